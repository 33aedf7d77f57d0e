"""Radar against closed forms: cross sections, radar equation, Swerling 1, Doppler, crop, cells."""

from copy import copy
from dataclasses import replace
from functools import cache
from math import cos, log, pi, sin, sqrt

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.field.site_setup import SiteSetup
from swath.field.solid.obstacles import BoxObstacle, Path, PostObstacle, SheetObstacle, things_of
from swath.field.stand import maps, uniform
from swath.field.weather import SiteWeather, Weather
from swath.rays.engine import RayCaster
from swath.sensing.mount import Mount
from swath.sensing.radar import error, ideal
from swath.sensing.radar.cross_section import rod
from swath.sensing.radar.error import Echo, Scatterers, glint, merged
from swath.sensing.radar.radar_sheet import LIGHT, load_radar
from swath.sensing.radar.stand_loss import DB, StandLoss, wave_factor
from tests.changed_sheets import changed_sheet
from tests.field.made_field import made_field
from tests.field.test_solids import MACHINE
from tests.sensing.driven_states import circle, feed, rolling, state, straight
from tests.sensing.swerling import detection_probability

CORNER, FRONT, LOW = (load_radar(f"radar-{n}") for n in ("77ghz-corner", "77ghz-front", "24ghz"))
BARE = maps.Params(stems_per_m2=1)
AT = Mount(at="axle", x_m=0.0, z_m=1.0, pitch_deg=0.0)


@cache
def field_of(stand=BARE):
    return made_field(stand=stand)


def setup_of(obstacles, stand=BARE):
    field = field_of(stand)
    setup = SiteSetup(field, MACHINE, Pose.identity(), "left", 0.05, "combine")
    setup.bodies.set_things(things_of(obstacles, field))
    return setup


def made(module, obstacles, *, stand=BARE, sheet=None, seed=1, **params):
    part = getattr(module, "IdealRadar" if module is ideal else "ErrorRadar")
    sensor = part(module.Params(**{"mount": AT, **params}), setup_of(obstacles, stand))
    if sheet is not None:
        sensor.sheet = replace(sensor.sheet, **sheet)
        if module is error:
            sensor.threshold = -sensor.sheet.false_alarm_lg * log(10.0)
    sensor.reset(Stream(seed, "combine.radar"))
    return sensor


def looks(sensor, count=4, way=None):
    return feed(sensor, way or straight(0.0), count, step=50_000_000)


def test_twelve_db_per_doubling_of_the_distance():
    assert CORNER.snr(0.0, 20.0) - CORNER.snr(0.0, 40.0) == pytest.approx(12.04, abs=0.1)
    echo = made(error, [SheetObstacle(kind="person", x_m=d, y_m=0.0, name=f"{d}") for d in (15.0, 30.0)])
    near, far = (10.0 * np.log10(echo.echo(s, []).snr) for s in seen(echo))
    assert near - far == pytest.approx(12.04, abs=0.35)  # to the front of the body, beam over its height


def seen(sensor):
    return sensor.look(0, {"state": (state(straight(0.0), 0),)})


def test_a_post_far_and_near():
    """2 m high, 15 cm thick, 76.5 GHz: the far-field formula would give 26.8 dBsm."""
    wave = LIGHT / 76.5e9
    assert 10.0 * np.log10(2.0 * pi * 0.075 * 4.0 / wave) == pytest.approx(26.8, abs=0.05)
    for distance, dbsm in ((10.0, 3.7), (20.0, 6.7), (40.0, 9.7)):
        assert 10.0 * np.log10(rod(0.075, 2.0, distance, wave)) == pytest.approx(dbsm, abs=0.05)
        (post,) = seen(made(ideal, [PostObstacle(x_m=distance, y_m=0.0)]))
        assert post.rcs == pytest.approx(dbsm, abs=0.05)
    assert 10.0 * np.log10(rod(0.075, 2.0, 1e5, wave)) == pytest.approx(26.8, abs=0.05)


@pytest.mark.parametrize(
    "thing",
    [
        BoxObstacle(x_m=20.0, y_m=0.0, rcs_dbsm=3.5),
        PostObstacle(x_m=20.0, y_m=0.0, rcs_dbsm=3.5),
        SheetObstacle(kind="person", x_m=20.0, y_m=0.0, rcs_dbsm=3.5),
    ],
)
def test_a_cross_section_of_ones_own(thing):
    """Of any kind of obstacle, in place of the sheet's or of what its shape gives."""
    (target,) = seen(made(ideal, [thing]))
    assert target.rcs == 3.5


def test_swerling_one_by_formula():
    """Pfa 1e-6 and 21.1 dB: 0.9."""
    assert detection_probability(10.0**2.11, 1e-6) == pytest.approx(0.9, abs=0.003)


@pytest.mark.draws
def test_swerling_one():
    """The same by the level's own draws."""
    snr = 10.0**2.11
    sensor = made(error, [], sheet={"false_alarm_lg": -6.0})
    draw, echoes = np.random.default_rng(1), [Echo(20.0, 0.0, 0.0, k, snr) for k in np.arange(50.0)]
    found = sum(len(sensor.rows(echoes, draw)) for _ in range(2000))
    assert found / 1e5 == pytest.approx(0.9, abs=0.003)


@pytest.mark.parametrize("module", [ideal, error])
def test_range_rate_of_a_post_while_driving_and_turning(module):
    """-(v + w x r) . u on a circle of 12 m at 2 m/s, the sensor 3 m ahead and 2 m left of the axle."""
    post = PostObstacle(x_m=9.0, y_m=4.0, height_m=2.0)
    mount = Mount(at="axle", x_m=3.0, y_m=2.0, z_m=1.0, pitch_deg=0.0)
    more = {} if module is ideal else {"noise": "none"}
    sensor = made(module, [post], mount=mount, sheet={"latency": 0.0}, **more)
    last = looks(sensor, 10, circle(2.0, 12.0))[-1]
    pose, rate = circle(2.0, 12.0)(0.5), 2.0 / 12.0
    yaw = pose.euler()[2]
    arm = pose.turn([3.0, 2.0, 0.0])
    velocity = np.array([2.0 * cos(yaw) - rate * arm[1], 2.0 * sin(yaw) + rate * arm[0]])
    way = np.array([9.0, 4.0]) - (pose.position + arm)[:2]
    assert last.radial_speed[0] == pytest.approx(-velocity @ way / np.hypot(*way), abs=1e-3)
    assert last.range[0] == pytest.approx(np.hypot(*way) - 0.075, abs=0.011)  # its box is square
    assert last.azimuth[0] == pytest.approx(np.arctan2(way[1], way[0]) - yaw, abs=1e-3)


def test_range_rate_while_rolling():
    """A sensor 3 m up goes to and fro as the machine rolls, seen from the side."""
    mount = Mount(at="axle", z_m=3.0, pitch_deg=0.0, yaw_deg=90.0)
    sensor = made(ideal, [PostObstacle(x_m=0.0, y_m=15.0, height_m=4.0)], mount=mount)
    last = looks(sensor, 10, rolling(0.02, 0.5))[-1]
    rate = 0.02 * pi * cos(2.0 * pi * 0.5 * 0.5)  # of the roll at 0.5 s
    assert last.radial_speed[0] == pytest.approx(rate * 3.0, abs=2e-3)


def test_a_thing_that_goes_has_its_own_speed():
    person = SheetObstacle(kind="person", x_m=20.0, y_m=0.0, path=Path(to=((0.0, 0.0),)))
    sensor = made(ideal, [person])
    sensor.setup.bodies.place("person 1", Pose.from_euler([20.0, 0.0, 0.0], yaw=pi), np.array([-1.4, 0, 0]))
    assert looks(sensor, 4, straight(2.0))[-1].radial_speed[0] == pytest.approx(-3.4, abs=1e-3)


@pytest.mark.parametrize(
    ("height", "stems", "lean"), [(0.2, 400, 5), (0.5, 200, 20), (0.5, 600, 0), (0.8, 400, 5)]
)
def test_geometric_extinction_of_the_plants_against_rays(height, stems, lean):
    field = field_of(uniform.Params(stems_per_m2=stems, lean_deg=lean))
    field.ensure(10.0, 5.0, 20.0)
    rng, count = np.random.default_rng(2), 60_000
    start = np.column_stack([rng.uniform(4, 18, count), rng.uniform(2, 8, count), np.full(count, height)])
    turn = rng.uniform(0.0, 2.0 * pi, count)
    way = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
    free = ~RayCaster(field).cast(start, way, range_max=0.2).is_hit
    found = StandLoss(field).depth(np.array([5.0, 5.0, height]), np.array([[9.0, 7.0, height]]))[0]
    assert found / sqrt(20.0) == pytest.approx(-log(free.mean()) / 0.2, rel=0.12)


@pytest.mark.parametrize("deep", [0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("name", ["radar-77ghz-corner", "radar-24ghz"])
def test_a_reflector_behind_crop(deep, name):
    """-2 k d: the crop begins at x = 0; k of that height from the profile, two way."""
    sensor = made(error, [], stand=uniform.Params(), sensor=name)
    z = 0.5
    depth = sensor.stand.depth(np.array([-6.0, 5.0, z]), np.array([[deep, 5.0, z]]))[0]
    k = np.interp(z, sensor.stand.heights, sensor.stand.profile) * sensor.wave * DB
    assert 2.0 * DB * sensor.wave * depth == pytest.approx(2.0 * k * deep, abs=0.2)


def test_density_and_lodging_act_on_the_loss():
    eye, end = np.array([2.0, 5.0, 0.3]), np.array([[4.0, 5.0, 0.3]])
    stands = uniform.Params(), uniform.Params(stems_per_m2=250)
    whole, half = (StandLoss(field_of(s)).depth(eye, end)[0] for s in stands)
    assert half / whole == pytest.approx(0.5, abs=0.06)  # other plants, drawn anew
    lean = uniform.Params(lean_deg=60.0, lean_azimuth_deg=0.0)  # northward, across the way
    lain = StandLoss(field_of(lean))
    assert lain.depth(eye, end)[0] > 1.3 * whole
    up = np.array([0.0, 0.0, 0.4])
    assert lain.depth(eye + up, end + up)[0] < 0.5 * whole


def test_the_factor_of_straw_is_the_table():
    """Back to dB/m of 500 stems: middle of thin and thick walls at 12 % water, vertical, 76.5 GHz."""
    assert wave_factor(76.5e9, "V", 0.12) * 1.75 * DB == pytest.approx(sqrt(7.9 * 13.3), rel=1e-3)
    assert wave_factor(24.1e9, "H", 0.08, wall=0.0) * 1.75 * DB == pytest.approx(0.4, rel=1e-3)


def test_a_low_body_three_metres_inside_ripe_wheat():
    """Two way through 3 m: 77 GHz vertical loses it, 24 GHz horizontal hardly."""
    deer = [SheetObstacle(kind="animal", x_m=3.0, y_m=5.0, height_m=0.6)]
    at = Mount(at="axle", x_m=-3.0, y_m=5.0, z_m=0.6, pitch_deg=0.0)
    chance = {}
    for name in ("radar-77ghz-corner", "radar-24ghz"):
        sensor = made(error, deer, stand=uniform.Params(), sensor=name, mount=at)
        (echo,) = [sensor.echo(s, []) for s in seen(sensor)]
        chance[name] = float(detection_probability(echo.snr, 10.0**sensor.sheet.false_alarm_lg))
    assert chance["radar-77ghz-corner"] < 0.05
    assert chance["radar-24ghz"] > 0.95


@pytest.mark.parametrize(("apart", "count"), [(0.3, 1), (0.5, 2)])
def test_posts_nearer_and_farther_than_a_cell(apart, count):
    """One behind the other, a hand aside so that none hides the other; the cell is 0.39 m long."""
    posts = [PostObstacle(x_m=12.0 + k * apart, y_m=0.2 * k, diameter_m=0.05) for k in range(2)]
    found = looks(made(error, posts, noise="none"))[-1]
    assert len(found.range) == count


def test_powers_in_a_cell_add():
    one, two = Echo(10.0, 0.0, 0.0, 0.0, 30.0), Echo(10.3, 0.02, 0.0, 0.0, 10.0)
    (both,) = merged([two, one], (0.39, 0.05, 0.1))
    assert (both.snr, both.distance, both.azimuth) == pytest.approx((40.0, 10.075, 0.005))
    assert len(merged([two, replace(one, radial_speed=0.2)], (0.39, 0.05, 0.1))) == 2


def test_spread_of_a_strong_echo():
    """cell / sqrt(2 SNR) + floor; the echo itself does not fluctuate here."""
    sensor, draw = made(error, []), np.random.default_rng(4)
    snr, s = 10.0**3.0, CORNER
    rows = [
        sensor.row(Echo(30.0, 0.1, 0.0, -1.0, snr), 1.0 + snr, 1.0, draw.standard_normal(6).tolist())
        for _ in range(4000)
    ]
    found = np.std([row[:4] for row in rows], axis=0)
    share = 1.0 / sqrt(2.0 * snr)
    wanted = (
        s.range_resolution * share + s.range_floor,
        s.azimuth_resolution * share + s.azimuth_floor,
        s.speed_resolution * share + s.speed_floor,
    )
    assert (found[0], found[1], found[3]) == pytest.approx(wanted, rel=0.04)
    assert np.isnan(rows[0][2])  # no elevation from this radar


@pytest.mark.parametrize("heading_deg", [0.0, 35.0, 90.0, 160.0])
def test_scatterers_of_a_box_lie_on_its_facing_sides(heading_deg):
    """Mean and spread along the view and across it, of sides that weigh as wide as they look."""
    thing = BoxObstacle(
        x_m=20.0, y_m=4.0, length_m=4.6, width_m=1.8, height_m=1.5, heading_deg=heading_deg, name="van"
    )
    (body,) = setup_of([thing]).bodies.around("combine")
    eye = np.array([0.0, 0.0, 1.0])
    rng, half = np.random.default_rng(3), body.half
    own = body.pose.inverse().apply(eye) - body.middle
    points, weights = [], []
    for axis in (0, 1):
        side = rng.uniform(-1.0, 1.0, (20_000, 3)) * half
        side[:, axis] = np.sign(own[axis]) * half[axis]
        points.append(side)
        weights.append(np.full(len(side), abs(own[axis]) * half[1 - axis]))  # as wide as it looks
    away = -own[:2] / np.hypot(*own[:2])
    places, share = np.concatenate(points)[:, :2], np.concatenate(weights)
    along, across = places @ away, places @ np.array([-away[1], away[0]])
    mean = [np.average(v, weights=share) for v in (along, across)]
    spread = [
        np.sqrt(np.average((v - m) ** 2, weights=share)) for v, m in zip((along, across), mean, strict=True)
    ]
    points = (body.pose.inverse().apply(Scatterers().of(body, eye)) - body.middle)[:, :2]
    along, across = points @ away, points @ np.array([-away[1], away[0]])
    assert (along.mean(), across.mean()) == pytest.approx(mean, abs=0.06)
    assert (along.std(), across.std()) == pytest.approx(spread, abs=0.06)


@pytest.mark.parametrize("share", [1.0, 2.0, 5.0])
def test_glint_is_that_of_echoes_with_random_phases(share):
    """The apparent place of 20 scatterers on a line, in those of 200,000 looks that have about a power."""
    rng, places = np.random.default_rng(1), np.linspace(-1.0, 1.0, 20)
    echo = rng.standard_normal((200_000, 20, 2), dtype=np.float32)
    whole, moment = echo.sum(axis=1), np.einsum("ijk,j->ik", echo, places.astype(np.float32))
    power = (whole**2).sum(axis=1)
    kept = np.abs(power / power.mean() / share - 1.0) < 0.05
    apparent = (whole * moment).sum(axis=1)[kept] / power[kept]
    assert apparent.std() == pytest.approx(places.std() * glint(1.0, share), rel=0.05)


def test_false_alarms_are_as_many_as_cells_times_chance():
    sensor = made(error, [], sheet={"latency": 0.0})
    mean = CORNER.cells * 1e-7
    counts = [len(s.range) for s in looks(sensor, 600)]
    assert np.mean(counts) == pytest.approx(mean, abs=4.0 * sqrt(mean / 600))
    assert np.var(counts) == pytest.approx(mean, rel=0.35)


def test_rain_and_a_wall_take_from_an_echo():
    person = SheetObstacle(kind="person", x_m=30.0, y_m=0.0)
    dry, wet = (made(error, [person], rain_mm_h=r) for r in (0.0, 25.0))
    loss = [10.0 * np.log10(s.echo(seen(s)[0], []).snr) for s in (dry, wet)]
    assert loss[0] - loss[1] == pytest.approx(2.0 * 0.011 * 29.85, rel=0.03)  # 11 dB/km at 77 GHz
    wall = BoxObstacle(x_m=15.0, y_m=0.0, length_m=0.2, width_m=4.0, height_m=3.0)
    found = looks(made(error, [person, wall], noise="none"))[-1]
    assert found.range.tolist() == pytest.approx([14.9], abs=0.02)
    assert len(looks(made(ideal, [person, wall]))[-1].range) == 2


def test_rain_that_begins_takes_from_an_echo_by_the_hour(tmp_path):
    file = tmp_path / "day.csv"
    file.write_text("hour,rain_mm_h\n12,0\n13,25\n")
    setup = setup_of([SheetObstacle(kind="person", x_m=30.0, y_m=0.0)])
    weather = SiteWeather(Weather(time="2026-07-25T12:00:00+02:00", file=str(file)))
    field = copy(setup.field)
    field.weather = weather
    sensor = error.ErrorRadar(error.Params(mount=AT), replace(setup, field=field))
    sensor.reset(Stream(1, "combine.radar"))
    snr = [
        10.0 * np.log10(sensor.echo(sensor.look(t, {"state": (state(straight(0.0), t),)})[0], []).snr)
        for t in (0, 1800 * NS, 3600 * NS)
    ]
    sheet = np.array([0.0, 12.5, 25.0])
    k, a = error.RAIN["high"]
    assert snr[0] - np.array(snr) == pytest.approx(2.0 * 29.85 * k * sheet**a / 1000.0, rel=0.02, abs=1e-9)


def test_field_of_view_and_latency():
    things = [PostObstacle(x_m=10.0 * cos(a), y_m=10.0 * sin(a)) for a in (0.0, 0.7, 0.9, pi)]
    found = looks(made(ideal, things))[-1]
    assert sorted(found.azimuth) == pytest.approx([0.0, 0.7], abs=0.01)
    late = looks(made(error, things, noise="none", sheet={"latency": 0.1}), 4)
    assert [s.t for s in late] == [0, 0, 50_000_000, 100_000_000]


def test_saved_and_loaded_in_the_middle():
    things = [SheetObstacle(kind="person", x_m=25.0, y_m=2.0)]
    whole = looks(made(error, things), 8, straight(1.0))
    part, other = made(error, things), made(error, things)
    feed(part, straight(1.0), 4, step=50_000_000)
    other.load(part.save())
    rest = feed(other, straight(1.0), 4, step=50_000_000, first=4)
    for a, b in zip(whole[4:], rest, strict=True):
        assert a.t == b.t
        assert (a.range.tobytes(), a.rcs.tobytes()) == (b.range.tobytes(), b.rcs.tobytes())


def test_a_cell_wider_than_the_field_of_view(tmp_path):
    path = changed_sheet(tmp_path, "sensors", "radar-24ghz", "azimuth_fov_deg", {"value": 2.0})
    with pytest.raises(InputError, match=r"azimuth_fov_deg = 2\.0: expected at least azimuth_resolution_deg"):
        load_radar(str(path))
