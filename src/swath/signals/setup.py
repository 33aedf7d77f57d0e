"""What the parts of a machine know about the machine: geometry from the data sheet, never the truth."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from swath.core.component import Port
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.units import Quantity
from swath.signals.arrays import F64
from swath.signals.settings import Works


@dataclass(frozen=True)
class Hitch:
    """What is towed. x: of the pin ahead of the fixed axle; drawbar: from the pin back to the axle [m]."""

    x: float
    drawbar: float


@dataclass(frozen=True)
class OpenBox:
    """A box that grain is poured into.

    x: its middle ahead of the origin of what carries it: the middle of the trailer's axle, or the machine's
    own; length, width, depth
    floor: above the ground [m]
    """

    x: Annotated[float, Quantity("m", -20, 20)]
    length: Annotated[float, Quantity("m", 0.5, 30)]
    width: Annotated[float, Quantity("m", 0.5, 5)]
    depth: Annotated[float, Quantity("m", 0.1, 5)]
    floor: Annotated[float, Quantity("m", 0, 5)]

    @property
    def rim(self) -> float:
        """Height of the rim above the ground [m]."""
        return self.floor + self.depth


@dataclass(frozen=True)
class Pipe:
    """An unloading pipe.

    x, y, z: its pivot in the machine frame [m], z also of its mouth
    length [m]: pivot to mouth, outward and level
    swing: largest angle from folded straight back to out, to the left [rad]; rate [rad/s]
    exit_speed: of the grain [m/s]
    fall: its direction below the pipe's [rad]
    """

    x: Annotated[float, Quantity("m", -20, 20)]
    y: Annotated[float, Quantity("m", -5, 5)]
    z: Annotated[float, Quantity("m", 0.5, 8)]
    length: Annotated[float, Quantity("m", 0.5, 15)]
    swing: Annotated[float, Quantity("deg", 10, 150)]
    rate: Annotated[float, Quantity("deg_s", 0.5, 90)]
    exit_speed: Annotated[float, Quantity("m_s", 0.1, 20)]
    fall: Annotated[float, Quantity("deg", 0, 89)]


@dataclass(frozen=True)
class MachineGeometry:
    """Data-sheet geometry. Machine frame: origin at the middle of the fixed axle on the ground.

    wheelbase, front_track (fixed axle), rear_track (steered axle) [m]; the steered axle lies `wheelbase`
    BEHIND the fixed one, or ahead of it where `steers_ahead` (tractors)
    max_steer: equivalent single-wheel angle limit [rad]
    header_width [m], 0 for a machine without a header, whose front end then stands for the knife
    knife_x: knife ahead of the fixed axle [m]; header_y: centre of the header, leftward [m]
    header_height: of its body above the knife [m]; header_depth: of its body behind the knife [m]
    body: rear end x, front end x, half width, bottom z, top z of the chassis box [m]
    hitch, box, pipe: what it tows, pours grain into and out of, None where it has none
    works: what its organs are set to in wheat
    """

    wheelbase: float
    front_track: float
    rear_track: float
    max_steer: float
    header_width: float
    knife_x: float
    header_y: float
    header_height: float
    header_depth: float
    body: tuple[float, float, float, float, float]
    steers_ahead: bool = field(default=False, kw_only=True)
    hitch: Hitch | None = field(default=None, kw_only=True)
    box: OpenBox | None = field(default=None, kw_only=True)
    pipe: Pipe | None = field(default=None, kw_only=True)
    works: Works = field(default=Works(), kw_only=True)

    @property
    def has_header(self) -> bool:
        """Whether it carries a header."""
        return self.header_width > 0.0

    @property
    def steered_x(self) -> float:
        """The steered axle ahead of the fixed one [m]."""
        return self.wheelbase if self.steers_ahead else -self.wheelbase

    @property
    def outline(self) -> tuple[tuple[float, float, float, float], ...]:
        """Body and header from above: rectangles in the machine frame, each rear, front, right, left [m]."""
        rear, front, half, _, _ = self.body
        if not self.has_header:
            return ((rear, front, -half, half),)
        wide, x, y = 0.5 * self.header_width, self.knife_x, self.header_y
        return (rear, front, -half, half), (x - self.header_depth, x, y - wide, y + wide)

    def header_end(self, side: str) -> tuple[float, float]:
        """(x, y) of the knife's `left` or `right` end in the machine frame [m]."""
        half = 0.5 * self.header_width
        return self.knife_x, self.header_y + (half if side == "left" else -half)


@dataclass(frozen=True)
class ControlSetup:
    """What a control component may know.

    machine: geometry of its machine
    mountings: by input port pose_machine_sensor of the sensor wired to it, as the fitter measured it
    edge_side: `left` or `right`, the end of the header that follows the edge. With `left` the cut ground lies
    to the left of the edge and the standing crop to its right; with `right` the other way round
    period: period of the component [s]
    crop_height: usual height over the ground [m], standing upright, as a scanner sees it, of the crop that
    the driver chose at the terminal; 0 = none
    row_spacing: distance of the rows that the crop was sown in [m]; 0 = not known, or no rows
    line_of: reads the n-th line of a GeoJSON file as points (n, 2) of the field's frame [m], as a terminal
    reads its guidance lines; raises InputError
    """

    machine: MachineGeometry
    mountings: Mapping[str, Pose]
    edge_side: str
    period: float
    crop_height: float = 0.0
    line_of: Callable[[str, int], F64] | None = None
    row_spacing: float = 0.0

    @property
    def mounting(self) -> Pose:
        """Of the one sensor that is wired to the component, an inertial unit aside.

        InputError where there is none, or several.
        """
        poses = {port: pose for port, pose in self.mountings.items() if port != "inertial"}
        if len(poses) != 1:
            found = ", ".join(poses) or "none"
            expected = (
                "expected one sensor with a mounting, such as {scan: lidar.scan}, of a log with `mount`"
            )
            raise InputError("wires", found, expected)
        return next(iter(poses.values()))


@dataclass(frozen=True)
class LinkSetup:
    """What a part from outside (FMU, ROS 2 node, log) knows: the slot it fills, and what control may know.

    machine_name, slot: where it sits, e.g. `combine`, `steer`
    inputs: ports it may have, as the slot is wired in a machine, each optional; a component takes those it
    wants, with `dataclasses.replace(port, history=True)` to get every sample since its last step. In a
    slot of control no truth is among them
    outputs: ports that the rest of the machine expects of the slot
    control: geometry, sensor mounting, side of the edge and period
    base: folder that relative file names start from
    sources: input port -> slot that feeds it, e.g. `combine.lidar_left`
    before_asking: to be called before somebody outside is waited for, who may act on messages of the run
    ground: height of the terrain [m] at x, y, (n,) each; None in a slot of control
    to_local: longitude, latitude [deg], height [m], (n, 3), as east, north, up of the field [m]; None where
    it lies nowhere on Earth
    """

    machine_name: str
    slot: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    control: ControlSetup
    base: Path
    sources: Mapping[str, str] = field(default_factory=dict)
    before_asking: Sequence[Callable[[], None]] = ()
    ground: Callable[[F64, F64], F64] | None = None
    to_local: Callable[[F64], F64] | None = None

    @property
    def name(self) -> str:
        """Full name of the slot, e.g. `combine.steer`."""
        return f"{self.machine_name}.{self.slot}"
