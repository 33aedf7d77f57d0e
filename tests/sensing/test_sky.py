"""Satellites over a place, what shades them, and the fix that a receiver makes of those it hears."""

import math

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.field.site_setup import Bodies
from swath.field.solid.obstacles import SheetObstacle, things_of
from swath.field.solid.solids import box_on_ground
from swath.sensing.gnss.antenna import Place
from swath.sensing.gnss.error import PRESETS, ErrorGnss, Loss
from swath.sensing.gnss.error import Params as ErrorParams
from swath.sensing.gnss.receiver_errors import FIGURES
from swath.sensing.gnss.sky import (
    DGPS,
    FIX,
    FLOAT,
    NONE,
    SINGLE,
    FixStates,
    Heard,
    Params,
    Shading,
    Silence,
    Sky,
    SkyGnss,
    Times,
    dilution,
    directions,
)
from swath.signals import FIX_QUALITIES
from tests.field.made_field import made_field
from tests.sensing.driven_states import circle, column, feed, setup_of, standing, straight

LATITUDE, LONGITUDE = math.radians(52.3), math.radians(10.4)
OPEN = Heard(14, 14, 0.8, 1.0)


def test_dilution_of_one_at_the_zenith_and_three_on_the_horizon():
    """Closed form of the least GDOP of four satellites: HDOP sqrt(4/3), VDOP sqrt(4/3), GDOP sqrt(3)."""
    flat = [[math.cos(a), math.sin(a), 0.0] for a in (0.0, 2.0 * math.pi / 3.0, 4.0 * math.pi / 3.0)]
    assert dilution(np.array([[0.0, 0.0, 1.0], *flat])) == pytest.approx((math.sqrt(4 / 3),) * 2, rel=1e-12)
    assert dilution(np.array(flat)) == (math.inf, math.inf)


def test_satellites_turn_as_their_orbits_say():
    """Never beyond 90 - |latitude - 56| deg in the north; 14 to 24 of 48 above 10 deg at 52 deg north."""
    counts, hdop = [], []
    for second in range(0, 86_400, 1800):
        up = directions(LATITUDE, LONGITUDE, second)
        assert np.allclose(np.linalg.norm(up, axis=1), 1.0)
        high = up[up[:, 2] > math.sin(math.radians(10.0))]
        counts.append(len(high))
        hdop.append(dilution(high)[0])
        northward = high[(np.abs(high[:, 0]) < 0.1) & (high[:, 1] > 0.0)]
        if len(northward):  # the pole is empty: nothing stands lower in the north than over it
            assert np.degrees(np.arcsin(northward[:, 2])).min() > 38.0
    assert min(counts) >= 11
    assert max(counts) <= 24
    assert 0.5 < np.median(hdop) < 1.0


def test_a_satellite_passes_over_again_after_a_sidereal_day_of_two_orbits():
    """GPS: two turns of the satellite are one of the Earth, within what a circle of 26,560 km is off."""
    first = directions(LATITUDE, LONGITUDE, 0.0)[:24]
    later = directions(LATITUDE, LONGITUDE, 86_164.1)[:24]
    assert np.degrees(np.arccos(np.clip((first * later).sum(axis=1), -1.0, 1.0))).max() < 1.0


def shaded(*obstacles, at=(0.0, 0.0, 3.9)):
    site = setup_of()
    site.bodies.set_things(things_of(obstacles, made_field()))
    up = np.array([[math.cos(e) * math.sin(a), math.cos(e) * math.cos(a), math.sin(e)] for e, a in SKY])
    return Shading(site, len(up)).look(np.array(at), up)


SKY = [
    (math.radians(e), math.radians(a)) for e in (10, 30, 60) for a in (0, 90, 180, 270)
]  # elevation, azimuth


def test_a_tree_shades_what_lies_behind_its_crown_and_a_building_blocks():
    """A crown from 2 to 8 m, 5 m wide, 10 m to the north: up to atan(4.1 / 10) = 22 deg from 3.9 m up."""
    blocked, leaves = shaded(SheetObstacle(kind="tree", x_m=0.0, y_m=10.0))
    assert not blocked.any()
    assert leaves.tolist() == [True] + [False] * 11
    blocked, leaves = shaded(SheetObstacle(kind="building", x_m=12.0, y_m=0.0))
    assert not leaves.any()
    assert blocked[1]
    assert not blocked[[0, 2, 3]].any()


def test_the_own_body_shades_an_antenna_below_its_roof():
    site = setup_of()
    site.bodies = Bodies()
    site.bodies.add("combine", box_on_ground((-2.75, 0.0, 0.0), (6.5, 3.0, 3.9)), Pose.identity())
    up = np.array([[-math.cos(0.3), 0.0, math.sin(0.3)], [math.cos(0.3), 0.0, math.sin(0.3)]])
    look = Shading(site, 2).look
    assert look(np.array([1.0, 0.0, 3.0]), up)[0].tolist() == [True, False]
    assert not look(np.array([1.0, 0.0, 3.95]), up)[0].any()


def machine_of(times=None, quality=NONE, best=FIX):
    states = FixStates(times or Times(), best)
    states.reset(quality)
    return states


def test_from_nothing_to_a_fix_and_back():
    states = machine_of(Times(fix_mean_s=6.0, wrong_percent=0.0, losses_per_h=0.0))
    found = [states.step(0.1, OPEN, (1.0 - math.exp(-1.0), 0.5, 0.5)) for _ in range(120)]
    assert found[8] == NONE  # 1 s to hear four
    assert found[9] == FLOAT
    assert found.index(FIX) == pytest.approx(9 + 80, abs=1)  # 2 s and 6 s times -ln(e^-1)
    assert states.step(0.1, OPEN._replace(carriers=4), (0.5, 0.5, 0.5)) == DGPS
    assert states.step(0.1, OPEN._replace(age=31.0), (0.5, 0.5, 0.5)) == DGPS
    assert states.step(0.1, OPEN._replace(age=121.0), (0.5, 0.5, 0.5)) == SINGLE
    assert states.step(0.1, OPEN._replace(codes=3), (0.5, 0.5, 0.5)) == NONE


def test_the_time_to_a_fix_is_exponential_beyond_its_least():
    rng, found = np.random.default_rng(3), []
    for _ in range(400):
        states = machine_of(Times(wrong_percent=0.0))
        steps = 0
        while states.quality != FIX:
            states.step(0.5, OPEN, tuple(rng.random(3)))
            steps += 1
        found.append(0.5 * steps - 1.0)
    assert np.mean(found) == pytest.approx(8.0 + 0.5, abs=3 * 6.0 / 20.0)


@pytest.mark.parametrize(("heard", "share"), [(OPEN, 0.02), (Heard(7, 7, 1.5, 1.0), 0.2)])
def test_wrong_fixes_come_as_often_and_stay_as_long_as_said(heard, share):
    times = Times(
        wrong_percent=2.0, wrong_shaded=10.0, wrong_s=20.0, fix_min_s=0.1, fix_mean_s=0.1, losses_per_h=3600.0
    )
    rng, states, wrong = np.random.default_rng(1), machine_of(times, FLOAT), 0.0
    fixes = wrongs = 0
    for _ in range(40_000):
        before = states.quality
        is_new = states.step(0.1, heard, tuple(rng.random(3))) == FIX != before
        wrong += 0.1 * states.is_wrong
        fixes, wrongs = fixes + is_new, wrongs + (is_new and states.is_wrong)
    assert fixes > 500
    sd = math.sqrt(share * (1.0 - share) / fixes)
    assert wrongs / fixes == pytest.approx(share, abs=3.5 * sd)
    assert wrong / wrongs == pytest.approx(20.0, rel=3.5 / math.sqrt(wrongs))


def sky(obstacles=(), **params):
    site = setup_of()
    site.bodies.set_things(things_of(obstacles, made_field()))
    receiver = SkyGnss(Params(**params), site)
    receiver.reset(Stream(1, "combine.gnss"))
    return receiver


def test_under_an_open_sky_it_is_the_receiver_of_level_error():
    quiet = {"states": Times(losses_per_h=0.0)}
    plain = ErrorGnss(ErrorParams(), setup_of())
    plain.reset(Stream(1, "combine.gnss"))
    a, b = (feed(r, straight(2.0), 40) for r in (sky(**quiet), plain))
    assert np.allclose(column(a, "x")[1:], column(b, "x")[1:], atol=2e-3)  # hdop a little above 0.8 at most
    assert (column(a, "quality")[1:] == FIX).all()
    assert column(a, "satellites")[-1] >= 12
    assert column(a, "age")[-1] == 0.0


def row(x):
    return tuple(SheetObstacle(kind="tree", x_m=x, y_m=y) for y in range(-30, 34, 4))


def test_between_two_rows_of_trees_the_fix_goes_and_comes_back():
    """Carriers are lost behind leaves, codes are not: from a fix to float or dgps, and a worse dilution."""
    between = column(feed(sky((*row(5.0), *row(-5.0))), straight(0.0), 30), "quality")
    assert between[-1] in (DGPS, FLOAT, FIX)
    open_sky, shaded_sky = (feed(sky(r), straight(0.0), 30)[-1] for r in ((), (*row(5.0), *row(-5.0))))
    assert shaded_sky.satellites < open_sky.satellites - 3
    assert shaded_sky.hdop > 1.3 * open_sky.hdop
    assert shaded_sky.horizontal_sd > 1.3 * open_sky.horizontal_sd


def test_a_wrong_fix_is_off_and_says_it_is_sure():
    sure = Times(wrong_percent=100.0, wrong_s=1e5, fix_min_s=0.0, fix_mean_s=1e-3, losses_per_h=0.0)
    receiver = sky(begin="float", states=sure, wrong_m=0.5)
    last = feed(receiver, straight(0.0), 40)[-1]
    assert receiver.is_wrong
    assert last.quality == FIX
    assert math.hypot(last.x - 1.0, last.y) > 5.0 * last.horizontal_sd


def test_corrections_age_and_the_error_with_them():
    found = feed(sky(silences=(Silence(2.0, 60.0),)), straight(0.0), 400)
    ages, quality = column(found, "age"), column(found, "quality")
    assert ages[100] == pytest.approx(10.1 - 0.05 - 2.0, abs=0.06)
    assert found[250].horizontal_sd == pytest.approx(
        0.0114 * found[1].horizontal_sd / 0.0114 + 0.023, abs=0.003
    )
    assert quality[300] == FIX
    assert quality[335] == DGPS
    with pytest.raises(InputError, match="to_s"):
        Silence(3.0, 2.0)


def test_ppp_converges_and_begins_anew_after_an_outage():
    receiver = sky(receiver="ppp", begin="none", ppp_start_m=0.6, ppp_s=5.0, losses=(Loss(20.0, 22.0),))
    found = feed(receiver, straight(0.0), 260)
    sd = column(found, "horizontal_sd")
    assert sd[15] == pytest.approx(0.04 + 0.56 * math.exp(-1.4 / 5.0), rel=0.1)
    assert sd[190] == pytest.approx(0.041 + 0.56 * math.exp(-19.0 / 5.0), rel=0.1)
    assert found[210].quality == NONE
    assert sd[240] > 0.4


@pytest.mark.parametrize(("second", "baseline"), [(Place(1.0, -1.5, 3.9), 1.5), (Place(-1.0, 0.0, 3.9), 2.0)])
def test_heading_of_two_antennas(second, baseline):
    """sd = s sqrt(2) / B: 3.5 mm on 1.5 m are 0.19 deg."""
    receiver = ErrorGnss(ErrorParams(second_antenna=second, heading_noise_mm=3.5), setup_of())
    receiver.reset(Stream(4, "combine.gnss"))
    found = feed(receiver, circle(2.0, 20.0), 400)[1:]
    true = np.array([2.0 / 20.0 * f.t * 1e-9 for f in found])
    error = np.angle(np.exp(1j * (column(found, "heading") - true)))
    sd = 0.0035 * math.sqrt(2.0) / baseline
    assert column(found, "heading_sd") == pytest.approx(sd)
    assert error.std() == pytest.approx(sd, rel=0.11)
    assert abs(error.mean()) < 4.0 * sd / 20.0
    lost = ErrorGnss(ErrorParams(second_antenna=second, losses=(Loss(0.0, 9.0, "single"),)), setup_of())
    lost.reset(Stream(4, "combine.gnss"))
    assert math.isnan(feed(lost, circle(2.0, 20.0), 5)[-1].heading)
    with pytest.raises(InputError, match="second_antenna"):
        ErrorGnss(ErrorParams(second_antenna=Place(1.1, 0.0, 3.9)), setup_of())


@pytest.mark.parametrize(
    ("second", "angle", "other"),
    [(Place(1.3, -1.2, 3.9), "roll", "pitch"), (Place(-1.0, 0.4, 3.9), "pitch", "roll")],
)
def test_roll_or_pitch_of_two_antennas(second, angle, other):
    """> 0 left side up, nose down; of an oblique baseline the share that lies in that plane."""
    along, across = second.x_m - 1.0, second.y_m
    share = max(abs(along), abs(across)) / math.hypot(along, across)
    receiver = PRESETS["ideal"].component(PRESETS["ideal"].params(second_antenna=second), setup_of())
    for size in (-0.1, 0.0, 0.07):
        receiver.reset(Stream(4, "combine.gnss"))
        fix = feed(receiver, standing(yaw=0.8, **{angle: size}), 1)[0]
        assert getattr(fix, angle) == pytest.approx(share * size, rel=2e-3, abs=1e-12)
        assert math.isnan(getattr(fix, other))
    noisy = ErrorGnss(ErrorParams(second_antenna=second, heading_noise_mm=3.5), setup_of())
    noisy.reset(Stream(5, "combine.gnss"))
    found = column(feed(noisy, straight(1.0), 400)[1:], angle)
    sd = 0.0035 * math.sqrt(2.0) / math.hypot(along, across) * FIGURES["fix"].vertical
    assert found.std() == pytest.approx(sd, rel=0.11)


def test_the_states_of_a_fix_are_saved_with_the_receiver():
    receiver = sky(begin="none")
    feed(receiver, straight(1.0), 25)
    state = receiver.save()
    a = column(feed(receiver, straight(1.0), 40, first=25), "x")
    other = sky(begin="none")
    other.load(state)
    assert np.array_equal(a, column(feed(other, straight(1.0), 40, first=25), "x"), equal_nan=True)
    assert FIX_QUALITIES[FIX] == "fix"
    assert Sky().mask_deg == 10.0
