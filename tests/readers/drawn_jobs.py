"""Drawn maps of fields: outlines, islands, roads, guidance and points in files of four kinds, as jobs of a
fleet and as outlines alone. What is true, and by which key a fault is told, is known before it is read.
"""

import json
import math
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from swath.field.maps.projection import transform
from tests.readers.verdict import Drawn, Got, Truth, verdict

PLACES = {  # latitude, longitude, UTM zone, another system there
    "Bavaria": (48.05, 11.03, 32632, 25832), "Iowa": (42.03, -93.53, 32615, 26915),
    "Pampa": (-34.1, -61.2, 32720, 5347), "Scania": (55.6, 13.4, 32633, 3006),
    "Rutland": (52.6, -0.7, 32630, 27700), "Riverina": (-34.6, 146.2, 32755, 28355),
    "Punjab": (30.9, 75.8, 32643, 7755),
}  # fmt: skip
FIELD_WORDS: list[dict[str, Any]] = [
    {}, {"kind": "field"}, {"landuse": "farmland"}, {"type": "Field Boundary"}, {"nutzung": "Ackerland"},
    {"name": "Am Feldweg"}, {"type": "boundary", "id": 7}, {"fclass": "farmland", "code": 7228},
    {"crop": "Winter wheat"}, {"Objektart": "Schlag"}, {"role": "parcel"}, {"tags": {"landuse": "meadow"}},
]  # fmt: skip
BARE_WORDS: list[dict[str, Any]] = [
    {"natural": "water"}, {"kind": "obstacle"}, {"type": "Island"}, {"building": "yes"}, {"art": "Teich"},
    {"kind": "pond", "name": "Old pond"}, {"fclass": "forest"}, {"natural": "wood"}, {"role": "exclusion"},
    {"kind": "Hindernis"}, {"man_made": "silo"}, {"natural": "scrub", "tags": {"leaf_type": "broadleaved"}},
]  # fmt: skip
ROAD_WORDS: list[dict[str, Any]] = [
    {"highway": "track"}, {"kind": "road"}, {"kind": "track", "highway": "track"}, {"type": "Feldweg"},
    {"highway": "residential", "name": "Hill Road"}, {"fclass": "track_grade2"}, {"class": "path"},
    {"highway": "unclassified", "surface": "gravel"}, {"art": "Straße"}, {"kind": "chemin"},
]  # fmt: skip
LINE_WORDS: list[dict[str, Any]] = [
    {}, {"type": "AB"}, {"kind": "guidance"}, {"name": "AB 1"},
    {"kind": "Leitlinie"}, {"role": "swath"}, {"name": "AB line 2"},
]  # fmt: skip
POINT_WORDS: list[dict[str, Any]] = [
    {"natural": "tree"}, {"kind": "depot"}, {"yield_t_ha": 7.1}, {}, {"kind": "truck"}, {"barrier": "gate"},
]  # fmt: skip
UNIT = {  # corners of shapes, in sides of a square; all hold the square from 0.2 to 0.48
    "rectangle": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "L": [(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)],
    "trapezium": [(0, 0), (1, 0.1), (0.8, 1), (0.1, 0.9)],
    "hexagon": [(0.1, 0.1), (0.6, 0), (1, 0.3), (0.9, 0.8), (0.4, 1), (0, 0.7)],
    "triangle": [(0, 0), (1.3, 0.1), (0, 1.3)],
    "circle": [(0.5 + 0.5 * math.cos(t), 0.5 + 0.5 * math.sin(t)) for t in np.arange(60) * math.pi / 30],
}  # fmt: skip
ISLANDS = ("none", "hole", "silent area", "area that says so", "two areas")
ROADS = ("none", "line beside", "line across", "area beside", "area across", "area over the edge")
FORMS = ("geojson job", "geojson", "kml", "kmz", "shapefile")
SYSTEMS = ("degrees", "CRS84", "UTM", "UTM by URN", "own", "UTM as text", "UTM by code")
HELD_OUT: dict[str, tuple[Any, ...]] = {
    "place": ("Rutland", "Riverina", "Punjab"), "shape": ("circle", "triangle"),
    "field says": tuple(map(str, FIELD_WORDS[7:])), "island says": tuple(map(str, BARE_WORDS[6:])),
    "road says": tuple(map(str, ROAD_WORDS[5:])), "line says": tuple(map(str, LINE_WORDS[4:])),
    "points": tuple(map(str, POINT_WORDS[4:])), "system": ("UTM as text", "UTM by code"),
    "road": ("area over the edge",), "form": ("kmz",),
    "fault": ("two laps", "island beyond the sea", "feet", "centimetres", "an infinite place", "two surveys"),
}  # fmt: skip
"""Axis -> values that are drawn with held_out alone."""

Array = np.ndarray


@dataclass
class Thing:
    """What becomes a feature: kind of its geometry, its rings or line [m], what it says."""

    kind: str
    rings: list[Any]
    said: dict[str, Any] = field(default_factory=dict)


@dataclass
class Map:
    """A map as it is made: things [m] from its corner; ground: of the field, its islands and roads out."""

    corner: Array
    epsg: int
    things: list[Thing]
    ground: Any
    direction: float = -1.0
    system: str = "degrees"
    own: int = 0
    turned: bool = False
    names_system: bool = True
    scale: float = 1.0
    texts: list[Callable[[str], str]] = field(default_factory=list)
    is_known: bool = True
    expected: set[str] = field(default_factory=set)


def _crossed(made: Map, rng: np.random.Generator) -> None:
    ring = made.things[0].rings[0]
    if len(ring) == 3:
        return
    at = 1 + len(ring) // 3
    ring[[1, at]] = ring[[at, 1]]
    made.is_known, made.expected = False, made.expected | {"outline"}


def _spike(made: Map, rng: np.random.Generator) -> None:
    ring = made.things[0].rings[0]
    out = ring[1] + 0.3 * (ring[1] - ring[0])
    made.things[0].rings[0] = np.vstack([ring[:2], out, ring[1:]])
    made.expected |= {"outline", "shape"}


def _two_laps(made: Map, rng: np.random.Generator) -> None:
    ring = made.things[0].rings[0]
    again = ring + rng.uniform(0.4, 1.5, ring.shape) * np.where(np.arange(len(ring))[:, None] % 2, 1.0, -1.0)
    made.things[0].rings[0] = np.vstack([ring, again])
    made.is_known, made.expected = False, made.expected | {"outline", "plausible"}


def _hole_outside(made: Map, rng: np.random.Generator) -> None:
    made.things[0].rings.append(_box(*(-90.0, -90.0), 25.0, 20.0))
    made.expected |= {"outline"}


def _no_number(made: Map, rng: np.random.Generator, value: float) -> None:
    ring = made.things[0].rings[0]
    ring[int(rng.integers(len(ring)))] = value
    made.is_known, made.expected = False, made.expected | {"damaged"}


def _flat(made: Map, rng: np.random.Generator) -> None:
    made.things[:] = [Thing("Polygon", [np.array([(0.0, 0.0), (50.0, 0.0), (100.0, 0.0)])])]
    made.is_known, made.expected = False, made.expected | {"plausible"}


def _vast(made: Map, rng: np.random.Generator) -> None:
    for thing in made.things:
        thing.rings = [ring * 400.0 for ring in thing.rings]
    made.is_known, made.expected = False, made.expected | {"plausible", "place"}


def _twice(made: Map, rng: np.random.Generator) -> None:
    first = made.things[0]
    made.things.append(Thing("Polygon", [r.copy() for r in first.rings], dict(first.said)))
    made.expected |= {"copies"}


def _scaled(made: Map, rng: np.random.Generator, by: float, off: float, key: str) -> None:
    first = made.things[0]
    middle, step = first.rings[0].mean(axis=0), off * np.ptp(first.rings[0], axis=0)
    moved = [(ring - middle) * by + middle + step for ring in first.rings]
    made.things.append(Thing("Polygon", moved, dict(first.said)))
    made.is_known, made.expected = made.is_known and key == "copies", made.expected | {key, "sources"}


def _field_in_field(made: Map, rng: np.random.Generator) -> None:
    side = math.sqrt(made.ground.area)
    made.things[0].said = {"kind": "field"}
    made.things.append(
        Thing("Polygon", [_box(0.2 * side, 0.2 * side, 0.27 * side, 0.27 * side)], {"kind": "field"})
    )
    made.is_known, made.expected = False, made.expected | {"sources"}


def _far_island(made: Map, rng: np.random.Generator, off: tuple[float, float]) -> None:
    made.things.append(Thing("Polygon", [_box(*off, 30.0, 30.0)], {"kind": "island"}))
    made.expected |= {"place"}


def _all_roads(made: Map, rng: np.random.Generator) -> None:
    for thing in made.things:
        thing.said = {"highway": "track"}
    made.is_known, made.expected = False, made.expected | {"unused"}


def _system(made: Map, rng: np.random.Generator, system: str, keys: set[str], **more: Any) -> None:
    made.system, made.is_known = system, made.is_known and bool(more.pop("known", True))
    for key, value in more.items():
        setattr(made, key, value)
    made.expected |= keys


FAULTS: dict[str, tuple[str, Callable[[Map, np.random.Generator], None]]] = {  # group, what it does
    "crossed": ("ring", _crossed), "spike": ("ring", _spike), "two laps": ("ring", _two_laps),
    "a null place": ("ring", partial(_no_number, value=math.nan)),
    "an infinite place": ("ring", partial(_no_number, value=math.inf)),
    "flat": ("all", _flat), "vast": ("all", _vast), "all say road": ("all", _all_roads),
    "hole outside": ("hole", _hole_outside), "twice": ("again", _twice),
    "alike": ("again", partial(_scaled, by=1.004, off=0.0, key="copies")),
    "another outline": ("again", partial(_scaled, by=0.87, off=0.12, key="sources")),
    "two surveys": ("again", partial(_scaled, by=0.9, off=0.0, key="sources")),
    "field in field": ("again", _field_in_field),
    "island far away": ("far", partial(_far_island, off=(3.0e5, 2.0e4))),
    "island beyond the sea": ("far", partial(_far_island, off=(-1.2e5, 9.0e5))),
    "north first": ("system", partial(_system, system="UTM", keys={"reference", "place"}, turned=True)),
    "URN of degrees": ("system", partial(_system, system="4326", keys={"place"})),
    "URN of degrees, north first": ("system", partial(_system, system="4326", keys={"place"}, turned=True)),
    "no system named": (
        "system", partial(_system, system="UTM", keys={"place"}, names_system=False, known=False)
    ),
    "feet": ("system", partial(_system, system="UTM", keys={"place"}, scale=1 / 0.3048, known=False)),
    "centimetres": ("system", partial(_system, system="UTM", keys={"place"}, scale=100.0, known=False)),
}  # fmt: skip


def _box(x: float, y: float, width: float, height: float) -> Array:
    return np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height)], float)


def draw(seed: int, held_out: bool = False) -> Drawn:
    """A map of a field. A third has no fault, the others up to three. held_out: of all values, else without
    those of HELD_OUT.
    """
    rng = np.random.default_rng([86, seed])

    def one(axis: str, values: Any) -> Any:
        free = [v for v in values if held_out or str(v) not in HELD_OUT.get(axis, ())]
        value = free[int(rng.integers(len(free)))]
        usual.append(f"{axis}={value}")
        return value

    usual: list[str] = []
    form = one("form", FORMS)
    is_shape, is_kml = form == "shapefile", form.startswith("km")
    lat, lon, epsg, own = PLACES[one("place", PLACES)]
    corner = np.round(transform([[lon, lat]], "EPSG:4326", f"EPSG:{epsg}")[0])
    side = math.sqrt(10_000.0 * one("size_ha", (0.6, 1.5, 4.0, 12.0)))
    ring = np.array(UNIT[one("shape", UNIT)]) * side
    made = Map(
        corner,
        epsg,
        [Thing("Polygon", [ring], one("field says", FIELD_WORDS))],
        shapely.Polygon(ring),
        own=own,
    )
    if not (is_kml or is_shape):
        made.system = one("system", SYSTEMS)
    _add_island(made, one("island", ISLANDS), side, partial(one, "island says", BARE_WORDS))
    _add_road(made, one("road", ROADS), side, partial(one, "road says", ROAD_WORDS), is_shape)
    if not is_shape and rng.random() < 0.4:
        turn = math.radians(rng.uniform(-75.0, 75.0))
        ends = (
            np.array([0.3 * side, 0.35 * side])
            + np.outer([-0.08, 0.14], (math.cos(turn), math.sin(turn))) * side
        )
        made.things.append(Thing("LineString", [ends], one("line says", LINE_WORDS)))
        made.direction = math.degrees(turn)
    if not is_shape and rng.random() < 0.4:
        said = one("points", POINT_WORDS)
        made.things += [Thing("Point", [p[None]], said) for p in rng.uniform(-0.2, 1.2, (5, 2)) * side]
    unusual = _faults(made, rng, held_out, is_kml, is_shape) if seed % 3 else []
    names = ("opened", "clockwise", "heights", "shuffled", "collected", "null feature")
    how = {name: bool(rng.random() < 0.25) for name in names}
    usual += [name for name, is_so in how.items() if is_so]
    parts = [p for p in getattr(made.ground, "geoms", [made.ground]) if p.area > 100.0]
    kept = parts if form == "geojson job" else [max(parts, key=lambda p: p.area)]
    middle = shapely.union_all(kept).centroid
    at = transform([[corner[0] + middle.x, corner[1] + middle.y]], f"EPSG:{epsg}", "EPSG:4326")[0]
    truth = {
        "area_ha": Truth(sum(p.area for p in kept) / 1e4),
        "holes": Truth(sum(len(p.interiors) for p in kept)),
        "lat": Truth(float(at[1]), 0.0, 2e-4), "lon": Truth(float(at[0]), 0.0, 2e-4),
    }  # fmt: skip
    if form == "geojson job":
        truth["direction"] = Truth(made.direction, 0.0, 1.0)
    return Drawn(
        seed, partial(_write, made, form, how, int(rng.integers(1 << 30))), truth if made.is_known else {},
        frozenset(made.expected), {}, tuple(usual), tuple(f"fault={name}" for name in unusual),
    )  # fmt: skip


def _faults(made: Map, rng: np.random.Generator, held_out: bool, is_kml: bool, is_shape: bool) -> list[str]:
    """Up to three, of different groups."""
    names, groups = [n for n in FAULTS if held_out or n not in HELD_OUT["fault"]], set[str]()
    taken: list[str] = []
    for name in rng.permutation(names)[: int(rng.integers(1, 4))].tolist():
        group, change = FAULTS[name]
        if group in groups or "all" in groups or (group == "all" and taken):
            continue
        if ((is_kml or is_shape) and group == "system") or (is_kml and "place" in name.split()):
            continue
        if is_shape and name in ("hole outside", "a null place", "an infinite place"):
            continue
        change(made, rng)
        taken, groups = [*taken, name], groups | {group}
    return taken


def _add_island(made: Map, island: str, side: float, say: Callable[[], dict[str, Any]]) -> None:
    boxes = [
        _box(0.22 * side, 0.22 * side, 0.1 * side, 0.08 * side),
        _box(0.38 * side, 0.36 * side, 0.07 * side, 0.09 * side),
    ]
    boxes = boxes[: {"none": 0, "two areas": 2}.get(island, 1)]
    if island == "hole":
        made.things[0].rings += boxes
    elif boxes:
        said = {} if island == "silent area" else say()
        made.things += [Thing("Polygon", [box], said) for box in boxes]
    made.ground = made.ground.difference(shapely.union_all([shapely.Polygon(b) for b in boxes]))


def _add_road(made: Map, road: str, side: float, say: Callable[[], dict[str, Any]], is_shape: bool) -> None:
    if road == "none" or (is_shape and "line" in road):
        return
    said = say()
    if "line" in road:
        y = -40.0 if "beside" in road else 0.15 * side
        made.things.append(
            Thing("LineString", [np.array([(-30.0, y), (0.4 * side, y - 3.0), (1.5 * side, y + 9.0)])], said)
        )
        return
    y = {"area beside": -12.0, "area across": 0.1 * side, "area over the edge": -3.0}[road]
    box = _box(-20.0, y, 3.0 * side, 6.0)
    made.things.append(Thing("Polygon", [box], said))
    made.ground = made.ground.difference(shapely.Polygon(box))


def _write(made: Map, form: str, how: dict[str, bool], seed: int, folder: Path) -> tuple[str, Path]:
    """The file, and for a job the job beside it."""
    rng = np.random.default_rng(seed)
    utm = f"EPSG:{made.epsg}"
    name = {
        "UTM": utm, "UTM as text": utm, "UTM by code": utm, "own": f"EPSG:{made.own}",
        "UTM by URN": f"urn:ogc:def:crs:EPSG::{made.epsg}", "CRS84": "urn:ogc:def:crs:OGC:1.3:CRS84",
        "4326": "urn:ogc:def:crs:EPSG::4326",
    }.get(made.system, "")  # fmt: skip
    to = name if name.startswith("EPSG") else f"EPSG:{made.epsg}" if "UTM" in made.system else "EPSG:4326"

    def placed(line: Array, is_ring: bool) -> list[Any]:
        line = line[::-1] if is_ring and how["clockwise"] else line
        line = (
            np.vstack([line, line[:1]]) if is_ring and not (how["opened"] and form != "shapefile") else line
        )
        known = np.isfinite(line).all(axis=1)
        found = line.copy()
        found[known] = transform(line[known] + made.corner, f"EPSG:{made.epsg}", to) * made.scale
        found = found[:, ::-1] if made.turned else found
        return [[None if math.isnan(c) else c for c in p] + [431.0] * how["heights"] for p in found.tolist()]

    shapes = [(t.kind, [placed(r, t.kind == "Polygon") for r in t.rings], t.said) for t in made.things]
    if how["shuffled"]:
        shapes = [shapes[i] for i in rng.permutation(len(shapes))]
    if form.startswith("km"):
        return "outline", _kml(folder / f"a.{form}", shapes)
    if form == "shapefile":
        return "outline", _shapefile(folder / "a.shp", shapes)
    features = [_feature(*shape, how["collected"]) for shape in shapes]
    features += [{"type": "Feature", "properties": {"kind": "note"}, "geometry": None}] * how["null feature"]
    data: dict[str, Any] = {"type": "FeatureCollection", "features": features}
    if name and made.names_system:
        about: Any = {"type": "name", "properties": {"name": name}}
        if made.system == "UTM by code":
            about = {"type": "EPSG", "properties": {"code": made.epsg}}
        data["crs"] = name if made.system == "UTM as text" else about
    (folder / "a.geojson").write_text(json.dumps(data))
    if form == "geojson":
        return "outline", folder / "a.geojson"
    (folder / "job.yaml").write_text(
        "format: swath fleet 1\nfield: {file: a.geojson}\ncombines: {combine: {machine: lexion-700}}\n"
        "truck: {x_m: -60, y_m: -60}\n"
    )
    return "job", folder / "job.yaml"


def _feature(kind: str, rings: list[Any], said: dict[str, Any], is_collected: bool) -> dict[str, Any]:
    inner = {"Polygon": rings, "LineString": rings[0], "Point": rings[0][0]}[kind]
    shape: dict[str, Any] = {"type": kind, "coordinates": inner}
    if is_collected and kind == "Polygon":
        shape = {
            "type": "GeometryCollection",
            "geometries": [{"type": "MultiPolygon", "coordinates": [inner]}],
        }
    return {"type": "Feature", "properties": said or None, "geometry": shape}


def _kml(path: Path, shapes: list[Any]) -> Path:
    def text(line: list[Any]) -> str:
        return f"<coordinates>{' '.join(','.join(f'{c:.9f}' for c in p) for p in line)}</coordinates>"

    marks = []
    for kind, rings, said in shapes:
        flat = {**said, **said.get("tags", {})}
        more = "".join(
            f'<Data name="{k}"><value>{v}</value></Data>'
            for k, v in flat.items()
            if k not in ("tags", "name")
        )
        inner = text(rings[0])
        if kind == "Polygon":
            around = ["outer", *["inner"] * (len(rings) - 1)]
            inner = "".join(f"<{a}BoundaryIs><LinearRing>{text(r)}</LinearRing></{a}BoundaryIs>"
                            for a, r in zip(around, rings, strict=True))  # fmt: skip
        said = f"<name>{flat.get('name', '')}</name><ExtendedData>{more}</ExtendedData>"
        marks.append(f"<Placemark>{said}<{kind}>{inner}</{kind}></Placemark>")
    inside = f"<Document><name>Field</name>{''.join(marks)}</Document>"
    data = f'<kml xmlns="http://www.opengis.net/kml/2.2">{inside}</kml>'
    if path.suffix == ".kmz":
        with zipfile.ZipFile(path, "w") as made:
            made.writestr("doc.kml", data)
    else:
        path.write_text(data)
    return path


def _shapefile(path: Path, shapes: list[Any]) -> Path:
    import shapefile

    said = [
        {k[:10]: str(v) for k, v in {**s, **s.get("tags", {})}.items() if k != "tags"} for _, _, s in shapes
    ]
    columns = list(dict.fromkeys(["id", *(k for s in said for k in s)]))
    with shapefile.Writer(str(path), shapeType=shapefile.POLYGON) as file:
        for column in columns:
            file.field(column, "C", 40)
        for (_, rings, _), about in zip(shapes, said, strict=True):
            file.poly([[p[:2] for p in ring] for ring in rings])
            file.record(*[about.get(c, "") for c in columns])
    path.with_suffix(".prj").write_text(
        'GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],PRIMEM["Greenwich",0.0],'
        'UNIT["Degree",0.0174532925199433]]'
    )
    return path


def read(given: tuple[str, Path], out: Path) -> Got:
    """A job up to the ground that is worked, an outline up to the field that it holds."""
    from swath.field_io.outline import read_outlines
    from swath.fleet.files import read_field, read_job
    from swath.fleet.ground import Ground
    from swath.fleet.machines import body_of, machines_of

    kind, path = given
    if kind == "outline":
        found = read_outlines(path)
        polygon, notes = found.field()
        areas, epsg, numbers = (polygon,), found.epsg, {}
    else:
        job, _ = read_job(str(path))
        ground = Ground(job, body_of(machines_of(job).truck))
        made = read_field(path.parent / "a.geojson", 9.0)
        areas, epsg, notes = made.areas, made.epsg, list(job.notes)
        direction = job.plan.direction_deg
        numbers = {"direction": -1.0 if direction is None else direction, "area_ha": ground.field.area / 1e4}
    whole = shapely.union_all(areas)
    lon, lat = transform([[whole.centroid.x, whole.centroid.y]], f"EPSG:{epsg}", "EPSG:4326")[0].tolist()
    holes = sum(len(p.interiors) for p in areas)
    return Got({"area_ha": whole.area / 1e4, "holes": holes, "lat": lat, "lon": lon, **numbers}, tuple(notes))


if __name__ == "__main__":
    import sys

    from tests.readers.verdict import table

    first, count, held = int(sys.argv[1]), int(sys.argv[2]), len(sys.argv) > 3
    verdicts = [verdict(draw(seed, held), read) for seed in range(first, first + count)]
    print("\n".join(line for v in verdicts if not v.is_good for line in v.lines()))
    print("\n".join(table(verdicts)))
