"""Water in the grain and the straw of a stand, a number or by the hour."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, MinLen

from swath.core.errors import InputError
from swath.core.estimate import Estimate
from swath.core.schedule import NS
from swath.core.units import HOUR, PERCENT

Percent = Annotated[float, Ge(0.0), Le(80.0)]
Hour = Annotated[float, Ge(0.0), Le(24.0)]
ByHour = Percent | Annotated[tuple[tuple[Hour, Percent], ...], MinLen(1)]
FromWeather = ByHour | Literal["weather"]
DAY, NOON = 24.0, 12.0  # [h]


@dataclass(frozen=True, kw_only=True)
class Moisture:
    """Moisture of a stand. A part of a machine that has a key of its own for it takes that where it is set.

    grain_moisture_percent: water in the grain, share of the wet mass; a number, or pairs of hour of the day
        and percent, linear between them
    straw_moisture_percent: water in the straw, likewise; 25 at dew and 11 at noon are usual, an estimate;
        `weather`: dew, rain and drying by field.weather
    start_hour: time of day at the start of the run, for what goes by the hour; none = that of
        field.weather.time, without which it is 12
    dry_straw_kg_m2: straw that dew and rain wet, without its water
    film_max_kg_m2: the most water that hangs on it
    straw_lag_h: how far the water in the straw is behind the air
    """

    grain_moisture_percent: ByHour = 14.0
    straw_moisture_percent: FromWeather = 12.0
    start_hour: Hour | None = None
    dry_straw_kg_m2: Annotated[float, Gt(0.0), Le(5.0), Estimate(0.3, 1.0, decides="is_by_weather")] = 0.6
    film_max_kg_m2: Annotated[float, Gt(0.0), Le(2.0), Estimate(0.15, 0.5, decides="is_by_weather")] = 0.3
    straw_lag_h: Annotated[float, Gt(0.0), Le(24.0), Estimate(1.0, 2.0, decides="is_by_weather")] = 1.5

    def __post_init__(self) -> None:
        for key in ("grain_moisture_percent", "straw_moisture_percent"):
            pairs = getattr(self, key)
            hours = [hour for hour, _ in pairs] if isinstance(pairs, tuple) else []
            if hours != sorted(set(hours)):
                raise InputError(key, hours, "expected hours that rise")

    @property
    def is_by_weather(self) -> bool:
        """Whether dew, rain and drying make the straw's water."""
        return isinstance(self.straw_moisture_percent, str)

    def at(self, t: int) -> dict[str, float]:
        """`grain_moisture` and `straw_moisture` at a time [ns] of the run, shares of the wet mass."""
        return {"grain_moisture": self.of_grain(t), "straw_moisture": self.of_straw(t)}

    def of_grain(self, t: int) -> float:
        """Water in the grain at a time [ns] of the run, share of the wet mass."""
        return PERCENT * self._percent(self.grain_moisture_percent, t)

    def of_straw(self, t: int) -> float:
        """The same of the straw."""
        return PERCENT * self._percent(self.straw_moisture_percent, t)

    def _percent(self, given: FromWeather, t: int) -> float:
        if isinstance(given, str):
            raise InputError("straw_moisture_percent", given, "expected a field with weather")
        if not isinstance(given, tuple):
            return given
        hour = (NOON if self.start_hour is None else self.start_hour) + t / NS / HOUR
        hours, percents = np.array(given).T
        return float(np.interp(hour, hours, percents, period=DAY))
