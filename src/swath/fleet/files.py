"""The file of a job: the field, its crop, how it is worked, and the machines that do it; fields from files
of others, task data, outlines, guidance lines, a yield log.

format: swath fleet 1
field:
  boundary_m: [[0, 0], [800, 0], [800, 600], [0, 600]]
  holes_m: [[[90, 80], [130, 80], [110, 120]]]
  yield_t_ha: 8
combines: {combine: {machine: lexion-700}}
carts: {cart: {machine: tractor-grain-cart}}
truck: {x_m: 20, y_m: -30}
"""

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as made
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from swath.core.errors import InputError, near_miss
from swath.core.number_text import num
from swath.documents.data_sheets import find_sheet, sheet_names
from swath.documents.validation import checked
from swath.documents.yaml_document import Document, read_mapping
from swath.scenario.overrides import change_of, put
from swath.scenario.section_reader import NAME

FORMAT = "swath fleet 1"
SQUARE = 10.0  # m, side of those in which the yield of a log is averaged, about a header wide
SHORT = 1.0  # m between the ends of a line, below which it has no direction
Metre = Annotated[float, Ge(-1e7), Le(1e7)]
Ring = Annotated[list[tuple[Metre, Metre]], MinLen(3)]
Line = Annotated[list[tuple[Metre, Metre]], MinLen(2)]


@dataclass(frozen=True)
class FieldSettings:
    """The field: an outline, a file or a yield log.

    With `file` or `log` all other places are in metres from the field's south-west corner, rounded down.

    boundary_m: outline, points [x, y], east and north. It is drawn with fewer of them, within 0.3 m, its area
        kept
    holes_m: outlines of ponds and islands in it, drawn the same way
    parts_m: outlines of further parts of the field
    around_m: width of the ground beyond the outlines that may be driven on
    yield_t_ha: yield of grain, the mean where a log says how it varies
    file: task data of ISO 11783-10, GeoJSON, KML or a shapefile, with all outlines. Lines in it are the
        passes where they cover at least half of the field, else they give the direction of the passes
    log: a yield log, with its ground, direction and yields
    ways_m: middles of ways outside of the field, 20 m wide, as between parts that lie apart, or to the truck
    """

    boundary_m: Ring = made(default_factory=list)
    holes_m: list[Ring] = made(default_factory=list)
    parts_m: list[Ring] = made(default_factory=list)
    around_m: Annotated[float, Ge(0), Le(200)] = 20.0
    yield_t_ha: Annotated[float, Gt(0), Le(30)] = 8.0
    file: str | None = None
    log: str | None = None
    ways_m: list[Line] = made(default_factory=list)


@dataclass(frozen=True)
class PlanSettings:
    """The passes.

    direction_deg: direction of the passes, counter-clockwise from east (default: along the longest side, or
        as the file of the field says)
    headland_rounds: number of rounds along the outlines that are cut before the passes
    headland: direction in which these rounds are driven; `clockwise` keeps the crop on the right
    order: order of the passes: `lands` round and round in lands, `adjacent` one after the other, `skip` with
        one left out that is cut on the return
    land_passes: greatest number of passes of a land
    overlap_m: overlap of the header over what is cut, in each pass
    passes_m: your own passes, each two points [x, y] of the header's middle or more on a straight line,
        driven in this order; nothing else is cut
    unload: where tanks are emptied: `anywhere`, or on `headland` passes and outside of the field alone
    """

    direction_deg: Annotated[float, Ge(-360), Le(360)] | None = None
    headland_rounds: Annotated[int, Ge(0), Le(20)] = 1
    headland: Literal["clockwise", "counterclockwise"] = "clockwise"
    order: Literal["lands", "adjacent", "skip"] = "lands"
    land_passes: Annotated[int, Ge(1), Le(200)] = 12
    overlap_m: Annotated[float, Ge(0.05), Le(3)] = 0.2
    passes_m: list[Line] = made(default_factory=list)
    unload: Literal["anywhere", "headland"] = "anywhere"


@dataclass(frozen=True)
class CombineSettings:
    """A combine.

    machine: name of its data sheet
    header_width_m: width of another header on it
    speed_kmh: greatest speed in the crop
    grain_kg_s: greatest flow of grain (default: the data sheet's nominal flow)
    turn_speed_kmh: speed in turns
    turn_radius_m: radius of turns
    transport_speed_kmh: speed on straight parts of paths
    call_percent: level of the tank from which a cart may come
    tank_start_percent: level of the tank at the start
    pipe: the side on which the unloading pipe is, the same for all combines
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
    pipe: Literal["left", "right"] = "left"


@dataclass(frozen=True)
class CartSettings:
    """A tractor with a grain cart.

    machine: name of its data sheet
    speed_kmh: speed on straight parts of paths
    turn_radius_m: radius of turns
    unload_l_s: flow of grain into the truck
    leave_percent: level of its box from which it drives to the truck
    fill_percent: share of the largest heap at which it is full
    """

    machine: str = "tractor-grain-cart"
    speed_kmh: Annotated[float, Gt(0), Le(40)] = 15.0
    turn_radius_m: Annotated[float, Gt(4), Le(50)] = 9.0
    unload_l_s: Annotated[float, Gt(10), Le(2000)] = 350.0
    leave_percent: Annotated[float, Gt(0), Le(100)] = 60.0
    fill_percent: Annotated[float, Gt(10), Le(100)] = 95.0


@dataclass(frozen=True)
class TruckSettings:
    """Where grain is handed over.

    x_m: east coordinate of the place where carts unload
    y_m: north coordinate of that place, beside the truck
    machine: name of the truck's data sheet
    volume_m3: volume of a truck, none = it never ends
    away_min: time until a truck that is full is back
    dock_s: time that a cart needs to drive up and to leave again
    trucks: number of trucks, which come there in turn
    gate_m: place [x, y] outside of the field at its gate (default: the point of the field nearest to the
        truck is the gate)
    """

    x_m: Metre
    y_m: Metre
    machine: str = "grain-truck"
    volume_m3: Annotated[float, Gt(1), Le(10_000)] | None = None
    away_min: Annotated[float, Ge(0), Le(600)] = 40.0
    dock_s: Annotated[float, Ge(0), Le(600)] = 45.0
    trucks: Annotated[int, Ge(1), Le(100)] = 1
    gate_m: tuple[Metre, Metre] | None = None


@dataclass(frozen=True)
class FleetSettings:
    """dispatcher: `horizon`, `greedy`, or a Python class of your own as `my.py:Class`, see dispatcher.py;
    plans: most that are compared, the best one is taken
    draw: number by which the estimates of `horizon` are off at random, as some of these plans have it, 0:
        they are not.
    """

    dispatcher: str = "horizon"
    plans: Annotated[int, Ge(1), Le(10_000)] = 4
    draw: Annotated[int, Ge(0), Le(10_000)] = 0


@dataclass(frozen=True, kw_only=True)
class JobKeys:
    """A job as written.

    format: `swath fleet 1`
    name: name of the job (default: its file's)
    summary: one line on its page
    """

    format: str
    field: FieldSettings
    combines: dict[str, CombineSettings]
    truck: TruckSettings
    carts: dict[str, CartSettings] = made(default_factory=dict)
    plan: PlanSettings = PlanSettings()
    fleet: FleetSettings = FleetSettings()
    name: str = ""
    summary: str = ""


@dataclass(frozen=True, kw_only=True)
class JobFile(JobKeys):
    """A job as read.

    drawn: lines of its file, [x, y] as passes are [m]
    yields: middles of squares of its log, x, y [m], and what it has there [kg/m2]
    notes: notes on it
    """

    drawn: tuple[Line, ...] = ()
    yields: tuple[tuple[float, float, float], ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def is_mirrored(self) -> bool:
        """Whether pipes are on the right: then its frame is mirrored, in which they are on the left."""
        return any(c.pipe == "right" for c in self.combines.values())


def job_schema() -> dict[str, Any]:
    """JSON Schema of job files, draft 2020-12, for editors."""
    from swath.scenario.schema import adopt

    defs: dict[str, Any] = {}
    job = adopt(JobKeys, "job", defs)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "swath job",
        "description": "A field, how it is worked, and the machines that do it.",
        **job,
        "properties": {**job["properties"], "format": {"const": FORMAT, "description": "of this file"}},
        "$defs": defs,
    }


RENAMED = {"echelon": "two-combines", "small-echelon": "small-two-combines"}  # bundled jobs of 0.2
COSTS_LESS = "a tank is emptied beside or standing, whatever costs less time"
GONE: dict[tuple[str, ...], str] = {  # keys of 0.2, and what is done now
    ("carts", "*", "align_s"): "until a cart is in line follows from its way",
    ("team", "together"): "combines share the field out among them in bands",
    ("team", "lag_m"): "combines share the field out among them in bands",
    ("unload", "mode"): COSTS_LESS,
    ("unload", "at_row_end"): COSTS_LESS,
    ("unload", "finish_s"): COSTS_LESS,
    ("unload", "pocket_s"): COSTS_LESS,
    ("unload", "ramps_s"): "the pipe swings as its data sheet says",
}
REFUSED = {  # values of them that ask for something else
    "echelon": "expected no such key: nothing drives in echelon now, combines share the field out in bands",
    "standing": "expected no such key: a dispatcher of your own that takes no `beside` does it",
    "at_headland": "expected no such key: `plan: {unload: headland}` does it",
}


def read_job(name: str, changes: Sequence[str] = ()) -> tuple[JobFile, Document]:
    """A bundled job by name, or a file. changes: `combines.combine.speed_kmh=5` and the like.

    Raises InputError with key, value, file and line; its `others` are what else is wrong.
    """
    file = job_sheet(name)
    document = read_mapping(file, "job")
    known = _machines(document.data)
    for change in changes:
        flag, path, value = change_of(f"--set {change}", change)
        put(document.data, path, _from_here(value), flag)
    for (section, machine), keys in _machines(document.data).items():
        if (section, machine) not in known and not (isinstance(keys, dict) and "machine" in keys):
            here = [own for kind, own in known if kind == section]
            expected = f"expected a machine that is there{near_miss(machine, here)}, or its `machine` with it"
            raise InputError(f"--set {section}.{machine}", None, expected)
    notes = tuple(_without_gone(document))
    if name in RENAMED:
        notes = (f"form: {name} is called {RENAMED[name]} now: nothing drives in echelon", *notes)
    if document.data.get("format") != FORMAT:
        raise document.error(("format",), document.data.get("format"), f"expected `{FORMAT}`")
    found: JobKeys = checked(JobKeys, document)
    job = JobFile(**vars(replace(found, name=found.name or file.stem)))
    if not job.combines:
        raise document.error(("combines",), None, "expected at least one combine")
    _check_machines(job, document)
    given = [bool(job.field.boundary_m), job.field.file is not None, job.field.log is not None]
    if given.count(True) != 1:
        raise document.error(("field",), None, "expected one of boundary_m, file and log")
    if not job.field.boundary_m:
        job, told = _with_field(job, base_of(document), "yield_t_ha" in document.data["field"])
        notes = (*notes, *told)
    job = replace(job, notes=notes)
    for section in ("combines", "carts"):
        for name in getattr(job, section):
            if not NAME.match(name) or name == "truck":
                expected = "expected a machine's name, not truck: at most 41 letters, digits, - and _"
                raise document.error((section, name), None, expected)
    for name in job.carts:
        if name in job.combines:
            raise document.error(("carts", name), None, "expected another name, a combine has it")
    return job, document


TYPES = {"combines": "combine", "carts": "tractor_with_trailer", "truck": "truck"}  # of data sheets


def _check_machines(job: JobFile, document: Document) -> None:
    """InputError for a data sheet that is not there, with those that serve in its place."""
    from swath.machine.machine_sheet import open_machine

    named = [(("combines", n), c.machine) for n, c in job.combines.items()]
    named += [(("carts", n), c.machine) for n, c in job.carts.items()]
    for path, machine in [*named, (("truck",), job.truck.machine)]:
        try:
            open_machine(machine, base_of(document))
        except InputError as error:
            if error.key != "machines":
                raise
            fits = [n for n in sheet_names("machines") if open_machine(n).value("type") == TYPES[path[0]]]
            expected = f"expected a file or one of {', '.join(fits)}{near_miss(machine, fits)}"
            raise document.error((*path, "machine"), machine, expected) from error


def job_sheet(name: str) -> Path:
    """The file of a bundled job, by its name or that of 0.2, or of the user's own."""
    return find_sheet("jobs", RENAMED.get(name, name))


def base_of(document: Document) -> Path | None:
    """Folder that relative paths of a job start from."""
    place = document.place(("format",))
    return None if place is None or place.file is None else Path(place.file).parent


def _machines(data: Mapping[str, Any]) -> dict[tuple[str, str], Any]:
    """Machines of a job as written, by section and name."""
    sections = ((kind, data.get(kind)) for kind in ("combines", "carts"))
    return {
        (kind, str(n)): keys for kind, own in sections if isinstance(own, dict) for n, keys in own.items()
    }


def _from_here(value: Any) -> Any:
    """A file, or `file.py:Class`, that the command line names, by its whole path."""
    if isinstance(value, str):
        file = value.rpartition(":")[0] if ".py:" in value else value
        if os.path.isfile(Path(file)):
            return str(Path(file).resolve()) + value[len(file) :]
    return value


def _without_gone(document: Document) -> Iterator[str]:
    """Take out keys of 0.2 that nothing reads now, each with a note. InputError for what is not done now."""
    for (section, *_, key), instead in GONE.items():
        found = document.data.get(section)
        if not isinstance(found, dict):
            continue
        inner = {(section,): found} if section != "carts" else {(section, n): v for n, v in found.items()}
        for path, node in inner.items():
            if not isinstance(node, dict) or key not in node:
                continue
            value, place = node.pop(key), document.place((*path, key))
            asks = REFUSED.get(value) if isinstance(value, str) else None
            if asks and (key != "mode" or document.data.get("carts")):
                raise document.error((*path, key), value, asks)
            where = "" if place is None or place.file is None else f" ({Path(place.file).name}:{place.line})"
            yield f"unused: {'.'.join((*path, key))} is read no more{where}: {instead}"
        if section != "carts" and not found:
            del document.data[section]


def _header(job: JobFile, base: Path | None) -> float:
    """Width of the narrowest header [m]."""
    from swath.machine.machine_sheet import load_machine

    sheets = [
        load_machine(c.machine, base=base, header_width_m=c.header_width_m) for c in job.combines.values()
    ]
    return min(sheet.header_width for sheet in sheets)


def _with_field(job: JobFile, base: Path | None, has_yield: bool) -> tuple[JobFile, list[str]]:
    """With the outlines of a file or log, and notes on them."""
    field, name = job.field, job.field.file or job.field.log
    assert name is not None
    path = Path(name) if base is None else base / name
    read = read_log_field(path) if field.file is None else read_field(path, _header(job, base))
    corner = np.floor(np.min([a.bounds[:2] for a in read.areas], axis=0))
    notes = [
        *read.notes,
        f"reference: origin of the field: {num(corner[0])}, {num(corner[1])} in EPSG:{read.epsg}",
    ]

    def ring(points: Any) -> Ring:
        return [(x - corner[0], y - corner[1]) for x, y, *_ in list(points.coords)[:-1]]

    first, *others = [ring(a.exterior) for a in read.areas]
    holes = [ring(h) for a in read.areas for h in a.interiors]
    field = replace(field, boundary_m=first, parts_m=others, holes_m=holes)
    if math.isfinite(read.grain) and not has_yield:
        field = replace(field, yield_t_ha=10.0 * read.grain)
        notes.append(f"derived: yield {num(field.yield_t_ha)} t/ha, the mean of the log")
    plan = job.plan
    if plan.direction_deg is None and math.isfinite(read.direction):
        plan = replace(plan, direction_deg=math.degrees(math.remainder(read.direction, math.pi)))
    lines = tuple([(x - corner[0], y - corner[1]) for x, y in line] for line in read.lines)
    yields = tuple((float(x - corner[0]), float(y - corner[1]), grain) for x, y, grain in read.yields)
    return replace(job, field=field, plan=plan, drawn=lines, yields=yields), notes


@dataclass(frozen=True)
class FileField:
    """areas: polygons [m] of a system, epsg; direction of its passes, counter-clockwise from east [rad], and
    grain, its mean yield [kg/m2], nan for none; notes: on what it was taken from; lines: points of each
    (n, 2) [m], in the order of the file; yields: x, y [m] of middles of squares, yield there [kg/m2].
    """

    areas: tuple[Any, ...]
    epsg: int
    direction: float = math.nan
    grain: float = math.nan
    notes: tuple[str, ...] = ()
    lines: tuple[Any, ...] = ()
    yields: tuple[tuple[float, float, float], ...] = ()


def read_field(path: Path, header: float) -> FileField:
    """Task data of ISO 11783-10, GeoJSON, KML or a shapefile. InputError for what is none.

    header: width of the strip [m] that each line covers, of which a file of lines alone is the field
    """
    from swath.field_io.outline import read_outlines
    from swath.field_io.task_data.isoxml import is_taskdata

    if not os.path.exists(path):
        raise InputError("field.file", str(path), "expected a file that is there")
    if path.suffix.lower() not in (".geojson", ".json", ".kml", ".kmz") and is_taskdata(path):
        return _of_taskdata(path)
    found = read_outlines(path, or_lines=True)
    doubts = found.doubts_of(range(len(found.areas)))
    made = FileField(found.areas, found.epsg, notes=(*found.notes, *doubts))
    return _along(made if made.areas else _under(made, found.lines, header), found.lines, "lines")


def _of_taskdata(path: Path) -> FileField:
    from swath.field_io.plan import in_metres, largest_part, read_plan
    from swath.field_io.task_data.taskdata import drawn, listed

    described = read_plan(path)
    if not described.parts:
        raise InputError("field.file", str(path), "expected a field with a boundary", file=path)
    key, polygon, epsg, notes = largest_part(described, path)
    unused = described.parts[key].unused + described.unused
    notes += [f"unused: {listed(unused)}"] if unused.total() else []
    made = FileField((polygon,), epsg, notes=(*notes, *described.problems))
    lines = [in_metres(drawn(p), epsg) for p in described.parts[key].guidance]
    return _along(made, lines, "guidance lines")


def _along(made: FileField, lines: Sequence[Any], what: str) -> FileField:
    """With the direction of the longest of some lines [m]."""
    drawn = tuple(line for line in lines if math.dist(line[0], line[-1]) > SHORT)
    if len(drawn) < len(lines):
        said = f"unused: {len(lines) - len(drawn)} of {len(lines)} {what} without a direction are left out"
        made = replace(made, notes=(*made.notes, said))
    if not drawn:
        return made
    longest = max(drawn, key=lambda line: math.dist(line[0], line[-1]))
    (ax, ay), (bx, by) = longest[[0, -1]].tolist()
    direction = math.atan2(by - ay, bx - ax)
    turned = f"{num(math.degrees(direction))} degrees counter-clockwise from east"
    said = f"derived: direction of the passes, that of the longest of {len(drawn)} {what}: {turned}"
    return replace(made, direction=direction, notes=(*made.notes, said), lines=drawn)


def _under(made: FileField, lines: Sequence[Any], header: float) -> FileField:
    """The ground under lines [m], the largest piece, gaps of less than a header closed."""
    import shapely  # of the extra of the projection, which is there

    strips = [shapely.LineString(line).buffer(0.5 * header, cap_style="flat") for line in lines]
    grown = shapely.union_all(strips).buffer(0.5 * header, join_style="mitre")
    ground = shapely.get_parts(grown.buffer(-0.5 * header, join_style="mitre"))
    if not len(ground):
        raise InputError("field.file", None, "expected an outline, or lines of passes")
    largest = max(ground, key=lambda part: part.area)
    said = f"derived: the file has no outline: the field is the {num(largest.area / 1e4)} ha under its lines"
    return replace(made, areas=(largest,), notes=(*made.notes, said))


def read_log_field(path: Path) -> FileField:
    """Ground that a yield log covers, with the direction of its passes and its mean yield."""
    from swath.field.maps.projection import Origin
    from swath.field_io.clean import clean
    from swath.field_io.importer import find_log
    from swath.field_io.logs.log import read_log
    from swath.field_io.outline import covered_ground
    from swath.field_io.passes import make_tracks, row_azimuth

    log = read_log(find_log(path))
    cleaned = clean(log)
    ground, notes = covered_ground(cleaned)
    origin = Origin(log.epsg, float(log.east.min()), float(log.north.min()))
    direction = 0.5 * math.pi - row_azimuth(make_tracks(cleaned, origin))
    known = cleaned.kept & np.isfinite(cleaned.grain)
    grain = float(cleaned.grain[known].mean()) if known.any() else math.nan
    yields, told = _in_squares(log.position[known], cleaned.grain[known])
    said = f"derived: passes are planned along those of the log, {num(math.degrees(direction))} degrees"
    return FileField(
        (ground,), log.epsg, direction, grain,
        (*log.notes, *notes, f"{said} counter-clockwise from east", *told), yields=yields,
    )  # fmt: skip


def _in_squares(position: Any, grain: Any) -> tuple[tuple[tuple[float, float, float], ...], list[str]]:
    """Mean yields of squares, and notes on them. position (n, 2) [m]; grain (n,) [kg/m2]."""
    if not len(grain):
        return (), []
    squares, number = np.unique(np.floor(position / SQUARE), axis=0, return_inverse=True)
    mean = np.bincount(number.ravel(), grain) / np.bincount(number.ravel())
    low, high = np.percentile(10.0 * mean, [5.0, 95.0])
    of_squares = f"{num(low)} to {num(high)} t/ha in 90 % of squares of {num(SQUARE)} m"
    told = f"derived: the yield varies as in the log, {of_squares}"
    middles = SQUARE * (squares + 0.5)
    return tuple(zip(*middles.T.tolist(), mean.tolist(), strict=True)), [f"{told}; elsewhere it is the mean"]
