"""What TASKDATA.XML of ISO 11783-10 says: fields, crops, machines and tasks. What is not used is named.

Types of polygons, lines, points and patterns after ISO 11783-10:2015, schema 4.3; version 3 has some of them.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swath.field_io import trade
from swath.field_io.task_data.taskfiles import DEEPEST, Node, hex_number, number, read_tree

Array = NDArray[np.float64]
READ = ("CTP", "CVT", "PFD", "PLN", "LSG", "GGP", "GPN", "TSK", "DAN", "TLG", "DVC", "DET", "DOR", "DPT",
        "DPD", "DVP", "XFR")  # fmt: skip
"""Elements that are read, and PNT."""
LEFT_OUT = {"TZN": "treatment zone", "GRD": "grid", "TIM": "entry of a task's times and totals"}
RECORDS = ("AFE", "ASP", "BSN", "CAN", "CAT", "CCG", "CCT", "CLD", "CNN", "CPC", "CTR", "DLT", "FRM", "GAN",
           "OTP", "OTQ", "PAN", "PDT", "PGP", "TCC", "VPN", "WAN", "WKR")  # fmt: skip
"""Elements about people, products and allocations: they say nothing of ground, crop and machine."""

POLYGONS = {
    "1": ("field", "field boundary"), "2": ("", "treatment zone"), "3": ("bare", "water surface"),
    "4": ("bare", "building"), "5": ("bare", "road"), "6": ("bare", "obstacle"),
    "7": ("bare", "flagged area"), "8": ("bare", "other area"), "9": ("part", "main field"),
    "10": ("part", "headland"), "11": ("", "buffer zone"), "12": ("bare", "windbreak"),
}  # fmt: skip
"""PLN.A -> role and name. field: crop stands in it; bare: none does; part: of a field, which together make
one that has no boundary of its own."""
EXTERIOR, INTERIOR, GUIDANCE = "1", "2", "5"  # of LSG.A
LINES = {
    EXTERIOR: "ring without a polygon", INTERIOR: "ring without a polygon", "3": "tramline",
    "4": "sampling route", GUIDANCE: "guidance line", "6": "drain", "7": "fence", "8": "flagged line",
    "9": "obstacle line",
}  # fmt: skip
POINTS = {
    "1": "flag", "2": "point", "3": "field entrance", "4": "storage place", "5": "obstacle point",
    "9": "guidance point", "10": "reference point", "11": "home base",
}  # fmt: skip
POINT_A, POINT_B, POINT_CENTRE = "6", "7", "8"  # of PNT.A
AB, A_PLUS, CURVE, PIVOT, SPIRAL = "1", "2", "3", "4", "5"  # of GPN.C
PATTERNS = {AB: "AB line", A_PLUS: "A+ line", CURVE: "curve", PIVOT: "pivot", SPIRAL: "spiral"}
CLOCKWISE, COUNTER_CLOCKWISE = "1", "2"  # of GPN.D, of a pivot; else a full circle
FUNCTION, SECTION, UNIT = "2", "4", "5"  # of DET.C
WIDTHS = {67: "actual", 68: "default", 70: "maximum"}
"""DDI of a working width [mm], the one first that says most of the ground that is covered."""
YIELDS = (84, 87, 181, 182)  # DDI of grain per area and per time, as harvested and dry


class Polygon(NamedTuple):
    """name: of its type; exteriors, interiors: rings, lon/lat [deg], (n, 2) each."""

    name: str
    exteriors: list[Array]
    interiors: list[Array]


@dataclass(frozen=True)
class Pattern:
    """Guidance as it is stored. kind: of PATTERNS; types: of its points, lon/lat [deg], shape (n, 2).

    heading: clockwise from north [deg], radius [m], nan = none
    turn: of a pivot
    name: of its tracks
    """

    kind: str
    types: tuple[str, ...]
    points: Array
    heading: float = np.nan
    radius: float = np.nan
    turn: str = ""
    name: str = "guidance line"


@dataclass
class Part:
    """A field (partfield). crop: its name, '' = none; polygons: by their role; unused: name -> count."""

    name: str
    crop: str
    polygons: dict[str, list[Polygon]] = field(default_factory=dict)
    guidance: list[Pattern] = field(default_factory=list)
    unused: Counter[str] = field(default_factory=Counter)

    @property
    def boundary(self) -> list[Polygon]:
        """What encloses it: the boundary, else the parts of it."""
        return self.polygons.get("field") or self.polygons.get("part") or []

    @property
    def rough_area(self) -> float:
        """Inside its boundary [deg2 of latitude], to compare it with others."""
        sizes = (abs(_signed(ring)) for polygon in self.boundary for ring in polygon.exteriors)
        holes = (abs(_signed(ring)) for polygon in self.boundary for ring in polygon.interiors)
        return float(sum(sizes) - sum(holes))


class Value(NamedTuple):
    """How a device shows a logged integer: label, unit, and (integer + offset) * scale."""

    label: str = ""
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0


class DeviceElement(NamedTuple):
    """kind: of DET.C; parent: object id; properties: DDI -> integer."""

    kind: str
    parent: str
    properties: dict[int, float]


@dataclass
class Device:
    """elements: by their id; objects: object id -> id of an element; loose: properties of no element."""

    name: str
    elements: dict[str, DeviceElement] = field(default_factory=dict)
    objects: dict[str, str] = field(default_factory=dict)
    loose: dict[int, float] = field(default_factory=dict)

    def above(self, element: str) -> list[str]:
        """The elements that an element is part of, the nearest first, as far as no circle closes."""
        found = [element]
        while element in self.elements and len(found) < DEEPEST:
            element = self.objects.get(self.elements[element].parent, "")
            if element in found or not element:
                break
            found.append(element)
        return found[1:]

    def whole(
        self, of: Collection[str], marks: Collection[str] = (), size: Callable[[str], float] = lambda _: 0.0
    ) -> list[str]:
        """The numbers of those elements that together make up the machine's header.

        Of several parts the one counts that is marked (has the yield), else the largest.
        """
        parts, marked = self.parts(of, marks)
        return parts[max(marked or parts, key=lambda p: sum(map(size, parts[p])))]

    def parts(
        self, of: Collection[str], marks: Collection[str] = ()
    ) -> tuple[dict[str, list[str]], list[str]]:
        """Part -> those of the elements that together make it up, and which parts are marked.

        What is part of another one of them is in that. Sections of the same part stand beside each other.
        """
        all_of = set(of)
        tops = [e for e in of if all_of.isdisjoint(self.above(e))] or list(of)
        parts: dict[str, list[str]] = {}
        for e in tops:
            is_section = e in self.elements and self.elements[e].kind in (SECTION, UNIT)
            parts.setdefault(next(iter(self.above(e)), e) if is_section else e, []).append(e)
        with_mark = {above for m in marks for above in (m, *self.above(m))}
        return parts, [p for p in parts if p in with_mark]

    def stated_width(self, ddi: int, marks: Collection[str] = ()) -> float:
        """A working width of its properties [m], 0 = none."""
        there = {e: d.properties[ddi] for e, d in self.elements.items() if d.properties.get(ddi, 0.0) > 0.0}
        if there:
            return sum(there[e] for e in self.whole(there, marks, there.__getitem__)) / 1000.0
        return max(self.loose.get(ddi, 0.0), 0.0) / 1000.0


class Task(NamedTuple):
    """part: id of its field; devices: ids of those allocated to it."""

    part: str
    devices: tuple[str, ...]


@dataclass
class Description:
    """What TASKDATA.XML and the files it refers to say; ids are those of the file.

    values: by device and DDI
    logs: name -> task; lengths: name -> bytes that its file has, where that is said
    owners: device element -> device
    problems: what could not be read
    unused: name -> count
    """

    parts: dict[str, Part] = field(default_factory=dict)
    crops: dict[str, str] = field(default_factory=dict)
    devices: dict[str, Device] = field(default_factory=dict)
    tasks: dict[str, Task] = field(default_factory=dict)
    logs: dict[str, str] = field(default_factory=dict)
    lengths: dict[str, float] = field(default_factory=dict)
    owners: dict[str, str] = field(default_factory=dict)
    values: dict[tuple[str, int], Value] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    unused: Counter[str] = field(default_factory=Counter)

    def crop_of(self, part: str) -> str:
        """The crop's name that a field has, else that of the list; '' = none is named.

        Of a list of crops with different data sheets all are named, which is no crop's name.
        """
        own = self.parts[part].crop if part in self.parts else ""
        listed = list(dict.fromkeys(name for name in self.crops.values() if name))
        if own or not listed:
            return own
        return (
            listed[0] if len({trade.sheet_of(name) or name for name in listed}) == 1 else " or ".join(listed)
        )

    def width_of(self, devices: Iterable[str], marks: Collection[str] = ()) -> tuple[float, str]:
        """The working width of the properties of machines [m] and what it is; 0 where they say none.

        Of machines with different widths it is the first's that has one.
        """
        for device in devices:
            for ddi, kind in WIDTHS.items():
                width = self.devices[device].stated_width(ddi, marks)
                if width:
                    return width, f"{kind} working width of {self.devices[device].name or device}"
        return 0.0, ""


def listed(counts: Mapping[str, int]) -> str:
    """`grid (2), flag`, without what is not there."""
    return ", ".join(f"{name} ({n})" if n > 1 else name for name, n in counts.items() if n)


def read_description(files: Mapping[str, bytes]) -> Description:
    """Read TASKDATA.XML and the files it refers to; files: upper-case name -> content."""
    made = Description()
    names, tops = ["TASKDATA.XML"], []
    for name in names:
        if name not in files:
            made.problems.append(f"damaged: {name}: referenced, but missing")
            continue
        tree = read_tree(files[name], READ)
        if tree.problem:
            made.problems.append(f"damaged: {name}: {tree.problem}; the rest of it is left out")
        for tag, count in tree.others.items():
            if tag not in RECORDS:
                made.unused[LEFT_OUT.get(tag, f"element {tag}")] += count
        tops += tree.top.children
        linked = [f"{x.get('A').upper()}.XML" for top in tree.top.children for x in top.of("XFR")]
        names += [link for link in dict.fromkeys(linked) if link not in names]
    varieties: dict[str, str] = {}
    for listed_crop in _all(tops, "CTP"):
        made.crops[listed_crop.get("A")] = listed_crop.get("B")
        varieties |= {v.get("A"): listed_crop.get("A") for v in listed_crop.of("CVT")}
    for device in _all(tops, "DVC"):
        _take_device(device, made)
    for part in _all(tops, "PFD"):
        crop = made.crops.get(part.get("G"), "") or made.crops.get(varieties.get(part.get("H"), ""), "")
        made.parts[part.get("A")] = _part(part, crop)
    for task in _all(tops, "TSK"):
        devices = tuple(d.get("C") for d in task.of("DAN"))
        made.tasks[task.get("A")] = Task(task.get("E"), devices)
        made.logs |= {log.get("A").upper(): task.get("A") for log in task.of("TLG") if log.get("A")}
        made.lengths |= {log.get("A").upper(): number(log.get("B"), 0.0) for log in task.of("TLG")}
    return made


def _all(tops: list[Node], tag: str) -> list[Node]:
    return [node for top in tops for node in top.of(tag)]


def _take_device(node: Node, made: Description) -> None:
    """A device, and labels and scaling of the values of its elements."""
    name, device = node.get("A"), Device(node.get("B"))
    made.devices[name] = device
    stated = {d.get("A"): (hex_number(d.get("B")), number(d.get("C"), 0.0)) for d in node.of("DPT")}
    used = set()
    for e in node.of("DET"):
        refers = [r.get("A") for r in e.of("DOR") if r.get("A") in stated]
        own = {ddi: value for ddi, value in map(stated.__getitem__, refers) if ddi is not None}
        used |= set(refers)
        device.elements[e.get("A")] = DeviceElement(e.get("C"), e.get("F"), own)
        device.objects[e.get("B")] = e.get("A")
        made.owners[e.get("A")] = name
    for key, (ddi, value) in stated.items():
        if ddi is not None and key not in used:
            device.loose[ddi] = max(value, device.loose.get(ddi, 0.0))
    shown = {d.get("A"): d for d in node.of("DVP")}
    for d in node.of("DPD"):
        ddi, as_shown = hex_number(d.get("B")), shown.get(d.get("F"), Node("DVP", {}))
        scale, offset = number(as_shown.get("C"), 1.0), number(as_shown.get("B"), 0.0)
        if ddi is not None:
            made.values[name, ddi] = Value(d.get("E").strip(), as_shown.get("E"), scale, offset)


def _part(node: Node, crop: str) -> Part:
    part = Part(node.get("C"), crop)
    for polygon in node.of("PLN"):
        role, name = POLYGONS.get(polygon.get("A"), ("", f"polygon of type {polygon.get('A')!r}"))
        rings = {kind: _rings(polygon, kind, part) for kind in (EXTERIOR, INTERIOR)}
        if not rings[EXTERIOR]:
            part.unused[f"{name} without a ring"] += 1
        elif role:
            part.polygons.setdefault(role, []).append(Polygon(name, rings[EXTERIOR], rings[INTERIOR]))
        else:
            part.unused[name] += 1
    if "field" in part.polygons:
        part.unused.update(polygon.name for polygon in part.polygons.pop("part", []))
    for line in node.of("LSG"):
        if line.get("A") == GUIDANCE:  # as version 3 writes it
            _take_pattern(Pattern(CURVE if len(line.points) > 2 else AB, *_points(line)), part)
        else:
            part.unused[LINES.get(line.get("A"), f"line of type {line.get('A')!r}")] += 1
    for kind, *_ in node.points:
        part.unused[POINTS.get(kind, f"point of type {kind!r}")] += 1
    for group in node.of("GGP"):
        part.unused["boundary of guidance"] += len(group.of("PLN"))
        for gpn in group.of("GPN"):
            part.unused["boundary of guidance"] += len(gpn.of("PLN"))
            heading, radius = number(gpn.get("G"), np.nan), number(gpn.get("H"), np.nan) / 1000.0
            for line in gpn.of("LSG"):
                made = Pattern(gpn.get("C"), *_points(line), heading, radius, gpn.get("D"))
                _take_pattern(made, part)
    return part


def _points(line: Node) -> tuple[tuple[str, ...], Array]:
    places = np.array([place for _, *place in line.points], dtype=float).reshape(-1, 2)
    return tuple(kind for kind, *_ in line.points), places


def _rings(polygon: Node, kind: str, part: Part) -> list[Array]:
    """The rings of a type that have at least three places."""
    found = [_points(line)[1] for line in polygon.of("LSG") if line.get("A") == kind]
    good = [ring for ring in found if len(ring) >= 3 and np.isfinite(ring).all()]
    part.unused["ring without its places"] += len(found) - len(good)
    return good


def _signed(ring: Array) -> float:
    """Area of a ring [deg2 of latitude], > 0 counter-clockwise."""
    lon, lat = (ring - ring[0]).T
    lon = lon * np.cos(np.radians(ring[0, 1]))
    return 0.5 * float(lon @ np.roll(lat, -1) - lat @ np.roll(lon, -1))


def _take_pattern(pattern: Pattern, part: Part) -> None:
    """Put guidance to its field, where its numbers say which lines it is of."""
    name = PATTERNS.get(pattern.kind, f"guidance of type {pattern.kind!r}")
    count, on_earth = len(pattern.points), bool((np.abs(pattern.points) <= (180.0, 90.0)).all())
    missing = ""
    if pattern.kind == A_PLUS and not np.isfinite(pattern.heading):
        missing = " without a heading"
    elif pattern.kind == PIVOT and count < 2 and not pattern.radius > 0.0:
        missing = " without a radius"
    if pattern.kind not in PATTERNS or missing:
        part.unused[name + missing] += 1
    elif not on_earth or count < (1 if pattern.kind in (A_PLUS, PIVOT) else 2):
        part.unused[f"{name} without its places"] += 1
    else:
        part.guidance.append(pattern)


def drawn(pattern: Pattern) -> Array:
    """A pattern's own line, lon/lat [deg], shape (n, 2): two points of a straight one, all others of a curve,
    the circle or arc of a pivot at every degree.
    """
    points, of = pattern.points, dict(zip(pattern.types, pattern.points, strict=True))
    if pattern.kind == AB:
        return np.array([of.get(POINT_A, points[0]), of.get(POINT_B, points[-1])])
    if pattern.kind == A_PLUS:
        start = of.get(POINT_A, points[0])
        return np.array([start, *_off(start, np.array([pattern.heading]), 100.0)])
    if pattern.kind != PIVOT:
        return points
    centre = of.get(POINT_CENTRE, points[0])
    rim = [of.get(kind, points[i] if i < len(points) else None) for i, kind in ((1, POINT_A), (2, POINT_B))]
    begin, radius = (0.0, pattern.radius) if rim[0] is None else _course(centre, rim[0])
    sweep = 360.0
    if rim[1] is not None and pattern.turn in (CLOCKWISE, COUNTER_CLOCKWISE):
        sweep = (_course(centre, rim[1])[0] - begin) % 360.0 or 360.0
        sweep = sweep if pattern.turn == CLOCKWISE else sweep - 360.0
    count = int(np.ceil(abs(sweep))) + 1
    return _off(centre, begin + np.linspace(0.0, sweep, count), radius)


def pivot_radius(pattern: Pattern) -> float:
    """Radius of its own circle [m]."""
    centre = dict(zip(pattern.types, pattern.points, strict=True)).get(POINT_CENTRE, pattern.points[0])
    return _course(centre, drawn(pattern)[0])[1]


def _off(start: Any, azimuth: Array, distance: float) -> Array:
    """Places at azimuths [deg] and a distance [m] from one, lon/lat [deg], shape (n, 2)."""
    from swath.field.maps.projection import ellipsoid

    n = len(azimuth)
    lon, lat, _ = ellipsoid().fwd(np.full(n, start[0]), np.full(n, start[1]), azimuth, np.full(n, distance))
    return np.stack([lon, lat], axis=1)


def _course(start: Any, end: Any) -> tuple[float, float]:
    """Azimuth [deg] and distance [m] from one place to another."""
    from swath.field.maps.projection import ellipsoid

    azimuth, _, distance = ellipsoid().inv(*start, *end)
    return float(azimuth), float(distance)
