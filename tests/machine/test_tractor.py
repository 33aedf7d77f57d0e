"""A machine that steers ahead of its fixed axle, against the bicycle model of the textbooks."""

import math

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.machine.attitude import TerrainFollower
from swath.machine.machine_sheet import load_machine
from swath.machine.motion import kinematic, single_track
from swath.signals import SpeedCommand, SteerState
from tests.machine.machine_fakes import STREAM, Ground, drive, site, slope

SHEET = load_machine("tractor-grain-cart")
D, L, G = SHEET.dynamics, SHEET.wheelbase, 9.81
FRONT, REAR = L - D.cg_behind, D.cg_behind  # axles from the centre of gravity, as in a car


def make(level=single_track.SingleTrack, params=None, ground=None):
    params = params or single_track.Params(rolling_resistance=0.0, friction=1.5, start_speed_kmh=18.0)
    motion = level(params, site(ground, SHEET))
    motion.reset(STREAM)
    return motion


def run(motion, seconds, *, steer=0.0, speed=5.0):
    steering, wanted = SteerState(0, steer, 0.0), SpeedCommand(0, speed)
    return drive(motion, seconds, dt=0.005, steering=steering, speed=wanted)


def test_it_is_steered_ahead():
    assert SHEET.steers_ahead
    assert SHEET.steered_x == L
    assert not load_machine("lexion-700").steers_ahead


def test_a_wrong_axle_is_named(tmp_path):
    text = "steers: middle\n" + "".join(
        line for line in open_sheet().splitlines(keepends=True) if not line.startswith("steers")
    )
    (tmp_path / "own.yaml").write_text(text)
    with pytest.raises(InputError, match=r"steers = middle: expected one of front, rear"):
        load_machine("own.yaml", base=tmp_path)


def open_sheet():
    from swath.documents.data_sheets import find_sheet

    return find_sheet("machines", "tractor-grain-cart").read_text()


def test_kinematic_circle():
    motion = make(kinematic.Kinematic, kinematic.Params(start_speed_kmh=18.0))
    state = run(motion, 2.0, steer=0.2)[-1]
    assert state.yaw_rate == pytest.approx(5.0 * math.tan(0.2) / L)
    assert state.pose.euler()[2] == pytest.approx(10.0 * math.tan(0.2) / L)


def textbook(speed, steer):
    """Yaw rate and lateral speed of the centre of gravity: linear bicycle, steered front wheel (Mitschke)."""
    mass, inertia = D.mass, D.yaw_inertia
    cf, cr = D.stiffness * mass * G * REAR / L, D.stiffness * mass * G * FRONT / L
    a = np.array(
        [
            [-(cf + cr) / (mass * speed), -speed + (REAR * cr - FRONT * cf) / (mass * speed)],
            [
                (REAR * cr - FRONT * cf) / (inertia * speed),
                -(FRONT**2 * cf + REAR**2 * cr) / (inertia * speed),
            ],
        ]
    )
    b = np.array([cf / mass, FRONT * cf / inertia])
    return np.linalg.solve(a, -b * steer)


@pytest.mark.parametrize("speed", [1.0, 3.0, 8.0])
def test_steady_turn_of_the_bicycle_model(speed):
    motion = make(
        params=single_track.Params(rolling_resistance=0.0, friction=1.5, start_speed_kmh=3.6 * speed)
    )
    state = run(motion, 12.0, steer=1e-3, speed=speed)[-1]
    lateral, turn = textbook(speed, 1e-3)
    assert state.yaw_rate == pytest.approx(turn, rel=2e-3)
    assert state.lateral_speed == pytest.approx(lateral - REAR * turn, rel=5e-3, abs=2e-6)  # of the rear axle
    assert turn > 0.0


def test_its_lateral_dynamics_are_those_of_the_bicycle_with_lagging_tyres():
    """Yaw rate over the first second after a step of the steering, linear model with relaxation lengths."""
    speed, steer, h = 5.0, 1e-3, 0.0005
    motion = make()
    mine = np.array([s.yaw_rate for s in run(motion, 1.5, steer=steer)])
    cf, cr = D.stiffness * D.mass * G * REAR / L, D.stiffness * D.mass * G * FRONT / L
    w = r = front = rear = 0.0
    rates = []
    for _ in range(round(1.5 / h)):
        front += h * (w + FRONT * r - speed * steer - speed * front) / D.rear.relaxation
        rear += h * (w - REAR * r - speed * rear) / D.front.relaxation
        push = -cf * front, -cr * rear
        w += h * (sum(push) / D.mass - speed * r)
        r += h * (FRONT * push[0] - REAR * push[1]) / D.yaw_inertia
        rates.append(r)
    np.testing.assert_allclose(mine, rates[9::10], atol=0.01 * max(rates))


@pytest.mark.parametrize(("along", "left"), [(0.1, 0.0), (-0.06, 0.05)])
def test_stands_on_slopes(along, left):
    follower = TerrainFollower(slope(along, left), SHEET)
    for yaw in (0.0, 1.0, -2.5):
        follower.at(3.0, -2.0, yaw)
        normal = np.array([-along, -left, 1.0]) / math.sqrt(1.0 + along**2 + left**2)
        np.testing.assert_allclose(follower.pose().rotation[:, 2], normal, atol=1e-12)


def test_its_front_axle_is_ahead_on_the_ground():
    """A step up under the front axle only: nose up, and the fixed axle stays down."""
    follower = TerrainFollower(Ground(lambda x, y: 0.1 * (np.asarray(x) > 1.0)), SHEET)
    stance = follower.at(0.0, 0.0, 0.0)
    assert stance.z == 0.0
    assert stance.pitch == pytest.approx(-math.atan(0.1 / L))


@pytest.mark.parametrize("grade", [-0.1, 0.1])
def test_uphill_loads_the_rear_axle(grade):
    motion = make(ground=slope(grade, 0.0), params=single_track.Params(rolling_resistance=0.0))
    run(motion, 0.005, speed=0.0)
    rear, front = motion.axle_loads
    normal = D.mass * G * math.cos(math.atan(grade))
    assert front + rear == pytest.approx(normal)
    assert front == pytest.approx(normal * (REAR - D.cg_height * grade) / L)


def test_crabs_downhill_on_a_side_slope():
    motion = make(ground=slope(0.0, 0.1))
    state = run(motion, 12.0)[-1]
    assert -state.lateral_speed / state.speed == pytest.approx(0.1 / D.stiffness, rel=0.04)
    assert state.pose.position[1] < -0.5
