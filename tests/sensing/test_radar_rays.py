"""Radar level `rays` against closed forms (CFAR, clutter, cells, solids) and against `error`."""

from math import log10, pi, sqrt

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.field.solid.obstacles import PostObstacle, SheetObstacle
from swath.field.solid.solids import box_on_ground, mesh, post, stone
from swath.field.stand import uniform
from swath.sensing.mount import Mount
from swath.sensing.radar import error, rays
from swath.sensing.radar.detector import (
    Columns,
    Grid,
    ca_detection,
    ca_factor,
    os_factor,
    peaks,
    thresholds,
    window,
)
from swath.sensing.radar.error import merged
from swath.sensing.radar.rays import Clutter
from swath.sensing.radar.solid_rays import distances, facing
from swath.sensing.radar.stand_loss import BIN, DB, StandLoss
from tests.sensing.driven_states import circle, feed, state, straight
from tests.sensing.swerling import detection_probability
from tests.sensing.test_radar import AT, BARE, CORNER, field_of, looks, made, seen, setup_of

NO_CLUTTER = {"crop_reflectivity_db": -60.0, "ground_reflectivity_db": -60.0}


def rays_of(obstacles, *, stand=BARE, seed=1, **params):
    sensor = rays.RaysRadar(rays.Params(**{"mount": AT, **params}), setup_of(obstacles, stand))
    sensor.reset(Stream(seed, "combine.radar"))
    return sensor


@pytest.mark.parametrize(("decibel", "chance"), [(10.0, 0.335), (15.0, 0.686), (20.0, 0.884)])
def test_cell_averaging_over_16_cells(decibel, chance):
    """alpha = 12.45 at Pfa 1e-4; Pd by formula, and by draws through the level's own thresholds."""
    assert ca_factor(16, 1e-4) == pytest.approx(12.45, abs=0.005)
    snr, count = 10.0 ** (decibel / 10.0), 40_000
    assert ca_detection(snr, 16, 1e-4) == pytest.approx(chance, abs=0.0006)
    draw = np.random.default_rng(3)
    training, cell = draw.standard_exponential((count, 16)), (1.0 + snr) * draw.standard_exponential(count)
    found = float(np.mean(cell > thresholds(training, 1e-4, "ca")))
    assert found == pytest.approx(chance, abs=3.0 * sqrt(chance * (1.0 - chance) / count))


def test_ordered_statistics_keep_the_false_alarms():
    """Pfa of 1e-2 by draws; one strong neighbour among the training cells hardly moves the threshold."""
    draw = np.random.default_rng(4)
    training, cell = draw.standard_exponential((200_000, 16)), draw.standard_exponential(200_000)
    found = float(np.mean(cell > thresholds(training, 1e-2, "os")))
    assert found == pytest.approx(1e-2, abs=3.0 * sqrt(1e-2 / 200_000))
    assert os_factor(16, 1e-2) > 1.0
    with_one = training.copy()
    with_one[:, 0] = 1000.0
    ca, other = (
        np.median(thresholds(with_one, 1e-4, k) / thresholds(training, 1e-4, k)) for k in ("ca", "os")
    )
    assert ca > 30.0
    assert other < 1.3


def test_window():
    """Hann's main lobe as 1 at its place, -6 dB after one bin of the transform, nothing outside."""
    assert window(np.array([0.0, 1.0 / 1.44, 1.5])) == pytest.approx([1.0, 0.5, 0.0], abs=1e-5)
    assert window(np.array([0.5]))[0] ** 2 == pytest.approx(0.5, abs=0.01)  # cells: half power to half power


@pytest.mark.parametrize("wave", [0.2, 1.2])
def test_clutter_of_a_flat_stand(wave):
    """Water cloud: g sin(psi) (1 - exp(-2 k h / sin(psi))) + gamma sin(psi) exp(...), 5 to 60 deg, 0.5 dB."""
    field = field_of(uniform.Params(lean_deg=0.0))
    stand, crop, ground, high = StandLoss(field), 10.0**-1.15, 10.0**-0.5, 10.0
    stand.profile = np.full(42, 2.0)
    ranges = np.arange(10.5, high / np.sin(np.radians(5.0)), 0.39)
    field.ensure(5.0, 5.0, ranges[-1] + 5.0)
    clutter = Clutter(field, stand, wave=wave, crop=crop, ground=ground)
    eye = np.array([5.0, 5.0, high])
    found = clutter.echoes(eye, np.eye(3), np.array([-0.02, 0.0, 0.02]), ranges).area[1] / ranges
    psi = np.arcsin(high / ranges)
    scale, lean_x, lean_y, density = stand.tiles(np.array([20.0]), np.array([5.0]))[:, 0]
    ux, uy = stand.turned(np.array([[1.0, 0.0]]))
    along = (lean_x * ux[0] + lean_y * uy[0]) / scale * np.cos(psi) - np.sin(psi)
    k = wave * 2.0 * density * np.sqrt(1.0 + (lean_x**2 + lean_y**2) / scale**2 - along**2)
    left = np.exp(-2.0 * k * 42 * BIN * scale / np.sin(psi))
    wanted = (crop * (1.0 - left) + ground * left) * np.sin(psi)
    seen_at = (psi > np.radians(5.0)) & (psi < np.radians(60.0))
    assert np.abs(10.0 * np.log10(found / wanted))[seen_at].max() < 0.5


@pytest.mark.parametrize("deep", [0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("name", ["radar-77ghz-corner", "radar-24ghz"])
def test_a_reflector_behind_crop(deep, name):
    """-2 k d; the crop begins at x = 0."""
    sensor = rays_of([], stand=uniform.Params(), sensor=name)
    z = 0.5
    lost = sensor.through(np.array([-6.0, 5.0, z]), np.array([[deep, 5.0, z]]))[0]
    k = np.interp(z, sensor.stand.heights, sensor.stand.profile) * sensor.wave * DB
    assert lost == pytest.approx(2.0 * k * deep, abs=0.2)


def test_range_rate_while_driving_and_turning():
    """-(v + w x r) . u within 1 mm/s, of the echo; the sensor 3 m ahead and 2 m left of the axle."""
    mount = Mount(at="axle", x_m=3.0, y_m=2.0, z_m=0.1, pitch_deg=0.0)
    sensor = rays_of([PostObstacle(x_m=9.0, y_m=4.0, height_m=0.2, diameter_m=0.02)], mount=mount)
    way = circle(2.0, 12.0)
    states = tuple(state(way, t) for t in range(0, 500_000_001, 5_000_000))
    echo = sensor.parts(*sensor.locate(500_000_000, {"state": states}))
    pose, rate = way(0.5), 2.0 / 12.0
    yaw, arm = pose.euler()[2], pose.turn([3.0, 2.0, 0.0])
    velocity = np.array([2.0 * np.cos(yaw) - rate * arm[1], 2.0 * np.sin(yaw) + rate * arm[0]])
    u = np.array([9.0, 4.0]) - (pose.position + arm)[:2]
    assert echo.speed == pytest.approx(-velocity @ u / np.hypot(*u), abs=1e-3)


def test_clutter_of_a_turning_machine_has_its_own_speeds():
    """The ground comes nearer with v . u in every direction, whatever the machine turns."""
    mount = Mount(at="axle", x_m=3.0, y_m=2.0, z_m=1.0, pitch_deg=0.0)
    sensor, way = rays_of([], mount=mount), circle(2.0, 12.0)
    states = tuple(state(way, t) for t in range(0, 500_000_001, 5_000_000))
    eye, rotation, velocity = sensor.locate(500_000_000, {"state": states})
    sensor.setup.field.ensure(0.0, 0.0, 80.0)
    _, speed, spread = sensor.clutter(eye, rotation, velocity)
    yaw = way(0.5).euler()[2]
    for a in (0, 14, 27):
        u = np.array([np.cos(yaw + sensor.grid.azimuths[2 * a]), np.sin(yaw + sensor.grid.azimuths[2 * a])])
        assert speed[a, 100] == pytest.approx(-velocity[:2] @ u, abs=2e-3)
        across = abs(velocity[:2] @ [-u[1], u[0]])  # speed that an angle adds
        assert spread[a, 100] == pytest.approx(across * CORNER.azimuth_resolution / sqrt(12.0), abs=3e-3)


@pytest.mark.parametrize(("apart", "count"), [(0.3, 1), (0.55, 2)])
def test_posts_nearer_and_farther_than_a_cell(apart, count):
    """As in the test of `error`; echoes swing, so the most frequent number of 14 looks."""
    posts = [PostObstacle(x_m=12.0 + k * apart, y_m=0.2 * k, diameter_m=0.05) for k in range(2)]
    found = [len(s.range[abs(s.range - 12.0) < 2.0]) for s in looks(rays_of(posts, **NO_CLUTTER), 16)[2:]]
    assert np.bincount(found).argmax() == count
    quiet = looks(rays_of(posts, noise="none", **NO_CLUTTER))[-1]
    assert len(quiet.range) == count


def test_false_alarms_of_an_empty_field():
    """As many as cells times their probability where nothing throws back."""
    sensor = rays_of([], sensor="radar-24ghz", **NO_CLUTTER)
    mean = 10.0**sensor.sheet.false_alarm_lg * sensor.sheet.cells
    assert sum(len(s.range) for s in looks(sensor, 100)) == pytest.approx(
        100 * mean, abs=4.0 * sqrt(100 * mean)
    )


def test_noise_in_columns_is_detected_as_seldom():
    """The detector's own false alarms in drawn noise: bins times their probability, less neighbours."""
    draw, count = np.random.default_rng(5), 0
    for _ in range(25):
        power = draw.standard_exponential((400, 400))
        index = np.arange(400)[:, None].repeat(1, axis=1)  # 400 azimuths far apart in speed
        columns = Columns(power, np.arange(400), np.zeros(400, dtype=np.int64), index)
        grid = Grid(1000.0 + np.arange(400.0), np.arange(400.0), np.zeros(1), (2.0, 2.0, 2.0))
        count += len(peaks(columns, grid, 16, 1e-4, "ca"))
    assert count == pytest.approx(25 * 400 * 400 * 1e-4, rel=0.2)


def beside_each_other(things, sheet, count=500):
    """Of level rays, without clutter, and error for each target: (target, mean SNR, rows, rows)."""
    sensor, other = rays_of(things, sensor=sheet, **NO_CLUTTER), made(error, things, sensor=sheet)
    targets = seen(other)
    here = sensor.locate(100, {"state": (state(straight(0.0), 100),)})
    sensor.setup.field.ensure(0.0, 0.0, 75.0)
    parts, clutter = sensor.parts(*here), sensor.clutter(*here)
    echoes = merged([e for t in targets for e in other.echoes(t, targets)], other.cell)
    found = [(t, other.echo(t, targets).snr, [], []) for t in targets]
    for k in range(count):
        draw = sensor._stream.at(k)
        columns = sensor.columns(parts, *clutter, draw)
        ours = [sensor.measured(*p, draw) for p in peaks(columns, sensor.grid, 16, sensor.false_alarm, "ca")]
        theirs = sorted(other.rows(echoes, draw), key=lambda row: -row[5])  # as a sample has them
        for target, _, *kept in found:
            for rows, into in zip((ours, theirs), kept, strict=True):
                into += [r for r in rows if abs(r[0] - target.distance) < 0.8][:1]
    return found


def test_error_against_rays():
    """Four targets from 10 to 58 m without clutter: Pd within 0.05, ratio of the spreads 0.8 to 1.25."""
    things = [
        PostObstacle(x_m=10.3, y_m=-0.7, diameter_m=0.02),
        PostObstacle(x_m=24.0, y_m=-3.1, diameter_m=0.02),
        SheetObstacle(kind="person", x_m=40.1, y_m=3.3, name="c"),
        SheetObstacle(kind="person", x_m=57.6, y_m=-6.5, name="d"),
    ]
    for _, snr, ours, theirs in beside_each_other(things, "radar-77ghz-corner"):
        a, b = (np.array(rows)[:, [0, 1, 3]] for rows in (ours, theirs))
        chance = float(detection_probability(snr, 10.0**CORNER.false_alarm_lg))
        assert len(a) / 500 == pytest.approx(chance, abs=0.05)
        ratio = a.std(axis=0) / b.std(axis=0)
        assert (ratio > 0.8).all()
        assert (ratio < 1.25).all()


def test_a_thing_wider_than_a_cell_wanders_as_with_rays():
    """Persons of half a metre at 10 and 22 m; the front radar's cell is 0.28 and 0.6 m wide there."""
    things = [
        SheetObstacle(kind="person", x_m=10.3, y_m=-0.7, name="a"),
        SheetObstacle(kind="person", x_m=22.0, y_m=2.1, name="b"),
    ]
    for _, _, ours, theirs in beside_each_other(things, "radar-77ghz-front"):
        a, b = (np.array(rows)[:, [0, 1]] for rows in (ours, theirs))
        assert len(a) / len(b) == pytest.approx(1.0, abs=0.05)
        assert a.std(axis=0) / b.std(axis=0) == pytest.approx(1.0, abs=0.22)


def test_a_thing_longer_than_cells_as_with_rays():
    """Several detections, and a threshold that its own echoes raise: the vehicle seen aslant at 25 m is found
    in 0.29 of the looks of the 24 GHz radar, where its power alone would make it 1.00."""
    things = [
        SheetObstacle(kind="vehicle", x_m=25.0, y_m=2.0, heading_deg=40.0, name="a"),
        SheetObstacle(kind="animal", x_m=42.0, y_m=3.0, heading_deg=110.0, name="b"),
    ]
    for thing in things:
        ((_, _, ours, theirs),) = beside_each_other([thing], "radar-24ghz", 300)
        assert len(theirs) / 300 == pytest.approx(len(ours) / 300, abs=0.12)


def test_what_stands_some_cells_behind_raises_the_threshold():
    """A wall of 20 dBsm 4 cells behind a person, in the training bins; one 9 cells behind is not in them."""
    person = error.Echo(20.0, 0.0, 0.0, 0.0, 200.0)
    sensor, draw = made(error, []), np.random.default_rng(1)
    found = {}
    for cells in (4.0, 9.0):
        wall = error.Echo(20.0 + cells * CORNER.range_resolution, 0.0, 0.0, 0.0, 20_000.0)
        rows = [sensor.rows([person, wall], draw) for _ in range(400)]
        found[cells] = np.mean([any(r[0] < 20.7 for r in look) for look in rows])
    assert found[9.0] == pytest.approx(float(detection_probability(200.0, 1e-7)), abs=0.05)
    assert found[4.0] < 0.3


def test_a_low_body_in_the_crop():
    """77 GHz vertical loses it in the crop's loss, 24 GHz horizontal in the crop's own echo alone."""
    deer = [SheetObstacle(kind="animal", x_m=3.0, y_m=5.0, height_m=0.6)]
    at = Mount(at="axle", x_m=-3.0, y_m=5.0, z_m=0.6, pitch_deg=0.0)

    def chance(things, name, **params):
        sensor = rays_of(things, stand=uniform.Params(), sensor=name, mount=at, **params)
        samples = looks(sensor, 22)[2:]
        return np.mean([((abs(s.range - 5.6) < 0.6) & (abs(s.azimuth) < 0.1)).any() for s in samples])

    assert chance(deer, "radar-77ghz-corner", **NO_CLUTTER) < 0.05
    assert chance(deer, "radar-24ghz", **NO_CLUTTER) > 0.8
    assert chance(deer, "radar-24ghz") < 0.5
    assert chance([], "radar-24ghz") < 0.2


def test_rays_on_solids():
    """Distances to a box, a ball, a post and a mesh by hand."""
    eye, ahead = np.array([0.0, 0.0, 1.0]), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert distances(box_on_ground([5.0, 0.0, 0.0], [2.0, 2.0, 2.0]), eye, ahead) == pytest.approx(
        [4.0, np.inf]
    )
    assert distances(stone([5.0, 0.0, 1.0], [2.0, 1.0, 1.0]), eye, ahead) == pytest.approx([4.0, np.inf])
    assert distances(post([5.0, 0.05, 0.0], 2.0, 0.2), eye, ahead)[0] == pytest.approx(
        5.0 - sqrt(0.01 - 0.0025)
    )
    over = np.array([[3.0, 0.0, -0.2]]) / sqrt(9.04)  # onto the round top of a post of 0.9 m
    assert np.isfinite(distances(post([3.0, 0.0, 0.0], 0.9, 0.3), eye, over)[0])
    wall = np.array([[[4.0, -1.0, 0.0], [4.0, 1.0, 0.0], [4.0, 0.0, 3.0]]])
    assert distances(mesh(wall, Pose.identity()), eye, ahead) == pytest.approx([4.0, np.inf], abs=1e-6)


def test_what_stands_behind_a_wall_is_hidden():
    person = SheetObstacle(kind="person", x_m=20.0, y_m=0.0)
    half = PostObstacle(x_m=10.0, y_m=0.07, diameter_m=0.2, height_m=3.0)
    setup = setup_of([person, half])
    sides = {
        side.body.kind: side for side in facing(setup.bodies.around("combine"), np.array([0, 0, 1.0]), 60.0)
    }
    free = len(sides["person"].points) * sides["person"].share
    assert 0.1 < free < 0.75  # a post of 20 cm at half the way covers 40 of 56 cm, aside
    assert len(sides["post"].points) * sides["post"].share == pytest.approx(1.0)


def test_cross_section_of_a_strong_echo():
    """A post at 12 m, on average over its swings: pi a R within 2 dB, 1.6 m seen from 1 m."""
    thing = PostObstacle(x_m=12.0, y_m=0.0, diameter_m=0.1, height_m=1.6)
    found = looks(rays_of([thing], sensor="radar-24ghz", **NO_CLUTTER), 80)
    rcs = [10.0 ** (s.rcs[np.abs(s.range - 12.0) < 1.0].max(initial=-60.0) / 10.0) for s in found[2:]]
    assert 10.0 * log10(float(np.mean(rcs))) == pytest.approx(10.0 * log10(pi * 0.05 * 11.95), abs=2.0)


def test_saved_and_loaded_in_the_middle():
    things = [SheetObstacle(kind="person", x_m=25.0, y_m=2.0)]
    whole = looks(rays_of(things), 6, straight(1.0))
    part, other = rays_of(things), rays_of(things)
    feed(part, straight(1.0), 3, step=50_000_000)
    other.load(part.save())
    rest = feed(other, straight(1.0), 3, step=50_000_000, first=3)
    assert [s.range.tobytes() for s in whole[3:]] == [s.range.tobytes() for s in rest]
