"""Harvests that are drawn: where and when a machine was, what its sensor showed, and what grew there."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.field.maps.projection import Origin, transform, utm_epsg
from tests.field.drawn_logs import drive, late, yields

CROPS = {  # lb a bushel, moisture of trade, usual moistures [%], usual yields [t/ha], names
    "wheat": (60, 0.135, (12, 17), (4, 10), ("Wheat", "Winterweizen")),
    "barley": (48, 0.145, (12, 17), (4, 9), ("Winter Barley", "Wintergerste")),
    "maize": (56, 0.155, (16, 30), (6, 15), ("Corn", "Körnermais")),
    "rape": (50, 0.09, (6, 11), (2.2, 5), ("Canola", "Winterraps")),
    "rye": (56, 0.14, (12, 17), (4, 9), ("Rye", "Roggen")),
    "soy": (60, 0.13, (10, 16), (2, 5), ("Soybeans", "Sojabohnen")),
}
PLACES = {
    "N E": (48.1, 11.3), "N W": (40.7, -96.4), "Greenwich": (52.3, -0.9), "S E": (-33.4, 148.2),
    "S W": (-35.1, -60.4), "zone border": (51.2, 11.9995), "far north": (61.8, 23.1),
}  # fmt: skip
SLOW_LAG = 1.5  # s: of a flow that dies away slowly
MEASURED = ("mf4", "asc", "blf")
TABLES = ("csv", "shapefile", "geojson")


class Axes:
    """What is drawn: each value of an axis is noted; those of `kept` (axis -> values) are left out."""

    def __init__(self, rng: np.random.Generator, kept: Mapping[str, Collection[Any]]) -> None:
        self.rng, self.kept = rng, kept
        self.usual: list[str] = []
        self.chosen: dict[str, Any] = {}

    def pick(self, axis: str, values: Sequence[Any], weights: Sequence[float] | None = None) -> Any:
        """A value of an axis."""
        left = self.allowed(axis, values)
        share = np.array([1.0 if weights is None else weights[values.index(v)] for v in left])
        value = left[int(self.rng.choice(len(left), p=share / share.sum()))]
        self.chosen[axis] = value
        self.usual.append(f"{axis}={value}")
        return value

    def allowed(self, axis: str, values: Sequence[Any]) -> list[Any]:
        """Values that may be drawn."""
        return [v for v in values if v not in self.kept.get(axis, ())]

    def within(self, low: float, high: float) -> float:
        """A number."""
        return float(self.rng.uniform(low, high))


@dataclass
class Records:
    """Records of a harvest in driven order, shape (n,): t [s], x, y [m], v [m/s], way [m] since the last one,
    flow [kg/s] as the sensor shows it, wet: true yield there [kg/m2], nan out of the crop; width [m];
    moisture: share of the wet mass; up: header out of work; machine and part: numbers; off [m]: of a part to
    the right; course: counter-clockwise from x [rad].
    """

    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    v: np.ndarray
    way: np.ndarray
    flow: np.ndarray
    wet: np.ndarray
    width: np.ndarray
    moisture: np.ndarray
    up: np.ndarray
    machine: np.ndarray
    part: np.ndarray
    off: np.ndarray
    course: np.ndarray

    def take(self, index: Any) -> "Records":
        """Some of them, in this order."""
        return Records(**{k: v[index] for k, v in vars(self).items()})


def harvest(axes: Axes) -> tuple[Records, dict[str, float]]:
    """Records, and the true area [ha], delay [s] and number of passes."""
    rng = axes.rng
    passes = int(rng.integers(7, 13))
    machines = axes.pick("machines", [1, 2] if axes.chosen["format"] in TABLES else [1], [4, 1])
    width, length = axes.within(4.0, 12.5), axes.within(110, 230)
    speed, interval = axes.within(1.2, 2.5), 1.0 / axes.pick("rate", [0.5, 1.0, 2.0, 5.0], [1, 3, 1, 1])
    low, high = CROPS[axes.chosen["crop"]][3]
    level = axes.within(low, high)
    grown = yields(rng, axes.within(0.03, 0.12), 30.0)
    turns = axes.pick("turns", ["not logged", "logged", "logged, flow dies away", "logged, flow 0",
                                "logged, flow held"])  # fmt: skip
    delay = 0.0 if axes.pick("delay", ["taken off", "left"]) == "taken off" else axes.within(3, 14)
    is_logged, has_stops = turns != "not logged", bool(rng.integers(2))
    lag = SLOW_LAG if turns == "logged, flow dies away" else axes.within(0.3, 0.8)
    delay = max(delay, SLOW_LAG) if turns == "logged, flow dies away" else delay
    slant, lead = axes.within(-0.3, 0.3), axes.within(0.5, 2.0) if is_logged else 0.0
    wander, noise, parts = axes.within(0.01, 0.08), axes.within(0.01, 0.05), []
    for index in range(machines):
        lanes = np.arange(index, passes, machines)
        own_speed, turn_s = speed * axes.within(0.95, 1.05), axes.within(14, 24)
        first_up = bool(rng.integers(2))
        x, y, cuts, ends = drive(
            rng, lanes, first_up, length, slant, width, own_speed, turn_s, lead, has_stops
        )
        v = np.hypot(np.gradient(x), np.gradient(y)) / 0.1
        wet = np.where(cuts, grown(x, y) * level / 6.0, np.nan)
        flow = late(rng, np.nan_to_num(wet) * v * width, delay, lag)
        up = ends % 2 == 1
        if turns == "logged, flow 0":
            flow = np.where(up, 0.0, flow)
        elif turns == "logged, flow held":
            flow = flow[np.maximum.accumulate(np.where(up, 0, np.arange(len(x))))]
        rows = np.arange(int(rng.integers(0, 10)), len(x), round(interval * 10))
        rows = rows if is_logged else rows[~up[rows]]
        begun = np.maximum(rows - round(interval * 10), 0)
        track = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
        shown = np.maximum(flow[rows] * (1 + noise * rng.standard_normal(len(rows))), 0.0)
        count = len(rows)
        parts.append(Records(
            t=np.round(rows * 0.1, 3), x=x[rows] + rng.normal(0, wander, count),
            y=y[rows] + rng.normal(0, wander, count),
            v=v[rows], way=track[rows] - track[begun], flow=shown, wet=wet[rows], width=np.full(count, width),
            moisture=np.full(count, axes.chosen["moisture"]) + 0.004 * np.sin(y[rows] / 40), up=up[rows],
            machine=np.full(count, index), part=np.zeros(count, int), off=np.zeros(count),
            course=np.arctan2(np.gradient(y), np.gradient(x))[rows],
        ))  # fmt: skip
    joined = Records(**{k: np.concatenate([getattr(p, k) for p in parts]) for k in vars(parts[0])})
    made = joined.take(np.argsort(joined.t, kind="stable"))
    axes.chosen |= {"interval": interval, "passes": passes}
    size = passes * width * length / 1e4
    return made, {"area": size, "slack": passes * width * speed * interval / 1e4, "delay": delay}


def in_parts(records: Records, shares: Sequence[float]) -> Records:
    """A row for each part of the header, side by side from left to right."""
    step = np.arange(len(records.t))
    index = np.repeat(step, len(shares))
    made = records.take(index)
    share, number = np.tile(shares, len(step)), np.tile(np.arange(len(shares)), len(step))
    middle = np.cumsum(shares) - np.array(shares) / 2 - 0.5
    made.off = made.width * np.tile(middle, len(step))
    made.width, made.flow, made.part = made.width * share, made.flow * share, number
    return made


def places(records: Records, axes: Axes) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]:
    """lon, lat [deg], easting and northing [m] of records, and the EPSG code of these."""
    lat, lon = PLACES[axes.chosen["place"]]
    turn = axes.chosen["turn"]
    x = records.x + records.off * np.sin(records.course)
    y = records.y - records.off * np.cos(records.course)
    epsg = utm_epsg(lon, lat)
    east, north = transform([[lon, lat]], "EPSG:4326", f"EPSG:{epsg}")[0]
    local = np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y], axis=1)
    lon, lat = Origin(epsg, east, north).to_lon_lat(local).T
    return lon, lat, east + local[:, 0], north + local[:, 1], epsg
