"""Where an edge goes on that broke off."""

import numpy as np
import pytest

from tests.control.block_rig import Rig

STEP, NOISE = 0.4, 0.02  # m from block to block; m, standard deviation of a block
FREE = 3  # blocks that may be wrong, by the reach of their rays


def carried_on(rows, place, scatter=0.0):
    """The track as it goes on, and the distance behind which it breaks off [m].

    place: of the track, 20 m along the edge: x, u [m], angle [rad], bend [1/m]
    """
    rig = Rig().set_points(rows).begin(*place, 20.0)
    return rig.arc, rig("carry_on", scatter)[0]


def broken(rng, *, bend, since, wrong, turn=0.0):
    """An edge that bends since a way before its break [m], the last blocks wrong: rows, place and angle.

    The track has followed the wrong ones, off by 0.1 m and 0.15 rad; turn: of the whole, in the plane [rad]
    """
    way = STEP * np.arange(-24, 1)
    angle = bend * np.maximum(way + since, 0.0)
    x, u = np.cumsum(STEP * np.cos(angle)), np.cumsum(STEP * np.sin(angle))
    beside = rng.normal(0.0, NOISE, len(way))
    beside[len(way) - wrong :] += np.linspace(0.1, 0.25, wrong)
    x, u = x - beside * np.sin(angle), u + beside * np.cos(angle)
    place = (x[-1], u[-1] + 0.1, angle[-1] + 0.15)
    c, s = np.cos(turn), np.sin(turn)
    rows = np.column_stack([c * x - s * u, s * x + c * u, np.full(len(x), NOISE**2), way + 20.0])
    at = c * place[0] - s * place[1], s * place[0] + c * place[1], place[2] + turn
    return rows, (*at, 0.05), angle[-1] + turn


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("bend", [-0.08, -0.05, 0.05, 0.08])
def test_a_bend_goes_on_behind_the_break(bend, seed):
    rng = np.random.default_rng([7, seed])
    rows, track, angle = broken(rng, bend=bend, since=rng.uniform(3.5, 9.0), wrong=seed % 3)
    arc, last = carried_on(rows, track)
    assert arc["bend"] == pytest.approx(bend, abs=0.03)  # a parabola in the place of an arc
    assert arc["angle"] == pytest.approx(angle, abs=0.09)
    assert last >= 20.0 - STEP * FREE - 1e-9  # no more than their rays reach


@pytest.mark.parametrize("seed", range(6))
def test_a_straight_line_goes_on_straight(seed):
    rng = np.random.default_rng([8, seed])
    rows, track, angle = broken(rng, bend=0.0, since=0.0, wrong=seed % 4)
    arc, _ = carried_on(rows, track)
    assert abs(arc["bend"]) < 0.012
    assert arc["angle"] == pytest.approx(angle, abs=0.03)
    assert arc["u"] - rows[-1, 1] == pytest.approx(-0.2 * (seed % 4 > 0), abs=0.12)


def test_it_turns_and_mirrors_with_the_plane():
    drawn = {"bend": 0.06, "since": 5.0, "wrong": 2}
    arc, last = carried_on(*broken(np.random.default_rng(9), **drawn)[:2], 1e-4)
    turned, also = carried_on(*broken(np.random.default_rng(9), **drawn, turn=1.1)[:2], 1e-4)
    assert also == last
    assert turned["angle"] - arc["angle"] == pytest.approx(1.1)
    assert turned["bend"] == pytest.approx(arc["bend"])
    assert turned["covariance"] == pytest.approx(arc["covariance"])
    rows, (x, u, angle, bend), _ = broken(np.random.default_rng(9), **drawn)
    rows[:, 1] *= -1.0
    mirrored, _ = carried_on(rows, (x, -u, -angle, -bend), 1e-4)
    for name in ("u", "angle", "bend"):
        assert mirrored[name] == pytest.approx(-arc[name])


def test_few_blocks_show_no_bend():
    """Nor what is wrong: the line goes on from where the track is."""
    rows, track, _ = broken(np.random.default_rng(1), bend=0.05, since=5.0, wrong=0)
    arc, last = carried_on(rows[-3:], track)
    assert (arc["bend"], arc["angle"], last) == (0.0, track[2], 20.0)
