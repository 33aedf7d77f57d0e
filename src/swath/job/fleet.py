"""The file of a job: the field, its crop, how it is worked, and the machines that do it.

format: swath fleet 1
field: {boundary_m: [[0, 0], [800, 0], [800, 600], [0, 600]], yield_t_ha: 8}
combines: {combine: {machine: lexion-700}}
carts: {cart: {machine: tractor-grain-cart}}
"""

from dataclasses import dataclass
from dataclasses import field as made
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, MinLen

from swath.core.errors import InputError
from swath.documents.data_sheets import find_sheet
from swath.documents.validation import validate
from swath.documents.yaml_document import Document, KeyPath, parse_value, read_document
from swath.job.lands import PlanSettings
from swath.scenario.section_reader import NAME

FORMAT = "swath fleet 1"
Metre = Annotated[float, Ge(-1e6), Le(1e6)]


@dataclass(frozen=True)
class FieldSettings:
    """One of the first three. boundary_m: points [x, y], east and north; file: a plan of others (GeoJSON,
    ISOXML) or the outline of a field; log: a yield log, whose recorded passes are driven; yield_t_ha: grain,
    even over the field
    """

    boundary_m: Annotated[list[tuple[Metre, Metre]], MinLen(3)] | None = None
    file: str | None = None
    log: str | None = None
    yield_t_ha: Annotated[float, Gt(0), Le(30)] = 8.0


@dataclass(frozen=True)
class CombineSettings:
    """machine: its data sheet; speed_kmh: fastest in the crop; grain_kg_s: most that it threshes (default:
    the data sheet's nominal flow); turn_speed_kmh, turn_radius_m: in turns; transport_speed_kmh: on longer
    ways; call_percent: of the tank, at which a cart is called, or before, where it would be full in passes
    beside which no cart may drive; tank_start_percent: at the start
    """

    machine: str = "lexion-700"
    speed_kmh: Annotated[float, Gt(0), Le(20)] = 7.3
    grain_kg_s: Annotated[float, Gt(0), Le(100)] | None = None
    turn_speed_kmh: Annotated[float, Gt(0), Le(20)] = 7.0
    turn_radius_m: Annotated[float, Gt(3), Le(50)] = 6.4
    transport_speed_kmh: Annotated[float, Gt(0), Le(40)] = 12.0
    call_percent: Annotated[float, Ge(0), Le(100)] = 60.0
    tank_start_percent: Annotated[float, Ge(0), Le(100)] = 0.0


@dataclass(frozen=True)
class CartSettings:
    """machine: its data sheet; speed_kmh: on the field; unload_l_s: into the truck; leave_percent: of its
    box, from which it drives to the truck after a load, unless it has room for all that is still to come;
    fill_percent: of the largest heap, at which it is full; align_s: beside the combine until pipe, cart and
    trailer are in line
    """

    machine: str = "tractor-grain-cart"
    speed_kmh: Annotated[float, Gt(0), Le(40)] = 15.0
    unload_l_s: Annotated[float, Gt(10), Le(2000)] = 350.0
    leave_percent: Annotated[float, Gt(0), Le(100)] = 60.0
    fill_percent: Annotated[float, Gt(10), Le(100)] = 95.0
    align_s: Annotated[float, Ge(0), Le(300)] = 15.0


@dataclass(frozen=True)
class TruckSettings:
    """Where grain is handed over. machine: the truck's data sheet; x_m, y_m: where carts empty, beside it;
    volume_m3: of all trucks that wait, none = it never ends; away_min: until the next has come; dock_s: until
    a cart stands beside it and is gone again
    """

    machine: str = "grain-truck"
    x_m: Metre = 0.0
    y_m: Metre = 0.0
    volume_m3: Annotated[float, Gt(1), Le(10_000)] | None = None
    away_min: Annotated[float, Ge(0), Le(600)] = 40.0
    dock_s: Annotated[float, Ge(0), Le(600)] = 45.0


@dataclass(frozen=True)
class UnloadSettings:
    """mode: `on_the_go` while cutting; `standing` where the tank is full; `at_headland` at the end of a pass.

    at_row_end: what happens to a load that the end of the pass cuts short: `finish` standing there when no
    more than `finish_s` are left, or where no cart may drive beside the next pass, `resume` in a later pass;
    finish_s: longest that it is finished for; pocket_s: until a cart can stand beside a combine that has
    standing crop on its left; ramps_s: of the auger's flow, as time lost
    """

    mode: Literal["on_the_go", "standing", "at_headland"] = "on_the_go"
    at_row_end: Literal["finish", "resume"] = "finish"
    finish_s: Annotated[float, Ge(0), Le(600)] = 30.0
    pocket_s: Annotated[float, Ge(0), Le(600)] = 40.0
    ramps_s: Annotated[float, Ge(0), Le(60)] = 1.75


@dataclass(frozen=True)
class TeamSettings:
    """together: `own_lands`, each combine takes the next pass of its own land; `echelon`, side by side;
    lag_m: in echelon, of each behind the one ahead
    """

    together: Literal["own_lands", "echelon"] = "own_lands"
    lag_m: Annotated[float, Ge(5), Le(500)] = 40.0


@dataclass(frozen=True, kw_only=True)
class FleetFile:
    """A job as written. format: `swath fleet 1`; name, summary: of the job, on its page; field, combines,
    carts, truck, plan, unload, team: see there
    """

    format: str
    field: FieldSettings
    combines: dict[str, CombineSettings]
    carts: dict[str, CartSettings] = made(default_factory=dict)
    truck: TruckSettings = TruckSettings()
    plan: PlanSettings = made(default_factory=PlanSettings)
    unload: UnloadSettings = UnloadSettings()
    team: TeamSettings = TeamSettings()
    name: str = "job"
    summary: str = ""


def read_fleet(name: str, changes: tuple[str, ...] = ()) -> tuple[FleetFile, Document]:
    """A bundled job by name, or a file. changes: `combines.combine.speed_kmh=5` and the like.

    Raises InputError with key, value, file and line; its `others` are what else is wrong.
    """
    document = read_document(find_sheet("jobs", name))
    document.kind = "job"
    if not isinstance(document.data, dict):
        raise document.error((), None, "expected a mapping of keys")
    for change in changes:
        _set(document, change)
    if document.data.get("format") != FORMAT:
        raise document.error(("format",), document.data.get("format"), f"expected `{FORMAT}`")
    made, errors = validate(FleetFile, document.data, (), document)
    if errors:
        errors[0].others = tuple(errors[1:])
        raise errors[0]
    assert isinstance(made, FleetFile)
    _check(made, document)
    return made, document


def _set(document: Document, change: str) -> None:
    """Change one key of a job as read."""
    key, equals, text = change.partition("=")
    path: KeyPath = tuple(key.strip().split("."))
    if not equals or not all(path):
        raise InputError("--set", change, "expected KEY=VALUE")
    node = document.data
    for part in path[:-1]:
        if node.get(part) is None:
            node[part] = {}
        node = node[part]
        if not isinstance(node, dict):
            raise InputError("--set", change, f"expected a section, {part} is none")
    node[path[-1]] = parse_value(text, "--set")


def _check(made: FleetFile, document: Document) -> None:
    """What no single key shows."""
    given = [k for k in ("boundary_m", "file", "log") if getattr(made.field, k) is not None]
    if len(given) != 1:
        said = " and ".join(given) or None
        raise document.error(("field",), said, "expected one of boundary_m, file and log")
    if not made.combines:
        raise document.error(("combines",), None, "expected at least one combine")
    both = set(made.combines) & set(made.carts)
    if both:
        raise document.error(("carts", sorted(both)[0]), None, "expected another name, a combine has it")
    for section in ("combines", "carts"):
        for name in getattr(made, section):
            if not NAME.match(name):
                expected = "expected a machine's name: letters, digits, - and _"
                raise document.error((section, name), None, expected)
        if "truck" in getattr(made, section):
            raise document.error((section, "truck"), None, "expected another name, the truck has it")
    if made.unload.mode == "on_the_go" and not made.carts:
        expected = "expected a cart to unload into on the go; without: `standing` or `at_headland`"
        raise document.error(("unload", "mode"), made.unload.mode, expected)


def base_of(document: Document) -> Path | None:
    """Folder that relative paths of a job start from."""
    place = document.place(("format",))
    return None if place is None or place.file is None else Path(place.file).parent
