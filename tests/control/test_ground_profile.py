"""Stubble told apart from the ground under it: drives over drawn waves whose form is known."""

from dataclasses import dataclass

import numpy as np
import pytest
import warp as wp

from swath.control.edge.detector_kernel import Memory, go_over
from swath.kernels import of_worlds, repeatable
from tests.control.canopy_scans import Canopy
from tests.control.synthetic_edge import mounting

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

BASE, TRACK, STEP = 3.9, 3.0, 0.1  # m: axles apart, wheels apart, travel from scan to scan
X, U, SLOPE = 12.0, -5.0, 0.25  # m, m: where the stubble is seen; of a hillside
USUAL = 0.15, 0.1  # m: stubble that the driver expects, and its standard deviation


@wp.kernel(enable_backward=False)
def go(memories: wp.array(dtype=Memory)):
    go_over(memories[0])


class Profile(Canopy):
    """The ground as `go_over` knows it. flat: how far it rises is asked over so many metres"""

    def __init__(self, flat=0.0):
        super().__init__(mounting(), base=BASE, usual=USUAL, flat=flat)
        self.row_of_track["height"], self.held = 1.0, [self.memory()]
        self.go = repeatable(go, [of_worlds(Memory, self.held)]).launch

    def over(self, travel, seen, rise):
        row = self.row
        row["travel"], row["is_known"], row["is_seen"] = travel, True, seen is not None
        self.step["is_sure"] = rise is not None
        if seen is not None:
            row["middle_x"], row["edge_u"], row["level"], row["slope"] = seen
        if rise is not None:
            self.step["ahead"], self.step["rise"] = rise
        self.go()

    @property
    def stubble(self):
        return self.ground["plane"]

    @property
    def stubble_sd(self):
        return self.ground["plane_sd"]


@dataclass
class Ground:
    """A wave, a hillside and unevenness of some millimetres, drawn."""

    rng: np.random.Generator
    length: float
    height: float
    side: float

    def __post_init__(self):
        self.turn, self.phase = self.rng.uniform(-np.pi, np.pi, 2)
        self.ahead, self.stubble = self.rng.uniform(-SLOPE, SLOPE), self.rng.uniform(0.02, 0.3)

    def z(self, x, u):
        along, across = 2.0 * np.pi / self.length * np.array([np.cos(self.turn), np.sin(self.turn)])
        wave = self.height * np.cos(along * x + across * u + self.phase)
        return wave + self.ahead * x + self.side * u

    def machine(self, s):
        """Slopes ahead and to the side of a machine whose axle is at s."""
        half = 0.5 * TRACK
        return (self.z(s, 0) - self.z(s - BASE, 0)) / BASE, (self.z(s, half) - self.z(s, -half)) / TRACK

    def seen(self, s):
        ahead, aside = self.machine(s)
        over = self.z(s + X, U) - self.z(s, 0) - ahead * X - aside * U
        slope = 0.5 * (self.z(s + X, U + 1) - self.z(s + X, U - 1)) - aside
        return X, U, over + self.stubble + 0.01 * self.rng.standard_normal(), slope


def drawn(seed):
    """Waves of 20 to 80 m whose ground never falls by more than 10 deg, a fourth of them level fields."""
    rng = np.random.default_rng(seed)
    length = float(np.exp(rng.uniform(np.log(20.0), np.log(80.0))))
    height = min(rng.uniform(0.0, 0.8), 0.17 * length / (2.0 * np.pi)) * (seed % 4 > 0)
    return Ground(rng, length, height, rng.uniform(-SLOPE, SLOPE))


def driven(ground, far, *, has_unit, flat=0.0):
    profile, off = Profile(flat), 0.005 * ground.rng.standard_normal(2)
    for k in range(round(far / STEP)):
        felt = np.array(ground.machine(k * STEP)) + off + 0.002 * ground.rng.standard_normal(2)
        profile.over(STEP, ground.seen(k * STEP), tuple(felt) if has_unit else None)
    return profile


@pytest.mark.parametrize("seed", range(8))
def test_stubble_is_known_on_any_ground_that_was_driven_over(seed):
    ground = drawn(seed)
    profile = driven(ground, 30.0, has_unit=True)
    assert profile.stubble_sd < 0.07
    assert abs(profile.stubble - ground.stubble) < max(3.0 * profile.stubble_sd, 0.02)


def test_deviations_without_an_inertial_unit_are_honest():
    """Nothing tells a long rise from stubble there: what is told is wide, and as wide as it is wrong."""
    away = []
    for seed in range(100, 112):
        ground = drawn(seed)
        profile = driven(ground, 20.0, has_unit=False)
        away.append((profile.stubble - ground.stubble) / profile.stubble_sd)
    assert np.sqrt(np.mean(np.square(away))) < 1.8


def test_level_ground_is_known_soon():
    ground = drawn(0)
    assert ground.height == 0.0
    profile = driven(ground, 8.0, has_unit=True)
    assert profile.stubble == pytest.approx(ground.stubble, abs=0.05)
    assert profile.stubble_sd < 0.06


@pytest.mark.parametrize("seed", [1, 2, 3, 5])
def test_the_rise_of_the_ground_between_crop_and_stubble(seed):
    ground = drawn(seed)
    ground.turn = 0.0
    profile = driven(ground, 25.0, has_unit=True, flat=3.0)
    at, (ahead, _) = 25.0 - STEP, ground.machine(25.0 - STEP)
    rise = (ground.z(at + X, 0.0) - ground.z(at + X - 3.0, 0.0)) / 3.0 - ahead
    assert profile.row["grade"] == pytest.approx(rise, abs=0.035)


def test_where_nothing_is_seen_nothing_is_learned():
    """Dust for 30 m: the stubble is as unknown as before, and the next look counts again."""
    ground = drawn(4)
    profile = Profile()
    for k in range(300):
        profile.over(STEP, None, ground.machine(k * STEP))
    assert profile.stubble_sd == pytest.approx(USUAL[1], rel=0.1)
    for k in range(300, 500):
        profile.over(STEP, ground.seen(k * STEP), ground.machine(k * STEP))
    assert profile.stubble == pytest.approx(ground.stubble, abs=0.04)


def test_a_mirrored_field_is_mirrored():
    """Left and right give the same stubble, bit for bit."""
    ground, told = drawn(3), []
    looks = [(ground.seen(k * STEP), ground.machine(k * STEP)) for k in range(150)]
    for sign in (1.0, -1.0):
        profile = Profile()
        for (x, u, level, slope), (ahead, aside) in looks:
            profile.over(STEP, (x, sign * u, level, sign * slope), (ahead, sign * aside))
        told.append((profile.stubble, profile.stubble_sd))
    assert told[0] == told[1]
