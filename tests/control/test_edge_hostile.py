"""Whatever a sensor sends: an edge or none, never an exception, never a number that is not one."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swath.control.edge import likelihood_ratio, otsu
from swath.core.random import Stream
from swath.signals import Odometry, Scan
from tests.control.closed_loop import setup_of
from tests.control.synthetic_edge import Scanner, Stand, mounting

PERIOD = 40_000_000
MOUNT = mounting()
GOOD = Scanner(Stand(lambda x, y: 6.0 - y), MOUNT)
LEVELS = [likelihood_ratio.LEVEL, otsu.LEVEL]

ranges = st.one_of(
    st.floats(0.0, 40.0),
    st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -3.0, 1e30, 5.7, 8.35]),
)
odometry = st.builds(
    Odometry,
    st.just(0),
    st.floats(-3, 30) | st.just(np.nan),
    st.floats(-3, 3) | st.just(np.inf),
    st.just(0.0),
)


@st.composite
def scans(draw):
    values = draw(st.lists(ranges, max_size=60))
    n = len(values)
    echoes = draw(st.integers(1, 3))
    azimuth = np.linspace(-0.9, 0.9, n) if draw(st.booleans()) else np.zeros(n)
    if n and draw(st.booleans()):
        azimuth[draw(st.integers(0, n - 1))] = np.nan
    late = draw(st.sampled_from([0.0, -0.02, -1e9, np.nan]))
    table = np.repeat(np.array(values, dtype=np.float32).reshape(n, 1), echoes, axis=1)
    return Scan(0, np.full(n, late), azimuth, np.zeros(n), table, np.ones_like(table))


def stamped(scan, t):
    return Scan(t, scan.beam_t, scan.azimuth, scan.elevation, scan.ranges, scan.intensity)


def check(edge):
    assert 0.0 <= edge.confidence <= 1.0
    assert edge.is_found == bool(np.isfinite(edge.offset))
    assert np.isfinite(edge.heading) == edge.is_found
    assert np.isfinite(edge.curvature)
    assert np.isfinite(edge.reference_x)


@pytest.mark.parametrize("level", LEVELS)
@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(scans(), odometry, st.integers(-3, 60)), min_size=1, max_size=8), st.booleans())
def test_any_scans(level, sequence, is_warm):
    detector = level.component(level.params(), setup_of("left", 0.04, MOUNT))
    check(detector.reset(Stream(1, "edge"))["edge"])
    rng = np.random.default_rng(0)
    t = 0
    for i in range(10 if is_warm else 0):
        t += PERIOD
        scan = GOOD.scan(t, (0.08 * i, 0.1, 0.0), rng)
        inputs = {"scan": scan, "odometry": Odometry(t, 2.0, 0.0, 0.0)}
        check(detector.step(t - PERIOD, PERIOD, inputs)["edge"])
    for scan, driven, ticks in sequence:
        t += PERIOD
        inputs = {"scan": stamped(scan, max(0, t - ticks * PERIOD)), "odometry": driven}
        check(detector.step(t - PERIOD, PERIOD, inputs)["edge"])


@pytest.mark.parametrize("level", LEVELS)
def test_no_scan_at_all(level):
    detector = level.component(level.params(), setup_of("left", 0.04, MOUNT))
    detector.reset(Stream(1, "edge"))
    edge = detector.step(0, PERIOD, {"scan": None, "odometry": Odometry(0, 2.0, 0.0, 0.0)})["edge"]
    assert not edge.is_found
    assert edge.t == PERIOD


@pytest.mark.parametrize("share", [0.1, 0.3, 0.6])
def test_lost_echoes_and_dust_cost_little(share):
    detector = otsu.Otsu(otsu.Params(lean_deg=0.0), setup_of("left", 0.04, MOUNT))
    detector.reset(Stream(1, "edge"))
    rng = np.random.default_rng(2)
    for i in range(75):
        t = (i + 1) * PERIOD
        scan = GOOD.scan(t, (0.08 * i, 0.1, 0.0), rng)
        struck = rng.uniform(size=len(scan.ranges)) < share
        dust = rng.uniform(0.2, 1.0, len(scan.ranges))
        table = np.where(
            struck, np.where(rng.uniform(size=len(struck)) < 0.5, np.nan, dust), scan.ranges[:, 0]
        )
        bad = Scan(
            t, scan.beam_t, scan.azimuth, scan.elevation, table.astype(np.float32)[:, None], scan.intensity
        )
        inputs = {"scan": bad, "odometry": Odometry(t, 2.0, 0.0, 0.0)}
        edge = detector.step(t - PERIOD, PERIOD, inputs)["edge"]
    assert edge.is_found
    assert edge.offset == pytest.approx(5.9, abs=0.06)
