"""Motion level `multibody`: bodies, joints and four wheels on rough ground, stepped by MuJoCo.

Chassis with six degrees of freedom, rear pendulum axle with two kingpins after Ackermann, spinning wheels,
feeder and header as masses, grain that shifts the centre of gravity. Equations: docs/explanation/machine.md.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import atan2, ceil, fsum, hypot, tan
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port, State
from swath.core.errors import Extra, InputError
from swath.core.frames import Pose, rotation_of
from swath.core.portable import product
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG_PER_G, KMH, MS
from swath.field.site_setup import SiteSetup
from swath.machine.attitude import TerrainFollower
from swath.machine.loops import SpeedLoop, within_drive
from swath.machine.machine_sheet import Axle, MachineSheet, dynamics_of, masses_of
from swath.machine.motion import ON_SOIL
from swath.machine.multibody.model import LEAST, WHEELS, mjcf
from swath.machine.multibody.wheels import Wheel, Wheels
from swath.machine.on_soil import OnSoil, OnTyres, met_by, soil_of
from swath.machine.soil import Brixius, Firm, Grip
from swath.machine.towing import DRIVEN
from swath.machine.tyre import GRAVITY, axle_stiffness
from swath.signals import HeaderState, MachineLoad, MachineState

LOOK = 0.01  # the ground under the wheels is read this often [s]
DRIVE_FREQUENCY, DRIVE_DAMPING = 70.0, 0.4  # of a driven or locked wheel on oil and shafts [rad/s, ratio]
GRAIN_STEP = 1.0  # the model's masses follow the tank in steps of this [kg]
SETTLE = 600  # steps in which the machine sinks into its tyres at the start
SETTLE_STEP = 0.0025  # [s]


@dataclass(frozen=True)
class Params(OnTyres):
    """A vehicle of several bodies; what is left out comes from the machine's sheet.

    suspension: whether the front axle is sprung
    header: whether the header is fitted
    engine: whether the engine drives and brakes; without it all wheels roll freely
    grain_kg: grain in the tank at t = 0, where the input `load` is not connected
    start_speed_kmh: speed at t = 0
    substep_ms: longest integration step
    """

    suspension: bool = False
    header: bool = True
    engine: bool = True
    grain_kg: Annotated[float, Ge(0), Le(50000)] = 0.0
    start_speed_kmh: Annotated[float, Ge(0), Le(40)] = 0.0
    substep_ms: Annotated[float, Ge(0.01), Le(5)] = 2.5


class Multibody(KeepsState):
    """Rear-steered machine of rigid bodies. The steering angle is held over a step."""

    kept = ("wheels", "_soil", "_grain", "_aim", "_parked", "_angles", "_header", "_distance", "_unseen")

    inputs = (*DRIVEN, Port("load", MachineLoad, optional=True), Port("header", HeaderState, optional=True))
    outputs = (Port("state", MachineState),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        mujoco = _engine()
        machine = setup.machine
        d, masses = dynamics_of(machine), masses_of(machine)
        assert isinstance(machine, MachineSheet)
        self._mj, self._params, self._start = mujoco, params, setup.start
        self._wheelbase, self._tank = machine.wheelbase, masses.tank
        self._kingpin = 0.5 * machine.rear_track - masses.kingpin
        self._follower = TerrainFollower(setup.field, machine)
        self._loop = SpeedLoop(d)
        self._soil = soil_of(setup.field, machine, params)
        wheels = wheels_of(machine, params, self._soil)
        self.wheels = Wheels(setup.field, wheels, None if self._soil is None else self._soil.soil)
        self._radius = wheels[0].rolling_radius
        self._thrust, self._brake = (0.5 * f * d.front.radius for f in (masses.thrust, masses.brake))
        text = mjcf(machine, header=params.header, suspension=params.suspension)
        try:
            self.model = mujoco.MjModel.from_xml_string(text)
        except ValueError as error:  # what MuJoCo takes for no body; it ends with `Element name 'x', ...`
            part = str(error).partition("Element name '")[2].partition("'")[0].replace("_", " ")
            expected = f"expected masses and sizes that make a body of each part, also of {part}"
            raise InputError("machine", machine.name, expected) from error
        self.data, self._spare = mujoco.MjData(self.model), mujoco.MjData(self.model)
        self._find()

    def meets(self, state: MachineState) -> Mapping[str, Any]:
        """The soil under it."""
        return met_by(self._soil, state)

    def _find(self) -> None:
        """Numbers of bodies and joints in the model."""
        m = self.model
        self.bodies = np.array([m.body(n).id for n in WHEELS])
        self._carriers = m.body_parentid[self.bodies]
        self._spin = np.array([m.joint(n).dofadr[0] for n in WHEELS])
        self._spin_q = np.array([m.joint(n).qposadr[0] for n in WHEELS[:2]])
        driven = ("kingpin_left", "kingpin_right", "lift", "tilt")
        self._driven = np.array([m.joint(n).dofadr[0] for n in driven])
        self._driven_q = np.array([m.joint(n).qposadr[0] for n in driven])
        self._chassis, self._grain_body = m.body("chassis").id, m.body("grain").id
        inertia = float(m.body_inertia[self.bodies[0]][1])
        self._drive_rate = inertia * DRIVE_FREQUENCY**2
        self._drive_damping = 2.0 * DRIVE_DAMPING * inertia * DRIVE_FREQUENCY

    def reset(self, stream: Stream) -> Outputs:
        """Stand (or roll straight) at the start pose, sunk into the tyres."""
        mj, d, p = self._mj, self.data, self._params
        mj.mj_resetData(self.model, d)
        self.wheels.reset()
        self._fill(p.grain_kg, force=True)
        self._header, self._distance = (0.0, 0.0), 0.0
        self._aim, self._parked, self._unseen = 0.0, True, LOOK
        self._angles = [0.0, 0.0]
        x, y = float(self._start.position[0]), float(self._start.position[1])
        yaw = self._start.euler()[2]
        self._follower.at(x, y, yaw)
        pose = self._follower.pose()
        qx, qy, qz, qw = pose.quaternion()
        d.qpos[:3], d.qpos[3:7] = pose.position, (qw, qx, qy, qz)
        self._settle(x, y)
        self._roll(p.start_speed_kmh * KMH)
        return self._output(0, 0.0)

    def _settle(self, x: float, y: float) -> None:
        """Let the machine sink until it rests; then back to x, y [m]."""
        for _ in range(SETTLE):
            self._substep(SETTLE_STEP, 0.0)
            self.data.qvel *= 0.96
        self.data.qvel[:] = 0.0
        self.data.qpos[:2] = x, y
        self._unseen = LOOK

    def _roll(self, speed: float) -> None:
        """Move straight on at a speed [m/s]."""
        if speed == 0.0 and self._params.engine:
            return
        d = self.data
        self._aim = speed
        d.qvel[:3] = speed * self._rotation()[:, 0]
        radii = np.array([w.rolling_radius for w in self.wheels.wheels])
        d.qvel[self._spin] = speed / radii

    def hold_header(self, lift: float, tilt: float) -> None:
        """Set the header: feeder raised by `lift`, header turned by `tilt` (left side up) [rad]."""
        self._header = lift, tilt

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Integrate over dt in equal substeps."""
        steer: float = inputs["steering"].angle
        wanted = within_drive(inputs["speed"].speed, inputs.get("drive"))
        load: MachineLoad | None = inputs.get("load")
        if load is not None:
            self._fill(max(load.tank_grain, 0.0))
        header: HeaderState | None = inputs.get("header")
        if header is not None:
            self.hold_header(header.lift, header.tilt)
        count = max(1, ceil(dt / NS / (self._params.substep_ms * MS) - 1e-9))
        h = dt / NS / count
        self.data.qpos[self._driven_q] = (*self._ackermann(steer), *self._header)
        self.data.qvel[self._driven] = 0.0
        before = self._ground_speed()
        for _ in range(count):
            self._substep(h, wanted)
        self._distance += 0.5 * (before + self._ground_speed()) * dt / NS
        if self._soil is not None:
            (x, y), yaw = self.data.qpos[:2].tolist(), _yaw(self._rotation())
            loads = self.wheels.loads
            self._soil.roll(x, y, yaw, (loads[0] + loads[1], loads[2] + loads[3]))
        return self._output(t + dt, steer)

    def save(self) -> State:
        """MuJoCo's integration state, tyre slips, drive, brake, header, grain."""
        kind = self._mj.mjtState.mjSTATE_INTEGRATION
        kept = np.empty(self._mj.mj_stateSize(self.model, kind))
        self._mj.mj_getState(self.model, self.data, kept, kind)
        return {**super().save(), "mujoco": kept}

    def load(self, state: State) -> None:
        """Take on a state that `save` gave."""
        self._fill(state["grain"], force=True)
        kind = self._mj.mjtState.mjSTATE_INTEGRATION
        self._mj.mj_setState(self.model, self.data, state["mujoco"], kind)
        super().load(state)

    def _ackermann(self, steer: float) -> tuple[float, float]:
        """Angles of the left and the right wheel about their kingpins [rad] for a single-wheel angle."""
        rise, arm = self._wheelbase * tan(steer), self._kingpin * tan(steer)
        return atan2(-rise, self._wheelbase - arm), atan2(-rise, self._wheelbase + arm)

    def _fill(self, grain: float, *, force: bool = False) -> None:
        """Put so much grain [kg] into the tank."""
        if not force and abs(grain - getattr(self, "_grain", -9.0)) < GRAIN_STEP:
            return
        m, body, tank = self.model, self._grain_body, self._tank
        self._grain = grain
        mass, height = grain + LEAST, 2.0 * (tank.centre(grain) - tank.floor)
        l2, w2, h2 = tank.length**2, tank.width**2, height**2
        m.body_mass[body] = mass
        m.body_ipos[body] = (0.0, 0.0, 0.5 * height)
        m.body_inertia[body] = np.array([w2 + h2, l2 + h2, l2 + w2]) * mass / 12.0
        self._mj.mj_setConst(m, self._spare)

    def _substep(self, h: float, wanted: float) -> None:
        mj, m, d = self._mj, self.model, self.data
        m.opt.timestep = h
        mj.mj_step1(m, d)
        middles, axes = d.xpos[self.bodies], d.xmat[self.bodies][:, 1::3]
        if self._unseen >= LOOK - 1e-9:
            self._unseen = 0.0
            self.wheels.look(middles, axes)
        self._unseen += h
        motion = d.cvel[self._carriers]
        turns, arms = motion[:, :3], middles - d.subtree_com[self._chassis]
        speeds = motion[:, 3:] + _cross(turns, arms)
        spins = d.qvel[self._spin].tolist()
        d.xfrc_applied[self.bodies] = self.wheels.push(h, middles, axes, speeds, turns, spins)
        d.qfrc_applied[self._spin[:2]] = self._drive(h, wanted, spins)
        mj.mj_step2(m, d)

    def _drive(self, h: float, wanted: float, spins: list[float]) -> tuple[float, float]:
        """Torques on the driven wheels [N m]: hydrostat behind a differential, or the parking brake.

        A hydrostat sets the angle that the wheels turn through; oil and shafts give like a spring.
        """
        if not self._params.engine:
            return 0.0, 0.0
        self._aim, travel = self._loop.advance(self._aim, wanted, h)
        left, right = self.data.qpos[self._spin_q].tolist()
        if wanted != 0.0 or abs(self._aim) > 1e-3:
            if self._parked:
                self._parked, self._angles = False, [0.5 * fsum(self._angles)] * 2
            middle, spin = 0.5 * (left + right), 0.5 * (spins[0] + spins[1])
            slide = self._aim / self._radius - spin
            off, torque = self._spring(self._angles[0] - middle, slide, self._thrust)
            self._angles[0] = middle + off + travel / self._radius
            return torque, torque
        if not self._parked:
            held = self._angles[0] - 0.5 * (left + right)
            self._parked, self._angles = True, [left + held, right + held]
        off_left, torque_left = self._spring(self._angles[0] - left, -spins[0], self._brake)
        off_right, torque_right = self._spring(self._angles[1] - right, -spins[1], self._brake)
        self._angles = [left + off_left, right + off_right]
        return torque_left, torque_right

    def _spring(self, off: float, slide: float, most: float) -> tuple[float, float]:
        """Angle and torque of one wheel's drive; beyond the torque `most` [N m] it slips."""
        off = min(max(off, -most / self._drive_rate), most / self._drive_rate)
        torque = self._drive_rate * off + self._drive_damping * slide
        return off, min(max(torque, -most), most)

    def _rotation(self) -> Any:
        w, x, y, z = self.data.qpos[3:7].tolist()
        return rotation_of(x, y, z, w)

    def _ground_speed(self) -> float:
        return hypot(self.data.qvel[0], self.data.qvel[1])

    def _output(self, t: int, steer: float) -> Outputs:
        d, rotation = self.data, self._rotation()
        pose = Pose(d.qpos[:3].copy(), rotation)
        forward, left, _ = product(d.qvel[:3], rotation).tolist()
        turn = product(rotation, d.qvel[3:6])
        yaw_rate = _yaw_rate(rotation, turn)
        return {"state": MachineState(t, pose, forward, left, yaw_rate, steer, self._distance)}

    def energy(self) -> float:
        """Kinetic energy, gravity and the vertical tyre springs [J]; not the slip of the tyres."""
        mj, m, d = self._mj, self.model, self.data
        mj.mj_fwdPosition(m, d)
        mj.mj_energyPos(m, d)
        mj.mj_energyVel(m, d)
        middles, axes = d.xpos[self.bodies], d.xmat[self.bodies][:, 1::3]
        return float(d.energy.sum()) + self.wheels.energy(middles, axes)

    @property
    def mass(self) -> float:
        """Mass of the whole machine [kg]."""
        return float(self.model.body_mass.sum())


def wheels_of(machine: MachineSheet, params: Params, on: OnSoil | None = None) -> list[Wheel]:
    """The four wheels (front left, front right, rear left, rear right) on their soil."""
    d, m = dynamics_of(machine), masses_of(machine)
    share = d.cg_behind / machine.wheelbase
    loads = (0.5 * d.mass * GRAVITY * (1.0 - share), 0.5 * d.mass * GRAVITY * share)
    given = params.understeer_deg_per_g
    fixed, steered = axle_stiffness(
        d.stiffness if params.stiffness_per_rad is None else params.stiffness_per_rad,
        d.understeer if given is None else given * DEG_PER_G,
        steers_ahead=machine.steers_ahead,
    )
    tyres = (None, None) if on is None else on.tyres
    front = _wheel(machine, params, d.front, fixed, loads[0], m.front_deflection, tyres[0])
    rear = _wheel(machine, params, d.rear, steered, loads[1], m.rear_deflection, tyres[1])
    return [front, front, rear, rear]


def _wheel(
    machine: MachineSheet,
    params: Params,
    axle: Axle,
    stiffness: float,
    load: float,
    deflection: float,
    tyre: Brixius | None,
) -> Wheel:
    d, m = dynamics_of(machine), masses_of(machine)
    grip = Grip(
        stiffness,
        m.stiffness_along,
        d.friction if params.friction is None else params.friction,
        m.friction_along,
        d.rolling_resistance if params.rolling_resistance is None else params.rolling_resistance,
    )
    radius = axle.radius + deflection
    soil: Firm | Brixius = Firm(grip, load, m.load_sensitivity)
    if tyre is not None:
        soil = replace(tyre, grip=grip)
    return Wheel(radius, axle.patch_width, axle.relaxation, load, deflection, m.tyre_damping, soil)


def _yaw(rotation: Any) -> float:
    return atan2(float(rotation[1, 0]), float(rotation[0, 0]))


def _yaw_rate(rotation: Any, turn: Any) -> float:
    """Rate of the heading (atan2 of the x axis) for a turn rate in the world [rad/s]."""
    x, y, z = rotation[:, 0].tolist()
    ox, oy, oz = turn.tolist()
    dx, dy = oy * z - oz * y, oz * x - ox * z
    return float((x * dy - y * dx) / (x * x + y * y))


def _cross(a: Any, b: Any) -> Any:
    """Row-wise cross product; faster than numpy's for few rows."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def _engine() -> Any:
    with Extra("multibody", "motion level multibody"):
        import mujoco
    mujoco.set_mju_user_warning(_warn)  # else it writes into the working folder
    return mujoco


def _warn(text: str) -> None:
    print(f"swath: MuJoCo: {text}", file=sys.stderr)


LEVEL = Level(
    Multibody,
    Params,
    summary="bodies, pendulum axle, four wheels with load shift on rough ground, grain in the tank (MuJoCo)",
    cost="about 210 us per 5 ms step, 24 times real time at 200 Hz",
    tolerance="loads, roll-out, crab within 0.1 to 3 % of hand calculation; no real machine measured",
    checked=ON_SOIL,
)
