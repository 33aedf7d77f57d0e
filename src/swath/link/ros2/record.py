"""Samples as stamped lists of named numbers: sensor_msgs/JointState with `name` and `position`.

ROS 2 has no message for a crop edge or for what is in a threshing drum. JointState is its one stamped list of
named float64 numbers; every number of a sample goes over it exactly, and viewers plot it by name. A name is
`port.field`, e.g. `edge.offset`, `odometry.speed`, `state.pose.yaw`, and `port.t_ns` for the time the sample
is valid for [ns]. Booleans are 0 and 1. A sample that does not exist has no names.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from swath.core.component import Port
from swath.core.errors import InputError, SwathError
from swath.signals import Signal
from swath.signals.flat import build, flat_fields, is_bulky, read
from swath.signals.setup import LinkSetup

AXES = ("x", "y", "z", "roll", "pitch", "yaw")


def numbers_of(prefix: str, sample: Signal) -> dict[str, float]:
    """Every number of a sample by name, with its time; an array as `name.0`, `name.1` ..."""
    found = {f"{prefix}.t_ns": float(sample.t)}
    for field in flat_fields(type(sample)).values():
        value = read(sample, field.name)
        if field.kind == "array":
            flat = np.ravel(value)
            found |= {f"{prefix}.{field.name}.{i}": float(v) for i, v in enumerate(flat)}
        else:
            found[f"{prefix}.{field.name}"] = float(value)
    return found


def numbers_of_inputs(inputs: Mapping[str, Any]) -> dict[str, float]:
    """Every number of a slot's inputs; of a scan or an image only its time, `scan.t_ns`.

    Of a port with history, `port.0.field` is the oldest sample's since the last step, and so on; `port.field`
    is the newest.
    """
    found: dict[str, float] = {}
    for port, value in inputs.items():
        samples = value if isinstance(value, tuple) else ((value,) if value is not None else ())
        if not samples:
            continue
        if is_bulky(type(samples[-1])):
            found[f"{port}.t_ns"] = float(samples[-1].t)
            continue
        found |= numbers_of(port, samples[-1])
        if isinstance(value, tuple):
            for index, sample in enumerate(samples):
                found |= numbers_of(f"{port}.{index}", sample)
    return found


def numbers_of_setup(setup: LinkSetup) -> dict[str, float]:
    """What a node gets first: geometry [m, rad], period [s], mountings of the sensors wired to the slot.

    The names of one mounting begin with `setup.mounting.`, of several with `setup.mounting.PORT.`; an
    inertial unit does not count and always is `setup.mounting.inertial.`.
    """
    control = setup.control
    names = ("wheelbase", "front_track", "rear_track", "max_steer", "header_width", "knife_x", "header_y")
    found = {
        "setup.period": control.period,
        "setup.edge_is_left": float(control.edge_side == "left"),
        **{f"setup.{name}": float(getattr(control.machine, name)) for name in names},
    }
    alone = len(control.mountings.keys() - {"inertial"}) == 1
    for port, pose in control.mountings.items():
        lead = "setup.mounting" if alone and port != "inertial" else f"setup.mounting.{port}"
        values = (*pose.position.tolist(), *pose.euler())
        found |= {f"{lead}.{axis}": float(v) for axis, v in zip(AXES, values, strict=True)}
    return found


def sample_of(port: Port, t: int, numbers: Mapping[str, float]) -> Signal | None:
    """The sample of an output port from an answer, None when no name of it is in there.

    It is valid at t [ns], or when `port.t_ns` says so.
    Raises SwathError that names what is missing or unknown.
    """
    lead = f"{port.name}."
    own = {name[len(lead) :]: value for name, value in numbers.items() if name.startswith(lead)}
    valid_at = round(own.pop("t_ns", t))
    if not own:
        return None
    fields = flat_fields(port.signal)
    values: dict[str, Any] = {}
    arrays: dict[str, dict[int, float]] = {}
    for name, value in own.items():
        first, _, index = name.rpartition(".")
        if index.isdigit() and first in fields and fields[first].kind == "array":
            arrays.setdefault(first, {})[int(index)] = value
        else:
            values[name] = value
    values |= {name: [rows[i] for i in sorted(rows)] for name, rows in arrays.items()}
    try:
        return build(port.signal, valid_at, values)
    except InputError as error:
        raise SwathError(f"{port.name}: {error}") from error


def check_names(ports: Iterable[Port], numbers: Mapping[str, float]) -> None:
    """SwathError for a name that starts with none of the ports."""
    known = tuple(port.name for port in ports)
    for name in numbers:
        if name.partition(".")[0] not in known:
            raise SwathError(
                f"{name}: expected a name that starts with {' or '.join(f'{p}.' for p in known)}"
            )
