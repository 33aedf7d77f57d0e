"""Marks on the time line of a run: its worst moments and what happened."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.record.charts import Columns
from swath.terminal.outcome import result_of

SETTLED_M = 15.0  # worst moments of steering are looked for beyond
NEAR_M = 5.0  # a clearance above is no moment worth looking at


@dataclass(frozen=True)
class Worst:
    """A moment to look at: where a column is largest, or smallest; text with its value."""

    column: str
    text: str
    factor: float
    is_least: bool = False
    beyond_m: float = 0.0
    at_least: float = 0.01
    of_header: bool = False

    def row_of(self, columns: Columns) -> tuple[int, float]:
        """The row of the moment, and the size of the value there; nan where no row has one."""
        values = columns[self.column]
        size = np.where(columns["distance_m"] >= self.beyond_m, np.abs(values), np.nan)
        if not np.isfinite(size).any():
            return 0, np.nan
        at = int(np.nanargmin(size) if self.is_least else np.nanargmax(size))
        return at, float(size[at])


WORST = (
    Worst(
        "lateral_error_m",
        "header end {:.1f} cm off",
        100.0,
        beyond_m=SETTLED_M,
        at_least=0.01,
        of_header=True,
    ),
    Worst(
        "edge_error_m",
        "detected edge {:.1f} cm off",
        100.0,
        beyond_m=SETTLED_M,
        at_least=0.01,
        of_header=True,
    ),
    Worst("engine_load", "engine load {:.0f} %", 100.0, at_least=0.5),
    Worst("loss_share", "{:.1f} % of the grain lost", 100.0, at_least=0.02),
    Worst("clearance_m", "least clearance {:.2f} m", 1.0, is_least=True),
)


def worst_moments(name: str, columns: Columns, *, cuts: bool) -> list[dict[str, Any]]:
    """The worst moments of a machine, in order of time. cuts: False for one without a header."""
    found = []
    for worst in WORST:
        values = columns.get(worst.column)
        if values is None or (worst.of_header and not cuts):
            continue
        at, size = worst.row_of(columns)
        if not np.isfinite(size) or size < worst.at_least or (worst.is_least and size > NEAR_M):
            continue
        text = worst.text.format(float(values[at]) * worst.factor).replace("-", "\u2212")
        found.append({"t_s": round(float(columns["t_s"][at]), 3), "machine": name, "text": text})
    return sorted(found, key=lambda moment: float(moment["t_s"]))


def events_of(summary: Mapping[str, Any], tracks: Mapping[str, Columns]) -> list[dict[str, Any]]:
    """Incidents, limits that broke and changes that were made, in order of time."""
    found = [
        {
            "t_s": float(e["t_s"]),
            "end_s": None if e.get("end_t_s", e["t_s"]) is None else float(e.get("end_t_s", e["t_s"])),
            "kind": e["kind"],
            "machine": e["machine"],
            "text": f"{e['kind'].replace('_', ' ')}: {e['text']}",
        }
        for e in summary.get("incidents", [])
    ]
    found += [event for e in summary.get("expect", []) if (event := _broken(e, tracks)) is not None]
    for change in summary.get("events", []):
        told = "removed" if change["value"] in (None, "") else f"= {change['value']}"
        found.append(_mark(float(change["t_s"]), "change", "", f"{change['set']} {told}"))
    return sorted(found, key=lambda event: float(event["t_s"]))


def telling_rows(piece: Columns, limits: Sequence[Mapping[str, Any]]) -> list[int]:
    """Rows of a piece of a machine's tracks that `worst_moments` and `events_of` may tell of.

    limits: that fail, entries `expect` of the summary
    """
    found = {len(piece["t_s"]) - 1, *(w.row_of(piece)[0] for w in WORST if w.column in piece)}
    for entry in limits:
        found.update(_outside(entry, piece)[:1].tolist())
    return sorted(found)


def _outside(entry: Mapping[str, Any], columns: Columns) -> np.ndarray:
    """Rows at which a column is outside a limit; none where the limit is on a metric."""
    limit, values = entry["limit"], columns.get(entry["name"])
    if values is None:
        return np.zeros(0, int)
    low, high = limit.get("min", -np.inf), limit.get("max", np.inf)
    beyond = columns["distance_m"] >= float(entry.get("window", {}).get("from_m", 0.0))
    return np.flatnonzero(beyond & ((values < low) | (values > high)))


def _broken(entry: Mapping[str, Any], tracks: Mapping[str, Columns]) -> dict[str, Any] | None:
    """A limit that fails, at the first sample outside it or at the end of the run."""
    if result_of(entry) != "fail":
        return None
    columns = tracks.get(entry["subject"]) or next(iter(tracks.values()))
    outside = _outside(entry, columns)
    time = float(columns["t_s"][outside[0] if len(outside) else -1])
    text = f"limit {entry['name']} fails: {entry.get('reason', '')}"
    return _mark(time, "limit", str(entry["subject"]), text.rstrip(": "))


def _mark(time: float, kind: str, machine: str, text: str) -> dict[str, Any]:
    return {"t_s": round(time, 3), "end_s": round(time, 3), "kind": kind, "machine": machine, "text": text}
