"""A look at the stand itself: the stems that rays really met, painted from far to near.

Reads the field's pages and plant library (see field/memory_layout.py) and undoes the tile transform; no ray
is cast.
A plant is drawn whole where it reaches over the side of its tile; rays see it continued by the next tile's.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.field.field import Field
from swath.field.memory_layout import (
    MIRROR_X,
    MIRROR_Y,
    PAGE_CUT_CELLS,
    PAGE_TILES,
    STANDING,
    Organ,
    Pages,
    Shape,
)
from swath.record.message_factory import RecordedMachine
from swath.report.plots import BLUE, INK, ORANGE, figure
from swath.report.scan_sampler import KeptScan
from swath.signals import F64, I64, U8, Mask

COLOURS = {
    Organ.STEM: "#D9C37C",
    Organ.EAR: "#E69F00",
    Organ.LEAF: "#8E9A4B",
    Organ.STUBBLE: "#8D7F6D",
    Organ.WEED: "#009E73",
    Organ.AWN: "#F0D58A",
    Organ.BRANCH: "#B9A05A",
    Organ.POD: "#E69F00",
    Organ.COB: "#E69F00",
}
NAMES = {
    Organ.EAR: "ear",
    Organ.POD: "pod",
    Organ.COB: "cob",
    Organ.AWN: "awn",
    Organ.BRANCH: "branch",
    Organ.STEM: "stem",
    Organ.LEAF: "leaf",
    Organ.WEED: "weed",
    Organ.STUBBLE: "cut: stubble",
}
GROUND, GROUND_FAR = "#C9BBA3", "#E9E3D8"
LAYERS, SHADES = 100, 31  # of the picture, from far to near; of each colour, at most 31
BACK, AHEAD, ASIDE = 2.4, 2.4, 1.9  # shown about the place where the beams meet the edge [m]


@dataclass(frozen=True)
class Organs:
    """Pieces of plants in the world.

    a, b: ends [m], (n, 3)
    half: half width [m], (n, 3), zero for capsules; radius [m], (n,), zero for ribbons and triangles
    organ: Organ, (n,)
    tip: width at b relative to that at a, (n,), zero for triangles
    """

    a: F64
    b: F64
    half: F64
    radius: F64
    organ: U8
    tip: F64

    def take(self, which: Mask) -> "Organs":
        """Some of them."""
        return Organs(*(getattr(self, f.name)[which] for f in fields(self)))

    def quads(self, eye: F64) -> F64:
        """Corners (n, 4, 3) as seen from a point: capsules flat, towards it."""
        wide = np.cross(self.b - self.a, eye - 0.5 * (self.a + self.b))
        wide *= (self.radius / np.maximum(np.linalg.norm(wide, axis=1), 1e-9))[:, None]
        half = np.where(self.radius[:, None] > 0.0, wide, self.half)
        tip = self.tip[:, None] * half
        return np.stack([self.a - half, self.a + half, self.b + tip, self.b - tip], axis=1)


def organs_near(field: Field, x: float, y: float, reach: float) -> Organs:
    """What stands (or is left as stubble) within `reach` of a world point [m]."""
    turn = Pose.from_euler([0.0, 0.0, 0.0], yaw=field.stand_yaw)
    centre = turn.inverse().apply([x, y, 0.0])[:2]
    size = field.library.tile_size
    low, high = np.floor((centre - reach) / size).astype(int), np.floor((centre + reach) / size).astype(int)
    tile_of = np.searchsorted(field.library.stem_start, field.library.owner, side="right") - 1
    first = np.searchsorted(tile_of, np.arange(len(field.library.stem_start)))  # they lie tile by tile
    parts = [
        part
        for iy in range(low[1], high[1] + 1)
        for ix in range(low[0], high[0] + 1)
        if (part := _tile(field, ix, iy, first, centre, reach)) is not None
    ]
    if not parts:
        none = np.zeros((0, 3))
        return Organs(none, none, none, np.zeros(0), np.zeros(0, np.uint8), np.zeros(0))
    a, b, half, radius, organ, tip = (np.concatenate([p[i] for p in parts]) for i in range(6))
    return Organs(turn.apply(a), turn.apply(b), turn.turn(half), radius, organ, tip)


def _tile(field: Field, ix: int, iy: int, first: I64, centre: F64, reach: float) -> tuple[Any, ...] | None:
    """Pieces of one tile in the stand frame, cut where they are cut."""
    pages, library = field.pages, field.library
    page = (iy // PAGE_TILES - pages.table_y, ix // PAGE_TILES - pages.table_x)
    if not (0 <= page[0] < pages.table.shape[0] and 0 <= page[1] < pages.table.shape[1]):
        return None
    slot = int(pages.table[page])
    if slot < 0:
        return None
    at = (slot, iy % PAGE_TILES, ix % PAGE_TILES)
    ground, slope_x, slope_y = (float(v) for v in pages.tile_plane[at])
    scale, lean_x, lean_y, fraction = (float(v) for v in pages.tile_stand[at])
    prototype = int(pages.tile_prototype[at])
    size = library.tile_size
    number = prototype & (MIRROR_X - 1)
    own = np.arange(first[number], first[number + 1])
    foot = library.base[own].astype(float)
    own = own[
        (library.stem_rank[library.owner[own]] < fraction) & np.all((foot >= 0) & (foot < size), axis=1)
    ]
    flip = np.array([-1.0 if prototype & f else 1.0 for f in (MIRROR_X, MIRROR_Y)] + [1.0])
    shift = np.array([size if f < 0 else 0.0 for f in flip])
    foot = library.base[own] * flip[:2] + shift[:2]
    corner = np.array([ix * size, iy * size])
    near = np.linalg.norm(foot + corner - centre, axis=1) < reach
    own, foot = own[near], foot[near]
    a, b = library.a[own] * flip + shift, library.b[own] * flip + shift
    half = np.where((library.shape[own] != Shape.CAPSULE)[:, None], library.width[own] * flip, 0.0)
    organ = library.organ[own].copy()
    limit = _cut_height(pages, at, foot, size) / scale
    keep = np.minimum(a[:, 2], b[:, 2]) < limit
    a, b = _clipped(a, b, limit), _clipped(b, a, limit)
    organ[np.isfinite(limit) & (organ == Organ.STEM)] = Organ.STUBBLE
    for p in (a, b):
        zeta = p[:, 2].copy()
        p[:, 0] += lean_x * zeta
        p[:, 1] += lean_y * zeta
        plane = ground + slope_x * (p[:, 0] - size / 2) + slope_y * (p[:, 1] - size / 2)
        p[:, 2] = plane + scale * zeta
        p[:, :2] += corner
    radius = np.where(library.shape[own] == Shape.CAPSULE, library.radius[own], 0.0)
    tip = np.where(library.shape[own] == Shape.TRIANGLE, 0.0, 1.0)
    return a[keep], b[keep], half[keep], radius[keep], organ[keep], tip[keep]


def _cut_height(pages: Pages, at: tuple[int, int, int], foot: F64, size: float) -> F64:
    """Height [m] at which the stems with these feet are cut, inf = they stand."""
    slot, iy, ix = at
    row = int(pages.cut_slot[slot])
    if row < 0:
        code = np.full(len(foot), -1 - row)
    else:
        fine = PAGE_CUT_CELLS // PAGE_TILES
        cell = np.clip(np.floor(foot * (fine / size)).astype(int), 0, fine - 1)
        code = pages.cut[row, iy * fine + cell[:, 1], ix * fine + cell[:, 0]].astype(int)
    return np.where(code == STANDING, np.inf, 0.01 * code)


def _clipped(end: F64, other: F64, limit: F64) -> F64:
    """The end, moved down along the piece to the cut where it lies above it."""
    drop = end[:, 2] - other[:, 2]
    share = np.where(end[:, 2] > limit, (limit - other[:, 2]) / np.where(drop == 0.0, 1.0, drop), 1.0)
    return other + np.clip(share, 0.0, 1.0)[:, None] * (end - other)


@dataclass(frozen=True)
class Camera:
    """A pinhole. eye [m], (3,); axes: right, up, forward, (3, 3) rows; world."""

    eye: F64
    axes: F64

    @staticmethod
    def looking(eye: F64, target: F64) -> "Camera":
        """At `target`, upright."""
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return Camera(eye, np.stack([right, np.cross(right, forward), forward]))

    def project(self, points: Any) -> tuple[F64, F64]:
        """(image coordinates (..., 2) at unit focal length, depth (...) [m])."""
        seen = (np.asarray(points, dtype=float) - self.eye) @ self.axes.T
        depth = np.maximum(seen[..., 2], 0.05)
        return seen[..., :2] / depth[..., None], depth


def stand_figure(field: Field, scan: KeptScan, machine: RecordedMachine, edge: F64) -> Any:
    """The stand where a scan meets the edge, with its echoes.

    edge: points of the initial edge in the world, (k, 2) [m]
    """
    side = 1.0 if machine.edge_side == "left" else -1.0
    edge_seen = np.nan if scan.edge is None else scan.edge.offset
    y = next((v for v in (scan.edge_true, edge_seen) if np.isfinite(v)), 0.0)
    y = float(y) if y else machine.geometry.header_end(machine.edge_side)[1]
    box = _Box(scan.pose, _meeting(scan, y), y, side)
    camera = Camera.looking(box.world(-6.0, 2.9, 3.0), box.world(0.2, -0.15, 0.30))
    x0, y0, _ = box.world(0.0, 0.0, 0.0)
    found = organs_near(field, float(x0), float(y0), 3.4)
    quads, colours = _painted(field, found, box, camera)
    fig = figure(11.0, 6.2, layout=None)
    ax = fig.add_axes((0.0, 0.0, 1.0, 0.95))
    ax.add_collection(_areas(quads, colours))
    _draw_edges(ax, field, scan, edge, box, camera)
    _draw_echoes(ax, scan, machine, box, camera)
    low, high = quads.min(axis=(0, 1)), quads.max(axis=(0, 1))
    ax.set(xlim=(low[0] - 0.01, high[0] + 0.01), ylim=(low[1] - 0.01, high[1] + 0.01), aspect="equal")
    ax.set_axis_off()
    _legend(ax, found.organ)
    return fig


def _meeting(scan: KeptScan, y: float) -> float:
    """How far ahead of the axle the echoes next to the edge lie [m]; the edge's reference without any."""
    hits = scan.pose.inverse().apply(scan.hits) if len(scan.hits) else np.zeros((0, 3))
    near = hits[np.abs(hits[:, 1] - y) < 1.0, 0]
    return (
        float(0.5 * (near.min() + near.max())) if len(near) else (scan.edge.reference_x if scan.edge else 0.0)
    )


@dataclass(frozen=True)
class _Box:
    """A frame at the edge's reference point: u ahead, v to the cut side, both [m]."""

    pose: Pose
    x: float
    y: float
    side: float

    def world(self, u: float, v: float, height: float) -> F64:
        return np.asarray(self.pose.apply([self.x + u, self.y + self.side * v, height]))

    def holds(self, points: F64) -> Mask:
        local = self.pose.inverse().apply(points)
        u, v = local[..., 0] - self.x, self.side * (local[..., 1] - self.y)
        return np.asarray((u > -BACK) & (u < AHEAD) & (np.abs(v) < ASIDE))


def _painted(field: Field, organs: Organs, box: _Box, camera: Camera) -> tuple[F64, F64]:
    """Quads (n, 4, 2) in the image and their colours (n, 4), in painting order: ground, then far to near."""
    seen = organs.take(box.holds(organs.a))
    a, b = seen.a, seen.b
    image, _ = camera.project(seen.quads(camera.eye))
    depth = np.linalg.norm(camera.eye - 0.5 * (a + b), axis=1)
    height = 0.5 * (a[:, 2] + b[:, 2]) - np.asarray(field.ground_height(a[:, 0], a[:, 1]), dtype=float)
    order = np.argsort(-depth)
    colours = _shaded(seen.organ, height, depth)
    ground, soil = _ground(field, box, camera)
    return np.concatenate([ground, image[order]]), np.concatenate([soil, colours[order]])


def _areas(quads: F64, colours: F64) -> Any:
    """Quads (n, 4, 2) of colours (n, 4) as a collection for the axes, painted in their order.

    One path of the plotting library holds all quads of like colour of a layer: some 3,000 instead of 50,000.
    All corners run the same way round, so that quads of a path that overlap add up.
    """
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path

    around = quads[:, 2:] - quads[:, :2]  # the diagonals
    turned = around[:, 0, 0] * around[:, 1, 1] < around[:, 0, 1] * around[:, 1, 0]
    quads = np.where(turned[:, None, None], quads[:, ::-1], quads)
    shade = (np.clip(colours, 0.0, 1.0) * SHADES + 0.5).astype(np.int64)
    layer = np.arange(len(quads)) * LAYERS // max(len(quads), 1)
    key = (layer * 32 + shade[:, 0]) * 1024 + shade[:, 1] * 32 + shade[:, 2]
    order = np.argsort(key, kind="stable")
    _, first = np.unique(key[order], return_index=True)
    ring = np.concatenate([quads, quads[:, :1]], axis=1)[order]
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(quads))
    ends = [*first[1:], len(quads)]
    paths = [
        Path(ring[i:j].reshape(-1, 2), codes[5 * i : 5 * j])
        for i, j in zip(first.tolist(), ends, strict=True)
    ]
    made = PathCollection(paths, facecolors=colours[order][first], edgecolors="none", linewidths=0)
    return made


def _shaded(organ: U8, height: F64, depth: F64) -> F64:
    """Organ colours, darker deep in the stand and paler far away."""
    from matplotlib.colors import to_rgb

    table = np.ones((len(Organ), 3)) * 0.6
    for kind, colour in COLOURS.items():
        table[kind] = to_rgb(colour)
    lit = 0.50 + 0.50 * np.clip(height / 0.75, 0.0, 1.0)
    lit = np.where(organ == Organ.STUBBLE, 0.78 + 0.22 * np.clip(height / 0.15, 0.0, 1.0), lit)
    rgb = table[organ] * lit[:, None]
    haze = 0.35 * np.clip((depth - 5.0) / 7.0, 0.0, 1.0)[:, None]
    return np.concatenate([rgb * (1 - haze) + haze, np.ones((len(rgb), 1))], axis=1)


def _ground(field: Field, box: _Box, camera: Camera) -> tuple[F64, F64]:
    from matplotlib.colors import to_rgb

    u, v = np.arange(-BACK, AHEAD + 1e-9, 0.2), np.linspace(-ASIDE, ASIDE, 20)
    nodes = np.stack([[box.world(float(i), float(j), 0.0) for j in v] for i in u])
    nodes[..., 2] = field.ground_height(nodes[..., 0], nodes[..., 1])
    quads = np.stack([nodes[:-1, :-1], nodes[1:, :-1], nodes[1:, 1:], nodes[:-1, 1:]], axis=2)
    image, depth = camera.project(quads.reshape(-1, 4, 3))
    far = np.clip((depth.mean(axis=1) - 4.0) / 6.0, 0.0, 1.0)[:, None]
    colours = (1 - far) * np.array(to_rgb(GROUND)) + far * np.array(to_rgb(GROUND_FAR))
    order = np.argsort(-depth.mean(axis=1))
    rgba = np.concatenate([colours, np.ones((len(colours), 1))], axis=1)
    return image[order], rgba[order]


def _draw_edges(ax: Any, field: Field, scan: KeptScan, edge: F64, box: _Box, camera: Camera) -> None:
    """The initial and the detected edge on the ground."""
    u = np.linspace(-BACK, AHEAD, 40)
    seen = np.zeros((0, 2))
    if scan.edge is not None and scan.edge.is_found and np.isfinite(scan.edge.heading):
        ahead = box.x + u - scan.edge.reference_x
        v = (
            scan.edge.offset
            - box.y
            + np.tan(scan.edge.heading) * ahead
            + 0.5 * scan.edge.curvature * ahead**2
        )
        seen = np.stack([box.world(*at, 0.0)[:2] for at in zip(u, box.side * v, strict=True)])
    for line, colour, dash in ((_fine(edge), INK, (0, (5, 3))), (seen, ORANGE, "-")):
        if len(line):
            z = np.asarray(field.ground_height(line[:, 0], line[:, 1]), dtype=float) + 0.02
            points = np.concatenate([line, z[:, None]], axis=1)
            points = points[box.holds(points)]
            ax.plot(*camera.project(points)[0].T, color=colour, lw=1.6, ls=dash, zorder=3)


def _fine(line: F64) -> F64:
    """Points at most 5 cm apart along a line, (n, 2) [m]."""
    if len(line) < 2:
        return line
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = np.arange(0.0, way[-1], 0.05)
    return np.stack([np.interp(at, way, line[:, 0]), np.interp(at, way, line[:, 1])], axis=1)


def _draw_echoes(ax: Any, scan: KeptScan, machine: RecordedMachine, box: _Box, camera: Camera) -> None:
    """Echoes with the last stretch of their beams."""
    from matplotlib.collections import LineCollection

    hits = scan.hits[box.holds(scan.hits)] if len(scan.hits) else scan.hits
    if len(hits) == 0:
        return
    mounting = machine.mounting.get(scan.slot, Pose.identity())
    back = (scan.pose @ mounting).position - hits
    start = hits + 0.45 * back / np.linalg.norm(back, axis=1)[:, None]
    rays = np.stack([camera.project(start)[0], camera.project(hits)[0]], axis=1)
    ax.add_collection(LineCollection(list(rays), colors=BLUE, alpha=0.30, linewidths=0.8, zorder=4))
    ax.plot(*rays[:, 1].T, "o", color=BLUE, ms=4.2, mec="white", mew=0.6, zorder=5)


def _legend(ax: Any, organs: U8) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [Patch(fc=COLOURS[k], label=n) for k, n in NAMES.items() if (organs == k).any()]
    handles.append(Line2D([], [], marker="o", ls="", mfc=BLUE, mec="white", label="echo and its beam"))
    handles.append(Line2D([], [], color=INK, ls=(0, (5, 3)), label="initial edge"))
    handles.append(Line2D([], [], color=ORANGE, label="detected edge"))
    ax.legend(handles=handles, ncol=len(handles), loc="lower center", bbox_to_anchor=(0.5, 1.0),
              handlelength=1.4, columnspacing=1.2, borderaxespad=0.2)  # fmt: skip
