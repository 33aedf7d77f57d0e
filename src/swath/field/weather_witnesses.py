"""What the hours of a weather say of their own units, order and place: physics against physics.

Each row of `WITNESSES` asks columns of a table, in the units of `field.weather`. Bounds are those of weather
that was ever seen (WMO archive of extremes), that a law excludes, or that hardly one of some 2500 days of
seven EPW files passes (Amsterdam, Mannheim, Chicago, Tokyo, Long Beach, Los Angeles, Piedmont). What they
cannot say looks like weather: oktas or tenths of a sky that is never covered by three quarters, shares of it
that are all 0 or 1, km/h of a light wind or in dry air, degF of frost, rad of a wind that keeps its
direction within 0.5 rad, sight in km of smoke or dust, a running total without a dry hour.
"""

from collections.abc import Callable
from math import atan2, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.portable import exp, log, product, solve
from swath.documents.witness import Witness

Array = NDArray[np.float64]
Found = tuple[float, ...]
SILENT = (np.nan,) * 4

FEWEST, WHOLE_DAY = 6, 20.0  # rows, and h, of a column that says something of its unit, and of its course
SATURATED, ICE = 85.0, 0.01  # % in fog, instruments included; what ice lowers it by for each K below 0
DRY, CLEAR = 25.0, 10.0  # %: air and sky from which no rain falls
RAINS = 0.5  # mm of rain
HELD = 6.0  # h from its first rain to its end that a column never falls
PAUSE, UNEVEN = 3.0, 0.25  # h at one amount; spread of its steps over their mean: equal ones are a ramp
SMOKE, STORM = 200.0, 50.0  # m of sight: down to it in dry smoke, and in a storm of dust, snow or spray
RAISES = 6.0  # m/s at 2 m: wind that raises dust, which floats on when it falls
GUST, FRONT, OUTFLOW = 3.0, 8.0, 12.0  # m/s more; K that air leaps and back, and falls under a thunderstorm
WAVE, SHARE = 3.0, 0.6  # K, and of the variance: a wave of the day that is to be trusted
OFF_SUN, OFF_CLOCK = 5.0, 7.0  # h: 4.7 on none of 1473 such days; zones lie up to 2.5 h off the sun
MIXED = 150.0  # K m/s: half as much again as on any of 2541 days
ARID = 30.0  # %: air so dry cools and warms by more under any wind


def within(
    top: float, is_whole: bool | None = None, above: float = 0.0, spread: float = 0.0
) -> Callable[[Array], Found]:
    """Whether a column stays within 0 to top: its upper quartile over top.

    A quarter of the day it is three eighths of top or more, or it may as well be a small number of the right
    unit: a clear day. is_whole: the numbers are whole, or are not; above: least of its highest; spread: least
    between lowest and highest.
    """

    def find(column: Array) -> Found:
        whole = bool((column == np.round(column)).all())
        if (
            len(column) < FEWEST
            or column.min() < 0.0
            or not above <= column.max() <= top
            or np.ptp(column) < spread
            or is_whole is (not whole)
        ):
            return SILENT
        return float(np.percentile(column, 75)) / top, top

    return find


def vapour_pressure(temperature: Array) -> Array:
    """Of saturation over water [hPa] (Magnus, WMO-No. 8)."""
    return 6.112 * exp(17.62 * temperature / (243.12 + temperature))


def dew_point(temperature: Array, humidity: Array) -> Array:
    """By the Magnus formula [deg C]."""
    of = log(vapour_pressure(temperature) * np.maximum(humidity, 0.1) / 100.0 / 6.112)
    return 243.12 * of / (17.62 - of)


def _at_most(residual: Array, *facts: Array) -> Found:
    """The largest residual of a column, and the facts of its hour."""
    n = int(np.argmax(residual))
    return float(residual[n]), *(float(fact[n]) for fact in facts)


def _fog_is_wet(fog: Array, humidity: Array, hour: Array, air: Array, rain: Array, wind: Array) -> Found:
    """What the air of a fog lacks of saturation, where it may be neither smoke nor, after wind, dust."""
    cold = np.maximum(-air, 0.0)
    least = np.where(np.maximum.accumulate(wind) < RAISES, SMOKE, STORM)
    lack = np.where((fog < least) & (rain < RAINS), SATURATED * (1.0 - ICE * cold) - humidity, -np.inf)
    return _at_most(lack, fog, humidity, hour)


def _in_fog(sight: float, least: float) -> Callable[[Array, Array, Array], Found]:
    """How far something exceeds what stands in a fog of less sight."""
    return lambda fog, other, hour: _at_most(np.where(fog < sight, other - least, -np.inf), fog, other, hour)


def _fog_all_day(fog: Array, hour: Array) -> Found:
    return (1.0, float(fog.max())) if _is_whole_day(hour) and fog.max() <= 100.0 else SILENT


def _rain_from(limit: float) -> Callable[[Array, Array, Array], Found]:
    """Rain [mm] of the hours around which air or sky stay below a limit."""

    def find(rain: Array, other: Array, hour: Array) -> Found:
        if len(hour) < 2:
            return SILENT
        around = np.maximum(other, np.maximum(np.r_[other[1:], other[-1]], np.r_[other[0], other[:-1]]))
        fell = float((rain * np.gradient(hour))[around < limit].sum())
        return fell, fell, limit

    return find


def _never_falls(rain: Array, hour: Array) -> Found:
    """Hours that a column holds or grows, where it stops for a while, or goes on all day by uneven steps."""
    step = np.diff(rain)
    if len(rain) < 2 * FEWEST or (step < 0.0).any() or not (step > 0.0).any():
        return SILENT
    lasts, grows = float(hour[-1] - hour[rain > 0.0][0]), step[step > 0.0]
    pause = float(np.diff(hour)[(step == 0.0) & (rain[1:] > 0.0)].sum())
    is_uneven = float(grows.std()) > UNEVEN * float(grows.mean())
    return (lasts, float(rain[-1])) if pause >= PAUSE or (is_uneven and lasts >= WHOLE_DAY) else SILENT


def _in_a_day(rain: Array, hour: Array) -> Found:
    fell = float(np.trapezoid(rain, hour)) / max(float(hour[-1] - hour[0]) / 24.0, 1.0)
    return fell, fell


def _spike(column: Array, hour: Array, wind: Array, rain: Array) -> Found:
    """How far a row lies off both beside it; less where it may be the cold air of a thunderstorm.

    That comes with more wind or rain; a table in which neither changes says nothing of it.
    """
    if len(column) < 3:
        return SILENT
    before, after = column[1:-1] - column[:-2], column[1:-1] - column[2:]
    same = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    is_calm = (np.diff(wind)[:-1] < GUST) & (np.diff(rain)[:-1] < RAINS)
    is_known = np.ptp(wind) > 0.0 or np.ptp(rain) > 0.0
    same = np.where((before > 0.0) | (is_calm & is_known), same, same - (OUTFLOW - FRONT))
    return _at_most(np.where(hour[2:] - hour[:-2] <= 3.0, same, 0.0), column[1:-1], hour[1:-1])


def _is_whole_day(hour: Array) -> bool:
    return len(hour) >= 2 * FEWEST and float(hour[-1] - hour[0]) >= WHOLE_DAY


def daily(column: Array, hour: Array) -> Found:
    """Amplitude of the wave of 24 h in a column, hour of its highest value, and its share of the variance.

    A trend over the day, of a front, belongs to neither.
    """
    angle = 2.0 * pi * hour / 24.0
    base = np.stack([np.ones_like(hour), hour - hour.mean(), np.cos(angle), np.sin(angle)], axis=1)
    fit = solve(product(base.T, base), product(base.T, column))
    rest = column - product(base, fit)
    wave = product(base[:, 2:], fit[2:])
    share = float(wave.var() / max(wave.var() + rest.var(), 1e-12))
    return (
        float(np.hypot(fit[2], fit[3])),
        atan2(fit[3], fit[2]) * 24.0 / (2.0 * pi) % 24.0,
        share,
    )


def _warm_at_night(temperature: Array, hour: Array) -> Found:
    """How far the warmest hour lies from 15 h, where the temperature goes as the sun does."""
    if not _is_whole_day(hour):
        return SILENT
    amplitude, top, share = daily(temperature, hour)
    if amplitude < WAVE or share < SHARE:
        return SILENT
    return abs((top - 15.0 + 12.0) % 24.0 - 12.0), top


def _moist_when_warm(temperature: Array, humidity: Array, hour: Array) -> Found:
    if not _is_whole_day(hour):
        return SILENT
    waves = daily(temperature, hour), daily(humidity, hour)
    if min(waves[0][2], waves[1][2]) < SHARE or waves[0][0] < WAVE:
        return SILENT
    apart = abs((waves[0][1] - waves[1][1] + 12.0) % 24.0 - 12.0)
    return 6.0 - apart, apart


def _wind_cools_not(wind: Array, temperature: Array, hour: Array, humidity: Array) -> Found:
    """Wind of the day times its wave of temperature [K m/s]: wind mixes the air, a storm has a small one."""
    if not _is_whole_day(hour) or float(np.median(humidity)) < ARID:
        return SILENT
    usual, swing = float(np.median(wind)), 2.0 * daily(temperature, hour)[0]
    return usual * max(swing, 5.0), usual, swing


def _gap(hour: Array) -> Found:
    step = np.diff(hour)
    if len(step) < 2 * FEWEST:
        return SILENT
    usual = float(np.median(step))
    wide = np.flatnonzero(step > 1.5 * usual)
    if not len(wide) or np.mean(np.abs(step - usual) < 0.1 * usual) < 0.75:
        return SILENT
    return float(len(wide)), float(hour[wide[0]]), float(hour[wide[0] + 1])


def _sky_is_covered(top: float, name: str, factor: str, *how: Any) -> Witness:
    shown = f"cloud_percent never leaves 0 to {{:g}}, as {name} do"
    return Witness(("cloud_percent",), within(top, *how), shown, f"are they {name}? x {factor}", 0.374)


CELSIUS = "are they K or degF?"
SIGHT = "is fog_mor_m a range in km? x 1000"
WITNESSES = (
    _sky_is_covered(1.0, "shares", "100", False, 0.75),
    _sky_is_covered(8.0, "oktas", "12.5", True, 6.0),
    _sky_is_covered(10.0, "tenths", "10", True, 9.0),
    Witness(("humidity_percent",), within(1.0), "humidity_percent never leaves 0 to {:g}", "a share? x 100",
            refused=0.0),
    Witness(("wind_azimuth_deg",), within(2.0 * pi, False, spread=0.5),
            "wind_azimuth_deg never leaves 0 to {:.2f}", "is it in rad?", 0.1),
    Witness(("fog_mor_m", "humidity_percent", "hour", "air_c", "falls", "blows"), _fog_is_wet,
            "a range of sight of {:.0f} m in air of {:.0f} % humidity at {:g} h", SIGHT),
    Witness(("fog_mor_m", "wind_m_s", "hour"), _in_fog(STORM, 9.0),
            "a range of sight of {:.0f} m in wind of {:.0f} m/s at {:g} h", SIGHT),
    Witness(("fog_mor_m", "rain_mm_h", "hour"), _in_fog(100.0, 0.9),
            "a range of sight of {:.0f} m in rain of {:.1f} mm/h at {:g} h", SIGHT),
    Witness(("fog_mor_m", "hour"), _fog_all_day, "a range of sight that never leaves 0 to {:.0f} m", SIGHT),
    Witness(("rain_mm_h", "humidity_percent", "hour"), _rain_from(DRY),
            "rain of {:.1f} mm from air below {:g} % humidity", "is it a running total?", RAINS),
    Witness(("rain_mm_h", "cloud_percent", "hour"), _rain_from(CLEAR),
            "rain of {:.1f} mm from a sky with less than {:g} % cloud",
            "is it a running total, or is the cloud no percent?", RAINS),
    Witness(("rain_mm_h", "hour"), _never_falls, "rain_mm_h never falls, to {:g} at the end",
            "is it a running total? its steps are the rain", HELD),
    Witness(("rain_mm_h", "hour"), _in_a_day, "{:.0f} mm of rain in a day", "is it a running total?", 300.0),
    Witness(("temperature_c",), lambda t: (float(t.max()), t.max()), "a temperature of {:.0f} deg C", CELSIUS,
            50.0),
    Witness(("temperature_c",), lambda t: (float(np.ptp(t)), np.ptp(t)),
            "temperature_c goes through {:.0f} K", "is its unit the same in all rows?", 40.0),
    Witness(("temperature_c", "hour", "blows", "falls"), _spike,
            "temperature_c leaps to {:.1f} at {:g} h and back", "does a number stand for none?", FRONT),
    Witness(("dew_point_c", "temperature_c", "hour"),
            lambda dew, t, hour: _at_most(dew - t, dew, t, hour),
            "a dew point of {:.1f} over {:.1f} deg C of the air, at {:g} h", "are they swapped?", 1.0, 5.0),
    Witness(("temperature_c", "humidity_percent", "hour"),
            lambda t, h, hour: _at_most(dew_point(t, h), t, h, hour),
            "{:.1f} deg C at {:.0f} % humidity, at {:g} h: moister than any air", CELSIUS, 33.0),
    Witness(("temperature_c", "humidity_percent", "dew_point_c", "hour"),
            lambda t, h, dew, hour: _at_most(
                np.abs(100.0 * vapour_pressure(dew) / vapour_pressure(t) - h), dew, h, hour),
            "a dew point of {:.1f} deg C against {:.0f} % humidity at {:g} h", "is one wrong?", 15.0),
    Witness(("temperature_c", "humidity_percent", "hour"), _moist_when_warm,
            "temperature and humidity rise together, {:.1f} h apart", "is one of them shifted?"),
    Witness(("wind_m_s", "temperature_c", "hour", "damp"), _wind_cools_not,
            "wind of {:.0f} m/s all day, and a night that cools by {:.0f} K", "is it in km/h or kn?", MIXED),
    *(Witness(("temperature_c", hours), _warm_at_night, f"the day is warmest at {{:.0f}} h, by the {hours}",
              "are its hours those of the zone of time?", off, key="timeline")
      for hours, off in (("sun", OFF_SUN), ("zone", OFF_CLOCK))),
    Witness(("hour",), _gap, "rows from {:g} to {:g} h are missing", "taken between their neighbours",
            key="lost"),
    Witness(("sun_off_deg",), lambda off: (off, off),
            "the sun of the file stands {:.0f} deg off that of time and place", "taken as said", 3.0,
            key="timeline"),
)  # fmt: skip
"""`sun`, else `zone`: hours by the sun where the place is known, else those of the zone
`air_c`, `falls`, `blows`, `damp`: temperature, rain, wind, humidity; of the scenario where the table has none
`sun_off_deg`: between the sun of the table and that of time and place
"""
