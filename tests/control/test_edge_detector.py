"""`otsu` against a closed-form canopy with a known edge: accuracy, availability, false alarms, mirror."""

from dataclasses import replace

import numpy as np
import pytest

from swath.control.edge.otsu import Otsu, Params
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.signals import Odometry
from tests.control.closed_loop import Course, setup_of
from tests.control.edge_drive import EdgeSensor, drive, errors
from tests.control.synthetic_edge import Scanner, Stand, hazard_table, mounting

DEG = np.pi / 180


def test_the_canopy_follows_the_closed_form_of_first_returns():
    z = np.linspace(0.0, 1.5, 1501)
    optical = np.cumsum(hazard_table(200.0, 0.85, 0.08, 0.0, z)[::-1]) * 0.001 / np.tan(15 * DEG)
    survival = np.exp(-optical)[::-1]
    heights = np.interp(np.random.default_rng(0).uniform(survival[0], 1, 4000), survival, z)
    assert survival[0] == pytest.approx(0.06, abs=0.015)  # ground share, 200 stems/m2 at 15 deg, thin ray
    assert heights.mean() == pytest.approx(0.69, abs=0.02)
    assert heights.std() == pytest.approx(0.21, abs=0.02)


@pytest.mark.parametrize("side", ["left", "right"])
def test_straight_edge_in_normal_crop(side):
    sign = 1 if side == "left" else -1
    share, rmse, bias, heading = errors(drive(side=side, scans=200, roll_sd=1 * DEG))
    assert share == 1.0
    assert rmse < 0.03
    assert abs(bias * sign) < 0.02
    assert heading < 0.7 * DEG


def test_thin_crop_costs_confidence_before_it_costs_accuracy():
    drives = [drive(stand={"density": d}, scans=200) for d in (500.0, 200.0, 150.0, 100.0)]
    for rows in drives[:3]:
        share, rmse = errors(rows)[:2]
        assert share > 0.95
        assert rmse < 0.03
    confidence = [rows[rows[:, 0] > 1.0, 5].mean() for rows in drives]
    assert confidence == sorted(confidence, reverse=True)
    assert confidence[2] < 0.85
    assert confidence[3] < 0.4  # half of the rays go on: one threshold shows the edge 12 cm off
    assert errors(drives[3])[1] < 0.14


def test_low_crop_needs_the_height_step_it_was_promised():
    assert errors(drive(stand={"tip": 0.55}))[0] > 0.95  # 0.40 m above the stubble
    assert errors(drive(stand={"tip": 0.30}))[0] == 0.0  # 0.15 m, below min_step_m


@pytest.mark.parametrize("spot", [0.05, 0.10])
def test_a_nearest_echo_spot_shifts_the_edge_and_known_beam_data_shift_it_back(spot):
    plain = errors(drive(stand={"spot": spot}, params={"learn_m": 0.0}))[2]
    corrected = errors(drive(stand={"spot": spot}, params={"spot_mm": 1e3 * spot, "learn_m": 0.0}))[2]
    assert corrected == pytest.approx(plain - 0.5 * spot, abs=0.002)
    assert 0.3 * spot < plain < 1.2 * spot
    assert 0.01 < corrected < 0.035  # rays of a spot meet 30 stems per metre: their end lies outside the edge


def test_a_canopy_offset_that_is_given_is_half_the_lean_times_the_crop_height():
    upright, leaning = (drive(params={"lean_deg": lean, "learn_m": 0.0}) for lean in (0.0, 10.0))
    shift = upright[-1, 2] - leaning[-1, 2]  # the crop is to the right: a correction towards it lowers y
    assert shift == pytest.approx(0.5 * np.tan(10 * DEG) * leaning[-1, 6], abs=1e-3)


@pytest.mark.parametrize("radius", [40.0, -40.0])
@pytest.mark.parametrize("side", ["left", "right"])
def test_bends(radius, side):
    sign = 1 if side == "left" else -1
    rows = drive(Course(radius, 15.0, y=6.0 * sign), side=side, scans=200, roll_sd=0.5 * DEG)
    share, rmse, _, heading = errors(rows)
    assert share > 0.98
    assert rmse < 0.04
    assert heading < 1.0 * DEG
    assert np.abs(rows[-25:, 4]).mean() < 0.01


@pytest.mark.parametrize("heading", [-10, -5, 5, 10])
def test_heading_errors_are_found_within_three_seconds(heading):
    rows = drive(Course(y=6.0), heading=heading * DEG, speed=2.0, scans=75)
    assert abs(rows[-1, 2]) < 0.04
    assert abs(rows[-1, 3]) < 1.2 * DEG


def test_a_rolled_machine_sees_the_same_edge():
    assert errors(drive(tilt=2 * DEG))[1] < 0.03
    assert errors(drive(tilt=-2 * DEG))[1] < 0.03


@pytest.mark.parametrize(("tip", "where"), [(0.15, 6.0), (0.85, 100.0), (0.85, -100.0)])
@pytest.mark.parametrize("density", [200.0, 500.0])
def test_no_edge_in_stubble_or_in_crop_alone(tip, where, density):
    sense = EdgeSensor(Course(y=where), stand={"tip": tip, "density": density}, roll_sd=1 * DEG)
    found = [sense(sense.period * (i + 1), (0.08 * i, 0.1, 0.0), 2.0, 0.0).is_found for i in range(150)]
    assert not any(found)


def test_a_short_gap_is_bridged():
    rows = drive(scans=250, stand={"gaps": ((18.0, 18.6),)})
    assert errors(rows)[:2] == pytest.approx((1.0, 0.0), abs=0.03)


def test_a_long_gap_raises_the_flag_within_half_a_second_and_ends_with_the_gap():
    rows = drive(scans=250, stand={"gaps": ((18.0, 24.0),)})
    enters, leaves = (18.0 - 9.5) / 2.0, (24.0 - 9.0) / 2.0  # the footprint runs 5.3 m ahead of x = 4
    lost = rows[(rows[:, 0] > 1.0) & (rows[:, 1] == 0), 0]
    assert enters < lost[0] <= enters + 0.65  # 0.5 s, and 0.15 s for the depth of the footprint
    assert lost[-1] < leaves + 0.5
    assert errors(rows)[1] < 0.05


def test_wheel_tracks_in_the_crop_are_not_the_edge():
    course = Course(y=6.0)
    sense = EdgeSensor(course)
    inside = sense.scanner.stand.inside

    def with_tracks(x, y):
        depth = inside(x, y)
        return np.where(((depth > 2.0) & (depth < 2.5)) | ((depth > 3.8) & (depth < 4.3)), -1.0, depth)

    sense.scanner.stand.inside = with_tracks
    edges = [sense(sense.period * (i + 1), (0.08 * i, 0.1, 0.0), 2.0, 0.0) for i in range(100)]
    assert max(abs(e.offset - 5.9) for e in edges[25:]) < 0.05


def test_an_edge_beside_the_lost_one_is_taken_only_after_a_while():
    sense = EdgeSensor(Course(y=6.0))
    inside = sense.scanner.stand.inside
    sense.scanner.stand.inside = lambda x, y: inside(x, y) - np.where(x > 18.0, 1.0, 0.0)
    edges = [sense(sense.period * (i + 1), (0.08 * i, 0.1, 0.0), 2.0, 0.0) for i in range(200)]
    times = np.array([e.t / 1e9 for e in edges])
    found = np.array([e.is_found for e in edges])
    gone = times[(times > 1.0) & ~found]
    assert 1.0 < gone[-1] - gone[0] < 2.0
    assert edges[-1].offset == pytest.approx(4.9, abs=0.06)


def test_heights_are_reported():
    last = drive()[-1]
    assert last[6] == pytest.approx(0.9, abs=0.06)  # 90th percentile of first returns from tips at 0.85 m
    assert last[7] == pytest.approx(0.14, abs=0.05)


def mirrored(scan):
    flip = slice(None, None, -1)
    return replace(
        scan,
        beam_t=scan.beam_t[flip],
        azimuth=-scan.azimuth[flip],
        ranges=scan.ranges[flip],
        intensity=scan.intensity[flip],
    )


def test_left_and_right_are_mirror_images():
    left, right = mounting("left"), mounting("right")
    scanner = Scanner(Stand(lambda x, y: 6.0 - y), left)
    a, b = (
        Otsu(Params(), setup_of("left", 0.04, left)),
        Otsu(Params(), setup_of("right", 0.04, right)),
    )
    a.reset(Stream(1, "a"))
    b.reset(Stream(1, "b"))
    rng = np.random.default_rng(5)
    period = 40_000_000
    for i in range(40):
        scan = scanner.scan((i + 1) * period, (0.08 * i, 0.1, 0.002 * i), rng)
        x = a.step(i * period, period, {"scan": scan, "odometry": Odometry(0, 2.0, 0.05, 0.0)})["edge"]
        y = b.step(i * period, period, {"scan": mirrored(scan), "odometry": Odometry(0, 2.0, -0.05, 0.0)})[
            "edge"
        ]
        pair = [(e.offset, e.heading, e.curvature) for e in (x, y)]
        assert np.allclose(pair[0], -np.array(pair[1]), atol=1e-9, equal_nan=True)
        assert x.confidence == pytest.approx(y.confidence, abs=1e-9)


def test_a_late_scan_is_moved_by_odometry():
    course = Course(y=6.0)
    sense = EdgeSensor(course)
    pose, speed, yaw_rate, t, offsets = [0.0, 0.1, 0.0], 2.0, 0.0, 0, []
    late = 5 * sense.period
    for _ in range(60):
        pose[0] += speed * 0.04
        t += sense.period
        scan = sense.scanner.scan(t, pose, sense.rng)
        inputs = {"scan": scan, "odometry": Odometry(t + late, speed, yaw_rate, 0.0)}
        edge = sense.level.step(t + late - sense.period, sense.period, inputs)["edge"]
        offsets.append(edge.offset)
        assert edge.t == t + late
    assert np.nanmax(np.abs(np.array(offsets[10:]) - 5.9)) < 0.06


def test_a_dead_sensor_raises_the_flag():
    sense = EdgeSensor(Course(y=6.0))
    for i in range(20):
        scan = sense.scanner.scan((i + 1) * sense.period, (0.08 * i, 0.1, 0.0), sense.rng)
        inputs = {"scan": scan, "odometry": Odometry(0, 2.0, 0.0, 0.0)}
        edge = sense.level.step(i * sense.period, sense.period, inputs)["edge"]
    assert edge.is_found
    for i in range(20, 20 + 13):
        edge = sense.level.step(i * sense.period, sense.period, inputs)["edge"]
    assert not edge.is_found


def test_a_saved_detector_goes_on_as_if_nothing_had_happened():
    sense = EdgeSensor(Course(y=6.0))
    poses = [(0.08 * i, 0.1, 0.0) for i in range(40)]
    scans = [sense.scanner.scan((i + 1) * sense.period, p, sense.rng) for i, p in enumerate(poses)]

    def run(level, start, stop):
        odometry = Odometry(0, 2.0, 0.0, 0.0)
        steps = ((i * sense.period, {"scan": scans[i], "odometry": odometry}) for i in range(start, stop))
        return [repr(level.step(t, sense.period, given)["edge"]) for t, given in steps]

    run(sense.level, 0, 20)
    state = sense.level.save()
    straight = run(sense.level, 20, 40)  # as text: what is not known is nan, which equals nothing
    other = Otsu(Params(lean_deg=0.0, echo_parts=1), setup_of("left", 0.04, sense.mounting))
    other.reset(Stream(1, "edge"))
    other.load(state)
    assert run(other, 20, 40) == straight
    sense.level.load(state)
    assert run(sense.level, 20, 40) == straight


def test_a_horizontal_scanner_finds_nothing_and_says_so():
    sensor = Pose.from_euler([4.0, 6.3, 2.4])
    scanner = Scanner(Stand(lambda x, y: 6.0 - y), sensor)
    level = Otsu(Params(), setup_of("left", 0.04, sensor))
    first = level.reset(Stream(1, "edge"))["edge"]
    scan = scanner.scan(40_000_000, (0.0, 0.0, 0.0), np.random.default_rng(1))
    edge = level.step(0, 40_000_000, {"scan": scan, "odometry": Odometry(0, 2.0, 0.0, 0.0)})["edge"]
    assert not first.is_found
    assert not edge.is_found
    assert np.isnan(edge.offset)
