"""GNSS under the sky of the scene: satellites behind trees, buildings and the machine, and what follows.

Once a second a ray goes from the antenna to every satellite. What is solid blocks it, leaves weaken it. From
the carrier to noise ratio follows which satellites are heard by code and by carrier, from their directions
the dilution of precision that stretches the errors of level `error`, and from their number and the age of the
corrections the state of the fix, wrong ones among them.

`FixStates`, what a receiver makes of the satellites it hears, is a state machine with times: ambiguities are
fixed a while after the carrier is tracked, and now and then to wrong numbers, which nobody notices until a
later test does. How often and how long is not published for farm machines as a whole: the defaults are
estimates.

The satellites are two Walker constellations on circles: GPS 24/6/1 at 55 deg, radius 26,560 km (IS-GPS-200),
Galileo 24/3/1 at 56 deg, radius 29,600 km (Galileo OS SIS ICD). Real orbits are off from these by some
degrees: their number, their spread over the sky and how it turns are right, the single satellite is nobody's.
Between them and an antenna stand the scene, the other machines and the own body.
"""

from dataclasses import dataclass, field
from math import cos, exp, hypot, log1p, nan, pi, sin, sqrt
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core import portable
from swath.core.component import KeepsState, Outputs
from swath.core.errors import InputError
from swath.core.packed_state import saved_type
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import DEG
from swath.field.memory_layout import Solids
from swath.field.site_setup import Body, SiteSetup
from swath.field.solid.solids import merge
from swath.rays.single.buffers import BeamBuffer
from swath.sensing import CHECKED
from swath.sensing.gnss import error
from swath.sensing.gnss.error import ErrorGnss, Reception
from swath.sensing.gnss.receiver_errors import RECEIVERS
from swath.signals import F64, FIX_QUALITIES

FOLIAGE = ("tree", "hedge")
REACH = 150.0  # farther bodies shade nothing above 5 deg up to a height of 13 m
FAR = 400.0  # of a ray [m]
SKIN = 0.05  # above the antenna's place, so that its foot does not shade it [m]


class Shading:
    """Casts a ray to every satellite against the solids of all bodies, those in leaf by themselves."""

    def __init__(self, setup: SiteSetup, count: int) -> None:
        self._setup = setup
        self._hard, self._leaves = BeamBuffer(count), BeamBuffer(count)

    def look(self, antenna: F64, up: F64) -> tuple[F64, F64]:
        """(is blocked, is behind leaves), boolean (n,) each. antenna (3,) [m], up: directions (n, 3)."""
        bodies = [b for b in self._setup.bodies.around() if _is_near(b, antenna)]
        leaves = [b.solids for b in bodies if b.kind in FOLIAGE]
        hard = [b.solids for b in bodies if b.kind not in FOLIAGE]
        return self._met(self._hard, hard, antenna, up), self._met(self._leaves, leaves, antenna, up)

    def _met(self, beams: BeamBuffer, solids: list[Solids], antenna: F64, up: F64) -> F64:
        count = beams.count
        if not solids:
            return np.zeros(count, dtype=bool)
        beams.origins[:count] = antenna + np.array([0.0, 0.0, SKIN])
        beams.directions[:count] = up
        beams.distance[:count] = FAR
        if not beams.meet(merge(*solids), FAR):
            return np.zeros(count, dtype=bool)
        return np.asarray(beams.distance[:count] < 0.999 * FAR)


def _is_near(body: Body, antenna: F64) -> bool:
    middle = body.pose.apply(body.middle)
    away = hypot(*(middle[:2] - antenna[:2]).tolist())
    return away < REACH + hypot(*body.half.tolist())


GRAVITY = 3.986004418e14  # of the Earth [m3/s2]
TURN = 7.2921151467e-5  # of the Earth [rad/s]
RADIUS = 6.371e6  # of the Earth [m]
# satellites, planes, phasing, inclination [rad], radius [m], node of the first plane [rad]
WALKERS = ((24, 6, 1, 55.0 * pi / 180.0, 26.56e6, 0.0), (24, 3, 1, 56.0 * pi / 180.0, 29.6e6, 0.6))


def directions(latitude: float, longitude: float, seconds: float) -> F64:
    """Unit vectors east, north, up (n, 3) to all satellites; those below the horizon have up < 0.

    latitude, longitude [rad]; seconds: of the day
    """
    places = np.concatenate([_orbit(*walker, seconds) for walker in WALKERS])
    angle = TURN * seconds
    c, s = cos(angle), sin(angle)
    x, y = c * places[:, 0] + s * places[:, 1], c * places[:, 1] - s * places[:, 0]
    sb, cb, sl, cl = sin(latitude), cos(latitude), sin(longitude), cos(longitude)
    here = RADIUS * np.array([cb * cl, cb * sl, sb])
    dx, dy, dz = x - here[0], y - here[1], places[:, 2] - here[2]
    east, north = -sl * dx + cl * dy, -sb * cl * dx - sb * sl * dy + cb * dz
    up = cb * cl * dx + cb * sl * dy + sb * dz
    away = np.stack([east, north, up], axis=-1)
    return np.asarray(away / np.linalg.norm(away, axis=1)[:, None])


def _orbit(
    count: int, planes: int, phasing: int, inclination: float, radius: float, node: float, seconds: float
) -> F64:
    """Positions in the frame that does not turn (count, 3) [m]."""
    per_plane = count // planes
    plane, slot = np.divmod(np.arange(count), per_plane)
    rate = sqrt(GRAVITY / radius**3)
    along = 2.0 * pi * (slot / per_plane + plane * phasing / count) + rate * seconds
    ascending = node + 2.0 * pi * plane / planes
    c, s, cn, sn = np.cos(along), np.sin(along), np.cos(ascending), np.sin(ascending)
    x = c * cn - s * cos(inclination) * sn
    y = c * sn + s * cos(inclination) * cn
    return radius * np.stack([x, y, s * sin(inclination)], axis=-1)


def dilution(seen: F64) -> tuple[float, float]:
    """Horizontal and vertical dilution of precision of unit vectors (n, 3); inf where they give no place."""
    if len(seen) < 4:
        return float("inf"), float("inf")
    rows = np.concatenate([-seen, np.ones((len(seen), 1))], axis=1)
    normal = portable.product(rows.T, rows)
    try:
        spread = np.diag(portable.inverse(normal))
    except ZeroDivisionError:
        return float("inf"), float("inf")
    if not np.all(np.isfinite(spread)) or float(spread.min()) < 0.0:
        return float("inf"), float("inf")
    return hypot(sqrt(float(spread[0])), sqrt(float(spread[1]))), sqrt(float(spread[2]))


NONE, SINGLE, DGPS, FLOAT, FIX = range(len(FIX_QUALITIES))
TINY = 1e-9  # s, that sums of periods are off by
Seconds = Annotated[float, Ge(0), Le(1e6)]


@dataclass(frozen=True)
class Times:
    """How a receiver gets its fix and loses it.

    reacquire_s: time from four satellites on to the first position
    fix_min_s: least time from the first float solution to the fix
    fix_mean_s: mean of the time that is added to fix_min_s (exponential)
    phase_float: satellites whose carrier must be tracked for a float solution
    phase_fix: satellites whose carrier must be tracked for a fix
    rtk_age_s: age of the corrections up to which they serve RTK
    dgps_age_s: age of the corrections up to which they serve DGPS
    losses_per_h: losses of a fix to float under open sky
    wrong_percent: share of fixes that are wrong
    wrong_shaded: factor on that share with fewer than 8 carriers or a horizontal dilution above 2 [1]
    wrong_s: mean time until a wrong fix is noticed
    """

    reacquire_s: Seconds = 1.0
    fix_min_s: Seconds = 2.0
    fix_mean_s: Annotated[float, Gt(0), Le(1e5)] = 6.0
    phase_float: Annotated[int, Ge(4), Le(50)] = 5
    phase_fix: Annotated[int, Ge(4), Le(50)] = 6
    rtk_age_s: Seconds = 30.0
    dgps_age_s: Seconds = 120.0
    losses_per_h: Annotated[float, Ge(0), Le(3600)] = 0.5
    wrong_percent: Annotated[float, Ge(0), Le(100)] = 0.5
    wrong_shaded: Annotated[float, Ge(1), Le(200)] = 10.0
    wrong_s: Annotated[float, Gt(0), Le(1e5)] = 40.0


@saved_type()
class Heard(NamedTuple):
    """codes, carriers: satellites of which either is tracked; hdop; age: of the corrections [s]."""

    codes: int
    carriers: int
    hdop: float
    age: float


class FixStates(KeepsState):
    """quality: by number, as in FIX_QUALITIES; is_wrong: a fix on wrong ambiguities."""

    kept = ("quality", "is_wrong", "_heard", "_floats", "_wait")

    def __init__(self, times: Times, best: int = FIX) -> None:
        self._times, self._best = times, best
        self.reset()

    def reset(self, quality: int = NONE) -> None:
        """From this quality on."""
        self.quality, self.is_wrong = min(quality, self._best), False
        self._heard = 0.0 if quality == NONE else float("inf")  # time with four satellites
        self._floats = 0.0  # time with a float solution
        self._wait = float("inf")  # time of it until the fix

    def step(self, seconds: float, heard: Heard, draw: tuple[float, float, float]) -> int:
        """The quality after so many seconds. draw: three uniform numbers of [0, 1)."""
        t = self._times
        self._heard = self._heard + seconds if heard.codes >= 4 else 0.0
        if heard.codes < 4 or self._heard < t.reacquire_s - TINY:
            return self._go(NONE)
        most = FLOAT if heard.carriers >= t.phase_float else DGPS
        if heard.age > t.dgps_age_s:
            most = SINGLE
        elif heard.age > t.rtk_age_s:
            most = min(most, DGPS)
        if most < FLOAT or self._best < FLOAT:
            return self._go(min(most, self._best))
        if self.quality == FIX:
            return self._keep(seconds, heard, draw)
        if self.quality != FLOAT or self._wait == float("inf"):
            self._begin(draw[0])
            return self._go(FLOAT)
        self._floats += seconds
        if self._best == FIX and self._floats >= self._wait - TINY and heard.carriers >= t.phase_fix:
            self._fix(heard, draw[1])
        return self.quality

    def _keep(self, seconds: float, heard: Heard, draw: tuple[float, float, float]) -> int:
        """A fix stays, is lost, or is found to be wrong."""
        t = self._times
        rate = 1.0 / t.wrong_s if self.is_wrong else t.losses_per_h / 3600.0
        if heard.carriers < t.phase_float or draw[2] < rate * seconds:
            self._begin(draw[0])
            return self._go(FLOAT)
        return FIX

    def _begin(self, draw: float) -> None:
        """A float solution begins; draw the time until it is fixed."""
        self._floats = 0.0
        self._wait = self._times.fix_min_s - self._times.fix_mean_s * log1p(-draw)

    def _fix(self, heard: Heard, draw: float) -> None:
        t = self._times
        is_shaded = heard.carriers < 8 or heard.hdop > 2.0
        share = min(t.wrong_percent / 100.0 * (t.wrong_shaded if is_shaded else 1.0), 1.0)
        self.is_wrong = draw < share
        self.quality = FIX

    def _go(self, quality: int) -> int:
        self.quality, self.is_wrong = quality, False
        return quality


OPEN_HDOP = 0.8  # of an open sky with two constellations, at which the table's figures hold
MOST_STRETCH = 10.0


@dataclass(frozen=True)
class Silence:
    """A time without corrections.

    from_s: begin
    to_s: end
    """

    from_s: Annotated[float, Ge(0)]
    to_s: Annotated[float, Ge(0)]

    def __post_init__(self) -> None:
        if self.to_s <= self.from_s:
            raise InputError("to_s", self.to_s, f"expected > from_s = {self.from_s:g}")


@dataclass(frozen=True)
class Sky:
    """Satellites and what weakens their signals.

    time_of_day_s: time of day at the start, which sets the satellites
    latitude_deg: latitude of a field that lies nowhere on Earth
    longitude_deg: longitude of a field that lies nowhere on Earth
    mask_deg: elevation from which on satellites count
    leaves_db: loss behind a tree or a hedge
    code_dbhz: carrier-to-noise ratio from which on the code is tracked, of 36 + 12 sin(elevation)
    carrier_dbhz: carrier-to-noise ratio from which on the carrier is tracked
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
    """The keys of level `error`, and satellites.

    sky: satellites and what weakens them
    states: how a fix comes and goes
    begin: quality of the fix at the start
    silences: times without corrections
    age_mm_s: growth of the error with the age of the corrections
    wrong_m: sd of the offset of a wrong fix, east and north each
    ppp_start_m: error before precise point positioning has converged
    ppp_s: time constant of that convergence
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
        """Age of the corrections at a time [ns], in s; PPP has its own."""
        begun = [begin for begin, end in self._silences if begin <= at < end]
        return (at - min(begun)) / NS if begun else 0.0

    def _look(self, at: int) -> None:
        """Satellites that are heard now."""
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
    checked=CHECKED,
)
