"""Likelihood-ratio detectors of any number of worlds: rows, and launches over them."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from swath.compiled import Compiled
from swath.control.edge.canopy_rays import CanopyRays
from swath.control.edge.detector_rows import ALL, EDGE, FEET, POINTS, ROW, ROWS
from swath.control.edge.line.near_line import COLUMNS
from swath.control.inertial_memory import AllInertial
from swath.core.component import State
from swath.core.ops import Call
from swath.core.random import Stream
from swath.core.rows import row_of
from swath.core.together import Given, Samples, field_of
from swath.kernels import Repeated, of_worlds, shared, start_warp
from swath.signals import F64, CropEdge, CropFlow, Inertial, Odometry, Scan

BEGIN = 3  # blocks: a line through two shows nothing of its own error
ANGLES = "azimuth", "elevation", "beam_t"


class Detectors(Compiled):
    """The detectors of many worlds.

    rows: of ROW, (worlds,); steps, detectors, blocks, ground, told, lines, feet: their parts
    points: of the edge, as `EdgePoints` has them, (worlds, POINTS, COLUMNS)
    """

    reads: ClassVar = {"scan": Scan, "odometry": Odometry, "flow": CropFlow}
    hears: ClassVar = {"inertial": Inertial}

    def __init__(self, parts: Sequence[Any]) -> None:
        n = len(parts)
        super().__init__(n, {"edge": row_of(CropEdge, n)})
        self.parts, self.rows, self.points = parts, np.zeros(n, ROW), np.zeros((n, POINTS, COLUMNS))
        parts_of = {name: self.rows[name] for name in ROWS}
        self.steps, self.detectors, self._canopies = (parts_of[n] for n in ("step", "detector", "canopy"))
        self.blocks, self.ground, self.told = (parts_of[n] for n in ("block", "ground", "told"))
        self.lines, self.feet = parts_of["line"], parts_of["feet"]
        for world, part in enumerate(parts):
            self.detectors[world] = part.row
        self.tracks = [part.track(self.rows[w : w + 1]["counted"]) for w, part in enumerate(parts)]
        self._rays = [
            CanopyRays(part.mounting, part.stubble, self.rows[w : w + 1], self.tracks[w].block)
            for w, part in enumerate(parts)
        ]
        self._upward, self._turning = AllInertial(n), AllInertial(n)
        self._angles: tuple[Any, ...] = ()  # of the beams

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """No edge at t = 0: nothing was seen yet."""
        self.steps[:], self.feet[:] = 0, 0
        for world, (part, track, rays) in enumerate(zip(self.parts, self.tracks, self._rays, strict=True)):
            for memory, own in zip((self._upward, self._turning), part.memories, strict=True):
                memory.load(world, own)
            track.clear()
            rays.clear()
            track.feet.compile()
            self._learn(world)
        self.reports()[-1].launch()
        return self.sent_at(0)

    def step(self, t: int, dt: int, inputs: Given) -> Mapping[str, Samples]:
        """Take a new scan, if there is one, and report the edge in the machine frames of t + dt."""
        self._aim(inputs["scan"])
        return super().step(t, dt, inputs)

    def launches(self) -> Sequence[Repeated]:
        """What came with the step, a scan into its block, then what is told of the edge."""
        from swath.control.edge.detector_kernel import Memory, drive, take

        scan, trail = self.given.get("scan"), self.heard.get("inertial")
        if scan is not None and scan.alike:
            self._aim(scan)
        heard = [] if trail is None else [own.launch(trail) for own in (self._upward, self._turning)]
        if trail is None:
            self._upward.rows[:, 0] = self._turning.rows[:, 0] = 0.0
        motion = [self.column("odometry", name) for name in ("speed", "yaw_rate", "steer_angle")]
        units = self._upward.rows, self._turning.rows
        came = *motion, self.column("flow", "header_fill"), *units, self._flat()
        none = np.zeros(1, np.int64), np.zeros((self.worlds, 0, 0), np.float32)
        sent = none if scan is None else (scan.stamp, scan.arrays["ranges"])
        self._held = [rays.memory() for rays in self._rays]
        self._memories = of_worlds(Memory, self._held)
        first = [
            *heard,
            self.launch(drive, self.active, self.clock, *came),
            self.launch(take, self.active, self.needs, *sent, self._memories),
        ]
        self._taken = len(first) - 1
        ask = [self.asking()] if any(part.outward for part in self.parts) else []
        feet, edge, both = self.reports()
        return [*first, *([feet, *ask, edge] if ask else [both])]

    def reports(self) -> Sequence[Repeated]:
        """Launches of the stages FEET, EDGE, ALL."""
        from swath.control.edge.detector_kernel import report

        edges = self.sent["edge"].memory.view(np.uint8).reshape(self.worlds, -1)
        given = self.active, self._flat(), shared(self.points, start_warp().vec4d), edges
        return [self.launch(report, *given, stage) for stage in (FEET, EDGE, ALL)]

    def _flat(self) -> F64:
        return self.rows.view(np.float64).reshape(self.worlds, -1)

    def calls(self) -> Sequence[Call] | None:
        """None where angles of beams come with every scan: they are looked at in Python."""
        scan = self.given.get("scan")
        return None if scan is None or "azimuth" not in scan.alike else super().calls()

    def supply(self, stage: int) -> None:
        """Full blocks are looked at; what other scanners say of the lean."""
        if stage > self._taken:
            for world, part in enumerate(self.parts):
                feet = self.feet[world]
                told = part.outward(float(feet["low"])) if part.outward and feet["is_found"] else None
                self.told[world] = (told is not None, *(told or (0.0, 0.0)))
            return
        for world in np.flatnonzero(self.active).tolist():
            rays, track = self._rays[world], self.tracks[world]
            if self._canopies["is_full"][world]:
                self._canopies["is_full"][world] = 0.0
                track.add(*rays.seen(), float(self.ground["plane"][world]))
                self._learn(world)
            if rays.make_room():
                self._renew(world)

    def _renew(self, world: int) -> None:
        """The memory of a world is another now."""
        if self._launches is not None:
            self._held[world] = self._rays[world].memory()
            self._memories.numpy()[world] = self._held[world].numpy_value()

    def _learn(self, world: int) -> None:
        """What the next scan and the report read of the blocks."""
        track = self.tracks[world]
        arc, top, feet = track.track.arc, track.height, track.feet
        if arc is None:
            self.blocks[world] = 0
            self.blocks["height"][world] = top
            return
        row = (
            *(1.0, track.followed >= BEGIN, arc.x, arc.u, arc.angle, arc.bend, arc.distance),
            *(track.bite, track.turn_sd, track.agreed, track.scatter, track.blank, top),
            *(*track.populations.heights(), track.populations.dust(), track.jagged.swing(top)),
            *(*feet.lean[:2], *feet.tops.tolist(), feet.noise, feet.along if feet.spacing else 0.0),
        )
        self.learn(world, (*row, feet.overhang(top)), track.points.rows, track.points.returns)

    def learn(self, world: int, row: Sequence[float], points: F64, returns: Sequence[float]) -> None:
        """What the report reads from now on.

        row: of the block, but for the last two numbers; points: (n, COLUMNS); returns: as of `EdgePoints`
        """
        back = self.rows["back"][world]
        points, returns = points[-POINTS:], returns[-len(back) :]
        self.blocks[world] = (*row, len(points), len(returns))
        self.points[world, : len(points)], back[: len(returns)] = points, returns

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        own = {"upward": self._upward, "turning": self._turning}
        kept: State = {name: memory.save(world) for name, memory in own.items()}
        kept["step"], kept["track"], kept["rays"] = (
            self.steps[world].copy(),
            self.tracks[world].save(),
            self._rays[world].save(),
        )
        return kept

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        self._upward.load(world, state["upward"])
        self._turning.load(world, state["turning"])
        self.steps[world] = state["step"]
        self.tracks[world].load(state["track"])
        self._rays[world].load(state["rays"])
        self._learn(world)
        self._renew(world)

    def _aim(self, scan: Samples | Scan | None) -> None:
        """Directions of the beams of a scan, where they are others than before."""
        if scan is None:
            return
        own = [getattr(scan, n) if isinstance(scan, Scan) else field_of(scan, n) for n in ANGLES]
        if self._angles and all(a is b for a, b in zip(own, self._angles, strict=True)):
            return
        self._angles = tuple(own)
        each = [np.broadcast_to(angles, (self.worlds, angles.shape[-1])) for angles in own]
        for world, rays in enumerate(self._rays):
            if rays.aim(*(angles[world] for angles in each)):
                self._renew(world)
