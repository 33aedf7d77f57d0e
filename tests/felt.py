"""Whether what a run says of a key that was set is so: it is felt where another value changes the digest."""

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields, is_dataclass
from typing import Any

from swath.core.asked import bare
from swath.core.errors import SwathError
from swath.field.weather import Weather
from swath.runtime.assembly import assemble
from swath.runtime.job import run_unrecorded
from swath.scenario.overrides import layered
from swath.scenario.scenario import Scenario, load_scenario

SHORT = ("run.distance_m=3", "run.max_duration_s=4", "run.record=none")
# a value of each key of the weather that is far from its default, and what it cannot be without
WEATHER: dict[str, tuple[str, ...]] = {
    "rain_mm_h": ("20",), "fog_mor_m": ("60",), "dust_per_m": ("0.02",), "wind_m_s": ("12",),
    "wind_azimuth_deg": ("20",), "temperature_c": ("5",), "humidity_percent": ("95",),
    "cloud_percent": ("80",),
    "sun_azimuth_deg": ("110", "field.weather.sun_elevation_deg=30"),
    "sun_elevation_deg": ("30", "field.weather.sun_azimuth_deg=110"),
    "time": ("2026-07-25T09:00+02:00", "field.weather={sun_elevation_deg: 30, sun_azimuth_deg: 110}"),
}  # fmt: skip


@dataclass(frozen=True)
class Row:
    """A key of a scenario with changes, and what else it is set to: first its default, where it has one."""

    scenario: str
    sets: tuple[str, ...]
    key: str
    others: tuple[str, ...]


@dataclass(frozen=True)
class Found:
    """is_told: the run says that nothing uses the key; is_felt: its digest is another one without it."""

    is_told: bool
    is_felt: bool

    @property
    def is_false(self) -> bool:
        """A key that changes the run is said to be unused."""
        return self.is_told and self.is_felt


class Looked:
    """Runs that were driven so far, each once."""

    def __init__(self) -> None:
        self._driven: dict[tuple[str, ...], tuple[str, list[str]]] = {}

    def drive(self, name: str, sets: tuple[str, ...]) -> tuple[str, list[str]]:
        """Digest and notes."""
        if (name, *sets) not in self._driven:
            summary = run_unrecorded(load_scenario(name, sets=layered(sets, SHORT)))
            self._driven[name, *sets] = summary["digest"], summary.get("notes", [])
        return self._driven[name, *sets]

    def look(self, row: Row) -> Found:
        """What a run says of a key, and what is so."""
        digest, notes = self.drive(row.scenario, row.sets)
        rest = tuple(text for text in row.sets if text.partition("=")[0] != row.key)
        is_told = any(note.startswith(f"no part of this run uses {row.key}:") for note in notes)
        return Found(is_told, any(self.drive(row.scenario, (*rest, o))[0] != digest for o in row.others))


def rows_of(name: str, sets: tuple[str, ...] = ()) -> Iterator[Row]:
    """The keys that a scenario sets, but for those that cannot be otherwise."""
    scenario = load_scenario(name, sets=layered(sets, SHORT))
    world = assemble(scenario)
    world.close()
    for asked in world.asked:
        for key, (kind, field) in asked.about.items():
            if others := _others(scenario, sets, key, kind, field):
                yield Row(name, sets, key, others)


def weather_rows(name: str, sets: tuple[str, ...] = ()) -> Iterator[Row]:
    """All keys of the weather."""
    for key, (value, *more) in WEATHER.items():
        own = f"field.weather.{key}"
        kept = [text for text in sets if not text.startswith(f"{own}=")]
        other = {"sun_azimuth_deg": 200.0, "sun_elevation_deg": 50.0}.get(key, USUAL[key])  # it needs both
        yield Row(name, (*kept, *more, f"{own}={value}"), own, (f"{own}={json.dumps(other)}",))


def _others(scenario: Scenario, sets: tuple[str, ...], key: str, kind: Any, field: str) -> tuple[str, ...]:
    """Changes that take a key away, or make it another; () where it cannot be."""
    value: Any = scenario.lifted()
    for part in key.split("."):
        value = value[int(part)] if isinstance(value, list) else value[part]
    rest = tuple(text for text in sets if text.partition("=")[0] != key)
    found = []
    for other in (*_default(kind, field), *_other(value)):
        text = f"{key}={json.dumps(other)}"
        with suppress(SwathError, TypeError):
            assemble(load_scenario(scenario.name, sets=layered((*rest, text), SHORT))).close()
            found.append(text)
    return tuple(found[:2])


def _default(kind: Any, field: str) -> list[Any]:
    if not is_dataclass(kind):
        own = kind.model_fields[field]
        return [own.get_default(call_default_factory=True)]
    (own,) = (f for f in fields(kind) if f.name == field)
    if own.default_factory is not MISSING:
        return [] if is_dataclass(made := own.default_factory()) else [made]
    return [] if own.default is MISSING or is_dataclass(bare(own.default)) else [own.default]


def _other(value: Any) -> list[Any]:
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 1, value - 1]
    return [0.9 * value, 1.1 * value, 0.1] if isinstance(value, float) else []


USUAL = {f.name: f.default for f in fields(Weather)}
# scenarios in which each key of the weather is looked at, with what makes more of it felt
WITH_WEATHER: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("straight", ()),
    ("straight", ("field.stand.wind={}", "combine.lidar.level=empirical")),
    ("straight", ("combine.lidar.daylight.shot_noise=20", "field.weather.sun_elevation_deg=30",
                  "field.weather.sun_azimuth_deg=110", "combine.lidar.level=empirical")),
    ("straight", ("combine.lidar.level=empirical", "field.stand.straw_moisture_percent=weather")),
    ("drifting-dust", ()),
    ("evening-camera", ()),
    ("fawn-at-dawn", ()),
)  # fmt: skip
