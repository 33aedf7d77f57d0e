"""The map of a field after a run: what stands, what was cut, who drove where.

`top_view` is the field from above as pixels, as it is now: crop, stubble, straw, bodies.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import Solids
from swath.report import plots
from swath.report.scan_sampler import FieldMap, straw_depth
from swath.runtime.world import World
from swath.signals import F64, U8, Mask

SHOWN_STRAW = 0.01  # depth from which straw is drawn [m]


def ground_colours(field: Any, x: F64, y: F64) -> U8:
    """Colours (..., 3) in sRGB of world points (...) [m]: crop, stubble, bare ground, straw."""
    left = field.left_height(x, y)
    colours = np.empty((*np.shape(x), 3), np.uint8)
    colours[...] = _rgb(plots.SOIL)
    colours[(left > 0.0) & np.isfinite(left)] = _rgb(plots.STUBBLE)
    colours[np.isinf(left)] = _rgb(plots.CROP)
    colours[(straw_depth(field, x, y) > SHOWN_STRAW) & ~np.isinf(left)] = _rgb(plots.STRAW)
    return colours


def top_view(world: World, machine: str, *, size_m: float = 30.0, pixels: int = 300) -> U8:
    """Picture in sRGB, (pixels, pixels, 3), north up: the machine in its middle is blue, others dark."""
    centre = world.bodies.pose_of(machine).position
    middle = (np.arange(pixels) + 0.5) / pixels - 0.5
    x, y = np.meshgrid(centre[0] + size_m * middle, centre[1] - size_m * middle)
    picture = ground_colours(world.field, x, y)
    own = world.bodies.own(machine)
    for body in world.bodies.around():
        picture[_under(body.solids, x, y)] = _rgb(plots.BLUE if body.name in own else plots.INK)
    return picture


def _under(solids: Solids, x: F64, y: F64) -> Mask:
    """Which points lie below or above a body. A mesh is taken as its box."""
    found: Mask = np.zeros(x.shape, bool)
    points = np.stack([x, y], axis=-1)
    reach = [np.abs(mesh.corners.reshape(-1, 3)).max(axis=0) for mesh in solids.mesh_shape]
    boxes = (
        *solids.boxes,
        *zip(solids.mesh_centre, solids.mesh_axes, reach, strict=True),
    )
    for centre, axes, half in boxes:
        found |= (np.abs((points - centre[:2]) @ axes[:2, :2]) <= half[:2]).all(axis=-1)
    for centre, axes, half in solids.ellipsoids:
        found |= (((points - centre[:2]) @ axes[:2, :2] / half[:2]) ** 2).sum(axis=-1) <= 1.0
    for a, b, radius in zip(solids.capsule_a, solids.capsule_b, solids.capsule_radius, strict=True):
        along = b[:2] - a[:2]
        share = np.clip((points - a[:2]) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        found |= ((points - a[:2] - share[..., None] * along) ** 2).sum(axis=-1) <= radius**2
    return found


def _rgb(colour: str) -> tuple[int, int, int]:
    """Numbers of a colour `#RRGGBB`."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return red, green, blue


SLICE = 0.1  # of an outline, along x [m]


@dataclass(frozen=True)
class MapTrack:
    """A machine's way on the map; world points [m], shape (n, 2).

    header_ends: left and right path
    axle: of the fixed axle's centre
    outline: of the machine at the end
    side: `left` or `right`, the header end that follows the edge
    has_header: it cuts
    """

    name: str
    header_ends: tuple[F64, F64]
    axle: F64
    outline: F64 | None = None
    side: str = "left"
    has_header: bool = True


def map_figure(
    picture: FieldMap,
    tracks: Sequence[MapTrack],
    *,
    edges: Sequence[F64] = (),
    obstacles: Sequence[tuple[float, float, float]] = (),
    driven: F64 | None = None,
    places: Sequence[tuple[float, float, str]] = (),
) -> Any:
    """Field map with the tracks of all machines.

    edges: initial edges, (k, 2); obstacles: x, y, radius; driven: a track driven in reality, (m, 2)
    places: x, y and kind of what happened; all world [m]
    """
    from matplotlib.patches import Circle

    left, right, bottom, top = picture.extent
    fig, axes = plots.panels(float(np.clip(10.0 * (top - bottom) / (right - left), 1.7, 8.5)) + 0.8, top=0.3)
    ax = axes[0, 0]
    ax.grid(False)
    ax.set_facecolor(plots.SOIL)

    def lay(share: NDArray[Any], colour: str, alpha: float, zorder: int, name: str) -> None:
        look = {"extent": picture.extent, "origin": "lower", "gid": f"{plots.DIM}_{name}"}
        ax.imshow(_layer(share, colour, alpha), zorder=zorder, **look)

    lay(picture.standing, plots.CROP, 0.92, 2, "crop")
    if picture.straw is not None and (picture.straw > 0.01).any():
        depth = np.clip(picture.straw / max(float(picture.straw.max()), 1e-6), 0, 1)
        lay(depth, plots.STRAW, 0.75, 3, "straw")
    ax.set_autoscale_on(False)
    for index, edge in enumerate(edges):
        label = None if index else "initial edge"
        ax.plot(*picture.place(edge).T, color=plots.INK, ls=(0, (5, 3)), label=label, lw=1.4, zorder=5)
    for index, track in enumerate(tracks):
        _draw_track(ax, picture, track, index, named=len(tracks) > 1)
    if driven is not None:
        ax.plot(
            *picture.place(driven).T, color=plots.PURPLE, ls=":", lw=2.0, zorder=6, label="driven in reality"
        )
    for x, y, radius in obstacles:
        u, v = picture.place([x, y])
        ax.add_patch(Circle((u, v), max(radius, 0.35), fc=plots.GREY, ec=plots.INK, lw=0.8, zorder=8))
    for kind in dict.fromkeys(kind for _, _, kind in places):
        at = picture.place([(x, y) for x, y, own in places if own == kind])
        ax.plot(*at.T, "X", ms=9, mfc="white", mec=plots.INK, zorder=9, label=kind)
    ax.set(xlim=(left, right), ylim=(bottom, top), xlabel="along the run [m]", aspect="equal")
    ax.set_ylabel("across [m]")
    _north(ax, picture.turn)
    _map_legend(ax, picture, has_obstacles=len(obstacles) > 0)
    return fig


def _draw_track(ax: Any, picture: FieldMap, track: MapTrack, index: int, *, named: bool) -> None:
    """What a machine cut, the header end that follows the edge, the axle, and the machine at the end, in the
    colour of its axle where there are several.
    """
    line = {"lw": 1.4, "zorder": 5}
    axle = (plots.BLUE, plots.GREEN, plots.PURPLE, plots.SKY)[index % 4]
    if track.has_header:
        left, right = (picture.place(_thin(end)) for end in track.header_ends)
        swath = np.concatenate([left, right[::-1]])
        ax.add_artist(_area(swath, color=plots.STUBBLE, lw=0, label=None if index else "cut in this run"))
        follows = f"header end ({track.side})" if not named else None if index else "header end"
        ax.plot(*(left if track.side == "left" else right).T, color=plots.ORANGE, label=follows, **line)
    label = track.name if named else "machine (fixed axle)"
    ax.plot(*picture.place(_thin(track.axle)).T, color=axle, label=label, **line)
    if track.outline is not None:
        outline = picture.place(track.outline)
        edge = {"ec": axle, "lw": 1.5} if named else {"ec": plots.INK, "lw": 0.9}
        ax.add_artist(_area(outline, fc="white", alpha=0.9, zorder=7, **edge))


def _area(corners: F64, **style: Any) -> Any:
    """A polygon (n, 2). `Axes.fill` would go through its sides one by one, to scale the axes."""
    from matplotlib.patches import Polygon

    return Polygon(corners, closed=True, **style)


def _thin(way: F64) -> F64:
    """Points of a way (n, 2) spread plots.evenly, and its end."""
    return np.concatenate([way[:-1][plots.evenly(way)], way[-1:]])


def _layer(share: NDArray[Any], colour: str, alpha: float) -> U8:
    """An image of one colour that covers as much as the share [0, 1] says, (h, w, 4)."""
    from matplotlib.colors import to_rgb

    rgba = np.empty((*share.shape, 4), np.uint8)
    rgba[..., :3] = np.rint(255.0 * np.array(to_rgb(colour)))
    rgba[..., 3] = np.rint(255.0 * alpha * share)
    return rgba


def _north(ax: Any, turn: float) -> None:
    """An arrow to the north in the upper right corner."""
    up = np.array([np.sin(turn), np.cos(turn)])
    ax.annotate(
        "N",
        xy=(0.975, 0.90),
        xycoords="axes fraction",
        xytext=tuple(-26 * up),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=9,
        color=plots.INK,
        zorder=9,
        arrowprops={"arrowstyle": "-|>", "color": plots.INK, "lw": 1.2, "shrinkA": 5, "shrinkB": 0},
        bbox={"boxstyle": "circle,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.85},
    )


def _map_legend(ax: Any, picture: FieldMap, *, has_obstacles: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles, _ = ax.get_legend_handles_labels()
    handles.insert(0, Patch(fc=plots.CROP, label="standing crop"))
    if picture.straw is not None and (picture.straw > 0.01).any():
        handles.insert(1, Patch(fc=plots.STRAW, alpha=0.75, label="straw"))
    if has_obstacles:
        handles.append(Line2D([], [], marker="o", ls="", mfc=plots.GREY, mec=plots.INK, label="obstacle"))
    ax.legend(handles=handles, ncol=len(handles), loc="lower left", bbox_to_anchor=(0.0, 1.0),
              handlelength=1.6, columnspacing=1.3, borderaxespad=0.2)  # fmt: skip


def silhouette(triangles: F64) -> F64:
    """Corners (n, 2) of the outline of triangles (m, 3, 3) seen from above [m], left side first.

    Slices along x, each from its rightmost to its leftmost point: notches across x are kept; holes are
    filled, gaps along x bridged.
    """
    flat = np.asarray(triangles, dtype=float)[:, :, :2]
    starts, ends = flat.reshape(-1, 2), np.roll(flat, -1, axis=1).reshape(-1, 2)
    steps = max(2, int(np.ceil(np.abs(ends - starts).max() / (0.5 * SLICE))) + 1)
    share = np.linspace(0.0, 1.0, min(steps, 400))[:, None, None]
    points = (starts + share * (ends - starts)).reshape(-1, 2)
    first = points[:, 0].min()
    number = ((points[:, 0] - first) / SLICE).astype(int)
    right, left = np.full(number.max() + 1, np.inf), np.full(number.max() + 1, -np.inf)
    np.minimum.at(right, number, points[:, 1])
    np.maximum.at(left, number, points[:, 1])
    kept = np.flatnonzero(np.isfinite(right))
    low, high = first + kept * SLICE, np.minimum(first + (kept + 1) * SLICE, points[:, 0].max())
    x = np.column_stack([low, high]).ravel()
    sides = [np.column_stack([x, np.repeat(y[kept], 2)]) for y in (left, right)]
    return np.concatenate([sides[0], sides[1][::-1]])
