"""GNSS with latency, white noise, a slowly wandering error, and times at which the fix is lost."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core import portable
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError
from swath.core.random import Normals, Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import CM
from swath.field.site_setup import SiteSetup
from swath.sensing import CHECKED
from swath.sensing.gnss.antenna import Antenna, Place, TwoAntennas, fix_of, no_fix
from swath.sensing.gnss.receiver_errors import FIGURES, RECEIVERS, Figures
from swath.signals import F64, FIX_QUALITIES, Fix, MachineState

Centimetres = Annotated[float, Ge(0), Le(10_000)] | None
MS_NS = 1_000_000


@dataclass(frozen=True)
class Loss:
    """A time without the receiver's own quality.

    from_s: begin
    to_s: end
    quality: quality of the fix in that time
    """

    from_s: Annotated[float, Ge(0)]
    to_s: Annotated[float, Ge(0)]
    quality: Literal["none", "single", "dgps", "float"] = "none"

    def __post_init__(self) -> None:
        if self.to_s <= self.from_s:
            raise InputError("to_s", self.to_s, f"expected > from_s = {self.from_s:g}")


@dataclass(frozen=True)
class Params:
    """A receiver with errors.

    receiver: receiver whose figures count (docs/explanation/sensors.md)
    antenna: where the antenna sits on the machine
    second_antenna: place of another antenna, for the heading, and for roll or pitch
    heading_noise_mm: sd per sample of its place relative to the first, across the line between them, while
        the fix is one of carriers; an estimate
    latency_ms: time from the measurement to its sample, 20 to 100 (uncited)
    noise_cm: sd of the white noise per sample; none, here and below = the receiver's
    wander_cm: sd of the error that wanders
    wander_s: correlation time of the error that wanders
    velocity_noise_m_s: sd of the white noise of the velocity, per sample and axis
    vertical_factor: errors of the height over those of east and north [1]
    losses: times at which the fix is lost
    """

    receiver: Literal["rtk", "rtk_standing", "rtk_float", "ppp", "dgps", "single"] = "rtk"
    antenna: Place = field(default_factory=Place)
    second_antenna: Place | None = None
    heading_noise_mm: Annotated[float, Ge(0), Le(1000)] = 3.5
    latency_ms: Annotated[float, Ge(0), Le(2000)] = 50.0
    noise_cm: Centimetres = None
    wander_cm: Centimetres = None
    wander_s: Annotated[float, Gt(0), Le(1e6)] | None = None
    velocity_noise_m_s: Annotated[float, Ge(0), Le(10)] | None = None
    vertical_factor: Annotated[float, Gt(0), Le(10)] | None = None
    losses: tuple[Loss, ...] = ()

    def __post_init__(self) -> None:
        own = FIX_QUALITIES.index(RECEIVERS[self.receiver][0])
        for loss in self.losses:
            if FIX_QUALITIES.index(loss.quality) >= own:
                worse = ", ".join(FIX_QUALITIES[:own])
                raise InputError(
                    "quality", loss.quality, f"expected one of {worse}, less than the receiver's"
                )

    def figures(self) -> Figures:
        """Figures of the receiver, with what was given here."""
        given: dict[str, Any] = {
            "noise": None if self.noise_cm is None else self.noise_cm * CM,
            "wander": None if self.wander_cm is None else self.wander_cm * CM,
            "wander_time": self.wander_s,
            "velocity": self.velocity_noise_m_s,
            "vertical": self.vertical_factor,
        }
        _, own = RECEIVERS[self.receiver]
        return replace(own, **{k: v for k, v in given.items() if v is not None})


class Reception(NamedTuple):
    """What comes in.

    quality: by number
    stretch: errors over those of the table
    offset: of a wrong fix, (3,) [m]
    more: fields of Fix from `age` on
    """

    quality: int
    stretch: float = 1.0
    offset: F64 = np.zeros(3)
    more: Mapping[str, Any] = {}


class ErrorGnss(KeepsState):
    """The true place, late and a little off."""

    kept: ClassVar[tuple[str, ...]] = ("_wander", "_antenna", "_pair")

    inputs = (Port("state", MachineState, history=True),)
    outputs = (Port("fix", Fix),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self._setup = setup
        self._latency = round(params.latency_ms * MS_NS)
        self._antenna = Antenna(params.antenna, self._latency)
        self.mounting = self._antenna.mounting
        self._pair: TwoAntennas | None = None
        if params.second_antenna is not None:
            noise = params.heading_noise_mm * 1e-3
            self._pair = TwoAntennas(params.antenna, params.second_antenna, noise, self._latency)
        own, _ = RECEIVERS[params.receiver]
        self._figures = {**FIGURES, own: params.figures()}
        self._own = FIX_QUALITIES.index(own)
        self._losses = [
            (round(x.from_s * NS), round(x.to_s * NS), FIX_QUALITIES.index(x.quality)) for x in params.losses
        ]
        self._times = np.array([f.wander_time for f in self._figures.values()])[:, None]

    def reset(self, stream: Stream) -> Outputs:
        """Nothing received yet; draws where the wandering errors begin."""
        self._normals, self._turns = Normals(stream), Normals(stream.child("heading"))
        self._antenna.reset()
        if self._pair is not None:
            self._pair.reset()
        self._wander: F64 = stream.at(0).standard_normal((len(self._figures), 3))
        return {"fix": no_fix(0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """One sample at t + dt, of what was `latency_ms` before."""
        self._antenna.take(inputs["state"])
        draw = self._normals.at(t + dt, (len(self._figures) + 2, 3))
        kept = portable.exp(-dt / NS / self._times)
        self._wander = self._wander * kept + np.sqrt(1.0 - kept**2) * draw[:-2]
        at = t + dt - self._latency
        if self._pair is not None:
            self._pair.take(inputs["state"])
        got = self.receive(at, dt)
        if got.quality == 0:
            return {"fix": no_fix(max(at, 0))}
        name = FIX_QUALITIES[got.quality]
        figures = self._figures[name]
        off = figures.noise * draw[-2] + figures.wander * self._wander[list(self._figures).index(name)]
        position, velocity = self._antenna.at(at)
        position = position + got.stretch * off * (1.0, 1.0, figures.vertical) + got.offset
        velocity = velocity + figures.velocity * draw[-1]
        spread = figures.sd * got.stretch
        sd = (spread, spread * figures.vertical, figures.velocity)
        more = {**self._attitude(t + dt, at, got.quality), **got.more}
        return {"fix": fix_of(at, self._setup, position, velocity, sd, got.quality, **more)}

    def receive(self, at: int, dt: int) -> Reception:
        """What is received at a time [ns], a period [ns] after the last."""
        return Reception(self.quality_at(at))

    def _attitude(self, t: int, at: int, quality: int) -> dict[str, float]:
        """Heading and roll by two antennas, while the carriers are tracked."""
        if self._pair is None or quality < FIX_QUALITIES.index("float"):
            return {}
        vertical = self._figures[FIX_QUALITIES[quality]].vertical
        return self._pair.seen(at, self._turns.at(t, 2).tolist(), vertical)

    def quality_at(self, t: int) -> int:
        """Quality of a fix measured at t [ns]: the least of all that holds then; none before the start."""
        if t < 0:
            return 0
        return min((q for begin, end, q in self._losses if begin <= t < end), default=self._own)


LEVEL = Level(
    ErrorGnss,
    Params,
    "receiver with latency, white noise, slow wander, losses",
    cost="0.25 ms per sample",
    tolerance="equal to ideal with every error at 0",
    checked=CHECKED,
)
PRESETS = {
    "ideal": LEVEL.preset(
        "true place and velocity of the antenna",
        cost="0.25 ms per sample",
        receiver="rtk",
        losses=(),
        wander_s=None,
        vertical_factor=None,
        **dict.fromkeys(
            ("heading_noise_mm", "latency_ms", "noise_cm", "wander_cm", "velocity_noise_m_s"), 0.0
        ),
    )
}
