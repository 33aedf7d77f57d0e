"""From a world to files: sizes told first, then written."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swath.core.errors import InputError
from swath.core.whole_file import write_whole
from swath.runtime.world import World
from swath.signals import F64
from swath.tools.field_export.glb import glb_bytes, glb_size, need_trimesh
from swath.tools.field_export.scene import FieldScene, expected_pieces, make_scene
from swath.tools.field_export.sdf import sdf_size, write_sdf
from swath.tools.field_export.survey import pulse_count, survey
from swath.tools.scan.point_cloud import need_las, write_las

MB = 1e6
PIECE_BYTES = {"sdf": (400.0, 100.0), "glb": (192.0, 72.0)}  # of a rod of four sides, of a blade
POINT_BYTES = 34.0  # of a point of LAS, format 6 with the number of its pulse
SUFFIXES = {"sdf": ("",), "glb": (".glb",), "las": (".las", ".laz")}


@dataclass(frozen=True)
class Wanted:
    """to: sdf, glb or las; out: folder or file; place: middle [m], None = where the first machine meets the
    crop;
    ground: side of the square [m]; plants: radius [m]; per_m2: pulses of a survey; most: size [bytes]
    """

    to: str
    out: Path
    place: tuple[float, float] | None = None
    ground: float = 60.0
    plants: float = 3.0
    per_m2: float = 50.0
    most: float = 250 * MB


def export(world: World, wanted: Wanted, tell: Callable[[str], None]) -> list[Path]:
    """Write the field as it stands. Returns the files, what comes is told before. InputError for a name of
    another form and for what becomes larger than allowed.
    """
    suffix, known = wanted.out.suffix.lower(), SUFFIXES[wanted.to]
    if suffix not in known:
        raise InputError("--out", str(wanted.out), f"expected {_named(wanted.to)}")
    place = meeting_point(world) if wanted.place is None else np.array(wanted.place)
    tell(f"place     x = {place[0]:.2f} m, y = {place[1]:.2f} m, {wanted.ground:g} m x {wanted.ground:g} m")
    if wanted.to == "las":
        return _survey(world, wanted, place, tell)
    if wanted.to == "glb":
        need_trimesh()
    pieces = expected_pieces(world.field, place, wanted.plants)
    _check(wanted, sum(n * each for n, each in zip(pieces, PIECE_BYTES[wanted.to], strict=True)))
    scene = make_scene(world, place, ground_m=wanted.ground, plants_m=wanted.plants)
    size = glb_size(scene) if wanted.to == "glb" else sdf_size(scene)
    _tell_scene(scene, wanted, size, tell)
    _check(wanted, size)
    if wanted.to == "glb":
        return [_written(wanted.out, glb_bytes(scene))]
    return write_sdf(wanted.out, scene, world)


def meeting_point(world: World) -> F64:
    """Under the middle of the knife of the first machine that has one, else under the first machine."""
    machine = next((m for m in world.machines.values() if m.cuts), world.leader)
    sheet = machine.sheet
    ahead = [sheet.knife_x, sheet.header_y, 0.0] if machine.cuts else [0.0, 0.0, 0.0]
    return np.asarray(world.bodies.pose_of(machine.name).apply(ahead))[:2]


def _survey(world: World, wanted: Wanted, place: F64, tell: Callable[[str], None]) -> list[Path]:
    need_las()
    count = pulse_count(wanted.ground, wanted.per_m2)
    tell(f"survey    {count:,} pulses, {wanted.per_m2:g} per m2")
    _tell_size(count * POINT_BYTES, tell)
    _check(wanted, count * POINT_BYTES)
    cloud, classes = survey(world, place, side=wanted.ground, per_m2=wanted.per_m2)
    wanted.out.parent.mkdir(parents=True, exist_ok=True)
    return [write_las(wanted.out, cloud, world.leader.origin, classes=classes)]


def _tell_scene(scene: FieldScene, wanted: Wanted, size: float, tell: Callable[[str], None]) -> None:
    heights = scene.ground.heights
    low, high = float(np.nanmin(heights)), float(np.nanmax(heights))
    tell(f"heights   {len(scene.ground.x)} x {len(scene.ground.y)}, {low:.3f} m to {high:.3f} m")
    if (share := scene.ground.unknown_share) > 0.0:
        tell(f"note      {100 * share:.1f} % of the ground is beyond the terrain's map: taken as its lowest")
    counts = ", ".join(f"{s.name} {len(s.faces):,}" for s in scene.plants) or "none"
    tell(f"plants    within {wanted.plants:g} m, triangles: {counts}")
    tell(f"bodies    {', '.join(body.name for body in scene.bodies) or 'none'}")
    _tell_size(size, tell)


def _tell_size(size: float, tell: Callable[[str], None]) -> None:
    tell(f"size      about {size / MB:.1f} MB")


def _check(wanted: Wanted, size: float) -> None:
    """InputError where it becomes larger than allowed; says what would fit."""
    if size <= wanted.most:
        return
    share = wanted.most / size
    if wanted.to == "las":
        raise InputError(
            "--points-per-m2", wanted.per_m2, f"expected at most {wanted.per_m2 * share:.3g} for --most-mb "
            f"{wanted.most / MB:g}: it would be {size / MB:.0f} MB",
        )  # fmt: skip
    raise InputError(
        "--plants-m", wanted.plants, f"expected at most {wanted.plants * share**0.5:.2g} for --most-mb "
        f"{wanted.most / MB:g}: it would be {size / MB:.0f} MB",
    )  # fmt: skip


def _written(path: Path, data: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_whole(path, data)


def _named(form: str) -> str:
    """What `--out` of a form is called."""
    if form == "sdf":
        return "the name of a folder, without a suffix"
    return f"a name with {' or '.join(SUFFIXES[form])}"
