"""The detected crop edge against the one that stands in the field."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from swath.core.blocks import Block, Seen, Shown
from swath.core.frames import Pose, wrap_angle
from swath.core.number_text import num
from swath.core.packed_state import saved_type
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import plain
from swath.field.edges.present_edge import STEP_M, Holes, edges_of, whole_rows
from swath.judge.edge_looks import COUNT, REPORTED, EdgeLooks, LooksOfAll, span_across
from swath.judge.evaluator import NEVER, EvaluatorSetup, KeptRows, Later, Metric, is_among, mean, rms
from swath.record.tracks import Column
from swath.signals import F64, CropEdge, MachineState, Signal

GROUP = "Edge detection"
NEAR_M = 5.0  # an edge this near to the header end has to be detected
MATCH_M = 1.5  # a detected edge is none that stands there when it is farther from it
SURE = 0.5  # confidence from which on a detector is sure
WRONG_M = 0.3  # error beyond which an edge is wrong
DEVIATIONS = 3.0  # an error beyond so many of those that are reported is not reported
EPISODE_M = 1.0  # a longer distance wrong, sure and not reported is a hazardous episode
RIGHT_M = 0.1  # error up to which an edge is right: what its confidence is the probability of
FEW = 0.5  # a metric over a smaller share of the samples is noted
NAN = float("nan")
CHUNK = 32  # samples that are judged together: a millisecond of work
MOST = 512  # states that are kept


@dataclass(frozen=True)
class EdgeSeries:
    """The course of a run, arrays of shape (n,): t [s], distance [m].

    true: y in the machine frame at the detector's reference [m] of the line to be steered along; nan = none
    detected: likewise, nan = none
    error: detected minus true [m], > 0 towards the crop, nan where they are farther apart than MATCH_M
    found: an edge was reported
    exists: one is near enough that it had to be
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
        """Whether the detector reports an edge and is sure of it."""
        return self.found & (self.confidence >= SURE)

    @property
    def is_wrong(self) -> NDArray[np.bool_]:
        """Whether an edge is reported that is more than WRONG_M off, or where none is."""
        return self.found & ~(np.abs(self.error) <= WRONG_M)

    @property
    def is_hazardous(self) -> NDArray[np.bool_]:
        """Whether it is wrong and sure, and by more than DEVIATIONS of those that are reported."""
        return self.is_sure & self.is_wrong & ~(np.abs(self.error) <= DEVIATIONS * self.offset_sd)

    @property
    def is_none(self) -> NDArray[np.bool_]:
        """Whether an edge is reported where there is neither the line nor a wall."""
        return self.found & ~np.isfinite(self.error) & ~(np.abs(self.detected - self.wall) <= MATCH_M)

    def episodes(self) -> list[tuple[float, float]]:
        """Where hazardous samples go on unbroken for more than EPISODE_M: first and last distance [m]."""
        change = np.diff(self.is_hazardous.astype(int), prepend=0, append=0)
        begins, ends = self.distance[change[:-1] > 0], self.distance[change[1:] < 0]
        return [(a, b) for a, b in zip(begins.tolist(), ends.tolist(), strict=True) if b - a > EPISODE_M]


@saved_type("t", "rows")
class States:
    """The newest places of a machine. t [ns], (n,); rows: pose as 12 numbers, distance [m], (n, 13)."""

    def __init__(self, t: NDArray[np.int64] | None = None, rows: F64 | None = None) -> None:
        self.t = np.zeros(0, np.int64) if t is None else t
        self.rows = np.zeros((0, 13)) if rows is None else rows

    def take(self, block: Block) -> None:
        """Note more of them."""
        more = self.with_block(block)
        self.t, self.rows = more.t[-MOST:], more.rows[-MOST:]

    def with_block(self, block: Block | None) -> "States":
        """Add a block of samples."""
        if block is None:
            return self
        rows = np.concatenate([block["pose"], block["distance"][:, None]], axis=1)
        return States(np.concatenate([self.t, block["t"]]), np.concatenate([self.rows, rows]))

    @property
    def newest_t(self) -> int:
        """Time of the newest [ns], -1 = none."""
        return int(self.t[-1]) if len(self.t) else -1

    def at(self, t: int) -> list[float]:
        """True row at t [ns]; position and angles are interpolated."""
        after = min(int(np.searchsorted(self.t, t)), len(self.t) - 1)
        if self.t[after] == t or after == 0:
            found: list[float] = self.rows[after].tolist()
            return found
        pose, distance = between_states(self._of(after - 1), self._of(after), t)
        return [*plain(pose), distance]

    def _of(self, k: int) -> tuple[int, Pose, float]:
        return int(self.t[k]), _pose_of(self.rows[k, :12]), float(self.rows[k, 12])


def _pose_of(numbers: F64) -> Pose:
    values = list(map(float, numbers))
    return Pose.of_numbers(values[:3], [values[i : i + 3] for i in (3, 6, 9)])


class EdgeDetection(Later):
    """Detected against true edge, at the place ahead that the detector reports for.

    What stands there is looked up at the time of the sample, and judged later, many together.
    reference: x of the newest line across the machine [m]
    """

    __slots__ = ("_alone", "_together")  # who looks for it, alone or with others: no part of a saved state
    SIGNALS = (MachineState, CropEdge)
    live = (CropEdge,)
    COLUMNS = ("edge_true_m", "edge_wall_m")
    METRICS = (
        Metric("edge_rmse_m", "m", "detected against true edge, root mean square; after settling", GROUP,
               "lower", "edge error, RMS"),
        Metric("edge_bias_m", "m", "detected minus true edge, mean; > 0 towards the standing crop; after "
               "settling", GROUP, "", "edge error, mean"),
        Metric("detection_availability", "1", "share of edge samples with a right edge, where one is near; "
               "after settling", GROUP, "higher", "availability"),
        Metric("false_edge_share", "1", "share of the edges reported as seen that are none, no edge within "
               f"{num(MATCH_M)} m; after settling", GROUP, "lower", "edges reported where none is"),
        Metric("sure_wrong_share", "1", f"share of edge samples with a confidence of {num(SURE)} or more and "
               f"an error above {num(WRONG_M)} m; after settling", GROUP, "lower", "sure and wrong"),
        Metric("unsure_right_share", "1", f"share of the edges with an error up to {num(RIGHT_M)} m that "
               f"have a confidence below {num(SURE)}; after settling", GROUP, "lower", "right, not sure"),
        Metric("edge_sample_count", "", "edge samples that were judged; after settling", GROUP, "",
               "edge samples"),
        Metric("edge_judged_share", "1", "share of edge samples with a detected and a true edge, over which "
               "the edge error is; after settling", GROUP, "higher", "samples with both edges"),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self.side = 1.0 if setup.machine.edge_side == "left" else -1.0  # +y or -y is the cut side
        self.reference, self._end_y = setup.machine.geometry.header_end(setup.machine.edge_side)[:2]
        self._states = States()
        self.rests_until = NEVER  # unless the truth has to reach the time of an edge
        self._waiting: list[list[float]] = []  # t and REPORTED of samples that are before the truth
        self._rows: list[F64] = []  # as of `EdgeLooks`
        self._crop: list[NDArray[np.uint8]] = []  # where it stands on the line across, packed
        self._judged = KeptRows(10)
        self._newest: F64 | None = None  # row of those
        self._alone: EdgeLooks | None = None
        self._together: Callable[[], LooksOfAll | None] = no_looks

    def take(self, seen: Seen) -> None:
        """Note where the machine was."""
        if (states := seen.of(MachineState)) is not None:
            self._states.take(states)

    @classmethod
    def looking(
        cls, parts: Sequence["EdgeDetection"], slot: str, kinds: Sequence[type[Signal]]
    ) -> LooksOfAll | None:
        """What looks at edges for these in many worlds, compiled."""
        if not is_among((*kinds,), cls.live):
            return None
        found = LooksOfAll(parts)
        for judge in parts:
            judge._together = ref(found)
        return found

    def see_live(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Look up what stands where edges are reported, once the truth has reached their times."""
        shown = Shown.of_one(outputs)
        reported = [shown.number(CropEdge, name) for name in ("t", *REPORTED)]
        edge = None if reported[0] is None else list(map(float, reported))
        self.wait(edge, shown.waiting(MachineState, self.setup.name))

    def wait(self, edge: list[float] | None, more: Block | None = None) -> None:
        """Look where the truth has reached the times of edges. edge: one more, its t and REPORTED.

        more: states that it was not given yet
        """
        self._waiting += [] if edge is None else [edge]
        known = self._states.with_block(more) if self._waiting else self._states
        while self._waiting and self._waiting[0][0] <= known.newest_t:
            edge = self._waiting.pop(0)
            self._alone = self._alone or EdgeLooks([self.setup])
            self._alone.reference[0] = self.reference
            self._alone.look_at(edge, known.at(int(edge[0])))
            self.add(*self._alone.take(0), float(self._alone.reference[0]))
        self.rests_until = 0 if self._waiting else NEVER

    @property
    def is_waiting(self) -> bool:
        """Whether the truth has not reached the time of an edge."""
        return bool(self._waiting)

    def add(self, rows: F64, crop: NDArray[np.uint8], reference: float) -> None:
        """What was seen, as `EdgeLooks` gives it; the newest reference [m]."""
        self._rows.append(rows)
        self._crop.append(crop)
        self.reference = reference
        if sum([len(own) for own in self._rows]) >= CHUNK:
            self._judge_rows()

    def look(self) -> None:
        """Look up what stands where edges were reported up to the time of the newest state."""
        self.wait(None)

    def beside(self, states: "States") -> "EdgeDetection":
        """A judge of another detector in the same run. states: that others note for it.

        Show it edges alone, and let it `look` after each state.
        """
        other = EdgeDetection(self.setup)
        other._states = states
        return other

    def metrics(self) -> dict[str, float]:
        """Metrics of all edges; none of a machine without an edge detection."""
        self._catch_up()
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
        return [f"the edge error is over {round(share * count)} of {num(count)} edge samples"]

    @property
    def true_offset(self) -> float:
        """True edge at the newest judged sample, y in the machine frame [m], nan = there is none."""
        self._catch_up()
        self._judge_rows()
        return NAN if self._newest is None else float(self._newest[2])

    @property
    def newest_t(self) -> int:
        """Time of the newest judged sample [ns], -1 before there is one."""
        self._catch_up()
        return int(self._rows[-1][-1, 0] if self._rows else -1 if self._newest is None else self._newest[0])

    def columns(self) -> tuple[Column, ...]:
        """The true edge and the crop that stands, for the newest detected edge."""
        at = "at edge_reference_m, > 0 left"
        wall = f"edge of the crop that stands, holes included, {at}"
        return (
            Column("edge_true_m", "m", f"true edge {at}", later=partial(self._at_rows, "true")),
            Column("edge_wall_m", "m", wall, later=partial(self._at_rows, "wall")),
        )

    def series(self, most: int | None = None) -> EdgeSeries:
        """The course of the run so far. most: samples, spread evenly, where there are more."""
        self._catch_up()
        self._judge_rows()
        table = self._judged.table(most)
        t, at, true, seen, found, exists, confidence, is_held, sd, wall = table.T
        error = -self.side * (seen - true)
        error = np.where(np.abs(error) <= MATCH_M, error, np.nan)
        reported = confidence, is_held > 0, sd, wall
        return EdgeSeries(t / NS, at, true, seen, error, found > 0, exists > 0, *reported)

    def _at_rows(self, name: str, tracks: Mapping[str, F64]) -> F64:
        """An array of the series for the rows of the tracks."""
        series, asked = self.series(), tracks["edge_t_s"]
        if not len(series.t):
            return np.full(len(asked), np.nan)
        index = np.minimum(np.searchsorted(series.t, asked), len(series.t) - 1)
        return np.where(series.t[index] == asked, getattr(series, name)[index], np.nan)

    def _catch_up(self) -> None:
        """Take what was seen with others since the last look."""
        if (together := self._together()) is not None:
            together.look()

    def _judge_rows(self) -> None:
        """Judge what was looked up: rows of `KeptRows`, as `series` reads them."""
        if not self._rows:
            return
        table = np.concatenate(self._rows)
        crop = np.unpackbits(np.concatenate(self._crop), axis=1, count=COUNT).astype(bool)
        self._rows, self._crop = [], []
        begin, width = span_across(self.setup)
        if self.setup.field.rows is not None:
            for k, (bx, by, ax, ay, *start) in enumerate(table[:, 10:].tolist()):
                pose = 0.0, 0.0, 0.0, ax, bx, 0.0, ay, by
                crop[k] = whole_rows(self.setup.field, crop[k : k + 1], pose, [start], width)
        places = edges_of(crop)
        at = np.full((len(table), 1 + max(map(len, places))), NAN)
        for k, own in enumerate(places):
            at[k, : len(own)] = own
        at = begin - self.side * STEP_M * at
        t, distance, offset, confidence, is_held, sd = table[:, :6].T
        found = (confidence > 0.0) & np.isfinite(offset)
        exists = (np.abs(at - self._end_y) <= NEAR_M).any(axis=1)
        seen = np.where(found, offset, NAN)
        asked = np.where(found, seen, np.where(exists, self._end_y, NAN))
        gap = np.abs(at - asked[:, None])
        nearest = np.where(np.isfinite(gap), gap, np.inf).argmin(axis=1)
        wall = np.where(np.isfinite(asked), at[np.arange(len(at)), nearest], NAN)
        line = self.lines(table[:, 6:12]) if self.setup.gaps else NAN
        true = np.where(np.isfinite(line), line, wall)
        judged = np.stack((t, distance, true, seen, found, exists, confidence, is_held, sd, wall), axis=1)
        self._judged.add(judged)
        self._newest = judged[-1].copy()

    def lines(self, places: F64) -> F64:
        """Lateral place of the line across a hole of an edge with gaps [m], (n,); nan where no hole is.

        places: x, y of the header end at the detector's reference, then at the knife, then the machine's y
        axis, in the world, (n, 6)
        """
        holes = Holes(self.setup.edge, self.setup.gaps, 0.5 * self.setup.machine.geometry.header_width)
        return self._end_y + holes.line(places[:, :2], places[:, 4:], places[:, 2:4])


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


def edge_metrics(series: EdgeSeries, *, settling: float) -> dict[str, float]:
    """Quality of an edge detection. settling: driven before a machine has to have found its edge [m]."""
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


def no_looks() -> None:
    """Nobody looks for it together with others."""


LEVEL = Level(EdgeDetection, None, summary="the detected edge against the one that stands in the field")
