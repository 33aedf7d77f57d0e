"""The detected crop edge against the one that stands in the field."""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.frames import Pose, wrap_angle
from swath.core.packed_state import saved_type
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import Samples, field_of
from swath.field.present_edge import SIDE_M, STEP_M, Holes, crop_across, edges_of
from swath.judge.evaluator import EvaluatorSetup, KeptRows, Metric, mean, rms
from swath.judge.together import Bits, Table
from swath.kernels import of_worlds, repeatable, shared
from swath.record.tracks import Column
from swath.signals import F64, CropEdge, MachineState, Signal

GROUP = "Edge detection"
NEAR_M = 5.0  # an edge this near to the header end has to be detected
FAR_M = 8.0  # one this near may be detected
MATCH_M = 1.5  # a detected edge is none that stands there when it is farther from it
SURE = 0.5  # confidence from which on a detector is sure
WRONG_M = 0.3  # error beyond which an edge is wrong
DEVIATIONS = 3.0  # an error beyond so many of those that are told is not told
EPISODE_M = 1.0  # a longer way wrong, sure and not told is a hazardous episode
RIGHT_M = 0.1  # error up to which an edge is right: what its confidence is the probability of
FEW = 0.5  # a metric over a smaller share of the samples is noted
NAN = float("nan")
CHUNK = 32  # samples that are judged together: a millisecond of work


@dataclass(frozen=True)
class EdgeSeries:
    """The course of a run, arrays of shape (n,): t [s], distance [m].

    true: y in the machine frame at the detector's reference [m] of the line to be steered along; nan = none
    detected: likewise, nan = none; error: detected minus true [m], > 0 towards the crop, nan where they are
    farther apart than MATCH_M; found: an edge was reported; exists: one is near enough that it had to be
    confidence, is_held, offset_sd [m]: as reported
    wall: y of the crop that stands, nearest to the detected edge, or to the header end where none is detected
    [m]; it is the true edge but across a hole of the initial edge, see `present_edge.Holes`; nan = none
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
    wall: F64

    def settled(self, settling: float) -> "EdgeSeries":
        """What is judged: without the first metres driven [m]."""
        is_judged = self.distance >= settling
        return EdgeSeries(*(getattr(self, f.name)[is_judged] for f in fields(self)))

    @property
    def is_sure(self) -> NDArray[np.bool_]:
        """Whether the detector tells an edge and is sure of it."""
        return self.found & (self.confidence >= SURE)

    @property
    def is_wrong(self) -> NDArray[np.bool_]:
        """Whether an edge is told that is more than WRONG_M off, or where none is."""
        return self.found & ~(np.abs(self.error) <= WRONG_M)

    @property
    def is_hazardous(self) -> NDArray[np.bool_]:
        """Whether it is wrong and sure, and by more than DEVIATIONS of those that are told."""
        return self.is_sure & self.is_wrong & ~(np.abs(self.error) <= DEVIATIONS * self.offset_sd)

    @property
    def is_none(self) -> NDArray[np.bool_]:
        """Whether an edge is told where there is neither the line nor a wall."""
        return self.found & ~np.isfinite(self.error) & ~(np.abs(self.detected - self.wall) <= MATCH_M)

    def episodes(self) -> list[tuple[float, float]]:
        """Where hazardous samples go on unbroken for more than EPISODE_M: first and last distance [m]."""
        change = np.diff(self.is_hazardous.astype(int), prepend=0, append=0)
        begins, ends = self.distance[change[:-1] > 0], self.distance[change[1:] < 0]
        return [(a, b) for a, b in zip(begins.tolist(), ends.tolist(), strict=True) if b - a > EPISODE_M]


@saved_type()
@dataclass
class _Row:
    """A sample, where it was, and whether crop stands on the line across the machine there, packed."""

    t: int
    distance: float
    edge: CropEdge
    crop: NDArray[np.uint8]
    place: tuple[float, ...]  # as in `lines`


class EdgeDetection:
    """Detected against true edge, at the place ahead that the detector reports for.

    What stands there is looked up at the time of the sample, and judged later, many samples together.
    """

    OF_FIELD = False
    SIGNALS = (MachineState, CropEdge)
    COLUMNS = ("edge_true_m", "edge_wall_m")
    METRICS = (
        Metric("edge_rmse_m", "m", "detected against true edge, root mean square; after settling", GROUP,
               "lower", "edge error, RMS", "cm"),
        Metric("edge_bias_m", "m", "detected minus true edge, mean; > 0 towards the standing crop; after "
               "settling", GROUP, "", "edge error, mean", "cm"),
        Metric("detection_availability", "1", "share of edge samples with a right edge, where one is near; "
               "after settling", GROUP, "higher", "availability", "%", 1),
        Metric("false_edge_share", "1", "share of the edges reported as seen that are none, no edge within "
               f"{MATCH_M:g} m; after settling", GROUP, "lower", "edges reported where none is", "%", 1),
        Metric("sure_wrong_share", "1", f"share of edge samples with a confidence of {SURE:g} or more and an "
               f"error above {WRONG_M:g} m; after settling", GROUP, "lower", "sure and wrong", "%", 1),
        Metric("unsure_right_share", "1", f"share of the edges with an error up to {RIGHT_M:g} m that have a "
               f"confidence below {SURE:g}; after settling", GROUP, "lower", "right, not sure", "%", 1),
        Metric("edge_sample_count", "", "edge samples that were judged; after settling", GROUP, "",
               "edge samples", "", 0),
        Metric("edge_judged_share", "1", "share of edge samples with a detected and a true edge, over which "
               "the edge error is; after settling", GROUP, "higher", "samples with both edges", "%", 1),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup, across: Callable[..., NDArray[np.bool_]] | None = None) -> None:
        self.setup = setup
        self._across = across  # None, which a save of the run can hold, is `crop_across`
        self.side = 1.0 if setup.machine.edge_side == "left" else -1.0  # +y or -y is the cut side
        self._reference, self._end_y = setup.machine.geometry.header_end(setup.machine.edge_side)[:2]
        self._begin = self._end_y + self.side * (FAR_M + SIDE_M)  # of the lines, on the cut side
        self._knife_x = self._reference
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
        """Of many worlds, where their fields are profiles without rows."""
        fields = [e.setup.field for e in evaluators]
        if any(getattr(f, "profile", None) is None or f.rows is not None for f in fields):
            return None
        return _Together(evaluators)

    def metrics(self) -> dict[str, float]:
        """Of all edges; nothing of a machine without an edge detection."""
        if not self._rows and not self._judged and not self._waiting:
            return {}
        return edge_metrics(self.series(), settling=self.setup.settling_m)

    @property
    def notes(self) -> Sequence[str]:
        """Over how many samples the error is, where those are few."""
        found = self.metrics()
        count, share = found.get("edge_sample_count", 0.0), found.get("edge_judged_share", 1.0)
        if not share < FEW:
            return []
        return [f"the edge error is over {round(share * count)} of {count:.0f} edge samples"]

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
        """The true edge and the crop that stands, for the newest detected edge."""
        at = "at edge_reference_m, > 0 left"
        wall = f"edge of the crop that stands, holes included, {at}"
        return (
            Column("edge_true_m", "m", f"true edge {at}", later=partial(self._at_rows, "true")),
            Column("edge_wall_m", "m", wall, later=partial(self._at_rows, "wall")),
        )

    def series(self, most: int | None = None) -> EdgeSeries:
        """The course of the run so far. most: samples, spread evenly, where there are more"""
        self._judge_rows()
        table = self._judged.table(most)
        t, at, true, seen, found, exists, confidence, is_held, sd, wall = table.T
        error = -self.side * (seen - true)
        error = np.where(np.abs(error) <= MATCH_M, error, np.nan)
        told = confidence, is_held > 0, sd, wall
        return EdgeSeries(t / NS, at, true, seen, error, found > 0, exists > 0, *told)

    def _at_rows(self, name: str, tracks: Mapping[str, F64]) -> F64:
        """An array of the series for the rows of the tracks."""
        series, asked = self.series(), tracks["edge_t_s"]
        if not len(series.t):
            return np.full(len(asked), np.nan)
        index = np.minimum(np.searchsorted(series.t, asked), len(series.t) - 1)
        return np.where(series.t[index] == asked, getattr(series, name)[index], np.nan)

    def _look(self, edge: CropEdge) -> None:
        pose, distance = self._at(edge.t)
        if isfinite(edge.reference_x):  # where none is reported, the last one counts, at first the knife
            self._reference = edge.reference_x
        end = 2.0 * self._end_y - self._begin
        crop = (self._across or crop_across)(self.setup.field, pose, self._reference, self._begin, end)
        (px, py, _), ((ax, bx, _), (ay, by, _), _) = pose.numbers
        place = _place((px, ax, bx), (py, ay, by), (self._reference, self._knife_x), self._end_y)
        self._rows.append(_Row(edge.t, distance, edge, np.packbits(crop), place))

    def _judge_rows(self) -> None:
        if self._rows:
            judged = self._judge(self._rows)
            self._judged.add(judged.ravel())
            self._newest = judged[-1].copy()
            self._rows = []

    def _judge(self, rows: Sequence[_Row]) -> F64:
        """Rows of t [ns], distance, true, seen, found, exists, confidence, is_held, offset_sd, wall."""
        count = round(2.0 * (FAR_M + SIDE_M) / STEP_M)
        crop = np.unpackbits(np.stack([r.crop for r in rows]), axis=1, count=count).astype(bool)
        judged = []
        lines = self.lines(np.array([row.place for row in rows])).tolist()
        for row, places, line in zip(rows, edges_of(crop), lines, strict=True):
            edge, end = row.edge, self._end_y
            at = [self._begin - self.side * STEP_M * place for place in places.tolist()]
            seen, wall = edge.offset if edge.is_found else NAN, NAN
            exists = any(abs(y - end) <= NEAR_M for y in at)
            if edge.is_found and at:
                wall = _nearest(at, seen)
            elif exists:
                wall = _nearest(at, end)
            true = line if isfinite(line) else wall
            told = edge.is_found, exists, edge.confidence, edge.is_held, edge.offset_sd, wall
            judged.append((row.t, row.distance, true, seen, *told))
        return np.array(judged, dtype=float)

    def lines(self, places: F64) -> F64:
        """y of the line across a hole of the initial edge [m], (n,); nan where no hole is.

        places: x, y of the header end at the detector's reference, then at the knife, then the machine's y
        axis, in the world, (n, 6)
        """
        if not self.setup.gaps:
            return np.full(len(places), NAN)
        holes = Holes(self.setup.edge, self.setup.gaps, 0.5 * self.setup.machine.geometry.header_width)
        return self._end_y + holes.line(places[:, :2], places[:, 4:], places[:, 2:4])

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

    states: time, poses, distances; waiting: edges of later times; rows: as in `_judge`, places: as in `lines`
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
        self._rows, self._places = Table(n, 10), Table(n, 6)
        self._knife_x = self._reference.copy()
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
                lines = e.lines(places)
                rows[:, 2] = np.where(np.isfinite(lines), lines, rows[:, 2])
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
        wall = at[self._worlds, np.abs(at - to[:, None]).argmin(axis=1)]
        wall[~((found & (self._counts > 0)) | exists)] = NAN
        more = (field_of(edge, name) for name in ("is_held", "offset_sd"))
        self._rows.add(self._worlds, edge.t, distance, wall, seen, found, exists, confidence, *more, wall)
        place = _place((px, ax, bx), (py, ay, by), (self._reference, self._knife_x), self._end_y)
        self._places.add(self._worlds, *place)

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


def _place(x: tuple[Any, ...], y: tuple[Any, ...], ahead: tuple[Any, Any], left: Any) -> tuple[Any, ...]:
    """Points of a machine in the world, and its y axis there, as in `EdgeDetection.lines`.

    x, y: of the world, each with its rate along the machine's x and y axis; ahead, left: in the machine
    """
    ends = [v + a * at + b * left for at in ahead for v, a, b in (x, y)]
    return *ends, x[2], y[2]


def _nearest(places: Sequence[float], to: float) -> float:
    return min(places, key=lambda place: abs(place - to))


def edge_metrics(series: EdgeSeries, *, settling: float) -> dict[str, float]:
    """Quality of an edge detection. settling: driven before a machine has to have found its edge [m]"""
    s = series.settled(settling)
    is_judged = np.isfinite(s.error)
    claimed = s.found & ~s.is_held
    right = claimed & (np.abs(s.error) <= RIGHT_M)
    return {
        "edge_rmse_m": rms(s.error[is_judged]),
        "edge_bias_m": mean(s.error[is_judged]),
        "detection_availability": mean(is_judged[s.exists].astype(float)),
        "false_edge_share": mean(s.is_none[claimed]),
        "sure_wrong_share": mean(s.is_sure & s.is_wrong),
        "unsure_right_share": mean(~s.is_sure[right]),
        "edge_sample_count": float(len(s.t)),
        "edge_judged_share": mean(is_judged),
    }


LEVEL = Level(EdgeDetection, None, summary="the detected edge against the one that stands in the field")
