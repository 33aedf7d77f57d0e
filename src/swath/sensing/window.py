"""The window of a scanner: dust that settles and drops that hang on it, what they take, what takes them off.

Of the light (1 - 0.3437 erf(0.17 m^0.8473))^f comes through m g/m2, there and back the square. With f = 1
that is solar glass (Coello and Boyle 2019, doi:10.1109/JPHOTOV.2019.2919628), which keeps what dust
scatters forward; a scanner does not, its receiver looks where the beam went. Glass that lay outdoors for
eight weeks at several sites lost at most 7 % of the light as solar cells have it and 50 % of the direct
light ("A unified global investigation on the spectral effects of soiling losses of PV glass substrates:
preliminary results", IEEE PVSC 2017): f up to 10. By Mie's theory, exp(-k m) with k of plant dust of 30 um,
f is 1.9 at 1 g/m2, of 50 um 1.2. An upright window catches a tenth of the dust that falls past it and a
share of what the air carries against it; both are estimated.

Of rain it catches a share, too. Each drop of the diameter d that stays lies there as half a ball and covers
a circle of the diameter 2^(1/3) d, which no light passes: as a lens of three radii it sends all but its
middle elsewhere. How many come before a beam is Poisson distributed, and they run off or dry by a time of
their own. The wider the beam, the fewer are lost, as Fersch et al. 2016 found
(doi:10.1109/GEMIC.2016.7461562); drops of 20 mm3, 3.4 mm, run down upright acrylic (André et al. 2019,
doi:10.1051/emsci/2019002). How much a scanner loses in rain was compared with no measurement.

The scanner looks at itself with dirt sensors, each at the mean of its sector, and says `ok`, `warning`,
`error` or `serious`, as SICK's LMS500 does with six.
"""

from dataclasses import dataclass
from math import erf, exp
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core import portable
from swath.core.component import KeepsState
from swath.core.errors import InputError
from swath.core.estimate import Estimate
from swath.core.portable import product
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import GRAM, HOUR, PERCENT
from swath.field.field import Field
from swath.field.plume import PLANT, fall_speed
from swath.sensing.haze import extinction_at
from swath.signals import F64, WindowState
from swath.signals.scan import WINDOW_STATES

Percent = Annotated[float, Ge(0), Le(100)]


@dataclass(frozen=True)
class Params:
    """A window that gets dirty.

    dust_g_m2: dust on it at the start
    fall_percent: share of the dust falling past that it catches
    impaction_percent: share of the dust that the air carries against it that it catches
    loss_factor: f above, of the dust on it: 1 = as solar glass, 10 = direct light through fine dust
    drop_catch_percent: share of the rain that it catches
    drop_mm: diameter of the drops that hang on it
    drop_stay_s: time after which a drop has run off or dried, e-fold
    wiped_s: times at which it is wiped
    rinse_mm: rain that takes off half of the dust
    dirt_sensors: how many look through it, each through its sector
    warning_percent: light that comes through the dirtiest sector where the scanner warns, one way
    error_percent: likewise, where it calls it an error
    serious_percent: likewise, where it calls it serious
    """

    dust_g_m2: Annotated[float, Ge(0), Le(100)] = 0.0
    fall_percent: Annotated[Percent, Estimate(3, 30)] = 10.0
    impaction_percent: Annotated[Percent, Estimate(0.5, 10)] = 2.0
    loss_factor: Annotated[float, Ge(0), Le(20), Estimate(1.2, 10, "Mie's theory, and direct light")] = 2.0
    drop_catch_percent: Annotated[Percent, Estimate(3, 30)] = 10.0
    drop_mm: Annotated[float, Ge(0.2), Le(6), Estimate(1, 3.4, "André et al. 2019, upward")] = 2.0
    drop_stay_s: Annotated[float, Ge(1), Le(10_000), Estimate(20, 300)] = 60.0
    wiped_s: tuple[Annotated[float, Ge(0), Le(1e6)], ...] = ()
    rinse_mm: Annotated[float, Gt(0), Le(100), Estimate(0.3, 5)] = 1.0
    dirt_sensors: Annotated[int, Ge(1), Le(100)] = 6
    warning_percent: Annotated[Percent, Estimate(85, 95)] = 90.0
    error_percent: Annotated[Percent, Estimate(70, 85)] = 80.0
    serious_percent: Annotated[Percent, Estimate(40, 75)] = 70.0

    def __post_init__(self) -> None:
        if not self.serious_percent <= self.error_percent <= self.warning_percent:
            names = ("error_percent", "warning_percent", "serious_percent")
            said = next(name for name in names if getattr(self, name) != getattr(Params, name))
            expected = "expected serious_percent <= error_percent <= warning_percent, 70 80 90 by default"
            raise InputError(said, getattr(self, said), expected)


def transmission(mass: F64, factor: float = 2.0) -> F64:
    """Share of light that comes through dust of a mass [g/m2], one way; factor: as `loss_factor`."""
    shades = portable.power(np.maximum(mass, 0.0), 0.8473) * 0.17
    through = [1.0 - 0.3437 * erf(x) for x in shades.ravel().tolist()]
    return np.asarray(portable.power(np.array(through), factor).reshape(mass.shape))


class Window(KeepsState):
    """The window of one scanner.

    mass: of the dust before each beam [g/m2], (n,); drops: share of it that they cover there, (n,)
    told: what the scanner says of it
    aperture: diameter of a beam on the window [m]
    """

    kept: ClassVar[tuple[str, ...]] = ("mass", "drops", "told", "_t", "_place", "_warned")

    def __init__(self, params: Params, count: int, aperture: float = 0.01) -> None:
        self.params, self._count = params, count
        self._drop = min((2.0 ** (1.0 / 3.0) * 1e-3 * params.drop_mm / aperture) ** 2, 1.0)  # covers so much
        # of a drop: circle over volume; of a millimetre of rain: the drops before a beam
        covered = 1.5 * 2.0 ** (2.0 / 3.0) / (1e-3 * params.drop_mm)
        self._per_mm = params.drop_catch_percent * PERCENT * 1e-3 * covered / self._drop
        self.reset()

    def reset(self) -> None:
        """As at the start of a run."""
        self.mass, self.drops = np.full(self._count, self.params.dust_g_m2), np.zeros(self._count)
        self._t, self._place = 0, np.full(3, np.nan)
        self._warned: dict[str, float] = {}
        self._tell(0, self._through())

    def step(self, t: int, field: Field, place: F64, directions: F64, stream: Stream) -> F64:
        """Let dust settle up to t [ns]: light that comes through before each beam, one way (n,).

        place: of the scanner, world (3,); directions: of its beams (n, 3); stream: of its drops
        """
        p, dt, weather = self.params, (t - self._t) / NS, field.weather
        last, self._place = self._place, place
        if dt > 0.0 and weather is not None and not np.isnan(last).any():
            air = weather.at(t)
            ground = float(field.ground_height(place[0], place[1]))
            here = np.array([[place[0], place[1], max(place[2] - ground, 0.0)]])
            middle = PLANT[1]
            thick = air.dust / middle.extinction  # [kg/m3]
            falling = thick * fall_speed(middle.diameter, middle.density)  # [kg/(m2 s)]
            for puffs in field.plumes.values():
                packed, per_mass, speed = puffs.packed(), puffs.rows[:, 5], puffs.rows[:, 6]
                packed[:, 5] /= per_mass
                thick += float(extinction_at(packed, here)[0])
                packed[:, 5] *= speed
                falling += float(extinction_at(packed, here)[0])
            against = -product(directions, np.array([*air.wind, 0.0]) - (place - last) / dt)
            carried = p.impaction_percent * PERCENT * thick * np.maximum(against, 0.0)
            self.mass += dt / GRAM * (p.fall_percent * PERCENT * falling + carried)
            self.mass *= 0.5 ** (air.rain * dt / HOUR / p.rinse_mm)
            self.drops *= exp(-dt / p.drop_stay_s)
            if air.rain > 0.0:
                new = stream.at(t).poisson(self._per_mm * air.rain * dt / HOUR, self._count)
                self.drops = 1.0 - (1.0 - self.drops) * portable.power(1.0 - self._drop, new)
        if any(self._t < wiped * NS <= t for wiped in p.wiped_s):
            self.mass[:] = self.drops[:] = 0.0
        self._t = t
        through = self._through()
        self._tell(t, through)
        return through

    def _through(self) -> F64:
        return np.asarray(transmission(self.mass, self.params.loss_factor) * (1.0 - self.drops))

    def _tell(self, t: int, through: F64) -> None:
        """What the dirt sensors see."""
        p = self.params
        means = [float(part.mean()) for part in np.array_split(through, min(p.dirt_sensors, self._count))]
        least = min(means)
        limits = p.warning_percent, p.error_percent, p.serious_percent
        state = len([limit for limit in limits if least < limit * PERCENT])
        for name in WINDOW_STATES[1 : state + 1]:
            self._warned.setdefault(name, t / NS)
        self.told = WindowState(t, state, least, means.index(least))

    @property
    def notes(self) -> list[str]:
        """The warnings that the scanner gave."""
        return [f"lidar: {state} of its dirty window from {t:.0f} s on" for state, t in self._warned.items()]
