"""The slots of a machine: which packages hold their levels, how often they run, what feeds them.

The order here is the order within one tick. Wires are by the name of the input port; a level connects those
of its slot's list whose port it has, an optional one only where the level at the other end gives it; a
scenario's `wires:` override them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from swath.core.component import Port
from swath.core.registry import Registry
from swath.signals import (
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
    SpeedCommand,
    SteerCommand,
    SteerState,
    YieldReading,
)


@dataclass(frozen=True)
class SlotKind:
    """One slot of a machine.

    packages: where its levels lie; level: the default one; rate_hz: the default rate
    outputs: ports that every level of it has; more: that some levels have
    wires: input port -> (slot, output port) of the same machine
    is_on: present in every machine; otherwise only where a scenario names it
    """

    name: str
    packages: tuple[str, ...]
    level: str
    rate_hz: float
    outputs: tuple[Port, ...]
    wires: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    is_on: bool = True
    more: tuple[Port, ...] = ()


_STATE = {"state": ("motion", "state")}

SLOTS: tuple[SlotKind, ...] = (
    SlotKind(
        "motion",
        ("swath.machine.motion",),
        "single_track",
        200.0,
        (Port("state", MachineState),),
        {
            "steering": ("steering", "steering"),
            "speed": ("speed", "command"),
            "drive": ("powertrain", "engine"),
            "load": ("process", "load"),
            "header": ("header", "height"),
        },
    ),
    SlotKind(
        "header",
        ("swath.machine.header",),
        "fixed_height",
        50.0,
        (Port("flow", CropFlow),),
        _STATE,
        more=(Port("height", HeaderState),),
    ),
    SlotKind(
        "process",
        ("swath.machine.process",),
        "constant",
        10.0,
        (Port("load", MachineLoad),),
        {**_STATE, "flow": ("header", "flow"), "engine": ("powertrain", "engine")},
    ),
    SlotKind(
        "powertrain",
        ("swath.machine.powertrain",),
        "hydrostat",
        20.0,
        (Port("engine", EngineState),),
        {**_STATE, "load": ("process", "load")},
        is_on=False,
    ),
    SlotKind(
        "crop_flow",
        ("swath.sensing.crop_flow",),
        "delayed",
        10.0,
        (Port("feed", FeedReading), Port("grain", YieldReading), Port("loss", LossReading)),
        {"load": ("process", "load")},
        is_on=False,
    ),
    SlotKind(
        "lidar",
        ("swath.sensing.lidar",),
        "plants",
        25.0,
        (Port("scan", Scan, unit="m", shape=(None,)), Port("truth", ScanTruth)),
        _STATE,
    ),
    SlotKind(
        "camera",
        ("swath.sensing.camera",),
        "rays",
        5.0,
        (Port("image", Image),),
        _STATE,
        is_on=False,
    ),
    SlotKind(
        "odometry",
        ("swath.sensing.odometry",),
        "error",
        50.0,
        (Port("odometry", Odometry),),
        {**_STATE, "steering": ("steering", "steering")},
    ),
    SlotKind(
        "gnss",
        ("swath.sensing.gnss",),
        "error",
        10.0,
        (Port("fix", Fix),),
        _STATE,
        is_on=False,
    ),
    SlotKind(
        "imu",
        ("swath.sensing.imu",),
        "error",
        100.0,
        (Port("inertial", Inertial),),
        _STATE,
        is_on=False,
    ),
    SlotKind(
        "edge",
        ("swath.control.edge", "swath.sensing.edge"),
        "max_likelihood",
        25.0,
        (Port("edge", CropEdge),),
        {**_STATE, "scan": ("lidar", "scan"), "odometry": ("odometry", "odometry")},
    ),
    SlotKind(
        "ahead",
        ("swath.control.ahead",),
        "penetration",
        5.0,
        (Port("ahead", CropAhead),),
        {"scan": ("lidar", "scan")},
        is_on=False,
    ),
    SlotKind(
        "steer",
        ("swath.control.steer",),
        "preview",
        50.0,
        (Port("command", SteerCommand),),
        {**_STATE, "edge": ("edge", "edge"), "odometry": ("odometry", "odometry")},
    ),
    SlotKind(
        "speed",
        ("swath.control.speed",),
        "constant",
        10.0,
        (Port("command", SpeedCommand),),
        {
            "odometry": ("odometry", "odometry"),
            "load": ("process", "load"),
            "edge": ("edge", "edge"),
            "feed": ("crop_flow", "feed"),
            "engine": ("powertrain", "engine"),
            "ahead": ("ahead", "ahead"),
        },
    ),
    SlotKind(
        "steering",
        ("swath.machine.steering",),
        "actuator",
        200.0,
        (Port("steering", SteerState),),
        {"command": ("steer", "command")},
    ),
)
SLOT_NAMES = tuple(s.name for s in SLOTS)
TRUTH = (MachineState, ScanTruth)  # what control never sees
CONTROL = ("edge", "ahead", "steer", "speed")  # these are told the machine's geometry, never the truth
# Whose level may change while a run goes on: they keep nothing of the machine's motion and masses.
EXCHANGEABLE = ("lidar", "camera", "odometry", "gnss", "imu", "crop_flow", "edge", "ahead", "steer", "speed")

FIELD_PACKAGES: dict[str, tuple[str, ...]] = {
    "terrain": ("swath.field.terrain",),
    "stand": ("swath.field.stand",),
}
FIELD_LEVELS = {"terrain": "formula", "stand": "uniform"}

REGISTRY = Registry(
    {**FIELD_PACKAGES, **{s.name: s.packages for s in SLOTS}},
    links="swath.link.levels",
    linkable=SLOT_NAMES,
)
