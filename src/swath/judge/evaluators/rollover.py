"""Whether a machine rolls over; the run then ends."""

from collections.abc import Mapping, Sequence
from math import acos, cos, degrees, radians, sqrt

import numpy as np

from swath.core.blocks import Block, Seen
from swath.core.number_text import num
from swath.core.portable import product
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Event, Later, Metric
from swath.judge.waking import Waking, times_of
from swath.kernels import Repeated
from swath.signals import MachineState, Signal

TIPPED = radians(20.0)  # one side's wheels are a metre up, the header's end is in the ground
PERIOD = NS // 50  # of looking, or several of them [ns]
FASTEST = (
    1.5  # that a machine on the ground tilts [rad/s]: free, a body of 2 m falls over its wheels more slowly
)
NEAR = np.array([[1.5, 0.0], [-1.5, 0.0], [0.0, 1.5], [0.0, -1.5]])  # where the ground is looked up [m]


class Rollover(Later):
    """Event `rollover`: the machine is tilted by more than 20 degrees, against the vertical and against the
    ground under it.

    Only the motion level `multibody` can do that: others keep the machine on the ground. What lies on its
    side would slide, dig in and break; no level says how, so that the run ends there, and fails.
    """

    SIGNALS = (MachineState,)
    live = ()  # types that it has to be shown though it rests
    METRICS = (
        Metric("rollover_count", "", "times that the machine rolled over, which ends the run", "Safety",
               "lower", "rolled over", is_windowed=False),
    )  # fmt: skip
    EVENTS = ("rollover",)
    LIMITS: Mapping[str, Mapping[str, float]] = {"rollover_count": {"max": 0.0}}

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self.rests_until = 0
        self._events: list[Event] = []

    @classmethod
    def looking(cls, parts: Sequence["Rollover"], slot: str, kinds: Sequence[type[Signal]]) -> "_Tilts":
        """What looks at every state for these in many worlds, compiled."""
        return _Tilts(parts)

    def see_live(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Look how the machine stands now."""
        self.take(Seen.of_one(slot, t, outputs))

    def take(self, seen: Seen) -> None:
        """Look how the machine stood. What was seen once is seen no more."""
        if (states := seen.of(MachineState)) is not None:
            self.stand(states)

    def stand(self, states: Block) -> None:
        """The same for states."""
        times, first = states["t"], 0
        while not self._events and len(due := (times[first:] >= self.rests_until).nonzero()[0]):
            k = first + int(due[0])
            upright, first = float(states["pose"][k, -1]), k + 1
            left = TIPPED - acos(min(max(upright, -1.0), 1.0))
            self.rests_until = int(times[k]) + PERIOD * max(1, int(left / FASTEST * NS / PERIOD))
            if upright < cos(TIPPED):
                state = states.sample(k)
                if (tilt := self._tilt(state)) > TIPPED:
                    self._note(state, tilt)

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
        where = f"at {num(state.t / NS, places=1)} s, x = {num(x, places=1)} m, y = {num(y, places=1)} m"
        text = f"rolled over {where}: tilted by {num(degrees(tilt))} deg against the ground"
        begun = state.t, "rollover", self.setup.name, x, y, state.distance
        self._events.append(Event(*begun, text, end_t=state.t))


class _Tilts(Waking):
    """Machines that are tilted against the vertical: only they may have rolled over."""

    def launches(self) -> Sequence[Repeated]:
        """One launch."""
        from swath.judge.look_kernel import watch_tilt

        state, self._rests = self.given["state"], np.array([part.rests_until for part in self.parts])
        seen = times_of(state), state.arrays["pose"], cos(TIPPED), self._rests
        return [self.launch(watch_tilt, self.needs, self.active, *seen, self.asks)]

    def wake(self, world: int) -> None:
        """Look at all states that the evaluator was not given yet."""
        part = self.parts[world]
        if (states := self.blocks.waiting(world, MachineState, part.setup.name)) is not None:
            part.stand(states)
        self._rests[world] = part.rests_until


LEVEL = Level(Rollover, None, summary="whether a machine rolls over, which ends the run")
