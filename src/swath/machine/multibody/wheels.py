"""Wheels as force elements: an enveloping contact with the ground and the brush tyre along and across.

Contact: a bed of vertical springs under the round tread (Winkler), as long as the tyre can reach and as wide
as its patch, on the ground's heights. Its force is the gradient of the energy in the springs, so rough ground
takes no energy out and puts none in; a gap shorter than the tyre is bridged. A damper acts along the normal
and grows with the length of the patch, the cube root of the load.

Along and across the contact plane: the slips that the tread feels lag over the relaxation length (tyre.py);
the brush acts against both together. With n stiffness and mu friction over load, for each direction:

    q = n s / mu,  Q = |q|,  F / Fz = -n s G(Q) / Q,  G = Q - Q^2/3 + Q^3/27 up to full sliding at Q = 3

on soil after Brixius G = 1 - exp(-Q), the resistance a force along the ground. The relaxation length along is
sigma (n_x / n_y) (mu_y / mu_x)^2: then the force of the resting tyre has a potential, a machine that rocks on
its tyres gains no energy.

Rolling resistance is a torque on the wheel, drag * load * rolling radius: the load acts ahead of the wheel's
middle. The rolling radius is the free one less a third of the deflection (uncited).
"""

from dataclasses import dataclass, replace
from math import cbrt, expm1, hypot, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.component import KeepsState
from swath.core.portable import product
from swath.field.field import Field
from swath.field.ground.soil import Soil
from swath.machine.soil import Brixius, Firm
from swath.machine.tyre import creep_damping

REACH = 0.65  # the bed reaches this far ahead and behind, over the free radius
POINTS = 11  # springs along; two across
FADE_SPEED = 0.1  # rolling resistance grows to its full value up to this rim speed [m/s]
SINK = 1.0 / 3.0  # rolling radius: free radius less this share of the deflection
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Wheel:
    """One wheel. radius: free [m]; width, relaxation [m]; load [N] under which it sinks by `deflection` [m].

    damping: ratio of the vertical spring
    """

    radius: float
    width: float
    relaxation: float
    load: float
    deflection: float
    damping: float
    soil: Firm | Brixius

    def bed(self) -> tuple[Array, Array, Array]:
        """Springs: along s, down q, left j of the wheel's middle [m], shapes (2 * POINTS,)."""
        along = REACH * self.radius * np.linspace(-1.0, 1.0, POINTS)
        down = np.sqrt(self.radius**2 - along**2)
        left = np.array([-0.25, 0.25]) * self.width
        return np.tile(along, 2), np.tile(down, 2), np.repeat(left, POINTS)

    def rate(self) -> float:
        """Stiffness of one spring [N/m]: the load is carried at the deflection, on flat ground."""
        _, down, _ = self.bed()
        return self.load / float(np.maximum(down - self.radius + self.deflection, 0.0).sum())

    @property
    def rolling_radius(self) -> float:
        """Way per angle of the free wheel under its load [m]."""
        return self.radius - SINK * self.deflection

    def damper(self) -> float:
        """Along the normal, under `load` [N s/m]; the bed's rate at that load is 1.5 load / deflection."""
        return 2.0 * self.damping * self.load * sqrt(1.5 / (9.81 * self.deflection))


class Wheels(KeepsState):
    """Forces on all wheels of a machine. Order of the rows: as the wheels were given."""

    kept = (
        "_along",
        "_side",
        "loads",
        "_indices",
        "air_times",
        "_height",
        "_seen",
        "_rise_x",
        "_rise_y",
        "_basis",
    )

    def __init__(self, ground: Field, wheels: list[Wheel], soil: Soil | None = None) -> None:
        self._ground, self.wheels, self._soil = ground, wheels, soil
        beds = [w.bed() for w in wheels]
        self._s, self._q, self._j = (np.stack([b[i] for b in beds]) for i in range(3))
        self._rates = np.array([w.rate() for w in wheels])
        self._step = np.array([2.0 * REACH * w.radius / (POINTS - 1) for w in wheels])[:, None, None]
        self._gap = np.array([0.5 * w.width for w in wheels])[:, None]
        self._dampers = [w.damper() for w in wheels]
        self.reset()

    def reset(self) -> None:
        """No slip."""
        n = len(self.wheels)
        self._along, self._side = [0.0] * n, [0.0] * n
        self.loads = [0.0] * n  # forces normal to the ground [N]
        self._indices = [0.0] * n  # cone index of the soil under each [Pa]
        self.air_times = [0.0] * n  # since each wheel left the ground [s]

    def look(self, middles: Array, axes: Array) -> None:
        """Read the ground around the wheels. middles, axes: world places [m] and leftward axes, (n, 3)."""
        ax, ay = axes[:, 0:1], axes[:, 1:2]
        flat = np.sqrt(ax * ax + ay * ay)
        cx, cy = ax / flat, ay / flat  # leftward, level
        across = self._j * flat - self._q * (-axes[:, 2:3])
        x = middles[:, 0:1] + self._s * cy + across * cx
        y = middles[:, 1:2] - self._s * cx + across * cy
        height = np.asarray(self._ground.ground_height(x, y), dtype=float)
        if self._soil is not None:
            self._indices = self._soil.at(middles[:, 0], middles[:, 1]).tolist()
        lanes = height.reshape(len(height), 2, POINTS)
        rise = np.empty_like(lanes)
        rise[:, :, 1:-1] = (lanes[:, :, 2:] - lanes[:, :, :-2]) / (2.0 * self._step)
        rise[:, :, :1] = (lanes[:, :, 1:2] - lanes[:, :, :1]) / self._step
        rise[:, :, -1:] = (lanes[:, :, -1:] - lanes[:, :, -2:-1]) / self._step
        along = rise.reshape(height.shape)
        left = np.tile((lanes[:, 1] - lanes[:, 0]) / self._gap, 2)
        self._height: Array = height
        self._seen: Array = middles[:, :2].copy()
        self._rise_x, self._rise_y = along * cy + left * cx, left * cy - along * cx
        self._basis = np.stack([np.ones_like(height), self._s, self._q, self._j, along, left], axis=-1)

    def _sunk(self, middles: Array, axes: Array) -> Array:
        """Compression of every spring [m], (n, 2 * POINTS)."""
        moved = middles[:, :2] - self._seen
        ground = self._height + self._rise_x * moved[:, 0:1] + self._rise_y * moved[:, 1:2]
        tilt = axes[:, 2:3]
        level = np.sqrt(1.0 - tilt * tilt)
        return np.maximum(ground - middles[:, 2:3] + self._q * level - self._j * tilt, 0.0)

    def push(self, h: float, middles: Array, axes: Array, speeds: Array, turns: Array, spins: Any) -> Array:
        """Force [N] and torque [N m] on each wheel at its middle, world frame, shape (n, 6).

        h: time step [s] over which the slips go on; speeds, turns: velocity [m/s] and turn rate [rad/s] of
        what carries the wheel, at the wheel's middle; spins: wheel about its axis against it [rad/s]
        """
        sunk = self._sunk(middles, axes)
        sums = product(sunk[:, None, :], self._basis)[:, 0, :] * self._rates[:, None]
        rows = zip(
            sums.tolist(),
            sunk.max(axis=1).tolist(),
            axes.tolist(),
            speeds.tolist(),
            turns.tolist(),
            spins,
            strict=True,
        )
        return np.array([self._one(i, h, *row) for i, row in enumerate(rows)])

    def _one(
        self, i: int, h: float, sums: Any, depth: float, axis: Any, speed: Any, turn: Any, spin: float
    ) -> tuple[float, ...]:
        """One wheel. Inside: x level along the heading, y level to the left, z up."""
        total = sums[0]
        if total <= 0.0:
            self._along[i] = self._side[i] = self.loads[i] = 0.0
            self.air_times[i] += h
            return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self.air_times[i] = 0.0
        w = self.wheels[i]
        level, tilt = hypot(axis[0], axis[1]), axis[2]
        lx, ly = axis[0] / level, axis[1] / level
        s, q, j, gx, gy = (v / total for v in sums[1:])
        rx, ry, rz = s, j * level + q * tilt, j * tilt - q * level  # middle to contact
        vx, vy, vz = speed[0] * ly - speed[1] * lx, speed[0] * lx + speed[1] * ly, speed[2]
        ox, oy, oz = turn[0] * ly - turn[1] * lx, turn[0] * lx + turn[1] * ly, turn[2]
        vx, vy, vz = vx + oy * rz - oz * ry, vy + oz * rx - ox * rz, vz + ox * ry - oy * rx
        norm, run = sqrt(1.0 + gx * gx + gy * gy), sqrt(1.0 + gx * gx)
        spring = total * norm
        damper = self._dampers[i] * cbrt(spring / w.load) * (gx * vx + gy * vy - vz) / norm
        load = max(spring + damper, 0.0)
        self.loads[i] = load
        ex, ez = 1.0 / run, gx / run
        side = 1.0 / (norm * run)
        fx, fy, fz = -gx * gy * side, run * run * side, gy * side
        radius = w.radius - SINK * depth
        drive, drift, drag = self._tread(
            i, h, load, vx * ex + vz * ez, vx * fx + vy * fy + vz * fz, spin * radius
        )
        up = load / norm
        soft = 0.0
        if w.soil.exponential:
            soft, drag = drag * min(max(vx / FADE_SPEED, -1.0), 1.0), 0.0
        px = (drive - soft) * ex + drift * fx - up * gx
        py = drift * fy - up * gy
        pz = (drive - soft) * ez + drift * fz + up
        mx, my, mz = ry * pz - rz * py, rz * px - rx * pz, rx * py - ry * px
        rest = -drive * radius - drag * radius - (my * level + mz * tilt)
        my, mz = my + rest * level, mz + rest * tilt
        return (
            px * ly + py * lx,
            py * ly - px * lx,
            pz,
            mx * ly + my * lx,
            my * ly - mx * lx,
            mz,
        )

    def _tread(
        self, i: int, h: float, load: float, forward: float, left: float, rim: float
    ) -> tuple[float, float, float]:
        """Forces along and to the left, resistance [N]; the slips go on by h [s]."""
        w = self.wheels[i]
        soil = w.soil
        if isinstance(soil, Brixius):
            soil = replace(soil, cone_index=self._indices[i])
        grip = soil.at(load, self._along[i])
        lag = w.relaxation * (grip.along / grip.side) * (grip.side_top / grip.along_top) ** 2
        pace = abs(forward)
        sx = _lagged(self._along[i], forward - rim, pace, h, lag)
        sy = _lagged(self._side[i], left, pace, h, w.relaxation)
        q = hypot(grip.along * sx / grip.along_top, grip.side * sy / grip.side_top)
        full = 6.0 if w.soil.exponential else 3.0
        if q > full:
            sx, sy, q = sx * full / q, sy * full / q, full
        self._along[i], self._side[i] = sx, sy
        if w.soil.exponential:
            share = -expm1(-q) / q if q > 1e-9 else 1.0
        else:
            share = 1.0 - q / 3.0 + q * q / 27.0
        drive = grip.along * sx * share + creep_damping(pace, grip.along, lag) * (forward - rim)
        drift = grip.side * sy * share + creep_damping(pace, grip.side, w.relaxation) * left
        fade = 1.0 if w.soil.exponential else min(max(rim / FADE_SPEED, -1.0), 1.0)
        return -load * drive, -load * drift, load * grip.drag * fade

    def energy(self, middles: Array, axes: Array) -> float:
        """Energy in the vertical springs [J]."""
        sunk = self._sunk(middles, axes)
        return float(0.5 * (self._rates * (sunk * sunk).sum(axis=1)).sum())


def _lagged(slip: float, slide: float, pace: float, h: float, lag: float) -> float:
    """Solve lag ds/dt + pace s = slide over h."""
    z = pace * h / lag
    gone = -expm1(-z)
    return slip * (1.0 - gone) + slide * h / lag * (gone / z if z > 1e-9 else 1.0)
