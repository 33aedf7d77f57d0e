"""Yield logs drawn at random whose flow is late by a known time: machines, turns, gaps, units as in use."""

import csv
from dataclasses import dataclass

import numpy as np

from swath.field.maps.projection import Origin, transform, utm_epsg

LB, FT, ACRE = 0.45359237, 0.3048, 4046.8564224
FLOWS = {"flow_kg_s": 1.0, "flow_t_h": 3.6, "flow_lb_s": 1 / LB}
YIELDS = {"yield_t_ha": 10.0, "yield_kg_ha": 1e4, "yield_bu_ac": ACRE / LB / 60}


@dataclass
class DrawnLog:
    """columns: of the file; delays [s]: machine -> what is left in its flow; passes: of the field; turns: of
    each machine, that the log shows or ends at; has_turns: the log goes on in the turns
    """

    columns: dict
    delays: dict[str, float]
    passes: int
    turns: dict[str, int]
    has_turns: bool

    def write(self, path):
        with path.open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow(self.columns)
            writer.writerows(zip(*self.columns.values(), strict=True))
        return path


def yields(rng, spread, shortest):
    """A yield [kg/m2] of random waves of `shortest` to 300 m; spread: standard deviation over mean."""
    count = 30
    size = 2 * np.pi / np.exp(rng.uniform(np.log(shortest), np.log(300.0), count))
    way, phase, height = (
        rng.uniform(0, 2 * np.pi, count),
        rng.uniform(0, 2 * np.pi, count),
        rng.uniform(0.3, 1, count),
    )
    scale = spread / np.sqrt((height**2).sum() / 2)

    def at(x, y):
        turned = size * (np.multiply.outer(x, np.cos(way)) + np.multiply.outer(y, np.sin(way))) + phase
        return 0.6 * np.clip(1 + scale * (height * np.sin(turned)).sum(axis=-1), 0.2, 2.5)

    return at


def drive(rng, lanes, first_up, length, slant, width, speed, turn_s, lead, stops):
    """Place [m] and whether the header cuts, ten times a second: passes there and back on `lanes`."""
    dt, x, y, cuts, ends = 0.1, [], [], [], []
    for k, lane in enumerate(lanes):
        up = (k % 2 == 0) == first_up
        bottom, top = slant * lane * width, length + slant * lane * width
        steps = np.clip(
            speed * dt * (1 + 0.05 * np.sin(np.arange(0, length / speed * 1.3, dt) / 9 + rng.uniform(0, 6))),
            0.05,
            None,
        )
        along = np.cumsum(steps)
        along = along[along < length + 2 * lead] - lead
        if stops and rng.uniform() < 0.2:
            at = int(rng.uniform(0.2, 0.8) * len(along))
            along = np.r_[along[:at], np.full(int(rng.uniform(20, 60) / dt), along[at]), along[at:]]
        standing = np.r_[False, np.diff(along) == 0.0]
        x.append(np.full(len(along), lane * width))
        y.append(bottom + along if up else top - along)
        cuts.append((along >= 0) & (along <= length) & ~standing)
        ends.append(np.full(len(along), 2 * k))
        if k + 1 < len(lanes):
            a = np.pi * np.arange(1, int(turn_s / dt)) / int(turn_s / dt)
            across = (lanes[k + 1] - lane) * width
            end = y[-1][-1]
            other = (length + lead if up else -lead) + slant * lanes[k + 1] * width
            x.append(lane * width + across / 2 * (1 - np.cos(a)))
            y.append(end + (other - end) * a / np.pi + (1 if up else -1) * 7.0 * np.sin(a))
            cuts.append(np.zeros(len(a), bool))
            ends.append(np.full(len(a), 2 * k + 1))
    return tuple(map(np.concatenate, (x, y, cuts, ends)))


def late(rng, inflow, delay, lag):
    """What the sensor shows of an inflow ten times a second: late by delay in the mean, smeared by lag."""
    kernel = np.exp(-np.arange(0, 6 * lag, 0.1) / lag)
    kernel /= kernel.sum()
    whole = np.convolve(inflow, kernel)[: len(inflow)]
    shift = delay - float((np.arange(len(kernel)) * 0.1 * kernel).sum())
    t = 0.1 * np.arange(len(inflow))
    return np.interp(t - shift, t, whole, left=0.0, right=0.0)


def _dying(flow, cuts, delay, tail_s):
    """The same, where the machine empties slowly once no crop comes: exponentially, by tail_s."""
    late = np.roll(cuts, round(10 * delay))
    begun = np.maximum.accumulate(np.where(late, np.arange(len(flow)), 0))
    return np.where(
        late, flow, np.maximum(flow, flow[begun] * np.exp(0.1 * (begun - np.arange(len(flow))) / tail_s))
    )


def draw(seed, *, has_work_state=False, tail_s=0.0):
    """One log. has_work_state: a column says whether the header cuts; tail_s: of a flow that dies away."""
    rng = np.random.default_rng(seed)
    width, speed, interval = (
        rng.uniform(3, 13),
        rng.uniform(1.2, 2.4),
        float(rng.choice([1.0, 1.0, 1.0, 2.0])),
    )
    passes, length = int(rng.integers(6, 31)), rng.uniform(120, 400)
    machines = int(rng.choice([1, 1, 2, 3]))
    has_turns, is_beside = bool(rng.integers(2)), bool(rng.integers(2))
    grown = yields(rng, rng.uniform(0.03, 0.25), rng.uniform(20, 100))
    is_taken_off = bool(rng.integers(2))
    noise, slant, lead = rng.uniform(0.02, 0.08), rng.uniform(-0.4, 0.4), rng.uniform(0.0, 2.0)
    wander, has_stops = rng.uniform(0.01, 0.15), bool(rng.integers(2))
    form = str(rng.choice([*FLOWS, *YIELDS]))
    columns, delays, turns = [], {}, {}
    begun = rng.integers(1, 400000)
    for index in range(machines):
        lanes = (
            np.arange(index, passes, machines)
            if is_beside
            else np.array_split(np.arange(passes), machines)[index]
        )
        x, y, cuts, ends = drive(
            rng,
            lanes,
            bool(rng.integers(2)),
            length,
            slant,
            width,
            speed * rng.uniform(0.9, 1.1),
            rng.uniform(12, 25),
            lead if has_turns else min(lead, 1.0),
            has_stops,
        )
        delay = rng.uniform(-5, 20) if not is_taken_off else float(rng.choice([0.0, rng.uniform(-5, 5)]))
        v = np.hypot(np.gradient(x), np.gradient(y)) / 0.1
        inflow = np.where(cuts, grown(x, y) * v * width, 0.0)
        flow = late(rng, inflow, delay, rng.uniform(0.5, 2.5))
        flow = _dying(flow, cuts, delay, tail_s) if tail_s else flow
        rows = np.arange(0, len(x), int(interval * 10))
        kept = np.full(len(rows), True) if has_turns else ends[rows] % 2 == 0
        for _ in range(int(rng.integers(0, 4))):  # a gap of the receiver or the terminal
            at = int(rng.uniform(0, len(rows)))
            kept[at : at + int(rng.uniform(5, 60) / interval)] = False
        rows = rows[kept]
        shown = np.maximum(flow[rows] * (1 + noise * rng.standard_normal(len(rows))), 0.0)
        shown[shown < 0.05 * np.median(shown[shown > 0])] = 0.0
        if form in YIELDS:
            shown = np.where(v[rows] > 0.3, shown / np.maximum(v[rows] * width, 0.3), 0.0)
        name = f"M{index + 1}"
        delays[name], turns[name] = float(delay), len(lanes) - 1
        columns.append({
            "machine": np.full(len(rows), name), "time_s": begun + rows * 0.1,
            "x": x[rows] + rng.normal(0, wander, len(rows)), "y": y[rows] + rng.normal(0, wander, len(rows)),
            "speed_m_s": np.round(v[rows], 2), "moisture_pct": 14.0 + 0.002 * y[rows],
            form: shown * {**FLOWS, **YIELDS}[form], "width_m": np.full(len(rows), round(width, 3)),
            **({"work_state": np.where(cuts[rows], "in", "out")} if has_work_state else {}),
        })  # fmt: skip
    held = {key: np.concatenate([c[key] for c in columns]) for key in columns[0]}
    lon, lat = rng.uniform(-3, 20), rng.uniform(44, 56)
    epsg, turn = utm_epsg(lon, lat), rng.uniform(0, np.pi)
    east, north = transform([[lon, lat]], "EPSG:4326", f"EPSG:{epsg}")[0]
    x, y = held.pop("x"), held.pop("y")
    local = np.stack([np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y], axis=1)
    held["lon"], held["lat"] = np.round(Origin(epsg, east, north).to_lon_lat(local).T, 8)
    if rng.integers(2):
        held.pop("speed_m_s")
    order = np.argsort(held["time_s"], kind="stable")
    return DrawnLog({k: v[order].tolist() for k, v in held.items()}, delays, passes, turns, has_turns)
