"""Detectors of many worlds in step tell what each tells alone: scans come late, worlds are saved and end."""

from dataclasses import replace

import numpy as np
import pytest

from swath.control.edge.detectors import Detectors
from swath.control.edge.likelihood_ratio import LikelihoodRatio, Params
from swath.core.packed_state import pack, unpack
from swath.core.random import Stream
from swath.core.together import Samples
from swath.signals import CropFlow, Inertial, Odometry
from tests.control.closed_loop import setup_of
from tests.control.edge_drive import PERIOD
from tests.control.synthetic_edge import Scanner, Stand, mounting

STEPS, SAVED, ENDED = 70, 45, 55


def part(rng):
    setup = replace(setup_of("left", 0.04, mounting()), crop_height=float(rng.choice([0.0, 0.9])))
    drawn = {"slip_percent": rng.uniform(0.0, 5.0), "stubble_m": rng.uniform(0.05, 0.3)}
    return LikelihoodRatio(Params(**drawn, search_m=rng.uniform(0.5, 2.0)), setup)


def drawn_inputs(rng, *, has_unit, has_flow):
    """What one world gets in each step; scans come late to all of them alike."""
    scanner = Scanner(Stand(lambda x, y: 6.0 - y, density=rng.uniform(100.0, 600.0)), mounting())
    speed, bends = rng.uniform(1.0, 4.0), rng.uniform(-0.02, 0.02)
    angles, found = None, []
    for k in range(STEPS):
        end = (k + 1) * PERIOD
        rate = bends + 0.01 * rng.standard_normal()
        scan = scanner.scan(end, (speed * 0.04 * (k + 1), 0.1, 0.0), rng)
        scan.ranges[rng.uniform(size=scan.ranges.shape) < 0.05] = np.nan
        if angles is None:
            angles = [scan.beam_t, scan.azimuth, scan.elevation]
            for own in angles:
                own.flags.writeable = False
        scan = type(scan)(scan.t, *angles, scan.ranges, scan.intensity)
        given = {"scan": scan, "odometry": Odometry(k * PERIOD, speed, rate, 0.0)}
        if has_unit:
            times = (k * PERIOD + 10_000_000 * n for n in (1, 2, 3, 4))
            given["inertial"] = tuple(Inertial(t, 0.0, 0.0, rate, 0.1, 0.3, 9.8) for t in times)
        if has_flow:
            given["flow"] = CropFlow(k * PERIOD, 0.0, 0.0, 0.0, 0, rng.uniform(0.9, 1.0), 0.04)
        found.append(given)
    return found


def given_of(inputs, step):
    """The inputs of all worlds in a step."""
    each = [own[step] for own in inputs]
    return {name: joined([own[name] for own in each]) for name in each[0]}


def joined(each):
    """One input of all worlds as samples."""
    if isinstance(each[0], tuple):
        return tuple(Samples.joined(one) for one in zip(*each, strict=True))
    return Samples.joined(each)


@pytest.mark.parametrize(
    ("seed", "has_unit", "has_flow"), [(1, True, True), (2, False, True), (3, True, False)]
)
def test_worlds_in_step_are_those_of_each(seed, has_unit, has_flow):
    rng = np.random.default_rng(seed)
    parts = [part(rng) for _ in range(3)]
    inputs = [drawn_inputs(rng, has_unit=has_unit, has_flow=has_flow) for _ in parts]
    both = Detectors(parts)
    both.reset([Stream(1, "edge")] * 3)
    for own in parts:
        own.reset(Stream(1, "edge"))
    told = []
    for k in range(STEPS):
        if k == SAVED:  # into other detectors, the worlds in another order
            state, other = [unpack(pack(both.save(w))) for w in (0, 1, 2)], Detectors(parts[::-1])
            other.reset([Stream(1, "edge")] * 3)
            for world, saved in enumerate(state[::-1]):
                other.load(world, saved)
            both, parts, inputs = other, parts[::-1], inputs[::-1]
        if k == SAVED + 2:  # others drive on, and back to here
            state = [both.save(w) for w in (0, 1, 2)]
            for ahead in range(k, k + 8):
                both.step(ahead * PERIOD, PERIOD, given_of(inputs, ahead))
            for world, saved in enumerate(state):
                both.load(world, saved)
        if k == ENDED:
            both.active[2] = False
        each, given = [own[k] for own in inputs], given_of(inputs, k)
        if k % 7 == 5:
            each, given = [{**own, "scan": None} for own in each], {**given, "scan": None}
        found = both.step(k * PERIOD, PERIOD, given)["edge"].each()
        alone = [own.step(k * PERIOD, PERIOD, one)["edge"] for own, one in zip(parts, each, strict=True)]
        last = found[2] if k < ENDED else told[-1]
        assert repr(found[:2]) == repr(alone[:2])
        assert repr(replace(found[2], t=0)) == repr(replace(last if k >= ENDED else alone[2], t=0))
        told.append(found[2])
    assert all(edge.is_found for edge in found)
