"""Downloads of weather services as they come, and what tables of weather say of their own units."""

from datetime import datetime, timedelta

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.documents.reasons import doubts
from swath.field.maps.projection import origin_at
from swath.field.weather import KELVIN, SiteWeather, Weather, sun_at

HOUR = 3600 * NS
HOURS = np.arange(25)
TIME = "2026-07-25T13:00+02:00"
EPW_ROW = (
    "{y},{m},{d},{h},60,?9,{t},99.9,50,99000" + 10 * ",0" + ",270,4.0,5,5,20.0,777,9,9,10,0.1,0,88,0.2,0.0,1"
)
EPW_HEAD = (
    "LOCATION,M\u00fcnchen,BY,DEU,IWEC,1,48.13,11.70,1.0,529.0\nDATA PERIODS,1,1,Data,Sunday,1/1,12/31\n"
)
POWER = """-BEGIN HEADER-
NASA/POWER Source Native Resolution Hourly Data
Dates (month/day/year): 07/25/2026 through 07/25/2026 in {zone}
Location: Latitude  48.0   Longitude 11.0
Parameter(s):
T2M                   MERRA-2 Temperature at 2 Meters (C)
PRECTOTCORR           MERRA-2 Precipitation Corrected ({rain})
WS10M                 MERRA-2 Wind Speed at 10 Meters (m/s)
-END HEADER-
YEAR,MO,DY,HR,T2M,PRECTOTCORR,WS10M
"""
METEO = "latitude,longitude,elevation,utc_offset_seconds,timezone,timezone_abbreviation\n"
METEO += "48.0,11.0,500.0,{off},Europe/Berlin,CEST\n\n"


def read(folder, text, name="a.csv", time=TIME, coding="utf-8"):
    (folder / name).write_text(text, encoding=coding)
    return SiteWeather(Weather(time=time, file=name), folder=folder)


def celsius(weather, hours=0.0):
    return weather.at(round(hours * HOUR)).temperature - KELVIN


def test_hours_of_an_epw_are_their_ends_in_standard_time_of_any_year(tmp_path):
    rows = [EPW_ROW.format(y=1984, m=7, d=d, h=h, t=h) for d in (24, 25, 26) for h in range(1, 25)]
    weather = read(tmp_path, EPW_HEAD + "\n".join(rows) + "\n", coding="cp1252")
    air = weather.at(0)
    assert celsius(weather) == pytest.approx(12.0)  # 13:00 of summer time
    assert air.wind == pytest.approx((4.0 * 0.748, 0.0), abs=2e-3)  # from the west, at 10 m
    assert (air.cloud, air.mor, air.humidity) == pytest.approx((0.5, 20_000.0, 0.5))
    assert weather.notes[0].startswith("form: a.csv is of EPW: temperature_c of dry bulb [C]")


def test_the_turn_of_a_year_and_its_leap_day_are_in_any_epw(tmp_path):
    days = [datetime(1999, 1, 1) + timedelta(days=k) for k in range(365)]
    rows = [EPW_ROW.format(y=1999, m=t.month, d=t.day, h=h, t=t.month) for t in days for h in range(1, 25)]
    text = EPW_HEAD + "\n".join(rows) + "\n"
    assert celsius(read(tmp_path, text, time="2026-12-31T12:00+01:00"), 20.0) == pytest.approx(1.0)
    assert celsius(read(tmp_path, text, time="2027-01-01T00:30+01:00")) == pytest.approx(6.5, abs=6.0)
    assert doubts(read(tmp_path, text, time="2028-02-29T12:00+01:00").notes) == ["lost"]


@pytest.mark.parametrize(("zone", "shift"), [("UTC", 2.0), ("LST", 1.0)])
@pytest.mark.parametrize(("rain", "factor"), [("mm/hour", 1.0), ("mm/day", 1 / 24)])
def test_power_gives_means_of_hours_in_utc_or_by_the_sun(tmp_path, zone, shift, rain, factor):
    rows = "".join(f"2026,7,25,{h},{h},{h},5\n" for h in range(24))
    weather = read(tmp_path, POWER.format(zone=zone, rain=rain) + rows)
    hour = 13.0 - shift - 0.5
    assert (celsius(weather), weather.at(0).rain) == pytest.approx((hour, hour * factor))
    with pytest.raises(InputError, match="form = NASA POWER: expected NASA POWER by the hour"):
        read(tmp_path, "-BEGIN HEADER-\n-END HEADER-\nYEAR,MO,DY,T2M\n2026,7,25,3\n")


@pytest.mark.parametrize(
    ("unit", "factor"), [("km/h", 1 / 3.6), ("m/s", 1.0), ("mp/h", 0.44704), ("kn", 0.51444)]
)
@pytest.mark.parametrize("stamped", ["iso", "unix"])
def test_open_meteo_says_its_units_and_its_zone(tmp_path, unit, factor, stamped):
    head = (
        METEO.format(off=7200)
        + f"time,temperature_2m (°F),wind_speed_10m ({unit}),wind_direction_10m (°),rain (inch)\n"
    )
    begin = datetime(2026, 7, 25)
    stamps = [begin + timedelta(hours=h) for h in range(25)]
    seconds = [round((t - datetime(1970, 1, 1)).total_seconds()) - 7200 for t in stamps]
    told = [f"{t:%Y-%m-%dT%H:%M}" for t in stamps] if stamped == "iso" else seconds
    weather = read(tmp_path, head + "".join(f"{t},{50 + h},3.6,90,0.1\n" for h, t in enumerate(told)))
    assert celsius(weather) == pytest.approx((63.0 - 32.0) / 1.8)
    assert weather.at(0).wind == pytest.approx((-3.6 * factor * 0.748, 0.0), abs=2e-3)
    assert weather.at(0).rain == pytest.approx(2.54)
    with pytest.raises(InputError, match="form = Open-Meteo: expected Open-Meteo by the hour"):
        read(tmp_path, METEO.format(off=0) + "time,temperature_2m_max (°C)\n2026-07-25,20\n")


def test_products_of_the_dwd_are_utc_with_gaps(tmp_path):
    rows = [f"  44;20260725{h:02d};    3;{h:6.1f};  62.0;eor" for h in range(24)]
    rows[11] = "  44;2026072511;    3;  -999;  -999;eor"
    text = "STATIONS_ID;MESS_DATUM;QN_9;TT_TU;RF_TU;eor\n"
    weather = read(tmp_path, text + "\n".join(rows) + "\n", "produkt_tu_stunde.txt")
    assert celsius(weather) == pytest.approx(11.0)
    assert doubts(weather.notes) == ["lost", "lost"]
    okta = "".join(f"  44;20260725{h:02d}00; 3; 7;eor\n" for h in range(24))
    assert read(tmp_path, "STATIONS_ID;MESS_DATUM;QN_8;V_N;eor\n" + okta).at(0).cloud == pytest.approx(0.875)
    for text, said in (
        (
            "STATIONS_ID;MESS_DATUM;QN_3;FM;eor\n44;20260725;3;4.0;eor\n",
            "form = DWD CDC: expected DWD CDC by",
        ),
        (
            "STATIONS_ID;MESS_DATUM;QN_3;FX_911;eor\n44;2026072511;3;4.0;eor\n",
            "columns = .*expected one of TT_TU",
        ),
        (
            "STATIONS_ID;MESS_DATUM;QN_8;R1;eor\n44;2026072511;3;0,4;eor\n",
            "damaged = 0,4: expected a number of R1",
        ),
        (
            "STATIONS_ID;MESS_DATUM;QN_8;R1;eor\n44;2025072511;3;0.4;eor\n",
            "expected a day of the file, 2025-07-25 to",
        ),
    ):
        with pytest.raises(InputError, match=said):
            read(tmp_path, text)


def table(folder, start=TIME, origin=None, **more):
    """25 hours of a usual day in summer; columns over the usual ones."""
    wave = np.sin((HOURS - 9) / 24 * 2 * np.pi)
    columns = {"hour": HOURS, "temperature_c": 18 + 8 * wave, "humidity_percent": 65 - 25 * wave, **more}
    rows = [
        ",".join(columns),
        *(",".join(f"{v:g}" for v in row) for row in zip(*columns.values(), strict=True)),
    ]
    (folder / "a.csv").write_text("\n".join(rows) + "\n")
    return SiteWeather(Weather(time=start, file="a.csv"), origin, folder).notes[1:]


CLOUDY = np.array([0, 1, 3, 5, 7, 8, 8, 7, 6, 4, 5, 6, 7, 7, 5, 8, 8, 8, 7, 5, 4, 3, 2, 1, 0])
FOG = np.where(HOURS == 13, 150.0, 9000.0)
TOLD = {
    "oktas": ({"cloud_percent": CLOUDY}, "plausible: cloud_percent never leaves 0 to 8, as oktas do"),
    "tenths": (
        {"cloud_percent": np.minimum(CLOUDY + 2, 10)},
        "plausible: cloud_percent never leaves 0 to 10",
    ),
    "share": ({"cloud_percent": CLOUDY / 8}, "plausible: cloud_percent never leaves 0 to 1, as shares"),
    "fog": ({"fog_mor_m": FOG}, "plausible: a range of sight of 150 m in air of 43 % humidity at 13 h"),
    "rain": (
        {"rain_mm_h": np.full(25, 0.5), "cloud_percent": 0 * HOURS},
        "plausible: rain of 12.5 mm from a sky",
    ),
    "total": ({"rain_mm_h": np.minimum(HOURS, 9.0)}, "plausible: rain_mm_h never falls, to 9 at the end"),
    "kn": (
        {"wind_m_s": np.full(25, 11.0)},
        "plausible: wind of 11 m/s all day, and a night that cools by 16 K",
    ),
    "rad": ({"wind_azimuth_deg": 3 + np.sin(HOURS)}, "plausible: wind_azimuth_deg never leaves 0 to 6.28"),
    "degF": ({"temperature_c": 41 + 9.0 * np.sin(HOURS)}, "moister than any air; are they K or degF"),
    "gap": ({"hour": HOURS + 4 * (HOURS > 9)}, "lost: rows from 9 to 14 h are missing"),
    "fog in a storm": (
        {"fog_mor_m": FOG / 5, "wind_m_s": np.full(25, 10.0)},
        "plausible: a range of sight of 30 m",
    ),
    "total of a wet day": (
        {"rain_mm_h": np.cumsum(HOURS % 5 / 10), "humidity_percent": np.full(25, 95.0)},
        "plausible: rain_mm_h never falls",
    ),
    "spike in calm air": (
        {"temperature_c": np.where(HOURS == 9, 11.0, 20.0), "wind_m_s": 2 + HOURS % 2},
        "plausible: temperature_c leaps to 11.0 at 9 h",
    ),
    "turned": (
        {"temperature_c": 18 - 8 * np.sin((HOURS - 9) / 12 * np.pi)},
        "timeline: the day is warmest at 3 h",
    ),
    "spike": (
        {"temperature_c": np.where(HOURS == 9, 0.0, 20.0)},
        "plausible: temperature_c leaps to 0.0 at 9 h",
    ),
}


@pytest.mark.parametrize("case", TOLD)
def test_a_column_in_another_unit_is_told(tmp_path, case):
    columns, said = TOLD[case]
    assert said in "\n".join(table(tmp_path, **columns))


DRY = {"humidity_percent": np.full(25, 20.0)}
RARE = {
    "smoke": {"fog_mor_m": np.full(25, 800.0), "humidity_percent": np.full(25, 35.0)},
    "haze": {"fog_mor_m": np.full(25, 4000.0), **DRY},
    "dust storm": {"fog_mor_m": np.where(HOURS > 14, 60.0, 2e4), "wind_m_s": np.full(25, 14.0), **DRY},
    "dust that floats on": {
        "fog_mor_m": np.where(HOURS > 14, 90.0, 2e4),
        "wind_m_s": 8.0 * (HOURS < 16),
        **DRY,
    },
    "gust front": {"temperature_c": np.where(HOURS == 16, 13.0, 22.0)},
    "gust front with wind": {
        "temperature_c": np.where(HOURS == 16, 12.0, 22.0),
        "wind_m_s": np.where(HOURS == 16, 11.0, 2.0),
    },
    "gust front with rain": {
        "temperature_c": np.where(HOURS == 16, 12.0, 22.0),
        "humidity_percent": np.full(25, 70.0),
        "rain_mm_h": np.where(HOURS == 16, 8.0, 0.0),
    },
    "rain that grows": {"rain_mm_h": HOURS / 4.0, "humidity_percent": np.full(25, 90.0)},
    "rain from noon": {"rain_mm_h": np.maximum(HOURS - 12, 0) * 0.5, "humidity_percent": np.full(25, 95.0)},
    "wind of a warm day": {
        "wind_m_s": np.full(25, 11.0),
        "temperature_c": 28 + 5 * np.sin((HOURS - 9) * 0.26),
    },
    "steady azimuth": {"wind_azimuth_deg": 3.5 + 0.1 * (HOURS % 3)},
    "clear, 0 and 1 %": {"cloud_percent": HOURS % 2},
    "clear, 0 to 4 %": {"cloud_percent": HOURS % 5},
    "clear, less than 1 %": {"cloud_percent": 0.1 * (HOURS % 7)},
}


@pytest.mark.parametrize("case", RARE)
def test_rare_weather_is_no_doubt(tmp_path, case):
    assert table(tmp_path, **RARE[case]) == []


def test_a_usual_day_and_a_clear_one_are_not_doubted(tmp_path):
    clear = np.array([0, 0, 0, 2, 5, 8, 3, 1] + [0] * 17)
    assert table(tmp_path, cloud_percent=clear, wind_m_s=2 + 0 * HOURS, rain_mm_h=0 * HOURS) == []
    with pytest.raises(InputError, match=r"plausible = humidity_percent never leaves 0 to 1: .*a share"):
        table(tmp_path, humidity_percent=np.full(25, 0.6))


def test_the_sun_of_a_table_is_that_of_time_and_place(tmp_path):
    pytest.importorskip("pvlib")
    place = origin_at(48.0, 11.0)
    day = datetime.fromisoformat(TIME).replace(hour=0)
    true = [sun_at(day + timedelta(hours=int(h)), place) for h in HOURS]
    sun = {
        "sun_azimuth_deg": np.degrees([s.azimuth for s in true]),
        "sun_elevation_deg": np.degrees([s.elevation for s in true]),
    }
    assert not [n for n in table(tmp_path, origin=place, **sun) if "sun of the file" in n]
    late = table(tmp_path, origin=place, **{key: np.roll(column, 6) for key, column in sun.items()})
    assert "timeline: the sun of the file stands" in "\n".join(late)
