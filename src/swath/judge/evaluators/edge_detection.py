"""The detected crop edge against the one that stands in the field."""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose, wrap_angle
from swath.core.packed_state import saved_type
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import Samples, field_of
from swath.field.present_edge import SIDE_M, STEP_M, crop_across, edges_of
from swath.judge.evaluator import EvaluatorSetup, Metric
from swath.judge.kept_rows import KeptRows
from swath.judge.statistics import mean, rms
from swath.judge.together import Bits, Table
from swath.kernels import of_worlds, repeatable, shared
from swath.record.tracks import Column
from swath.signals import F64, CropEdge, MachineState, Signal

GROUP = "Edge detection"
NEAR_M = 5.0  # an edge this near to the header end has to be detected
FAR_M = 8.0  # one this near may be detected
MATCH_M = 1.5  # a detected edge is none that stands there when it is farther from it
SURE, WRONG_M = 0.5, 0.3  # confidence, and error, of an edge that is wrong and sure
RIGHT_M = 0.1  # error up to which an edge is right: what its confidence is the probability of
FEW = 0.5  # a metric over a smaller share of the samples is noted
NAN = float("nan")
BRIDGED = (
    "at a gap the true edge follows the gap and the detector bridges it: there the edge error is its depth"
)
CHUNK = 32  # samples that are judged together: a millisecond of work


@dataclass(frozen=True)
class EdgeSeries:
    """The course of a run, arrays of shape (n,): t [s], distance [m].

    true: y in the machine frame at the detector's reference [m] of the edge nearest to the detected one, or
    to the header end where none is detected; nan = none
    detected: likewise, nan = none; error: detected minus true [m], > 0 towards the crop, nan where they are
    farther apart than MATCH_M; found: an edge was reported; exists: one is near enough that it had to be
    confidence, is_held, offset_sd [m]: as reported
    across: error against the line across a gap of the initial edge [m], like `error`; nan beside none
    """

    t: F64
    distance: F64
    true: F64
    detected: F64
    error: F64
    found: NDArray[np.bool_]
    exists: NDArray[np.bool_]
    confidence: F64
    is_held: NDArray[np.bool_]
    offset_sd: F64
    across: F64


@saved_type()
@dataclass
class _Row:
    """A sample, its place, and whether crop stands on the line across the machine there, packed."""

    t: int
    distance: float
    edge: CropEdge
    crop: NDArray[np.uint8]
    place: tuple[float, float]  # of the reported edge in the world [m]


class EdgeDetection:
    """Detected against true edge, at the place ahead that the detector reports for.

    What stands there is looked up at the time of the sample, and judged later, many samples together.
    """

    OF_FIELD = False
    SIGNALS = (MachineState, CropEdge)
    COLUMNS = ("edge_true_m",)
    METRICS = (
        Metric("edge_rmse_m", "m", "detected against true edge, root mean square", GROUP,
               "lower", "edge error, RMS", "cm"),
        Metric("edge_bias_m", "m", "detected minus true edge, mean; > 0 towards the standing crop", GROUP,
               "", "edge error, mean", "cm"),
        Metric("detection_availability", "1", "share of edge samples with a right edge, where one is near; "
               "after settling", GROUP, "higher", "availability, settled", "%", 1),
        Metric("false_edge_share", "1", "share of the edges reported as seen that are none, no edge within "
               f"{MATCH_M:g} m", GROUP, "lower", "edges reported where none is", "%", 1),
        Metric("sure_wrong_share", "1", f"share of edge samples with a confidence of {SURE:g} or more and an "
               f"error above {WRONG_M:g} m", GROUP, "lower", "sure and wrong", "%", 1),
        Metric("unsure_right_share", "1", f"share of the edges with an error up to {RIGHT_M:g} m that have a "
               f"confidence below {SURE:g}; after settling", GROUP, "lower", "right, not sure", "%", 1),
        Metric("edge_sample_count", "", "edge samples that were judged", GROUP, "", "edge samples", "", 0),
        Metric("edge_judged_share", "1", "share of edge samples with a detected and a true edge, over which "
               "the edge error is", GROUP, "higher", "samples with both edges", "%", 1),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup, across: Callable[..., NDArray[np.bool_]] | None = None) -> None:
        self.setup = setup
        self._across = across  # None, which a save of the run can hold, is `crop_across`
        self.side = 1.0 if setup.machine.edge_side == "left" else -1.0  # +y or -y is the cut side
        self._reference, self._end_y = setup.machine.geometry.header_end(setup.machine.edge_side)[:2]
        self._begin = self._end_y + self.side * (FAR_M + SIDE_M)  # of the lines, on the cut side
        self._states: list[MachineState] = []
        self._waiting: list[CropEdge] = []
        self._rows: list[_Row] = []
        self._judged = KeptRows(10)
        self._newest: F64 | None = None  # row of those

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Look up what stands where an edge is reported, once the truth has reached its time."""
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self._states.append(signal)
                if len(self._states) > 512:
                    del self._states[:256]
            elif isinstance(signal, CropEdge):
                self._waiting.append(signal)
        self.look()

    def look(self) -> None:
        """What stands where edges were reported up to the time of the newest state."""
        if len(self._rows) >= CHUNK and not self._waiting:  # a tick with an edge has enough to do
            self._judge_rows()
        while self._waiting and self._states and self._waiting[0].t <= self._states[-1].t:
            self._look(self._waiting.pop(0))

    def beside(self, across: Callable[..., NDArray[np.bool_]]) -> "EdgeDetection":
        """A judge of another detector in the same run: it reads the states that this one keeps.

        Show it edges alone, and let it `look` after each state. across: in place of `crop_across`
        """
        other = EdgeDetection(self.setup, across)
        other._states = self._states
        return other

    @classmethod
    def together(cls, evaluators: Sequence["EdgeDetection"]) -> "_Together | None":
        """Of many worlds, where their fields are profiles and all lines across machines as long."""
        if any(getattr(e.setup.field, "profile", None) is None for e in evaluators):
            return None
        return _Together(evaluators)

    def metrics(self) -> dict[str, float]:
        """Of all edges; nothing of a machine without an edge detection."""
        if not self._rows and not self._judged and not self._waiting:
            return {}
        return edge_metrics(self.series(), settling=self.setup.settling_m)

    @property
    def notes(self) -> Sequence[str]:
        """Over how many samples the error is, where those are few; where a detector bridges a gap."""
        found, said = self.metrics(), []
        count, share = found.get("edge_sample_count", 0.0), found.get("edge_judged_share", 1.0)
        if share < FEW:
            said.append(f"the edge error is over {round(share * count)} of {count:.0f} edge samples")
        if found and bridges_gaps(self.series()):
            said.append(BRIDGED)
        return said

    @property
    def true_offset(self) -> float:
        """Of the newest judged sample, y in the machine frame [m], nan = there is no true edge."""
        if self._rows:
            return float(self._judge(self._rows[-1:])[0, 2])
        return NAN if self._newest is None else float(self._newest[2])

    @property
    def newest_t(self) -> int:
        """Time of the newest judged sample [ns], -1 before there is one."""
        return self._rows[-1].t if self._rows else -1 if self._newest is None else int(self._newest[0])

    def columns(self) -> tuple[Column, ...]:
        """The true edge, for the newest detected one."""
        meaning = "true edge at edge_reference_m, > 0 left"
        return (Column("edge_true_m", "m", meaning, later=self._true_at),)

    def series(self) -> EdgeSeries:
        """The course of the run so far."""
        self._judge_rows()
        table = self._judged.table()
        t, at, true, seen, found, exists, confidence, is_held, sd, across = table.T
        error = -self.side * (seen - true)
        error = np.where(np.abs(error) <= MATCH_M, error, np.nan)
        told = confidence, is_held > 0, sd, across
        return EdgeSeries(t / NS, at, true, seen, error, found > 0, exists > 0, *told)

    def _true_at(self, tracks: Mapping[str, F64]) -> F64:
        """y of the true edge [m] for the rows of the tracks."""
        series, asked = self.series(), tracks["edge_t_s"]
        if not len(series.t):
            return np.full(len(asked), np.nan)
        index = np.minimum(np.searchsorted(series.t, asked), len(series.t) - 1)
        return np.where(series.t[index] == asked, series.true[index], np.nan)

    def _look(self, edge: CropEdge) -> None:
        pose, distance = self._at(edge.t)
        if isfinite(edge.reference_x):  # where none is reported, the last one counts, at first the knife
            self._reference = edge.reference_x
        end = 2.0 * self._end_y - self._begin
        crop = (self._across or crop_across)(self.setup.field, pose, self._reference, self._begin, end)
        (px, py, _), ((ax, bx, _), (ay, by, _), _) = pose.numbers
        x, y = self._reference, edge.offset if edge.is_found else self._end_y
        place = px + ax * x + bx * y, py + ay * x + by * y
        self._rows.append(_Row(edge.t, distance, edge, np.packbits(crop), place))

    def _judge_rows(self) -> None:
        if self._rows:
            judged = self._judge(self._rows)
            self._judged.add(judged.ravel())
            self._newest = judged[-1].copy()
            self._rows = []

    def _judge(self, rows: Sequence[_Row]) -> F64:
        """Rows of t [ns], distance, true, seen, found, exists, confidence, is_held, offset_sd, across."""
        count = round(2.0 * (FAR_M + SIDE_M) / STEP_M)
        crop = np.unpackbits(np.stack([r.crop for r in rows]), axis=1, count=count).astype(bool)
        judged = []
        for row, places, across in zip(rows, edges_of(crop), self._across_gaps(rows), strict=True):
            edge, end = row.edge, self._end_y
            at = [self._begin - self.side * STEP_M * place for place in places.tolist()]
            seen, true = edge.offset if edge.is_found else NAN, NAN
            exists = any(abs(y - end) <= NEAR_M for y in at)
            if edge.is_found and at:
                true = _nearest(at, seen)
            elif exists:
                true = _nearest(at, end)
            told = edge.is_found, exists, edge.confidence, edge.is_held, edge.offset_sd, across
            judged.append((row.t, row.distance, true, seen, *told))
        return np.array(judged, dtype=float)

    def _across_gaps(self, rows: Sequence[_Row]) -> Sequence[float]:
        """How far inside the initial edge reported places lie that are beside its gaps [m], nan elsewhere."""
        if not self.setup.gaps:
            return [NAN] * len(rows)
        places, found = np.array([row.place for row in rows]), np.array([row.edge.is_found for row in rows])
        across: Sequence[float] = self.across_gaps(places, found).tolist()
        return across

    def across_gaps(self, places: F64, found: NDArray[np.bool_]) -> F64:
        """How far inside the initial edge places (n, 2) lie that are beside its gaps [m], nan elsewhere.

        found: an edge was reported there
        """
        x, y = places.T
        s = np.asarray(self.setup.edge.project(x, y)[0])
        gaps = [(s >= gap.start) & (s < gap.end) for gap in self.setup.gaps]
        is_beside = found & np.any(gaps, axis=0)
        return np.where(is_beside, self.setup.edge.signed_distance(x, y), NAN)

    def take(self, rows: F64) -> None:
        """Rows that were judged elsewhere."""
        self._judged.add(rows.ravel().tolist())
        self._newest = rows[-1].copy()

    def _at(self, t: int) -> tuple[Pose, float]:
        """True pose and distance at t [ns]; position and angles are interpolated between samples."""
        if self._states[-1].t == t:
            return self._states[-1].pose, self._states[-1].distance
        after = min(bisect_left(self._states, t, key=lambda s: s.t), len(self._states) - 1)
        b = self._states[after]
        if b.t == t or after == 0:
            return b.pose, b.distance
        first, second = ((s.t, s.pose, s.distance) for s in self._states[after - 1 : after + 1])
        return between_states(first, second, t)


class _Together:
    """The same in arrays: a line across each machine, and its edges, in one launch.

    states: time, poses, distances; waiting: edges of later times; rows: as in `_judge`, places: as in `_Row`
    """

    def __init__(self, evaluators: Sequence[EdgeDetection]) -> None:
        from swath.field.profile_kernel import Profile
        from swath.judge.edge_detection_kernel import edges_across

        n = len(evaluators)
        self._evaluators = evaluators
        self._side, self._end_y, self._begin, self._reference = np.array(
            [(e.side, e._end_y, e._begin, e._reference) for e in evaluators]
        ).T.copy()
        self._states: deque[tuple[int, F64, F64]] = deque(maxlen=512)
        self._waiting: deque[Samples] = deque()
        self._rows, self._places = Table(n, 10), Table(n, 2)
        count = round(2.0 * (FAR_M + SIDE_M) / STEP_M)
        self._starts, self._steps = np.zeros((2, n, 2))
        self._crop, self._counts = np.zeros((n, count), np.bool_), np.zeros(n, np.int32)
        self._edges = np.zeros((n, 16), np.int32)
        fields: list[Any] = [e.setup.field for e in evaluators]
        self._held = [field.profile.struct() for field in fields]
        inputs: list[Any] = [
            of_worlds(Profile, self._held),
            *(shared(array) for array in (self._starts, self._steps)),
            round(SIDE_M / STEP_M),
            *(shared(a) for a in (self._crop, np.zeros(n, np.int32), self._counts, self._edges)),
        ]
        self._launch = repeatable(edges_across, inputs, threads=n)
        self._worlds = np.arange(n)

    def see(self, slot: str, t: int, outputs: Mapping[str, Samples], active: Bits) -> None:
        """Look up what stands where edges are reported, once the truth has reached their time."""
        for samples in outputs.values():
            if samples.kind is MachineState:
                arrays = samples.arrays
                self._states.append((samples.t, arrays["pose"].copy(), arrays["distance"].copy()))
            elif samples.kind is CropEdge:
                self._waiting.append(samples.copy())
        while self._waiting and self._states and self._waiting[0].t <= self._states[-1][0]:
            self._look(self._waiting.popleft())

    def give(self, world: int) -> None:
        """What was seen of a world."""
        e, rows = self._evaluators[world], self._rows.news(world)
        places = self._places.news(world)
        if len(rows):
            if e.setup.gaps:
                rows[:, 9] = e.across_gaps(places, rows[:, 4] > 0.0)
            e.take(rows)
        e._waiting = [edge.of(world) for edge in self._waiting]

    def _look(self, edge: Samples) -> None:
        pose, distance = self._at(edge.t)
        offset, confidence, reference = (
            np.broadcast_to(field_of(edge, name), self._side.shape)
            for name in ("offset", "confidence", "reference_x")
        )
        told = np.isfinite(reference)
        self._reference[told] = reference[told]
        px, py, _, ax, bx, _, ay, by, *_ = pose.T
        begin = self._begin
        end = 2.0 * self._end_y - begin
        width = (end - begin) / self._crop.shape[1]
        self._starts[:, 0] = px + bx * begin + ax * self._reference
        self._starts[:, 1] = py + by * begin + ay * self._reference
        self._steps[:, 0], self._steps[:, 1] = bx * width, by * width
        self._launch.launch()
        found = (confidence > 0.0) & np.isfinite(offset)
        seen = np.where(found, offset, NAN)
        at = begin[:, None] - (self._side * STEP_M)[:, None] * self._edges
        at[np.arange(at.shape[1]) >= self._counts[:, None]] = np.inf
        exists = (np.abs(at - self._end_y[:, None]) <= NEAR_M).any(axis=1)
        to = np.where(found, offset, self._end_y)
        true = at[self._worlds, np.abs(at - to[:, None]).argmin(axis=1)]
        true[~((found & (self._counts > 0)) | exists)] = NAN
        more = (field_of(edge, name) for name in ("is_held", "offset_sd"))
        self._rows.add(self._worlds, edge.t, distance, true, seen, found, exists, confidence, *more, NAN)
        x, y = self._reference, to
        self._places.add(self._worlds, px + ax * x + bx * y, py + ay * x + by * y)

    def _at(self, t: int) -> tuple[F64, F64]:
        """As `EdgeDetection._at`, poses as numbers."""
        newest, pose, distance = self._states[-1]
        if newest == t:
            return pose, distance
        times = [state[0] for state in self._states]
        after = min(bisect_left(times, t), len(times) - 1)
        _, pose, distance = self._states[after]
        if times[after] == t or after == 0:
            return pose, distance
        poses, distances = [], []
        for world in range(len(pose)):
            first, second = (_state_of(self._states[k], world) for k in (after - 1, after))
            between, driven = between_states(first, second, t)
            place, rows = between.numbers
            poses.append([*place, *(v for row in rows for v in row)])
            distances.append(driven)
        return np.array(poses), np.array(distances)


def _state_of(state: tuple[int, F64, F64], world: int) -> tuple[int, Pose, float]:
    numbers = state[1][world].tolist()
    rows = [numbers[k : k + 3] for k in (3, 6, 9)]
    return state[0], Pose.of_numbers(numbers[:3], rows), float(state[2][world])


def between_states(
    first: tuple[int, Pose, float], second: tuple[int, Pose, float], t: int
) -> tuple[Pose, float]:
    """Pose and distance at t [ns] between two states (time, pose, distance); angles are interpolated."""
    (before, a, start), (after, b, end) = first, second
    share = (t - before) / (after - before)
    angles, last = np.array(a.euler()), np.array(b.euler())
    roll, pitch, yaw = angles + share * wrap_angle(last - angles)
    position = a.position + share * (b.position - a.position)
    return Pose.from_euler(position, roll, pitch, yaw), start + share * (end - start)


def bridges_gaps(series: EdgeSeries) -> bool:
    """Whether edges beside a gap were reported on the line across it, and not where the crop stands."""
    is_off = ~(np.abs(series.error) <= WRONG_M)
    return bool(np.any((np.abs(series.across) <= WRONG_M) & is_off))


def _nearest(places: Sequence[float], to: float) -> float:
    return min(places, key=lambda place: abs(place - to))


def edge_metrics(series: EdgeSeries, *, settling: float) -> dict[str, float]:
    """Quality of an edge detection. settling: driven before a machine has to have found its edge [m]"""
    right = np.isfinite(series.error)
    asked = series.exists & (series.distance >= settling)
    claimed = series.found & ~series.is_held
    off = ~right | (np.abs(series.error) > WRONG_M)
    near = claimed & (np.abs(series.error) <= RIGHT_M) & (series.distance >= settling)
    return {
        "edge_rmse_m": rms(series.error[right]),
        "edge_bias_m": mean(series.error[right]),
        "detection_availability": mean(right[asked].astype(float)),
        "false_edge_share": mean(~right[claimed]),
        "sure_wrong_share": mean(series.found & (series.confidence >= SURE) & off),
        "unsure_right_share": mean(series.confidence[near] < SURE),
        "edge_sample_count": float(len(series.t)),
        "edge_judged_share": mean(right),
    }


LEVEL = Level(EdgeDetection, None, summary="the detected edge against the one that stands in the field")
