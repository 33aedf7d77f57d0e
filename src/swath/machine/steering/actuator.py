"""Steering level `actuator`: electro-hydraulic angle servo of the steered axle.

Dead time, then a proportional valve with a dead band, a largest oil flow and a first-order approach:

    w = (wanted - angle) / (lag * rate_max)                   wanted valve opening
    rate = rate_max * sat(sign(w) * max(0, |w| - b) / (1 - b))  b = dead band

Solved exactly between the instants at which delayed commands arrive, so the step size does not enter. The
dead band leaves a rest error of b * lag * rate_max (0.12 deg with the numbers of the large combine).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le, Lt

from swath.compiled import Compiled
from swath.core.component import Port, State
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.rows import row_of
from swath.core.schedule import NS
from swath.core.together import InWorlds, Samples
from swath.core.units import DEG, PERCENT
from swath.field.site_setup import SiteSetup
from swath.kernels import Repeated, Rows
from swath.machine.machine_sheet import dynamics_of
from swath.signals import SteerCommand, SteerState

ROOM = 1024  # commands under way


@dataclass(frozen=True)
class Params:
    """A steering valve; what is left out comes from the machine's sheet.

    rate_deg_s: fastest turn of the equivalent wheel
    dead_time_s: time from command to first motion
    lag_s: time constant of the approach
    dead_band_percent: dead band of the valve, of its full opening
    """

    rate_deg_s: Annotated[float, Gt(0), Le(200)] | None = None
    dead_time_s: Annotated[float, Ge(0), Le(5)] | None = None
    lag_s: Annotated[float, Gt(0), Le(5)] | None = None
    dead_band_percent: Annotated[float, Ge(0), Lt(90)] | None = None


class Actuator(InWorlds):
    """Angle servo with a queue of commands that have not arrived yet."""

    inputs = (Port("command", SteerCommand),)
    outputs = (Port("steering", SteerState),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        d, machine = dynamics_of(setup.machine), setup.machine
        rate = d.steer_rate if params.rate_deg_s is None else params.rate_deg_s * DEG
        lag = d.steer_lag if params.lag_s is None else params.lag_s
        dead_time = d.steer_dead_time if params.dead_time_s is None else params.dead_time_s
        band = d.steer_dead_band if params.dead_band_percent is None else params.dead_band_percent * PERCENT
        self.servo = rate, lag, band, round(dead_time * NS), machine.wheelbase, machine.max_steer

    @classmethod
    def together(cls, parts: Sequence["Actuator"]) -> "Actuators":
        """Make one object that steps these parts of many worlds together."""
        return Actuators(parts)


class Actuators(Compiled):
    """The servos of many worlds."""

    reads: ClassVar = {"command": SteerCommand}

    def __init__(self, parts: Sequence[Actuator]) -> None:
        from swath.machine.steering import actuator_kernel as kernel

        n = len(parts)
        super().__init__(n, {"steering": row_of(SteerState, n)})
        self._servos = Rows(kernel.Servo, n, [part.servo for part in parts])
        self._wheels = Rows(kernel.Wheel, n)
        self._arrivals, self._curvatures = np.zeros((n, ROOM), np.int64), np.zeros((n, ROOM))
        self._engaged, self._seen = np.zeros((n, ROOM), np.bool_), np.full(n, -1)

    def launches(self) -> Sequence[Repeated]:
        """The wheels turn."""
        from swath.machine.steering import actuator_kernel as kernel

        command, steering = self.given["command"], self.sent["steering"]
        queue = (
            self._arrivals,
            self._curvatures,
            self._engaged,
            self._seen,
            self.clock,
            self.needs,
            command.stamp,
        )
        columns = *command.arrays.values(), *steering.arrays.values()
        return [self.launch(kernel.turn_wheels, self._servos.array, self._wheels.array, *queue, *columns)]

    def supply(self, stage: int) -> None:
        """There is no room for a command."""
        raise InputError("dead_time_s", None, f"expected fewer than {ROOM} commands under way")

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Wheels straight, nothing under way."""
        self._wheels.clear()
        self._seen[:] = -1
        self.sent["steering"].memory[:] = 0
        return self.sent_at(0)

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        first, count = (int(self._wheels.of[name][world]) for name in ("first", "count"))
        places = (first + np.arange(count)) % ROOM
        queue = (self._arrivals, self._curvatures, self._engaged)
        return {
            "wheel": self._wheels.save(world),
            "queue": [array[world, places] for array in queue],
            "seen": int(self._seen[world]),
        }

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        self._wheels.load(world, state["wheel"])
        places = (int(self._wheels.of["first"][world]) + np.arange(len(state["queue"][0]))) % ROOM
        for array, own in zip((self._arrivals, self._curvatures, self._engaged), state["queue"], strict=True):
            array[world, places] = own
        self._seen[world] = state["seen"]


LEVEL = Level(
    Actuator,
    Params,
    summary="dead time, rate limit, first-order lag and valve dead band",
    cost="about 12 us per step, 3 us in a batch of worlds",
    tolerance="exact solution of its equations at any step",
)
