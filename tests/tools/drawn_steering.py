"""Steering logs drawn at random: a machine in continuous time (steps of 1 ms), its logger and its sensors.

The axes: dead time, lag, rate limit or none, dead band or none, understeer, tyre lag, shape of the command,
log rate, noise, quantisation, offset of the angle, unit of the command, speed, duration.
"""

from dataclasses import dataclass

import numpy as np

MS = 0.001  # s
WHEELBASE = 3.9  # m
SHAPES, RATES = ("steps", "ramps"), (10, 20)
OTHER_SHAPES, OTHER_RATES = ("waves",), (5, 50)  # not looked at while the fit was made


@dataclass
class DrawnSteering:
    """truth: of the sheet's keys, an infinite rate is none; columns: of the log, values of each record."""

    truth: dict[str, float]
    axes: dict[str, object]
    columns: dict[str, np.ndarray]

    def write(self, path):
        rows = np.stack(list(self.columns.values()), axis=1)
        np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=",".join(self.columns), comments="")
        return path


def drawn(seed, *, others=False, motion=True, longest=260.0):
    """A log; others: command shapes and log rates that were left out; motion: with a yaw rate."""
    rng = np.random.default_rng((71, seed))
    rate = float(rng.uniform(8.0, 40.0)) if rng.uniform() < 0.6 else np.inf
    truth = {
        "steering.dead_time_s": float(rng.uniform(0.05, 0.5)), "steering.lag_s": float(rng.uniform(0.1, 0.5)),
        "steering.rate_deg_s": rate,
        "steering.dead_band_percent": float(rng.uniform(1.0, 8.0))
        if np.isfinite(rate) and rng.uniform() < 0.6 else 0.0,
        "tyres.understeer_deg_per_g": float(rng.uniform(-2.0, 4.0)),
    }  # fmt: skip
    axes = {
        "shape": str(rng.choice(OTHER_SHAPES if others else SHAPES)),
        "hz": int(rng.choice(OTHER_RATES if others else RATES)), "noise": float(rng.uniform(0.02, 0.3)),
        "quantum": float(rng.choice([0.0, 0.05, 0.2])), "offset": float(rng.uniform(-1.0, 1.0)),
        "unit": str(rng.choice(["deg", "rad", "curvature"])), "tyre_lag_m": float(rng.uniform(0.0, 1.2)),
        "duration": float(rng.uniform(140.0, longest)), "swing": float(rng.uniform(4.0, 14.0)),
    }  # fmt: skip
    time = np.arange(round(axes["duration"] / MS)) * MS
    wanted = _command(rng, axes["shape"], time, axes["swing"])
    angle = _servo(wanted, truth)
    speed = rng.uniform(1.5, 5.0) + rng.uniform(0.0, 1.0) * np.sin(0.1 * time)
    every = slice(None, None, 1000 // axes["hz"])
    t, command, v = time[every], wanted[every], speed[every]
    shown = angle[every] + axes["offset"] + axes["noise"] * rng.standard_normal(len(t))
    if axes["quantum"]:
        shown = axes["quantum"] * np.round(shown / axes["quantum"])
    turned = np.tan(np.deg2rad(command)) / WHEELBASE
    columns = {"time_s": t, "speed_m_s": v, **{
        "deg": {"steer_command_deg": command}, "rad": {"steer_command_rad": np.deg2rad(command)},
        "curvature": {"command_curvature_1_m": turned},
    }[axes["unit"]], "steer_angle_deg": shown}  # fmt: skip
    if motion:
        rows = _yaw_rate(angle, speed, truth["tyres.understeer_deg_per_g"], axes["tyre_lag_m"])[every]
        columns["yaw_rate_deg_s"] = rows + 0.1 * rng.standard_normal(len(t))
    return DrawnSteering(truth, axes, columns)


def _command(rng, shape, time, swing):
    if shape == "waves":
        phase, pace = rng.uniform(0.0, 6.0, 4), rng.uniform(0.3, 4.0, 4)
        return 0.5 * swing * np.sin(np.outer(time, pace) + phase).sum(axis=1) * 0.7
    at = np.cumsum(np.round(rng.uniform(1.5, 4.5, len(time) // 1500), 1))
    height = rng.uniform(-swing, swing, len(at))
    if shape == "ramps":
        return np.interp(
            time, np.stack([at, at + 1.0], axis=1).ravel()[: 2 * len(at)].clip(0.0), np.repeat(height, 2)
        )
    return np.r_[0.0, height][np.searchsorted(at, time + 0.5 * MS)]


def _servo(wanted, truth):
    """As the equations of the level `actuator` say, by steps of 1 ms; without a rate limit its limit."""
    late, lag, rate, band = (truth[k] for k in list(truth)[:4])
    reach = lag * (20.0 if np.isinf(rate) else rate)  # deg of error that open the valve fully
    band *= 0.01
    most = 1.0 if np.isfinite(rate) else np.inf
    begin = round(late / MS)
    angle, made = 0.0, []
    for value in np.r_[np.zeros(begin), wanted][: len(wanted)].tolist():
        made.append(angle)
        opening = (value - angle) / reach
        flow = min(max(abs(opening) - band, 0.0) / (1.0 - band), most)
        angle += MS * reach / lag * (flow if opening > 0.0 else -flow)
    return np.array(made)


def _yaw_rate(angle, speed, understeer, lag):
    """deg/s: the steady turn of a bicycle, reached over a length of travel [m]."""
    gradient = np.deg2rad(understeer) / 9.80665
    steady = np.rad2deg(speed * np.tan(np.deg2rad(angle)) / (WHEELBASE + gradient * speed**2))
    if lag == 0.0:
        return steady
    made, turn = [], 0.0
    for value, share in zip(steady.tolist(), (1.0 - np.exp(-speed * MS / lag)).tolist(), strict=True):
        made.append(turn)
        turn += (value - turn) * share
    return np.array(made)
