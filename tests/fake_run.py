"""A run without a simulator: a field on a fine grid and a machine that follows a prescribed path.

Shared by the tests of recording, metrics and report. The signals come in the order a graph publishes them.
"""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from swath.core.frames import Pose
from swath.record.message_factory import RecordedMachine
from swath.signals import (
    CropEdge,
    CropFlow,
    MachineLoad,
    MachineState,
    Odometry,
    Scan,
    ScanTruth,
    SpeedCommand,
    SteerCommand,
    SteerState,
)
from swath.signals.setup import MachineGeometry

NS = 1_000_000_000
GEOMETRY = MachineGeometry(3.7, 3.2, 3.0, 0.6, 7.0, 4.0, 0.0, 1.0, 1.0, (-6.0, 2.0, 1.6, 0.5, 3.9))
MOUNTING = Pose.from_euler([2.0, 3.5, 3.8], pitch=np.radians(20.0))


def machine(side="left", edge=None, name="combine"):
    return RecordedMachine(name, GEOMETRY, side, {"lidar": MOUNTING}, edge=edge or ArcEdge())


@dataclass
class ArcEdge:
    """Edge along a circle of radius R through the origin (0 = straight, east), crop on the right or left."""

    radius: float = 0.0
    crop_on_right: bool = True
    length: float = 200.0

    def signed_distance(self, x, y):
        """> 0 on the crop side. The circle bends left, its centre is (0, R)."""
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        right = -y if self.radius == 0 else np.hypot(x, y - self.radius) - self.radius
        return right if self.crop_on_right else -right

    def project(self, x, y):
        """Arc length and distance to the left of the edge."""
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        along = x if self.radius == 0 else self.radius * np.arctan2(x, self.radius - y)
        return along, self.signed_distance(x, y) * (-1.0 if self.crop_on_right else 1.0)

    def pose(self, s, offset=0.0):
        """World pose at arc length s, `offset` to the left of the edge, heading along it."""
        if self.radius == 0:
            return Pose.from_euler([s, offset, 0.0])
        a = s / self.radius
        r = self.radius - offset
        return Pose.from_euler([r * np.sin(a), self.radius - r * np.cos(a), 0.0], yaw=a)

    def point_at(self, s):
        return self.pose(s).position[:2]

    def heading_at(self, s):
        return self.pose(s).euler()[2]


@dataclass
class GridField:
    """Standing crop on cells of `cell` [m]: 0.8 kg/m2 of grain and 0.6 of straw."""

    nominal_edge: ArcEdge
    gap: tuple = (1e9, 1e9)
    low: tuple = (-20.0, -30.0)
    size: tuple = (120.0, 60.0)
    cell: float = 0.05
    soil: object = None
    ground_grain_kg: float = 0.0
    is_cut: np.ndarray = field(init=False)

    def __post_init__(self):
        nx, ny = int(self.size[0] / self.cell), int(self.size[1] / self.cell)
        x = self.low[0] + (np.arange(nx) + 0.5) * self.cell
        y = self.low[1] + (np.arange(ny) + 0.5) * self.cell
        self.x, self.y = np.meshgrid(x, y, copy=False)
        self.crop = self.nominal_edge.signed_distance(self.x, self.y) > 0
        self.crop &= (self.x < self.gap[0]) | (self.x > self.gap[1])
        self.is_cut = np.zeros_like(self.crop)

    def _index(self, x, y):
        i = np.floor((np.asarray(y) - self.low[1]) / self.cell).astype(int)
        j = np.floor((np.asarray(x) - self.low[0]) / self.cell).astype(int)
        return np.clip(i, 0, self.crop.shape[0] - 1), np.clip(j, 0, self.crop.shape[1] - 1)

    def standing(self, x, y):
        at = self._index(x, y)
        return self.crop[at] & ~self.is_cut[at]

    def standing_along(self, starts, step, count):
        middle = np.arange(count) + 0.5
        x, y = np.array(starts).T[:, :, None]
        return self.standing(x + step[0] * middle, y + step[1] * middle)

    boundary = None
    rows = None

    def each_outside(self, x, y):
        inside = (x > self.low[0]) & (x < self.low[0] + self.size[0])
        return ["" if own.any() else "beyond its boundary" for own in inside]

    def ground_height(self, x, y):
        return np.zeros(np.broadcast(x, y).shape)

    def straw_depth(self, x, y):
        at = self._index(x, y)
        return np.where(self.is_cut[at], 0.05, 0.0)

    def _inside(self, polygon):
        polygon = np.asarray(polygon)
        nxt = np.roll(polygon, -1, axis=0)
        low, high = self._index(*polygon.min(axis=0)), self._index(*polygon.max(axis=0))
        rows, columns = slice(low[0], high[0] + 1), slice(low[1], high[1] + 1)
        x, y = self.x[rows, columns], self.y[rows, columns]
        area = np.sum(polygon[:, 0] * nxt[:, 1] - polygon[:, 1] * nxt[:, 0])
        turn = np.sign(area)
        inside = np.ones(x.shape, dtype=bool)
        for (ax, ay), (bx, by) in zip(polygon, nxt, strict=True):
            inside &= turn * ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) >= 0
        return (rows, columns), inside

    def cut(self, polygon):
        window, inside = self._inside(polygon)
        fresh = inside & self.crop[window] & ~self.is_cut[window]
        self.is_cut[window] |= inside
        return self._mass(int(fresh.sum()))

    def standing_area(self, polygon):
        window, inside = self._inside(polygon)
        return float((inside & self.crop[window] & ~self.is_cut[window]).sum()) * self.cell**2

    def standing_areas(self, triangles):
        return np.array([self.standing_area(own) for own in triangles])

    def recount(self):
        return self._mass(int((self.crop & self.is_cut).sum()))

    def _mass(self, cells):
        area = cells * self.cell**2
        return SimpleNamespace(
            grain=0.8 * area, straw=0.6 * area, area=area, stem_count=int(500 * area), stubble=0.2 * area
        )


def drive(observers, ground, *, side="left", seconds=12.0, speed=2.0, lateral=0.1, edge_error=0.02, hz=100):
    """Publish a run: the header end `lateral` too far to the crop side, the edge seen `edge_error` so."""
    edge = ground.nominal_edge
    sign = 1.0 if side == "left" else -1.0
    end = np.array([*GEOMETRY.header_end(side), 0.0])
    tank, dropped, before = 0.0, 0.0, None
    scan_every, rng = hz // 25, np.random.default_rng(1)

    def publish(slot, t, **outputs):
        for observe in observers:
            observe(f"combine.{slot}", t, outputs)

    for step in range(int(seconds * hz) + 1):
        t = step * NS // hz
        s = speed * step / hz
        pose = _placed(edge, s, end, -sign * lateral)
        publish("motion", t, state=MachineState(t, pose, speed, 0.0, 0.0, 0.0, s))
        knife = pose.apply([[end[0], y, 0.0] for y in (-3.5, 3.5)])[:, :2]
        cut = None
        if before is not None:
            cut = ground.cut(np.array([before[0], knife[0], knife[1], before[1]]))
        before = knife
        grain, straw, area = (cut.grain, cut.straw, cut.area) if cut else (0.0, 0.0, 0.0)
        fill = area / (7.0 * speed / hz)
        publish("header", t, flow=CropFlow(t, grain, straw, area, int(500 * area), fill, 1.0 / hz))
        tank, dropped = tank + grain, dropped + straw
        publish("process", t, load=MachineLoad(t, tank, 0.0, dropped, 0.0, 0.0, grain * hz, straw * hz))
        if step % scan_every == 0:
            _sense(publish, t, pose, ground, sign, edge_error, rng)
            publish("steer", t, command=SteerCommand(t, 0.001, True))
        publish("odometry", t, odometry=Odometry(t, speed, 0.0, 0.01))
        publish("speed", t, command=SpeedCommand(t, speed))
        publish("steering", t, steering=SteerState(t, 0.01, 0.0))


def _placed(edge, s, end, left_of_edge):
    """Pose that puts the header end `left_of_edge` of the edge, the machine heading along the edge there."""
    at = edge.pose(s + end[0], left_of_edge)
    return at @ Pose(-end, np.eye(3))


def _sense(publish, t, pose, ground, sign, edge_error, rng):
    azimuth = np.radians(np.linspace(-50.0, 50.0, 201))
    sensor = pose @ MOUNTING
    directions = sensor.turn(np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1))
    reach = np.full(len(azimuth), np.nan)
    for height in (0.8, 0.0):  # the crop's top, then the ground
        along = (height - sensor.position[2]) / np.minimum(directions[:, 2], -1e-6)
        x, y = (sensor.position[:2] + along[:, None] * directions[:, :2]).T
        crop = ground.standing(x, y)
        ok = (along < 60.0) & np.isnan(reach) & (crop if height > 0 else True)
        reach[ok] = along[ok] + (rng.normal(0, 0.05, ok.sum()) if height > 0 else 0.0)
    ranges = reach[:, None].astype(np.float32)
    beam_t = np.linspace(-0.01, 0.0, len(azimuth))
    scan = Scan(t, beam_t, azimuth, 0 * azimuth, ranges, np.where(np.isnan(ranges), ranges, np.float32(0.3)))
    hits = sensor.position + reach[:, None] * directions
    truth = ScanTruth(t, hits[:, None, :], np.repeat(sensor.position[None], len(azimuth), axis=0))
    publish("lidar", t, scan=scan, truth=truth)
    reference = 10.0
    y = np.linspace(-12, 12, 4801)
    line = pose.apply(np.stack([np.full_like(y, reference), y, 0 * y], axis=1))
    depth = ground.nominal_edge.signed_distance(line[:, 0], line[:, 1])
    offset = float(y[np.argmin(np.abs(depth))]) - sign * edge_error
    beside = ground.standing(*pose.apply([reference, offset - sign * 0.5, 0.0])[:2])
    if beside:
        publish("edge", t, edge=CropEdge(t, offset, 0.0, 0.0, reference, 0.9, 0.8, 0.1))
    else:
        publish("edge", t, edge=CropEdge(t, np.nan, np.nan, 0.0, reference, 0.0, np.nan, np.nan))
