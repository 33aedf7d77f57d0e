"""How often a machine stopped on its way, and because of what.

A stop is because of an obstacle or another machine where the machine's slot `objects` reported, with a
confidence of 0.5 or more and while it may have braked, of something within 1 m of the box around it. Where it
reported nothing that is there, it stopped for a phantom, or for another reason than an object.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from swath.core.blocks import Seen, number_of, samples_of
from swath.core.number_text import num
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Event, Later, Metric
from swath.signals import MachineState, Objects, Signal

STANDS, DRIVES = 0.05, 0.5  # m/s: slower it stands, faster it has driven
SURE = 0.5  # confidence from which on an object counts
NEAR_M = 1.0  # from a box to the middle of an object that reports it, in the plane
LOOKED_BACK = 6 * NS  # from the stop: to brake from 10 km/h at 0.6 m/s2, and to react, takes as long


class Stops(Later):
    """Events `stop`: the machine drove, and stands."""

    SIGNALS = (MachineState, Objects)
    METRICS = (Metric("stop_count", "", "times that the machine drove and then stood", "Driving"),)
    EVENTS = ("stop",)
    COUNTED: Mapping[str, str] = {"stop_count": "stop"}

    def __init__(self, setup: EvaluatorSetup) -> None:
        self._setup = setup
        self._drove = False
        self._events: list[Event] = []
        self._told: dict[str, tuple[int, str]] = {}  # when it was reported last [ns], and of which kind it is

    @property
    def live(self) -> tuple[type[Signal], ...]:
        """What stands around is looked at when it stops."""
        return () if self._setup.bodies.is_alone else self.SIGNALS

    def take(self, seen: Seen) -> None:
        """Note whether the machine drives or stands, where no objects are reported."""
        states = seen.of(MachineState)
        if states is not None and not self.live:
            speeds = np.abs(states["speed"])
            if self._drove and float(speeds.min()) >= STANDS:
                return
            for k, speed in enumerate(speeds.tolist()):
                if self._stands(speed):
                    self._stand(states.sample(k))

    def see_live(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Note whether the machine drives or stands, and the objects that are reported to it."""
        for objects in samples_of(outputs, Objects):
            self._hear(objects)
        speed = number_of(outputs, MachineState, "speed")
        if speed is not None and self._stands(abs(speed)):
            self._stand(samples_of(outputs, MachineState)[0])

    def _stands(self, speed: float) -> bool:
        """Whether it drove and now stands."""
        self._drove = self._drove or bool(speed > DRIVES)
        stands = self._drove and bool(speed < STANDS)
        self._drove &= not stands
        return stands

    def _stand(self, state: MachineState) -> None:
        x, y, _ = state.pose.position.tolist()
        gap, other = self._setup.bodies.clearance(self._setup.name)
        near = f", {num(gap)} m before {other}" if other and gap < 20.0 else ""
        name, text = self._setup.name, f"{self._setup.name} stands{near}"
        why = self._why(state.t)
        self._events.append(Event(state.t, "stop", name, x, y, state.distance, text, state.t, because=why))

    def _hear(self, objects: Objects) -> None:
        """Note which bodies something reported is near to."""
        sure = objects.confidence >= SURE
        if not sure.any():
            return
        pose = self._setup.bodies.pose_of(self._setup.name)
        x, y = objects.x[sure], objects.y[sure]
        places = pose.apply(np.stack([x, y, np.zeros_like(x)], axis=1))
        for body in self._setup.bodies.around(self._setup.name):
            inside = body.pose.inverse().apply(places) - body.middle
            off = np.maximum(np.abs(inside[:, :2]) - body.half[:2], 0.0)
            if (np.hypot(off[:, 0], off[:, 1]) <= NEAR_M).any():
                self._told[body.name] = objects.t, body.kind

    def _why(self, t: int) -> tuple[str, ...]:
        """Names, then kinds, of what was reported lately."""
        lately = {name: kind for name, (when, kind) in self._told.items() if t - when <= LOOKED_BACK}
        return (*lately, *dict.fromkeys(lately.values()))

    def metrics(self) -> dict[str, float]:
        """How often."""
        return {"stop_count": float(len(self._events))}

    def events(self) -> Sequence[Event]:
        """Every stop."""
        return self._events


LEVEL = Level(Stops, None, summary="how often the machine stopped on its way")
