"""The paper's six figures and its three challenging cases, each drawn from what swath does here and now.

A figure is made by one function of the output folder, which also says in numbers what came out. What the
paper says of each stands in the page's template, `paper.html.j2`.
"""

import base64
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.random import Stream
from swath.core.units import DEG
from swath.field.field import Field
from swath.field.memory_layout import Organ
from swath.rays.engine import RayCaster
from swath.report.plots import (
    BLUE,
    CROP,
    FAINT,
    GREEN,
    GREY,
    INK,
    ORANGE,
    SOIL,
    STUBBLE,
    as_image,
    figure,
)
from swath.report.stand3d import COLOURS
from swath.signals import F64

SEED = 1
DENSITIES = (200.0, 600.0)  # stems/m2, as in the paper
SCANNERS = ("sick-lms511-hr", "sick-lms511-sr")  # of one make, with spots of 3.7 and 7.3 cm at 5 m
DEPRESSION = 30.0  # deg, of the middle beam in the lab
CASE_M = 60.0  # driven in each case of the closed loop
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "broken-edge": (
        "Broken edge: a gap of 3 m and random bites up to 15 cm deep",
        {
            "field.edge.gaps": [{"start_m": 30.0, "end_m": 33.0, "depth_m": 0.8, "stubble_height_m": 0.15}],
            "field.edge.teeth": {"amplitude_m": 0.15, "wavelength_m": 3.0, "kind": "random"},
        },
    ),
    "tight-curve": (
        "Tight curve: a bend of 16 m radius, at 4 km/h",
        {
            "field.edge": {"shape": "curve", "run_in_m": 25.0, "radius_m": 16.0, "angle_deg": 70.0},
            "combine.speed.speed_kmh": 4.0,
        },
    ),
    "low-density": ("Low crop density: 100 stems/m²", {"field.stand.stems_per_m2": 100.0}),
}
LEVEL_COLOURS = {"plants": BLUE, "empirical": ORANGE, "replay": GREEN}


@dataclass(frozen=True)
class Made:
    """A figure. image: data address; result: what came out, a sentence or two with numbers."""

    image: str
    result: str


def levels(out: Path) -> Made:
    """Every kind of part with its levels, and who else may stand in for it."""
    from swath.scenario.slots import CATALOGUE

    slots = [slot.name for slot in CATALOGUE.slots]
    rows, count = [], 0
    for kind in (*CATALOGUE.field_levels, *slots):
        names, is_slot = CATALOGUE.registry.names(kind), kind in slots
        count += len(names)
        software = "FMU · ROS 2 · Python" if is_slot else "Python"
        hardware = "controller box (CAN)" if kind == "steer" else ""
        rows.append((kind.replace("_", " "), " · ".join(names), software, hardware, "log" if is_slot else ""))
    head = ("part", "model in the loop: levels", "software in the loop", "hardware in the loop", "recorded")
    fig = figure(11.0, 0.5 + 0.235 * len(rows), layout=None)
    ax = fig.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(0, 11), ylim=(len(rows), -1.5))
    ax.set_axis_off()
    places = (0.1, 1.15, 6.9, 8.6, 10.25)
    for x, title, colour, column in zip(
        places, head, (INK, BLUE, GREY, ORANGE, GREEN), zip(*rows, strict=True), strict=True
    ):
        ax.text(x, -0.9, title, weight="bold", color=INK, size=9)
        for y, text in enumerate(column):
            ax.text(x, y, text, va="center", size=7.8, color=colour)
    for y in range(0, len(rows), 2):
        ax.axhspan(y - 0.5, y + 0.5, color=SOIL, lw=0)
    return Made(as_image(fig), f"{len(rows)} kinds of parts with {count} levels of swath's own.")


def flow(out: Path) -> Made:
    """The parts of the demo as they are wired, with level and rate of each."""
    from swath.runtime.assembly import assemble
    from swath.scenario.scenario import load_scenario

    world = assemble(load_scenario("laser-pilot"))
    nodes = {node.slot.name.partition(".")[2]: node for node in world.graph.nodes}
    world.close()
    rooms = {"sensing": GREEN, "control": BLUE, "machine": ORANGE}
    columns: dict[str, list[str]] = {room: [] for room in rooms}
    for name, node in nodes.items():
        room = type(node.component).__module__.split(".")[1]
        columns["machine" if room == "runtime" else room].append(name)
    fig = figure(11.0, 4.4, layout=None)
    ax = fig.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(0, 11), ylim=(0, 4.4))
    ax.set_axis_off()
    place: dict[str, tuple[float, float]] = {"field": (1.1, 2.1)}
    for x, names in zip((3.7, 6.3, 9.4), columns.values(), strict=True):
        for k, name in enumerate(names):
            place[name] = (x, 3.8 - (k + 0.5) * 3.6 / len(names))
    boxes = {"field": _box(ax, place["field"], "field", "terrain, stand; cut here", CROP, filled=True)}
    for room, names in columns.items():
        ax.text(place[names[0]][0], 4.15, room, ha="center", weight="bold", color=rooms[room])
        for name in names:
            level = type(nodes[name].component).__module__.rpartition(".")[2]
            rate = 1e9 / nodes[name].slot.period
            boxes[name] = _box(ax, place[name], name, f"{level}, {rate:g} Hz", rooms[room])
    arrows = {(source.partition(".")[2], name) for name, n in nodes.items() for source, _ in n.wires.values()}
    arrows |= {("field", name) for name in columns["sensing"] if "lidar" in name}
    for source, sink in sorted(arrows | {("header", "field")}):
        is_back = place[source][0] >= place[sink][0]
        ax.annotate(
            "", place[sink], place[source], zorder=1 if is_back else 2,
            arrowprops={
                "arrowstyle": "-|>", "lw": 1.0,
                "color": FAINT if is_back and source == "motion" else "#9AA0A8",
                "patchA": boxes[source], "patchB": boxes[sink], "shrinkA": 1, "shrinkB": 1,
                "connectionstyle": f"arc3,rad={-0.22 if is_back else 0.08}",
            },
        )  # fmt: skip
    wires = sum(len(node.wires) for node in nodes.values())
    text = f"The demo's {len(nodes)} parts and the {wires} wires between them, as they are assembled."
    return Made(as_image(fig), text + " The field closes the circle: the next scan sees the cut.")


def _box(
    ax: Any, at: tuple[float, float], title: str, text: str, colour: str, *, filled: bool = False
) -> Any:
    from matplotlib.patches import FancyBboxPatch

    x, y = at
    box = FancyBboxPatch(
        (x - 0.85, y - 0.2), 1.7, 0.4, boxstyle="round,pad=0.02,rounding_size=0.08",
        fc=CROP if filled else "white", ec=colour, lw=1.4, zorder=3,
    )  # fmt: skip
    ax.add_patch(box)
    ax.text(x, y + 0.07, title, ha="center", va="center", size=9, color=INK, zorder=4)
    ax.text(x, y - 0.1, text, ha="center", va="center", size=6.8, color=GREY, zorder=4)
    return box


def sensor_models(out: Path) -> Made:
    """One sweep over one stand by the three levels of the LiDAR, in a cut through that stand."""
    from swath.sensing.lidar_sheet import load_lidar
    from swath.tools.lab.lab import Bench, Case, Settings, make_stand

    density, half = 200.0, 14.0
    settings = Settings(
        densities=(density,), sensors=SCANNERS[:1], depressions_deg=(DEPRESSION,), seeds=1, seed=SEED,
        half_sector_deg=half, passes=1, stops=1,
    )  # fmt: skip
    stand = make_stand(settings, density, SEED)
    height = stand.crop_height
    spot = float(load_lidar(SCANNERS[0]).beam.diameter(settings.distance_m).mean())
    bench = Bench(settings, Case(density, SCANNERS[0], DEPRESSION, spot), stand, height, Stream(SEED, "lab"))
    (stop,) = bench.stops()
    across = np.linspace(-1.75, 1.75, 1400)
    up = np.arange(0.005, 1.02, 0.0025)[::-1]
    middle = settings.distance_m * np.cos(DEPRESSION * DEG)
    origins = np.empty((len(up), len(across), 3))
    origins[..., 0], origins[..., 1], origins[..., 2] = middle - 0.15, across, up[:, None]
    picture = _seen(stand, stop.apply(origins), stop.turn(np.array([1.0, 0.0, 0.0])), 0.45, ground=False)
    titles = {
        "replay": "measured data replayed by position (here: a recording made by plants, 0.3 m aside)",
        "empirical": "primitive bodies with an empirical spread",
        "plants": "3D surfaces of single plants, many rays a beam",
    }
    fig = figure(11.0, 8.0)
    axes = fig.subplots(len(titles), 1, sharex=True, sharey=True)
    told = []
    for ax, (level, title) in zip(axes, titles.items(), strict=True):
        (points,) = bench.echoes(level)
        local = stop.inverse().apply(points[np.isfinite(points[:, 0])])
        ax.imshow(
            0.5 + 0.5 * picture, extent=(across[0], across[-1], up[-1], up[0]), aspect="equal", zorder=1
        )
        ax.plot(
            local[:, 1], local[:, 2], "o", ms=4.5, mec="white", mew=0.6, color=LEVEL_COLOURS[level], zorder=3
        )
        ax.set_title(f"{level}: {title}", loc="left", fontsize=9.5)
        ax.set(ylabel="height [m]", ylim=(0.0, 1.02))
        told.append(f"{level} {np.median(local[:, 2]):.2f} m")
    axes[-1].set_xlabel("across [m]")
    text = (
        f"The same sweep of {len(points)} beams over the same {density:g} stems/m²: median height "
        f"{', '.join(told)}; the stand is {height:.2f} m high. Plants along 0.45 m are drawn."
    )
    return Made(as_image(fig, kind="webp"), text)


def _seen(field: Field, origins: F64, ahead: F64, reach: float, *, ground: bool = True) -> F64:
    """Colours (rows, columns, 3) of what rays (rows, columns) meet within reach [m], white where nothing.

    ahead: direction of all rays (3,), or of each (rows, columns, 3)
    """
    from matplotlib.colors import to_rgb

    centre = origins.reshape(-1, 3).mean(axis=0)
    field.ensure(centre[0], centre[1], reach + float(np.ptp(origins[..., :2])) + 2.0)
    directions = np.broadcast_to(ahead, origins.shape)
    hits = RayCaster(field).cast_image(origins, directions, range_max=reach)
    table = np.ones((len(Organ), 3))
    for organ, colour in COLOURS.items():
        table[organ] = to_rgb(colour)
    table[Organ.GROUND] = table[Organ.STRAW] = to_rgb("#C9BBA3") if ground else (1.0, 1.0, 1.0)
    lit = np.where(hits.organ > Organ.STRAW, 0.45 + 0.55 * hits.cosine, 1.0)
    return np.where(hits.is_hit[..., None], table[hits.organ] * lit[..., None], 1.0)


def lab_stands(out: Path) -> Made:
    """Stands of 200 and 600 plants/m2 as rays see them."""
    from swath.tools.lab.lab import Settings, make_stand

    rows, columns, focal = 420, 620, 700.0
    u, v = np.meshgrid(np.arange(columns) - columns / 2 + 0.5, np.arange(rows) - rows / 2 + 0.5)
    down = 32.0 * DEG
    forward, left, up = (
        np.array(axis)
        for axis in ((np.cos(down), 0, -np.sin(down)), (0, 1, 0), (np.sin(down), 0, np.cos(down)))
    )
    directions = focal * forward - u[..., None] * left - v[..., None] * up
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    fig = figure(11.0, 4.1)
    axes = fig.subplots(1, len(DENSITIES))
    told = []
    for ax, density in zip(axes, DENSITIES, strict=True):
        stand = make_stand(Settings(), density, SEED)
        origins = np.broadcast_to(np.array([-1.6, 0.0, 1.75]), directions.shape)
        ax.imshow(_seen(stand, np.ascontiguousarray(origins), directions, 12.0))
        ax.set_axis_off()
        ax.set_title(f"{density:g} plants/m²", loc="left", fontsize=9.5)
        told.append(f"{_counted(stand):.0f}")
    text = f"Wheat; plants counted in 4 m² of the stands: {' and '.join(told)} per m²."
    return Made(as_image(fig, kind="webp"), text)


def _counted(stand: Field) -> float:
    """Stems/m2 that stand within 2 m x 2 m about the origin."""
    from swath.report.stand3d import organs_near

    stand.ensure(0.0, 0.0, 3.0)
    organs = organs_near(stand, 0.0, 0.0, 1.5)
    feet = organs.a[(organs.organ == Organ.STEM) & (organs.a[:, 2] < 0.02)]
    return float((np.abs(feet[:, :2]).max(axis=1) < 1.0).sum()) / 4.0


def heights(out: Path) -> Made:
    """Histograms of the measured height over both stands, by two scanners and all levels."""
    import matplotlib

    from swath.report.plots import STYLE
    from swath.tools.lab.comparison import compare_levels
    from swath.tools.lab.lab import Settings, run_lab
    from swath.tools.lab.page import histograms_figure

    lab = run_lab(Settings(DENSITIES, SCANNERS, (DEPRESSION,), seeds=2, seed=SEED))
    cases = compare_levels(lab, None)
    with matplotlib.rc_context(STYLE):
        image = as_image(histograms_figure(lab, cases))
    told, rows = [], []
    for case in cases:
        c, found = case.heights.case, np.concatenate(case.heights.heights["plants"])
        low, median, high = np.nanpercentile(found, (10.0, 50.0, 90.0))
        rows.append((c.density, c.spot, median, high - low))
        told.append(
            f"{c.density:g} plants/m² with a spot of {100 * c.spot:.1f} cm {median:.2f} m "
            f"(8 of 10 within {100 * (high - low):.0f} cm)"
        )
    density, spot, median, spread = np.array(rows).T
    rise = 100 * (median[density == density.max()].mean() - median[density == density.min()].mean())
    large, small = spot == spot.max(), spot == spot.min()
    by_spot = 100 * (median[large].mean() - median[small].mean())
    narrower = 100 * (spread[large].mean() - spread[small].mean())
    text = (
        f"Median height by plants: {', '.join(told)}. The denser stand moves the median by {rise:+.0f} cm; "
        f"the larger spot moves it by {by_spot:+.0f} cm and the spread by {narrower:+.0f} cm. "
        "Heights measured in the field can be laid over these: swath lab stand --real FILE."
    )
    return Made(image, text)


def edge_detection(out: Path) -> Made:
    """A scan across the edge of 3D plants, with the edge that was detected."""
    from swath.scenario.scenario import load_scenario
    from swath.tools.scan.scan import scan_job

    scenario = load_scenario("straight", sets=["combine.lidar.level=plants", f"seed={SEED}"])
    with tempfile.TemporaryDirectory() as folder:
        picture, arrays = scan_job(scenario, Path(folder) / "scan", at_s=12.0, formats=("png", "npz"))
        image = f"data:image/png;base64,{base64.b64encode(picture.read_bytes()).decode()}"
        with np.load(arrays) as data:
            true, found = float(data["edge_true_m"]), float(data["edge_detected_m"])
    return Made(
        image,
        f"Detected at {found:.3f} m left of the axle, true {true:.3f} m: {100 * (found - true):+.1f} cm.",
    )


def closed_loop(name: str) -> Callable[[Path], Made]:
    """A case of the closed loop, driven by the default chain on 3D plants."""

    def make(out: Path) -> Made:
        import pyarrow.parquet as parquet

        from swath.replay.writer import ReplayWriter
        from swath.report.report import ReportWriter
        from swath.runtime.assembly import assemble
        from swath.runtime.job import run_job
        from swath.scenario.scenario import load_scenario

        title, changed = CASES[name]
        sets = [f"{key}={json.dumps(value)}" for key, value in changed.items()]
        sets += [f"run.distance_m={CASE_M:g}", f"name={name}", f"summary={json.dumps(title)}", "expect={}"]
        sets += ["combine.lidar.level=plants"]
        scenario = load_scenario("straight", sets=sets)
        world = assemble(scenario)
        field = world.field
        s, offset = np.arange(0.0, CASE_M + 14.0, 0.05), np.arange(-1.2, 1.2, 0.02)
        edge = field.first_edge
        normal = edge.heading_at(s) + 0.5 * np.pi
        x, y = (edge.point_at(s)[:, k] + offset[:, None] * f(normal) for k, f in enumerate((np.cos, np.sin)))
        standing = field.standing(x, y)
        world.close()
        folder = out / name
        summary = run_job(scenario, folder, hooks=[ReportWriter(), ReplayWriter()]).summary
        tracks = parquet.read_table(folder / "tracks.parquet").to_pydict()
        at, aside = edge.project(np.array(tracks["header_end_x_m"]), np.array(tracks["header_end_y_m"]))
        return Made(_case_figure(s, offset, standing, at, aside, tracks), _told(summary))

    return make


def _told(summary: Mapping[str, Any]) -> str:
    cm = {name: 100.0 * summary[name] for name in ("lateral_rms_m", "lateral_p95_m", "edge_rmse_m")}
    return (
        f"Lateral error {cm['lateral_rms_m']:.1f} cm RMS, 95 % within {cm['lateral_p95_m']:.1f} cm; detected "
        f"edge {cm['edge_rmse_m']:.1f} cm RMS, found in {100 * summary['detection_availability']:.0f} % of "
        f"the scans; {summary['distance_m']:.0f} m driven."
    )


def _case_figure(
    s: F64, offset: F64, standing: Any, at: F64, aside: F64, tracks: Mapping[str, Sequence[Any]]
) -> str:
    """The field along its edge, drawn straight, with the path of the header's end; errors below."""
    from matplotlib.colors import ListedColormap

    fig = figure(11.0, 4.2)
    above, below = fig.subplots(2, 1, sharex=True)
    extent = (s[0], s[-1], offset[0], offset[-1])
    above.imshow(
        standing, extent=extent, origin="lower", aspect="auto", cmap=ListedColormap([STUBBLE, CROP]),
        vmin=0, vmax=1, interpolation="nearest",
    )  # fmt: skip
    above.plot(at, aside, color=BLUE, lw=1.6, label="end of the header")
    above.set(ylabel="left of the edge [m]", xlim=(0.0, CASE_M + 12.0))
    above.legend(loc="upper right", ncol=2)
    lateral, seen, true = (
        np.array(tracks[k], float) for k in ("lateral_error_m", "edge_offset_m", "edge_true_m")
    )
    below.axhline(0.0, color=FAINT, lw=1.0)
    below.plot(at, 100 * (seen - true), color=ORANGE, lw=1.0, label="detected minus true edge")
    below.plot(at, 100 * lateral, color=BLUE, lw=1.4, label="header's end from its line, > 0 into the crop")
    below.set(ylabel="error [cm]", xlabel="along the edge [m]", ylim=(-40, 40))
    below.legend(loc="upper right", ncol=2)
    return as_image(fig)


FIGURES: dict[str, Callable[[Path], Made]] = {
    "levels": levels,
    "flow": flow,
    "sensor models": sensor_models,
    "lab stands": lab_stands,
    "measured heights": heights,
    "edge detection": edge_detection,
    **{name: closed_loop(name) for name in CASES},
}
"""Figures 1 to 6 in their order, and the cases."""
