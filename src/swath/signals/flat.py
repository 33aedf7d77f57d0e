"""Samples as flat, named numbers with units: what a variable of somebody else's part can be mapped to.

speed, pose.x, pose.yaw ...   plain numbers: float, int or bool
ranges, beam_t ...            whole arrays
"""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Any, get_type_hints

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.signals import (
    F32,
    F64,
    U8,
    CropAhead,
    CropEdge,
    CropFlow,
    EngineState,
    FeedReading,
    Fix,
    HeaderState,
    Image,
    Inertial,
    LossReading,
    MachineLoad,
    MachineState,
    Odometry,
    Scan,
    ScanTruth,
    Signal,
    SpeedCommand,
    SteerCommand,
    SteerState,
    YieldReading,
)

Value = Any  # float, int, bool or an array, as the field's kind says
POSE = {"x": "m", "y": "m", "z": "m", "roll": "rad", "pitch": "rad", "yaw": "rad"}
_DTYPES: dict[Any, Any] = {F64: np.float64, F32: np.float32, U8: np.uint8}
_MASS_RATE = "kg/s"
_FLOWS = (
    *("grain_flow", "straw_flow", "header_flow", "feeder_flow", "drum_flow", "rotor_flow", "shoe_flow"),
    *("chopper_flow", "return_flow", "unload_flow", "threshing_loss", "separation_loss", "cleaning_loss"),
)
_MASSES = (
    *("tank_grain", "lost_grain", "dropped_straw", "held_grain", "held_straw"),
    *("unloaded_grain", "tank_start"),
)
_POWERS = (
    *("power", "header_power", "threshing_power", "separation_power", "cleaning_power"),
    *("chopper_power", "unloading_power", "propulsion_power", "auxiliary_power"),
)
# Fields that are not listed are pure numbers (unit "").
UNITS: dict[type[Signal], dict[str, str]] = {
    MachineState: {
        "speed": "m/s",
        "lateral_speed": "m/s",
        "yaw_rate": "rad/s",
        "steer_angle": "rad",
        "distance": "m",
    },
    Scan: {"beam_t": "s", "azimuth": "rad", "elevation": "rad", "ranges": "m"},
    ScanTruth: {"points": "m", "sensor_position": "m"},
    Image: {"depth": "m"},
    Odometry: {"speed": "m/s", "yaw_rate": "rad/s", "steer_angle": "rad"},
    Fix: {
        **dict.fromkeys(("x", "y", "z", "horizontal_sd", "vertical_sd", "height"), "m"),
        **dict.fromkeys(("speed", "speed_sd"), "m/s"),
        **dict.fromkeys(("course", "longitude", "latitude"), "rad"),
    },
    Inertial: {
        **dict.fromkeys(("rate_x", "rate_y", "rate_z", "rate_sd"), "rad/s"),
        **dict.fromkeys(("force_x", "force_y", "force_z", "force_sd"), "m/s2"),
    },
    CropEdge: {
        "offset": "m",
        "heading": "rad",
        "curvature": "1/m",
        "reference_x": "m",
        "crop_height": "m",
        "stubble_height": "m",
    },
    SteerCommand: {"curvature": "1/m"},
    SteerState: {"angle": "rad", "rate": "rad/s"},
    SpeedCommand: {"speed": "m/s"},
    CropFlow: {"grain": "kg", "straw": "kg", "area": "m2", "dt": "s", "lost_grain": "kg", "left_grain": "kg"},
    HeaderState: {
        "heights": "m",
        "readings": "m",
        "wanted": "m",
        "band": "m",
        "lift": "rad",
        "tilt": "rad",
    },
    MachineLoad: dict.fromkeys(_MASSES, "kg") | dict.fromkeys(_FLOWS, _MASS_RATE),
    EngineState: {
        "speed": "rad/s",
        "fuel": _MASS_RATE,
        "fuel_used": "kg",
        "speed_limit": "m/s",
        **dict.fromkeys(_POWERS, "W"),
    },
    FeedReading: {"flow": _MASS_RATE},
    YieldReading: {"flow": _MASS_RATE},
    LossReading: {"separation": _MASS_RATE, "cleaning": _MASS_RATE},
    CropAhead: {"ahead": "m", "extinction": "1/m", "height": "m"},
}


_FOUND: dict[type[Signal], dict[str, "FlatField"]] = {}
_HINTS: dict[type[Signal], dict[str, Any]] = {}


@dataclass(frozen=True)
class FlatField:
    """One number of a sample. kind: real, int, bool or array; unit: SI; default None: must be given."""

    name: str
    kind: str
    unit: str
    default: Value = None


def flat_fields(signal: type[Signal]) -> dict[str, FlatField]:
    """The numbers of a sample type by name, in the order of its fields; `t` is not among them."""
    if signal not in _FOUND:
        _FOUND[signal] = _fields_of(signal)
    return _FOUND[signal]


def _hints(signal: type[Signal]) -> dict[str, Any]:
    if signal not in _HINTS:
        _HINTS[signal] = get_type_hints(signal)
    return _HINTS[signal]


def _fields_of(signal: type[Signal]) -> dict[str, FlatField]:
    hints = _hints(signal)
    units = UNITS.get(signal, {})
    kinds = {float: "real", int: "int", bool: "bool", F64: "array", F32: "array", U8: "array"}
    found: dict[str, FlatField] = {}
    for field in fields(signal):
        if field.name == "t":
            continue
        hint = hints[field.name]
        default = None if field.default is MISSING else field.default
        if hint is Pose:
            for part, unit in POSE.items():
                found[f"{field.name}.{part}"] = FlatField(f"{field.name}.{part}", "real", unit)
        elif hint in kinds:
            unit = units.get(field.name, "")
            found[field.name] = FlatField(field.name, kinds[hint], unit, default)
    return found


def read(sample: Signal, name: str) -> Value:
    """One number of a sample, or an array. Raises InputError for a name it does not have."""
    if name not in flat_fields(type(sample)):
        raise InputError("variable", name, _expected(type(sample)))
    first, _, part = name.partition(".")
    value = getattr(sample, first)
    if not part:
        return value
    parts = list(POSE)
    index = parts.index(part)
    return float(value.position[index] if index < 3 else value.euler()[index - 3])


def build(signal: type[Signal], t: int, values: Mapping[str, Value]) -> Signal:
    """A sample at t [ns] from its flat numbers. Raises InputError where one is unknown or missing."""
    known = flat_fields(signal)
    if unknown := [name for name in values if name not in known]:
        raise InputError("variable", unknown[0], _expected(signal))
    missing = [f.name for f in known.values() if f.default is None and f.name not in values]
    if missing:
        raise InputError(signal.__name__, None, f"expected a value for {', '.join(missing)}")
    hints = _hints(signal)
    made: dict[str, Any] = {}
    for field in fields(signal):
        if field.name == "t":
            continue
        if hints[field.name] is Pose:
            at = [float(values[f"{field.name}.{part}"]) for part in POSE]
            made[field.name] = Pose.from_euler(tuple(at[:3]), roll=at[3], pitch=at[4], yaw=at[5])
        elif field.name in values:
            made[field.name] = _typed(values[field.name], known[field.name], hints[field.name])
    return signal(t, **made)


def _typed(value: Value, field: FlatField, hint: Any) -> Value:
    if field.kind == "array":
        return np.asarray(value, dtype=_DTYPES[hint])
    if field.kind == "bool":
        return bool(value)
    return round(value) if field.kind == "int" else float(value)


def _expected(signal: type[Signal]) -> str:
    return f"expected one of {', '.join(flat_fields(signal))} of {signal.__name__}"
