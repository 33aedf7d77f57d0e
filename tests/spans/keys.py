"""Keys of scenarios: every number with a declared range, at both of its ends, in a run of a moment.

What a key needs beside it comes from the schema of scenarios, from `BESIDE` and `USUAL` where that is silent.
"""

import copy
import json
import math
from collections.abc import Callable, Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from swath.scenario.schema import scenario_schema
from swath.scenario.slots import FIELD_LEVELS, SLOT_NAMES
from swath.scenario.versions import FORMAT

Node = dict[str, Any]
ECHOES = 7  # of the samples that flow into levels alone
ENDS = ("minimum", "exclusiveMinimum", "maximum", "exclusiveMaximum")
NEAR = 1e-6  # from an open end, relative to the span, or to 1
ORGANS = {"process": "organs", "powertrain": "hydrostat", "crop_flow": "counted", "settings": "fixed"}
FED = {"process": "threshing", "powertrain": "hydrostat", "crop_flow": "delayed"}
PLACED = {"gnss": "error", "pose": "raw"}
BESIDE: dict[str, Node] = {  # slots that a slot needs beside it, by its name or `slot.level`
    **dict.fromkeys(("feeder", "threshing", "separation", "cleaning", "returns", "settings"), ORGANS),
    **dict.fromkeys(("powertrain", "process", "crop_flow", "speed", "unload"), FED),
    "crop_flow.counted": ORGANS,
    "process.organs": ORGANS,
    "pose": {"gnss": "error"},
    "steer.path": PLACED,
    "steer.edge_or_path": PLACED,
    "field_map": {"gnss": "error", **FED},
    "ahead": {"speed": {"level": "look_ahead", "throughput_kg_s": 30.0}, **FED},
    "speed.look_ahead": {"ahead": "penetration", **FED},
    "speed.map_ahead": {"field_map": "ideal", **FED},
    "speed.joined_ahead": {"ahead": "penetration", "field_map": "ideal", **FED},
    "objects.radar": {"radar": "error"},
    "objects.joined": {"radar": "error"},
    "odometry": {"motion": "multibody"},
}
PAIR = ("peer_link", "scan_filter", "box", "cooperate", "unload", "heap")  # slots that need a second machine
ON_CART = ("heap", "cooperate.by_profile", "cooperate.front_to_back", "cooperate.one_spot",
           "steer.station", "speed.station", "motion.articulated")  # fmt: skip
USUAL: Node = {  # where the schema leaves open what is right
    "points_m": [[0.0, -30.0], [0.0, 60.0], [60.0, 80.0]],
    "start_m": 1.0,
    "end_m": 3.0,
    "from_s": 0.1,
    "to_s": 0.3,
    "file": "x.file",
    "throughput_kg_s": 30.0,
    "crop": "wheat",
    "to": [[30.0, 60.0]],
    "kind": "person",
    "hold_s": [[0.1, 0.3]],
    "silent_s": [[0.1, 0.3]],
}


SMALL = {  # what takes little time
    "camera": {
        "width_px": 40,
        "height_px": 20,
        "binning": 8,
        "samples_per_pixel": 1,
        "shadows": False,
        "texture": False,
    },
    "lidar": {"sub_rays": 1, "step_deg": 2.0},
}
SEEN = {"x": {"field": "scan.ranges"}}
FIRST, SECOND = ({"tensor": "y", "index": i} for i in (0, 1))
NETWORKS: Node = {  # what levels with a network give it and take from it
    "edge.onnx": {
        "inputs": SEEN,
        "outputs": {"offset": FIRST, "heading": SECOND, "reference_x": 10.0, "confidence": 0.5},
    },
    "objects.onnx": {"inputs": SEEN, "outputs": {"x": FIRST, "y": SECOND, "confidence": 0.5}},
}
FILES = {
    **dict.fromkeys(NETWORKS, "net.onnx"),
    "terrain.dem": "dem.tif",
    "field_map.file": "map.tif",
    "stand.maps": "map.tif",
    "lidar.replay": "run",
}
WILD = "FIELD"  # stands for the field of a fault; here:
FIELDS = {"edge": "offset_m", "lidar": "ranges_m", "mount_error": "z_m"}
SLOW = ("camera", "lidar", "radar", "realtime")
COMMON_AT = ("edge", "lidar", "motion")  # slots at which the keys of every slot are walked


class Key(NamedTuple):
    """A number of a scenario. place: of the part of a scenario that holds it, and its level there

    part: makes that part of the number; node: what the schema says of it; says: its name
    """

    place: tuple[str, ...]
    level: str
    part: Callable[[float], Any]
    node: Node
    says: str

    def __str__(self) -> str:
        return self.says

    @property
    def is_quick(self) -> bool:
        """Whether a run of a moment takes less than a second, whatever its value."""
        return self.place[-1] not in SLOW and not self.says.endswith("rate_hz")

    def ends(self) -> dict[str, float]:
        """Its least and greatest legal number: at a closed end, beside an open one."""
        found, node = {}, self.node
        is_whole = node.get("type") == "integer"
        low, high = (
            node.get(k, node.get(o))
            for k, o in (("minimum", "exclusiveMinimum"), ("maximum", "exclusiveMaximum"))
        )
        width = max(high - low if None not in (low, high) else 1.0, 1e-9)
        step = 1 if is_whole else NEAR * min(width, 1.0)
        if low is not None:
            found["low"] = low if "minimum" in node else low + step
        if high is not None:
            found["high"] = high if "maximum" in node else high - step
        return found

    def scenario(self, end: float) -> Node:
        """A scenario with the number in it."""
        part = self.part(end)
        if self.place[-1] in SMALL:
            part = small(self.place[-1], self.level) | part
        text = json.dumps(placed(self.place, self.level, part))
        kind = "mount_error" if "mount_error" in self.says else self.place[-1]
        text = text.replace(f'"{WILD}"', f'"{FIELDS.get(kind, WILD)}"')
        return json.loads(text.replace("x.file", FILES.get(f"{self.place[-1]}.{self.level}", "box.obj")))


def _deep(base: Node, more: Node) -> Node:
    """Both, `more` first where they differ."""
    made = dict(base)
    for key, value in more.items():
        both = isinstance(value, dict) and isinstance(made.get(key), dict)
        made[key] = _deep(made[key], value) if both else value
    return made


def _plain(name: str, **more: Any) -> Node:
    return {"format": FORMAT, "name": name, "seed": 3, **more}


def base(place: tuple[str, ...], level: str) -> Node:
    """A scenario that has room for a part: one combine, or a combine with a cart beside it."""
    slot = place[2] if place[0] == "machines" and len(place) == 3 else ""
    whole = f"{slot}.{level}"
    combine: Node = {
        "machine": "lexion-700-class", "motion": {"level": "single_track", "start_speed_kmh": 5.0},
        "lidar": {"level": "empirical", "sensor": "sick-lms111", "rate_hz": 10.0,
                  "sector_deg": [-60.0, 60.0]},
        "edge": "truth",
    }  # fmt: skip
    made = _plain(
        "span",
        run={"distance_m": 1.0, "max_duration_s": 0.4, "record": "none"},
        field={
            "terrain": "plane",
            "stand": "uniform",
            "edge": {"shape": "straight"},
            "weather": {"wind_m_s": 3.0},
        },
        machines={"combine": combine},
    )
    if slot in PAIR or whole in ON_CART:
        combine |= {
            "peer": "cart", **FED, "process": {"level": "threshing", "tank_start_percent": 90.0},
            "unload": "auger", "peer_link": "radio", "cooperate": "unloader", "scan_filter": "peer_body",
        }  # fmt: skip
        made["machines"]["cart"] = {
            "machine": "tractor-grain-cart", "peer": "combine",
            "start": {"x_m": -8.5, "y_m": -4.0, "heading_deg": 90.0},
            "motion": {"level": "articulated", "start_speed_kmh": 5.0}, "odometry": "error",
            "peer_link": "radio", "heap": {"level": "height_map", "start_percent": 60.0},
            "cooperate": "front_to_back", "steer": "station", "speed": "station",
        }  # fmt: skip
    beside = BESIDE.get(whole, BESIDE.get(slot, {}))
    combine |= {
        key: value
        for key, value in beside.items()
        if key not in ("process",) or "cart" not in made["machines"]
    }
    return made


def placed(place: tuple[str, ...], level: str, part: Any) -> Node:
    """The scenario of `base` with a part in its place."""
    made = base(place, level)
    at: Any = made
    if len(place) == 3 and (f"{place[2]}.{level}" in ON_CART or place[2] in ON_CART):
        place = (place[0], "cart", place[2])
    for key in place[:-1]:
        at = at.setdefault(key, {})
    if isinstance(part, dict) and isinstance(at.get(place[-1]), dict) and not level:
        part = _deep(at[place[-1]], part)
    at[place[-1]] = part
    return made


@cache
def _schema() -> Node:
    return scenario_schema()


def _of(node: Node) -> Node:
    while "$ref" in node:
        at: Any = _schema()
        for name in node["$ref"].removeprefix("#/").split("/"):
            at = at[name]
        node = {**at, **{k: v for k, v in node.items() if k != "$ref"}}
    return node


def usual(node: Node, name: str = "") -> Any:
    """A value that fits."""
    node = _of(node)
    if "const" in node:
        return node["const"]
    if name in USUAL:
        return copy.deepcopy(USUAL[name])
    if node.get("default") is not None:
        return copy.deepcopy(node["default"])
    if "enum" in node:
        return node["enum"][0]
    if members := node.get("anyOf") or node.get("oneOf"):
        return usual(members[0], name)
    kind = node.get("type")
    if kind == "object":
        return {key: usual(node["properties"][key], key) for key in node.get("required", ())}
    if kind == "array":
        items = node.get("prefixItems") or [node.get("items", {})] * max(node.get("minItems", 0), 0)
        return [usual(item, name) for item in items]
    if kind in ("number", "integer"):
        low = node.get("minimum", node.get("exclusiveMinimum", -math.inf))
        high = node.get("maximum", node.get("exclusiveMaximum", math.inf))
        middle = 0.5 * (low + high) if math.isfinite(low + high) else low + 1.0 if math.isfinite(low) else 1.0
        fit = 1.0 if low < 1.0 < high else middle
        return round(fit) if kind == "integer" else fit
    return kind == "boolean" or "x"


def numbers(
    node: Node, says: str, name: str = "", given: Any = None
) -> Iterator[tuple[str, Node, Callable[[float], Any]]]:
    """Each number in a node with a declared range: its name, its node, and what makes the value of it."""
    node = _of(node)
    for member in node.get("anyOf") or node.get("oneOf") or ():
        yield from numbers(member, says, name, given)
    kind = node.get("type")
    if kind in ("number", "integer") and any(end in node for end in ENDS):
        yield says, node, (lambda value, whole=kind == "integer": round(value) if whole else float(value))
    elif kind == "object":
        tags = {key: inner["const"] for key, inner in node.get("properties", {}).items() if "const" in inner}
        needed = tags | usual({**node, "anyOf": None, "oneOf": None})
        for key, inner in node.get("properties", {}).items():
            for said, at, make in numbers(inner, f"{says}.{key}", key):
                yield said, at, (lambda value, key=key, make=make: {**needed, key: make(value)})
        if isinstance(inner := node.get("additionalProperties"), dict):
            for said, at, make in numbers(inner, f"{says}.*"):
                yield said, at, (lambda value, make=make: {WILD: make(value)})
    elif kind == "array":
        items = node.get("prefixItems") or [node.get("items", {})] * max(node.get("minItems", 0), 1)
        others = given or usual({**node, "default": None}, name) or [None] * len(items)
        for k, item in enumerate(items):
            inner = others[k] if isinstance(others[k], list) else None
            for said, at, make in numbers(item, f"{says}[{k}]", "", inner):
                yield (
                    said,
                    at,
                    (
                        lambda value, k=k, make=make: [
                            make(value) if i == k else v for i, v in enumerate(others)
                        ]
                    ),
                )


def files(folder: Path) -> None:
    """What scenarios of `every_key` name."""
    import numpy as np

    from swath.field.maps.raster import Raster

    for name, high, unit in (("dem.tif", 3.0, "m"), ("map.tif", 0.8, "")):
        Raster(np.full((60, 60), high, np.float32), 499_700.0, 5_760_900.0, 10.0, 32632).to_geotiff(
            folder / name, 32632, **({"unit": unit} if unit else {})
        )
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    faces = [(1, 2, 4, 3), (5, 6, 8, 7), (1, 2, 6, 5), (3, 4, 8, 7), (1, 3, 7, 5), (2, 4, 8, 6)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c} {d}" for a, b, c, d in faces]
    (folder / "box.obj").write_text("\n".join(lines) + "\n")
    if find_spec("onnx"):
        from tests.networks import linear

        linear(folder / "net.onnx", [ECHOES], np.eye(ECHOES)[:2], [0.0, 0.0])


@cache
def every_key() -> list[Key]:
    """All of them."""
    whole, found = _schema(), list[Key]()
    top = whole["properties"]

    def take(place: tuple[str, ...], level: str, node: Node, *, but: frozenset[str] = frozenset()) -> None:
        says = ".".join(p for p in (*place, level) if p)
        node = _of(node)
        left = {k: v for k, v in node.get("properties", {}).items() if k not in but}
        node = {**node, "properties": left} if "properties" in node else node
        for said, at, make in numbers(node, says):
            found.append(Key(place, level, make, at, said))

    for section in ("seed", "run", "realtime"):
        take((section,), "", top[section])
    fields = top["field"]["properties"]
    for name, node in fields.items():
        if name in FIELD_LEVELS:
            _levels(whole, ("field", name), take)
        elif name != "edges":
            take(("field", name), "", node)
    machine = top["machines"]["additionalProperties"]["properties"]
    common = frozenset(_of({"$ref": "#/$defs/slot.SlotCommon"})["properties"])
    for name, node in machine.items():
        if name in SLOT_NAMES:
            _levels(whole, ("machines", "combine", name), take, common)
        else:
            take(("machines", "combine", name), "", node)
    return found


def _levels(whole: Node, place: tuple[str, ...], take: Any, common: frozenset[str] = frozenset()) -> None:
    kind, is_first = place[-1], True
    for title, node in whole["$defs"].items():
        group, _, level = title.partition(".")
        if group == kind and "level" in node.get("properties", {}):
            rest = common - {"rate_hz", "offset_ms"} if kind not in COMMON_AT else frozenset[str]()
            take(place, level, node, but=rest if is_first else common)
            is_first = False


def small(slot: str, level: str) -> Node:
    """Keys with which a level takes little time."""
    known = _of({"$ref": f"#/$defs/{slot}.{level}"})["properties"]
    return {k: v for k, v in SMALL.get(slot, {}).items() if k in known}


def usual_part(slot: str, level: str) -> Node:
    """A level with the keys that it needs."""
    node = _of({"$ref": f"#/$defs/{slot}.{level}"})
    needed = {*node.get("required", ()), "level"} - {"rate_hz"}
    return (
        usual({**node, "required": sorted(needed)})
        | small(slot, level)
        | NETWORKS.get(f"{slot}.{level}", {})
        | {"level": level}
    )
