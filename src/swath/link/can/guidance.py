"""The machine's side of ISO 11783 guidance: when a command is obeyed, and what the machine sends."""

from dataclasses import dataclass, field
from math import atan, isfinite, tan
from typing import Any

from swath.core.schedule import NS
from swath.link.can.bus import Message
from swath.link.can.codec import Values
from swath.signals import CropEdge, Odometry, SteerCommand

COMMAND = "GuidanceSystemCommand"
STATUS = "GuidanceMachineStatus"
WHEEL, GROUND = "WheelBasedSpeedAndDistance", "GroundBasedSpeedAndDistance"
EDGE_LINE, EDGE_QUALITY = "CropEdgeLine", "CropEdgeQuality"  # the latter ends a cycle
CRAWL = 0.2  # m/s, below which curvature comes from the steering angle instead of the yaw rate
ALL_CLEAR, TIMEOUT, OUT_OF_RANGE = 0, 5, 6  # exit reason codes
INTENDED = 1  # to steer
ODOMETER = 4_211_081.215  # m, where the distance starts again from 0
AGE_MAX = 6.4255  # s
# Signal of the two messages about the edge -> field of CropEdge.
LINE = {
    "EdgeOffset": "offset",
    "EdgeHeading": "heading",
    "EdgeCurvature": "curvature",
    "EdgeReference": "reference_x",
}
QUALITY = {"EdgeConfidence": "confidence", "CropHeight": "crop_height", "StubbleHeight": "stubble_height"}


def to_bus(curvature: float) -> float:
    """1/m, > 0 left, to 1/km, > 0 right, as on the bus."""
    return -1000.0 * curvature


def from_bus(curvature: float) -> float:
    """1/km, > 0 right, to 1/m, > 0 left."""
    return 0.0 - curvature / 1000.0


@dataclass
class Guidance:
    """Which command holds. It is obeyed while it comes, is a number and intends to steer.

    timeout [ns]: longest time without a command. After it the controller has to say once that it does not
        intend to steer before it is obeyed again (request reset).
    """

    timeout: int
    command: SteerCommand = field(default_factory=lambda: SteerCommand(0, 0.0, False))
    heard_at: int | None = None
    needs_reset: bool = False
    reason: int = ALL_CLEAR

    def hear(self, message: Message, t: int) -> None:
        """A guidance command that arrived at t [ns]."""
        wanted, status = message.values["CurvatureCommand"], message.values["CurvatureCommandStatus"]
        self.heard_at = t
        if status != INTENDED:
            self.needs_reset, self.reason = False, ALL_CLEAR
        elif wanted is None:
            self.reason = OUT_OF_RANGE
        elif not self.needs_reset:
            self.reason = ALL_CLEAR
        is_obeyed = status == INTENDED and wanted is not None and not self.needs_reset
        curvature = self.command.curvature if wanted is None else from_bus(wanted)
        self.command = SteerCommand(t, curvature, is_obeyed)

    def is_overdue(self, t: int) -> bool:
        """True once, when at t [ns] the command of a controller that steers has stayed out for too long."""
        if self.heard_at is None or t - self.heard_at <= self.timeout or not self.command.is_engaged:
            return False
        self.command = SteerCommand(t, self.command.curvature, False)
        self.needs_reset, self.reason = True, TIMEOUT
        return True


def status_values(guidance: Guidance, odometry: Odometry | None, wheelbase: float) -> Values:
    """Guidance machine status."""
    curvature = measured_curvature(odometry, wheelbase)
    return {
        "EstimatedCurvature": None if curvature is None else to_bus(curvature),
        "MechanicalSystemLockout": 0,
        "SteeringSystemReadiness": 1,
        "SteeringInputPosition": 1,
        "RequestResetCommand": int(guidance.needs_reset),
        "LimitStatus": 0,
        "ExitReasonCode": guidance.reason,
    }


def speed_values(kind: str, speed: float | None, distance: float) -> Values:
    """Wheel-based or ground-based speed [m/s] and distance [m]; kind: `Wheel` or `Ground`."""
    return {
        f"{kind}BasedSpeed": None if speed is None else abs(speed),
        f"{kind}BasedDistance": distance % ODOMETER,
        f"{kind}BasedDirection": None if speed is None else int(speed >= 0.0),
        "KeySwitch": 1,
    }


def edge_values(edge: CropEdge | None, t: int, cycle: int) -> tuple[Values, Values]:
    """Line and quality of the crop edge at t [ns]; the number of the cycle ends them."""
    count: Values = {"Cycle": cycle % 251}
    if edge is None:
        return {}, {"EdgeConfidence": 0.0, **count}
    fields = vars(edge)
    line: Values = {signal: fields[name] for signal, name in LINE.items()}
    quality: Values = {signal: fields[name] for signal, name in QUALITY.items()}
    return line, {**quality, "EdgeAge": min((t - edge.t) / NS, AGE_MAX), **count}


def edge_of(line: Values, quality: Values, t: int) -> CropEdge:
    """The crop edge that the two messages carry, at the controller's time t [ns]."""
    sent = {signal: value for signal, value in {**line, **quality}.items() if value is not None}
    known = {"EdgeConfidence": 0.0, **sent}
    fields: dict[str, Any] = {
        name: known.get(signal, float("nan")) for signal, name in (LINE | QUALITY).items()
    }
    return CropEdge(t - round(sent.get("EdgeAge", 0.0) * NS), **fields)


def measured_curvature(odometry: Odometry | None, wheelbase: float) -> float | None:
    """Driven curvature [1/m]: yaw rate over speed, at a crawl from the steering angle; None = unknown."""
    if odometry is None:
        return None
    if odometry.speed > CRAWL and isfinite(odometry.yaw_rate):
        return odometry.yaw_rate / odometry.speed
    return tan(odometry.steer_angle) / wheelbase if isfinite(odometry.steer_angle) else None


def odometry_of(speed: float, curvature: float | None, wheelbase: float, t: int) -> Odometry:
    """Odometry at t [ns] from speed [m/s] and driven curvature [1/m]."""
    if curvature is None:
        return Odometry(t, speed, float("nan"), float("nan"))
    return Odometry(t, speed, curvature * speed, atan(curvature * wheelbase))
