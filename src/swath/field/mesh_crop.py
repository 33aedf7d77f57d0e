"""A crop whose plants are the user's own meshes: sections `mesh` and `parts` of its data sheet."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from swath.core.errors import near_miss, raise_all
from swath.core.portable import product
from swath.core.units import CM
from swath.documents.data_sheets import Sheet
from swath.documents.sheet_fields import Key
from swath.documents.validation import STRICT
from swath.field.memory_layout import Organ
from swath.field.mesh_file import UNITS, UP, MeshPart, base_middle, file_up, read_mesh

Array = NDArray[np.float64]
OrganName = Literal["stem", "ear", "leaf", "awn", "branch", "pod", "cob", "weed", "none"]
HEIGHT = (0.02, 6.0)  # of a plant [m]
REACH_MAX = 1.2  # of a plant from its foot, sideways [m]; tiles are 1 to 1.5 m wide
LYING = 0.5  # a plant whose longest side is not up, and the others are less than this share of it, lies
TRIANGLES_MAX = 20_000  # of a plant
ANY = "*"  # the part that stands for all that are not named


class MeshPartFacts(BaseModel):
    """What a part of the meshes is. organ `none`: left out."""

    model_config = STRICT
    organ: OrganName
    reflectance: Annotated[float, Field(ge=0, le=1)] | None = None


@dataclass(frozen=True, kw_only=True)
class MeshSection:
    """files: one or several, drawn evenly, beside the sheet; unit: of their coordinates, or `stand.height`
    scales them; up: their vertical axis; foot: what stands on the ground; parts: material or object -> what
    it is.
    """

    files: Annotated[Annotated[list[str], Field(min_length=1)] | str, Key("mesh.files")]
    unit: Annotated[Literal["m", "cm", "mm", "inch"] | None, Key("mesh.unit")] = None
    up: Annotated[Literal["x", "y", "z"] | None, Key("mesh.up")] = None
    foot: Annotated[Literal["base", "origin"], Key("mesh.foot")] = "base"
    turn: Annotated[Literal["random", "none"], Key("mesh.turn")] = "random"
    parts: Annotated[dict[str, MeshPartFacts], Field(min_length=1), Key("parts")]


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
        """Organ name -> reflectance, weighted by area where parts of one organ differ.

        `stem` is always in, the mean of all where no part is a stem: other levels take it for the crop as a
        whole.
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


def triangle_area(corners: Array) -> Array:
    """Area of triangles (n, 3, 3) [m2], one face."""
    edge = corners[:, 1:] - corners[:, :1]
    return np.asarray(0.5 * np.linalg.norm(np.cross(edge[:, 0], edge[:, 1]), axis=1))


def mesh_facts(sheet: Sheet, section: MeshSection) -> MeshFacts:
    """The meshes of a sheet. Raises InputError that names key and file for what cannot be a plant."""
    names = [section.files] if isinstance(section.files, str) else section.files
    files = [sheet.path.parent / name for name in names]
    parts = {name: MeshPartFacts.model_validate(part) for name, part in sheet.value("parts").items()}
    found = {path: read_mesh(path, key="mesh.files", file=sheet.path) for path in files}
    _check_parts(sheet, found, parts)
    raw = [_placed(sheet, section, path, found[path], parts) for path in files]
    scale = _scale(sheet, section, raw)
    variants = [MeshPlant(p.corners * scale, p.organ, p.reflectance, p.height * scale) for p in raw]
    for path, plant in zip(files, variants, strict=True):
        _check_size(sheet, path, plant)
    return MeshFacts(tuple(variants), section.turn == "random")


def _placed(
    sheet: Sheet,
    section: MeshSection,
    path: Path,
    found: tuple[MeshPart, ...],
    parts: dict[str, MeshPartFacts],
) -> MeshPlant:
    """A mesh with its organs, z up and its foot at the origin, still in units of the file."""
    corners, organ, reflectance = [], [], []
    for part in found:
        facts = parts[_entry(part, parts) or ANY]
        if facts.organ != "none":
            corners.append(part.corners)
            organ.append(np.full(len(part.corners), Organ[facts.organ.upper()], np.uint8))
            reflectance.append(np.full(len(part.corners), facts.reflectance))
    if not corners:
        raise sheet.document.error(("parts",), None, f"expected an organ for some part of {path.name}")
    points = np.concatenate(corners)
    if section.up is None:
        _check_up(sheet, path, points)
    points = product(points, UP[section.up or file_up(path)].T)
    if section.foot == "base":
        points = points - base_middle(points)
    height = float(points[..., 2].max())
    return MeshPlant(points, np.concatenate(organ), np.concatenate(reflectance), height)


def _entry(part: MeshPart, parts: dict[str, MeshPartFacts]) -> str | None:
    """The name under which a sheet has a part."""
    return next((n for n in (*part.names, ANY) if n in parts), None)


def _check_parts(
    sheet: Sheet, found: dict[Path, tuple[MeshPart, ...]], parts: dict[str, MeshPartFacts]
) -> None:
    """InputError with every part without an entry, and every entry without a part."""
    errors = [
        sheet.document.error(("parts", name, "reflectance"), None, "expected a value, the key is missing")
        for name, part in parts.items()
        if part.organ != "none" and part.reflectance is None
    ]
    used = {ANY}
    for path, own in found.items():
        lacking = list(dict.fromkeys(p.names[0] for p in own if _entry(p, parts) is None))
        used |= {name for p in own if (name := _entry(p, parts)) is not None}
        if lacking:
            expected = (
                f"expected an entry for {'these parts' if lacking[1:] else 'this part'} of {path.name}, "
            )
            expected += f"or for '*'{near_miss(lacking[0], parts)}"
            errors.append(sheet.document.error(("parts", ", ".join(lacking)), None, expected))
    known = ", ".join(sorted({p.names[0] for own in found.values() for p in own}))
    errors += [
        sheet.document.error(("parts", name), None, f"no mesh has a part of this name, they have {known}")
        for name in parts
        if name not in used
    ]
    raise_all(errors)


def _check_up(sheet: Sheet, path: Path, points: Array) -> None:
    """InputError for a plant that lies on the ground as its format has it: nobody said which axis is up."""
    size = np.ptp(points.reshape(-1, 3), axis=0)
    longest, assumed = int(np.argmax(size)), "xyz".index(file_up(path))
    if longest != assumed and max(np.delete(size, longest)) < LYING * size[longest]:
        up, along = "xyz"[assumed], "xyz"[longest]
        expected = f"expected {along}, or the axis that points up: with {up}, usual in {path.suffix} files, "
        expected += f"{path.name} lies, {size[longest]:.3g} long and {size[assumed]:.3g} high"
        raise sheet.error("mesh.up", expected)


def _scale(sheet: Sheet, section: MeshSection, raw: list[MeshPlant]) -> float:
    """Metres per unit of the files: by `mesh.unit`, or so that the mean height is `stand.height_cm`."""
    height = sheet.value("stand.height_cm")
    if (height is None) == (section.unit is None):
        expected = (
            f"expected either this ({', '.join(UNITS)}) or stand.height_cm, which scales the meshes to it"
        )
        raise sheet.error("mesh.unit", expected)
    if section.unit is not None:
        return UNITS[section.unit]
    mean = float(np.mean([p.height for p in raw]))
    if not mean > 0.0:
        raise sheet.error("mesh.foot", "expected a mesh that rises above its foot")
    return float(height) * CM / mean


def _check_size(sheet: Sheet, path: Path, plant: MeshPlant) -> None:
    reach = float(np.hypot(plant.corners[..., 0], plant.corners[..., 1]).max())
    expected = ""
    if len(plant.organ) > TRIANGLES_MAX:
        expected = f"expected at most {TRIANGLES_MAX} triangles, it has {len(plant.organ)}"
    elif not HEIGHT[0] <= plant.height <= HEIGHT[1]:
        expected = f"expected a plant {HEIGHT[0]:g} to {HEIGHT[1]:g} m high, it is {plant.height:.3g} m"
        expected += ": mesh.unit, mesh.up?"
    elif reach > REACH_MAX:
        expected = f"expected at most {REACH_MAX:g} m from the foot sideways, it is {reach:.3g} m"
        expected += ": mesh.foot, mesh.up?"
    if expected:
        raise sheet.document.error(("mesh", "files"), path.name, expected)
