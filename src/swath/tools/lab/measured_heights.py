"""Heights measured with a real scanner over a real stand, for comparison in the lab.

CSV with a line of names: `height_m` above the ground, one row per return; optional `stems_per_m2`, `sensor`
and `depression_deg` say which case a row belongs to. Without one of them a row belongs to every case; other
columns are ignored.
"""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, reason_of
from swath.core.typed_numbers import number_in, unit_of
from swath.documents.text_file import text_lines
from swath.signals import F64
from swath.tools.lab.lab import Case

HEIGHT, KEYS = "height_m", ("stems_per_m2", "sensor", "depression_deg")
NEAR_DEG = 0.5  # a depression this near is that of the case [deg]


@dataclass(frozen=True)
class MeasuredHeights:
    """Heights of a file.

    name: name of the file
    height: heights [m], nan = no return
    columns: those of KEYS that the file has, (n,) each
    """

    name: str
    height: F64
    columns: dict[str, NDArray[Any]]

    def of(self, case: Case) -> F64:
        """Heights that belong to a case, maybe none."""
        mine = np.ones(len(self.height), dtype=bool)
        if "stems_per_m2" in self.columns:
            mine &= np.abs(self.columns["stems_per_m2"] - case.density) < 0.5
        if "depression_deg" in self.columns:
            mine &= np.abs(self.columns["depression_deg"] - case.depression_deg) < NEAR_DEG
        if "sensor" in self.columns:
            mine &= self.columns["sensor"] == case.sensor
        return np.asarray(self.height[mine])


def read_measured(path: Path) -> MeasuredHeights:
    """Read the file. InputError names file, line and what is wrong."""
    table = _read_csv(path)
    height = table.pop(HEIGHT)
    if not np.isfinite(height).any():
        raise InputError(HEIGHT, None, "expected at least one number", file=path)
    if np.nanmax(np.abs(height)) > 20.0:
        far = float(height[np.nanargmax(np.abs(height))])
        raise InputError(HEIGHT, far, "expected metres above the ground, -20 to 20", file=path)
    return MeasuredHeights(path.name, height, table)


def _read_csv(path: Path) -> dict[str, NDArray[Any]]:
    found: dict[str, list[Any]] = {}
    try:
        reader = csv.DictReader(text_lines(path, "--real", "a table"))
        names = [n for n in (HEIGHT, *KEYS) if n in (reader.fieldnames or ())]
        if HEIGHT not in names:
            raise _no_height(", ".join(reader.fieldnames or ()), path)
        if twice := next((n for n in names if list(reader.fieldnames or ()).count(n) > 1), None):
            raise InputError("columns", twice, "expected once", file=path, line=1)
        found = {n: [] for n in names}
        for row in reader:
            if any((cell or "").strip() for cell in row.get(None, ())):
                expected = f"expected {len(reader.fieldnames or ())} cells, decimals with a point"
                raise InputError("row", None, expected, file=path, line=reader.line_num)
            for name in names:
                found[name].append(_value(name, row[name], path, reader.line_num))
    except csv.Error as error:
        raise InputError("--real", str(path), f"expected a table: {reason_of(error)}") from error
    return {n: np.array(v, dtype=str if n == "sensor" else np.float64) for n, v in found.items()}


def _value(name: str, text: str | None, path: Path, line: int) -> Any:
    text = (text or "").strip()
    if name == "sensor":
        return text
    if name == HEIGHT and text.lower() in ("", "nan"):
        return np.nan
    try:
        return number_in(text, unit_of(name))
    except ValueError as error:
        raise InputError(name, text, f"expected a number{error}", file=path, line=line) from None


def _no_height(have: str, path: Path) -> InputError:
    return InputError("columns", have, f"expected {HEIGHT}, and maybe {', '.join(KEYS)}", file=path)
