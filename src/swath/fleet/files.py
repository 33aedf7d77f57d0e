"""The file of a job: the field, its crop, how it is worked, and the machines that do it.

format: swath fleet 1
field:
  boundary_m: [[0, 0], [800, 0], [800, 600], [0, 600]]
  holes_m: [[[90, 80], [130, 80], [110, 120]]]
  yield_t_ha: 8
combines: {combine: {machine: lexion-700}}
carts: {cart: {machine: tractor-grain-cart}}
truck: {x_m: 20, y_m: -30}
"""

from dataclasses import dataclass
from dataclasses import field as made
from typing import Annotated

from annotated_types import Ge, Gt, Le, MinLen

from swath.documents.data_sheets import find_sheet
from swath.documents.validation import validate
from swath.documents.yaml_document import Document, read_document

FORMAT = "swath fleet 1"
Metre = Annotated[float, Ge(-1e7), Le(1e7)]
Ring = Annotated[list[tuple[Metre, Metre]], MinLen(3)]


@dataclass(frozen=True)
class FieldSettings:
    """boundary_m: points [x, y], east and north; holes_m: ponds and islands in it; parts_m: outlines of
    further parts of the field; around_m: ground beyond the outlines that may be driven on; yield_t_ha: grain,
    even over the field
    """

    boundary_m: Ring
    holes_m: list[Ring] = made(default_factory=list)
    parts_m: list[Ring] = made(default_factory=list)
    around_m: Annotated[float, Ge(0), Le(200)] = 20.0
    yield_t_ha: Annotated[float, Gt(0), Le(30)] = 8.0


@dataclass(frozen=True)
class PlanSettings:
    """headland_rounds: cut along the outlines before the passes; land_passes: most passes of a land, cut
    round and round; overlap_m: of the header over what is cut, in each pass
    """

    headland_rounds: Annotated[int, Ge(0), Le(20)] = 1
    land_passes: Annotated[int, Ge(1), Le(200)] = 12
    overlap_m: Annotated[float, Ge(0.05), Le(3)] = 0.2


@dataclass(frozen=True)
class CombineSettings:
    """machine: its data sheet; header_width_m: another header on it; speed_kmh: fastest in the crop;
    grain_kg_s: most that it threshes (default: the data sheet's nominal flow); turn_speed_kmh, turn_radius_m:
    in turns; transport_speed_kmh: on straights of ways; call_percent: of the tank, from which a cart may come;
    tank_start_percent: in it at the start
    """

    machine: str = "lexion-700"
    header_width_m: Annotated[float, Ge(1), Le(20)] | None = None
    speed_kmh: Annotated[float, Gt(0), Le(20)] = 7.3
    grain_kg_s: Annotated[float, Gt(0), Le(100)] | None = None
    turn_speed_kmh: Annotated[float, Gt(0), Le(20)] = 7.0
    turn_radius_m: Annotated[float, Gt(3), Le(50)] = 6.4
    transport_speed_kmh: Annotated[float, Gt(0), Le(40)] = 12.0
    call_percent: Annotated[float, Ge(0), Le(100)] = 40.0
    tank_start_percent: Annotated[float, Ge(0), Le(100)] = 0.0


@dataclass(frozen=True)
class CartSettings:
    """machine: its data sheet; speed_kmh: on straights of ways; turn_radius_m: in turns; unload_l_s: into the
    truck; leave_percent: of its box, from which it drives to the truck; fill_percent: of the largest heap, at
    which it is full
    """

    machine: str = "tractor-grain-cart"
    speed_kmh: Annotated[float, Gt(0), Le(40)] = 15.0
    turn_radius_m: Annotated[float, Gt(4), Le(50)] = 9.0
    unload_l_s: Annotated[float, Gt(10), Le(2000)] = 350.0
    leave_percent: Annotated[float, Gt(0), Le(100)] = 60.0
    fill_percent: Annotated[float, Gt(10), Le(100)] = 95.0


@dataclass(frozen=True)
class TruckSettings:
    """Where grain is handed over. machine: the truck's data sheet; x_m, y_m: where carts empty, beside it;
    volume_m3: of all trucks that wait, none = it never ends; away_min: until the next has come; dock_s: until
    a cart stands beside it and is gone again
    """

    x_m: Metre
    y_m: Metre
    machine: str = "grain-truck"
    volume_m3: Annotated[float, Gt(1), Le(10_000)] | None = None
    away_min: Annotated[float, Ge(0), Le(600)] = 40.0
    dock_s: Annotated[float, Ge(0), Le(600)] = 45.0


@dataclass(frozen=True)
class FleetSettings:
    """dispatcher: `greedy`, or a Python file and class of your own as `my.py:Class`, see dispatcher.py"""

    dispatcher: str = "greedy"


@dataclass(frozen=True, kw_only=True)
class JobFile:
    """A job as written. format: `swath fleet 1`; name, summary: of the job; field, plan, combines, carts,
    truck, fleet: see there
    """

    format: str
    field: FieldSettings
    combines: dict[str, CombineSettings]
    truck: TruckSettings
    carts: dict[str, CartSettings] = made(default_factory=dict)
    plan: PlanSettings = PlanSettings()
    fleet: FleetSettings = FleetSettings()
    name: str = "job"
    summary: str = ""


def read_job(name: str) -> tuple[JobFile, Document]:
    """A bundled job by name, or a file. Raises InputError with key, value, file and line; its `others` are
    what else is wrong.
    """
    document = read_document(find_sheet("jobs", name))
    document.kind = "job"
    if not isinstance(document.data, dict):
        raise document.error((), None, "expected a mapping of keys")
    if document.data.get("format") != FORMAT:
        raise document.error(("format",), document.data.get("format"), f"expected `{FORMAT}`")
    job, errors = validate(JobFile, document.data, (), document)
    if errors:
        errors[0].others = tuple(errors[1:])
        raise errors[0]
    assert isinstance(job, JobFile)
    if not job.combines:
        raise document.error(("combines",), None, "expected at least one combine")
    for name in job.carts:
        if name in job.combines:
            raise document.error(("carts", name), None, "expected another name, a combine has it")
    return job, document
