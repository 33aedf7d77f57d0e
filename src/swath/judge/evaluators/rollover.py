"""Whether a machine rolls over; the run then ends."""

from collections.abc import Mapping, Sequence
from math import acos, cos, degrees, radians, sqrt

import numpy as np

from swath.core.portable import product
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import Samples
from swath.judge.evaluator import EvaluatorSetup, Event, Metric
from swath.judge.together import Bits, Woken, newest_of
from swath.signals import MachineState, Signal

TIPPED = radians(20.0)  # one side's wheels are a metre up, the header's end is in the ground
PERIOD = NS // 50  # of looking [ns]
NEAR = np.array([[1.5, 0.0], [-1.5, 0.0], [0.0, 1.5], [0.0, -1.5]])  # where the ground is looked up [m]


class Rollover:
    """Event `rollover`: the machine is tilted by more than 20 degrees, against the vertical and against the
    ground under it.

    Only the motion level `multibody` can do that: others keep the machine on the ground. What lies on its
    side would slide, dig in and break; no level says how, so that the run ends there, and fails.
    """

    OF_FIELD = False
    SIGNALS = (MachineState,)
    METRICS = (
        Metric("rollover_count", "", "times that the machine rolled over, which ends the run", "Safety",
               "lower", "rolled over", "", decimals=0, is_windowed=False),
    )  # fmt: skip
    EVENTS = ("rollover",)
    LIMITS: Mapping[str, Mapping[str, float]] = {"rollover_count": {"max": 0.0}}

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self.rests_until = 0
        self._events: list[Event] = []

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Look how the machine stands."""
        for signal in outputs.values():
            if isinstance(signal, MachineState) and signal.t >= self.rests_until and not self._events:
                self.rests_until = signal.t + PERIOD
                if signal.pose.numbers[1][2][2] < cos(TIPPED) and (tilt := self._tilt(signal)) > TIPPED:
                    self._note(signal, tilt)

    @classmethod
    def together(cls, evaluators: Sequence["Rollover"]) -> Woken:
        """Of many worlds."""
        until = np.zeros(1, np.int64)

        def asks(t: int, outputs: Mapping[str, Samples], active: Bits) -> Bits | None:
            state = newest_of(outputs, MachineState)
            if state is None or state.t < until[0]:
                return None
            until[0] = state.t + PERIOD
            leans: Bits = state.arrays["pose"][:, 11] < cos(TIPPED)
            for world in np.flatnonzero(leans).tolist():
                evaluators[world].rests_until = state.t
            return leans

        return Woken(evaluators, asks)

    def metrics(self) -> dict[str, float]:
        """1 for a machine that rolled over, else 0."""
        return {"rollover_count": float(len(self._events))}

    def events(self) -> Sequence[Event]:
        """At most one."""
        return self._events

    def end_reason(self, t: int) -> str:
        """The rollover, once there was one."""
        return self._events[0].text if self._events else ""

    def _tilt(self, state: MachineState) -> float:
        """Angle between the machine's vertical axis and the normal of the ground under it [rad]."""
        up = state.pose.rotation[:, 2]
        x, y = (state.pose.position[:2] + NEAR).T
        east, west, north, south = np.asarray(self.setup.field.ground_height(x, y)).tolist()
        normal = np.array([(west - east) / 3.0, (south - north) / 3.0, 1.0])
        return acos(min(max(float(product(up, normal)) / sqrt(float(product(normal, normal))), -1.0), 1.0))

    def _note(self, state: MachineState, tilt: float) -> None:
        x, y, _ = (float(v) for v in state.pose.position)
        where = f"at {state.t / NS:.1f} s, x = {x:.1f} m, y = {y:.1f} m"
        text = f"rolled over {where}: tilted by {degrees(tilt):.0f} deg against the ground"
        begun = state.t, "rollover", self.setup.name, x, y, state.distance
        self._events.append(Event(*begun, text, end_t=state.t))


LEVEL = Level(Rollover, None, summary="whether a machine rolls over, which ends the run")
