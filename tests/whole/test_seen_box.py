"""Cart and combine go by the box as a LiDAR above the pipe sees it, not by the messages and the heap."""

import numpy as np
import pytest

from swath.core.schedule import NS
from swath.signals import BoxSeen, UnloadState
from tests.control.box_rig import EYE, MOUNT, THICK
from tests.whole.cart_rig import Run

EYE = EYE.replace("rate_hz: 10", "rate_hz: 5")
SEES = ("combine.lidar=" + EYE % (MOUNT, ""), "combine.box={level: rim, rate_hz: 5}")
BLIND = ("combine.lidar=" + EYE % (MOUNT, THICK), SEES[1])
WRONG = "{level: radio, rate_hz: 10, delay_ms: 100, left_error_m: %s, ahead_error_m: %s}"
SEEN = "cart.cooperate={level: by_profile, keep: {profile: seen}}"


def miscalibrated(left, ahead):
    """Both links are wrong by so much [m]."""
    return "combine.peer_link=" + WRONG % (left, ahead), "cart.peer_link=" + WRONG % (-left, -ahead)


@pytest.mark.parametrize(("sees", "low", "high"), [((), 0.25, 0.5), (SEES, 0.0, 0.1)])
def test_what_is_seen_corrects_the_link(sees, low, high):
    """Links wrong by 0.35 m across and 0.30 m along: so far beside the wanted place grain comes down."""
    rows = Run(*miscalibrated(0.35, -0.3), *sees, seconds=17).while_pouring(3.0)
    assert len(rows) > 50
    along, across = np.abs(rows[:, 1:3]).mean(axis=0)
    assert low <= along <= high
    assert low <= across <= high


def test_filling_by_what_is_seen():
    """The stream goes where the scanner sees room, on both sides of the middle."""
    run = Run(*SEES, SEEN, seconds=19)
    assert run["caught"][-1] > 500.0
    assert run["missed"][-1] == 0.0
    assert np.ptp(run["spot"]) > 0.5
    seen = run.of("combine", BoxSeen)
    assert seen.is_seen
    assert np.isfinite(seen.profile).mean() >= 0.75


def test_no_grain_into_a_box_that_is_not_seen():
    run = Run(*BLIND, SEEN, seconds=13)
    assert not run.of("combine", BoxSeen).is_seen
    assert run.of("combine", UnloadState).drawn == 0.0
    assert run["full"][5:].all()


def test_a_saved_run_goes_on_the_same():
    whole = Run(*SEES, SEEN, seconds=2)
    saved = whole.world.save()
    whole.drive_on(3)
    second = Run(*SEES, SEEN, seconds=3, resume=saved)
    np.testing.assert_array_equal(second.table, whole.table[-len(second.table) :])
    box = whole.of("combine", BoxSeen)
    assert box.t > 2 * NS
    assert second.of("combine", BoxSeen).x == box.x
