"""The steering law on a kinematic rear-steered machine with dead time, lag and rate limit of the steering."""

import numpy as np
import pytest

from swath.control.speed import constant
from swath.control.steer.plant_model import SlipObserver
from swath.control.steer.preview import Params, Preview
from swath.core.random import Stream
from swath.signals import CropEdge, Odometry
from tests.control.closed_loop import MACHINE, Course, Loop, setup_of
from tests.control.edge_drive import EdgeSensor

KMH = 1 / 3.6
DEG = np.pi / 180


def late(rows, after=10.0):
    return rows[rows[:, 0] > after, 1]


@pytest.mark.parametrize(("speed", "way"), [(0.05, 12), (1.0, 120), (3.5, 120)])
def test_straight_edge_known_to_three_centimetres(speed, way):
    error = late(Loop(speed=speed).run(way))
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert abs(error.mean()) < 0.005


@pytest.mark.parametrize(("speed", "start"), [(1.0, 0.5), (7 * KMH, -0.5)])
def test_a_step_of_half_a_metre_dies_out_in_fifteen_metres_without_overshoot(speed, start):
    rows = Loop(speed=speed, start_error=start, noise=0.0, heading_noise=0.0).run(50)
    error = rows[:, 1] / start
    assert np.abs(error[rows[:, 0] > 15.0]).max() < 0.05
    assert -error.min() < 0.10


@pytest.mark.parametrize(
    ("speed", "side", "radius"),
    [(1.0, "left", 40.0), (7 * KMH, "right", 40.0), (3.5, "left", -40.0), (3.5, "right", -40.0)],
)
def test_the_header_end_stays_on_a_bend(speed, side, radius):
    error = late(Loop(speed=speed, side=side, course=Course(radius, 30.0)).run(85))
    assert np.quantile(np.abs(error), 0.95) < 0.10


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_bend_of_unknown_curvature_is_still_followed(side):
    rows = Loop(side=side, course=Course(40.0, 20.0), curvature_known=False).run(85)
    assert np.quantile(np.abs(late(rows)), 0.95) < 0.20


@pytest.mark.parametrize(("speed", "crab"), [(1.0, 1.4), (3.5, -1.4)])
def test_crabbing_on_a_side_slope_leaves_no_bias(speed, crab):
    error = late(Loop(speed=speed, crab=crab * DEG).run(120), after=50.0)
    assert abs(error.mean()) < 0.02


def test_without_the_observer_crabbing_costs_the_preview_distance_times_the_angle():
    error = late(Loop(crab=1.4 * DEG, params=Params(slip_m=0.0)).run(120), after=50.0)
    assert abs(error.mean()) == pytest.approx(4.0 * 1.4 * DEG, rel=0.25)


def test_a_long_delay_of_the_edge_is_no_danger():
    for speed in (1.0, 3.5):
        error = late(Loop(speed=speed, delay=0.32, start_error=0.3).run(150), after=60.0)
        assert np.sqrt(np.mean(error**2)) < 0.02


def test_the_overlap_is_measured_out_of_the_crop():
    for side in ("left", "right"):
        for overlap in (0.0, 0.3):
            rows = Loop(side=side, params=Params(overlap_m=overlap), noise=0.0).run(60)
            assert abs(late(rows, 40.0).mean()) < 0.005


def test_a_lost_edge_is_held_then_given_back():
    rows = Loop(course=Course(40.0, 5.0), edge_lost=(40.0, 1e9), noise=0.0).run(60)
    held = rows[(rows[:, 0] > 40.3) & (rows[:, 0] < 41.5)]
    given_back = rows[rows[:, 0] > 40.0 + 7 * KMH * 1.3]
    assert (held[:, 3] == 1).all()
    assert np.ptp(held[:, 2]) < 1e-12
    assert held[0, 2] == pytest.approx(1.0 / 46.1, rel=0.1)  # axle on R + 6 m and a little
    assert (given_back[:, 3] == 0).all()
    assert abs(rows[-1, 2]) < 1e-12


def test_an_edge_that_comes_back_is_taken_gently():
    rows = Loop(edge_lost=(30.0, 40.0), noise=0.0, start_error=0.0).run(70)
    assert (rows[rows[:, 0] > 40.3, 3] == 1).all()
    assert np.abs(late(rows, 60.0)).max() < 0.01


def test_commands_keep_to_the_limits_of_the_steering():
    rows = Loop(start_error=5.0, speed=1.5).run(60)
    command = rows[:, 2]
    assert np.abs(np.diff(command)).max() <= 15 * DEG / MACHINE.wheelbase * 0.04 + 1e-12
    assert np.abs(command).max() <= np.tan(0.8 * MACHINE.max_steer) / MACHINE.wheelbase
    assert np.abs(rows[-1, 1]) < 0.1


def test_nothing_seen_is_not_engaged():
    law = Preview(Params(), setup_of())
    first = law.reset(Stream(1, "steer"))["command"]
    nan = float("nan")
    blind = {"edge": CropEdge(0, nan, nan, 0.0, 8.0, 0.0, nan, nan), "odometry": Odometry(0, 2.0, 0.0, 0.0)}
    command = law.step(0, 40_000_000, blind)["command"]
    assert not first.is_engaged
    assert not command.is_engaged
    assert command.curvature == 0.0


@pytest.mark.parametrize("speed", [0.0, -1.0, 0.05, np.nan])
def test_standing_still_and_nonsense_give_a_finite_command(speed):
    law = Preview(Params(), setup_of())
    law.reset(Stream(1, "steer"))
    edge = CropEdge(0, 5.0, 0.3, 0.02, 8.0, 0.9, 0.8, 0.1)
    for i in range(50):
        out = law.step(
            i * 40_000_000, 40_000_000, {"edge": edge, "odometry": Odometry(0, speed, np.nan, np.nan)}
        )
    assert np.isfinite(out["command"].curvature)


def test_a_saved_law_goes_on_as_if_nothing_had_happened():
    law = Preview(Params(), setup_of())
    law.reset(Stream(1, "steer"))
    rng = np.random.default_rng(3)
    inputs = [
        {
            "edge": CropEdge(
                i * 40_000_000, *(5.8 + 0.1 * rng.standard_normal(), 0.01), 0.01, 8.0, 0.9, 0.8, 0.1
            ),
            "odometry": Odometry(0, 2.0, 0.02 * rng.standard_normal(), 0.0),
        }
        for i in range(60)
    ]

    def run(of, start, stop):
        return [of.step(i * 40_000_000, 40_000_000, inputs[i])["command"] for i in range(start, stop)]

    run(law, 0, 30)
    state = law.save()
    rest = run(law, 30, 60)
    other = Preview(Params(), setup_of())
    other.reset(Stream(1, "steer"))
    other.load(state)
    assert run(other, 30, 60) == rest


@pytest.mark.parametrize(
    ("radius", "limit", "side", "way"),
    [(np.inf, 0.03, "left", 50), (40.0, 0.08, "left", 65), (-40.0, 0.08, "right", 65)],
)
def test_detector_and_law_together(radius, limit, side, way):
    course = Course(radius, 30.0, y=6.0 if side == "left" else -6.0)
    sense = EdgeSensor(course, side=side, roll_sd=0.5 * DEG, outside=0.0)
    rows = Loop(side=side, course=course, sense=sense).run(way)
    assert np.quantile(np.abs(late(rows)), 0.95) < limit
    assert rows[rows[:, 0] > 2.0, 3].all()


def test_constant_speed():
    law = constant.ConstantSpeed(constant.Params(speed_kmh=7.2), setup_of())
    assert law.reset(Stream(1, "speed"))["command"].speed == pytest.approx(2.0)
    command = law.step(0, 40_000_000, {"odometry": None, "edge": None})["command"]
    assert (command.t, command.speed) == (40_000_000, pytest.approx(2.0))


def observed(errors, deviations, *, slip_m=6.0):
    """Slip [rad] after lateral errors [m] every 4 cm of travel, of edges known to deviations [m]."""
    observer = SlipObserver(slip_m, 0.1, 0.07)
    for error, sd in zip(errors, deviations, strict=True):
        observer.update(error, 0.0, 0.04, min(1.0, (0.05 / sd) ** 2), sd)
    return observer.slip


def test_an_edge_that_becomes_better_known_is_no_slip():
    way = np.arange(0.0, 8.0, 0.04)
    settles = 0.2 * np.exp(-way / 1.5)
    known = 0.03 + settles
    assert abs(observed(settles, known)) < 0.1 * abs(observed(settles, np.full(len(way), 0.03)))
    assert observed(-0.01 * np.arange(0.0, 60.0, 0.04), np.full(1500, 0.03)) == pytest.approx(0.01, rel=0.05)
