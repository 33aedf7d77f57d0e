"""From a combine's yield log to a field folder."""

import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.resources import files
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, check_within
from swath.core.files.read_file import open_to_read
from swath.core.number_text import num, percent_of, span
from swath.documents.json_file import json_safe
from swath.documents.reasons import key_of
from swath.documents.witness import Pair, judge, outside, ratio
from swath.field.crop import Crop
from swath.field.crop_sheet import load_crop
from swath.field.maps.projection import Origin, transform
from swath.field.maps.raster import Raster
from swath.field_io import folder, outline
from swath.field_io.agopengps import is_agopengps
from swath.field_io.clean import Cleaned, clean, clean_map
from swath.field_io.dem import against_log, read_dem
from swath.field_io.folder import FieldFolder
from swath.field_io.grid import Maps, crop_height, make_grid, make_maps
from swath.field_io.heights import fit_terrain
from swath.field_io.logs.columns import CROP, FLOWS, ColumnsMissing, map_to_fill
from swath.field_io.logs.coordinates import place
from swath.field_io.logs.log import Log, first_loss, read_log
from swath.field_io.logs.parts import one_part
from swath.field_io.passes import Track, make_tracks, pass_spacing, row_azimuth
from swath.field_io.picture import draw
from swath.field_io.plan import is_outline, origin_near, plan_field, read_plan
from swath.field_io.report import ImportReport
from swath.field_io.task_data.isoxml import is_taskdata
from swath.field_io.trade import STEMS
from swath.terminal.progress import steps

Array = NDArray[np.float64]
MARGIN_M = 40.0  # of terrain around the field, for turning
CLIPPED = 0.05, 0.5  # of the cells, with stems outside what the crop can have: noted, refused
BALANCE = 0.25, 1.5  # of more logged than mapped grain: noted, refused; of less: noted
WIDER = 0.03  # of passes farther apart than the header is wide: no crop is left standing between them
OVERLAP = 0.12  # of a header over the distance of its passes: 0.03 in recorded logs, 0.1 without guidance
MACHINES, FEWEST_BESIDE = 0.1, 200  # yields of two machines side by side; records that say something
# of a log without a record left (noted, refused), estimated: shares of its records on the spot of the one
# before, and without flow, without width or behind a pause; by how much the faster of two speeds is faster
FEW_MOVE, IDLE, OTHER_SPEED = (0.5, 0.5), (0.9, 0.9), (0.5, 0.5)
# at harvest, estimated: moisture of the grain, and t/ha of a field, a good year included
MOISTURES = {"maize": (0.1, 0.42), "rape": (0.04, 0.16), "": (0.07, 0.26)}
YIELDS = {
    "wheat": (1, 11), "barley": (1, 9.5), "rye": (1, 9.5), "soy": (0.8, 5.5), "rape": (0.7, 5.5),
    "maize": (2, 16),
}  # fmt: skip
CAUSES = ("sources", "timeline", "plausible", "mixed", "place")  # of numbers that do not agree in the end
FEW_USED = 0.5  # of the records on passes, that are not used


@dataclass(frozen=True)
class Settings:
    """How to import. cell_m, terrain_cell_m: edges of map cells; flow_delay_s: None = estimate per machine.

    header_width_m: for logs that hold none
    crop: data sheet, None = what the log says
    grain_g_per_stem: None = the crop's own
    crop_height_m: for logs that hold none, None = the crop's own
    as_map: stand and yield of records in any order, without passes
    part: of a log with several fields or harvests, counted from 1
    """

    cell_m: float = 5.0
    terrain_cell_m: float = 4.0
    grain_g_per_stem: float | None = None
    crop_height_m: float | None = None
    flow_delay_s: float | None = None
    header_width_m: float | None = None
    crop: str | None = None
    as_map: bool = False
    part: int | None = None

    def check(self) -> None:
        """Raise InputError for a number that cannot be."""
        limits = {
            "cell_m": (0.5, 100.0), "terrain_cell_m": (0.25, 100.0), "grain_g_per_stem": (0.05, 500.0),
            "crop_height_m": (0.05, 5.0), "flow_delay_s": (-60.0, 60.0), "header_width_m": (0.5, 20.0),
        }  # fmt: skip
        for key, (low, high) in limits.items():
            value = getattr(self, key)
            if value is not None:
                check_within(key, value, low, high)


def import_log(
    log: Path,
    out: Path,
    *,
    dem: Path | None = None,
    boundary: Path | None = None,
    columns: Path | None = None,
    settings: Settings | None = None,
    progress: bool = True,
) -> ImportReport:
    """Make a field folder from a yield log.

    log: CSV, CSV.gz, point shapefile (bare, folder, zip), ISOXML folder or zip, or the bundled `sample-log`;
    or an outline, KML or GeoJSON, or a field of AgOpenGPS, on which the crop stands evenly
    dem: GeoTIFF of heights [m]; boundary: GeoJSON, KML or shapefile; columns: YAML map of columns
    Nothing is written unless all went well, but a map to fill in where columns are missing.
    Raises SwathError.
    """
    settings = settings or Settings()
    settings.check()
    log, out = find_log(log), Path(out)
    folder.check_target(out)
    with steps(6, shown=progress) as step:
        step("reading the log")
        if is_outline(log) or is_agopengps(log):
            return _import_plan(log, out, dem, settings)
        try:
            records = _read(log, out, columns, settings)
        except InputError as error:
            lacks_yield = isinstance(error, ColumnsMissing) and next(iter(CROP)) in error.expected
            is_plan = lacks_yield or error.key == "taskdata"
            if not is_plan or not is_taskdata(log) or not read_plan(log).parts:
                raise
            return _import_plan(log, out, dem, settings)
        crop_facts = load_crop(records.crop)
        polygon, notes, within = None, list(records.notes), None
        if boundary is not None:
            polygon, more = outline.read_outlines(boundary, records.epsg).field(records.position)
            notes += more
            within = outline.inside(polygon.buffer(15.0), records.position)
            if within.mean() < 0.05:
                raise InputError(
                    "boundary",
                    f"{percent_of(within.mean())} of the records inside",
                    "expected the field of the log",
                    file=boundary,
                )
        elif not settings.as_map:
            whole, records = records, one_part(records, settings.part, log)
            records.broken["other_part"] = len(whole) - len(records)
        step("aligning flow and cleaning")
        if settings.as_map:
            cleaned = clean_map(records, within)
        else:
            cleaned = clean(records, settings.flow_delay_s, within)
        if cleaned.kept.sum() < 30:
            judge(_of_raw(records), log)
            why = first_loss({**records.broken, **cleaned.counts}, records.row_count)[1]
            expected = f"expected at least 30 harvest records left: {why}"
            raise InputError("lost", int(cleaned.kept.sum()), expected, file=log)
        if polygon is None:
            polygon, more = (outline.mapped_ground if settings.as_map else outline.covered_ground)(cleaned)
            notes += more
        step("terrain")
        terrain, terrain_info = _terrain(cleaned, polygon, dem, settings)
        notes += terrain.notes
        step("maps of the crop")
        grid = make_grid(polygon.bounds, settings.cell_m, MARGIN_M, records.epsg)
        x, y = np.meshgrid(*grid.centres())
        middles = np.stack([x.ravel(), y.ravel()], axis=1)
        touched = polygon.buffer(grid.cell / np.sqrt(2.0))  # the boundary says how much of a cell bears crop
        crop = outline.inside(touched, middles).reshape(x.shape)
        settings = _of_crop(settings, crop_facts)
        assert settings.grain_g_per_stem is not None
        assert settings.crop_height_m is not None
        usual = crop_facts.stand.density
        maps = make_maps(cleaned, grid, crop, settings.grain_g_per_stem / 1000.0, usual)
        height = crop_height(cleaned, grid, maps.stems, settings.crop_height_m)
        step("passes")
        origin = origin_near(polygon, terrain, records.epsg)
        tracks = () if settings.as_map else make_tracks(cleaned, origin)
        spacing = pass_spacing(tracks, row_azimuth(tracks))[0] if tracks else np.nan
        with first_cause(notes):
            notes += _doubts(cleaned, maps, within, polygon, settings, crop_facts, spacing, log)
        report = _report(log, out, cleaned, tracks, maps, polygon, settings, terrain_info, tuple(notes))
        exterior, holes = outline.rings(polygon)
        corner = np.array([origin.easting, origin.northing])
        local = {k: r.shifted(*(-corner)) for k, r in _rasters(maps, height, terrain, origin).items()}
        info = {**report.to_dict(), "settings": vars(settings), "yield_histogram": _histogram(cleaned)}
        field = FieldFolder(
            path=out, origin=origin, boundary=exterior - corner, holes=tuple(h - corner for h in holes),
            row_azimuth=float(np.radians(report.field["row_azimuth_deg"])), tracks=tracks, obstacles=(),
            info=json_safe(info, 6), **local,
        )  # fmt: skip
        step("writing and drawing")
        folder.write(field, draw)
    return report


@contextmanager
def first_cause(notes: Sequence[str]) -> Iterator[None]:
    """A refusal of the result has the key of what the log was doubted for before, where there is that."""
    try:
        yield
    except InputError as error:
        cause = next((note for note in notes if key_of(note) in CAUSES), "")
        if not cause:
            raise
        key, _, text = cause.partition(": ")
        so = f"and so {error.key} = {error.value}: {error.expected}"
        raise InputError(key, None, f"{text}; {so}", file=error.file) from error


def find_log(log: Path) -> Path:
    """A log as given, or the bundled one of that name where there is no such file."""
    bundled = Path(str(files("swath.data") / "logs" / f"{Path(log).name}.csv.gz"))
    return bundled if os.path.isfile(bundled) and not os.path.exists(Path(log)) else Path(log)


def _read(log: Path, out: Path, columns: Path | None, settings: Settings) -> Log:
    with map_to_fill(log, None if is_taskdata(log) else out, columns):
        return read_log(
            log, columns, header_width=settings.header_width_m, crop=settings.crop, as_map=settings.as_map
        )


def _import_plan(path: Path, out: Path, dem: Path | None, settings: Settings) -> ImportReport:
    """A field folder of task data without a yield, or of an outline."""

    def terrain(polygon: Any, epsg: int) -> tuple[Raster, dict[str, Any]]:
        return _ground(make_grid(polygon.bounds, settings.terrain_cell_m, MARGIN_M, epsg), dem)

    field = plan_field(
        path, out, crop=settings.crop, width=settings.header_width_m, cell=settings.cell_m, load=load_crop,
        terrain=terrain,
    )  # fmt: skip
    field.info.update(json_safe(field.info, 6))
    folder.write(field, draw)
    about = field.info
    return ImportReport(
        out, about["source"], {}, [], {}, 0, about["field"], about["crop"], about["terrain"],
        tuple(about["notes"]),
    )  # fmt: skip


def _of_crop(settings: Settings, crop: Crop) -> Settings:
    """Settings with the crop's own numbers where nothing is given."""
    if crop.yields.grain_mass <= 0.0:
        raise InputError("crop", crop.name, "expected a crop with grain")
    grain, height = 1000.0 * crop.yields.grain_mass, crop.stand.height
    return replace(
        settings,
        grain_g_per_stem=round(grain, 6) if settings.grain_g_per_stem is None else settings.grain_g_per_stem,
        crop_height_m=round(height, 6) if settings.crop_height_m is None else settings.crop_height_m,
    )


def _sheet_name(crop: str, out: Path) -> str:
    """A bundled sheet by its name, a file as seen from the field folder."""
    return os.path.relpath(crop, out) if Path(crop).suffix else crop


def show(path: Path) -> Path:
    """Draw the overview of a field folder anew; returns the PNG. Raises InputError when it is none."""
    field = folder.read(path)
    picture = Path(path) / folder.PICTURE
    draw(field, picture)
    return picture


def _rasters(maps: Maps, height: Raster, terrain: Raster, origin: Origin) -> dict[str, Raster]:
    above = Raster(
        terrain.values - np.float32(origin.height), terrain.x0, terrain.y0, terrain.cell, terrain.epsg
    )
    return {
        "terrain": above,
        "stems": maps.stems,
        "height": height,
        "moisture": maps.moisture,
        "grain": maps.grain,
    }


def _terrain(
    cleaned: Cleaned, polygon: Any, dem: Path | None, settings: Settings
) -> tuple[Raster, dict[str, Any]]:
    grid = make_grid(polygon.bounds, settings.terrain_cell_m, MARGIN_M, cleaned.log.epsg)
    fit = None if dem is not None else fit_terrain(cleaned, grid)
    if fit is None:
        raster, info = _ground(grid, dem)
        if dem is not None:
            return against_log(raster, cleaned.log, dem), info
        of_passes = np.isfinite(cleaned.log.elevation[cleaned.pass_id >= 0])
        if of_passes.any():
            info["source"] = f"flat: {num(of_passes.sum())} of {num(len(of_passes))} records have a height"
        return raster, info
    used = bool(np.any(fit.offset != 0.0))
    return fit.raster, {
        "source": "heights of the log" + (", drift between passes removed" if used else ""),
        **_relief(fit.raster),
        "outliers": fit.outlier_count,
        "records_without_height": fit.missing_count,
        "pass_offset_sd_m": float(np.std(fit.offset)),
        "pass_step_sd_m": fit.step_after,
        "pass_step_sd_before_m": fit.step_before,
        "share_far_from_records": fit.far_share,
    }


def _ground(grid: Raster, dem: Path | None) -> tuple[Raster, dict[str, Any]]:
    """Terrain of a DEM, flat without one."""
    if dem is not None:
        raster, known = read_dem(dem, grid)
        return raster, {"source": f"DEM {dem.name}", "known_share": known, **_relief(raster)}
    flat = Raster(np.zeros(grid.values.shape, np.float32), grid.x0, grid.y0, grid.cell, grid.epsg)
    return flat, {"source": "flat: there are no heights", "relief_m": 0.0}


def _relief(raster: Raster) -> dict[str, float]:
    low, high = float(np.nanmin(raster.values)), float(np.nanmax(raster.values))
    return {"relief_m": high - low, "lowest_m": low, "highest_m": high}


def _report(
    path: Path,
    out: Path,
    cleaned: Cleaned,
    tracks: tuple[Track, ...],
    maps: Maps,
    polygon: Any,
    settings: Settings,
    terrain: dict[str, Any],
    notes: tuple[str, ...],
) -> ImportReport:
    log = cleaned.log
    azimuth = row_azimuth(tracks) if tracks else outline.long_axis(polygon)
    spacing, spread, count = pass_spacing(tracks, azimuth)
    grain = cleaned.grain[cleaned.kept] * 10.0
    map_kg = _mapped_kg(maps, polygon)
    logged_kg = float((log.flow * log.duration)[log.working].sum())
    field = {
        "place": _place(polygon, log.epsg),
        "area_ha": polygon.area / 1e4,
        "passes": len(tracks),
        "pass_length_m": sum(t.length for t in tracks),
        "pass_spacing_m": spacing if count else None,
        "pass_spacing_sd_m": spread if count else None,
        "straight_windows": sum(len(t.straights) for t in tracks),
        "lateral_sd_m": _median([w.lateral_sd for t in tracks for w in t.straights]),
        "row_azimuth_deg": float(np.degrees(azimuth)),
    }
    crop = {
        "name": _sheet_name(log.crop, out),
        "yield_t_ha": float(grain.mean()),
        "yield_p10_t_ha": float(np.percentile(grain, 10)),
        "yield_p90_t_ha": float(np.percentile(grain, 90)),
        "grain_logged_kg": logged_kg,
        "grain_on_map_kg": map_kg,
        "stems_per_m2": float(np.nanmean(maps.stems.values)),
        "grain_g_per_stem": settings.grain_g_per_stem,
        "stems_clipped_cells": maps.clipped_count,
        "filled_cells": maps.filled_count,
        "cells": int(np.isfinite(maps.grain.values).sum()),
    }
    rows = {"read": log.row_count, "broken": log.broken, "records": len(log)}
    if log.stated is not None:
        rows["stated"] = log.stated
    left = log.row_count - sum(log.broken.values()) - sum(cleaned.counts.values()) - int(cleaned.kept.sum())
    if left:
        notes = (
            *notes,
            f"lost: {num(left)} of {num(log.row_count)} rows are not used, without a reason",
        )
    digest = _digest(path)
    profile = log.column_map.profile
    source = {"file": path.name, "sha256": digest, "profile": profile, **log.column_map.summary()}
    return ImportReport(
        out, source, rows, _machines(cleaned, tracks), cleaned.counts, int(cleaned.kept.sum()), field, crop,
        terrain, notes,
    )  # fmt: skip


def _place(polygon: Any, epsg: int) -> str:
    """Where a field is, in words. polygon [m]."""
    return place(transform([polygon.centroid.coords[0]], f"EPSG:{epsg}", "EPSG:4326"))


def _mapped_kg(maps: Maps, polygon: Any) -> float:
    """Grain on the map [kg]: its cells in the mean on the area of the field."""
    known = maps.grain.values[np.isfinite(maps.grain.values)]
    return float(known.mean(dtype=float)) * polygon.area if len(known) else 0.0


def _doubts(
    cleaned: Cleaned,
    maps: Maps,
    within: Any,
    polygon: Any,
    settings: Settings,
    crop: Crop,
    spacing: float,
    path: Path,
) -> list[str]:
    """What the result itself contradicts. Raises InputError where it cannot be."""
    log, kept = cleaned.log, int(cleaned.kept.sum())
    yields = float(np.mean(cleaned.grain[cleaned.kept])) * 10.0
    key = next(k for k in FLOWS[:2] if k in log.column_map.columns)
    column = log.column_map.columns[key]
    cells = int(np.isfinite(maps.grain.values).sum())
    assert settings.grain_g_per_stem is not None
    low, high = (s * crop.stand.density * settings.grain_g_per_stem / 100.0 for s in STEMS)
    shown = f"{num(yields)} t/ha in the mean, by {column.column} in {column.unit}"
    text = (
        f"{shown}; {maps.clipped_count} of {cells} cells lie outside {num(low)} to {num(high)} of {crop.name}"
    )
    unit = "say the unit with --columns, or --grain-g-per-stem"
    pairs = [Pair("yield", f"{text}, clipped", maps.clipped_count / max(cells, 1), *CLIPPED, unit)]
    if usual := YIELDS.get(crop.name):
        text = f"{shown}, usual of {crop.name} are {usual[0]} to {usual[1]}"
        entry = "another unit (--columns), or another crop (--crop)?"
        pairs.append(Pair("yield", text, outside(yields, usual), 0.0, entry=entry))
    if settings.as_map:
        return judge(pairs, path)
    told = [f"delay: {d.machine}: {d.doubt}" for d in cleaned.delays if d.doubt]
    own = np.ones(len(log), bool) if within is None else outline.inside(polygon, log.position)
    logged, mapped = float((log.flow * log.duration)[own & log.working].sum()), _mapped_kg(maps, polygon)
    text = f"{num(logged / 1000)} t logged, {num(mapped / 1000)} t on the map of {num(polygon.area / 1e4)} ha"
    over = logged / mapped - 1.0 if mapped > 0.0 else np.inf  # less is grain of rows that are left out
    less = ratio(_arrived_kg(cleaned, own), mapped) if over < 0.0 else 0.0
    flag = f"{shown}; say the units of width, speed and yield with --columns"
    reason, count = max(cleaned.counts.items(), key=lambda item: item[1])
    text_used = f"{num(kept)} of {num(len(log))} are used: {num(count)} {reason.replace('_', ' ')}"
    pairs += [Pair("yield", text, over, *BALANCE, flag), Pair("yield", text, less, BALANCE[0]),
              Pair("lost", text_used, 1.0 - kept / max(int(cleaned.driven.sum()), 1), FEW_USED)]  # fmt: skip
    return [*told, *judge([*pairs, *_beside(cleaned, spacing, crop)], path)]


def _arrived_kg(cleaned: Cleaned, own: NDArray[np.bool_]) -> float:
    """Grain of all that was cut [kg], by the flow where it is known: some of a late flow may not be."""
    log, cut = cleaned.log, own & cleaned.cutting
    known = cut & np.isfinite(cleaned.flow)
    ground = log.speed * log.width * log.duration
    share = float(ground[known].sum()) / max(float(ground[cut].sum()), 1e-9)
    return float((cleaned.flow * log.duration)[known].sum()) / max(share, 1e-9)


def _of_raw(log: Log) -> list[Pair]:
    """What the records say twice before any of them is judged: of these the cause is where none is left."""
    on_spot = log.broken.get("duplicated_position", 0) / max(log.row_count, 1)
    goes_on = ~log.gap[1:] & (np.diff(log.time) > 0.0)
    driven = np.hypot(*np.diff(log.position, axis=0)[goes_on].T)
    pace = float(driven.sum() / np.diff(log.time)[goes_on].sum()) if goes_on.any() else np.nan
    shown = float(np.mean(log.speed[1:][goes_on])) if goes_on.any() else np.nan
    idle = [float((values <= 0.0).mean()) for values in (np.where(log.working, log.flow, 0.0), log.width)]
    far = f"the others are {num(np.median(driven))} m apart" if len(driven) else "the others are far apart"
    speeds = f"{num(3.6 * shown)} km/h logged, {num(3.6 * pace)} km/h by positions and times"
    of_log, units = "of the records", "say the units with --columns"
    return [
        Pair("place", f"{percent_of(on_spot)} of the rows lie on the very spot of the one before, {far}",
             on_spot, *FEW_MOVE, "positions with more digits, or a machine that drives"),
        Pair("timeline", speeds, ratio(shown, pace), *OTHER_SPEED, units),
        Pair("lost", f"flow of 0 in {percent_of(idle[0])} {of_log}, work states counted", idle[0], *IDLE,
             units),
        Pair("width", f"0 in {percent_of(idle[1])} {of_log}", idle[1], *IDLE, units),
        Pair("timeline", f"{percent_of(log.gap.mean())} {of_log} come after a pause", float(log.gap.mean()),
             *IDLE, "records of a machine at most 5 s apart, in one order"),
    ]  # fmt: skip


def _beside(cleaned: Cleaned, spacing: float, crop: Crop) -> list[Pair]:
    """What the log says twice: by widths and passes, by machines side by side, by moisture and crop."""
    from scipy.spatial import cKDTree

    log, kept = cleaned.log, np.flatnonzero(cleaned.kept)
    width, moist = float(np.median(log.width[kept])), log.moisture[kept]
    text = f"passes lie {num(spacing)} m apart, the header is {num(width)} m wide"
    entry = "the yield goes with the width: header_width in --columns, or --header-width-m"
    pairs = [Pair("width", text, spacing / width - 1.0, WIDER, entry=entry),
             Pair("width", text, width / spacing - 1.0, OVERLAP, entry=entry)]  # fmt: skip
    low, high = MOISTURES.get(crop.name, MOISTURES[""])
    middle = float(np.median(moist[np.isfinite(moist)])) if np.isfinite(moist).any() else np.nan
    text = f"{percent_of(middle)} in the middle, usual of {crop.name} are {span([100 * low, 100 * high])} %"
    pairs.append(
        Pair("moisture", text, max(low - middle, middle - high), 0.0, entry="another crop (--crop)?")
    )
    distance, near = cKDTree(log.position[kept]).query(log.position[kept], k=min(12, len(kept)))
    for a, b in combinations(range(len(log.machine_names)), 2):
        beside = (log.machine[kept][:, None] == a) & (log.machine[kept][near] == b) & (distance < 1.5 * width)
        i, j = np.nonzero(beside)
        if len(i) < FEWEST_BESIDE:
            continue
        over = float(np.median(cleaned.grain[kept[near[i, j]]] / cleaned.grain[kept[i]]))
        one, other = (log.machine_names[k][:30] for k in (a, b))
        text = f"{other} shows {percent_of(over)} of the yield of {one}"
        pairs.append(
            Pair(
                "calibration", f"{text} beside it", ratio(over, 1.0), MACHINES, entry="is one not calibrated?"
            )
        )
    return pairs


def _digest(path: Path) -> str:
    """SHA-256 of the log, of a folder of all its files in the order of their names."""
    made = hashlib.sha256()
    for part in sorted(p for p in path.iterdir() if os.path.isfile(p)) if os.path.isdir(path) else [path]:
        with open_to_read(part, "log", "a yield log") as stream:
            while block := stream.read(1 << 20):
                made.update(block)
    return made.hexdigest()


def _machines(cleaned: Cleaned, tracks: tuple[Track, ...]) -> list[dict[str, Any]]:
    log, rows = cleaned.log, []
    for index, (name, delay) in enumerate(zip(log.machine_names, cleaned.delays, strict=True)):
        own = cleaned.log.machine == index
        kept = own & cleaned.kept
        rows.append(
            {
                "name": name,
                "records": int(own.sum()),
                "kept": int(kept.sum()),
                "passes": sum(t.machine == name for t in tracks),
                "header_width_m": _median(log.width[kept].tolist()),
                "speed_kmh": _median((3.6 * log.speed[kept]).tolist()),
                "grain_flow_kg_s": _median(cleaned.flow[kept].tolist()),
                "flow_delay_s": delay.seconds,
                "flow_delay_method": delay.method,
                "flow_delay_agreement": delay.agreement,
                "flow_delay_pairs": delay.pair_count,
                "flow_delay_error_s": delay.error,
            }
        )
    return rows


def _median(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None


def _histogram(cleaned: Cleaned) -> dict[str, Any]:
    """Records per yield class, kept and removed; yields above the last class count in it."""
    grain, kept = cleaned.grain * 10.0, cleaned.kept
    top = float(np.ceil(1.5 * np.percentile(grain[kept], 99)))
    edges = np.linspace(0.0, max(top, 1.0), 41)
    known = np.isfinite(grain)
    count = {
        name: np.histogram(np.minimum(grain[m & known], edges[-1]), edges)[0]
        for name, m in (("kept", kept), ("removed", ~kept))
    }
    return {"top_t_ha": float(edges[-1]), **{k: v.tolist() for k, v in count.items()}}
