"""From a requirement to the runs that judge it, and back; and what the runs met, as tables of OpenODD."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swath.core.number_text import num
from swath.core.process.shell import command
from swath.runtime.met import SUMMARY as MET
from swath.terminal.outcome import NOT_JUDGED, limit_text, result_of, window_text
from swath.tools.function_test.judging.margin import margin_of
from swath.tools.function_test.odd.binding import Odd, OddFile
from swath.tools.function_test.odd.openodd import export_tables
from swath.tools.function_test.stored_line import Result

FOLDER = "cod"
NOT_MEASURED = "not measured"
DEGREE_M = 111_319.49  # of longitude at the equator of WGS 84


@dataclass
class Traced:
    """What runs say of a requirement. limits: as text; kept, broken, unmeasured, unjudged: counts of runs.

    worst: the run nearest to a limit or farthest beyond one, by margin
    why: that limit and its value
    """

    name: str
    limits: dict[str, None] = field(default_factory=dict)
    kept: int = 0
    broken: int = 0
    unmeasured: int = 0
    unjudged: int = 0
    worst: Result | None = None
    margin: float = 2.0
    why: str = ""


def requirements_of(file: OddFile, entry: Mapping[str, Any]) -> list[str]:
    """Identifiers of the requirements that a limit of a result stands for."""
    names = {entry["name"], f"{entry['subject']}.{entry['name']}"}
    own = [name for name, limits in file.requirements.items() if names & set(limits)]
    return [*([file.requirement] if file.requirement else []), *own]


def said_of(entry: Mapping[str, Any]) -> str:
    """The result of a limit; `not measured`, too, where it fails because there was no value."""
    said = result_of(entry)
    return NOT_MEASURED if said == "fail" and entry["value"] is None else said


def broken_by(file: OddFile, result: Result) -> list[str]:
    """Identifiers of the requirements that a run breaks."""
    found = [n for e in result["expect"] if said_of(e) == "fail" for n in requirements_of(file, e)]
    return list(dict.fromkeys(found))


def traced(file: OddFile, results: Iterable[Result]) -> list[Traced]:
    """Of every requirement, the one of the whole ODD first."""
    names = [*([file.requirement] if file.requirement else []), *file.requirements]
    found = {name: Traced(name) for name in names}
    for result in results:
        own: dict[str, list[Mapping[str, Any]]] = {}
        for entry in result["expect"]:
            for name in requirements_of(file, entry):
                own.setdefault(name, []).append(entry)
        for name, entries in own.items():
            _add(found[name], result, entries)
    return list(found.values())


def _add(told: Traced, result: Result, entries: Sequence[Mapping[str, Any]]) -> None:
    said = {said_of(entry) for entry in entries}
    told.limits.update(dict.fromkeys(f"{e['name']} {limit_text(e)}{window_text(e)}" for e in entries))
    told.broken += "fail" in said
    told.unmeasured += "fail" not in said and NOT_MEASURED in said
    told.unjudged += not {"fail", NOT_MEASURED} & said and NOT_JUDGED in said
    told.kept += said == {"pass"}
    for entry in entries:
        margin = margin_of(entry, is_bounded=False)
        if said_of(entry) in ("pass", "fail") and entry["value"] is not None and margin < told.margin:
            told.worst, told.margin = result, margin
            told.why = f"{entry['subject']}.{entry['name']} {num(entry['value'])}"


TRACE = ("requirement", "run", "limit", "result", "value", "again")


def trace_rows(file: OddFile, results: Iterable[Result], folder: str) -> Iterable[Mapping[str, Any]]:
    """A row of TRACE for each requirement, run and limit."""
    for result in results:
        for entry in result["expect"]:
            for name in requirements_of(file, entry):
                limit = f"{entry['subject']}.{entry['name']} {limit_text(entry)}{window_text(entry)}"
                row = (name, result["id"], limit, said_of(entry), entry["value"], again(folder, result))
                yield dict(zip(TRACE, row, strict=True))


def again(folder: str, result: Result) -> str:
    """The command that makes a run once more."""
    return command("test", "again", folder, str(result["id"])[:8])


def write_cod(folder: Path, odd: Odd, results: Iterable[Result]) -> int:
    """Write what each run drove as a current operational domain of OpenODD, into `cod`; returns how many.

    Time counts from 1970-01-01, as a run knows no clock. A field lies nowhere on Earth: the way from the
    start [m] is written as metres along the equator, eastwards from latitude and longitude 0.
    """
    attributes = [
        {"name": name, "unit": _unit(odd, name), "values": list(attribute.values) or None}
        for name, attribute in odd.domain.attributes.items()
    ]
    count = 0
    for result in results:
        met = result.get(MET) or {}
        rows = [
            [
                t,
                0.0,
                distance / DEGREE_M,
                *(_value(odd, name, result, number) for name in odd.domain.attributes),
            ]
            for number, (t, distance) in enumerate(
                zip(met.get("t_s", ()), met.get("distance_m", ()), strict=True)
            )
        ]
        count += export_tables(attributes, rows, folder / FOLDER, str(result["id"]))
    return count


def _unit(odd: Odd, name: str) -> str:
    bound = odd.file.attributes.get(name)
    return "" if bound is None or bound.unit == "1" else bound.unit


def _value(odd: Odd, name: str, result: Result, number: int) -> Any:
    """At a row of what was met: as measured, else as set; None for what nothing says."""
    bound = odd.file.attributes.get(name)
    met = result.get(MET) or {}
    if bound is not None and bound.met in met:
        return met[bound.met][number]
    return result["point"].get(name)
