"""What a line of a journal says, and a row of the table: read as data that anybody may have written."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Literal

from pydantic import ConfigDict, TypeAdapter

from swath.documents.json_file import whole_number
from swath.scenario.sections import Limit
from swath.tools.function_test.case import Scalar

Result = dict[str, Any]
Values = dict[str, float | None]


@dataclass
class _Entry:
    """What became of a limit."""

    subject: str
    name: str
    limit: Limit
    value: float | None
    result: Literal["pass", "fail", "not measured"]
    reason: str = ""
    rests_outside: list[str] = field(default_factory=list)
    window: dict[str, float | str] = field(default_factory=dict)


@dataclass
class _Quantity:
    quantity: str
    met: tuple[float, float]
    checked: tuple[float, float]


@dataclass
class _Outside:
    level: str
    quantities: list[_Quantity]


@dataclass
class _Integrity:
    samples: int
    hazardous: int
    episodes: int
    longest_m: float
    km: float
    bins: list[tuple[int, int, int]]


@dataclass
class _Steering:
    classes: list[tuple[int, int]]
    squares: float


@dataclass
class _Shadow:
    metrics: Values
    digest: str
    integrity: _Integrity | None = None
    edge_us: float | None = None


@dataclass
class _Ended:
    reason: str
    text: str


@dataclass
class _Line:
    """A result. Keys that are not here nobody reads."""

    id: str
    case: str
    candidate: str
    point: dict[str, Scalar]
    seed: int
    verdict: Literal["pass", "fail", "not judged", "error", "open"]
    reason: str
    metrics: Values
    expect: list[_Entry]
    incidents: list[dict[str, Any]]
    digest: str
    ended: _Ended | None = None
    edge_us: float | None = None
    credibility: dict[str, _Outside] = field(default_factory=dict)
    never_checked: dict[str, list[str]] = field(default_factory=dict)
    shadow: dict[str, _Shadow] = field(default_factory=dict)
    integrity: _Integrity | None = None
    steering: _Steering | None = None
    met: dict[str, list[float | None]] | None = None
    asked_by: dict[str, list[str]] = field(default_factory=dict)
    cpu_s: float = 0.0

    def __post_init__(self) -> None:
        if not all(self.credibility.keys() >= set(entry.rests_outside) for entry in self.expect):
            raise ValueError("expected what it rests on")
        met = self.met or {}
        t, distance = met.get("t_s", []), met.get("distance_m", [])
        if None in (*t, *distance) or any(len(column) != len(t) for column in (distance, *met.values())):
            raise ValueError("expected columns of one length over time and way")


@cache
def _adapter() -> TypeAdapter[tuple[_Line]]:
    return TypeAdapter(tuple[_Line], config=ConfigDict(strict=True, allow_inf_nan=False))


def read_line(line: bytes) -> Result | None:
    """The result in a line of JSON; None where it is no whole one."""
    try:
        found: Result = json.loads(line, parse_int=whole_number)
        _adapter().validate_json(b"[" + line + b"]")
    except (ValueError, RecursionError):
        return None
    return found


def read_row(row: Mapping[str, Any]) -> Result:
    """The result in a row of the table, with texts as JSON. ValueError where it is none."""
    found = {**row, **{name: json.loads(row[name]) for name in ("point", "expect", "incidents")}}
    names = [name for name in found if name.startswith("metric.")]
    found["metrics"] = {name.removeprefix("metric."): found.pop(name) for name in names}
    if (result := read_line(json.dumps(found, allow_nan=False).encode())) is None:
        raise ValueError(f"{str(row.get('id'))!r:.40} is no result")
    return result
