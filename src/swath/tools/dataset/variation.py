"""What varies between the pictures of a data set: each a function of the seed and its number alone."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, hypot, sin

import numpy as np

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.units import DEG
from swath.field.obstacles import SheetKind, SheetObstacle

CROPS = ("wheat", "barley", "rye")
DENSITIES = (300, 400, 500)  # stems/m2
KINDS: tuple[tuple[SheetKind, float, float], ...] = (  # kind, weight, least distance [m]
    ("person", 0.42, 4.0),
    ("animal", 0.16, 4.0),
    ("vehicle", 0.18, 8.0),
    ("tree", 0.1, 15.0),
    ("hedge", 0.06, 15.0),
    ("building", 0.08, 28.0),
)
MOST_THINGS = 5
STRAW_SHARE, STRAW_KG_M = 0.6, 3.0  # of the scenes with a straw swath; per metre
TURN_SD, PITCH_SD, ROLL_SD, HEIGHT_SD = 6.0, 3.0, 1.5, 0.15  # of the camera about its mount [deg, m]


@dataclass(frozen=True)
class Scene:
    """A field, its light and air. sets: changes of the scenario; straw: a swath of the pass before"""

    number: int
    sets: tuple[str, ...]
    straw: bool


@dataclass(frozen=True)
class View:
    """A picture of a scene. along: of the camera's machine behind its start [m]; aside: leftward [m]
    shift: pose_mount_camera
    """

    along: float
    aside: float
    shift: Pose


def scene_of(seed: int, number: int, machine: str, camera: str, *, varies: Sequence[str]) -> Scene:
    """Scene number k of a seed. varies: of `terrain`, `stand`, `light`"""
    draw = Stream(seed, "dataset.scene").at(number)
    u = draw.uniform(size=14).tolist()
    crop, density = CROPS[int(u[0] * len(CROPS))], DENSITIES[int(u[1] * len(DENSITIES))]
    sets = [f"field.seed={int(1 + u[2] * 1e6)}"]
    if "terrain" in varies:
        slope = f"slope_percent: {6 * u[3]:.2f}, slope_azimuth_deg: {360 * u[4]:.0f}"
        sets.append(f"field.terrain={{level: formula, {slope}}}")
    if "stand" in varies:
        grown = f"crop: {crop}, stems_per_m2: {density}, height_factor: {0.85 + 0.3 * u[6]:.2f}"
        patchy = f"density_variation: {{sd_percent: {15 * u[7]:.1f}}}"
        sets.append(f"field.stand={{level: maps, {grown}, {patchy}, lean_deg: {20 * u[5]:.1f}}}")
    if "light" in varies:
        at = f"{machine}.{camera}"
        cloud = max(0.0, 180.0 * u[8] - 80.0)
        dust = 0.0 if u[9] < 0.7 else 0.002 * 15.0 ** ((u[9] - 0.7) / 0.3)
        sets += [
            f"{at}.sun_azimuth_deg={360 * u[10]:.0f}",
            f"{at}.sun_elevation_deg={12 + 48 * u[11]:.0f}",
            f"{at}.cloud_percent={cloud:.0f}",
            f"{at}.weather.extinction_per_m={dust:.4f}",
            f"{at}.green_percent={max(0.0, 120 * (u[12] - 0.75)):.0f}",
        ]
    return Scene(number, tuple(sets), u[13] < STRAW_SHARE)


def view_of(seed: int, number: int, place: int) -> View:
    """Picture number i of a seed, at the k-th place of its scene."""
    draw = Stream(seed, "dataset.view").at(number)
    a, b, c, d = draw.standard_normal(4).tolist()
    along, aside = draw.uniform(0.0, 4.0), draw.uniform(-3.0, 3.0)
    shift = Pose.from_euler(
        (0.0, 0.0, HEIGHT_SD * a), ROLL_SD * DEG * b, PITCH_SD * DEG * c, TURN_SD * DEG * d
    )
    return View(10.0 * place + float(along), float(aside), shift)


def things_of_view(
    seed: int, number: int, eye: Pose, half_angle: float, reach: float
) -> tuple[SheetObstacle, ...]:
    """Things that stand in the view of a camera (pose_world_sensor, x forward), apart from each other."""
    draw = Stream(seed, "dataset.things").at(number)
    x0, y0, ahead = float(eye.position[0]), float(eye.position[1]), eye.euler()[2]
    weights = np.cumsum([weight for _, weight, _ in KINDS])
    found: list[SheetObstacle] = []
    for _ in range(int(draw.integers(0, MOST_THINGS + 1))):
        pick, near, side, turn, tall = draw.uniform(size=5).tolist()
        kind, _, least = KINDS[int(np.searchsorted(weights, pick * weights[-1]))]
        most = max(reach - 5.0, least + 1.0)
        distance = least * (most / least) ** near  # as often near as far
        angle = ahead + (2.0 * side - 1.0) * half_angle
        x, y = round(x0 + distance * cos(angle), 2), round(y0 + distance * sin(angle), 2)
        room = {"tree": 4.0, "hedge": 7.0, "building": 14.0, "vehicle": 3.5}.get(kind, 1.0)
        if any(hypot(o.x_m - x, o.y_m - y) < room + 2.0 for o in found):
            continue
        height = {"person": 1.55 + 0.4 * tall, "tree": 5.0 + 6.0 * tall}.get(kind)
        heading = 180.0 * (2.0 * turn - 1.0)
        name = f"{kind} {number}.{len(found)}"
        found.append(
            SheetObstacle(kind=kind, x_m=x, y_m=y, name=name, heading_deg=round(heading, 1), height_m=height)
        )
    return tuple(found)
