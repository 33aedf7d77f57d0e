"""Motion level `kinematic`: wheels roll where they point. Exact circular arcs.

With the fixed axle as reference and the steered axle a distance L behind it: yaw rate = v tan(steer) / L
(steer > 0 turns left; the rear wheel itself then points right). Turning costs no side slip: see
docs/explanation/machine.md for what that hides. On a slope the wheels slip as in the other levels, along and
across, behind by the relaxation lengths: both axles drift alike, so it crabs downhill and keeps its heading.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.together import InWorlds, Samples
from swath.core.units import KMH
from swath.field.site_setup import SiteSetup
from swath.kernels import Repeated, filled, of_worlds, shared
from swath.machine.attitude import TerrainFollower
from swath.machine.loops import loop_of
from swath.machine.machine_sheet import dynamics_of
from swath.machine.motion import CHECKED, FIRM
from swath.machine.motion.on_ground import OnGround
from swath.machine.towing import DRIVEN, ports_of, towed_by
from swath.machine.traction import across_of, traction_of
from swath.signals import HeapState
from swath.signals.setup import MachineGeometry


@dataclass(frozen=True)
class Params:
    """start_speed_kmh: speed at t = 0."""

    start_speed_kmh: Annotated[float, Ge(0), Le(40)] = 0.0


class Kinematic(InWorlds):
    """A vehicle, its trailer behind it. The steering angle is held over a step."""

    inputs = (*DRIVEN, Port("cargo", HeapState, optional=True))

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.machine, start = setup.machine, setup.start
        self.follower = TerrainFollower(setup.field, setup.machine)
        self.start = float(start.position[0]), float(start.position[1]), start.euler()[2]
        self.start_speed = params.start_speed_kmh * KMH
        self.towed = towed_by(setup)
        self.outputs = ports_of(self.towed)

    @classmethod
    def together(cls, parts: Sequence["Kinematic"]) -> "Vehicles":
        """Make one object that steps these parts of many worlds together."""
        return Vehicles(parts)


class Vehicles(OnGround):
    """The machines of many worlds."""

    def __init__(self, parts: Sequence[Kinematic]) -> None:
        from swath.machine.motion import kinematic_kernel as kernel

        super().__init__(parts)
        self._steer = np.zeros(self.worlds)
        self._vehicles = of_worlds(kernel.Vehicle, [_vehicle(kernel, part.machine) for part in parts])
        moving = self.tracks.array, self.stands.array, shared(self._steer)
        inputs = [self.grounds, self._vehicles, *moving, shared(self.table), shared(self.needs)]
        self.stand = self.launch(kernel.stand_on, *inputs)

    def launches(self) -> Sequence[Repeated]:
        """Drive one arc, then stand on the ground there."""
        from swath.machine.motion import kinematic_kernel as kernel

        given = [self._vehicles, *self.asked(), shared(self.clock), shared(self.needs)]
        moving = [self.tracks.array, self.stands.array, shared(self._steer)]
        return [self.launch(kernel.drive_arcs, *given, *moving), self.stand]

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Stand at the start pose."""
        self._steer[:] = 0.0
        return super().reset(streams)


def _vehicle(kernel: Any, machine: MachineGeometry) -> Any:
    d = dynamics_of(machine)
    along, across = (filled(kernel.Traction, **of(machine)._asdict()) for of in (traction_of, across_of))
    return filled(
        kernel.Vehicle,
        along=along,
        across=across,
        loop=filled(kernel.Loop, **loop_of(d)._asdict()),
        wheelbase=machine.wheelbase,
        rear_share=d.cg_behind / abs(machine.wheelbase),
    )


LEVEL = Level(
    Kinematic,
    Params,
    summary="rolls where the wheels point, slips on slopes, on the terrain",
    cost="about 20 us per step, 8 us in a batch of worlds",
    tolerance="against multibody up to 2.5 m/s: yaw gain 1.8 to 4 % high, offset after 30 deg -3 to +21 %",
    checked=(*CHECKED, FIRM),
)
