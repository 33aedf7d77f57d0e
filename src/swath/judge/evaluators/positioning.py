"""How well a machine knows where it is, how long its receiver was without a fix, and what steered it."""

from collections.abc import Sequence
from math import hypot, isfinite

import numpy as np

from swath.core.blocks import Seen
from swath.core.frames import wrapped
from swath.core.portable import solve
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Event, KeptRows, Later, Metric, mean, rms
from swath.signals import F64, FIX_QUALITIES, Fix, GuidanceState, MachineState, PoseEstimate

GROUP = "Positioning"
FIXED = FIX_QUALITIES.index("fix")


class Positioning(Later):
    """The estimated pose against the true one, the quality of the fix, the time on a path.

    Events `fix_lost`: the receiver had a fix and has none until it comes back.
    """

    SIGNALS = (MachineState, Fix, PoseEstimate, GuidanceState)
    METRICS = (
        Metric("pose_error_rms_m", "m", "estimated against true place, root mean square", GROUP, "lower",
               "pose error, RMS"),
        Metric("pose_error_max_m", "m", "estimated against true place, largest", GROUP, "lower",
               "pose error, largest"),
        Metric("pose_heading_rms_rad", "rad", "estimated against true heading, root mean square", GROUP,
               "lower", "heading error, RMS"),
        Metric("pose_nees", "", "mean normalised estimation error squared of x, y, heading and speed; a "
               "consistent estimate has 4", GROUP, "", "NEES"),
        Metric("fix_share", "1", "share of the receiver's samples with the quality `fix`", GROUP, "higher",
               "with a fix"),
        Metric("fix_lost_max_s", "s", "longest time from losing the quality `fix` to having it again", GROUP,
               "lower", "longest without a fix"),
        Metric("path_share", "1", "share of the time on a path by the measured pose", GROUP, "",
               "steered along a path"),
    )  # fmt: skip
    EVENTS = ("fix_lost",)

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._setup = setup
        self._state: MachineState | None = None
        self._rows = KeptRows(3)  # error [m], of the heading [rad], NEES
        self._fixed = self._fix_count = self._led = self._state_count = 0
        self._lost: tuple[int, float, float, float] | None = None
        self._had_fix = False
        self._events: list[Event] = []
        self._longest = 0.0

    def take(self, seen: Seen) -> None:
        """Samples beside the true state of their time."""
        states = seen.of(MachineState)
        for poses in (block for block in (seen.of(PoseEstimate), seen.of(Fix)) if block is not None):
            at = np.full(len(poses), -1) if states is None else states.before(poses.orders)
            for k, i in enumerate(at.tolist()):
                state = self._state if states is None or i < 0 else states.sample(i)
                if poses.kind is PoseEstimate:
                    self._take(poses.sample(k), state)
                else:
                    self._hear(int(poses.times[k]), poses.sample(k), state)
        if (guided := seen.of(GuidanceState)) is not None:
            self._led += int(np.count_nonzero(guided["is_following"]))
            self._state_count += len(guided)
        if states is not None:
            self._state = states.newest

    def metrics(self) -> dict[str, float]:
        """Metrics of the sensors that the machine has."""
        found: dict[str, float] = {}
        if self._rows:
            off, turn, nees = (column.copy() for column in self._rows.table().T)
            found |= {"pose_error_rms_m": rms(off), "pose_error_max_m": float(off.max())}
            found |= {"pose_heading_rms_rad": rms(turn), "pose_nees": mean(nees[np.isfinite(nees)])}
        if self._fix_count:
            found |= {"fix_share": self._fixed / self._fix_count, "fix_lost_max_s": self._longest}
        if self._state_count:
            found["path_share"] = self._led / self._state_count
        return found

    def events(self) -> Sequence[Event]:
        """Every loss of the fix, and one that lasts."""
        if self._lost is None:
            return self._events
        return [*self._events, self._event(self._lost, None, float("nan"))]

    def _take(self, pose: PoseEstimate, state: MachineState | None) -> None:
        if state is None or not isfinite(pose.x) or not isfinite(pose.heading):
            return
        x, y, _ = state.pose.position.tolist()
        turn = pose.heading - state.pose.euler()[2]
        turn = wrapped(turn)
        error = np.array([pose.x - x, pose.y - y, turn, pose.speed - state.speed])
        self._rows.add((hypot(pose.x - x, pose.y - y), turn, _normalised(error, pose.covariance)))

    def _hear(self, t: int, fix: Fix, state: MachineState | None) -> None:
        is_fixed = fix.quality == FIXED
        self._had_fix = self._had_fix or is_fixed
        self._fixed += is_fixed
        self._fix_count += 1
        if state is None or not self._had_fix:
            return
        if not is_fixed and self._lost is None:
            x, y, _ = state.pose.position.tolist()
            self._lost = t, x, y, state.distance
        if self._lost is None:
            return
        self._longest = max(self._longest, (t - self._lost[0]) / NS)
        if is_fixed:
            self._events.append(self._event(self._lost, t, state.distance))
            self._lost = None

    def _event(self, lost: tuple[int, float, float, float], end: int | None, gone: float) -> Event:
        t, x, y, distance = lost
        text = f"the receiver of {self._setup.name} lost its fix"
        return Event(t, "fix_lost", self._setup.name, x, y, distance, text, end, end_distance=gone)


def _normalised(error: F64, covariance: F64) -> float:
    """Normalised squared error e' P^-1 e; nan where the covariance is not known or singular."""
    try:
        return float(np.einsum("k,k->", error, solve(covariance, error)))
    except ZeroDivisionError:
        return float("nan")


LEVEL = Level(Positioning, None, summary="the pose against the true one, the fix, and the time on a path")
