"""From a world to files: sizes reported first, then written.

`survey` is a virtual one: pulses of a scanner that flies over the field, each to what it meets first.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np

from swath.core.errors import InputError
from swath.core.files.whole_file import write_whole
from swath.core.frames import rotation_matrix
from swath.core.number_text import num, percent_of
from swath.field.memory_layout import Organ
from swath.field.solid.solids import merge
from swath.rays.engine import RayCaster
from swath.runtime.world import World
from swath.signals import F64, U8
from swath.tools.field_export.glb import glb_bytes, glb_size, need_trimesh
from swath.tools.field_export.scene import FieldScene, expected_pieces, known_ground, make_scene
from swath.tools.field_export.sdf import sdf_size, write_sdf
from swath.tools.scan.point_cloud import RECORD, Cloud, need_las, write_las

HEIGHT_M = 40.0  # of the scanner above the ground in the middle
SPEED_M_S = 5.0  # of the flight, for the time of a pulse
OTHER, GROUND, LOW, MEDIUM, HIGH = 1, 2, 3, 4, 5  # classes of ASPRS LAS 1.4; the last three are vegetation
LOW_M, MEDIUM_M = 0.5, 2.0  # tops of low and medium vegetation above the ground
GOLDEN = (
    0.7548776662466927,
    0.5698402909980532,
)  # low-discrepancy steps in the plane: 1/g, 1/g2 with g3 = g + 1
HARD = {Organ.GROUND: GROUND, Organ.SOLID: OTHER}


def pulse_count(side: float, per_m2: float) -> int:
    """Pulses of a survey of a square [m]."""
    return int(side**2 * per_m2)


def survey(world: World, place: F64, *, side: float, per_m2: float) -> tuple[Cloud, U8]:
    """Points of one line flown over the middle of a square, along the rows, and their ASPRS classes.

    place: middle, (2,) [m]; per_m2: pulses on level ground. Exact places, no noise; intensity is reflectance
    times the cosine of incidence. Pulses go to known ground alone; InputError where there is none.
    """
    field, number = world.field, np.arange(1, pulse_count(side, per_m2) + 1)
    aim = place + side * ((number[:, None] * np.array(GOLDEN)) % 1.0 - 0.5)
    aim = aim[known_ground(field, *aim.T)]
    field.ensure(float(place[0]), float(place[1]), 0.5 * side * 2**0.5 + HEIGHT_M)
    along = rotation_matrix(0.0, 0.0, field.stand_yaw)[:2, 0]
    along_line = (aim - place) @ along
    order = np.argsort(along_line, kind="stable")
    aim, along_line = aim[order], along_line[order]
    ground = np.asarray(field.ground_height(*aim.T), dtype=float)
    top = float(np.nanmax(ground)) + HEIGHT_M
    origins = np.column_stack([place + along_line[:, None] * along, np.full(len(aim), top)])
    to = np.column_stack([aim, ground]) - origins
    directions = to / np.linalg.norm(to, axis=1)[:, None]
    solids = merge(*(body.solids for body in world.bodies.in_sight("")))
    hits = RayCaster(field).cast(origins, directions, range_max=2.0 * side + 2.0 * HEIGHT_M, solids=solids)
    seen = hits.is_hit
    points = origins[seen] + hits.distance[seen, None].astype(float) * directions[seen]
    cloud = np.zeros(int(seen.sum()), RECORD)
    for k, axis in enumerate("xyz"):
        cloud[axis] = points[:, k]
    across = (aim - place) @ np.array([-along[1], along[0]])
    cloud["intensity"] = (hits.reflectance * hits.cosine)[seen]
    cloud["time"] = (along_line[seen] - along_line[0]) / SPEED_M_S
    cloud["azimuth"] = np.clip(np.arctan2(across, top - ground), -pi, pi)[seen]
    cloud["beam"] = np.flatnonzero(seen)
    cloud["echo_count"] = 1
    above = points[:, 2] - np.asarray(field.ground_height(points[:, 0], points[:, 1]), dtype=float)
    return cloud, _classes(hits.organ[seen], above)


def _classes(organs: U8, above: F64) -> U8:
    """ASPRS classes of what was hit, so many metres above the ground; straw and stubble are low
    vegetation.
    """
    found = np.where(above < LOW_M, LOW, np.where(above < MEDIUM_M, MEDIUM, HIGH)).astype(np.uint8)
    for organ, number in HARD.items():
        found[organs == organ] = number
    return found


MB = 1e6
PIECE_BYTES = {"sdf": (400.0, 100.0), "glb": (192.0, 72.0)}  # of a rod of four sides, of a blade
POINT_BYTES = 34.0  # of a point of LAS, format 6 with the number of its pulse
SUFFIXES = {"sdf": ("",), "glb": (".glb",), "las": (".las", ".laz")}


@dataclass(frozen=True)
class Wanted:
    """to: sdf, glb or las; out: folder or file; place: middle [m], None = where the first machine meets the
    crop;
    ground: side of the square [m]; plants: radius [m]; per_m2: pulses of a survey; most: size [bytes].
    """

    to: str
    out: Path
    place: tuple[float, float] | None = None
    ground: float = 60.0
    plants: float = 3.0
    per_m2: float = 50.0
    most: float = 250 * MB


def export(world: World, wanted: Wanted, tell: Callable[[str], None]) -> list[Path]:
    """Write the field as it stands.

    Returns the files, what comes is reported before. InputError for a name of another form and for what
    becomes larger than allowed.
    """
    suffix, known = wanted.out.suffix.lower(), SUFFIXES[wanted.to]
    if suffix not in known:
        raise InputError("--out", str(wanted.out), f"expected {_named(wanted.to)}")
    place = meeting_point(world) if wanted.place is None else np.array(wanted.place)
    tell(f"place     x = {num(place[0])} m, y = {num(place[1])} m, {num(wanted.ground)} m wide")
    if wanted.to == "las":
        return _survey(world, wanted, place, tell)
    if wanted.to == "glb":
        need_trimesh()
    pieces = expected_pieces(world.field, place, wanted.plants)
    _check(wanted, sum(n * each for n, each in zip(pieces, PIECE_BYTES[wanted.to], strict=True)))
    scene = make_scene(world, place, ground_m=wanted.ground, plants_m=wanted.plants)
    size = glb_size(scene) if wanted.to == "glb" else sdf_size(scene)
    _tell_scene(scene, wanted, tell)
    _check(wanted, size, tell)
    if wanted.to == "glb":
        return [write_whole(wanted.out, glb_bytes(scene))]
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
    tell(f"survey    {num(count)} pulses, {num(wanted.per_m2)} per m2")
    _check(wanted, count * POINT_BYTES, tell)
    cloud, classes = survey(world, place, side=wanted.ground, per_m2=wanted.per_m2)
    return [write_las(wanted.out, cloud, world.leader.origin, classes=classes)]


def _tell_scene(scene: FieldScene, wanted: Wanted, tell: Callable[[str], None]) -> None:
    heights = scene.ground.heights
    low, high = float(np.nanmin(heights)), float(np.nanmax(heights))
    tell(f"heights   {len(scene.ground.x)} x {len(scene.ground.y)}, {num(low)} m to {num(high)} m")
    if (share := scene.ground.unknown_share) > 0.0:
        tell(f"note      {percent_of(share)} of the ground is beyond the terrain's map: taken as its lowest")
    counts = ", ".join(f"{s.name} {num(len(s.faces))}" for s in scene.plants) or "none"
    tell(f"plants    within {num(wanted.plants)} m, triangles: {counts}")
    tell(f"bodies    {', '.join(body.name for body in scene.bodies) or 'none'}")


def _check(wanted: Wanted, size: float, tell: Callable[[str], None] = lambda text: None) -> None:
    """InputError where it becomes larger than allowed; says what would fit."""
    tell(f"size      about {num(size / MB)} MB")
    if size <= wanted.most:
        return
    share, key, value = wanted.most / size, "--points-per-m2", wanted.per_m2
    if wanted.to != "las":
        share, key, value = share**0.5, "--plants-m", wanted.plants
    fits = f"expected at most {num(value * share)} for --most-mb {num(wanted.most / MB)}"
    raise InputError(key, value, f"{fits}: it would be {num(size / MB)} MB")


def _named(form: str) -> str:
    """What `--out` of a form is called."""
    if form == "sdf":
        return "the name of a folder, without a suffix"
    return f"a name with {' or '.join(SUFFIXES[form])}"
