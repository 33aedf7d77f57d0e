"""Paths of pieces whose curvature changes linearly with the distance: straights, arcs, clothoids."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SPACING = 0.25  # m between the points of a path


class Pose(NamedTuple):
    """Place [m] and heading, counter-clockwise from east [rad]."""

    x: float
    y: float
    heading: float


def ahead_of(pose: Pose, way: float) -> Pose:
    """A pose so far straight ahead [m]."""
    return Pose(pose.x + way * math.cos(pose.heading), pose.y + way * math.sin(pose.heading), pose.heading)


class Piece(NamedTuple):
    """Curvature [1/m], > 0 to the left, from `first` to `last` over `length` [m]."""

    first: float
    last: float
    length: float


@dataclass(frozen=True)
class Path:
    """Points of a path in the order of driving. points (n, 2) [m]; heading [rad], curvature [1/m] and the
    distance from its start [m], shape (n,) each.
    """

    points: Array
    heading: Array
    curvature: Array
    distance: Array

    @property
    def length(self) -> float:
        """Length [m]."""
        return float(self.distance[-1])

    @property
    def start(self) -> Pose:
        """Where it begins."""
        return Pose(float(self.points[0, 0]), float(self.points[0, 1]), float(self.heading[0]))

    @property
    def end(self) -> Pose:
        """Where it ends."""
        return Pose(float(self.points[-1, 0]), float(self.points[-1, 1]), float(self.heading[-1]))

    def at(self, distance: float) -> Pose:
        """The pose at a distance from the start [m]; straight on beyond the ends."""
        inside = min(max(distance, 0.0), self.length)
        x = float(np.interp(inside, self.distance, self.points[:, 0]))
        y = float(np.interp(inside, self.distance, self.points[:, 1]))
        heading = float(np.interp(inside, self.distance, self.heading))
        beyond = distance - inside
        return Pose(x + beyond * math.cos(heading), y + beyond * math.sin(heading), heading)

    def depth(self) -> float:
        """How far it goes beyond its start, along its first heading [m]."""
        ahead = self.points - self.points[0]
        first = float(self.heading[0])
        return float((ahead[:, 0] * math.cos(first) + ahead[:, 1] * math.sin(first)).max())


def path_of(pieces: Sequence[Piece], start: Pose, spacing: float = SPACING) -> Path:
    """Points of pieces driven one after the other from a pose, at most `spacing` [m] apart.

    The heading is exact; places are integrated with three Gauss points a step, to 1e-9 m.
    """
    first, length, slope = [], [], []
    for piece in pieces:
        if piece.length < 1e-9:
            continue
        count = max(1, math.ceil(piece.length / spacing))
        step = piece.length / count
        rise = (piece.last - piece.first) / piece.length
        first += [piece.first + rise * step * i for i in range(count)]
        length += [step] * count
        slope += [rise] * count
    k, h, c = np.array(first), np.array(length), np.array(slope)
    turn = h * (k + 0.5 * c * h)
    heading = start.heading + np.concatenate([[0.0], np.cumsum(turn)])
    dx, dy = np.zeros(len(h)), np.zeros(len(h))
    for node, weight in ((-math.sqrt(0.6), 5 / 18), (0.0, 8 / 18), (math.sqrt(0.6), 5 / 18)):
        u = 0.5 * (1.0 + node) * h
        angle = heading[:-1] + u * (k + 0.5 * c * u)
        dx += weight * h * np.cos(angle)
        dy += weight * h * np.sin(angle)
    x = start.x + np.concatenate([[0.0], np.cumsum(dx)])
    y = start.y + np.concatenate([[0.0], np.cumsum(dy)])
    curvature = np.concatenate([k, [k[-1] + c[-1] * h[-1]] if len(k) else [0.0]])
    distance = np.concatenate([[0.0], np.cumsum(h)])
    return Path(np.stack([x, y], axis=1), heading, curvature, distance)


def polyline(points: Array, spacing: float = 1.0) -> Path:
    """A path along straight pieces from point to point, (n, 2) [m], without curvature."""
    points = np.asarray(points, dtype=float)
    steps = np.diff(points, axis=0)
    length = np.hypot(steps[:, 0], steps[:, 1])
    keep = np.concatenate([[True], length > 1e-9])
    points, length = points[keep], length[keep[1:]]
    at = np.concatenate([[0.0], np.cumsum(length)])
    count = max(1, math.ceil(at[-1] / spacing))
    fine = np.unique(np.concatenate([np.linspace(0.0, at[-1], count + 1), at]))
    x, y = np.interp(fine, at, points[:, 0]), np.interp(fine, at, points[:, 1])
    segment = np.clip(np.searchsorted(at, fine, side="right") - 1, 0, len(length) - 1)
    angle = np.array([math.atan2(b, a) for a, b in np.diff(points, axis=0).tolist()])
    heading = np.unwrap(angle)[segment] if len(angle) else np.zeros(len(fine))
    return Path(np.stack([x, y], axis=1), heading, np.zeros(len(fine)), fine)


def through(points: Array, radius: float) -> Path:
    """A path through points (n, 2) [m] that lie close together in bends. radius: of its tightest bend [m]"""
    steps = np.diff(np.asarray(points, dtype=float), axis=0)
    length = np.hypot(steps[:, 0], steps[:, 1])
    steps, length = steps[length > 1e-9], length[length > 1e-9]
    course = np.unwrap([math.atan2(y, x) for x, y in steps.tolist()])
    count = np.maximum(np.ceil(length), 1).astype(int)  # at most 1 m apart
    at = np.concatenate([[0.0], np.cumsum(np.repeat(length / count, count))])
    heading = np.repeat(course, count)
    x, y = (
        p + np.concatenate([[0.0], np.cumsum(np.repeat(s / count, count))])
        for p, s in zip(points[0], steps.T, strict=True)
    )
    curvature = np.zeros(len(at))
    curvature[1:-1] = np.diff(heading) / (0.5 * (at[2:] - at[:-2]))
    return Path(
        np.stack([x, y], axis=1),
        np.append(heading, heading[-1]),
        np.clip(curvature, -1.0 / radius, 1.0 / radius),
        at,
    )


def joined(paths: Sequence[Path]) -> Path:
    """Paths driven one after the other as one; each begins where the one before ends."""
    paths = [p for p in paths if len(p.points) > 1]
    at = 0.0
    points: list[Array] = []
    heading: list[Array] = []
    curvature: list[Array] = []
    distance: list[Array] = []
    for i, path in enumerate(paths):
        part = slice(0 if i == 0 else 1, None)
        turns = 0.0
        if i:
            turns = 2.0 * math.pi * round((float(heading[-1][-1]) - float(path.heading[0])) / (2.0 * math.pi))
        points.append(path.points[part])
        heading.append(path.heading[part] + turns)
        curvature.append(path.curvature[part])
        distance.append(path.distance[part] + at)
        at += path.length
    return Path(*(np.concatenate(a) for a in (points, heading, curvature, distance)))
