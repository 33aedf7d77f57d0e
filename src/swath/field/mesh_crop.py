"""A crop whose plants are the user's own meshes: sections `mesh` and `parts` of its card."""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.documents.data_sheets import Card
from swath.field.facts import LENGTH, RATIO, number
from swath.field.memory_layout import Organ
from swath.field.mesh_file import UNITS, UP, MeshPart, base_middle, file_up, read_mesh

Array = NDArray[np.float64]
ORGANS = ("stem", "ear", "leaf", "awn", "branch", "pod", "cob", "weed")
HEIGHT = (0.02, 6.0)  # of a plant [m]
REACH_MAX = 1.2  # of a plant from its foot, sideways [m]; tiles are 1 to 1.5 m wide
TRIANGLES_MAX = 20_000  # of a plant
ANY = "*"  # the part that stands for all that are not named


@dataclass(frozen=True, eq=False)
class MeshPlant:
    """One variant. corners: (n, 3, 3) [m], foot at the origin, z up; organ, reflectance: (n,); height [m]."""

    corners: Array
    organ: NDArray[np.uint8]
    reflectance: Array
    height: float


@dataclass(frozen=True, eq=False)
class MeshFacts:
    """variants: drawn evenly; turns: each plant is turned at random about its foot."""

    variants: tuple[MeshPlant, ...]
    turns: bool = True

    @property
    def height(self) -> float:
        """Mean height of the variants [m]."""
        return float(np.mean([v.height for v in self.variants]))

    def reflectances(self) -> dict[str, float]:
        """Organ name -> reflectance, weighted by area where parts of one organ differ. `stem` is always in,
        the mean of all where no part is a stem: other levels take it for the crop as a whole.
        """
        organ = np.concatenate([v.organ for v in self.variants])
        value = np.concatenate([v.reflectance for v in self.variants])
        area = np.concatenate([triangle_area(v.corners) for v in self.variants])
        found = {}
        for o in np.unique(organ):
            mine = value[organ == o]
            mean = mine[0] if np.ptp(mine) == 0.0 else np.average(mine, weights=area[organ == o])
            found[Organ(int(o)).name.lower()] = float(mean)
        return {"stem": float(np.average(value, weights=area))} | found


@dataclass(frozen=True)
class _PartFacts:
    """organ: None = left out."""

    organ: Organ | None
    reflectance: float = 0.0


def triangle_area(corners: Array) -> Array:
    """Area of triangles (n, 3, 3) [m2], one face."""
    edge = corners[:, 1:] - corners[:, :1]
    return np.asarray(0.5 * np.linalg.norm(np.cross(edge[:, 0], edge[:, 1]), axis=1))


def mesh_facts(card: Card) -> MeshFacts:
    """The meshes of a card. Raises InputError that names key and card for whatever cannot be a plant."""
    allowed = {"files", "unit", "up", "foot", "turn"}
    for key in card.entry("mesh"):
        if key not in allowed:
            expected = f"expected one of {', '.join(sorted(allowed))}"
            raise InputError(f"mesh.{key}", None, expected, file=card.path)
    parts = _part_facts(card)
    files = _files(card)
    used: set[str] = set()
    raw = [
        _placed(card, path, read_mesh(path, key="mesh.files", file=card.path), parts, used) for path in files
    ]
    for name in parts:
        if name != ANY and name not in used:
            raise InputError(f"parts.{name}", None, _no_such_part(name, files, card), file=card.path)
    scale = _scale(card, raw)
    variants = [MeshPlant(p.corners * scale, p.organ, p.reflectance, p.height * scale) for p in raw]
    for path, plant in zip(files, variants, strict=True):
        _check_size(card, path, plant)
    return MeshFacts(tuple(variants), _choice(card, "turn", ("random", "none"), "random") == "random")


def _files(card: Card) -> list[Path]:
    names = card.entry("mesh.files")
    names = [names] if isinstance(names, str) else names
    if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
        raise InputError("mesh.files", names, "expected a file name or a list of them", file=card.path)
    return [card.path.parent / name for name in names]


def _part_facts(card: Card) -> dict[str, _PartFacts]:
    entries = card.entry("parts")
    if not isinstance(entries, Mapping) or not entries:
        raise InputError("parts", None, "expected {part: {organ, reflectance}}", file=card.path)
    found = {}
    for name, entry in entries.items():
        key = f"parts.{name}"
        organ = entry.get("organ") if isinstance(entry, Mapping) else None
        if organ not in (*ORGANS, "none"):
            expected = f"expected one of {', '.join(ORGANS)}, or none"
            raise InputError(f"{key}.organ", organ, expected, file=card.path)
        if organ == "none":
            found[str(name)] = _PartFacts(None)
        else:
            value = number(card, f"{key}.reflectance", RATIO, 0.0, 1.0)
            found[str(name)] = _PartFacts(Organ[organ.upper()], value)
    return found


def _placed(
    card: Card, path: Path, parts: tuple[MeshPart, ...], facts: dict[str, _PartFacts], used: set[str]
) -> MeshPlant:
    """A mesh with its organs, z up and its foot at the origin, still in units of the file."""
    corners, organ, reflectance = [], [], []
    for part in parts:
        name = next((n for n in (*part.names, ANY) if n in facts), None)
        if name is None:
            near = difflib.get_close_matches(part.names[0], list(facts), n=1)
            hint = f", did you mean {near[0]!r}?" if near else ""
            expected = f"expected an entry for this part of {path.name}, or for '*'{hint}"
            raise InputError(f"parts.{part.names[0]}", None, expected, file=card.path)
        used.add(name)
        fact = facts[name]
        if fact.organ is not None:
            corners.append(part.corners)
            organ.append(np.full(len(part.corners), fact.organ, np.uint8))
            reflectance.append(np.full(len(part.corners), fact.reflectance))
    if not corners:
        raise InputError("parts", None, f"expected an organ for some part of {path.name}", file=card.path)
    up = _choice(card, "up", tuple(UP), file_up(path))
    points = np.concatenate(corners) @ UP[up].T
    if _choice(card, "foot", ("base", "origin"), "base") == "base":
        points = points - base_middle(points)
    height = float(points[..., 2].max())
    return MeshPlant(points, np.concatenate(organ), np.concatenate(reflectance), height)


def _scale(card: Card, raw: list[MeshPlant]) -> float:
    """Metres per unit of the files: by `mesh.unit`, or so that the mean height is `stand.height`."""
    has_height = "height" in card.entry("stand")
    if has_height == ("unit" in card.entry("mesh")):
        expected = f"expected either this ({', '.join(UNITS)}) or stand.height, which scales the meshes to it"
        raise InputError("mesh.unit", card.entry("mesh").get("unit"), expected, file=card.path)
    if not has_height:
        return UNITS[_choice(card, "unit", tuple(UNITS), "")]
    mean = float(np.mean([p.height for p in raw]))
    if not mean > 0.0:
        raise InputError("mesh.foot", "origin", "expected a mesh that rises above its foot", file=card.path)
    return number(card, "stand.height", LENGTH, *HEIGHT) / mean


def _check_size(card: Card, path: Path, plant: MeshPlant) -> None:
    if len(plant.organ) > TRIANGLES_MAX:
        expected = f"expected at most {TRIANGLES_MAX} triangles, it has {len(plant.organ)}"
        raise InputError("mesh.files", path.name, expected, file=card.path)
    if not HEIGHT[0] <= plant.height <= HEIGHT[1]:
        expected = f"expected a plant {HEIGHT[0]:g} to {HEIGHT[1]:g} m high, it is {plant.height:.3g} m"
        raise InputError("mesh.files", path.name, f"{expected}: mesh.unit, mesh.up?", file=card.path)
    reach = float(np.hypot(plant.corners[..., 0], plant.corners[..., 1]).max())
    if reach > REACH_MAX:
        expected = f"expected at most {REACH_MAX:g} m from the foot sideways, it is {reach:.3g} m"
        raise InputError("mesh.files", path.name, f"{expected}: mesh.foot, mesh.up?", file=card.path)


def _no_such_part(name: str, files: list[Path], card: Card) -> str:
    known = {p.names[0] for path in files for p in read_mesh(path, key="mesh.files", file=card.path)}
    return f"no mesh has a part of this name, they have {', '.join(sorted(known))}"


def _choice(card: Card, key: str, choices: tuple[str, ...], default: str) -> str:
    value: Any = card.entry("mesh").get(key, default)
    if value not in choices:
        raise InputError(f"mesh.{key}", value, f"expected one of {', '.join(choices)}", file=card.path)
    return str(value)
