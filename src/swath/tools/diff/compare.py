"""Two run folders compared: scenarios, exact samples, metrics, events; and the page, with both tracks."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.number_text import num, signed
from swath.core.schedule import NS
from swath.documents.yaml_document import read_document
from swath.judge.summary import numbers_in, read_summary
from swath.record.charts import Columns, shown_charts
from swath.record.digest import encode
from swath.record.read.feed import exact_outputs, exact_samples, unlike
from swath.record.read.files import Log, open_log
from swath.replay.machines import derived
from swath.replay.moments import events_of
from swath.replay.writer import tracks_of
from swath.report.html import Figure, Table, write_page
from swath.report.plots import BLUE, ORANGE, as_image, curves_figure, figure, styled
from swath.runtime.folder import check_run_folder
from swath.signals import Signal
from swath.signals.flat import flat_fields, read

ROUNDING = 1e-12  # relative; metrics nearer than that are reported as equal
VARY = ("real_time_factor", "wall_s", "seed")  # by the clock on the wall, and what is a setting


@dataclass(frozen=True)
class Run:
    """A run folder as read. label: its name, with its parents where both have the same."""

    folder: Path
    label: str
    summary: Mapping[str, Any]
    scenario: Mapping[str, Any]
    tracks: Mapping[str, Columns]


@dataclass(frozen=True)
class Difference:
    """Where an output first differs. t [ns]; what: its field or what else; values: of the field, as text."""

    slot: str
    t: int
    what: str
    values: tuple[str, str]


@dataclass(frozen=True)
class Comparison:
    """What differs. settings, metrics: rows of text; differences: by slot, the earliest first.

    is_same: both have the same digest, not a bit differs; is_exact: both folders hold every sample
    """

    first: Run
    second: Run
    is_same: bool
    settings: list[tuple[str, str, str]]
    differences: list[Difference]
    is_exact: bool
    metrics: list[tuple[str, str, str, str]]
    events: list[tuple[str, str]]

    @property
    def headline(self) -> str:
        """The result in one sentence."""
        if self.is_same:
            return f"same digest: {self.first.label} and {self.second.label} are equal to the last bit"
        if not self.is_exact:
            return "different digests; where they begin is not known: a run.mcap with all samples is missing"
        if not self.differences:
            return "different digests, the same recorded samples"
        at = self.differences[0]
        return f"different from {num(at.t / NS, places=3)} s on: {at.slot}, {at.what}"

    def difference_rows(self) -> list[tuple[str, ...]]:
        """Rows of a table."""
        return [(d.slot, num(d.t / NS, places=3), d.what, *d.values) for d in self.differences]


def compare(first: Path, second: Path) -> Comparison:
    """Compare two run folders. Raises InputError where one is none."""
    a, b = _read(first, second), _read(second, first)
    logs = [_log(first), _log(second)]
    is_same = a.summary.get("digest") == b.summary.get("digest") is not None
    differences: list[Difference] = []
    is_exact = is_same
    if not is_same and logs[0] is not None and logs[1] is not None:
        outputs = [exact_outputs(log) for log in logs if log is not None]
        is_exact = bool(outputs[0] and outputs[1])
        for topic in [t for t in outputs[0] if t in outputs[1]]:
            found = _first_difference(topic, outputs[0][topic], logs[0], logs[1])
            differences += [found] if found else []
        order = list(a.summary.get("cost", ()))  # of the slots within a tick
        differences.sort(
            key=lambda d: (d.t, order.index(slot) if (slot := d.slot.rpartition(".")[0]) in order else 0)
        )
    return Comparison(
        a, b, is_same, _settings(a, b), differences, is_exact, _metrics(a, b), [*_events(a), *_events(b)]
    )


def _read(folder: Path, other: Path) -> Run:
    check_run_folder(folder, "scenario.yaml", "summary.json", "tracks.parquet")
    summary = read_summary(folder / "summary.json")
    data = read_document(folder / "scenario.yaml").data
    tracks = {name: derived(own, _edge_side(data, name)) for name, own in tracks_of(folder).items()}
    label = folder.name if folder.name != other.name else str(folder)
    return Run(folder, label, summary, data, tracks)


def _edge_side(scenario: Any, machine: str) -> str:
    """Edge side of a machine of a resolved scenario; `left` where a damaged one does not say it."""
    machines = scenario.get("machines") if isinstance(scenario, dict) else None
    section = machines.get(machine) if isinstance(machines, dict) else None
    return str(section.get("edge_side", "left")) if isinstance(section, dict) else "left"


def _log(folder: Path) -> Log | None:
    return open_log(folder / "run.mcap") if os.path.isfile(folder / "run.mcap") else None


def _first_difference(topic: str, slot: str, a: Log, b: Log) -> Difference | None:
    """The first difference of one output; being longer is no difference of a run."""
    blocks = unlike(*(log.messages((topic,)) for log in (a, b)))
    for one, other in zip_longest(*map(exact_samples, blocks)):
        if one is None or other is None:
            return None
        if one[0] != other[0]:
            times = num(one[0] / NS, places=4), num(other[0] / NS, places=4)
            return Difference(slot, min(one[0], other[0]), "time of the sample", times)
        for name in dict.fromkeys([*flat_fields(type(one[1])), *flat_fields(type(other[1]))]):
            values = (_value(one[1], name), _value(other[1], name))
            if encode(values[0]) != encode(values[1]):
                return Difference(slot, one[0], name, (shown_value(*values), shown_value(*reversed(values))))
    return None


def _value(sample: Signal, name: str) -> Any:
    return read(sample, name) if name in flat_fields(type(sample)) else None


def shown_value(value: Any, other: Any) -> str:
    """A number, with digits that tell it from the other; of an array the first one that differs."""
    if isinstance(value, np.ndarray) and isinstance(other, np.ndarray):
        if value.shape != other.shape:
            return f"{value.shape} numbers"
        at = np.flatnonzero((value != other).ravel() & ~(np.isnan(value) & np.isnan(other)).ravel())
        return shown_value(value.ravel()[at[0]].item(), other.ravel()[at[0]].item()) if len(at) else "-"
    return num(value, beside=[other])


def _settings(a: Run, b: Run) -> list[tuple[str, str, str]]:
    one, other = ({k: v for k, v in _flat(run.scenario, "") if k != "summary"} for run in (a, b))
    keys = dict.fromkeys([*one, *other])
    pairs = [(k, one.get(k, "-"), other.get(k, "-")) for k in keys if one.get(k) != other.get(k)]
    files = [run.summary.get("files", {}) for run in (a, b)]
    changed = [name for name in files[0] if files[1].get(name, files[0][name]) != files[0][name]]
    rows = [(k, shown_value(x, y), shown_value(y, x)) for k, x, y in pairs]
    return rows + [(f"contents of {n}", files[0][n][:8], files[1][n][:8]) for n in changed]


def _flat(node: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(node, Mapping) and node:
        for key, value in node.items():
            yield from _flat(value, f"{path}.{key}" if path and path != "machines" else str(key))
    else:
        yield path, node


def _metrics(a: Run, b: Run) -> list[tuple[str, str, str, str]]:
    """Metrics that differ; of several machines with the machine's name."""
    one, other = numbers_in(a.summary), numbers_in(b.summary)
    rows = []
    for name in dict.fromkeys([*one, *other]):
        x, y = one.get(name), other.get(name)
        if name in VARY or (x is None and y is None):
            continue
        if x is None or y is None:
            rows.append((name, num(x), num(y), ""))
        elif abs(y - x) > ROUNDING * max(abs(x), abs(y)):
            rows.append((name, num(x, beside=[y]), num(y, beside=[x]), signed(y - x, of=[x, y])))
    return rows


def _events(run: Run) -> list[tuple[str, str]]:
    found = events_of(run.summary, run.tracks)
    return [(run.label, f"{num(e['t_s'], places=2)} s {e['machine']} {e['text']}") for e in found]


STYLES = ({"color": BLUE, "lw": 1.6}, {"color": ORANGE, "lw": 1.1})


def write_diff(found: Comparison, path: Path) -> Path:
    """Write the page; returns its path."""
    machines = [name for name in found.first.tracks if name in found.second.tracks]
    figures = [figure for name in machines for figure in _figures(found, name)]
    names = [found.first.label, found.second.label]
    folders = f"{found.first.folder} · {found.second.folder}"
    verdict = ("pass", "same digest", folders) if found.is_same else ("none", "different", folders)
    differ = ["output", "from [s]", "field", *names]
    tables = [
        Table("Scenario", ["key", *names], found.settings),
        Table("Where each output first differs", differ, found.difference_rows(), (1, 3, 4)),
        Table("Metrics that differ", ["metric", *names, "difference"], found.metrics, (1, 2, 3)),
        Table("Events", ["run", "event"], found.events),
    ]
    heading = " and ".join(names)
    return write_page(path, [*tables, *figures], heading=heading, lead=found.headline, verdict=verdict)


def _figures(found: Comparison, machine: str) -> list[Figure]:
    tracks = (found.first.tracks[machine], found.second.tracks[machine])
    names = (found.first.label, found.second.label)
    with styled():
        way = Figure(
            f"Way of {machine}", as_image(_way(tracks, names)), "Middle of the fixed axle, seen from above."
        )
        charts = {c["title"]: c for own in tracks for c in shown_charts(own, cuts="header_end_x_m" in own)}
        drawn = curves_figure(dict(zip(names, tracks, strict=True)), list(charts.values()))
        curves = Figure(
            f"Tracks of {machine}", as_image(drawn), "Over the distance driven, so that speeds may differ."
        )
    return [way, curves]


def _way(tracks: tuple[Columns, Columns], names: tuple[str, str]) -> Any:
    fig = figure(11.0, 3.4)
    left, right = fig.subplots(1, 2)
    for own, name, style in zip(tracks, names, STYLES, strict=True):
        left.plot(own["x_m"], own["y_m"], label=name, **style)
    left.set(xlabel="east [m]", ylabel="north [m]", aspect="equal", adjustable="datalim")
    left.legend()
    way, apart = _apart(*tracks)
    right.plot(way, 100.0 * apart, color="#6B6F76")
    right.set(xlabel="driven [m]", ylabel="apart after the same distance [cm]")
    return fig


def _apart(a: Columns, b: Columns) -> tuple[np.ndarray, np.ndarray]:
    """How far apart the two are after the same way driven; way [m], distance [m]."""
    distance = np.linspace(0.0, min(float(a["distance_m"].max()), float(b["distance_m"].max())), 400)
    places = [
        np.stack([np.interp(distance, own["distance_m"], own[k]) for k in ("x_m", "y_m")]) for own in (a, b)
    ]
    return distance, np.hypot(*(places[0] - places[1]))
