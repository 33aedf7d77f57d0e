"""The machine as bodies and joints: an MJCF text made from the machine sheet.

Frame of the chassis: the machine frame (middle of the fixed axle, on the ground when the empty machine
stands). Total mass, centre of gravity and the three inertias are those of the sheet: the chassis is what the
other parts leave over. Joints that are driven (kingpins, feeder, header tilt) carry a huge armature: their
angle is set, what presses on them does not move them and goes into the next body.
"""

from dataclasses import dataclass
from math import fsum, pi

from swath.core.errors import InputError
from swath.machine.machine_sheet import MachineSheet, Masses, masses_of
from swath.machine.tyre import GRAVITY

DRIVEN = 1e12  # armature of a joint whose angle is set [kg m2]
LEAST = 1e-3  # mass of an empty tank [kg]
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
Vec = tuple[float, float, float]


@dataclass(frozen=True)
class Part:
    """A rigid part. mass [kg]; place: centre of gravity [m, machine frame]; inertia about it [kg m2]."""

    mass: float
    place: Vec
    inertia: Vec

    def about(self, point: Vec) -> Vec:
        """Inertia about the axes through a point (Steiner)."""
        x, y, z = (p - q for p, q in zip(self.place, point, strict=True))
        i = self.inertia
        return (
            i[0] + self.mass * (y * y + z * z),
            i[1] + self.mass * (x * x + z * z),
            i[2] + self.mass * (x * x + y * y),
        )


def parts_of(machine: MachineSheet, *, header: bool = True) -> dict[str, Part]:
    """All parts by name, `chassis` among them. InputError when they weigh more than the whole machine."""
    d, m = machine.dynamics, masses_of(machine)
    back, half_f, half_r = -machine.wheelbase, 0.5 * machine.front_track, 0.5 * machine.rear_track
    width, front, rear = machine.header_width, d.front.radius, d.rear.radius
    parts = {
        "header": Part(
            m.header,
            (m.header_x, machine.header_y, m.header_z),
            (m.header * width**2 / 12, 0.36 * m.header, m.header * (width**2 / 12 + 0.3)),
        ),
        "feeder": Part(
            m.feeder,
            (0.5 * (m.feeder_x + m.header_x), 0.0, 0.5 * (m.feeder_z + m.header_z)),
            (0.3 * m.feeder, 0.6 * m.feeder, 0.6 * m.feeder),
        ),
        "rear_axle": Part(
            0.8 * m.rear_axle,
            (back, 0.0, m.pivot_z),
            (0.8 * m.rear_axle * half_r**2 / 3, 30.0, 0.8 * m.rear_axle * half_r**2 / 3),
        ),
    }
    for side, sign in (("left", 1.0), ("right", -1.0)):
        parts[f"knuckle_{side}"] = Part(
            0.1 * m.rear_axle, (back, sign * (half_r - m.kingpin), rear), (5.0, 5.0, 5.0)
        )
        parts[f"front_{side}"] = Part(
            m.front_wheel, (0.0, sign * half_f, front), _wheel(m.front_wheel, front)
        )
        parts[f"rear_{side}"] = Part(m.rear_wheel, (back, sign * half_r, rear), _wheel(m.rear_wheel, rear))
    rest = _rest(machine, m, parts)
    if not header:
        parts["header"] = Part(LEAST, parts["header"].place, (LEAST, LEAST, LEAST))
    return {"chassis": rest, **parts}


def _wheel(mass: float, radius: float) -> Vec:
    """Ring and disc: 0.6 m r2 about the axle, 0.35 m r2 across."""
    return 0.35 * mass * radius**2, 0.6 * mass * radius**2, 0.35 * mass * radius**2


def _rest(machine: MachineSheet, m: Masses, parts: dict[str, Part]) -> Part:
    """The chassis: whole machine less its parts."""
    d = machine.dynamics
    whole = (-d.cg_behind, 0.0, d.cg_height)
    mass = d.mass - fsum(p.mass for p in parts.values())
    if mass <= 0.1 * d.mass:
        raise InputError("bodies", f"{d.mass - mass:g} kg", f"expected less than the whole, {d.mass:g} kg")
    x, y, z = (
        (d.mass * c - fsum(p.mass * p.place[i] for p in parts.values())) / mass for i, c in enumerate(whole)
    )
    taken = [p.about(whole) for p in parts.values()] + [Part(mass, (x, y, z), (0.0, 0.0, 0.0)).about(whole)]
    total = (m.roll_inertia, m.pitch_inertia, d.yaw_inertia)
    a, b, c = (t - fsum(p[i] for p in taken) for i, t in enumerate(total))
    if min(a, b, c, a + b - c, b + c - a, c + a - b) <= 0.0:
        shown = f"{a:.0f}, {b:.0f}, {c:.0f} kg m2 (roll, pitch, yaw) left for the chassis"
        raise InputError("mass.*_inertia_kg_m2", shown, "expected the inertias of a body")
    return Part(mass, (x, y, z), (a, b, c))


def mjcf(machine: MachineSheet, *, header: bool = True, suspension: bool = False) -> str:
    """The model as MJCF. Native contacts are off: the wheels are force elements (see wheels.py)."""
    m, parts = masses_of(machine), parts_of(machine, header=header)
    back = -machine.wheelbase
    pivot, feeder = (back, 0.0, m.pivot_z), (m.feeder_x, 0.0, m.feeder_z)
    front = _body("front_left", parts["front_left"], (0, 0, 0), SPIN) + _body(
        "front_right", parts["front_right"], (0, 0, 0), SPIN
    )
    if suspension:
        front = _axle(machine, m, parts, front)
    tool = _body("header", parts["header"], feeder, '<joint name="tilt" axis="1 0 0" class="driven"/>')
    lift = '<joint name="lift" axis="0 -1 0" class="driven"/>'
    knuckles = "".join(_knuckle(side, parts, pivot) for side in ("left", "right"))
    stop = f'<joint name="pendulum" axis="1 0 0" range="{-m.pendulum!r} {m.pendulum!r}" limited="true"/>'
    inside = (
        f'<body name="grain" pos="{m.tank.x!r} 0 {m.tank.floor!r}">'
        f'<inertial pos="0 0 0" mass="{LEAST!r}" diaginertia="{LEAST!r} {LEAST!r} {LEAST!r}"/></body>'
        + _body("feeder", parts["feeder"], (0, 0, 0), lift, tool, at=feeder)
        + front
        + _body("rear_axle", parts["rear_axle"], (0, 0, 0), stop, knuckles, at=pivot)
    )
    return (
        '<mujoco model="machine"><compiler angle="radian" autolimits="false"/>'
        f'<option integrator="implicitfast" gravity="0 0 {-GRAVITY!r}" jacobian="dense">'
        '<flag contact="disable"/></option>'
        f'<default><default class="driven"><joint armature="{DRIVEN!r}"/></default></default><worldbody>'
        + _body("chassis", parts["chassis"], (0, 0, 0), '<freejoint name="free"/>', inside, at=(0, 0, 0))
        + "</worldbody></mujoco>"
    )


SPIN = '<joint name="{name}" axis="0 1 0"/>'


def _body(name: str, part: Part, parent: Vec, joint: str, inside: str = "", *, at: Vec | None = None) -> str:
    """One body. parent: place of the parent's frame; at: of its own one, its centre of gravity by default."""
    at = part.place if at is None else at
    here = _text(*(a - b for a, b in zip(at, parent, strict=True)))
    centre = _text(*(a - b for a, b in zip(part.place, at, strict=True)))
    inertial = f'<inertial pos="{centre}" mass="{part.mass!r}" diaginertia="{_text(*part.inertia)}"/>'
    return f'<body name="{name}" pos="{here}">{joint.format(name=name)}{inertial}{inside}</body>'


def _knuckle(side: str, parts: dict[str, Part], pivot: Vec) -> str:
    part = parts[f"knuckle_{side}"]
    wheel = _body(f"rear_{side}", parts[f"rear_{side}"], part.place, SPIN)
    pin = f'<joint name="kingpin_{side}" axis="0 0 1" class="driven"/>'
    return _body(f"knuckle_{side}", part, pivot, pin, wheel)


def _axle(machine: MachineSheet, m: Masses, parts: dict[str, Part], wheels: str) -> str:
    """The front axle on springs: heave and roll. Its beam stays a part of the chassis."""
    d = machine.dynamics
    load = d.mass * GRAVITY * (1 - d.cg_behind / machine.wheelbase) - 2 * m.front_wheel * GRAVITY
    rate = load / GRAVITY * (2 * pi * m.ride_hz) ** 2
    damping = 2 * m.ride_damping * load / GRAVITY * 2 * pi * m.ride_hz
    arm = (0.35 * machine.front_track) ** 2
    beam = Part(1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    joints = (
        f'<joint name="heave" type="slide" axis="0 0 1" stiffness="{rate!r}" damping="{damping!r}" '
        f'springref="{-load / rate!r}"/>'
        f'<joint name="axle_roll" axis="1 0 0" pos="0 0 {d.front.radius!r}" stiffness="{rate * arm!r}" '
        f'damping="{damping * arm!r}"/>'
    )
    return _body("front_axle", beam, (0, 0, 0), joints, wheels)


def _text(*values: float) -> str:
    return " ".join(repr(float(v)) for v in values)
