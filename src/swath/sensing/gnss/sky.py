"""GNSS under the sky of the scene: satellites behind trees, buildings and the machine, and what follows.

Once a second a ray goes from the antenna to every satellite. What is solid blocks it, leaves weaken it. From
the carrier to noise ratio follows which satellites are heard by code and by carrier, from their directions
the dilution of precision that stretches the errors of level `error`, and from their number and the age of the
corrections the state of the fix, wrong ones among them.
"""

from dataclasses import dataclass, field
from math import exp, nan
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Outputs
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG
from swath.field.site_setup import SiteSetup
from swath.sensing.gnss import error
from swath.sensing.gnss.error import ErrorGnss, Reception
from swath.sensing.gnss.fix_states import FIX, FixStates, Heard, Times
from swath.sensing.gnss.receiver_errors import RECEIVERS
from swath.sensing.gnss.satellites import dilution, directions
from swath.sensing.gnss.shading import Shading
from swath.signals import F64, FIX_QUALITIES

OPEN_HDOP = 0.8  # of an open sky with two constellations, at which the table's figures hold
MOST_STRETCH = 10.0


@dataclass(frozen=True)
class Silence:
    """A time without corrections. from_s: its begin; to_s: its end"""

    from_s: Annotated[float, Ge(0)]
    to_s: Annotated[float, Ge(0)]

    def __post_init__(self) -> None:
        if self.to_s <= self.from_s:
            raise InputError("to_s", self.to_s, f"expected > from_s = {self.from_s:g}")


@dataclass(frozen=True)
class Sky:
    """time_of_day_s: at the start, of the satellites; latitude_deg, longitude_deg: of a field that lies
    nowhere on Earth
    mask_deg: elevation from which on satellites count; leaves_db: loss behind a tree or a hedge; code_dbhz,
    carrier_dbhz: carrier to noise ratio from which on code and carrier are tracked, of 36 + 12 sin(elevation)
    """

    time_of_day_s: Annotated[float, Ge(0), Le(86_400)] = 36_000.0
    latitude_deg: Annotated[float, Ge(-90), Le(90)] = 52.3
    longitude_deg: Annotated[float, Ge(-180), Le(180)] = 10.4
    mask_deg: Annotated[float, Ge(0), Le(60)] = 10.0
    leaves_db: Annotated[float, Ge(0), Le(60)] = 12.0
    code_dbhz: Annotated[float, Ge(0), Le(60)] = 25.0
    carrier_dbhz: Annotated[float, Ge(0), Le(60)] = 32.0


@dataclass(frozen=True)
class Params(error.Params):
    """As of level `error`, and:

    sky: satellites and what weakens them; states: how a fix comes and goes
    begin: quality at the start
    silences: times without corrections; age_mm_s: how the error grows with their age
    wrong_m: sd of the offset of a wrong fix, east and north each
    ppp_start_m: error before it has converged; ppp_s: time constant of its convergence
    """

    sky: Sky = field(default_factory=Sky)
    states: Times = field(default_factory=Times)
    begin: Literal["none", "float", "fix"] = "fix"
    silences: tuple[Silence, ...] = ()
    age_mm_s: Annotated[float, Ge(0), Le(1000)] = 1.0
    wrong_m: Annotated[float, Gt(0), Le(10)] = 0.3
    ppp_start_m: Annotated[float, Gt(0), Le(20)] = 0.6
    ppp_s: Annotated[float, Gt(0), Le(1e5)] = 500.0


class SkyGnss(ErrorGnss):
    """A receiver that hears what the scene lets through."""

    kept: ClassVar[tuple[str, ...]] = (
        *ErrorGnss.kept, "_states", "_heard", "_look_at", "_offset", "_tracked",
    )  # fmt: skip

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        self._p = params
        sky = params.sky
        place = (sky.longitude_deg, sky.latitude_deg)
        if setup.origin is not None:
            place = tuple(setup.origin.to_lon_lat([[0.0, 0.0]])[0].tolist())
        self._longitude, self._latitude = place[0] * DEG, place[1] * DEG
        self._shading = Shading(setup, len(directions(self._latitude, self._longitude, 0.0)))
        self._states = FixStates(params.states, FIX_QUALITIES.index(RECEIVERS[params.receiver][0]))
        self._silences = [(round(s.from_s * NS), round(s.to_s * NS)) for s in params.silences]
        self._forget()

    def _forget(self) -> None:
        self._states.reset(FIX_QUALITIES.index(self._p.begin))
        self._heard, self._look_at = Heard(0, 0, nan, 0.0), 0
        self._offset: F64 = np.zeros(3)
        self._tracked = 0.0 if self._p.begin == "none" else float("inf")  # s, that carriers are tracked

    def reset(self, stream: Stream) -> Outputs:
        """As it begins; nothing received yet."""
        self._chance = stream.child("fix")
        self._forget()
        return super().reset(stream)

    def receive(self, at: int, dt: int) -> Reception:
        """The state of the fix, from what is heard."""
        if at < 0:
            return Reception(0)
        if at >= self._look_at:
            self._look(at)
            self._look_at = at - at % NS + NS
        heard = self._heard._replace(age=self.age(at))
        is_lost = self.quality_at(at) == 0
        if is_lost:
            heard = heard._replace(codes=0, carriers=0)
        draws = self._chance.at(at)
        was_wrong = self._states.is_wrong
        quality = self._states.step(dt / NS, heard, tuple(draws.random(3).tolist()))
        if self._states.is_wrong and not was_wrong:
            self._offset = self._p.wrong_m * draws.standard_normal(3) * (1.0, 1.0, 2.0)
        self._tracked = self._tracked + dt / NS if heard.carriers >= 4 else 0.0
        return self._reception(min(quality, self.quality_at(at)), heard)

    def _reception(self, quality: int, heard: Heard) -> Reception:
        stretch = min(max(heard.hdop / OPEN_HDOP, 1.0), MOST_STRETCH) if heard.hdop == heard.hdop else 1.0
        figures = self._figures[FIX_QUALITIES[max(quality, 1)]]
        size = max(figures.sd, 1e-9)
        if self._p.receiver == "ppp":
            stretch *= 1.0 + (self._p.ppp_start_m / size - 1.0) * exp(-self._tracked / self._p.ppp_s)
        elif quality > 1:
            stretch *= 1.0 + self._p.age_mm_s * 1e-3 * heard.age / size
        offset = self._offset if self._states.is_wrong and quality == FIX else np.zeros(3)
        used = heard.carriers if quality >= FIX_QUALITIES.index("float") else heard.codes
        more = {"age": heard.age if quality > 1 else nan, "satellites": used, "hdop": heard.hdop}
        return Reception(quality, stretch, offset, more)

    def age(self, at: int) -> float:
        """Of the corrections at a time [ns], in s; PPP has its own."""
        begun = [begin for begin, end in self._silences if begin <= at < end]
        return (at - min(begun)) / NS if begun else 0.0

    def _look(self, at: int) -> None:
        """Which satellites are heard now."""
        sky = self._p.sky
        up = directions(self._latitude, self._longitude, sky.time_of_day_s + at / NS)
        high = up[:, 2] >= np.sin(sky.mask_deg * DEG)
        blocked, leaves = self._shading.look(self._antenna.at(at)[0], up)
        ratio = 36.0 + 12.0 * up[:, 2] - sky.leaves_db * leaves
        codes = high & np.logical_not(blocked) & (ratio >= sky.code_dbhz)
        carriers = codes & (ratio >= sky.carrier_dbhz)
        hdop, _ = dilution(up[carriers if np.count_nonzero(carriers) >= 4 else codes])
        self._heard = Heard(int(np.count_nonzero(codes)), int(np.count_nonzero(carriers)), hdop, 0.0)

    @property
    def is_wrong(self) -> bool:
        """Whether the fix is on wrong ambiguities: what no receiver knows."""
        return self._states.is_wrong


LEVEL = Level(
    SkyGnss,
    Params,
    "receiver that hears the satellites which trees, buildings and machine leave it; states of the fix",
    cost="0.4 ms per sample",
    tolerance="equal to ideal with every error at 0",
)
