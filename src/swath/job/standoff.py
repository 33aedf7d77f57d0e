"""Standoffs: two machines that stand in each other's way, and which of them makes room.

A machine makes room by backing up over its own tracks, by driving on in an arc, or by both. Of all such
manoeuvres that its bodies can drive without touching what others hold, the shortest is taken after which
either it stands clear of the other one's way, or its own way leads clear of where the other one stands.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swath.job.driver import Driver, Place
from swath.job.footprint import overlap
from swath.job.path import Path, Piece, Pose, path_of
from swath.job.traffic import GAP, gap_to

Array = NDArray[np.float64]
PATIENCE = 4.0  # s that two stand before one makes room
BACK = (0.0, 4.0, 8.0, 12.0, 18.0, 24.0, 32.0, 40.0, 50.0)  # m
TURNS = (0.0, 0.35, -0.35, 0.8, -0.8, 1.57, -1.57)  # rad
STRAIGHT = (4.0, 10.0, 18.0, 30.0, 45.0)  # m behind an arc
OUT = (48.0, 36.0, 24.0, 16.0, 8.0)  # m that a combine drives on behind its last pass, where it can
OUT_EVERY = 0.5  # m between two places on that way that are looked at
OUT_TURN = 0.15  # rad, to one side where straight on is not clear
CLEAR = 40.0  # m of the way that is to be clear then
COST_BACK = 1.5  # of a metre backwards against one forwards
EVERY = 1.5  # m between two places that are looked at
MARGIN = 0.05  # m beyond GAP


@dataclass(frozen=True)
class Standoff:
    """time [s], place of the first [m]; solved_by: who made room, "" = nobody could; driven_on: who drove on
    in the end with the other one in its way, "" = nobody had to
    """

    time: float
    first: str
    second: str
    x: float
    y: float
    solved_by: str
    driven_on: str = ""


def manoeuvre(
    driver: Driver, others: list[Array], keep_clear: Array | None, way_from: Callable[[Pose], Path] | None,
    obstacle: Array, *, radius: float, only_back: bool = False, least: float = 0.0,
) -> tuple[float, Path | None, Array, float] | None:  # fmt: skip
    """The shortest manoeuvre by which a machine makes room: way back [m], path, ground and cost; None where
    it has none.

    others: what the others hold; keep_clear: ground that it has to leave; or way_from: its way from a place,
    that has to lead clear of an obstacle; radius: of its arcs [m]; least: cost
    """
    found: list[tuple[float, float, list[tuple[float, float]]]] = [(COST_BACK * b, b, []) for b in BACK]
    if not only_back:
        found += [
            (COST_BACK * back + radius * abs(turn) + straight, back, [(turn, straight)])
            for back, turn, straight in itertools.product(BACK, TURNS, STRAIGHT)
        ]
    gaps = gaps_to(driver, others)
    tails = _tails(driver, others, gaps)
    for cost, back, arcs in sorted(found, key=lambda f: f[0]):
        if cost < least or (back > 0.0 and back not in tails) or (back <= 0.0 and not arcs):
            continue
        begin = tails[back] if back > 0.0 else driver.place
        path, places = None, [begin]
        for turn, straight in arcs:
            bend = math.copysign(1.0 / radius, turn)
            path = path_of([Piece(bend, bend, radius * abs(turn)), Piece(0.0, 0.0, straight)], begin[0], 0.5)
            places = _pulled(driver, begin, path)
        swept = driver.footprint.sweep(places)
        if path is not None and not _is_clear(swept, others, gaps):
            continue
        last = driver.footprint.sweep([places[-1]])
        if keep_clear is not None:
            if not overlap(last, keep_clear, GAP + MARGIN):
                return back, path, _ground(driver, back, swept), cost
        elif way_from is not None:
            way = way_from(places[-1][0])
            count = math.ceil(min(CLEAR, way.length) / EVERY)
            onward = _pulled(driver, places[-1], way, count)
            if not overlap(driver.footprint.sweep(onward), obstacle, GAP + MARGIN):
                return back, path, _ground(driver, back, swept), cost
    return None


def way_out(
    driver: Driver, others: list[Array], radius: float, *,
    turns: tuple[float, ...] = (0.0, OUT_TURN, -OUT_TURN), suits: Callable[[Pose], bool] = lambda _: True,
) -> tuple[Path, Array] | None:  # fmt: skip
    """Way on from where a machine stands, straight or a little to one side, and its ground; None where that
    is not clear. turns: to the left [rad]; suits: whether it may end at a pose
    """
    gaps = gaps_to(driver, others)
    for way, turn in itertools.product(OUT, turns):
        bend = math.copysign(1.0 / radius, turn)
        path = path_of(
            [Piece(bend, bend, abs(turn) * radius), Piece(0.0, 0.0, way)], driver.machine.pose, 0.5
        )
        if not suits(path.end):
            continue
        places = [path.at(OUT_EVERY * i) for i in range(math.ceil(path.length / OUT_EVERY) + 1)]
        ground = driver.footprint.sweep([(p, p.heading) for p in places])
        if _is_clear(ground, others, gaps):
            return path, ground
    return None


def _is_clear(ground: Array, others: list[Array], gaps: list[float]) -> bool:
    return not any(overlap(ground, o, gap) for o, gap in zip(others, gaps, strict=True))


def _ground(driver: Driver, back: float, swept: Array) -> Array:
    return np.vstack([swept, driver.footprint.sweep(driver.behind(back)[::2])])


def gaps_to(driver: Driver, others: list[Array]) -> list[float]:
    """Gap to keep to each of the others [m]: little to one that is that near already."""
    now = driver.footprint.sweep([driver.place])
    return [gap_to(now, o, GAP + MARGIN) for o in others]


def _tails(driver: Driver, others: list[Array], gaps: list[float]) -> dict[float, Place]:
    """Where it is after backing up by each way that is clear."""
    found: dict[float, Place] = {}
    track = driver.behind(BACK[-1])
    here = driver.machine.pose
    gone, steps = 0.0, iter(BACK[1:])
    want = next(steps)
    for place in track:
        gone += math.hypot(place[0].x - here.x, place[0].y - here.y)
        here = place[0]
        if not _is_clear(driver.footprint.sweep([place]), others, gaps):
            break
        if gone >= want:
            found[want] = place
            want = next(steps, math.inf)
    return found


def _pulled(driver: Driver, begin: Place, path: Path, most: int = 1000) -> list[Place]:
    """Places along a path, with the trailer as it follows."""
    machine = driver.machine.copied()
    machine.set_down(*begin)
    found = [begin]
    for i in range(min(math.ceil(path.length / EVERY), most)):
        for part in (1.0 / 3.0, 2.0 / 3.0, 1.0):
            machine.pull_to(path.at(min((i + part) * EVERY, path.length)))
        found.append((machine.pose, machine.trailer))
    return found
