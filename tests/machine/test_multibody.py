"""The multibody machine alone: masses, loads, energy, brakes, soil, saved states."""

import math
import sys
from dataclasses import fields, replace

import numpy as np
import pytest

from swath.core.errors import InputError, MissingExtra
from swath.machine.machine_sheet import load_machine, masses_of, with_grain
from swath.machine.motion.multibody import Multibody, Params
from swath.machine.multibody.model import parts_of
from swath.signals import EngineState, HeaderState, MachineLoad, SpeedCommand, SteerState
from tests.machine.machine_fakes import STREAM, Ground, drive, site, slope

mujoco = pytest.importorskip("mujoco", reason="needs the extra `multibody`")
SHEET = load_machine("lexion-700")
D = SHEET.dynamics
G = 9.81


def make(ground=None, machine=SHEET, **params):
    motion = Multibody(Params(**params), site(ground, machine))
    motion.reset(STREAM)
    return motion


def run(motion, seconds, *, steer=0.0, speed=2.0, dt=0.01, **more):
    return drive(
        motion, seconds, dt=dt, steering=SteerState(0, steer, 0.0), speed=SpeedCommand(0, speed), **more
    )


@pytest.mark.parametrize("name", ["lexion-700", "combine-5m"])
def test_the_parts_add_up_to_the_sheet(name):
    """Mass, centre of gravity and inertia as the engine itself adds them up."""
    machine = load_machine(name)
    motion = make(machine=machine)
    d, m = machine.dynamics, masses_of(machine)
    mujoco.mj_resetData(motion.model, motion.data)
    mujoco.mj_forward(motion.model, motion.data)
    full = np.zeros((motion.model.nv, motion.model.nv))
    mujoco.mj_fullM(motion.model, motion.data, full)
    np.testing.assert_allclose(np.diag(full)[:3], d.mass, rtol=1e-6)
    centre = motion.data.subtree_com[motion.model.body("chassis").id]
    np.testing.assert_allclose(centre, [-d.cg_behind, 0.0, d.cg_height], atol=1e-6)
    x2, z2 = d.cg_behind**2, d.cg_height**2
    about_origin = [m.roll_inertia + d.mass * z2, m.pitch_inertia + d.mass * (x2 + z2)]
    about_origin.append(d.yaw_inertia + d.mass * x2)
    np.testing.assert_allclose(np.diag(full)[3:6], about_origin, rtol=1e-6)


def test_parts_that_leave_no_chassis_are_refused():
    heavy = replace(SHEET, masses=replace(SHEET.masses, header=19000.0))
    with pytest.raises(InputError, match="bodies"):
        parts_of(heavy)
    wide = replace(SHEET, masses=replace(SHEET.masses, roll_inertia=1000.0))
    with pytest.raises(InputError, match="inertia"):
        parts_of(wide)
    with pytest.raises(InputError, match="bodies"):
        masses_of(replace(SHEET, masses=None))


@pytest.mark.parametrize("params", [{}, {"header": False}, {"suspension": True, "grain_kg": 4000.0}])
def test_the_wheels_carry_the_weight(params):
    motion = make(**params)
    run(motion, 3.0, speed=0.0)
    mass = D.mass + params.get("grain_kg", 0.0) - (3600.0 if params.get("header") is False else 0.0)
    assert motion.mass == pytest.approx(mass, rel=1e-3)
    assert sum(motion.wheels.loads) == pytest.approx(motion.mass * G, rel=5e-4)
    if not params:
        rear = motion.wheels.loads[2] + motion.wheels.loads[3]
        assert rear == pytest.approx(D.mass * G * D.cg_behind / SHEET.wheelbase, rel=1e-4)


def test_a_filling_tank_sinks_into_the_tyres_and_loads_both_axles():
    """Loads by the moments of a rigid body; deflection of a round bed of springs goes with load^(2/3)."""
    motion, mass = make(start_speed_kmh=5.0), []
    for i in range(200):
        load = MachineLoad(0, 40.0 * i, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        run(motion, 0.01, speed=1.0, load=load)
        mass.append(motion.mass)
    state = run(motion, 5.0, speed=0.0, load=load)[-1]
    full = with_grain(SHEET, 7960.0).dynamics
    assert motion.mass == pytest.approx(D.mass + 7960.0, abs=1.0)
    assert np.all(np.diff(mass) >= 0.0)
    front, rear = sum(motion.wheels.loads[:2]), sum(motion.wheels.loads[2:])
    assert front + rear == pytest.approx(full.mass * G, rel=1e-3)
    assert rear == pytest.approx(full.mass * G * full.cg_behind / SHEET.wheelbase, rel=5e-3)
    bare = D.mass * G * (1 - D.cg_behind / SHEET.wheelbase)
    sunk = masses_of(SHEET).front_deflection * ((front / bare) ** (2 / 3) - 1.0)
    assert -state.pose.position[2] == pytest.approx(sunk, rel=0.1)


@pytest.mark.parametrize(
    ("steer", "params"),
    [
        (0.3, {}),
        (0.0, {"rolling_resistance": 0.0}),
        (0.3, {"suspension": True}),
        (0.3, {"soil": "brixius", "cone_index_kpa": 600.0}),
    ],
)
def test_no_energy_appears_with_the_engine_off(params, steer):
    """On flat ground; what the springs of the tyres along and across give back is the tolerance."""
    motion = make(engine=False, start_speed_kmh=14.4, **params)
    energy = [motion.energy()]
    for _ in range(400):
        run(motion, 0.02, steer=steer)
        energy.append(motion.energy())
    kinetic = 0.5 * D.mass * 4.0**2
    gained = np.array(energy) - np.minimum.accumulate(energy)
    assert gained.max() < 5e-4 * kinetic
    assert max(energy) < energy[0] + 1e-6 * kinetic
    if params.get("rolling_resistance") != 0.0:
        assert energy[-1] < energy[0] - 0.5 * kinetic


@pytest.mark.parametrize("params", [{}, {"soil": "brixius", "cone_index_kpa": 900.0}])
def test_rolls_out_by_the_rolling_resistance(params):
    """Deceleration by hand: drag of the four loads, against the mass with its turning wheels."""
    motion = make(engine=False, start_speed_kmh=14.4, **params)
    run(motion, 1.0)
    first = run(motion, 0.01)[-1].speed
    last = run(motion, 2.0)[-1].speed
    wheels = motion.wheels.wheels
    radii = [w.rolling_radius for w in wheels]
    drag = sum(n * w.soil.at(n, 0.015).drag for n, w in zip(motion.wheels.loads, wheels, strict=True))
    inertia = motion.model.body_inertia[motion.bodies].max(axis=1)
    moved = D.mass + sum(i / r**2 for i, r in zip(inertia, radii, strict=True))
    assert (first - last) / 2.0 == pytest.approx(drag / moved, rel=0.03)


def test_mobility_number_and_resistance_of_soft_soil():
    """Brixius by hand for the front tyre, and no wheel finds more grip on softer soil."""
    m = masses_of(SHEET)
    b, d, load = D.front.patch_width, 2 * (D.front.radius + m.front_deflection), 80e3
    motion = make(soil="brixius", cone_index_kpa=900.0)
    soil = motion.wheels.wheels[0].soil
    bent = 1 + 5 * m.front_deflection * load / soil.load / m.front_section
    bn = 900e3 * b * d / load * bent / (1 + 3 * b / d)
    grip = soil.at(load, 0.1)
    assert soil.mobility(load) == pytest.approx(bn, rel=1e-9)
    assert grip.drag == pytest.approx(1 / bn + 0.04 + 0.05 / math.sqrt(bn), rel=1e-9)
    assert grip.along_top == pytest.approx(0.88 * (1 - math.exp(-0.1 * bn)), rel=1e-9)
    softer = make(soil="brixius", cone_index_kpa=450.0).wheels.wheels[0].soil.at(load, 0.1)
    assert softer.drag > grip.drag
    assert softer[:4] < grip[:4]


def test_soft_soil_makes_it_slip_uphill():
    speeds = {}
    for index in (1800.0, 450.0):
        motion = make(slope(0.08, 0.0), soil="brixius", cone_index_kpa=index, start_speed_kmh=7.2)
        speeds[index] = run(motion, 5.0)[-1].speed
    assert 1.9 < speeds[1800.0] < 2.0
    assert speeds[450.0] < speeds[1800.0] - 0.04


def test_the_rear_axle_swings_without_rolling_the_body():
    """Ground that rises to the left behind the machine only: the front axle sets the roll."""
    twisted = Ground(lambda x, y: 0.08 * np.asarray(y) * (np.asarray(x) < -2.0))
    motion = make(twisted)
    state = run(motion, 3.0, speed=0.0)[-1]
    swing = float(motion.data.qpos[motion.model.joint("pendulum").qposadr[0]])
    assert swing == pytest.approx(math.atan(0.08), rel=0.05)
    assert abs(state.pose.euler()[0]) < math.radians(0.3)
    blocked = Ground(lambda x, y: 0.25 * np.asarray(y) * (np.asarray(x) < -2.0))
    motion = make(blocked)
    state = run(motion, 3.0, speed=0.0)[-1]
    swing = float(motion.data.qpos[motion.model.joint("pendulum").qposadr[0]])
    assert swing == pytest.approx(masses_of(SHEET).pendulum, abs=math.radians(1.0))
    assert state.pose.euler()[0] > math.radians(0.5)


def test_parked_on_a_slope_it_stays():
    motion = make(slope(0.05, 0.1))
    start = motion.data.qpos[:3].copy()
    states = run(motion, 11.0, steer=0.3, speed=0.0)
    assert np.linalg.norm(states[-1].pose.position - start) < 0.02
    assert np.linalg.norm(states[-1].pose.position - states[-300].pose.position) < 1e-6


def test_brakes_to_a_stop_and_holds_on_a_slope():
    motion = make(slope(0.1, 0.0), start_speed_kmh=7.2)
    run(motion, 1.0)
    run(motion, 9.0, speed=0.0)
    first, *_, last = run(motion, 3.0, speed=0.0)
    assert np.linalg.norm(last.pose.position - first.pose.position) < 1e-3
    start = last.pose.position[0]
    states = run(motion, 6.0, speed=2.0)
    assert states[-1].speed == pytest.approx(2.0, abs=0.1)
    assert min(s.pose.position[0] for s in states) > start - 1e-3  # it does not roll back


def test_the_engine_limits_the_speed():
    engine = EngineState(0, **{k: 1.0 for k in (f.name for f in fields(EngineState)) if k != "t"})
    assert run(make(start_speed_kmh=3.6), 6.0, drive=engine)[-1].speed == pytest.approx(1.0, abs=0.02)


def test_a_raised_header_shifts_the_load_as_its_lever_says():
    """The header hangs below the pivot: raised by 40 deg its mass is farther ahead."""
    motion, m, lift = make(), masses_of(SHEET), math.radians(40.0)
    rear = sum(motion.wheels.loads[2:])
    motion.hold_header(lift, 0.0)
    run(motion, 4.0, speed=0.0)
    x, z = m.header_x - m.feeder_x, m.header_z - m.feeder_z
    ahead = (m.header + 0.5 * m.feeder) * (x * math.cos(lift) - z * math.sin(lift) - x)
    assert ahead > 400.0
    assert sum(motion.wheels.loads[2:]) - rear == pytest.approx(-ahead * G / SHEET.wheelbase, rel=0.05)
    motion.hold_header(0.0, math.radians(5.0))
    run(motion, 4.0, speed=0.0)
    assert sum(motion.wheels.loads) == pytest.approx(motion.mass * G, rel=1e-3)


def header_at(lift, tilt):
    return HeaderState(0, np.zeros(3), np.zeros(4), 0.15, 0.05, lift, tilt, 0.0)


def test_the_weight_of_the_header_goes_where_the_header_control_holds_it():
    """By hand: header and feeder turn about the feeder's pivot, their weight moves along x."""
    motion, m, lift = make(), masses_of(SHEET), 0.3
    run(motion, 4.0, speed=0.0, header=header_at(0.0, 0.0))
    front, rear = sum(motion.wheels.loads[:2]), sum(motion.wheels.loads[2:])
    run(motion, 4.0, speed=0.0, header=header_at(lift, 0.0))
    moved = 0.0
    for mass, share in ((m.header, 1.0), (m.feeder, 0.5)):
        x, z = share * (m.header_x - m.feeder_x), share * (m.header_z - m.feeder_z)
        moved += mass * (x * math.cos(lift) - z * math.sin(lift) - x)
    assert abs(moved) > 100.0
    more = moved * G / SHEET.wheelbase
    assert sum(motion.wheels.loads[:2]) - front == pytest.approx(more, rel=0.02)
    assert sum(motion.wheels.loads[2:]) - rear == pytest.approx(-more, rel=0.02)
    # tilted about its centre of gravity nothing moves
    before = list(motion.wheels.loads)
    run(motion, 4.0, speed=0.0, header=header_at(lift, math.radians(5.0)))
    np.testing.assert_allclose(motion.wheels.loads, before, rtol=1e-3)
    assert motion.save()["header"] == (lift, math.radians(5.0))


def test_left_and_right_mirror():
    left, right = (
        run(make(slope(0.02, s * 0.05), start_speed_kmh=5.0), 3.0, steer=s * 0.3)[-1] for s in (1, -1)
    )
    assert left.yaw_rate == pytest.approx(-right.yaw_rate, abs=1e-12)
    assert left.lateral_speed == pytest.approx(-right.lateral_speed, abs=1e-12)
    np.testing.assert_allclose(left.pose.position * [1, -1, 1], right.pose.position, atol=1e-10)


@pytest.mark.parametrize(("params", "speed"), [({}, 0.0), ({"suspension": True, "soil": "brixius"}, 2.0)])
def test_saved_state_goes_on_byte_for_byte(params, speed):
    """On rough ground, with a filling tank, into another copy that has been elsewhere."""
    rough = Ground(lambda x, y: 0.1 * np.sin(1.3 * x) * np.cos(0.7 * y) + 0.05 * np.sin(0.2 * x))
    one, two = make(rough, start_speed_kmh=4.0, **params), make(rough, **params)
    run(two, 0.5, steer=-0.2)
    load = [MachineLoad(0, g, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for g in (900.0, 900.5, 1700.0)]
    run(one, 2.0, steer=0.2, load=load[0])
    one.hold_header(0.1, 0.02)
    run(one, 0.1, steer=0.2, speed=speed, load=load[1])
    kept = one.save()
    first = run(one, 1.5, steer=-0.1, speed=speed, load=load[2])
    two.load(kept)
    second = run(two, 1.5, steer=-0.1, speed=speed, load=load[2])
    for a, b in zip(first, second, strict=True):
        assert a.pose.position.tobytes() == b.pose.position.tobytes()
        assert a.pose.rotation.tobytes() == b.pose.rotation.tobytes()
        assert (a.speed, a.lateral_speed, a.yaw_rate) == (b.speed, b.lateral_speed, b.yaw_rate)
        assert a.distance == b.distance
    for a, b in zip(one.wheels.save().values(), two.wheels.save().values(), strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()


def test_a_second_reset_starts_anew():
    motion = make(slope(0.02, 0.05), start_speed_kmh=3.0)
    fresh = motion.save()
    run(motion, 1.0, steer=0.2, load=MachineLoad(0, 5000.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    motion.hold_header(0.1, 0.1)
    motion.reset(STREAM)
    assert motion.mass == pytest.approx(D.mass, rel=1e-6)
    assert motion.save()["mujoco"].tobytes() == fresh["mujoco"].tobytes()


def test_the_step_size_hardly_enters():
    ends = []
    for ms in (5.0, 2.5, 1.25):
        state = run(make(substep_ms=ms, start_speed_kmh=10.8), 3.0, steer=0.2, speed=3.0)[-1]
        ends.append([*state.pose.position[:2], state.yaw_rate])
    coarse, middle, fine = np.array(ends)
    assert np.abs(coarse - fine)[:2].max() < 0.02
    assert np.abs(middle - fine)[:2].max() < 0.6 * np.abs(coarse - fine)[:2].max()
    assert abs(middle[2] - fine[2]) < 1e-4


@pytest.mark.parametrize(("speed", "degrees"), [(5.0, 28.0), (2.0, 42.0)])
def test_keeps_on_its_wheels_at_the_edge(speed, degrees):
    state = run(make(start_speed_kmh=3.6 * speed), 5.0, steer=math.radians(degrees), speed=speed)[-1]
    assert abs(state.pose.euler()[0]) < math.radians(5.0)
    assert 0.5 * speed < state.speed < 1.05 * speed


def test_without_mujoco_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtra, match=r"swath\[multibody\]"):
        Multibody(Params(), site())
