"""The receiver's errors against a measured one: a u-blox with RTK that stood for 41 minutes, at 1 Hz."""

import numpy as np
import pytest

from swath.record.read.fixes import TangentPlane
from swath.sensing.gnss.receiver_errors import RECEIVERS
from tests.shared_data import DATA

LOG = DATA / "gnss_ublox_rtk" / "demo5_b34f_f.pos"
pytestmark = pytest.mark.skipif(not LOG.is_file(), reason="needs the u-blox RTK log: SWATH_DATA")
LAGS = (1, 10, 60, 120, 300, 900)  # [s]


@pytest.fixture(scope="module")
def standing():
    """Fixed positions of the longest stand, (n, 3) [m], without their mean."""
    rows = [line.split() for line in LOG.read_text().splitlines() if not line.startswith("%")]
    table = np.array([[float(r[3]), float(r[2]), float(r[4]), float(r[5])] for r in rows])
    place = TangentPlane(*table[200, :3])(table[:, :3])
    moves = np.hypot(*np.diff(place[:, :2], axis=0).T) > 0.05
    ends = np.flatnonzero(np.concatenate([[True], moves | (table[1:, 3] != 1), [True]]))
    longest = int(np.argmax(np.diff(ends)))
    found = place[ends[longest] + 1 : ends[longest + 1]]
    return found - found.mean(axis=0)


def test_it_stood_for_41_minutes(standing):
    assert len(standing) == pytest.approx(2495, abs=3)
    assert 1e3 * standing.std(axis=0) == pytest.approx([4.7, 4.4, 8.6], abs=0.1)


def test_differences_over_time_are_those_of_the_fitted_errors(standing):
    _, fitted = RECEIVERS["rtk_standing"]
    for lag in LAGS:
        apart = standing[lag:] - standing[:-lag]
        level = np.sqrt(np.mean(apart[:, :2] ** 2))
        assert fitted.difference(lag) == pytest.approx(level, rel=0.12), lag
        assert fitted.difference(lag) * fitted.vertical == pytest.approx(apart[:, 2].std(), rel=0.2), lag


def test_a_moving_receiver_is_taken_to_be_worse_than_the_standing_one(standing):
    _, moving = RECEIVERS["rtk"]
    assert (
        standing[:, :2].std() < moving.sd < 0.0143
    )  # and better than what was published between driven rows
