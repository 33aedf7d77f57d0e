"""Two scanners joined: what they agree on, what they contradict each other in, and which way stems lean."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swath.control.edge.feet.stem_lean import StemLean
from swath.control.edge.joined import Joined, JoinedParams, chance_of
from swath.control.edge.likelihood_ratio import LikelihoodRatio
from swath.control.edge.likelihood_ratio import Params as ScannerParams
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.scenario.slots import CATALOGUE
from swath.signals import Odometry
from tests.control.closed_loop import setup_of
from tests.control.synthetic_edge import Scanner, Stand, mounting

pytestmark = pytest.mark.usefixtures("code_allowed")
EXAMPLE = Path(__file__).parents[2] / "examples" / "two_scanners.py"
PERIOD, SPEED = 40_000_000, 2.0
SIDES = ("left", "right")


def setup(sides=SIDES):
    return replace(setup_of("left", 0.04), mountings={side: mounting("left") for side in sides})


def drive(level, edges, *, metres=10.0, mountings=None):
    """Edges told while scanners see crop from y = their own edge on; the machine drives 0.1 m outside 6 m."""
    places = mountings or dict.fromkeys(edges, mounting("left"))
    scanners = {name: Scanner(Stand(lambda x, y, at=at: at - y), places[name]) for name, at in edges.items()}
    level.reset(Stream(1, "edge"))
    rng, told = np.random.default_rng(0), []
    for k in range(round(metres / (SPEED * 0.04))):
        pose = (SPEED * 0.04 * (k + 1), 0.1, 0.0)
        scans = {name: scanner.scan((k + 1) * PERIOD, pose, rng) for name, scanner in scanners.items()}
        told.append(
            level.step(k * PERIOD, PERIOD, {**scans, "odometry": Odometry(0, SPEED, 0.0, 0.0)})["edge"]
        )
    return told


def each():
    return JoinedParams(each=ScannerParams(slip_percent=0.0))


def test_two_that_agree_are_sure():
    both = drive(Joined(each(), setup()), {"left": 6.0, "right": 6.0})[-1]
    one = drive(Joined(each(), setup(["left"])), {"left": 6.0})[-1]
    assert abs(both.offset - 5.9) < 0.06
    assert both.confidence > 0.9
    assert both.offset_sd < one.offset_sd + 0.001  # what both have in common stays


def test_one_scanner_is_as_by_itself():
    joined = drive(Joined(each(), setup(["scan"])), {"scan": 6.0}, metres=6.0)
    alone = drive(LikelihoodRatio(each().each, setup(["scan"])), {"scan": 6.0}, metres=6.0)
    assert joined[-1].is_found
    assert joined[-40:] == alone[-40:]


def example():
    level = CATALOGUE.registry.get("edge", f"{EXAMPLE}:TwoScanners")
    return level.component(level.params(), setup())


@pytest.mark.parametrize("level", [lambda: Joined(each(), setup()), example])
def test_two_that_contradict_each_other_are_not_sure(level):
    told = drive(level(), {"left": 6.0, "right": 5.3})[-1]
    assert told.confidence < 0.5
    assert told.offset_sd > 0.3


def test_one_that_looks_out_of_the_crop_counts_less():
    """It sees where the tops end, as far across as a ray goes while it falls by what tops differ."""
    places = {"left": mounting("left"), "right": mounting("left", outside=-5.0, height=3.0)}
    inside = Joined(each(), replace(setup(), mountings=places))
    beside = drive(Joined(each(), setup()), {"left": 6.0, "right": 5.8})[-1]
    told = drive(inside, {"left": 6.0, "right": 5.8}, mountings=places)[-1]
    assert abs(told.offset - 5.9) < 0.05
    assert abs(beside.offset - 5.8) < 0.05


def test_what_one_does_not_see_the_other_says():
    told = drive(Joined(each(), setup()), {"left": 6.0, "right": 600.0})[-1]
    assert abs(told.offset - 5.9) < 0.06


def test_a_saved_one_goes_on():
    one, other = Joined(each(), setup()), Joined(each(), setup())
    drive(one, {"left": 6.0, "right": 6.0}, metres=5.0)
    other.reset(Stream(1, "edge"))
    other.load(one.save())
    scanner, rng = Scanner(Stand(lambda x, y: 6.0 - y), mounting("left")), np.random.default_rng(3)
    for k in range(63, 90):
        scan = scanner.scan((k + 1) * PERIOD, (SPEED * 0.04 * (k + 1), 0.1, 0.0), rng)
        inputs = {"left": scan, "right": scan, "odometry": Odometry(0, SPEED, 0.0, 0.0)}
        assert other.step(k * PERIOD, PERIOD, inputs) == one.step(k * PERIOD, PERIOD, inputs)


def test_without_a_scanner_it_cannot_work():
    with pytest.raises(InputError, match="wires"):
        Joined(JoinedParams(), setup([]))


@pytest.mark.parametrize(
    ("chi_square", "freedom"), [(3.841, 1), (5.991, 2), (7.815, 3), (9.488, 4), (11.070, 5)]
)
def test_chances_of_chi_square(chi_square, freedom):
    """Five percent points, Abramowitz & Stegun 1964, table 26.8."""
    assert chance_of(chi_square, freedom) == pytest.approx(0.05, rel=2e-3)


def looks(lean_deg, azimuths, gain=1.0):
    """Rays 13 deg down at azimuths [deg] > 0 toward the crop, and the brightness of matt bare cylinders."""
    a, down = np.radians(azimuths), np.radians(13.0)
    rays = np.stack(
        [np.cos(down) * np.cos(a), np.cos(down) * np.sin(a), np.full(len(a), -np.sin(down))], axis=1
    )
    stem = np.array([0.0, -np.sin(np.radians(lean_deg)), np.cos(np.radians(lean_deg))])
    return rays, gain * np.sqrt(1.0 - (rays @ stem) ** 2)


@pytest.mark.parametrize("lean", [-40.0, 0.0, 30.0, 45.0])
def test_stems_are_seen_to_lean_out(lean):
    """Cylinders without leaves, whose height says how far they lean but not which way."""
    stems = StemLean(0.03)
    stems.add(*looks(lean, np.linspace(25.0, 60.0, 500)))
    assert not stems.is_seen
    stems.add(*looks(lean, np.linspace(-60.0, -25.0, 500)))
    assert stems.is_seen
    told, sd = stems.outward(np.radians(abs(lean)))
    assert abs(told - max(np.tan(np.radians(lean)), 0.0)) < max(2.0 * sd, 0.05)
    assert (told > 0.3) == (lean > 0.0)
    assert sd < 0.35


def leafy(lean_deg, toward_deg, azimuths):
    """Rays 13 deg down, and the brightness of stems with leaves; toward 0 = along the edge, -90 = out."""
    rays, _ = looks(0.0, azimuths)
    lean, way = np.radians(lean_deg), np.radians(toward_deg)
    q = rays @ np.array([np.sin(lean) * np.cos(way), np.sin(lean) * np.sin(way), np.cos(lean)])
    return rays, np.exp(0.11 * q) * (1.0 - q * q) ** (0.5 * 0.37)


@pytest.mark.parametrize(
    ("lean", "toward"), [(35, -110), (35, -70), (43, -90), (40, -150), (40, -30), (40, 80)]
)
def test_a_lean_along_the_edge_is_told_from_one_across(lean, toward):
    """Direction in between: only the part that hangs over the edge counts."""
    stems = StemLean(0.02, scanners=2)
    stems.add(*leafy(lean, toward, np.linspace(3.0, 67.0, 2000)), 0)
    stems.add(*leafy(lean, toward, np.linspace(-73.0, 20.0, 2000)), 1)
    told, sd = stems.outward(np.radians(lean))
    off = abs(told - max(-np.tan(np.radians(lean)) * np.sin(np.radians(toward)), 0.0))
    assert off < max(sd, 0.05)
    assert off < (0.08 if toward < -80 or toward > 0 else 0.25)  # stems that lean ahead hide it most
    assert sd < 0.35


def test_a_difference_of_the_scanners_alone_says_little():
    stems = StemLean(0.1)
    stems.add(*looks(0.0, np.linspace(25.0, 60.0, 500), gain=0.95))
    stems.add(*looks(0.0, np.linspace(-60.0, -25.0, 500)))
    told, sd = stems.outward(np.radians(40.0))
    assert sd > 0.3
    assert stems.outward(0.0)[0] < 0.1
    assert told < 0.84
