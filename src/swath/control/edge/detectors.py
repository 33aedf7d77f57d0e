"""Likelihood-ratio detectors of any number of worlds: rows, and launches over them."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from swath.compiled import Compiled
from swath.control.edge.block_rows import COLUMNS, USUAL_HEIGHT
from swath.control.edge.block_tracks import BlockTracks
from swath.control.edge.blocks import Block
from swath.control.edge.canopy_rays import CanopyRays
from swath.control.edge.detector_rows import ALL, EDGE, FEET, POINTS, ROW, ROWS
from swath.control.inertial_memory import AllInertial
from swath.core.component import State
from swath.core.ops import Call
from swath.core.random import Stream
from swath.core.rows import row_of
from swath.core.together import Given, Samples, field_of
from swath.kernels import Repeated, of_worlds, shared, start_warp
from swath.signals import F64, CropEdge, CropFlow, Inertial, Odometry, Scan

ANGLES = "azimuth", "elevation", "beam_t"


class Detectors(Compiled):
    """The detectors of many worlds.

    rows: of ROW, (worlds,); steps, detectors, blocks, ground, told, lines, feet: their parts
    points: of the edges, as line/edge_points.cpp has them, (worlds, POINTS, COLUMNS)
    """

    reads: ClassVar = {"scan": Scan, "odometry": Odometry, "flow": CropFlow}
    hears: ClassVar = {"inertial": Inertial}

    def __init__(self, parts: Sequence[Any]) -> None:
        n = len(parts)
        super().__init__(n, {"edge": row_of(CropEdge, n)})
        self.parts, self.rows = parts, np.zeros(n, ROW)
        of = {name: self.rows[name] for name in ROWS}
        self.steps, self.detectors, self.blocks, self.ground = (
            of[name] for name in ("step", "detector", "block", "ground")
        )
        self.told, self.lines, self.feet = of["told"], of["line"], of["feet"]
        for world, part in enumerate(parts):
            self.detectors[world] = part.row
        self.tracks = BlockTracks(n)
        self.points: F64 = self.tracks.rows["points"]["rows"].reshape(n, POINTS, COLUMNS)
        each = [self.rows[world : world + 1] for world in range(n)]
        self._rays = [
            CanopyRays(part.mounting, part.stubble, row, Block(row["counted"]))
            for part, row in zip(parts, each, strict=True)
        ]
        self._upward, self._turning = AllInertial(n), AllInertial(n)
        self._angles: tuple[Any, ...] = ()  # of the beams

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """No edge at t = 0: nothing was seen yet."""
        self.steps[:], self.feet[:] = 0, 0
        for world, (part, rays) in enumerate(zip(self.parts, self._rays, strict=True)):
            for memory, own in zip((self._upward, self._turning), part.memories, strict=True):
                memory.load(world, own)
            rays.clear()
        self.tracks.clear()
        self.blocks[:] = 0
        self.blocks["height"] = USUAL_HEIGHT
        self.reports()[-1].launch()
        return self.sent_at(0)

    def step(self, t: int, dt: int, inputs: Given) -> Mapping[str, Samples]:
        """Take a new scan, if there is one, and report the edge in the machine frames of t + dt."""
        self._aim(inputs["scan"])
        return super().step(t, dt, inputs)

    def launches(self) -> Sequence[Repeated]:
        """What came with the step, a scan into its block, the look at that, then what is told of the edge."""
        from swath.control.edge.block_kernel import look
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
            self.launch(look, self.active, self._memories, *self.tracks.given()),
        ]
        self._taken = len(first) - 2
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
        """Room for more rays; what other scanners say of the lean."""
        if stage > self._taken:
            for world, part in enumerate(self.parts):
                feet = self.feet[world]
                told = part.outward(float(feet["low"])) if part.outward and feet["is_found"] else None
                self.told[world] = (told is not None, *(told or (0.0, 0.0)))
            return
        for world in np.flatnonzero(self.active).tolist():
            if self._rays[world].make_room():
                self._renew(world)

    def _renew(self, world: int) -> None:
        """The memory of a world is another now."""
        if self._launches is not None:
            self._held[world] = self._rays[world].memory()
            self._memories.numpy()[world] = self._held[world].numpy_value()

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        own = {"upward": self._upward, "turning": self._turning}
        kept: State = {name: memory.save(world) for name, memory in own.items()}
        own_rows = {name: self.rows[name][world].copy() for name in ("step", "block", "back")}
        track = self.tracks.rows.view(np.float64).reshape(self.worlds, -1)[world].copy()
        rays = self._rays[world]
        return kept | own_rows | {"track": track, "rays": rays.save(), "counted": rays.block.save()}

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        self._upward.load(world, state["upward"])
        self._turning.load(world, state["turning"])
        for name in ("step", "block", "back"):
            self.rows[name][world] = state[name]
        self.tracks.rows.view(np.float64).reshape(self.worlds, -1)[world] = state["track"]
        self._rays[world].block.load(state["counted"])
        self._rays[world].load(state["rays"])
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
