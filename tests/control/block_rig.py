"""A track of blocks on rays that a test makes up, and its parts, compiled, called one by one."""

from typing import NamedTuple

import numpy as np
import warp as wp

from swath.control.edge.block_kernel import FILES, KNOWN, look
from swath.control.edge.block_tracks import BlockTracks
from swath.control.edge.blocks import Block
from swath.control.edge.canopy_classes import BLOCK
from swath.control.edge.detector_kernel import Memory, Numbers, code
from swath.control.edge.detector_rows import ROW
from swath.kernels import filled, of_worlds, repeatable, shared
from tests.control.canopy_scans import lay

wp.set_module_options({"fuse_fp": False, "enable_backward": False})
# What is called by a name: a are the numbers given, b those told, t is the track, block its block.
CALLS = {
    # gate [m], known variance [m2]: all of Found, of what rays are worth as the populations have it
    "find_edge": "D worth[WITHIN]; t.weigh(block, worth); *(Found*)b = block.find_edge(worth, a[0], a[1]);",
    # known variance [m2], number of places, these, their chances: mean, variance
    "added": "const int n = (int)a[1]; Block::added(a + 2, a + 2 + n, n, a[0], b[0], b[1]);",
    "haze": "block.haze(b);",
    # haze: ratios of classes
    "ratios": "t.populations.ratios().at(a[0], b);",
    "heights": "*(Heights*)b = t.populations.heights();",
    "has_mat": "b[0] = t.populations.has_mat(a);",
    "begin": "t.populations.begin(a);",
    # beside the frame [m]: along, variance
    "wall": "D room[256]; *(Wall*)b = Wall::of(block, a[0], room);",
    # of a wall: middle [m], angle [rad]
    "place_along": "b[0] = Wall{a[0], 0.0}.place_along(a[1], a[2]);",
    "track": "Arc arc; arc.begin(a[0], a[1], a[2], a[3], a[4]); t.track.begin(arc);",
    "ahead": "t.track.arc = t.track.arc.ahead(a[0]);",
    "advance": "t.track.advance(a[0]);",
    # beside [m], variance [m2], whether it turns
    "accept": "t.track.accept(a[0], a[1], a[2] != 0.0);",
    # distance [m], variance of all [m2]
    "retrace": "t.track.retrace(a[0], t.points, a[1]);",
    # x, u [m], variance [m2], distance [m]
    "point": "t.points.add(a[0], a[1], a[2], a[3]);",
    "found_again": "t.points.found_again(a[0]);",
    # scatter [m2]: distance of the break [m]
    "carry_on": "BrokenLine line; b[0] = line.carry_on(t.points, t.track.arc, a[0]);",
    "bites": "b[0] = Bites::depth(t.points, a[0], t.track.arc);",
    # heading [rad]: standard deviation of the angle [rad]
    "bites_line": "b[0] = Bites::line(t.points, t.track.arc, a[0]);",
    # distance [m], angle [rad], wall ahead [m]
    "add_wall": "t.walls.add(a[0], a[1], a[2]);",
    # angle [rad]: distance of the first point that moves [m]
    "move_walls": "b[0] = t.walls.move(t.points, a[0]);",
    # wall and its variance, middle [m], angle [rad], travel [m]
    "add_jagged": "t.jagged.add(Wall{a[0], a[1]}, a[2], a[3], a[4]);",
    "swing": "b[0] = t.jagged.swing(a[0]);",
    # beside the line [m], distance [m]: whether it bends away, since which distance [m]
    "bends_away": "b[0] = t.breaks.bends_away(Found{a[0], 1e-4, 100.0, 0.0, 0.0, a[0]}, a[1], true, b[1]);",
    "add_ramp": "t.feet.ramp.add(block.counts, a[0]);",
    # height, overhang [m], rays per independent ray, slope that is feigned
    "ramp": "*(Ramp*)b = t.feet.ramp.foot(a[0], a[1], a[2], a[3]);",
    # of the crop's height [m]: overhang [m], how sure the edge goes along rows
    "overhang": "b[0] = t.feet.overhang_of(a[0]); b[1] = t.feet.along(t.spacing);",
    # edge, travel, height [m], heading [rad]
    "look_for_rows": "t.feet.look_for_rows(block.counts, a[0], a[1], a[2], a[3], t.spacing);",
}


class EdgeFrame(NamedTuple):
    """An arc in the machine's (x, u): a point on it [m], its angle [rad] and bend [1/m] there."""

    x: float
    u: float
    angle: float
    bend: float


@wp.func_native(
    code(*FILES, **KNOWN)
    + "const D* a = given.data; D* b = told.data;\nswitch (what) {\n"
    + "\n".join(f"case {k}: {{ {call} break; }}" for k, call in enumerate(CALLS.values()))
    + "\n}"
)
def call(what: int, m: Memory, track: Numbers, given: Numbers, told: Numbers): ...


@wp.kernel
def call_one(
    what: int,
    memories: wp.array(dtype=Memory),
    tracks: wp.array2d(dtype=wp.float64),
    given: Numbers,
    told: Numbers,
):
    call(what, memories[0], tracks[0], given, told)


class Rig:
    """A track, as its row has it, and its block; parts of both are called by their names in CALLS.

    spacing: of the rows of the crop [m]
    """

    def __init__(self, spacing=0.0):
        self.world, self._tracks = np.zeros(1, ROW), BlockTracks(1)
        own = self.world["detector"]
        own["search"], own["hold"], own["view"], own["spacing"] = 1.5, 5.0, 2.4, spacing
        self.block, self.row = Block(self.world["counted"]), self._tracks.rows[0]
        self._given = self._tracks.given()

    def _memory(self):
        own = {
            "row": self.world,
            "answers": self.block.rays,
            "counts": self.block.counts,
            "solid": self.block.solid,
        }
        flat = {name: array.view(np.float64).reshape(-1) for name, array in own.items()}
        self._held = filled(Memory, told=np.zeros((4, len(self.block.rays) + 1)), **flat)
        return of_worlds(Memory, [self._held])

    def __call__(self, name, *given, told=8):
        """What a call tells: so many numbers."""
        answer = np.zeros(told)
        asked = np.concatenate([np.ravel(np.asarray(value, float)) for value in (*given, 0.0)])
        inputs = [list(CALLS).index(name), self._memory(), *map(shared, (self._given[0], asked, answer))]
        repeatable(call_one, inputs).launch()
        return answer

    def add(self, rays, travel, at, **about):
        """A scan into the block, which is looked at when it is full. at: x, u [m], heading of the machine"""
        frame = self.frame(*at)
        lay(self.block, rays, travel, **about)
        canopy, step = self.world["canopy"], self.world["step"]
        for name, value in zip(("x", "u", "angle", "bend"), frame, strict=True):
            canopy[f"edge_{name}"] = value
        for name, value in zip(("x", "u", "heading"), at, strict=True):
            step[name] = value
        canopy["is_full"] = self.block.row["travel"] >= BLOCK
        tracks, offsets, *counts = self._given
        given = [shared(np.ones(1, bool)), self._memory(), shared(tracks), offsets, *map(shared, counts)]
        repeatable(look, given).launch()

    def frame(self, x, u, heading):
        """The track's arc as a machine sees it there; 9 m ahead of it, straight, where there is none."""
        if not self.has_arc:
            return EdgeFrame(9.0, 0.0, 0.0, 0.0)
        c, s, dx, du = np.cos(heading), np.sin(heading), self.arc["x"] - x, self.arc["u"] - u
        return EdgeFrame(c * dx + s * du, c * du - s * dx, self.arc["angle"] - heading, self.arc["bend"])

    def begin(self, x, u, angle, bend=0.0, distance=0.0):
        """A track at a place x, u [m], with an angle [rad] and a bend [1/m]."""
        self("track", x, u, angle, bend, distance)
        return self

    @property
    def has_arc(self):
        """Whether there is an edge."""
        return self.row["track"]["has_arc"] != 0.0

    @property
    def arc(self):
        """The track's."""
        return self.row["track"]["arc"]

    def set_points(self, rows):
        """Points of the edge are these, (n, 4)."""
        points = self.row["points"]
        points["count"], points["rows"][: 4 * len(rows)] = len(rows), np.ravel(rows)
        return self

    @property
    def points(self):
        """Points of the edge, (n, 4)."""
        points = self.row["points"]
        return points["rows"].reshape(-1, 4)[: int(points["count"])]
