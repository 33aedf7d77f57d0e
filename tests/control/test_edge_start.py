"""Where an edge begins: drawn edges of which a block says little, and drawn fields without one."""

import numpy as np
import pytest

from swath.control.edge.blocks import Block
from swath.control.edge.canopy_classes import (
    AIR,
    CELL,
    CLASSES,
    DUST,
    HALF,
    LAYER,
    LOWEST,
    NOTHING,
)
from swath.control.edge.canopy_rays import CanopyRays, EdgeFrame, Ground, RayAnswers
from swath.control.edge.edge_start import DOUBT, EdgeStart
from swath.control.edge.populations import taller
from swath.signals import Scan
from tests.control.synthetic_edge import mounting

AHEAD, TRAVEL, SCANS, RAYS, BLOCKS = 9.0, 0.08, 5, 60, 20
FRAME = EdgeFrame(AHEAD, 0.0, 0.0, 0.0)


def class_at(height):
    return int((height - LOWEST) / LAYER)


def shares(**of):
    """Shares of classes by name: stubble, crop, air, dust, nothing."""
    made = np.zeros(CLASSES)
    kinds = {"stubble": class_at(0.05), "crop": class_at(0.5), "air": AIR, "dust": DUST, "nothing": NOTHING}
    for name, share in of.items():
        made[kinds[name]] = share
    return made / made.sum()


def block(rng, populations, *, puffs_stand=0.0):
    """Rays of 0.4 m, of which `populations` gives the shares of classes, at places beside the frame (n,).

    puffs_stand: share of puffs that seem to stand, by chance
    """
    made, none = Block(), np.full(RAYS, np.nan)
    for _ in range(SCANS):
        place = rng.uniform(-3.0, 3.0, RAYS)
        drawn = rng.uniform(size=(RAYS, 1))
        kind = np.minimum((np.cumsum(populations(place), axis=1) < drawn).sum(axis=1), CLASSES - 1)
        cells = np.floor((place + HALF) / CELL).astype(np.int64) * CLASSES + kind
        stands = rng.uniform(size=RAYS) < np.where(kind == DUST, puffs_stand, 0.5)
        made.add(RayAnswers(cells, stands, none, 0.0, RAYS, none, stands, place, place), TRAVEL)
    return made


def begins(rng, edge, crop, stubble, at=lambda x: (x, 0.0, 0.0), blocks=BLOCKS):
    """The first edge of a filter, and the blocks until then. edge(x) -> u of it at x in the frame at rest."""
    start = EdgeStart()
    for n in range(blocks):
        pose = at(TRAVEL * SCANS * (n + 1))
        c, s = np.cos(pose[2]), np.sin(pose[2])

        def beside(place, pose=pose, c=c, s=s):
            x, u = pose[0] + c * AHEAD - s * place, pose[1] + s * AHEAD + c * place
            return np.where((u > edge(x))[:, None], crop, stubble)

        start.add(block(rng, beside), FRAME, pose)
        begun = start.edge(1.5)
        if begun is not None:
            return begun, n + 1
    return None, blocks


def faint(rng):
    """Crop in which few rays end, beside stubble of which few come back: either by what is drawn."""
    crop, quiet = rng.uniform(0.12, 0.25), rng.choice(["air", "nothing", "dust"])
    return shares(crop=crop, stubble=0.05, **{quiet: 0.95 - crop}), shares(stubble=0.05, **{quiet: 0.95})


@pytest.mark.parametrize("seed", range(6))
def test_a_faint_edge_begins_where_it_is_and_sooner_than_one_block_says_it(seed):
    rng = np.random.default_rng(seed)
    place, (crop, stubble) = rng.uniform(-1.2, 1.2), faint(rng)
    begun, blocks = begins(rng, lambda x: np.full_like(x, place), crop, stubble)
    assert begun is not None
    assert blocks > 1  # one block alone is not sure of it
    assert begun.gain >= -np.log(DOUBT)
    assert abs(begun.place - place) < max(0.15, 3.0 * np.sqrt(begun.variance))


@pytest.mark.parametrize("seed", range(4))
def test_evidence_follows_the_edge_past_a_machine_that_drives_at_an_angle_and_turns(seed):
    """Driven 0.1 rad toward or away from it, or turning: what was seen before lies at its place now."""
    rng = np.random.default_rng(10 + seed)
    angle, place = rng.uniform(0.06, 0.1) * rng.choice([-1, 1]), rng.uniform(-0.5, 0.5)
    turn = rng.uniform(-0.005, 0.005)  # rad per m
    at = lambda x: (x, 0.5 * turn * x * x, turn * x)  # noqa: E731
    begun, blocks = begins(rng, lambda x: place + angle * (x - AHEAD), *faint(rng), at)
    x, u, heading = at(TRAVEL * SCANS * blocks)
    there = place + angle * x - u - heading * AHEAD
    assert begun is not None
    assert abs(begun.place - there) < 0.25
    if blocks > 4:
        assert (begun.angle > 0.0) == (angle - heading > 0.0)


@pytest.mark.parametrize("seed", range(6))
def test_no_edge_begins_in_one_population_beside_a_strip_or_with_the_crop_outside(seed):
    rng = np.random.default_rng(20 + seed)
    crop, stubble = faint(rng)
    middle, width = rng.uniform(-1.0, 1.0), rng.uniform(0.3, 0.5)
    dense = shares(crop=rng.uniform(0.7, 0.9), stubble=0.1)
    start = [EdgeStart() for _ in range(5)]
    fields = (
        lambda place: np.tile(crop, (len(place), 1)),
        lambda place: np.tile(stubble, (len(place), 1)),
        lambda place: np.where((np.abs(place - middle) < 0.5 * width)[:, None], stubble, crop),
        lambda place: np.where((np.abs(place - middle) < 0.5 * width)[:, None], stubble, dense),
        lambda place: np.where((place < middle)[:, None], crop, stubble),
    )
    for n in range(12):
        for one, field in zip(start, fields, strict=True):
            one.add(block(rng, field), FRAME, (TRAVEL * SCANS * n, 0.0, 0.0))
            assert one.edge(1.5) is None


@pytest.mark.parametrize("seed", range(4))
def test_puffs_on_both_sides_make_no_tall_crop_and_tall_crop_among_them_does(seed):
    rng = np.random.default_rng(30 + seed)
    puffs = shares(dust=rng.uniform(0.3, 0.7), stubble=0.05, nothing=0.2)
    low, high, rest = shares(crop=1.0), np.zeros(CLASSES), rng.uniform(0.3, 0.7)
    high[class_at(1.2) : class_at(1.34)] = 1.0
    for crop, is_tall in ((low, False), (high / high.sum(), True)):
        mixed = rest * puffs + (1.0 - rest) * crop
        sides = lambda place, mixed=mixed: np.where((place > 0.0)[:, None], mixed, puffs)  # noqa: E731
        made = block(rng, sides, puffs_stand=0.2)
        top = taller(made.sides(0.0), 0.85)
        assert (top > 0.0) == is_tall
        assert not is_tall or top == pytest.approx(1.3, abs=0.1)


def test_an_echo_of_the_air_at_the_scanner_says_that_nothing_answered():
    """At 0.7 to 1.5 m no crop stands: in fog and behind a dirty window every beam that meets none answers."""
    azimuth, ranges = np.linspace(-1.0, 1.0, 41), np.random.default_rng(1).uniform(0.7, 1.49, (41, 1))
    rays, ground = CanopyRays(mounting(), 1.0), Ground()
    rays.take(
        Scan(1, np.zeros(41), azimuth, np.zeros(41), ranges.astype(np.float32), np.ones((41, 1), np.float32)),
        (2.0, 0.0), FRAME, ground, -3.5, -0.25,
    )  # fmt: skip
    kinds = rays.answers(ground, 0.0, 0.85, (0.0, 0.0)).cells % CLASSES
    assert len(kinds) > 5
    assert set(kinds.tolist()) == {AIR}
