"""report.html: one self-contained page about a run; no scripts, prints on paper."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from swath.field.memory_layout import Solids
from swath.judge.metrics import SETTLING_M
from swath.judge.referee import Referee, Series
from swath.record.messages import RecordedMachine
from swath.report import page, plots
from swath.report.scan_sampler import FieldMap, KeptScan, ScanKeeper, circles_of, make_map
from swath.report.stand3d import Stand, stand_figure
from swath.runtime.hooks import ActiveRun, RunHook
from swath.scenario.defaults import default_lines
from swath.signals import F64


@dataclass
class ReportData:
    """Everything a report shows. What is None or empty is left out. `collect` makes it after a run.

    summary: as in summary.json (see `study.summary.make_summary`)
    scenario: the resolved scenario as YAML text
    machine, series: of the machine the report is about, and its referee's `series()`
    tracks: its columns, as from `Recorder.tracks[name].arrays()`
    map: from `make_map`; scans: from `ScanKeeper.pick()`, the newest last
    stand: the field, when stems can be drawn from its pages
    edge: initial edge, (k, 2) world [m]; obstacles: (x, y, radius) [m]; driven: a track driven in reality
    default_lines: numbers, from 1, of the lines of `scenario` that nobody wrote
    """

    summary: Mapping[str, Any]
    scenario: str
    machine: RecordedMachine
    series: Series
    tracks: Mapping[str, Any]
    map: FieldMap | None = None
    scans: Sequence[KeptScan] = ()
    stand: Stand | None = None
    edge: F64 = field(default_factory=lambda: np.zeros((0, 2)))
    obstacles: Sequence[tuple[float, float, float]] = ()
    driven: F64 | None = None
    default_lines: Collection[int] = ()


def collect(
    summary: Mapping[str, Any],
    scenario: str,
    *,
    default_lines: Collection[int] = (),
    field: Any,
    referee: Referee,
    keeper: ScanKeeper,
    tracks: Mapping[str, Any],
    obstacles: Solids | None = None,
    driven: F64 | None = None,
) -> ReportData:
    """The data of a report after a run on a real field.

    summary: from `make_summary`; scenario: the resolved YAML; field: `swath.field.field.Field`
    tracks: `Recorder.tracks[name].arrays()`; driven: a track driven in reality, (n, 2) world [m]
    """
    machine = referee.machine
    picture, edge = None, np.zeros((0, 2))
    if len(tracks["t_s"]):
        side, other = ("left", "right") if machine.edge_side == "left" else ("right", "left")
        path = _way(tracks, *machine.geometry.header_end(side))
        picture = make_map(field, path, also=_way(tracks, *machine.geometry.header_end(other)), margin=6.0)
        edge = _edge_about(field.nominal_edge, path, float(tracks["distance_m"][-1]) + 60.0)
    return ReportData(
        summary,
        scenario,
        machine,
        referee.series(),
        tracks,
        map=picture,
        scans=keeper.pick(4),
        stand=field,
        edge=edge,
        obstacles=[] if obstacles is None else circles_of(obstacles),
        driven=driven,
        default_lines=default_lines,
    )


def _way(tracks: Mapping[str, Any], x: float, y: float) -> F64:
    """World path (n, 2) [m] of a point of the machine."""
    c, s = np.cos(tracks["yaw_rad"]), np.sin(tracks["yaw_rad"])
    return np.stack([tracks["x_m"] + c * x - s * y, tracks["y_m"] + s * x + c * y], axis=1)


def _edge_about(shape: Any, path: F64, reach: float) -> F64:
    """Points of the initial edge [m], from a little before a path to a little beyond it."""
    start = float(shape.project(path[0, 0], path[0, 1])[0])
    return np.asarray(shape.point_at(np.arange(start - 30.0, start + reach, 0.25)))


class ReportWriter(RunHook):
    """Writes report.html once a run is complete."""

    def begin(self, run: ActiveRun) -> None:
        """Keep some scans of the first machine on the way."""
        name = run.world.leader.name
        self._run, self._name = run, name
        self._keeper = ScanKeeper(run.referees[name].machine, run.referees[name])
        run.observers.insert(run.observers.index(run.recorder), self._keeper)

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write the page; an incomplete run gets none."""
        if summary["incomplete"]:
            return
        run, world = self._run, self._run.world
        data = collect(
            summary,
            world.scenario.resolved(),
            default_lines=default_lines(world.scenario),
            field=world.field,
            referee=run.referees[self._name],
            keeper=self._keeper,
            tracks=run.recorder.tracks[self._name].arrays(),
            obstacles=world.obstacles,
            driven=world.driven,
        )
        write_report(run.out, data)


def write_report(run_dir: Path, data: ReportData) -> Path:
    """Write `report.html` into the run folder in one go and return its path."""
    import matplotlib

    path = run_dir / "report.html"
    with matplotlib.rc_context(plots.STYLE):
        text = page.render(data.summary, data.scenario, list(_figures(data)), data.default_lines)
    part = path.with_suffix(".html.part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)
    return path


def _figures(data: ReportData) -> list[page.Figure]:
    made: list[page.Figure] = []
    if data.map is not None:
        made.append(_map(data))
    if len(data.series.distance) > 1:
        made.append(_errors(data))
    if data.scans:
        made.append(_scans(data))
        if data.stand is not None:
            made.append(_stand(data, data.stand))
    if len(data.tracks.get("t_s", ())) > 1:
        made.append(_drive(data))
        if np.isfinite(np.asarray(data.tracks.get("engine_load", np.nan))).any():
            made.append(_drivetrain(data))
    return made


def _map(data: ReportData) -> page.Figure:
    assert data.map is not None
    tracks, geometry = data.tracks, data.machine.geometry
    ends = _way(tracks, *geometry.header_end("left")), _way(tracks, *geometry.header_end("right"))
    fig = plots.map_figure(
        data.map,
        header_ends=ends,
        axle=_way(tracks, 0.0, 0.0),
        edge=data.edge,
        obstacles=data.obstacles,
        driven=data.driven,
        outline=_outline(data),
        side=data.machine.edge_side,
    )
    caption = "The field after the run, turned so that the run goes from left to right."
    return page.Figure("Field map", plots.as_image(fig, kind="png", dpi=190), caption)


def _outline(data: ReportData) -> F64:
    """The machine at the end of the run, seen from above: header and body."""
    g = data.machine.geometry
    rear, front, half = g.body[0], g.body[1], g.body[2]
    lx, ly = g.header_end("left")
    _, ry = g.header_end("right")
    corners = [(lx, ly), (lx, ry), (lx - g.header_depth, ry), (lx - g.header_depth, g.header_y - 0.7)]
    corners += [(front, g.header_y - 0.7), (front, -half), (rear, -half), (rear, half), (front, half)]
    corners += [(front, g.header_y + 0.7), (lx - g.header_depth, g.header_y + 0.7), (lx - g.header_depth, ly)]
    return np.array([_way(data.tracks, x, y)[-1] for x, y in corners])


def _errors(data: ReportData) -> page.Figure:
    expect = data.summary.get("expect") or {}
    bands: dict[str, float] = {}
    for part, name in (("lateral", "lateral_rms_m"), ("edge", "edge_rmse_m")):
        limit = expect.get(name, {}).get("limit", {}).get("max")
        if limit is not None:
            bands[part] = float(limit)
    fig = plots.errors_figure(data.series, settling=SETTLING_M, bands=bands)
    caption = (
        "Above: the header end against where it should be beside the initial edge. Below: the detected edge "
        "against the true one, at the place ahead where the detector reports it."
    )
    if bands:
        caption += " Dashed: plus and minus the limit on the root mean square."
    return page.Figure("Steering and detection", plots.as_image(fig), caption)


def _scans(data: ReportData) -> page.Figure:
    fig = plots.scans_figure(data.scans, data.machine.geometry, data.machine.edge_side)
    caption = (
        "Echoes as the sensor reports them, placed by its nominal mounting, seen from behind the machine: "
        "left is left. Travelled distance and detection error above each scan."
    )
    return page.Figure("Scans", plots.as_image(fig), caption)


def _stand(data: ReportData, stand: Stand) -> page.Figure:
    fig = stand_figure(stand, data.scans[-1], data.machine, data.edge)
    caption = (
        f"The stems about the edge ahead of the machine at {data.scans[-1].distance:.1f} m, every one as the "
        "rays met it, seen along the drive from above the cut ground, with the echoes of the last scan."
    )
    return page.Figure("The stand", plots.as_image(fig, kind="webp", dpi=190), caption)


def _drive(data: ReportData) -> page.Figure:
    fig = plots.drive_figure(dict(data.tracks))
    return page.Figure("Driving", plots.as_image(fig), "Speed, steering and use of the header's width.")


def _drivetrain(data: ReportData) -> page.Figure:
    fig = plots.works_figure(dict(data.tracks))
    caption = (
        "What reaches the feeder house; how much of its grain the crop that leaves at that moment has lost; "
        "the engine: above 100 % it loses speed."
    )
    return page.Figure("Crop and engine", plots.as_image(fig), caption)
