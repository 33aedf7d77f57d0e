"""A band of a GeoTIFF as SI numbers: scale, offset, unit and nodata applied, and doubts named."""

import os
import re
from dataclasses import dataclass
from math import atan2, cos, sin
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.units import PERCENT, factors
from swath.documents.text_file import read_bytes
from swath.documents.witness import Witness, ask
from swath.documents.xml_file import read_xml

Array = NDArray[np.float32]
SURVEY_FOOT = 1200 / 3937  # m, exact (NIST SP 447)
LENGTHS = factors("length") | {"dm": 0.1, "us-ft": SURVEY_FOOT}
SPELLINGS = {
    "metre": "m", "meter": "m", "metres": "m", "meters": "m", "foot": "ft", "feet": "ft",
    "international foot": "ft", "us survey foot": "us-ft", "us survey feet": "us-ft",
    "survey foot": "us-ft", "ftus": "us-ft", "us_survey_foot": "us-ft", "foot_us": "us-ft", "us_ft": "us-ft",
    "centimetre": "cm", "centimeter": "cm", "millimetre": "mm", "millimeter": "mm", "decimetre": "dm",
    "percent": "%", "fraction": "1", "share": "1",
}  # fmt: skip
HOLE_STEP, HOLE_STEPS = 2.0, 20.0  # m and usual steps: an extreme height farther from all around is no height
LEAST_HOLE = 10  # cells of the same number, where it could be a height
PROBED = 100_000  # pairs of cells that a step is measured on
CLIFF_STEP, CLIFF_SLOPE = 100.0, 3.0  # m from cell to cell, and over a cell: no ground
SMOOTHED = 10.0  # m, over which a slope is measured: crop, trees and noise are no slope
STEPS = 0.002  # share of steps over 45 degrees and HOLE_STEP: more than ditches and walls make
ACROSS, BROAD, STRAY, USUAL = 0.8, 2.0, 0.1, 10.0
"""Of a seam: share of the map, half its breadth in cells, share of steps to the other side, usual steps."""
STEEP, STEEPEST = 0.2, 1.0  # slope of half the map: more than combines harvest; more than ground has


@dataclass(frozen=True)
class Quantity:
    """What the numbers of a map are. units: that a file may state -> factor to SI; lowest, highest [SI].

    is_ground: heights of ground, whose steps and slopes are looked at
    stated: the factor, where the user says it: what the file states must not contradict it, and the limits
        are the user's affair
    called: pattern of what a band of it among others is called, lower case, '' = it is the first
    """

    name: str
    units: dict[str, float] | None = None
    lowest: float = -np.inf
    highest: float = np.inf
    is_ground: bool = False
    stated: float | None = None
    called: str = ""


PLAIN = Quantity("numbers")
GROUND = Quantity(
    "heights of the ground", LENGTHS, -500.0, 9000.0, is_ground=True,
    called=r"elev|height|altitude|terrain|ground|h(ö|oe)he|\b(dem|dtm|dsm|dgm|z)\b",
)  # fmt: skip
CROP_HEIGHT = Quantity("heights of the crop", LENGTHS, 0.0, 6.0)
STEMS = Quantity("stems per m2", factors("per area"), 0.0, 1e4)
MOISTURE = Quantity("moisture", factors("ratio") | {"%": PERCENT, "1": 1.0}, 0.0, 1.0)
GRAIN = Quantity("yield", factors("mass per area"), 0.0, 10.0)


@dataclass(frozen=True)
class Band:
    """values: SI, first row north, nan = unknown; notes: what was assumed or left out."""

    values: Array
    notes: tuple[str, ...] = ()


def read_band(
    dataset: Any,
    path: Path,
    quantity: Quantity = PLAIN,
    *,
    band: int | None = None,
    window: Any = None,
    shape: Any = None,
) -> Band:
    """The numbers of a band of an open dataset, or of a window of it, by means in `shape` (rows, columns).

    band: counted from 1; None: the one that is called so, of several
    An extreme height that stands off from all around it is a nodata value that the file does not declare: it
    becomes nan, with a note. Raises InputError for an unknown unit, and for numbers that cannot be meant.
    """
    from rasterio.enums import Resampling

    notes = list[str]()
    if band is None:
        band, notes = _band_of(dataset, quantity, path)
    if dataset.count < band:
        raise InputError("raster", dataset.count, f"expected {band} bands or more", file=path)
    if np.dtype(dataset.dtypes[band - 1]).kind == "c":
        raise InputError("raster", dataset.dtypes[band - 1], "expected real numbers", file=path)
    raw = dataset.read(band, masked=True, window=window, out_shape=shape, resampling=Resampling.average)
    mask, raw = np.ma.getmaskarray(raw), np.ma.getdata(raw)
    scale, offset = float(dataset.scales[band - 1]), float(dataset.offsets[band - 1])
    beside = _beside(path, band)
    if beside:
        said = ", ".join(f"{name} {text[:20]}" for name, text in beside.items())
        notes.append(f"form: {path.name}.aux.xml beside it says {said}")
        if (scale, offset) == (1.0, 0.0):
            scale, offset = (_number(beside.get(k), v, path) for k, v in (("Scale", 1.0), ("Offset", 0.0)))
        if dataset.nodatavals[band - 1] is None and "NoDataValue" in beside:
            mask |= raw == _number(beside["NoDataValue"], 0.0, path)
    if not (np.isfinite([scale, offset]).all() and scale != 0.0):
        raise InputError(
            "raster.scale", (scale, offset), "expected finite numbers, a scale of 0 none", file=path
        )
    unit = dataset.units[band - 1] or beside.get("UnitType")
    factor, more = _factor(dataset, unit, quantity, path)
    notes += more
    with np.errstate(all="ignore"):  # numbers beyond float32 become infinite, and unknown
        if (scale, offset, factor) == (1.0, 0.0, 1.0):
            values = raw.astype(np.float32)
        else:
            values = ((raw * np.float64(scale) + offset) * factor).astype(np.float32)
    values[mask | ~np.isfinite(values)] = np.nan
    if quantity.is_ground:
        notes += _without_holes(values, quantity, factor)
    _check_limits(values, quantity, path)
    return Band(values, tuple(notes))


def _band_of(dataset: Any, quantity: Quantity, path: Path) -> tuple[int, list[str]]:
    """The band of a quantity, and a note where others lie beside it."""
    from rasterio.enums import ColorInterp

    kinds = zip(range(1, dataset.count + 1), dataset.descriptions, dataset.colorinterp, strict=True)
    names = {n: text or "" for n, text, kind in kinds if kind != ColorInterp.alpha}
    if len(names) < 2 or not quantity.called:
        return 1, []
    listed = ", ".join(f"{n} {text[:30]!r}" if text else f"{n}" for n, text in names.items())
    found = [n for n, text in names.items() if re.search(quantity.called, text.lower())]
    if len(found) != 1:
        expected = f"expected one of {quantity.name}; there are {listed}: `gdal_translate -b N` writes one"
        raise InputError("raster.band", None, expected, file=path)
    return found[0], [f"form: {path.name}: band {found[0]} of {listed} is taken"]


def horizontal(crs: Any) -> Any:
    """The horizontal part of a system (rasterio's), as pyproj has it."""
    return _parts(crs)[0]


def _same(value: float) -> tuple[float, ...]:
    return abs(value), value


GROUND_WITNESSES = (
    Witness(("seam",), _same, "a step of {:.4g} m along a line through all of it",
            "do its tiles differ in height?", HOLE_STEP, CLIFF_STEP, "heights", "expected ground"),
    Witness(("step", "cell"), lambda step, cell: (step / max(CLIFF_STEP, CLIFF_SLOPE * cell), step),
            "a cell {:.0f} m above the next", "is its nodata value declared?", 1.0, 1.0, "heights",
            "expected ground"),
    Witness(("slope",), _same, "half of it is steeper than {:.0%}", "is its unit or scale missing, or not m?",
            STEEP, STEEPEST, "plausible", "expected ground"),
    Witness(("steep", "cell"), lambda share, cell: (share, share, max(HOLE_STEP, cell)),
            "{:.1%} of it steps by more than {:g} m in a cell",
            "is it a surface model, with trees and roofs?", STEPS, key="heights"),
)  # fmt: skip


def check_ground(values: Array, cell: float, path: Path) -> tuple[str, ...]:
    """Notes of what is hardly ground. values: heights [m] in cells of `cell` [m].

    Raises InputError for cliffs, and where half of it is too steep for ground.
    """
    steps = [np.diff(values, axis=axis) for axis in (0, 1)]
    known = sum(step.size - int(np.isnan(step).sum()) for step in steps)
    steep = sum(int((np.abs(step) > max(HOLE_STEP, cell)).sum()) for step in steps)
    seam = _seam(values, steps)
    measures = {
        "seam": seam,
        "cell": cell,
        "step": max(float(np.nanmax(np.abs(s), initial=0.0, where=np.isfinite(s))) for s in steps),
        "slope": _median_slope(values, cell),
        "steep": 0.0 if seam else steep / max(known, 1),
    }
    return tuple(ask(GROUND_WITNESSES, measures, path))


def _seam(values: Array, steps: list[Array]) -> float:
    """How far heights differ on both sides of a line of steps through the map [m], 0 without such a line."""
    places, usual = [], _usual_step(values)
    for axis, step in enumerate(steps):
        high = np.abs(step) > max(0.5 * HOLE_STEP, USUAL * usual)
        rises = step[high] > 0.0
        if STRAY * rises.size < rises.sum() < (1.0 - STRAY) * rises.size:
            return 0.0  # up and down again: trees, walls
        places.append(np.argwhere(high) + (0.5, 0.0)[:: 1 - 2 * axis])
    at = np.concatenate(places)
    if len(at) < ACROSS * min(values.shape):
        return 0.0
    middle = np.median(at, axis=0)
    y, x = (at - middle).T
    turned = 0.5 * atan2(2.0 * float((y * x).sum()), float((y * y).sum() - (x * x).sum()))
    along = np.array([[cos(turned), sin(turned)], [-sin(turned), cos(turned)]])
    way, off = y * along[:, :1] + x * along[:, 1:]
    passed = np.unique(way.astype(int))
    if len(passed) < ACROSS * min(values.shape) or np.median(np.abs(off)) > BROAD:
        return 0.0
    rows, columns = np.ogrid[: values.shape[0], : values.shape[1]]
    beside = (rows - middle[0]) * along[1, 0] + (columns - middle[1]) * along[1, 1]
    near = (np.abs(beside) > 2.0 * BROAD) & (np.abs(beside) < 4.0 * BROAD)
    sides = [np.nanmedian(values[near & (beside > 0.0)]), np.nanmedian(values[near & (beside < 0.0)])]
    return float(sides[0] - sides[1])


def _median_slope(values: Array, cell: float) -> float:
    """Median slope between means of squares of SMOOTHED; 0 where the map is smaller than a few of them."""
    n = max(1, round(SMOOTHED / cell))
    ny, nx = (size // n for size in values.shape)
    if min(ny, nx) < 3:
        return 0.0
    squares = values[: ny * n, : nx * n].reshape(ny, n, nx, n)
    mean = squares.mean(axis=(1, 3), dtype=np.float64)
    north, east = mean[1:, 1:] - mean[:-1, 1:], mean[1:, 1:] - mean[1:, :-1]
    slope = np.hypot(north, east) / (n * cell)
    return float(np.nanmedian(slope)) if np.isfinite(slope).any() else 0.0


def _parts(crs: Any) -> tuple[Any, str, float]:
    """Horizontal system, unit of heights ('' where none is said), and 1 over the ellipsoid, else 0."""
    from swath.field.maps.projection import known_crs

    whole = known_crs(crs.to_wkt())
    if whole.is_compound:
        flat, up = whole.sub_crs_list[:2]
        return flat, _unit(up.axis_info[0].unit_name), 0.0
    if len(whole.axis_info) == 3:
        return whole.to_2d(), _unit(whole.axis_info[2].unit_name), 1.0
    return whole, "", 0.0


def _unit(text: str | None) -> str:
    """A unit as `core.units` spells it: `Feet`, `US survey foot`, `plants/m²`."""
    plain = " ".join((text or "").strip().lower().replace("²", "2").replace("^2", "2").split())
    plain = re.sub(
        r"^(?:plants|stems|ears|pcs|n)\s*(?:/|per)\s*(m2|ha)$|^m-2$", lambda m: f"1/{m[1] or 'm2'}", plain
    )
    return SPELLINGS.get(plain, plain)


def _number(text: str | None, default: float, path: Path) -> float:
    try:
        return default if text is None else float(text)
    except ValueError as error:
        raise InputError("raster", text, "expected a number", file=f"{path}.aux.xml") from error


def _factor(dataset: Any, unit: str | None, quantity: Quantity, path: Path) -> tuple[float, list[str]]:
    """To SI, by the unit of the band, else of the vertical system, else of the places; what was assumed."""
    if quantity.units is None:
        return 1.0, []
    said, notes = _unit(unit), list[str]()
    if quantity.is_ground and dataset.crs is not None:
        flat, vertical, is_ellipsoidal = _parts(dataset.crs)
        across = _unit(flat.axis_info[0].unit_name) if flat.is_projected else ""
        if is_ellipsoidal:
            notes.append(f"reference: {path.name} is over the ellipsoid, not over the sea")
        if said and vertical and LENGTHS.get(said) != LENGTHS.get(vertical):
            notes.append(
                f"sources: {path.name} has two units of height: {said} of the band is taken, not {vertical}"
            )
        said = said or vertical
        if not said and across in LENGTHS and LENGTHS[across] != 1.0:
            said = across
            notes.append(
                f"unit: {path.name} states no unit of height: taken as {across}, as its places are; else "
                "write it into the file, gdal_edit.py -units m"
            )
    if quantity.stated is not None:
        if quantity.units.get(said, quantity.stated) != quantity.stated:
            expected = f"expected the unit that is stated: {quantity.stated:g} of the SI unit, not {said}"
            raise InputError("raster.unit", said, expected, file=path)
        return quantity.stated, []
    if said and said not in quantity.units:
        expected = f"expected {quantity.name} in one of {', '.join(filter(None, quantity.units))}"
        raise InputError("raster.unit", said, expected, file=path)
    factor = quantity.units[said] if said else 1.0
    if quantity.is_ground and not said:
        notes.append(f"unit: {path.name} states no unit of height: taken as m")
    if factor != 1.0 and not notes:
        notes.append(f"unit: {path.name} is in {said}")
    return factor, notes


def _without_holes(values: Array, quantity: Quantity, factor: float) -> list[str]:
    """Set extreme heights that stand off from all around to nan, in place; a note about each."""
    notes: list[str] = []
    usual = _usual_step(values)
    for _ in range(8):
        known = np.isfinite(values)
        if not known.any():
            break
        for extreme in (values[known].min(), values[known].max()):
            hole = values == extreme
            beyond = not quantity.lowest <= extreme <= quantity.highest
            if hole.all() or (known & ~hole).sum() < max(3, 0.02 * known.sum()):
                continue
            step = _step_around(values, hole)
            if hole.sum() < LEAST_HOLE and not beyond and step < CLIFF_STEP:
                continue  # a tree, a roof, a ditch
            if (beyond and step > HOLE_STEP) or step > max(HOLE_STEP, HOLE_STEPS * usual):
                values[hole] = np.nan
                notes.append(
                    f"heights: {int(hole.sum())} cells of {extreme / factor:g} stand {step:.4g} m off from "
                    "all around them: taken as unknown"
                )
                break
        else:
            break
    return notes


def _usual_step(values: Array) -> float:
    """Median of the steps from cell to cell [m], of rows and columns spread over the map."""
    ny, nx = values.shape
    rows = values[:: max(1, ny * nx // PROBED)]
    columns = values[:, :: max(1, ny * nx // PROBED)]
    steps = np.abs(np.concatenate([np.diff(rows, axis=1).ravel(), np.diff(columns, axis=0).ravel()]))
    steps = steps[np.isfinite(steps)]
    return float(np.median(steps)) if len(steps) else 0.0


def _step_around(values: Array, hole: NDArray[np.bool_]) -> float:
    """Smallest tenth of the steps [m] from a hole to the known cells beside it; infinite where none is."""
    found = []
    for axis in (0, 1):
        first, second = (np.moveaxis(a, axis, 0) for a in (hole, values))
        row, column = np.nonzero(first[1:] != first[:-1])
        every = max(1, len(row) // PROBED)
        row, column = row[::every], column[::every]
        found.append(np.abs(second[row + 1, column] - second[row, column]))
    steps = np.concatenate(found)
    steps = steps[np.isfinite(steps)]
    return float(np.percentile(steps, 10)) if len(steps) else np.inf


def _check_limits(values: Array, quantity: Quantity, path: Path) -> None:
    known = np.isfinite(values)
    if quantity.stated is not None or not known.any():
        return
    low, high = float(values[known].min()), float(values[known].max())
    if low < quantity.lowest or high > quantity.highest:
        expected = f"expected {quantity.name} of {quantity.lowest:g} to {quantity.highest:g}"
        expected += ": is its unit, scale or nodata missing?"
        raise InputError("plausible", f"{low:g} to {high:g}", expected, file=path)


def _beside(path: Path, band: int) -> dict[str, str]:
    """What GDAL and QGIS keep about a band in a file beside it (PAM): no more of it than these are read."""
    file = path.with_name(path.name + ".aux.xml")
    if not os.path.isfile(file):
        return {}
    try:
        root = read_xml(read_bytes(file, "raster", "a PAM dataset", 1 << 20))
    except ValueError as error:
        raise InputError("raster", None, f"expected a PAM dataset: {error}", file=file) from error
    own = next((n for n in root.iterfind("PAMRasterBand") if n.get("band") == str(band)), None)
    known = ("Scale", "Offset", "UnitType", "NoDataValue")
    return {} if own is None else {n.tag: (n.text or "").strip() for n in own if n.tag in known}
