"""Grids of heights by hand, a small real field, and machines driven along straight lines in it."""

import numpy as np

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.rays.height_grid import DEEP, LEVELS, NODES, NONE, PER_THICKNESS, SHARES, THICK, TILE, HeightGrid
from swath.runtime.assembly import assemble
from swath.scenario.scenario import parse_scenario
from swath.signals import MachineState
from swath.tools.height_map.poses import make_track
from swath.tools.height_map.source import Echoes, Source

TEXT = """
format: swath scenario 2
name: replay-rig
seed: 3
run: {distance_m: 12, max_duration_s: 20}
field:
  terrain: {level: formula, slope_percent: 1.0}
  stand: {level: uniform, stems_per_m2: 400}
  edge: {shape: straight}
machines:
  combine:
    lidar: {sub_rays: 7, sector_deg: [-25, 25], noise: none}
"""


def levels(heights):
    """Quantiles at SHARES, or one height, as all levels of a cell that nobody looked through."""
    even = np.round(np.broadcast_to(heights, len(SHARES)) * 1e3)
    return np.concatenate([even[:1], np.full(DEEP - 1, THICK * PER_THICKNESS), even]).astype(np.int16)


def small_world():
    return assemble(parse_scenario(TEXT))


def hand_grid(tiles=(4, 6), cell=0.1, heights=0.8, origin=(0.0, 0.0, 0.0), yaw=0.0, slope=0.0):
    """All cells measured, with one distribution; slope: of the ground along local x."""
    ty, tx = tiles
    m = ty * tx
    quantiles = np.full((m, TILE, TILE, LEVELS), 0, np.int16)
    quantiles[:] = levels(heights)
    node = cell * TILE / NODES
    ground = np.broadcast_to(slope * node * np.arange(tx * NODES + 1), (ty * NODES + 1, tx * NODES + 1))
    return HeightGrid(
        origin=np.array(origin, float),
        yaw=yaw,
        cell=cell,
        table=np.arange(m, dtype=np.int32).reshape(ty, tx),
        quantiles=quantiles,
        thickness=np.full((m, TILE, TILE), -THICK, np.float32),
        count=np.ones((m, TILE, TILE), np.uint16),
        intensity=np.full((m, TILE, TILE), 0.4, np.float32),
        ground=np.ascontiguousarray(ground, np.float32),
        about={},
    )


def set_where(grid, where, heights):
    """Give cells whose local centre (u, v) satisfies `where` other heights; None = never measured."""
    tile = np.zeros((len(grid.quantiles), 2))
    ty, tx = np.nonzero(grid.table >= 0)
    tile[grid.table[ty, tx]] = np.stack([tx, ty], axis=1)
    step = np.arange(TILE) + 0.5
    u = (tile[:, None, None, 0] * TILE + step[None, None, :]) * grid.cell
    v = (tile[:, None, None, 1] * TILE + step[None, :, None]) * grid.cell
    chosen = where(*np.broadcast_arrays(u, v))
    grid.quantiles[chosen] = NONE if heights is None else levels(heights)


def drive(lidar, world, offset=0.0, speed=2.0, length=8.0, rate=25.0):
    """Scans along a straight line parallel to the edge; offset to its left [m]. Returns outputs, states."""
    edge, setup = world.field.first_edge, lidar.setup
    h = float(edge.heading_at(0.0))
    ahead, left = np.array([np.cos(h), np.sin(h)]), np.array([-np.sin(h), np.cos(h)])
    end = np.array(setup.machine.header_end(setup.edge_side))
    start = np.asarray(edge.point_at(0.0)) - end[0] * ahead - end[1] * left + offset * left
    period = round(1e9 / rate)

    def state(t):
        at = start + ahead * speed * t * 1e-9
        ground, step = world.field.ground_height, 1e-4
        x, y = at
        n = np.array(
            [ground(x - step, y) - ground(x + step, y), ground(x, y - step) - ground(x, y + step), 0.0]
        )
        n[2] = 2 * step
        n /= np.linalg.norm(n)
        pitch, roll = np.arctan2(n[:2] @ ahead, n[2]), -np.arctan2(n[:2] @ left, n[2])
        pose = Pose.from_euler((*at, float(world.field.ground_height(*at))), roll, pitch, h)
        return MachineState(t, pose, speed, 0.0, 0.0, 0.0, speed * t * 1e-9)

    lidar.reset(Stream(5, "combine.lidar"))
    outs, states = [], []
    for k in range(int(length / speed * rate)):
        some = tuple(state(k * period + j * period // 4) for j in range(5))
        outs.append(lidar.step(k * period, period, {"state": some}))
        states += some
    return outs, states


def source_of(lidar, outs, states):
    """What a recording of such a drive is to the builder."""
    track = make_track(
        [s.t * 1e-9 for s in states],
        [s.pose.position for s in states],
        [s.pose.euler() for s in states],
    )

    def sweeps():
        for out in outs:
            scan = out["scan"]
            points = scan.points()[:, 0]
            seen = np.isfinite(points[:, 0])
            time = scan.t * 1e-9 + scan.beam_t[seen]
            yield Echoes(time, points[seen], scan.intensity[seen, 0].astype(float), int((~seen).sum()))

    return Source("drive", track, lidar.mounting, sweeps)


def heights_of(world, outs):
    """World points (n, 3) of all echoes and their heights above the true ground."""
    points = np.concatenate([out["truth"].points[:, 0] for out in outs])
    points = points[np.isfinite(points[:, 0])]
    return points, points[:, 2] - world.field.ground_height(points[:, 0], points[:, 1])


def wasserstein(a, b):
    share = (np.arange(2000) + 0.5) / 2000
    return float(np.abs(np.quantile(a, share) - np.quantile(b, share)).mean())
