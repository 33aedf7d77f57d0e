"""The weather against printed numbers of its laws, and against itself by the hour."""

from datetime import datetime
from math import cos, hypot, inf, log, pi, sin

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.field.maps.projection import origin_at
from swath.field.weather import (
    Air,
    SiteWeather,
    Weather,
    extinction,
    fog_extinction,
    rain_extinction,
    sun_at,
)
from swath.runtime.assembly import assemble
from swath.scenario.scenario import parse_scenario

HOUR = 3600 * NS
NOON = "2026-07-25T13:34+02:00"


@pytest.mark.parametrize(("distance", "left"), [(20.0, 0.0910), (50.0, 0.00250)])
def test_fog_takes_what_its_optical_range_says_there_and_back(distance, left):
    for wavelength in (550e-9, 905e-9, 1550e-9):  # dense fog dims all alike
        assert np.exp(-2.0 * fog_extinction(50.0, wavelength) * distance) == pytest.approx(left, rel=0.005)


def test_haze_dims_by_wavelength_as_kruse_says():
    assert 1000.0 * fog_extinction(10_000.0, 905e-9, left=np.exp(-3.912)) == pytest.approx(0.2048, rel=1e-3)
    assert fog_extinction(inf, 905e-9) == 0.0
    mor = np.geomspace(50.0, 80_000.0, 60)
    assert (np.diff([fog_extinction(v, 905e-9) for v in mor]) < 0.0).all()


def test_drops_of_rain_are_those_of_marshall_and_palmer():
    """Twice the geometric section of 8000 exp(-4.1 R^-0.21 D) drops per m3 and mm, summed up."""
    d = np.linspace(0.0, 20.0, 20_001)  # [mm]
    for rain in (1.0, 10.0, 50.0):
        section = 0.25 * pi * (1e-3 * d) ** 2 * 8000.0 * np.exp(-4.1 * rain**-0.21 * d)
        assert rain_extinction(rain, "drops") == pytest.approx(2.0 * section.sum() * d[1], rel=0.01)
        assert 23.0 < rain_extinction(rain, "goodin") / rain_extinction(rain, "drops") < 28.0


def test_what_floats_together_adds_up():
    air = Air(rain=4.0, mor=200.0, dust=0.003)
    parts = fog_extinction(200.0, 905e-9), rain_extinction(4.0, "drops"), 0.003
    assert extinction(air, 905e-9) == pytest.approx(sum(parts))


@pytest.mark.parametrize(
    ("moment", "place", "zenith", "azimuth", "within"),
    [
        (
            "2003-10-17T12:30:30-07:00",
            (39.742476, -105.1786, 1830.14),
            50.1116,
            194.3402,
            0.01,
        ),  # their example
        (NOON, (52.3, 8.0, 0.0), 90.0 - 57.285, 179.75, 0.02),
    ],
)
def test_the_sun_stands_where_reda_and_andreas_print_it(moment, place, zenith, azimuth, within):
    pytest.importorskip("pvlib")
    origin = origin_at(*place)
    sun = sun_at(datetime.fromisoformat(moment), origin)
    assert 90.0 - np.degrees(sun.elevation) == pytest.approx(zenith, abs=within)
    true_north = np.degrees(sun.azimuth) + origin.grid()["convergence_deg"]
    assert true_north == pytest.approx(azimuth, abs=within)


def test_the_sun_goes_on_through_a_run_and_a_stated_one_stands_still():
    pytest.importorskip("pvlib")
    by_time = SiteWeather(Weather(time=NOON), origin_at(52.3, 8.0))
    morning, evening = by_time.sun(-4 * HOUR), by_time.sun(5 * HOUR + 26 * 60 * NS)
    assert morning.azimuth < by_time.sun(0).azimuth < evening.azimuth
    assert 1.0 / np.tan(evening.elevation) == pytest.approx(2.66, abs=0.01)  # shadow of 1 m at 19 h
    stated = SiteWeather(Weather(sun_azimuth_deg=90.0, sun_elevation_deg=30.0, time=NOON))
    assert stated.sun(0) == stated.sun(5 * HOUR)
    assert SiteWeather(Weather(rain_mm_h=2.0)).sun(0) is None


def test_a_file_gives_the_weather_between_its_hours(tmp_path):
    file = tmp_path / "day.csv"
    file.write_text("hour,rain_mm_h,wind_m_s,wind_azimuth_deg,temperature_c\n12,0,2,350,20\n14,6,2,10,26\n")
    weather = SiteWeather(Weather(time="2026-07-25T12:30:00+02:00", dust_per_m=0.01, file=str(file)))
    assert weather.at(0).rain == pytest.approx(1.5)
    air = weather.at(HOUR // 2)
    assert (air.rain, air.temperature, air.dust) == pytest.approx((3.0, 273.15 + 23.0, 0.01))
    assert air.wind == pytest.approx((0.0, 2.0 * cos(np.radians(10.0))))  # north between 350 and 10 deg
    assert weather.at(9 * HOUR).rain == 6.0
    assert weather.may_be_dim
    assert weather.beyond(HOUR) == []
    nearest = "beyond the hours of its file, 12 to 14, its nearest row is taken"
    assert weather.beyond(2 * HOUR) == [f"field.weather: derived: {nearest}"]
    assert weather.beyond() == [f"field.weather: derived: straw dries through a whole day; {nearest}"]
    for text, expected in (
        ("hour,rain_mm_h\n12,0\n14,-1", r"plausible = rain_mm_h -1: expected >= 0; is it .*:3\)"),
        ("hour,wind_m_s\n12,3\n14,1e9", r"plausible = wind_m_s 1e\+09: expected <= 30; .*:3\)"),
        ("hour,rain_mm_h\n12,", r"plausible = rain_mm_h nan: expected a finite .* \(.*:2\)"),
        ("hour,rain_mm_h\n12,0\n49,0", r"timeline = 49.0: expected an hour of the day, .*48 \(.*:3\)"),
        ("hour,rain_mm_h\n12,0\n14:30,0", r"hour = 14:30: expected a number such as 10.5 \(.*:3\)"),
        ('hour,rain_mm_h\n12,"0,5"', r"rain_mm_h = 0,5: expected a number such as 10.5 \(.*:2\)"),
        ("hour,rain_mm_h\n12,0\n13,0,5", r"table = 13,0,5: expected 2 cells, with points in .* \(.*:3\)"),
        ("hour;rain_mm_h\n12;0,5;", r"expected commas between columns, and points in numbers \(.*:1\)"),
        ("# of DWD\nhour,rain_mm_h\n12,0", r"expected the names of columns, no comment \(.*:1\)"),
        (
            "Stunde,rain_mm_h\n12,0",
            "Stunde: unknown column, expected one of hour, rain_mm_h, .*cloud_percent",
        ),
        ("hour,sun_elevation_deg\n12,40\n15,30", "sun_azimuth_deg: expected both angles of the sun"),
        ("hour,rain\n12,1", r"rain: unknown column, did you mean 'rain_mm_h'.*:1\)"),
        ("Hour,rain_mm_h\n12,1", "did you mean 'hour'"),
        ("hour;rain_mm_h\n12;1", r"expected commas between columns, .* \(.*:1\)"),
        ("hour,rain_mm_h, rain_mm_h\n12,0,1", "table = rain_mm_h: expected each column once"),
        ("hour,rain_mm_h\n12,1\n11,1", r"timeline = hour 11 after 12: .*rise \(.*:3\)"),
        ("hour,rain_mm_h\n3,1\n4,1", "time = .* within the hours of the file, 3 to 4"),
    ):
        file.write_text(text + "\n")
        with pytest.raises(InputError, match=expected):
            SiteWeather(Weather(time=NOON, file=str(file)))


@pytest.mark.parametrize(("begin", "after_h"), [("25T23:30", 0.5), ("26T00:30", -0.5)])
def test_a_night_is_given_in_hours_beyond_24(tmp_path, begin, after_h):
    file = tmp_path / "night.csv"
    file.write_text("hour,temperature_c\n22,22\n26,14\n")
    weather = SiteWeather(Weather(time=f"2026-07-{begin}+02:00", file=str(file)))
    for h in np.linspace(-2.0, 2.0, 9):
        assert weather.at(round((h + after_h) * HOUR)).temperature == pytest.approx(273.15 + 18.0 - 2.0 * h)
    end = round((2.0 + after_h) * HOUR)
    assert weather.at(end + HOUR).temperature == pytest.approx(273.15 + 14.0)
    assert (weather.beyond(end), len(weather.beyond(end + HOUR))) == ([], 1)
    assert weather.notes == [f"clock: hours of {file.name} are taken in the zone of time, UTC+0200"]


def test_wind_blows_where_its_azimuth_points():
    draw = np.random.default_rng(5)
    for azimuth, speed in zip(draw.uniform(-360, 360, 20), draw.uniform(0, 30, 20), strict=True):
        wind = SiteWeather(Weather(wind_azimuth_deg=azimuth, wind_m_s=speed)).at(0).wind
        a = np.radians(azimuth)
        assert wind == pytest.approx((speed * sin(a), speed * cos(a)), abs=1e-9)
        assert hypot(*wind) == pytest.approx(speed)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{time: yesterday}", "expected a time with its zone"),
        ("{time: '2026-02-30T12:00+01:00'}", "time = 2026-02-30.*: expected a time with its zone"),
        ("{time: '9999-12-31T12:00+01:00'}", "1900 to 2100"),
        ("{rain_mm_h: -1}", "weather.rain_mm_h = -1: expected >= 0"),
        ("{rain_mm_h: .nan}", "weather.rain_mm_h = .nan: expected a finite number"),
        ("{wind_azimuth_deg: 361}", "weather.wind_azimuth_deg = 361: expected <= 360"),
        ("{time: '2026-07-25T13:34'}", "expected a time with its zone"),
        ("{time: '2026-07-25T13:34+02:00'}", "expected a field that lies on Earth"),
        ("{sun_azimuth_deg: 10}", "expected both angles of the sun"),
        ("{fog_mor: 100}", "fog_mor_m"),
    ],
)
def test_weather_that_cannot_be_is_one_clear_error(text, expected):
    with pytest.raises(InputError, match=expected):
        assemble(parse_scenario(SCENARIO.format(weather=text, lidar="", stand="")))


SCENARIO = """
format: swath scenario 2
name: weather
run: {{distance_m: 4, max_duration_s: 6}}
field:
  weather: {weather}
  stand: {{level: uniform, {stand}}}
  edge: {{shape: straight}}
machines:
  combine:
    motion: single_track
    lidar: {{sub_rays: 1, step_deg: 10{lidar}}}
    radar: {{level: error}}
    camera: {{width_px: 8, height_px: 6}}
"""
DIM = "{rain_mm_h: 10, fog_mor_m: 200, dust_per_m: 0.01, wind_m_s: 3, cloud_percent: 40}"


def test_all_sensors_have_the_weather_of_the_field_and_their_own_keys_win():
    plain = assemble(parse_scenario(SCENARIO.format(weather=DIM, lidar="", stand="wind: {}")))
    parts, fog = plain.leader.parts, log(20.0) / 200.0
    lidar, camera = parts["lidar"].weather_at(0), parts["camera"]._light_setup(0)
    assert lidar.extinction == pytest.approx(fog + 0.01 + 0.01 * 10**0.6, rel=1e-3)
    assert camera.extinction == pytest.approx(fog + 0.01 + 3.65e-4 * 10**0.63)
    assert parts["camera"].sky(0)[1] == 0.4
    assert parts["radar"]._rain > 0.0
    assert plain.field.wind.amplitude == pytest.approx(np.tan(np.radians(0.2 * 9.0)))
    own = ", weather: {rain_mm_h: 0, extinction_per_m: 0.2, rain_law: drops}"
    lidar = assemble(parse_scenario(SCENARIO.format(weather=DIM, lidar=own, stand=""))).leader.parts["lidar"]
    assert lidar.weather_at(0).extinction == pytest.approx(0.2 + fog, rel=1e-3)
