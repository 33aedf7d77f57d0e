"""summary.json: what a run came to."""

import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from swath.documents.json_file import json_safe, read_object, write_json
from swath.documents.validation import checked
from swath.documents.yaml_document import Document, Place
from swath.judge.evaluation import Evaluation, incident
from swath.judge.windows import FIELD
from swath.rays.device import ray_device
from swath.signals import F64

FORMAT = "swath summary 2"
PARTS = ("swath", "numpy", "warp-lang")
Seconds = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class _Limit(_Part):
    subject: str
    name: str
    limit: dict[str, Any]
    result: str
    window: dict[str, Any] = {}


class _Incident(_Part):
    t_s: Seconds
    end_t_s: Seconds | None = None
    kind: str
    machine: str
    text: str


class _Change(_Part):
    t_s: Seconds
    set: str
    value: Any


class _Cost(_Part):
    seconds: Seconds
    steps: Annotated[int, Field(ge=0)]


class _Checked(_Part):
    quantity: str
    state: str | None
    source: str
    checked: list[float | None] | None
    met: list[float | None] | None


class _Slot(_Part):
    level: str
    quantities: list[_Checked]


class _Credibility(_Part):
    undeclared: list[str] = []
    slots: dict[str, _Slot] = {}


class _Summary(_Part):
    """What readers of a summary rest on; metrics are read one by one."""

    name: str = ""
    expect: list[_Limit] = []
    incidents: list[_Incident] = []
    events: list[_Change] = []
    simulated_s: Seconds = 0.0
    incomplete: bool = False
    machines: dict[str, dict[str, Any]] = {}
    cost: dict[str, _Cost] = {}
    credibility: _Credibility = _Credibility()
    notes: list[str] = []
    versions: dict[str, Any] = {}
    files: dict[str, str] = {}


def make_summary(
    about: Mapping[str, Any],
    evaluation: Evaluation,
    tracks: Mapping[str, Mapping[str, F64]],
    *,
    sensors: Mapping[str, Mapping[str, float]],
    simulated_s: float,
    wall_s: float,
    ray_count: int,
    digest: str,
    incomplete: bool,
    cost: Mapping[str, tuple[float, int]],
) -> dict[str, Any]:
    """The content of summary.json, JSON-safe.

    about: `name`, `summary`, `seed`, `machine` ... of the run, first in the file; tracks: columns by machine
    sensors: further metrics by machine, which the sensors count; cost: slot -> (wall time [s], steps)

    The metrics of one machine stand at the top; those of several under `machines`, by name. Metrics of the
    field and of the run stand at the top, with several machines the field's also under `field`.
    """
    machines = {n: {**evaluation.metrics(n), **sensors.get(n, {})} for n in evaluation.machines}
    field = evaluation.metrics(FIELD)
    run = {
        "real_time_factor": simulated_s / wall_s if wall_s > 0 else float("nan"),
        "ray_count": ray_count,
    }
    expect = evaluation.check({**machines, FIELD: {**field, **run}}, tracks)
    is_alone = len(machines) == 1
    return json_safe(  # type: ignore[no-any-return]
        {
            "format": FORMAT,
            **about,
            **(next(iter(machines.values())) if is_alone else {}),
            **field,
            **run,
            "digest": digest,
            "incomplete": incomplete,
            "expect": expect,
            **({} if is_alone else {"machines": machines, "field": field}),
            "incidents": [incident(event) for event in evaluation.events()],
            "simulated_s": simulated_s,
            "wall_s": wall_s,
            "device": ray_device(),
            "versions": versions(),
            "cost": {slot: {"seconds": s, "steps": n} for slot, (s, n) in cost.items()},
        }
    )


def read_summary(file: Path, key: str = "RUN") -> dict[str, Any]:
    """A summary.json. InputError: with this key where it is none, else with the key in it that is wrong."""
    data = read_object(file, key, "a summary.json")
    checked(_Summary, Document(data, file, {(): Place(str(file))}, kind="summary"))
    return data


def numbers_in(summary: Mapping[str, Any]) -> dict[str, float | None]:
    """Numbers of a summary by name, None of what was not measured; of several machines as `machine.name`."""
    parts = {"": summary} | {f"{name}.": own for name, own in summary.get("machines", {}).items()}
    return {
        f"{of}{k}": v for of, part in parts.items() for k, v in part.items()
        if v is None or (isinstance(v, int | float) and not isinstance(v, bool))
    }  # fmt: skip


@cache
def versions() -> dict[str, str]:
    """Versions of what results depend on."""
    found = {}
    for part in PARTS:
        try:
            found[part.removesuffix("-lang")] = version(part)
        except PackageNotFoundError:
            continue
    return {
        **found,
        "python": platform.python_version(),
        "c_library": " ".join(platform.libc_ver()).strip() or platform.system(),
        "platform": f"{platform.system()} {platform.machine()}",
        "processor": processor(),
    }


def processor() -> str:
    """Name of the processor, and the widest vectors that it has."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    about = dict(reversed([line.replace("\t", "").split(": ", 1) for line in lines if ": " in line]))
    flags = about.get("flags", "").split()
    wide = [name for flag, name in (("avx2", "AVX2"), ("avx512f", "AVX-512")) if flag in flags][-1:]
    return ", ".join([about.get("model name", platform.machine()).strip(), *wide])


def write_summary(folder: Path, summary: Mapping[str, Any]) -> Path:
    """Write `summary.json` into the run folder in one go and return its path."""
    return write_json(folder / "summary.json", summary)
