"""What real passes showed: evidence.csv in a folder, and its table on the page there."""

import csv
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from swath.core.files.whole_file import write_csv
from swath.documents.json_file import read_object
from swath.documents.packed import readable
from swath.documents.text_file import read_text
from swath.report.html import Table
from swath.tools.compare_scans.compare import Comparison
from swath.tools.function_test.case import Point

EVIDENCE, CHECK = "evidence.csv", "check.json"
SAID = ("pass", "conditions", "compared", "number", "value", "noise", "unit", "says", "file", "date", "note")
ABOUT = (
    "Passes in a real field against the simulation at their conditions. Scans: Wasserstein-1 distance of the "
    "heights; what lies above the noise is a difference. Logs: root mean square error of the model."
)


@dataclass(frozen=True)
class Evidence:
    """What one pass showed. point: as it was driven; rows: of evidence.csv."""

    point: Point
    rows: Sequence[Mapping[str, object]]


def write_evidence(folder: Path, found: Sequence[Evidence]) -> Path:
    """Write evidence.csv, which a dossier in the same folder shows."""
    return write_csv(folder / EVIDENCE, [row for each in found for row in each.rows], SAID)


def scans_row(made: Comparison, measured: str) -> dict[str, object]:
    """The row of a comparison of scans. measured: name of the recording."""
    number = made.number("w1_m")
    noise = number.spread[0] if number.spread else float("nan")
    says = "differs" if number.difference > noise else "no difference shown"
    return {"compared": "scans", "number": "heights, Wasserstein-1", "value": f"{number.difference:.4g}",
            "noise": f"{noise:.4g}", "unit": "m", "says": says, "file": measured}  # fmt: skip


def checked_rows(folder: Path) -> list[Mapping[str, object]]:
    """The rows of a check of a twin (`swath twin check`) in a folder; none where there is no check."""
    if not os.path.isfile(folder / CHECK):
        return []
    what = "a check of a twin"
    data = read_object(folder / CHECK, "scans", what)
    with readable("scans", what, folder / CHECK):
        return [{name: str(each[name]) for name in SAID if name in each} for each in data["rows"]]


def evidence_table(folder: Path) -> Table:
    """What is in the evidence.csv of a folder; empty where there is none."""
    rows = []
    if os.path.isfile(path := folder / EVIDENCE):
        read = csv.DictReader(read_text(path, EVIDENCE, "evidence").splitlines())
        rows = [[row.get(name) or "" for name in SAID] for row in read]
    return Table("Evidence from the field", SAID, rows, (4, 5), ABOUT)
