"""Machines of many worlds that stand on their tyres: what the compiled levels of motion have in common."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from swath.compiled import Compiled
from swath.core.component import State
from swath.core.errors import InputError, SwathError
from swath.core.random import Stream
from swath.core.rows import row_of
from swath.core.together import Given, Samples, in_world
from swath.kernels import Repeated, Rows, of_worlds
from swath.machine.towing import refuse_reverse
from swath.signals import EngineState, MachineState, SpeedCommand, SteerState

TRIES = 4  # to find the ground of a step: more than pages under it


class OnGround(Compiled):
    """parts: with `machine`, `follower`, `start` (x, y, yaw), `start_speed`, `towed` each.

    tracks, stands: `Track` and `Stand` of the kernels; grounds: nodes in memory around each
    table: (worlds, 17) of the states; stand: the launch that stands all of them where their tracks are
    """

    reads: ClassVar = {"steering": SteerState, "speed": SpeedCommand, "drive": EngineState}
    stand: Repeated

    def __init__(self, parts: Sequence[Any]) -> None:
        from swath.machine.attitude_kernel import Ground, Stand, Track

        n = len(parts)
        super().__init__(n, {"state": row_of(MachineState, n)})
        self.parts = parts
        self.towing = [(world, part.towed) for world, part in enumerate(parts) if part.towed is not None]
        self.walks = not self.towing
        self.tracks, self.stands = Rows(Track, n), Rows(Stand, n)
        self._held = [part.follower.ground() for part in parts]
        self.grounds = of_worlds(Ground, self._held)
        self._ground_rows = self.grounds.numpy()
        self.table = self.sent["state"].memory.view(np.float64).reshape(n, -1)

    def asked(self) -> list[Any]:
        """Angle of the steered axle, wanted speed, what the drive can, for a kernel."""
        limit = self.column("drive", "speed_limit", otherwise=np.inf)
        return [self.column("steering", "angle"), self.column("speed", "speed"), limit]

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Stand, or roll straight, at the start pose."""
        self.tracks.clear()
        self.stands.clear()
        for name, values in zip(
            ("x", "y", "yaw"), zip(*(p.start for p in self.parts), strict=True), strict=True
        ):
            self.tracks.of[name][:] = values
        self.stands.of["speed"][:] = self.stands.of["rim"][:] = [part.start_speed for part in self.parts]
        for world, towed in self.towing:
            towed.place(*self.parts[world].start)
        self.stand.launch()
        if self.find_ground():
            self.stand.launch()
        self.needs[0] = 0
        return self.with_trailers(0)

    def step(self, t: int, dt: int, inputs: Given) -> Mapping[str, Samples]:
        """Drive on."""
        found = super().step(t, dt, inputs)
        if not self.towing:
            return found
        for world, towed in self.towing:
            refuse_reverse(float(self.given["speed"].arrays["speed"][world]))
            towed.carry(in_world(inputs.get("cargo"), world))
            towed.follow(*self.place(world))
        return self.with_trailers(t + dt)

    def supply(self, stage: int) -> None:
        """Ground that is not in memory; a speed that is no number ends its world."""
        wanted = self.given["speed"].arrays["speed"]
        for world in np.flatnonzero(~np.isfinite(wanted)).tolist():
            self.errors[world] = InputError("speed command", float(wanted[world]), "expected a finite speed")
        for _ in range(TRIES):
            if self.find_ground():
                self.stand_again()
        self.needs[0] = 0

    def lacking(self, world: int) -> tuple[float, float, float]:
        """Where the ground of a machine is missing [m], and its heading there [rad]."""
        return self.place(world)

    def stand_again(self) -> None:
        """Complete the step of those that had no ground."""
        self.stand.launch()

    def find_ground(self) -> bool:
        """Take the ground around those that had none into memory; whether there were any."""
        missing = np.flatnonzero(self.stands.of["is_done"] == 0.0).tolist()
        missing = [world for world in missing if world not in self.errors]
        for world in missing:
            try:
                self.parts[world].follower.footprint.take(*self.lacking(world))
            except SwathError as error:
                self.errors[world] = error
                continue
            self._held[world] = self.parts[world].follower.ground()
            self._ground_rows[world] = self._held[world].numpy_value()
        return bool(missing)

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        towed = self.parts[world].towed
        return {
            **{name: float(column[world]) for name, column in self.tracks.of.items()},
            "stand": self.stands.save(world),
            "towed": None if towed is None else towed.save(),
        }

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        for name, column in self.tracks.of.items():
            column[world] = state[name]
        self.stands.load(world, state["stand"])
        towed = self.parts[world].towed
        if towed is not None:
            towed.load(state["towed"])

    def place(self, world: int) -> tuple[float, float, float]:
        """Where a machine is [m], and its heading [rad]."""
        of = self.tracks.of
        return float(of["x"][world]), float(of["y"][world]), float(of["yaw"][world])

    def with_trailers(self, t: int) -> Mapping[str, Samples]:
        """What is sent at t [ns]."""
        found = self.sent_at(t)
        if not self.towing:
            return found
        states: list[Any] = self.sent["state"].each()
        trailers = [towed.state(t, states[w].pose, self.place(w)[2]) for w, towed in self.towing]
        return {**found, "trailer": Samples.joined(trailers)}
