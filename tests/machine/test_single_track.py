"""The single-track model against closed forms that are written down here a second time."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.field.terrain import formula
from swath.machine.machine_sheet import load_machine, with_grain
from swath.machine.motion import kinematic
from swath.machine.motion.single_track import Params, SingleTrack
from swath.record.digest import sample_bytes
from swath.signals import MachineLoad, SpeedCommand, SteerState
from tests.field.made_field import made_field
from tests.machine.machine_fakes import STREAM, drive, site, slope

SHEET = load_machine("lexion-700")
D = SHEET.dynamics
L, A = SHEET.wheelbase, D.cg_behind
B = L - A
G = 9.81


def slip_for(force_over_load, stiffness, friction):
    """Slip tan(alpha) that gives a side force over load in [0, friction): the brush formula turned round."""
    return 3.0 * friction / stiffness * (1.0 - math.cbrt(1.0 - force_over_load / friction))


def make(ground=None, machine=SHEET, **params):
    motion = SingleTrack(Params(**params), site(ground, machine))
    motion.reset(STREAM)
    return motion


def run(motion, seconds, *, steer=0.0, speed=2.0, dt=0.005, **more):
    return drive(
        motion, seconds, dt=dt, steering=SteerState(0, steer, 0.0), speed=SpeedCommand(0, speed), **more
    )


@pytest.mark.parametrize(("speed", "rolling"), [(1.0, 0.12), (2.0, 0.0), (5.0, 0.0), (5.0, 0.12)])
def test_yaw_gain_against_the_linear_closed_form(speed, rolling):
    """Moments and forces of the linear model, solved by hand.

    Y = m u r;  L Ff = Y (b + h f);  rear side force with its rolling drag: Fr + D steer = Y (a - h f) / L
    steer = L r / u + Ff / Cf - Fr / Cr
    """
    lead_f, lead_r = rolling * D.front.radius, rolling * D.rear.radius
    rear_load = D.mass * G * (A + lead_f) / (L + lead_f - lead_r)
    cf, cr = D.stiffness * (D.mass * G - rear_load), D.stiffness * rear_load
    drag, hf, push = rolling * rear_load, D.cg_height * rolling, D.mass * speed
    gain = (1 - drag / cr) / (L / speed + push / L * ((B + hf) / cf - (A - hf) / cr))
    steer = 1e-3
    motion = make(rolling_resistance=rolling, start_speed_kmh=speed * 3.6, friction=1.5)
    state = run(motion, 15.0, steer=steer, speed=speed)[-1]
    assert state.yaw_rate / steer == pytest.approx(gain, rel=2e-3)


def test_without_rolling_resistance_it_steers_neutrally():
    """Both tyres have the same stiffness per load: no understeer, the kinematic yaw rate at any speed."""
    for speed in (1.0, 5.0):
        motion = make(rolling_resistance=0.0, start_speed_kmh=speed * 3.6)
        state = run(motion, 15.0, steer=1e-3, speed=speed)[-1]
        assert state.yaw_rate == pytest.approx(speed * math.tan(1e-3) / L, rel=1e-3)


def crab_by_hand(yaw, speed, side):
    """(front slip, turn rate) at rest on a slope that rises by `side` to +y, heading off level by yaw.

    No rolling resistance. Gravity pulls at the centre of gravity, the axles share it by their levers; a
    heading off level tilts the machine fore and aft and shifts load by h, so the axles slip differently:
    rate = u / L (rear slip - front slip), and the turn itself needs side force. Slips: brush turned round.
    """
    pitch, left = math.atan(-side * math.sin(yaw)), side * math.cos(yaw)
    weight, roll = D.mass * G, math.atan(left * math.cos(pitch))
    normal = weight * math.cos(pitch) * math.cos(roll)
    rear = (A * normal - D.cg_height * weight * math.sin(pitch)) / L
    pull, rate = weight * math.cos(pitch) ** 2 * math.cos(roll) * left, 0.0
    for _ in range(20):
        push = pull + D.mass * speed * rate
        shares = push * B / L / (normal - rear), push * A / L / rear
        front_slip, rear_slip = (slip_for(s, D.stiffness, D.friction) for s in shares)
        rate = speed / L * (rear_slip - front_slip)
    return front_slip, rate


def test_crabs_on_a_side_slope():
    """On 10 % the tyres slip until they carry a tenth of their load: about 0.1 / 4 rad = 1.4 deg downhill."""
    motion = make(slope(0.0, 0.1), rolling_resistance=0.0, start_speed_kmh=7.2)
    run(motion, 15.0)
    first, *_, last = run(motion, 5.0)
    yaw = last.pose.euler()[2]  # drifted by 0.07 deg while the tyres built up slip
    slip, rate = crab_by_hand(yaw, 2.0, 0.1)
    assert 1e-4 < -yaw < 2e-3
    assert -last.lateral_speed / last.speed == pytest.approx(slip, rel=1e-7)
    assert last.yaw_rate == pytest.approx(rate, abs=2e-9)
    assert 4e-6 < rate < 6e-6  # not lost in the tolerance
    way = last.pose.position - first.pose.position
    assert -way[1] / way[0] + yaw == pytest.approx(slip, rel=1e-3)
    slip = slip_for(0.1, D.stiffness, D.friction)
    assert -last.lateral_speed / last.speed == pytest.approx(slip, rel=1e-3)
    assert math.degrees(slip) == pytest.approx(1.43, rel=0.07)
    assert math.degrees(slip_for(0.1, 4.0, 1.5)) == pytest.approx(1.43, rel=0.03)


def test_the_drag_of_the_wheels_turns_it_downhill():
    """Gravity pulls at the centre of gravity, whatever rolling resistance shifts between the axles.

    Downhill wheels drag more (torque f h m g slope) and the rear axle carries more than the lever of gravity
    allows; by hand, both tyres with the same stiffness per load: share of the side force of each axle, then
    yaw rate = speed / wheelbase * (slip rear - slip front).
    """
    f, slope_left, speed = D.rolling_resistance, 0.05, 2.0
    motion = make(slope(0.0, slope_left), friction=1.5, start_speed_kmh=speed * 3.6)
    rate = run(motion, 6.0, speed=speed)[-1].yaw_rate
    rear = (A + f * D.front.radius) / (L + f * D.front.radius - f * D.rear.radius)
    rate = 0.0
    for _ in range(20):  # gravity also feeds the turn itself
        push = slope_left + rate * speed / G
        front_share = push * (B + f * D.cg_height) / L / (1 - rear)
        rear_share = push * (A - f * D.cg_height) / L / rear
        slips = [slip_for(s, D.stiffness, 1.5) for s in (front_share, rear_share)]
        rate = speed / L * (slips[1] - slips[0])
    assert motion.save()["turn"] == pytest.approx(rate, rel=0.03)


def linear_matrix(speed):
    """Lateral speed, yaw rate and the two tyre slips; no rolling resistance, straight ahead."""
    cf, cr = D.stiffness * D.mass * G * B / L, D.stiffness * D.mass * G * A / L
    sf, sr = D.front.relaxation, D.rear.relaxation
    return np.array(
        [
            [0.0, -speed, -cf / D.mass, -cr / D.mass],
            [0.0, 0.0, -A * cf / D.yaw_inertia, B * cr / D.yaw_inertia],
            [1 / sf, A / sf, -speed / sf, 0.0],
            [1 / sr, -B / sr, 0.0, -speed / sr],
        ]
    )


@pytest.mark.parametrize("speed", [1.0, 2.0])
def test_relaxation_modes_against_the_eigenvalues(speed, capsys):
    """The ring-down after a small steering pulse, fitted with a linear map from sample to sample."""
    motion = make(rolling_resistance=0.0, start_speed_kmh=speed * 3.6)
    run(motion, 0.2, steer=2e-5, speed=speed)
    samples = []
    for _ in range(60):
        run(motion, 0.02, speed=speed)
        state = motion.save()
        samples.append([state[k] for k in ("side", "turn", "front_slip", "rear_slip")])
    x = np.array(samples)
    step = np.linalg.lstsq(x[:-1], x[1:], rcond=None)[0].T
    modes = np.log(np.linalg.eigvals(step).astype(complex)) / 0.02
    expected = np.linalg.eigvals(linear_matrix(speed))
    np.testing.assert_allclose(np.sort_complex(modes), np.sort_complex(expected), rtol=2e-3)
    for mode in expected[expected.imag > 0]:
        print(f"{speed} m/s: {abs(mode) / 2 / math.pi:.2f} Hz, damping {-mode.real / abs(mode):.2f}")
    shown = capsys.readouterr().out
    if speed == 2.0:
        assert "0.60 Hz, damping 0.42" in shown
        assert "1.15 Hz, damping 0.19" in shown


def test_converges_with_order_four():
    def end(substep_ms):
        motion = make(substep_ms=substep_ms, start_speed_kmh=10.8)
        s = run(motion, 2.0, steer=0.2, speed=3.0, dt=0.02)[-1]
        return np.array([*s.pose.position[:2], s.yaw_rate, s.lateral_speed])

    exact = end(0.5)
    errors = np.array([np.abs(end(ms) - exact).max() for ms in (20.0, 10.0, 5.0)])
    assert errors[2] < 1e-8
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 3.7)


def test_parked_on_a_slope_it_stays():
    motion = make(slope(0.05, 0.1))
    states = run(motion, 20.0, steer=0.3, speed=0.0)
    sunk = slip_for(0.1, D.stiffness, D.friction) * D.front.relaxation
    assert states[-1].pose.position[1] == pytest.approx(-sunk, rel=0.05)
    assert abs(states[-1].lateral_speed) < 1e-6
    assert abs(states[-1].yaw_rate) < 1e-6


def test_comes_to_rest_in_a_turn_without_swinging_on():
    motion = make(start_speed_kmh=7.2)
    run(motion, 3.0, steer=0.5)
    state = run(motion, 25.0, steer=0.5, speed=0.0)[-1]
    assert abs(state.speed) + abs(state.lateral_speed) + abs(state.yaw_rate) < 1e-6


@pytest.mark.parametrize(("dt", "steer"), [(0.001, 0.7), (0.005, 0.0), (0.02, 0.05), (0.02, 0.7)])
def test_stable_from_standstill_to_8_m_s(dt, steer):
    fast = replace(SHEET, dynamics=replace(D, max_speed=9.0, accel=2.0))
    states = run(make(machine=fast), 8.0, steer=steer, speed=8.0, dt=dt)
    values = np.array([[s.speed, s.lateral_speed, s.yaw_rate] for s in states])
    assert np.all(np.isfinite(values))
    assert values[-1, 0] == pytest.approx(8.0, abs=0.2)
    # no more sideways than the tyres (and the rolling drag of the turned rear wheel) can push
    speed, lateral, turn = values.T
    accel = np.diff(lateral - A * turn) / dt + 0.5 * (speed * turn)[1:] + 0.5 * (speed * turn)[:-1]
    assert np.abs(accel).max() < (D.friction + 0.03) * G


def test_left_and_right_mirror():
    left, right = (
        run(make(slope(0.02, s * 0.05), start_speed_kmh=5.0), 6.0, steer=s * 0.3)[-1] for s in (1, -1)
    )
    assert left.yaw_rate == -right.yaw_rate
    assert left.lateral_speed == pytest.approx(-right.lateral_speed, rel=1e-12)
    np.testing.assert_allclose(left.pose.position * [1, -1, 1], right.pose.position, atol=1e-9)


def test_grain_in_the_tank_makes_the_loaded_machine():
    """Filled while it drives, it ends in the turn of a machine that weighs so much from the start."""
    filled, loaded = make(start_speed_kmh=7.2), make(machine=with_grain(SHEET, 8000.0), start_speed_kmh=7.2)
    before = run(filled, 12.0, steer=0.3)[-1]
    for i in range(81):
        load = MachineLoad(0, 100.0 * i, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        after = run(filled, 0.05, steer=0.3, load=load)[-1]
        assert after.lateral_speed == pytest.approx(before.lateral_speed, abs=0.02)
    a, b = (run(m, 10.0, steer=0.3)[-1] for m in (filled, loaded))
    assert a.yaw_rate == pytest.approx(b.yaw_rate, rel=1e-6)
    assert a.lateral_speed == pytest.approx(b.lateral_speed, rel=1e-4)
    assert sum(filled.axle_loads) == pytest.approx((D.mass + 8000.0) * G)


@pytest.mark.parametrize("seed", range(3))
def test_grain_weighs_what_the_sheet_of_the_loaded_machine_says(seed):
    """To the bit, from the first step on, whatever was in the tank before."""
    draw = np.random.default_rng(seed)
    grain, other = draw.uniform(1.0, 9000.0, 2).tolist()
    ground = slope(*draw.uniform(-0.05, 0.05, 2))
    filled, loaded = make(ground, substep_ms=5.0), make(ground, with_grain(SHEET, grain), substep_ms=5.0)
    for carried in (other, 0.0, grain):
        run(filled, 0.02, speed=0.0, load=MachineLoad(0, carried, *(0.0,) * 6))
    filled.load({**loaded.save(), "grain": filled.save()["grain"]})
    for steer, speed in draw.uniform((-0.5, -2.0), (0.5, 3.0), (8, 2)).tolist():
        a, b = (run(motion, 0.5, steer=steer, speed=speed)[-1] for motion in (filled, loaded))
        assert sample_bytes("m", "state", 0, a) == sample_bytes("m", "state", 0, b)
    assert filled.axle_loads == loaded.axle_loads


def test_saved_state_goes_on_byte_for_byte():
    ground = slope(0.03, 0.05)
    one, two = make(ground, start_speed_kmh=4.0), make(ground, start_speed_kmh=4.0)
    run(one, 3.0, steer=0.2, load=MachineLoad(0, 3000.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    kept = one.save()
    first = run(one, 2.0, steer=-0.1)
    two.load(kept)
    second = run(two, 2.0, steer=-0.1)
    for a, b in zip(first, second, strict=True):
        assert a.pose.position.tobytes() == b.pose.position.tobytes()
        assert a.pose.rotation.tobytes() == b.pose.rotation.tobytes()
        assert (a.speed, a.lateral_speed, a.yaw_rate, a.distance) == (
            b.speed,
            b.lateral_speed,
            b.yaw_rate,
            b.distance,
        )


@pytest.mark.parametrize(
    ("speed", "yaw_off", "behind"), [(1.5, 0.03, 0.6), (2.2, 0.04, 0.8), (6.0, 0.10, 3.0)]
)
def test_what_the_kinematic_level_leaves_out(speed, yaw_off, behind):
    """One step of the steering angle to R = 20 m: tyre lag and drag set yaw rate and place apart."""
    steer, seconds = math.atan(L / 20.0), 20.0 * math.pi / 6 / speed
    simple = kinematic.Kinematic(kinematic.Params(start_speed_kmh=speed * 3.6), site())
    simple.reset(STREAM)
    full = make(start_speed_kmh=speed * 3.6)
    a, b = (run(m, seconds, steer=steer, speed=speed)[-1] for m in (simple, full))
    gap = float(np.hypot(*(a.pose.position - b.pose.position)[:2]))
    assert 0.25 * behind < gap < behind
    settled = run(full, 5.0, steer=steer, speed=speed)[-1]
    assert 0.0 < 1.0 - settled.yaw_rate / a.yaw_rate < yaw_off
    print(f"{speed} m/s: yaw rate {settled.yaw_rate / a.yaw_rate:.3f}, place after 30 deg {gap:.2f} m apart")


@pytest.mark.parametrize("pitch_grade", [-0.1, 0.1])
def test_axle_loads_add_up_and_follow_the_grade(pitch_grade):
    motion = make(slope(pitch_grade, 0.0), rolling_resistance=0.0)
    run(motion, 0.005, speed=0.0)
    front, rear = motion.axle_loads
    normal = D.mass * G * math.cos(math.atan(pitch_grade))
    assert front + rear == pytest.approx(normal)
    assert rear == pytest.approx(normal * (A + D.cg_height * pitch_grade) / L)


@pytest.mark.parametrize(("speed", "expected"), [(1.0, (35, 47, 57)), (2.8, (1, 10, 21)), (5.0, (0, 0, 3))])
def test_the_yaw_overshoot_at_half_and_twice_the_estimated_relaxation(speed, expected):
    """Percent over the settled yaw rate after a step of 3 deg."""
    for scale, percent in zip((0.5, 1.0, 2.0), expected, strict=True):
        front, rear = (replace(axle, relaxation=scale * axle.relaxation) for axle in (D.front, D.rear))
        machine = replace(SHEET, dynamics=replace(D, front=front, rear=rear))
        motion = make(machine=machine, start_speed_kmh=3.6 * speed)
        rates = [s.yaw_rate for s in run(motion, 24.0 / speed, steer=math.radians(3.0), speed=speed)]
        settled = float(np.mean(rates[-len(rates) // 4 :]))
        assert 100.0 * (max(rates) / settled - 1.0) == pytest.approx(percent, abs=1.0)


@pytest.mark.parametrize("percent", [-10.0, 0.0, 10.0])
def test_the_driven_wheels_slip_for_what_they_pull(percent):
    """The brush formula turned round: weight along the slope and rolling resistance."""
    angle = math.atan(0.01 * percent)
    motion = make(slope(0.01 * percent), wheel_slip=True, start_speed_kmh=7.2)
    run(motion, 3.0, speed=2.0)
    inputs = {"steering": SteerState(0, 0.0, 0.0), "speed": SpeedCommand(0, 2.0), "drive": None, "load": None}
    found = motion.step(3_000_000_000, 5_000_000, inputs)
    wheels, state = found["wheels"], found["state"]
    load = D.mass * G * (B * math.cos(angle) - D.cg_height * math.sin(angle)) / L
    pulled = D.mass * G * (math.sin(angle) + D.rolling_resistance * math.cos(angle))
    top, stiff = SHEET.masses.friction_along, SHEET.masses.stiffness_along
    force = abs(pulled) / (top * load)
    kappa = math.copysign(3.0 * top / stiff * (1.0 - (1.0 - force) ** (1 / 3)), pulled)
    assert wheels.load == pytest.approx(load, rel=0.02)
    assert wheels.traction == pytest.approx(pulled, rel=0.02, abs=200.0)
    assert wheels.slip == pytest.approx(kappa, rel=0.05)
    assert wheels.speed == pytest.approx(state.speed * (1.0 + kappa), rel=0.002)
    climbed = abs(math.sin(angle)) * D.mass * G / (top * load)
    lost = math.copysign(3.0 * top / stiff * (1.0 - (1.0 - climbed) ** (1 / 3)), percent)
    assert state.speed == pytest.approx(2.0 / (1.0 + lost), rel=1e-3)


def test_it_drives_the_same_whether_it_tells_its_wheels_or_not():
    told, silent = make(slope(0.05), wheel_slip=True), make(slope(0.05))
    assert [p.name for p in silent.outputs] == ["state"]
    a, b = run(told, 2.0, steer=0.1), run(silent, 2.0, steer=0.1)
    assert a[-1].pose.position.tolist() == b[-1].pose.position.tolist()


@pytest.mark.parametrize(("gradient", "name"), [(-2.0, "lexion-700"), (3.0, "grain-truck")])
def test_understeer_gradient_is_the_angle_per_lateral_acceleration(name, gradient):
    """Beyond atan(L kappa) a steady turn asks for K times the lateral acceleration."""
    machine = replace(load_machine(name), trailer=None, hitch=None)
    steer = math.radians(0.5)
    found = []
    for speed in (2.0, 5.0):
        motion = make(
            machine=machine, understeer_deg_per_g=gradient, rolling_resistance=0.0, friction=1.5,
            start_speed_kmh=speed * 3.6,
        )  # fmt: skip
        turn = run(motion, 15.0, steer=steer, speed=speed)[-1].yaw_rate
        found.append(
            (turn * speed / 9.80665, math.degrees(steer - math.atan(machine.wheelbase * turn / speed)))
        )
    for lateral, angle in found:
        assert angle == pytest.approx(gradient * lateral, rel=0.03)


def test_an_understeer_that_no_tyre_gives_is_refused():
    with pytest.raises(InputError, match=r"understeer_deg_per_g = 19.*expected at most"):
        make(understeer_deg_per_g=19.0, stiffness_per_rad=10.0)


@pytest.mark.parametrize("machine", ["lexion-700", "grain-truck"])
@pytest.mark.parametrize("seed", range(2))
def test_a_step_is_that_of_its_substeps(machine, seed):
    """To the bit, on rough ground over several pages, forwards, backwards and standing."""
    draw = np.random.default_rng(seed)
    field = made_field(terrain=formula.Params(slope_percent=6.0, roughness_class="E"))
    sheet, parts, t = load_machine(machine), int(draw.choice([1, 2, 4])), 0
    whole, fine = make(field, sheet, substep_ms=20.0 / parts), make(field, sheet)
    for _ in range(60):
        steer, speed = float(draw.uniform(-0.6, 0.6)), float(draw.choice([-2.0, 0.0, 0.4, 3.0, 50.0, -0.0]))
        inputs = {"steering": SteerState(t, steer, 0.0), "speed": SpeedCommand(t, speed)}
        for _ in range(10):
            state, dt = whole.step(t, 20_000_000, inputs)["state"], 20_000_000 // parts
            for k in range(parts):
                last = fine.step(t + k * dt, dt, inputs)["state"]
            t += 20_000_000
            assert sample_bytes("m", "state", t, state) == sample_bytes("m", "state", t, last)
        if draw.random() < 0.2:
            whole.load(whole.save())
    assert whole.axle_loads == fine.axle_loads
