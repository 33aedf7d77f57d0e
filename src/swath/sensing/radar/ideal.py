"""Radar level `ideal`: everything in the field of view, exactly, whatever stands before it."""

from dataclasses import dataclass, field
from math import asin, atan2, hypot
from typing import ClassVar

import numpy as np

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.portable import product
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.field.site_setup import Body, SiteSetup
from swath.sensing import SPEED
from swath.sensing.mount import Length, LevelMount, poses_at
from swath.sensing.radar.cross_section import cross_section
from swath.sensing.radar.radar_sheet import load_radar
from swath.signals import F64, MachineState
from swath.signals.radar import RadarTargets, radar_targets_of

TAP = 10_000_000  # between the three poses that a velocity is taken from [ns]


@dataclass(frozen=True)
class RadarMount(LevelMount):
    """Over the header, in front of the cab: an estimate.

    Level, since makers ask for 0 to 1 deg against the ground and a height of 0.5 m or more (Autoliv,
    Installation Specifications and User Manual, Radar Sensors, E567781, 6.3.4; 24 GHz E814702, 5.3.9).

    x_m: forward
    z_m: above ground
    """

    x_m: Length = 3.5
    z_m: Length = 1.6


@dataclass(frozen=True)
class Params:
    """An automotive radar.

    sensor: name in data/sensors, or the user's own YAML
    mount: where the radar sits; its x axis is the middle of the field of view
    """

    sensor: str = "radar-77ghz-corner"
    mount: RadarMount = field(default_factory=RadarMount)


@dataclass(frozen=True)
class Target:
    """A thing in the field of view. distance [m], azimuth, elevation [rad] in the sensor's frame.

    radial_speed: > 0 goes away [m/s]; rcs [dBsm]
    place: the nearest point, world (3,)
    body: whose it is
    """

    distance: float
    azimuth: float
    elevation: float
    radial_speed: float
    rcs: float
    place: F64
    body: Body


class IdealRadar(KeepsState):
    """Looks at the scene. mounting: pose_machine_sensor."""

    kept: ClassVar[tuple[str, ...]] = ("_last",)

    inputs = (Port("state", MachineState, history=True),)
    outputs = (Port("targets", RadarTargets),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.setup = setup
        self.sheet = load_radar(params.sensor, setup.base)
        self.mounting = params.mount.pose(setup.machine, setup.edge_side)
        self._last: tuple[MachineState, ...] = ()

    def reset(self, stream: Stream) -> Outputs:
        """Nothing before the first look."""
        self._last = ()
        return {"targets": radar_targets_of(0, [])}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Detections at t + dt."""
        rows = []
        for seen in self.look(t + dt, inputs):
            measured = seen.distance, seen.azimuth, seen.elevation, seen.radial_speed, seen.rcs
            rows.append((*measured, np.nan, 0.0, 0.0, 0.0))
        return {"targets": radar_targets_of(t + dt, rows)}

    def look(self, now: int, inputs: Inputs) -> list[Target]:
        """What is in the field of view from `_eye` (3,) that goes with `_velocity` (3,), the nearest first;
        nothing hides it.
        """
        self._eye, rotation, self._velocity = self.locate(now, inputs)
        bodies = self.setup.bodies.around(self.setup.name)
        seen = [self._seen(body, self._eye, rotation, self._velocity) for body in bodies]
        return sorted((s for s in seen if s is not None), key=lambda s: s.distance)

    def locate(self, now: int, inputs: Inputs) -> tuple[F64, F64, F64]:
        """Place (3,) [m], rotation (3, 3) and velocity (3,) [m/s] of the sensor in the world.

        The velocity by three points backward, of second order: the lever arm to the axle is in it, and
        whatever the machine pitches and rolls.
        """
        states: tuple[MachineState, ...] = (*self._last, *inputs["state"])
        self._last = tuple(s for s in states if s.t >= now - 3 * TAP) or states[-1:]
        tap = min(TAP, (now - states[0].t) // 2)
        times = np.array([now, now - tap, now - 2 * tap], dtype=float)
        at, turned = poses_at(states, times)
        place = at + product(turned, self.mounting.position)
        seconds = 2.0 * tap / NS
        moved = 3.0 * place[0] - 4.0 * place[1] + place[2]
        velocity = moved / seconds if tap > 0 else np.zeros(3)
        return place[0], product(turned[0], self.mounting.rotation), velocity

    def _seen(self, body: Body, eye: F64, rotation: F64, velocity: F64) -> Target | None:
        """A body by the point of its box where the line to its middle enters, at the sensor's own height as
        far as it reaches; None where that is out of view.
        """
        own = body.pose.inverse().apply(eye) - body.middle
        aim = np.array([0.0, 0.0, min(max(float(own[2]), -float(body.half[2])), float(body.half[2]))])
        enters = entry(own, aim, body.half)
        if enters is None:
            return None
        place = body.pose.apply(own + enters * (aim - own) + body.middle)
        ray = place - eye
        x, y, z = product(rotation.T, ray).tolist()
        distance = hypot(x, y, z)
        if not self.sheet.range_min <= distance <= self.sheet.range_max:
            return None
        azimuth, elevation = atan2(y, x), asin(min(max(z / distance, -1.0), 1.0))
        if abs(azimuth) > 0.5 * self.sheet.azimuth_fov or abs(elevation) > 0.5 * self.sheet.elevation_fov:
            return None
        radial = float(product(body.velocity - velocity, ray)) / distance
        rcs = cross_section(body, eye, self.sheet.frequency, self.sheet.wavelength)
        return Target(distance, azimuth, elevation, radial, rcs, place, body)


def entry(start: F64, end: F64, half: F64) -> float | None:
    """Share of the way from a point outside to another one (3,) where it enters a box about the origin with
    half sizes (3,); None where it does not, or starts inside.
    """
    first, last = -np.inf, 1.0
    for s, e, h in zip(start.tolist(), end.tolist(), half.tolist(), strict=True):
        step = e - s
        if abs(step) < 1e-12:
            if abs(s) > h:
                return None
            continue
        near, far = sorted(((-h - s) / step, (h - s) / step))
        first, last = max(first, near), min(last, far)
    return first if 0.0 < first <= last else None


LEVEL = Level(
    IdealRadar,
    Params,
    summary="everything in the field of view with distance, angles, radial speed and cross section",
    cost="0.6 ms per look at ten things",
    tolerance="exact; radial speed of what stands within 1 mm/s",
    checked=(SPEED,),
)
