"""Yield logs composed of independent axes, each with its truth and the outcome that is expected of it.

`draw(seed)` picks a value on every axis: of the harvest, of the columns, of the file, and in two thirds of
the draws one to three unusual traits. Values of HELD_OUT are not drawn without `held_out=True`.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.readers.harvests import CROPS, TABLES, Axes, harvest, in_parts
from tests.readers.log_columns import columns
from tests.readers.log_files import WRITERS
from tests.readers.log_traits import TRAITS, Job, make_unusual
from tests.readers.verdict import Drawn, Got, Truth

HELD_OUT: dict[str, set[Any]] = {
    "format": {"geojson", "csv, packed"},
    "separator": {"tab"},
    "encoding": {"utf-16"},
    "names": {"German"},
    "clock": {"12 hours", "ms since 1970"},
    "rate": {5.0},
    "place": {"S W", "zone border"},
    "coordinates": {"UTM, south"},
    "crop": {"rye", "soy"},
    "crop said": {"its name in German"},
    "unit of width": {"cm"},
    "unit of speed": {"kn"},
    "unit of flow": {"t/h"},
    "unit of yield": {"dt/ha"},
    "unit of dry_yield": {"dt/ha"},
    "unit of distance": {"in"},
    "grain": {"yield, dry beside"},
    "turns": {"logged, flow held"},
    "work state": {"On/Off", "width 0"},
    "sections": {4},
    "unusual": {
        "width twice, alike", "north first", "clock set back", "stamps since the last row", "SNA in words",
        "channels invalid in part", "a machine not calibrated", "4 decimals", "speed dead", "table shorter",
        "DBC in UTF-8", "a second receiver", "log written twice",
    },
}  # fmt: skip
"""Axis -> values that are kept for the judge: a quarter of each kind."""


def draw(seed: int, held_out: bool = False) -> Drawn:
    """A log. held_out: at least one value that is kept for the judge."""
    for attempt in range(100):
        rng = np.random.default_rng([seed, attempt, held_out])
        drawn = _draw(seed, Axes(rng, {} if held_out else HELD_OUT))
        if not held_out or is_held_out(drawn):
            return drawn
    raise AssertionError(seed)


def is_held_out(drawn: Drawn) -> bool:
    """Whether a log has a value that is kept for the judge."""
    kept = {f"{axis}={value}" for axis, values in HELD_OUT.items() for value in values}
    return bool(kept & {*drawn.usual, *(f"unusual={name}" for name in drawn.unusual)})


def _draw(seed: int, axes: Axes) -> Drawn:
    form = axes.pick("format", ["csv", "csv, packed", "shapefile", "geojson", "isoxml", "mf4", "asc", "blf"],
                     [6, 1, 3, 1.5, 2, 2, 1.5, 1])  # fmt: skip
    axes.chosen["format"] = form.partition(",")[0]
    crop = axes.pick("crop", list(CROPS), [4, 1, 2, 1, 1, 1])
    axes.chosen["moisture"] = axes.within(*CROPS[crop][2]) / 100
    records, truth = harvest(axes)
    if axes.chosen["format"] in TABLES and axes.chosen["machines"] == 1:
        count = axes.pick("sections", [0, 3, 4], [6, 1, 1])
        records = in_parts(records, [1 / count] * count) if count else records
    sheet = columns(axes, records)
    sheet.how["packed"] = form == "csv, packed"
    job = Job(axes, records, sheet, truth["area"])
    unusual = make_unusual(job) if seed % 3 else []
    wet = job.records.wet[np.isfinite(job.records.wet)]
    true = {"yield_t_ha": Truth(10.0 * float(wet.mean()))}
    if job.area is not None:
        true["area_ha"] = Truth(job.area, absolute=0.03 * job.area + truth["slack"])
    counts = {"unaccounted": 0}
    if not job.sheet.how.keys() & {"torn", "again"}:
        counts["records"] = len(job.sheet) * (2 if "twice" in job.sheet.how else 1)
    return Drawn(
        seed, partial(_write, job), true if job.is_known else {},
        frozenset(key for name in unusual for key in TRAITS[name].keys.split()), counts, tuple(axes.usual),
        tuple(unusual),
        claims={"delay_s": Truth(truth["delay"], absolute=max(1.5, 1.2 * axes.chosen["interval"]))},
        allowed=frozenset({"delay"}),
    )  # fmt: skip


def _write(job: Job, folder: Path) -> tuple[Path, Path | None]:
    """The log, and the map of its columns."""
    path = WRITERS[job.axes.chosen["format"]](folder, job.sheet, job.axes.chosen["file"])
    if "crs" not in job.sheet.how:
        return path, None
    given = folder / "columns.yaml"
    given.write_text(f"crs: {job.sheet.how['crs']}\n")
    return path, given


def read(given: tuple[Path, Path | None], out: Path) -> Got:
    """What an import makes of a log."""
    from swath.field_io.importer import import_log

    log, columns = given
    report = import_log(log, out, columns=columns, progress=False)
    rows = report.rows
    left = rows["read"] - sum(rows["broken"].values()) - sum(report.removed.values()) - report.kept
    delays = [m["flow_delay_s"] for m in report.machines if m["kept"]]
    return Got(
        {"yield_t_ha": report.crop["yield_t_ha"], "area_ha": report.field["area_ha"]}, report.notes,
        {"records": rows["read"], "unaccounted": left}, {"delay_s": delays},
    )  # fmt: skip
