"""What is unusual in a drawn log: each trait changes a job, and says the keys by which it may be told."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from tests.readers.harvests import CROPS, MEASURED, TABLES, Axes, Records, in_parts, places
from tests.readers.log_columns import OTHER_NAMES, named, stamps
from tests.readers.log_files import Column, Sheet


@dataclass
class Job:
    """A draw in the making: the axes, the harvest and what is known of it, the sheet once it is made."""

    axes: Axes
    records: Records
    sheet: Sheet
    area: float | None
    is_known: bool = True

    @property
    def rng(self) -> np.random.Generator:
        return self.axes.rng

    def is_(self, axis: str, *values: Any) -> bool:
        """Whether an axis has one of these values."""
        return self.axes.chosen.get(axis) in values

    def has(self, *keys: str) -> bool:
        """Whether the sheet has these columns."""
        return all(self.sheet.of(key) is not None for key in keys)


@dataclass(frozen=True)
class Trait:
    """An unusual trait. kind: of two of a kind only one is drawn; keys: that may tell it; fits: whether a job
    can have it; make: changes the job.
    """

    kind: str
    keys: str
    fits: Callable[[Job], bool]
    make: Callable[[Job], None]


def _form(*names: str) -> Callable[[Job], bool]:
    """Whether a log has one of these formats."""
    return lambda job: job.is_("format", *names)


_of_tables = _form(*TABLES)


def _always(_: Job) -> bool:
    return True


def _is_counted(job: Job) -> bool:
    """One machine, in rows whose clock counts by fractions of a second."""
    return job.has("time") and job.is_("clock", "seconds", "ISO") and _is_one(job)


def _paced(job: Job) -> bool:
    """Something says how far it is from one record to the next."""
    is_timed = job.has("time") or job.has("duration") or not _of_tables(job)
    return job.has("distance") or (job.has("speed") and is_timed)


def _restamp(job: Job, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Other times in the column of the clock."""
    column = job.sheet.of("time")
    assert column is not None
    begun = float(column.values[0]) - job.sheet.time[0] if job.is_("clock", "seconds") else 0.0
    column.values = stamps(job.axes.chosen["clock"], change(job.sheet.time), begun)[-1][1]


def _since_last(job: Job) -> None:
    column = job.sheet.of("time")
    assert column is not None
    column.values = np.maximum(np.diff(job.sheet.time, prepend=job.sheet.time[0] - 1.0), 0.0)


def _thin(job: Job) -> None:
    interval = job.axes.chosen["interval"]
    most = min(5, int(4.9 / interval))
    number = np.unique(job.sheet.time, return_inverse=True)[1]
    index = np.flatnonzero(number % int(job.rng.integers(2, most + 1)) == 0)
    job.records = job.records.take(index)
    job.sheet.rows(index)


def _restart(job: Job) -> None:
    at = int(job.rng.uniform(0.3, 0.7) * len(job.sheet)) // 2 * 2
    if job.is_("format", "asc"):
        job.sheet.how["blocks"] = at
    else:
        t = job.sheet.time
        _restamp(job, lambda _: np.where(np.arange(len(t)) < at, t, t - t[at] + t[0]))


def _set_back(job: Job) -> None:
    at, back = int(job.rng.uniform(0.3, 0.7) * len(job.sheet)), job.axes.within(40, 400)
    t = job.sheet.time
    _restamp(job, lambda _: np.where(np.arange(len(t)) < at, t, t - round(back)))


def _shuffle(job: Job) -> None:
    index = job.rng.permutation(len(job.sheet))
    job.records = job.records.take(index)
    job.sheet.rows(index)
    job.is_known &= job.has("time")


def _copy(job: Job) -> None:
    count = len(job.sheet)
    a = int(job.rng.uniform(0, 0.5) * count)
    again = np.arange(a, a + int(job.rng.uniform(0.25, 0.5) * count))
    index = np.repeat(np.arange(count), 2) if job.rng.integers(2) else np.r_[np.arange(count), again]
    job.records = job.records.take(index)
    job.sheet.rows(index)


def _second(job: Job, key: str, factor: float, name: str = "", noise: float = 0.0) -> None:
    """One more source of a quantity, in another unit where it is a column of a table."""
    first = job.sheet.of(key)
    assert first is not None
    values = first.values * factor * (1 + noise * job.rng.standard_normal(len(first.values)))
    if job.is_("format", *MEASURED):
        job.sheet.how["second"] = [(first, values)]
        return
    other = Column(key, "", "", values)
    unit = job.axes.chosen[f"unit of {key}"]
    style = job.axes.chosen["names"]
    other.name = named(key, unit, style if style == "short" else "English", name or OTHER_NAMES[key])
    at = int(job.rng.integers(len(job.sheet.columns) + 1))
    job.sheet.columns.insert(at, other)


def _may_repeat(job: Job) -> bool:
    """The format can hold one quantity twice, under names that say it in full."""
    return not job.is_("format", "isoxml", "shapefile")


def _grain(job: Job) -> str:
    """The only column of grain; empty where there are two."""
    keys = [c.key for c in job.sheet.columns if c.key in ("flow", "yield", "dry_yield")]
    return keys[0] if len(keys) == 1 else ""


def _may_repeat_grain(job: Job) -> bool:
    return _may_repeat(job) and bool(_grain(job))


def _has_yield_in_words(job: Job) -> bool:
    return job.has("yield") and job.is_("format", "csv", "geojson")


def _differs(job: Job) -> None:
    _second(job, _grain(job), float(job.rng.choice([job.axes.within(0.3, 0.9), job.axes.within(1.12, 1.7)])))
    job.is_known = False


def _average(job: Job) -> None:
    _second(job, "yield", 0.0, "Average Yield")
    other = next(c for c in job.sheet.columns if c.name.startswith("Average"))
    count = len(other.values)
    other.values = job.sheet.of("yield").values.mean() * (0.6 + 0.2 * np.arange(count) / count)  # type: ignore[union-attr]
    job.sheet.columns.remove(other)
    job.sheet.columns.insert(0, other)


def _swap(job: Job, one: str, other: str) -> None:
    if job.is_("format", "shapefile", "geojson", "isoxml"):
        job.sheet.lon, job.sheet.lat = job.sheet.lat, job.sheet.lon
        return
    a, b = job.sheet.of(one), job.sheet.of(other)
    assert a is not None
    assert b is not None
    a.values, b.values = b.values, a.values


def _tear(job: Job, part: str = ".shp") -> None:
    share = job.axes.within(0.6, 0.92)
    job.sheet.how |= {"torn": share, "torn_part": part}
    job.area = None
    job.is_known &= job.is_("format", "csv")
    job.records = job.records.take(np.arange(len(job.records.t)) < share * len(job.records.t))


def _again(job: Job) -> None:
    job.sheet.how |= {"again": int(job.rng.integers(30, len(job.sheet))), "total": bool(job.rng.integers(2))}


def _parts(job: Job, shares: Sequence[float]) -> None:
    """A row for each part of the header, without a column that says so."""
    job.sheet.rows(np.repeat(np.arange(len(job.sheet)), len(shares)))
    _scale(job, ("width", "flow"), np.tile(shares, len(job.records.t)))
    job.records = in_parts(job.records, shares)
    at = places(job.records, job.axes)
    job.sheet.lon, job.sheet.lat = at[:2]
    for c in job.sheet.columns:
        if c.key in ("lon", "lat", "easting", "northing"):
            c.values = at[("lon", "lat", "easting", "northing").index(c.key)]


def _drop(job: Job, key: str) -> None:
    job.sheet.columns = [c for c in job.sheet.columns if c.key != key]


def _scale(job: Job, keys: Sequence[str], factor: Any) -> None:
    for c in job.sheet.columns:
        if c.key in keys and c.is_number:
            c.values = c.values * factor


def _wrong_width(job: Job) -> None:
    factor = float(job.rng.choice([job.axes.within(0.55, 0.88), job.axes.within(1.15, 1.5)]))
    _scale(job, ("width",), factor)
    _scale(job, ("yield", "dry_yield"), 1.0 / factor)  # as a monitor makes it
    job.is_known = False


def _uncalibrated(job: Job) -> None:
    factor = float(job.rng.choice([job.axes.within(0.65, 0.82), job.axes.within(1.22, 1.5)]))
    _scale(job, ("flow", "yield", "dry_yield"), np.where(job.records.machine == 0, factor, 1.0))
    job.is_known = False


def _poor(job: Job) -> None:
    low = CROPS[job.axes.chosen["crop"]][3][0]
    factor = job.axes.within(0.05, 0.12) * low / (10 * float(np.nanmean(job.records.wet)))
    _scale(job, ("flow", "yield", "dry_yield"), factor)
    job.records.wet = job.records.wet * factor


def _bad(job: Job, share: float, key: str, value: float) -> None:
    c = job.sheet.of(key)
    assert c is not None
    c.values = np.where(job.rng.random(len(job.sheet)) < share, value, c.values)


def _words(job: Job) -> None:
    c = job.sheet.of(_main(job))
    assert c is not None
    bad = job.rng.random(len(job.sheet)) < job.axes.within(0.03, 0.15)
    if job.is_("format", "mf4"):
        job.sheet.how["words"] = c.key
    else:
        c.values = [("SNA" if wrong else f"{v:.4f}") for v, wrong in zip(c.values, bad, strict=True)]
        if job.sheet.how.get("comma"):
            c.values = [v.replace(".", ",") for v in c.values]


def _main(job: Job) -> str:
    return job.axes.chosen["grain"].split(",")[0]


def _unnamed(job: Job) -> None:
    c = job.sheet.of(_main(job))
    assert c is not None
    c.name, c.unit = named(c.key, "", job.axes.chosen["names"]), ""


def _no_moisture(job: Job) -> None:
    _scale(job, ("moisture",), np.arange(len(job.sheet)) < 0.66 * len(job.sheet))


def _nowhere(job: Job) -> None:
    bad = job.rng.random(len(job.sheet)) < 0.04
    job.sheet.lon, job.sheet.lat = np.where(bad, 0.0, job.sheet.lon), np.where(bad, 0.0, job.sheet.lat)
    for key in ("lat", "lon"):
        if (c := job.sheet.of(key)) is not None:
            c.values = np.where(bad, 0.0, c.values)


def _coarse(job: Job) -> None:
    for key in ("lat", "lon"):
        c = job.sheet.of(key)
        assert c is not None
        c.values = np.round(c.values, 4)
    job.is_known = False


def _slow(job: Job) -> None:
    job.sheet.how["slow"] = {"width": np.inf, "moisture": 10.0, "elevation": 5.0}


def _how(job: Job, **how: Any) -> None:
    job.sheet.how |= how


def _is_one(job: Job) -> bool:
    """One machine, a row at a time."""
    return not job.axes.chosen.get("sections") and job.is_("machines", 1)


def _may_be_thinned(job: Job) -> bool:
    return _of_tables(job) and _is_one(job) and (job.has("distance") or job.has("duration"))


def _in_degrees(job: Job) -> None:
    job.sheet.how["encoding"] = "utf-8"
    for c in job.sheet.columns:
        c.unit = "°" if c.key in ("lat", "lon") else c.unit


def _has_witness_of_speed(job: Job) -> bool:
    return job.has("speed") and (job.has("time") or not _of_tables(job))


TRAITS = {
    # who, and which part
    "two parts, equal": Trait("part", "timeline width sources", lambda j: _of_tables(j) and _is_one(j),
                              lambda j: _parts(j, (0.5, 0.5))),
    "two parts, unequal": Trait("part", "timeline width sources", lambda j: _of_tables(j) and _is_one(j),
                                lambda j: _parts(j, (2 / 3, 1 / 3))),
    "two machines, no column": Trait("part", "timeline lost calibration", lambda j: j.has("machine", "time"),
                                     lambda j: _drop(j, "machine")),
    "a machine not calibrated": Trait("part", "calibration", lambda j: j.has("machine"), _uncalibrated),
    # order and time of the rows
    "thinned": Trait("order", "timeline", _may_be_thinned, _thin),
    "restarted": Trait("order", "timeline lost", lambda j: _is_counted(j) or _form("asc")(j), _restart),
    "clock set back": Trait("order", "timeline lost", _is_counted, _set_back),
    "stamps since the last row": Trait("order", "timeline",
                                       lambda j: _is_counted(j) and j.is_("clock", "seconds"), _since_last),
    "relative stamps": Trait("order", "timeline", _form("asc"), lambda j: _how(j, relative=True)),
    "rows shuffled": Trait("order", "timeline lost", _of_tables, _shuffle),
    "rows copied": Trait("order", "timeline lost", _of_tables, _copy),
    # sources
    "grain twice, alike": Trait("source", "sources", _may_repeat_grain,
                                lambda j: _second(j, _grain(j), 1.0, noise=0.002)),
    "grain twice, differs": Trait("source", "sources", _may_repeat_grain, _differs),
    "width twice, alike": Trait("source", "sources width", _may_repeat, lambda j: _second(j, "width", 1.0)),
    "width twice, differs": Trait("source", "sources width", _may_repeat,
                                  lambda j: _second(j, "width", j.axes.within(0.5, 0.9))),
    "average yield beside": Trait("source", "sources", _has_yield_in_words, _average),
    "all on two buses": Trait("source", "sources", _form("asc", "blf"), lambda j: _how(
        j, second=[(c, c.values) for c in j.sheet.columns if c.is_number])),
    "a second receiver": Trait("source", "sources", _form(*MEASURED), lambda j: _how(
        j, second=[(c, c.values + 1.5e-5) for c in j.sheet.columns if c.key in ("lat", "lon")])),
    "log written twice": Trait("source", "sources lost", _form("isoxml"), lambda j: _how(j, twice=True)),
    # place
    "lat and lon swapped": Trait("place", "place", lambda j: j.is_("coordinates", "lat lon") and _paced(j),
                                 lambda j: _swap(j, "lat", "lon")),
    "north first": Trait("place", "place", lambda j: j.has("easting"),
                         lambda j: _swap(j, "easting", "northing")),
    "positions of 0": Trait("place", "place lost", lambda j: j.is_("coordinates", "lat lon"), _nowhere),
    "4 decimals": Trait("place", "place", lambda j: j.has("lat") and _form("csv")(j), _coarse),
    # file
    "torn": Trait("file", "damaged lost", _always, _tear),
    "table shorter": Trait("file", "damaged lost", _form("shapefile"),
                           partial(_tear, part=".dbf")),
    "header again": Trait("file", "damaged lost", _form("csv"), _again),
    "slow channels": Trait("file", "lost sources", _form("mf4"), _slow),
    "channels invalid in part": Trait("file", "lost", _form("mf4"),
                                      lambda j: _how(j, invalid=("moisture", "elevation"))),
    "DBC in UTF-8": Trait("file", "damaged", _form("asc", "blf"), _in_degrees),
    # numbers
    "width set wrong": Trait("width", "width", _always, _wrong_width),
    "speed in another unit": Trait("speed", "plausible timeline", _has_witness_of_speed,
                                   lambda j: _scale(j, ("speed",), 3.6)),
    "speed dead": Trait("speed", "plausible timeline", _has_witness_of_speed,
                        lambda j: _scale(j, ("speed",), 0.0)),
    "grain without its unit": Trait("unit", "yield plausible columns unit",
                                    lambda j: not j.is_(f"unit of {_main(j)}", "kg/s", "kg/ha"), _unnamed),
    "hardly any grain": Trait("level", "yield", _always, _poor),
    "no moisture in a third": Trait("moisture", "moisture plausible lost",
                                    lambda j: not j.is_("grain", "dry_yield"), _no_moisture),
    "-999 in the grain": Trait("bad", "lost plausible", _always,
                               lambda j: _bad(j, 0.06, _main(j), -999.0)),
    "SNA in words": Trait("bad", "lost plausible", _form("csv", "mf4"), _words),
}  # fmt: skip
"""Unusual traits by name."""
WEIGHTS = {"order": 3.0, "part": 3.0, "source": 1.5, "place": 1.0, "file": 1.0}
"""How often a kind is drawn, 0.5 where it is not named: some fit few logs, some all."""


def make_unusual(job: Job) -> list[str]:
    """One to three unusual traits of different kinds, made in the order of TRAITS."""
    most, made = int(job.rng.integers(1, 4)), list[str]()
    names = job.axes.allowed("unusual", list(TRAITS))
    late = [job.rng.exponential() / WEIGHTS.get(TRAITS[name].kind, 0.5) for name in names]
    for _, name in sorted(zip(late, names, strict=True)):
        is_new = TRAITS[name].kind not in {TRAITS[other].kind for other in made}
        if len(made) < most and is_new and TRAITS[name].fits(job):
            made.append(name)
    made.sort(key=list(TRAITS).index)
    for name in made:
        TRAITS[name].make(job)
    return made
