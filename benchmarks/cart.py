"""A cart beside a combine: what comes out, beside what it is held against.

python benchmarks/cart.py [PART ...]    all of them, or heap, trailer, unloading, station, ...
"""

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from tests.control.box_rig import DUST, EYE, MOUNT, THICK, errors, look
from tests.levels.test_cooperation import stream_of
from tests.machine.test_heap import BOXES, SLOPE, until_it_runs_over
from tests.machine.test_trailer import make, run
from tests.machine.test_unload import pour, setup_with_box
from tests.whole.cart_rig import Run
from tests.whole.test_unload_on_the_go import ALTERNATING, LINKS, QUICK, RADIO

from swath.core.foreign_code import allow_code
from swath.machine.heap.open_box import Surface, largest_heap
from swath.machine.machine_sheet import load_machine
from swath.machine.motion import articulated, kinematic
from swath.machine.unload import auger
from swath.signals import HeapState, UnloadState

CART = load_machine("tractor-grain-cart")


def say(case: str, found: str, expected: str) -> None:
    """One row."""
    print(f"{case:52s} {found:34s} {expected}", flush=True)


def heap() -> None:
    """First grain over the rim, volume, slope."""
    box, _, *expected = BOXES[0]
    cases = ([0.0], [-1.5, 1.5], np.linspace(-1.5, 1.5, 31))
    for name, spots, wanted in zip(("one spot", "two spots", "middle line"), cases, expected, strict=True):
        surface, poured = until_it_runs_over(box, spots)
        off = abs(surface.volume - poured) / poured
        say(f"first grain over the rim, {name}", f"{surface.volume:.2f} m3, volume {off:.0e}", f"{wanted} m3")
    cone = Surface(box, SLOPE, 0.1)
    cone.pour(2.0, 0.05, 0.05)
    row = cone.heights[:, 15]
    steep = math.degrees(math.atan(float(np.abs(np.diff(row[row > 0.0])).max()) / 0.1))
    say("slope of a cone", f"{steep:.2f} deg", "25 deg")
    say("largest heap", f"{largest_heap(box, SLOPE):.2f} m3", "33.1 m3")


def trailer() -> None:
    """Off-tracking on 15 m, both levels on the same circle."""
    for level in (kinematic, articulated):
        low, high = 0.1, 0.35
        for _ in range(25):  # steering angle at which the tractor's circle has 15 m
            steer = 0.5 * (low + high)
            state, towed = run(make(level), 40.0, steer=steer)[-1]
            radius = math.hypot(state.speed, state.lateral_speed) / state.yaw_rate
            low, high = (steer, high) if radius > 15.0 else (low, steer)
        across = state.pose.euler()[2] + math.atan2(state.lateral_speed, state.speed)
        x, y, _ = state.pose.position
        inner = math.hypot(towed.x - x + radius * math.sin(across), towed.y - y - radius * math.cos(across))
        name = level.__name__.rpartition(".")[2]
        say(f"trailer at R = {radius:.2f} m, {name}", f"{radius - inner:.3f} m inside", "0.672 m")


def unloading() -> None:
    """12 m3 at 120 l/s."""
    for name, inflow, wanted in (("standing", 0.0, 100), ("while cutting 23.8 kg/s", 23.8, 135)):
        _, lasted = pour(auger.PRESETS["ideal"], setup_with_box()[0], 150.0, inflow=inflow)
        say(f"12 m3 at 120 l/s {name}", f"{lasted:.1f} s", f"{wanted} s")


def station() -> None:
    """How far from the wanted point grain comes down."""
    cases = (
        ("1.2 m/s", (), 60, "0.048 / 0.26 m measured"),
        ("0.4 <-> 1.2 m/s", (ALTERNATING,), 90, "0.09 / 0.21 m measured"),
    )
    for name, sets, seconds, expected in cases:
        rows = np.abs(Run(*sets, seconds=seconds).while_pouring(2.0)[:, 1:3])
        along, across = (f"{v.mean():.3f} / {v.max():.3f}" for v in rows.T)
        say(f"station at {name}, mean / largest", f"along {along}, across {across}", expected)
    for angle in (60, -60):
        edge = f"field.edge={{shape: curve, run_in_m: 25, radius_m: 40, angle_deg: {angle}}}"
        rows = np.abs(Run(edge, "run.distance_m=200", seconds=50).while_pouring(5.0)[:, 1:3])
        found = f"along {rows[:, 0].max():.3f}, across {rows[:, 1].max():.3f} m"
        say(f"largest in a bend of 40 m, {'left' if angle > 0 else 'right'}", found, "-")


def link() -> None:
    """Age of messages, and silence."""
    for flag in ("true", "false"):
        sets = (LINKS[1] + RADIO % "", QUICK, f"cart.cooperate.keep.compensate={flag}")
        lag = float(Run(*sets, seconds=32).while_pouring(8.0)[:, 1].mean())
        say(
            f"10 Hz, 100 ms at 2.2 m/s, compensated: {flag}",
            f"{100 * lag:.1f} cm",
            "3 cm" if flag == "true" else "22 cm",
        )
    for text, name in ((", silent_from_s: 25, silent_for_s: 2", "2 s"), (", silent_from_s: 25", "for good")):
        found = Run(*(k + RADIO % text for k in LINKS), QUICK, seconds=50)
        later = found.table[(found["t"] > 25.0) & (found["t"] < 36.0)]
        gap, _ = found.world.bodies.clearance("combine")
        if name == "2 s":
            say("silent for 2 s, largest deviation", f"{np.abs(later[:, 1:3]).max():.3f} m", "0.5 m")
        else:
            off = later[later[:, 4] == 0.0][0, 0] - 25.0
            say("silent for good", f"auger off after {off:.2f} s, {gap:.1f} m clear", "off and clear")


def fill() -> None:
    """Filling while driving."""
    one, last = ("one_spot", 45, 4.32), ("by_profile", 80, 4.32)
    for level, start, speed in (one, ("front_to_back", 86, 4.32), ("front_to_back", 75, 6.0), last):
        more = f"cart.heap.start_percent={start}", f"combine.speed.speed_kmh={speed}"
        found = Run(f"cart.cooperate={level}", *more, seconds=200)
        pipe, share = found.of("combine", UnloadState), found.of("cart", HeapState).level
        spilled = f"{100 * share:.1f} %, spilled {100 * pipe.missed / pipe.drawn:.3f} %"
        expected = "77 %" if level == "one_spot" else "95 %, spill 0.1 %"
        say(f"filled while driving, {level} from {start} %, {speed:g} km/h", spilled, expected)


def reachable() -> None:
    """Most that a box takes until 0.1 % is spilled, poured where there is room, by the station error."""
    box, reach = CART.box, np.linspace(-2.0, 2.0, 41)
    for spread in (0.0, 0.1, 0.2):
        found = []
        for sd in (0.0, 0.02, 0.05, 0.1, 0.2):
            rng = np.random.default_rng(1)
            surface, spilled, poured, keep = Surface(box, SLOPE, 0.1), 0.0, 0.0, math.exp(-0.5 / 4.0)
            error = np.zeros(2)
            while spilled <= 1e-3 * poured:
                error = keep * error + math.sqrt(1.0 - keep**2) * sd * rng.standard_normal(2)
                room = [surface.top_at_rim(x, 0.0) - surface.at(x, 0.0) for x in reach]
                x, y = float(reach[int(np.argmax(room))]), -min(max(surface.lean, -0.06), 0.06)
                for share, dx, dy in stream_of(spread):
                    spilled += surface.pour(0.06 * share, x + error[0] + dx, y + error[1] + dy)
                poured += 0.06
            found.append(f"{100 * surface.volume / largest_heap(box, SLOPE):.1f}")
        say(f"reachable, spread {spread:g} m, station sd 0 2 5 10 20 cm", " ".join(found) + " %", "95 %")


def box() -> None:
    """Rim and grain as a LiDAR above the pipe sees them, at twelve stations drawn by chance."""
    rng = np.random.default_rng(2024)
    for air, name in (("", "day"), (DUST, "dust 0.1 1/m, puffs"), (THICK, "dust 1 1/m, puffs")):
        for fill in (0.0, 0.5, 1.0, 1.1):
            rows, nees = [], []
            for k in range(12):
                place = rng.uniform((-2.0, 8.3, -6.0), (2.0, 9.2, 6.0)).tolist()
                seen, truth = look(
                    air=air, fill=fill, ahead=place[0], left=place[1], heading=place[2], seed=50 + k
                )
                if seen.is_seen:
                    rows.append(np.abs(errors(seen, truth)))
                    ratio = (seen.x - truth.x) / seen.x_sd, (seen.y - truth.y) / seen.y_sd
                    nees.append(0.5 * (ratio[0] ** 2 + ratio[1] ** 2))
            found = f"{len(rows)} of 12 seen"
            if rows:
                most = np.nanmax(np.array(rows), axis=0)
                found += f", largest: rim {most[:3].max():.3f} m {most[3]:.2f} deg, grain {most[4]:.3f} m"
                found += f", known {np.array(rows)[:, 5].mean():.2f}, NEES {np.mean(nees):.2f}"
            say(f"box, {name}, {100 * fill:.0f} %", found, "0.10 m, 1 deg, 0.10 m, or not seen")


def seen_box() -> None:
    """Links wrong by 0.35 m across and 0.30 m along, without and with the scanner; filling by it."""
    wrong = "{level: radio, rate_hz: 10, delay_ms: 100, left_error_m: %s, ahead_error_m: %s}"
    links = "combine.peer_link=" + wrong % (0.35, -0.3), "cart.peer_link=" + wrong % (-0.35, 0.3)
    sees = "combine.lidar=" + EYE % (MOUNT, ""), "combine.box={level: rim, rate_hz: 5}"
    for name, sets in (("the link alone", ()), ("with the scanner", sees)):
        along, across = np.abs(Run(*links, *sets, seconds=25).while_pouring(4.0)[:, 1:3]).mean(axis=0)
        say(f"links off by 0.30, 0.35 m, {name}", f"along {along:.3f}, across {across:.3f} m", "-")
    cases = (("front_to_back", 1, 86, 4.32), ("front_to_back", 7, 80, 5.4), ("by_profile", 7, 82, 4.32))
    for level, seed, start, speed in cases:
        aim = f"cart.cooperate={{level: {level}, keep: {{profile: seen}}}}"
        more = f"seed={seed}", f"cart.heap.start_percent={start}", f"combine.speed.speed_kmh={speed}"
        found = Run(*sees, aim, *more, seconds=190)
        pipe, share = found.of("combine", UnloadState), found.of("cart", HeapState).level
        spilled = f"{100 * share:.1f} %, spilled {100 * pipe.missed / pipe.drawn:.3f} %"
        say(f"by what is seen, {level}, seed {seed}, {start} %, {speed:g} km/h", spilled, "95 %, spill 0.1 %")


if __name__ == "__main__":
    parts = {p.__name__: p for p in (heap, trailer, unloading, station, link, fill, reachable, box, seen_box)}
    with allow_code(None):
        for name in sys.argv[1:] or parts:
            parts[name]()
