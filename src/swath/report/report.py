"""report.html: one self-contained page about a run; no scripts, prints on paper.

Pictures that cameras took on the way are kept for it.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.files.whole_file import write_whole
from swath.core.number_text import num
from swath.field.memory_layout import Solids
from swath.field.weather import KELVIN
from swath.judge.catalogue import EvaluatorCatalogue
from swath.judge.evaluators.edge_detection import EdgeDetection, EdgeSeries
from swath.judge.evaluators.lateral_error import LateralError, PathSeries
from swath.judge.evaluators.unloading import Unloading, UnloadingSeries
from swath.judge.windows import FIELD
from swath.record.charts import path_of, shown_charts
from swath.record.message_factory import RecordedMachine
from swath.record.tracks import SHOWN_ROWS, Column, Tracks
from swath.report import page, plots
from swath.report.field_plot import MapTrack, map_figure, silhouette
from swath.report.flow import FlowSampler, flow_figure
from swath.report.html import Figure
from swath.report.scan_sampler import (
    FieldMap,
    KeptScan,
    Sampler,
    ScanSampler,
    circles_of,
    make_map,
    spread_evenly,
)
from swath.report.sent import sent
from swath.runtime.hooks import ActiveRun, RunHook
from swath.scenario.defaults import default_lines
from swath.scenario.scenario import Scenario
from swath.signals import F64, OBSTACLE_KINDS, Image, Signal
from swath.signals.image import ImageBoxes

SPACING_M = 2.0  # between kept pictures at first; doubles whenever MOST are kept
NEAR_M = 20.0  # of a way: obstacles there are on the map
MOST = 8
SHOWN = 4
ABOUT_DRIVING = (
    "Loss: share of the grain in the crop that leaves the machine. Above an engine load of 100 % the engine "
    "loses speed."
)
ABOUT_FLOW = (
    "Widths are masses, over the whole run; what is still inside at its end is missing at the right. "
    "Shares are of the grain that came out up to then, those in the results of what leaves together. "
    "Below: grain that leaves the machine with straw and chaff, and what a controller set."
)


@dataclass(frozen=True)
class KeptPicture:
    """A picture, the boxes around what is in it where the camera gives them, and where it was taken [m]."""

    image: Image
    boxes: ImageBoxes | None
    distance: float

    @property
    def nearest(self) -> float:
        """Distance of the nearest thing in it [m], inf where there is none."""
        return float(min(self.boxes.distance, default=np.inf)) if self.boxes is not None else float("inf")


@dataclass
class _Camera:
    newest: KeptPicture
    nearest: KeptPicture
    kept: list[KeptPicture] = field(default_factory=list)
    spacing: float = SPACING_M


class PictureSampler(Sampler):
    """Observer that keeps pictures of every camera of a machine at even distances, the newest, and the one
    with the nearest thing in it. state: gives the newest `MachineState`.
    """

    SEEN = (Image, ImageBoxes)

    def __init__(self, machine: RecordedMachine, state: Callable[[], Any]) -> None:
        self.machine, self._state = machine, state
        self._cameras: dict[str, _Camera] = {}

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Watch what `slot` published."""
        image = boxes = None
        for signal in outputs.values():
            if isinstance(signal, Image):
                image = signal
            elif isinstance(signal, ImageBoxes):
                boxes = signal
        if image is None or image.t == 0:  # black, before the first exposure
            return
        if image.colour.size or image.depth.size:
            self._keep(slot.partition(".")[2], KeptPicture(image, boxes, self._state().distance))

    def _keep(self, part: str, picture: KeptPicture) -> None:
        camera = self._cameras.setdefault(part, _Camera(picture, picture))
        camera.newest = picture
        if picture.nearest < camera.nearest.nearest:
            camera.nearest = picture
        if not camera.kept or picture.distance - camera.kept[-1].distance >= camera.spacing:
            camera.kept.append(picture)
            if len(camera.kept) > MOST:
                camera.kept, camera.spacing = camera.kept[::2], 2.0 * camera.spacing

    def pick(self) -> dict[str, list[KeptPicture]]:
        """By camera SHOWN pictures at the most, in the order of time: spread over the run, and the one with
        the nearest thing in it.
        """
        return {slot: _picked(camera) for slot, camera in self._cameras.items()}


def _picked(camera: _Camera) -> list[KeptPicture]:
    pictures = camera.kept if camera.newest is camera.kept[-1] else [*camera.kept, camera.newest]
    wanted = spread_evenly(pictures, SHOWN)
    if np.isfinite(camera.nearest.nearest) and all(p is not camera.nearest for p in wanted):
        wanted = [*spread_evenly(pictures, SHOWN - 1), camera.nearest]
    return sorted(wanted, key=lambda picture: picture.image.t)


def pictures_figure(pictures: Sequence[KeptPicture]) -> Any:
    """Pictures side by side, boxes drawn; temperatures in grey with their scale, depth in colours where a
    camera measures nothing else.
    """
    rows, shape = (len(pictures) + 1) // 2, pictures[0].image.height / pictures[0].image.width
    fig = plots.figure(11.0, rows * (5.4 * shape + 0.35))
    axes = fig.subplots(rows, 2, squeeze=False).ravel()
    far = max((_far(p.image) for p in pictures), default=1.0)
    warm = [p.image for p in pictures if np.isfinite(p.image.black)]
    coldest = min((image.black - KELVIN for image in warm), default=0.0)
    warmest = max((image.white - KELVIN for image in warm), default=0.0)
    drawn, scale = None, "distance along the optical axis [m]"
    for ax, picture in zip(axes, pictures, strict=False):
        image = picture.image
        if image.colour.size and np.isfinite(image.black):
            celsius = image.black - KELVIN + (image.white - image.black) / 255.0 * image.colour[..., 0]
            drawn = ax.imshow(celsius, cmap="gray", vmin=coldest, vmax=warmest)
            scale = "apparent temperature [°C]"
        elif image.colour.size:
            ax.imshow(image.colour)
        else:
            drawn = ax.imshow(image.depth, cmap="viridis_r", vmin=0.0, vmax=far)
        if picture.boxes is not None:
            _draw_boxes(ax, picture.boxes)
        ax.set_title(f"{num(picture.distance)} m, {num(image.t * 1e-9)} s", loc="left", fontsize=9.5)
    for ax in axes:
        ax.set_axis_off()
    if drawn is not None:
        fig.colorbar(drawn, ax=list(axes), label=scale, shrink=0.8)
    return fig


def _far(image: Image) -> float:
    known = image.depth[np.isfinite(image.depth)]
    return float(np.percentile(known, 98.0)) if known.size else 1.0


def _draw_boxes(ax: Any, boxes: ImageBoxes) -> None:
    from matplotlib.patches import Rectangle

    for kind, left, top, right, bottom, distance in zip(
        boxes.kind, boxes.left, boxes.top, boxes.right, boxes.bottom, boxes.distance, strict=True
    ):
        ax.add_patch(Rectangle((left, top), right - left, bottom - top, fill=False, ec=plots.ORANGE, lw=1.4))
        ax.text(
            left,
            bottom + 2.0,
            f"{OBSTACLE_KINDS[kind]}, {num(distance)} m",
            color="white",
            fontsize=9.0,
            va="top",
            bbox={"fc": plots.ORANGE, "ec": "none", "pad": 1.0},
            clip_on=True,
        )


@dataclass
class MachineReport:
    """What a report shows of one machine. What is None or empty is left out.

    tracks: its columns, as from `Recorder.tracks[name].arrays()`
    path, edges: what its evaluators saw
    scans: by scanner slot, from `ScanSampler.pick`, the newest last
    edge: initial, (k, 2) world [m]
    pictures: by camera slot, from `PictureSampler.pick`
    flow: what went through it
    columns: what the columns of its tracks are
    """

    machine: RecordedMachine
    tracks: Mapping[str, Any]
    path: PathSeries | None = None
    edges: EdgeSeries | None = None
    scans: Mapping[str, Sequence[KeptScan]] = field(default_factory=dict)
    edge: F64 = field(default_factory=lambda: np.zeros((0, 2)))
    pictures: Mapping[str, Sequence[KeptPicture]] = field(default_factory=dict)
    flow: FlowSampler | None = None
    columns: Sequence[Column] = ()


@dataclass
class ReportData:
    """Everything a report shows. What is None or empty is left out. `collect` makes it after a run.

    summary: as in summary.json (see `judge.summary.make_summary`)
    scenario: the resolved YAML
    map: from `make_map`
    obstacles: (x, y, radius) [m]
    driven: a track driven in reality, (n, 2) world [m]
    default_lines: numbers, from 1, of the lines of `scenario` that nobody wrote
    known: the evaluators
    unloading: grain handed over from machine to machine
    """

    summary: Mapping[str, Any]
    scenario: str
    machines: Sequence[MachineReport]
    map: FieldMap | None = None
    obstacles: Sequence[tuple[float, float, float]] = ()
    driven: F64 | None = None
    default_lines: Collection[int] = ()
    known: EvaluatorCatalogue | None = None
    unloading: UnloadingSeries | None = None


@dataclass
class Watched:
    """What is kept of a machine on the way: scans, pictures and what went through it."""

    scans: ScanSampler
    pictures: PictureSampler
    flow: FlowSampler


def collect(
    summary: Mapping[str, Any], run: ActiveRun, watched: Mapping[str, Watched], scenario: Scenario
) -> ReportData:
    """The data of a report after a run. watched: by machine; scenario: to print."""
    world, evaluation, measured = run.world, run.evaluation, summary.get("machines", {})
    machines = [
        _machine(run, watched[name], tracks, measured.get(name, summary))
        for name, tracks in run.recorder.tracks.items()
    ]
    moved = [m for m in machines if len(m.tracks["t_s"])]
    unloading = evaluation.find(FIELD, Unloading)
    picture = None
    if moved:
        ends = [
            path_of(m.tracks, *m.machine.geometry.header_end(s)) for m in moved for s in _sides(m.machine)
        ]
        near = near_obstacles(world.obstacles, np.concatenate(ends))
        picture = make_map(world.field, ends[0], also=np.concatenate([*ends[1:], near]), margin=6.0)
    return ReportData(
        summary,
        scenario.resolved(),
        machines,
        map=picture,
        obstacles=circles_of(world.obstacles),
        driven=world.driven,
        default_lines=default_lines(scenario),
        known=evaluation.catalogue,
        unloading=None if unloading is None else unloading.series(),
    )


def _machine(run: ActiveRun, kept: Watched, own: Tracks, measured: Mapping[str, Any]) -> MachineReport:
    machine, edge, tracks = kept.scans.machine, np.zeros((0, 2)), own.arrays(most=SHOWN_ROWS)
    lateral = run.evaluation.find(machine.name, LateralError)
    detection = run.evaluation.find(machine.name, EdgeDetection)
    if len(tracks["t_s"]) and lateral is not None:
        path = path_of(tracks, *machine.geometry.header_end(machine.edge_side))
        edge = _edge_about(lateral.setup.edge, path, float(tracks["distance_m"][-1]) + 60.0)
    return MachineReport(
        machine,
        tracks,
        None if lateral is None or "lateral_rms_m" not in measured else lateral.series(SHOWN_ROWS),
        None if detection is None or "edge_rmse_m" not in measured else detection.series(SHOWN_ROWS),
        {slot: kept.scans.pick(slot) for slot in kept.scans.scanners},
        edge,
        kept.pictures.pick(),
        kept.flow,
        own.columns,
    )


def _sides(machine: RecordedMachine) -> tuple[str, str]:
    """The side that follows the edge first."""
    return ("left", "right") if machine.edge_side == "left" else ("right", "left")


def _edge_about(shape: Any, path: F64, reach: float) -> F64:
    """Points of the initial edge [m], from a little before a path to a little beyond it."""
    start = float(shape.project(path[0, 0], path[0, 1])[0])
    return np.asarray(shape.point_at(np.arange(start - 30.0, start + reach, 0.25)))


@dataclass(frozen=True)
class FinishedRun:
    """A run that is over and lacks its report, which is drawn while its recording is played.

    summary: None of one that was killed; it becomes that of what is played
    """

    folder: Path
    summary: Mapping[str, Any] | None
    scenario: Scenario


class ReportWriter(RunHook):
    """Writes report.html once a run is complete. of: a finished run to write it for, instead of its own."""

    def __init__(self, *, of: FinishedRun | None = None) -> None:
        self._of = of

    def begin(self, run: ActiveRun) -> None:
        """Keep some scans of every machine on the way."""
        self._run = run
        self._watched: dict[str, Watched] = {}
        for name, machine in run.evaluation.machines.items():
            detection = run.evaluation.find(name, EdgeDetection)
            assert detection is not None
            state = partial(run.world.graph.latest, f"{name}.motion", "state")
            scans = ScanSampler(machine, partial(getattr, detection, "true_offset"), state)
            kept = self._watched[name] = Watched(scans, PictureSampler(machine, state), FlowSampler(machine))
            run.observers.insert(run.observers.index(run.recorder), kept.scans)
            run.observers.append(kept.flow)
            if run.world.machines[name].slots_of("camera"):
                run.observers.append(kept.pictures)

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write the page; an incomplete run gets none unasked, one without a folder has no place for it."""
        run = self._run
        if summary["incomplete"] or run.out is None:
            return
        of = self._of or FinishedRun(run.out, summary, run.world.scenario)
        told = _of_killed(summary, of.scenario) if of.summary is None else of.summary
        write_report(of.folder, collect(told, run, self._watched, of.scenario))


def _of_killed(played: Mapping[str, Any], scenario: Scenario) -> dict[str, Any]:
    """The summary of a run that left none, by that of its recording as it was played."""
    what = f"the run was killed: this is what its recording holds, {num(played['simulated_s'])} s"
    own = {"summary": scenario.summary, "incomplete": True, "digest": "", "notes": [what, *played["notes"]]}
    return {**played, **own}


def write_report(run_dir: Path, data: ReportData) -> Path:
    """Write `report.html` into the run folder in one go and return its path."""
    with plots.styled():
        figures = list(figures_of(data))
        lines = [sent(own.machine, own.columns, own.tracks) for own in data.machines if own.columns]
        text = page.render(data.summary, data.scenario, figures, data.default_lines, data.known, lines)
    return write_whole(run_dir / "report.html", text)


def figures_of(data: ReportData) -> Iterator[Figure]:
    """The figures of the page, in their order."""
    if data.map is not None:
        yield _map(data, data.map)
    if data.unloading is not None and len(data.unloading.t):
        yield from _unloading(data.unloading)
    for own in data.machines:
        for made in _of_machine(data, own):
            title = made.title if len(data.machines) == 1 else f"{made.title}: {own.machine.name}"
            yield replace(made, title=title)


def _of_machine(data: ReportData, own: MachineReport) -> Iterator[Figure]:
    if own.path is not None and len(own.path.distance) > 1:
        yield _errors(data, own)
    for slot, scans in own.scans.items():
        if scans:
            yield _scans(own, slot)
    for slot, pictures in own.pictures.items():
        yield _pictures(slot, pictures, alone=len(own.pictures) == 1)
    if len(own.tracks.get("t_s", ())) > 1:
        flow = own.flow if own.flow is not None and own.flow.shows else None
        if flow is not None:
            image = plots.as_image(flow_figure(flow, own.tracks))
            yield Figure("Flow through the machine", image, ABOUT_FLOW)
        yield from _drive(own, of_flow=None if flow is None else False)


def near_obstacles(obstacles: Solids, ways: F64) -> F64:
    """Middles of the obstacles that the map shows [m], (n, 2): those within NEAR_M of a way."""
    middles = [np.array(circle[:2]) for circle in circles_of(obstacles)]
    return np.array([m for m in middles if np.hypot(*(ways - m).T).min() < NEAR_M]).reshape(-1, 2)


def _map(data: ReportData, picture: FieldMap) -> Figure:
    tracks = [
        MapTrack(
            m.machine.name,
            (
                path_of(m.tracks, *m.machine.geometry.header_end("left")),
                path_of(m.tracks, *m.machine.geometry.header_end("right")),
            ),
            path_of(m.tracks, 0.0, 0.0),
            _outline(m),
            m.machine.edge_side,
            has_header=m.path is not None,
        )
        for m in data.machines
        if len(m.tracks["t_s"])
    ]
    fig = map_figure(
        picture,
        tracks,
        edges=[m.edge for m in data.machines if len(m.edge) and m.path is not None],
        obstacles=data.obstacles,
        driven=data.driven,
        places=[(e["x_m"], e["y_m"], e["kind"]) for e in data.summary.get("incidents", [])],
    )
    caption = "The field after the run, turned so that the run goes from left to right."
    return Figure("Field map", plots.as_image(fig), caption)


def _unloading(series: UnloadingSeries) -> Iterator[Figure]:
    caption = (
        "Above: the grain along the middle of the box. In the middle: where the stream comes down, from "
        "where it was wanted. Below: how full the box is."
    )
    for name in series.heaps:
        image = plots.as_image(plots.unloading_figure(series, name))
        yield Figure(f"Unloading into {name}", image, caption)


def _outline(own: MachineReport) -> F64:
    """The machine at the end of the run, seen from above: its own shape, or header and body of its sheet."""
    g = own.machine.geometry
    if len(own.machine.triangles):
        return np.array([path_of(own.tracks, x, y)[-1] for x, y in silhouette(own.machine.triangles)])
    rear, front, half = g.body[0], g.body[1], g.body[2]
    corners = [(front, -half), (rear, -half), (rear, half), (front, half)]
    if own.path is not None:
        (lx, ly), (_, ry), back = g.header_end("left"), g.header_end("right"), g.knife_x - g.header_depth
        header = [(lx, ly), (lx, ry), (back, ry), (back, g.header_y - 0.7), (front, g.header_y - 0.7)]
        corners = [*header, *corners, (front, g.header_y + 0.7), (back, g.header_y + 0.7), (back, ly)]
    return np.array([path_of(own.tracks, x, y)[-1] for x, y in corners])


def _errors(data: ReportData, own: MachineReport) -> Figure:
    bands: dict[str, float] = {}
    for part, name in (("lateral", "lateral_rms_m"), ("edge", "edge_rmse_m")):
        for entry in data.summary.get("expect", []):
            is_ours = entry["subject"] == own.machine.name and entry["name"] == name
            if is_ours and "window" not in entry and "max" in entry["limit"]:
                bands[part] = float(entry["limit"]["max"])
    fig = plots.errors_figure(own.path, own.edges, bands)
    caption = "Above: distance of the header end from its line along the initial edge."
    if own.edges is not None:
        caption += " Below: the detected edge against the true one, where the detector reports it."
    if bands:
        caption += " Dashed: plus and minus the limit on the root mean square."
    return Figure("Steering and detection", plots.as_image(fig), caption)


def _scans(own: MachineReport, slot: str) -> Figure:
    fig = plots.scans_figure(own.scans[slot], own.machine.geometry, own.machine.edge_side)
    caption = (
        "Echoes as the sensor reports them, placed by its nominal mounting, seen from behind the machine: "
        "left is left. Travelled distance and detection error above each scan."
    )
    title = "Scans" if len(own.scans) == 1 else f"Scans of {slot}"
    return Figure(title, plots.as_image(fig), caption)


def _pictures(slot: str, pictures: Sequence[KeptPicture], *, alone: bool) -> Figure:
    image = plots.as_image(pictures_figure(pictures), kind="webp", dpi=110)
    caption = "Camera pictures of the run; boxes: the visible part of each object, from the truth."
    return Figure("Pictures" if alone else f"Pictures of {slot}", image, caption)


def _drive(own: MachineReport, *, of_flow: bool | None) -> Iterator[Figure]:
    """The curves of its tracks, but for those that have a figure of their own."""
    shown = shown_charts(own.tracks, cuts=own.path is not None, of_flow=of_flow)
    charts = [c for c in shown if c["title"] != "Edge"]
    if charts:
        yield Figure("Driving", plots.as_image(plots.curves_figure({"": own.tracks}, charts)), ABOUT_DRIVING)
