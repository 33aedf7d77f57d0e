"""Drawn jobs: outlines, machines and crops that nobody chose."""

import math
from functools import cache

import numpy as np

from swath.fleet.files import (
    CartSettings,
    CombineSettings,
    FieldSettings,
    JobFile,
    PlanSettings,
    TruckSettings,
)
from swath.fleet.ground import shapely_here
from swath.fleet.schedule import Schedule, schedule_of

CORNER = math.radians(40.0)  # least of an outline
SMALL = (0.5, 1.0)  # ha


@cache
def scheduled(seed: int, hectares: tuple[float, float] = SMALL) -> Schedule:
    """The schedule of a drawn job, made once for all tests that read it."""
    return schedule_of(drawn_job(seed, hectares))


def drawn_job(seed: int, hectares: tuple[float, float] = (1.0, 6.0)) -> JobFile:
    """A job of a seed: size, shape (convex, concave, with holes, two parts), turned and moved at random."""
    rng = np.random.default_rng(seed)
    area = 1e4 * rng.uniform(*hectares)
    shape = ["convex", "concave", "holes", "two"][int(rng.integers(4))]
    rings = [_outline(rng, area if shape != "two" else 0.55 * area, shape == "concave" or rng.random() < 0.2)]
    holes = _holes(rng, rings[0]) if shape == "holes" else []
    if shape == "two":
        other = _outline(rng, 0.45 * area, rng.random() < 0.3)
        gap = rng.uniform(5.0, 25.0)
        rings.append(other + np.array([rings[0][:, 0].max() - other[:, 0].min() + gap, 0.0]))
    truck = _truck(rng, rings)
    turn, move = rng.uniform(-math.pi, math.pi), rng.uniform(-3000.0, 3000.0, 2)

    def placed(points):
        c, s = math.cos(turn), math.sin(turn)
        p = np.atleast_2d(points)
        return [(float(c * x - s * y + move[0]), float(s * x + c * y + move[1])) for x, y in p]

    combines = {f"combine_{i + 1}": _combine(rng) for i in range(rng.integers(1, 5))}
    carts = {f"cart_{i + 1}": _cart(rng) for i in range(rng.integers(0, 5))}
    ((x, y),) = placed(truck)
    volume = float(rng.uniform(20.0, 40.0)) if rng.random() < 0.25 else None
    return JobFile(
        format="swath fleet 1",
        name=f"drawn {seed}",
        field=FieldSettings(
            boundary_m=placed(rings[0]),
            holes_m=[placed(h) for h in holes],
            parts_m=[placed(r) for r in rings[1:]],
            yield_t_ha=float(rng.uniform(2.0, 13.0)),
        ),
        plan=PlanSettings(headland_rounds=int(rng.integers(0, 3))),
        combines=combines,
        carts=carts,
        truck=TruckSettings(x_m=x, y_m=y, volume_m3=volume, away_min=float(rng.uniform(5.0, 30.0))),
    )


def _combine(rng) -> CombineSettings:
    if rng.random() < 0.35:
        return CombineSettings(
            machine="combine-5m",
            speed_kmh=float(rng.uniform(3.0, 6.0)),
            turn_radius_m=float(rng.uniform(5.0, 7.0)),
        )
    return CombineSettings(
        machine="lexion-700",
        header_width_m=float(rng.uniform(6.0, 12.0)),
        speed_kmh=float(rng.uniform(4.0, 9.0)),
        turn_radius_m=float(rng.uniform(6.0, 8.0)),
        call_percent=float(rng.uniform(20.0, 70.0)),
    )


def _cart(rng) -> CartSettings:
    return CartSettings(
        speed_kmh=float(rng.uniform(10.0, 22.0)),
        turn_radius_m=float(rng.uniform(8.0, 10.0)),
        leave_percent=float(rng.uniform(30.0, 90.0)),
    )


def _outline(rng, area: float, is_concave: bool) -> np.ndarray:
    """Points (n, 2) of an outline of an area [m2], corners of 40 degrees at least, sides of 15 m."""
    while True:
        count = int(rng.integers(4, 9 if is_concave else 7))
        angle = np.sort(rng.uniform(0.0, 2.0 * math.pi, count))
        radius = rng.uniform(0.35 if is_concave else 0.8, 1.2, count)
        points = np.column_stack([radius * np.cos(angle) * rng.uniform(1.0, 2.2), radius * np.sin(angle)])
        polygon = shapely_here().Polygon(points)
        if not polygon.is_valid or polygon.area < 0.3:
            continue
        points = points * math.sqrt(area / polygon.area)
        inner = _angles(points)
        reflex = (inner > math.pi + 0.2).any()
        sides = np.hypot(*(points - np.roll(points, 1, axis=0)).T)
        if (
            inner.min() > CORNER
            and sides.min() > 15.0
            and reflex == is_concave
            and inner.max() < math.radians(320)
        ):
            return points - points.min(axis=0)


def _angles(points: np.ndarray) -> np.ndarray:
    """Inner angles of an outline, anticlockwise."""
    a, b = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
    turn = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1))
    return math.pi - turn


def _holes(rng, ring: np.ndarray) -> list[np.ndarray]:
    """One or two ponds, 20 m from the outline and each other at least."""
    shapely = shapely_here()
    inside, holes = shapely.Polygon(ring).buffer(-20.0), []
    for _ in range(200):
        if len(holes) == 2 or inside.is_empty:
            break
        middle = rng.uniform(ring.min(axis=0), ring.max(axis=0))
        angle = np.sort(rng.uniform(0.0, 2.0 * math.pi, rng.integers(4, 8)))
        hole = middle + rng.uniform(5.0, 20.0) * np.column_stack([np.cos(angle), np.sin(angle)])
        polygon = shapely.Polygon(hole)
        if polygon.area > 60.0 and _angles(hole).min() > CORNER and inside.contains(polygon):
            holes.append(hole)
            inside = inside.difference(polygon.buffer(20.0))
            if rng.random() < 0.5:
                break
    return holes


def _truck(rng, rings: list[np.ndarray]) -> np.ndarray:
    """A place outside, 8 to 150 m from the nearest outline."""
    shapely = shapely_here()
    parts = shapely.union_all([shapely.Polygon(r) for r in rings])
    low, high = np.concatenate(rings).min(axis=0), np.concatenate(rings).max(axis=0)
    while True:
        place = rng.uniform(low - 150.0, high + 150.0)
        if 8.0 < parts.distance(shapely.Point(place)) < 150.0:
            return place
