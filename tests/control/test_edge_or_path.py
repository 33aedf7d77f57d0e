"""The third way when the edge is lost: on by the measured pose, and back to the edge."""

import math

import numpy as np
import pytest

from swath.control.speed.constant import ConstantSpeed
from swath.control.speed.constant import Params as SpeedParams
from swath.control.speed.guard import Guard
from swath.control.steer.edge_or_path import EdgeOrPath, Params, line_through
from swath.control.steer.path import Begin, Segment
from swath.control.steer.path import Params as PathParams
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.signals import (
    CropEdge,
    GuidanceState,
    Odometry,
    PoseEstimate,
)
from swath.signals.setup import ControlSetup
from tests.control.closed_loop import MACHINE

PERIOD = 20_000_000
SPEED = 2.0


def test_the_line_is_that_of_least_squares_in_the_way_that_was_driven():
    rng = np.random.default_rng(1)
    for angle in (0.3, 2.0, -1.6, 3.1):
        along = np.linspace(0.0, 30.0, 61)
        across = 0.02 * rng.standard_normal(61)
        x = 5.0 + along * math.cos(angle) - across * math.sin(angle)
        y = -3.0 + along * math.sin(angle) + across * math.cos(angle)
        line = line_through(list(zip(x.tolist(), y.tolist(), strict=True)))
        slope, height = np.polyfit(along, across, 1)
        assert math.remainder(line.heading(10.0) - angle - slope, 2.0 * math.pi) == pytest.approx(
            0.0, abs=1e-4
        )
        assert line.project(x[0], y[0]).left == pytest.approx(across[0] - height, abs=1e-3)


def drive(
    lost,
    params,
    seconds=60.0,
    pose_known=lambda t: True,
    aside=lambda t: 0.0,
    jag=lambda t: (0.0, 0.0),
):
    """A machine without slip along an edge at y = 6.1 - 0.1 left of it; rows (t, y, led, engaged).

    aside: how far left the edge is seen at a time [m]; jag: direction [rad]
    and curvature [1/m] that it seems to have more
    """
    setup = ControlSetup(MACHINE, {}, "left", PERIOD * 1e-9)
    law = EdgeOrPath(params, setup)
    command = law.reset(Stream(1, "steer"))["command"]
    x, y, heading, angle, rows = 0.0, 0.3, 0.0, 0.0, []
    for i in range(round(seconds / 0.02)):
        t = (i + 1) * PERIOD
        wanted = math.atan(command.curvature * MACHINE.wheelbase)
        angle += min(max((wanted - angle) * 0.1, -0.005), 0.005)
        rate = SPEED * math.tan(angle) / MACHINE.wheelbase
        middle = heading + 0.01 * rate
        x, y = x + 0.02 * SPEED * math.cos(middle), y + 0.02 * SPEED * math.sin(middle)
        heading += 0.02 * rate
        is_lost = any(a < t * 1e-9 < b for a, b in lost)
        nan = math.nan
        offset = (5.9 + aside(t * 1e-9) - y) / math.cos(heading) - 8.0 * math.tan(heading)
        angled, bent = jag(t * 1e-9)
        seen = (nan, nan) if is_lost else (offset, angled - heading)
        edge = CropEdge(t, *seen, bent, 8.0, 0.0 if is_lost else 0.9, 0.85, 0.15)
        spread = np.diag([1e-4 if pose_known(t * 1e-9) else 9.0] * 4)
        pose = PoseEstimate(t, x + 100.0, y, heading, SPEED, rate, spread, 0.0)
        given = {"edge": edge, "odometry": Odometry(t, SPEED, rate, angle), "pose": pose}
        out = law.step(t - PERIOD, PERIOD, given)
        command = out["command"]
        rows.append((t * 1e-9, y, out["guidance"].is_following, command.is_engaged))
    return np.array(rows, dtype=float)


def test_without_an_edge_it_goes_on_as_it_drove_last_and_takes_up_the_edge_again():
    rows = drive([(25.0, 45.0)], Params())
    led = (rows[:, 0] > 25.3) & (rows[:, 0] < 45.5)
    assert rows[led, 2].all()
    assert not rows[(rows[:, 0] < 25.1) | (rows[:, 0] > 45.7), 2].any()
    assert rows[:, 3].all()  # never lets go, for 20 s
    settled = rows[rows[:, 0] > 15.0, 1]
    assert np.ptp(settled) < 0.04


def test_a_loss_before_enough_was_driven_or_without_a_position_ends_as_without_this_way():
    early = drive([(3.0, 13.0)], Params(), 12.0)
    assert not early[:, 2].any()
    assert not early[early[:, 0] > 4.5, 3].any()
    blind = drive([(25.0, 41.0)], Params(), 40.0, pose_known=lambda t: t < 25.0)
    assert not blind[blind[:, 0] > 27.0, 3].any()


def test_a_path_of_the_scenario_leads_instead_where_there_is_one():
    path = PathParams(begin=Begin(x_m=0.0, y_m=0.5, heading_deg=0.0), segments=(Segment(400.0),))
    rows = drive([(20.0, 60.0)], Params(path=path), 55.0)
    assert abs(rows[-1, 1] - 0.5) < 0.03
    assert rows[-1, 2]


ALONG = PathParams(begin=Begin(x_m=90.0, y_m=0.0, heading_deg=0.0), segments=(Segment(310.0),))


def test_an_edge_far_beside_the_path_does_not_lead():
    """Seen 1 m off for 4 s, as beside a gap that another machine left; without the bound it swerves."""

    def swerves(t):
        return 1.0 if 25.0 < t < 29.0 else 0.0

    for stray, least, most in ((0.3, 0.0, 0.02), (1.2, 0.5, 1.2), (None, 0.5, 1.2)):
        rows = drive([], Params(path=ALONG, stray_m=stray), 40.0, aside=swerves)
        seen = rows[rows[:, 0] > 20.0]
        assert least <= np.abs(seen[:, 1]).max() <= most
        assert seen[-1, 2] == 0.0  # the edge leads again


def test_a_jag_of_the_edge_does_not_turn_a_machine_that_keeps_near_its_path():
    """For 2 s it seems to bend off by 0.25 rad and to curve by 0.15 1/m; without a bound that is followed."""
    most = []
    for stray in (1.0, None):
        params = Params(path=ALONG, stray_m=stray)
        rows = drive([], params, 40.0, jag=lambda t: (0.25, 0.15) if 25.0 < t < 27.0 else (0.0, 0.0))
        most.append(np.abs(rows[rows[:, 0] > 20.0, 1]).max())
    assert most[0] < 0.5 * most[1]
    assert most[0] < 0.15
    assert most[1] > 0.3


@pytest.mark.parametrize(
    ("when_lost", "led", "stands"), [("path", True, False), ("path", False, True), ("stop", True, True)]
)
def test_the_speed_law_goes_on_where_a_path_leads(when_lost, led, stands):
    guard = Guard(when_lost=when_lost, slow_kmh=4.0)
    law = ConstantSpeed(SpeedParams(speed_kmh=7.0, guard=guard), ControlSetup(MACHINE, {}, "left", 0.1))
    law.reset(Stream(1, "speed"))
    edge = CropEdge(0, math.nan, math.nan, 0.0, 8.0, 0.0, 0.85, 0.15)
    state = GuidanceState(0, led, 0.0, 0.0, 0.0, 10.0)
    speed = 2.0
    for i in range(200):
        inputs = {"edge": edge, "odometry": Odometry(0, speed, 0.0, 0.0), "guidance": state, "objects": None}
        speed = law.step(i, 100_000_000, inputs)["command"].speed
    assert (speed == 0.0) == stands
    assert stands or speed == pytest.approx(4.0 / 3.6)
    assert bool(law.end_reason(0)) == stands


def test_a_bound_beside_no_path_is_refused():
    with pytest.raises(InputError, match=r"stray_m = 1\.0: expected a path, too"):
        drive([], Params(stray_m=1.0), 1.0)
