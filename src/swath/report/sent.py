"""Everything that the slots of a machine sent: the columns of its tracks, and where arrays are seen.

Made by rule of the columns themselves, so that a number of a new signal is here without being named.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swath.core.number_text import num
from swath.record.message_factory import RecordedMachine
from swath.record.tracks import Column, arrays_of
from swath.report.chart import Chart
from swath.report.html import Fold, Table, element

HEAD = ("column of tracks.parquet", "least", "greatest", "over time")
ABOUT = "What slots sent as single numbers, and what was judged on the way. {}"
WIDE, HIGH = 240.0, 24.0  # of a course [px]
STEPS = 80  # of a course, in each of which the least and the greatest value are drawn


def sent(machine: RecordedMachine, columns: Sequence[Column], tracks: Mapping[str, Any]) -> Fold:
    """All that a machine's slots sent. tracks: its rows, by the names of the columns."""
    rows, empty = [], []
    for column in columns:
        values = np.where(np.isfinite(tracks[column.name]), tracks[column.name], np.nan)
        low, high = (float(end.reduce(values, initial=np.nan)) for end in (np.fmin, np.fmax))
        if low != low:
            empty.append(f"`{column.name}`")
            continue
        name = element("code", column.name, title=column.meaning)
        course = (num(high), _course(values, low, high, column.name)) if low < high else ("", "")
        rows.append([name, num(low), *course])
    text = ABOUT.format(f"Without a number: {', '.join(empty)}." if empty else "")
    seen = [(o, arrays_of(kind), kind.about.seen_as) for o, kind in machine.outputs.items()]
    arrays = [[f"{output}: {', '.join(names)}", place] for output, names, place in seen if names]
    tables = [Table("", HEAD, rows, (1, 2), text), Table("", ("arrays without a column", "seen as"), arrays)]
    return Fold(f"Show the {len(columns)} columns of {machine.name}", [t for t in tables if t])


def _course(values: Any, low: float, high: float, label: str) -> Chart:
    """Values from the least to the greatest, in their order."""
    starts = np.arange(min(STEPS, len(values))) * len(values) // min(STEPS, len(values))
    ends = np.stack([end.reduceat(values, starts) for end in (np.fmin, np.fmax)], axis=1)
    drawing = Chart(WIDE, HIGH, label)
    drawing.curve(np.repeat(starts / len(values), 2), (ends.ravel() - low) / (high - low))
    return drawing
