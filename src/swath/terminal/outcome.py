"""The outcome of a run as a table on stdout."""

from pathlib import Path
from typing import Any


def print_outcome(summary: dict[str, Any], out: Path) -> None:
    """Print the metrics of a run, its limits and where the report is."""
    from swath.scenario.metric_names import LIMITABLE_METRICS
    from swath.terminal.tables import number, table

    limits = summary.get("expect", {})
    rows = []
    for name in LIMITABLE_METRICS:
        if name in summary:
            entry = limits.get(name, {})
            bounds = entry.get("limit", {})
            bound = ", ".join(f"{k} {number(v)}" for k, v in bounds.items() if v is not None)
            unmeasured = ": nothing measured" if entry and summary[name] is None else ""
            rows.append((name, number(summary[name]), bound, entry.get("verdict", "") + unmeasured))
    table("", ("metric", "value", "limit", "verdict"), rows)
    if summary.get("incomplete"):
        print("incomplete: the run was stopped before its end")
    for note in summary.get("notes", []):
        print(f"note    {note}")
    if events := summary.get("events"):
        print(f"events  {len(events)}, listed in summary.json; repeat them with --events {out}")
    print(f"digest  {summary.get('digest', '-')}")
    print(f"report  {out / 'report.html'}")
