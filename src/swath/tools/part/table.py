"""Samples as CSV: a row per moment `t_s`, a column `slot.output.number` per number, in SI units and radians.

An array is one cell with its numbers in a row, separated by spaces, `[]` without any. A row without any
number of an output says that no sample of it came; a single empty cell keeps the value before. The last row
says how long the table lasts, even where it has a time only.
"""

import csv
import difflib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swath.core.checked import misfit
from swath.core.component import Port
from swath.core.errors import InputError, raise_all, reason_of
from swath.core.files.whole_file import write_csv
from swath.core.layout import Field
from swath.core.number_text import num
from swath.core.schedule import NS
from swath.documents.text_file import text_lines
from swath.signals.flat import build, flat_fields, read
from swath.tools.part.isolate import Arrival, IsolatedPart, Output

TIME = "t_s"
STAMP = "t"  # when a sample was valid [s], where that is not when it came
MOST = 20  # bad cells named at once
TRUTHS = {"true": True, "1": True, "false": False, "0": False}
Column = tuple[Output, str]


class Inputs(NamedTuple):
    """Samples in the order of time; end: of the table [ns]."""

    arrivals: list[Arrival]
    end: int


def columns_of(part: IsolatedPart, ports: dict[Output, Port]) -> dict[str, tuple[Output, Field]]:
    """Name of a column -> its output and number."""
    return {
        part.column(output, field.name): (output, field)
        for output, port in ports.items()
        for field in flat_fields(port.signal).values()
    }


def read_table(path: Path, part: IsolatedPart) -> Inputs:
    """A table. InputError; every unknown and every missing column is named at once."""
    try:
        lines = csv.reader(text_lines(path, "--input", "a table or a run folder"))
        columns = _check_head([name.strip() for name in next(lines, [])], part, path)
        rows = list(_rows(lines, columns, part, path))
        return Inputs([a for _, arrivals in rows for a in arrivals], rows[-1][0] if rows else 0)
    except csv.Error as error:
        raise InputError("--input", str(path), f"expected a table in UTF-8: {reason_of(error)}") from None


def write_table(path: Path, part: IsolatedPart, samples: Sequence[Arrival], end: int = 0) -> None:
    """Write samples, numbers with every digit. end: a last row has at least this time [ns]."""
    rows: dict[int, dict[str, str]] = {}
    for t, output, sample in samples:
        cells = rows.setdefault(t, {})
        cells[part.column(output, STAMP)] = repr(sample.t / NS)
        for name in flat_fields(type(sample)):
            cells[part.column(output, name)] = _written(read(sample, name))
    if end > max(rows, default=0):
        rows[end] = {}
    names = dict.fromkeys(name for cells in rows.values() for name in cells)
    write_csv(path, [{TIME: repr(t / NS), **rows[t]} for t in sorted(rows)], (TIME, *names))


def _check_head(head: Sequence[str], part: IsolatedPart, path: Path) -> list[tuple[str, Column | None]]:
    """What each column is, None for the time. InputError for names that are unknown, missing or twice."""
    known: dict[str, Column] = {}
    for output, port in part.ports.items():
        for number in (STAMP, *flat_fields(port.signal)):
            known[part.column(output, number)] = known[".".join((*output, number))] = (output, number)
    errors = []
    for name in head:
        if name != TIME and name not in known:
            near = difflib.get_close_matches(name, known, 1)
            taken = ", ".join(sorted({part.column(o, "*") for o in part.ports}))
            hint = f"did you mean {near[0]}?" if near else f"expected {TIME} and columns of {taken}"
            errors.append(
                InputError("column", name, f"{part.slot} does not take it, {hint}", file=path, line=1)
            )
    named = [known[name] for name in head if name in known]
    twice = sorted({n for n in head if head.count(n) > 1})
    errors += [_wrong(path, name, "expected once") for name in twice]
    if TIME not in head:
        errors.append(_wrong(path, TIME, "the column is missing: time [s]"))
    for output, port in part.ports.items():
        if output in part.needed or any(output == o for o, _ in named):
            for field in flat_fields(port.signal).values():
                if field.default is None and (output, field.name) not in named:
                    unit = f" [{field.unit}]" if field.unit else ""
                    text = f"the column is missing: {field.quantity.meaning}{unit}"
                    errors.append(_wrong(path, part.column(output, field.name), text))
    raise_all(errors)
    return [(name, known.get(name)) for name in head]


def _rows(
    lines: Iterator[list[str]], columns: Sequence[tuple[str, Column | None]], part: IsolatedPart, path: Path
) -> Iterator[tuple[int, list[Arrival]]]:
    """Time [ns] of each row that is not blank, and what came then."""
    held: dict[Output, dict[str, Any]] = {}
    before, errors = 0, []
    for line, cells in enumerate(lines, 2):
        now, fresh, stamps = None, {}, {}
        if any(cell.strip() for cell in cells[len(columns) :]):
            text = f"expected at most {len(columns)} cells, decimals with a point"
            errors.append(InputError("row", ",".join(cells)[:80], text, file=path, line=line))
        for (name, column), cell in zip(columns, cells, strict=False):
            if not (text := cell.strip()):
                continue
            try:
                if column is None:
                    now = round(float(text) * NS)
                    continue
                output, number = column
                if number == STAMP:
                    stamps[output] = round(float(text) * NS)
                    continue
                field = flat_fields(part.ports[output].signal)[number]
                held.setdefault(output, {})[number] = _value(text, field.kind)
                fresh[output] = True
            except (ValueError, OverflowError, KeyError):
                errors.append(InputError(name, text, "expected a number", file=path, line=line))
        if any(cell.strip() for cell in cells) and (now is None or now < before):
            text = f"expected a time that is not before {num(before / NS)} s"
            errors.append(InputError(TIME, None if now is None else now / NS, text, file=path, line=line))
        if errors or now is None:
            if len(errors) >= MOST:
                break
            continue
        before, found = now, []
        for output in fresh:
            try:
                sample = build(part.ports[output].signal, stamps.get(output, now), held[output])
            except InputError as error:
                raise InputError(error.key, error.value, error.expected, file=path, line=line) from error
            if (wrong := misfit(sample)) is not None:
                name, value = part.column(output, wrong[0]), getattr(sample, wrong[0])
                raise InputError(name, value, f"expected {wrong[1]}", file=path, line=line)
            found.append(Arrival(now, output, sample))
        yield now, found
    raise_all(errors)


def _wrong(path: Path, name: str, expected: str) -> InputError:
    return InputError("column", name, expected, file=path, line=1)


def _value(text: str, kind: str) -> Any:
    if kind == "array":
        return np.array(text.strip("[]").split(), dtype=float)
    if kind == "bool":
        return TRUTHS[text.lower()]
    return float(text)


def _written(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return " ".join(repr(float(v)) for v in value.ravel()) or "[]"
    return str(value).lower() if isinstance(value, bool | np.bool_) else repr(float(value))
