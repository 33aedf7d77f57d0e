"""Logs whose units nothing says, or something says wrongly: the true field, or a refusal with the cause."""

import gzip
import re
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("scipy")
pytest.importorskip("shapefile")

from swath.core.errors import InputError
from swath.documents.reasons import doubts
from swath.field_io.clean import clean
from swath.field_io.importer import import_log
from swath.field_io.logs.columns import guess
from swath.field_io.logs.log import read_log
from tests.field import made_exports
from tests.field.unit_logs import (
    ACRE,
    FT,
    LB,
    MPH,
    Harvest,
    ag_leader,
    deere,
    deere_metric,
    shapes,
    sms,
    stamps,
    table,
)
from tests.shared_data import DATA

IOWA, BAVARIA, SASKATCHEWAN, KANSAS = (42.0, -93.5), (48.0, 11.0), (52.0, -106.0), (38.5, -98.5)
CORDOBA, WAGGA, UKRAINE = (-32.0, -63.5), (-35.0, 147.0), (49.0, 32.0)


def bare(path, h, **columns):
    return table(path / "log.csv", {**h.places(), "Time": h.t, **columns})


def clocked(path, h, **clock):
    rest = {"width_m": h.width * h.one, "yield_t_ha": 10 * h.wet, "moisture": 100 * h.moisture * h.one}
    return table(path / "log.csv", {**h.places(), **clock, **rest})


FORMS = {
    # John Deere's names, no unit anywhere
    "deere 20 ft": (Harvest(*IOWA, width=20 * FT), lambda p, h: deere(p / "d", h)),
    "deere 30 ft": (Harvest(*KANSAS, width=30 * FT), lambda p, h: deere(p / "d", h)),
    "deere maize": (Harvest(*IOWA, width=30 * FT, level=1.1, moisture=0.18),
                    lambda p, h: deere(p / "d", h, crop="Corn")),
    "deere metric names": (Harvest(*UKRAINE, width=9.15), lambda p, h: deere(p / "d", h, us=False)),
    "deere metric names in Canada": (Harvest(*SASKATCHEWAN, width=12.2),
                                     lambda p, h: deere(p / "d", h, us=False, mass=1e4)),
    "deere soy 40 ft": (Harvest(*IOWA, width=40 * FT, level=0.35, speed=2.4),
                        lambda p, h: deere(p / "d", h, crop="Soybeans")),
    "deere speed of vehicle": (Harvest(*IOWA, width=35 * FT),
                               lambda p, h: deere(
                                   p / "d", h, fields=("DISTANCE", "SWATHWIDTH", "VEHICLSPEED"))),
    "operations center metric": (Harvest(), lambda p, h: deere_metric(p / "d", h)),
    "operations center kg/ha": (Harvest(), lambda p, h: deere_metric(p / "d", h, mass=1e4)),
    "operations center sections": (Harvest(width=12.3), lambda p, h: deere_metric(p / "d", h, sections=3)),
    "operations center dt/ha": (
        Harvest(width=7.6, level=0.81), lambda p, h: deere_metric(p / "d", h, mass=100)),
    # names alone
    "bare t/ha km/h": (Harvest(), lambda p, h: bare(
        p, h, Width=9 * h.one, Yield=h.wet * 10, Moisture=14 * h.one, Speed=7.2 * h.one)),
    "bare dt/ha m/s": (Harvest(), lambda p, h: bare(
        p, h, Width=9 * h.one, Yield=h.wet * 100, Moisture=14 * h.one, Speed=2 * h.one)),
    "bare bu/ac mph": (Harvest(*KANSAS, width=30 * FT), lambda p, h: bare(
        p, h, Width=30 * h.one, Yield=h.wet * ACRE / 60 / LB, Moisture=14 * h.one, Speed=2 / MPH * h.one)),
    "bare lb/ac": (Harvest(*KANSAS, width=30 * FT), lambda p, h: bare(
        p, h, Width=30 * h.one, Yield=h.wet * ACRE / LB, Speed=2 / MPH * h.one)),
    "bare kg/ha in Australia": (
        Harvest(*WAGGA, width=13.7, level=0.21, speed=2.6, length=250.0), lambda p, h: bare(
        p, h, Swath=13.7 * h.one, Yield=h.wet * 1e4, Speed=2.6 * h.one)),
    "bare flow in lb/s, width in inches": (Harvest(*IOWA, width=6.096), lambda p, h: bare(
        p, h, Swath=240 * h.one, Flow=h.flow / LB, Distance=2 / 0.0254 * h.one)),
    "bare flow in t/h": (Harvest(width=12.0, level=0.9), lambda p, h: bare(
        p, h, Width=12 * h.one, Flow=h.flow * 3.6, Speed=7.2 * h.one)),
    # moisture as a share
    "share, dry yield": (Harvest(moisture=0.2), lambda p, h: table(p / "a.csv", {
        **h.places(), "time": h.t, "width_m": 9 * h.one, "dry_yield_t_ha": h.dry() * 10,
        "moisture": 0.2 * h.one})),
    "share, flow": (Harvest(moisture=0.17), lambda p, h: table(p / "a.csv", {
        **h.places(), "time": h.t, "width_m": 9 * h.one, "flow_kg_s": h.flow, "moisture": 0.17 * h.one})),
    "share, bare names": (Harvest(*CORDOBA, moisture=0.11, width=10.5), lambda p, h: bare(
        p, h, Width=10.5 * h.one, Dry_Yield=h.dry() * 10, Moisture=0.11 * h.one)),
    # clocks
    "HHMMSS": (Harvest(), lambda p, h: clocked(p, h, utc_time=stamps(h, "%H%M%S"))),
    "HHMMSS.ss": (Harvest(begun=datetime(2024, 7, 20, 9, 59)), lambda p, h: clocked(
        p, h, time=[s + ".00" for s in stamps(h, "%H%M%S")])),
    "HHMMSSss": (Harvest(), lambda p, h: clocked(p, h, time=[s + "00" for s in stamps(h, "%H%M%S")])),
    "date and HHMMSS over midnight": (Harvest(begun=datetime(2024, 7, 20, 23, 45)), lambda p, h: clocked(
        p, h, Date=stamps(h, "%m/%d/%Y"), Time=stamps(h, "%H%M%S"))),
    "eight digits and HHMMSS": (Harvest(begun=datetime(2024, 7, 20, 23, 50)), lambda p, h: clocked(
        p, h, Date=stamps(h, "%Y%m%d"), Time=stamps(h, "%H%M%S"))),
    "HHMMSS over midnight": (Harvest(begun=datetime(2024, 7, 20, 23, 45)), lambda p, h: clocked(
        p, h, Time=stamps(h, "%H%M%S"))),
    "YYYYMMDDHHMMSS": (Harvest(), lambda p, h: clocked(p, h, timestamp=stamps(h, "%Y%m%d%H%M%S"))),
    "HMMSS before ten": (Harvest(begun=datetime(2024, 7, 20, 9, 50)), lambda p, h: clocked(
        p, h, time=[str(int(s)) for s in stamps(h, "%H%M%S")])),
    "YYMMDDHHMMSS": (Harvest(), lambda p, h: clocked(p, h, time=stamps(h, "%y%m%d%H%M%S"))),
    "ms of the day and date": (Harvest(begun=datetime(2024, 7, 31, 23, 50)), lambda p, h: clocked(
        p, h, Date=stamps(h, "%Y-%m-%d"), Time=[
            f"{1000 * (3600 * w.hour + 60 * w.minute + w.second)}" for w in h.when])),
    "ms of the GPS week": (Harvest(), lambda p, h: clocked(
        p, h, iTOW=[f"{(380000 + s) * 1000:.0f}" for s in h.t])),
    "s of the GPS week": (Harvest(), lambda p, h: clocked(p, h, gps_time=[f"{380000 + s:.0f}" for s in h.t])),
    "days of a spreadsheet": (Harvest(), lambda p, h: clocked(p, h, time=45127.4166 + h.t / 86400)),
    "days, five decimals": (Harvest(), lambda p, h: clocked(
        p, h, time=[f"{45127.4166 + s / 86400:.5f}" for s in h.t])),
    "julian days": (Harvest(), lambda p, h: clocked(p, h, time=2460512.9166 + h.t / 86400)),
    "hours": (Harvest(), lambda p, h: clocked(p, h, time=10 + h.t / 3600)),
    "unix ms": (Harvest(), lambda p, h: clocked(p, h, timestamp=[f"{(1.72e9 + s) * 1000:.0f}" for s in h.t])),
    "ms, 5 Hz": (Harvest(interval=0.2), lambda p, h: clocked(p, h, time=[f"{1000 * s:.0f}" for s in h.t])),
    # SMS
    "sms ft": (Harvest(*IOWA, width=29.5 * FT), lambda p, h: sms(p / "s", h)),
    "sms metric": (Harvest(), lambda p, h: sms(p / "s", h, us=False)),
    "sms dry bushels only": (Harvest(*IOWA, width=40 * FT), lambda p, h: sms(
        p / "s", h, grain=("Yld_Vol_Dr",))),
    "sms wet bushels": (Harvest(*IOWA, width=30 * FT), lambda p, h: shapes(p / "s", h, {
        "Distance_f": h.speed / FT * h.one, "Duration_s": h.one, "Swth_Wdth_": 30 * h.one,
        "Yld_Vol_We": h.wet * ACRE / 60 / LB, "Speed_mph_": h.speed / MPH * h.one, "Elevation_": h.z / FT})),
    "sms without speed": (Harvest(*IOWA, width=40 * FT), lambda p, h: sms(
        p / "s", h, drop=("Distance_f", "Speed_mph_"))),
    "sms mass in Argentina": (Harvest(*CORDOBA, width=6.825), lambda p, h: sms(
        p / "s", h, us=False, grain=("Yld_Mass_W",))),
    # Ag Leader without a header line
    "yield monitor 2000": (Harvest(*IOWA, width=15 * FT, z=299.0), lambda p, h: ag_leader(
        p / "a.txt", h, width="ft", height=1.0, status=(" Down", " Up"))),
    "yield monitor 2000, 30 ft": (Harvest(*KANSAS, width=30 * FT, z=560.0), lambda p, h: ag_leader(
        p / "a.txt", h, width="ft", height=1.0, status=("DOWN", "UP"))),
    "yield monitor 2000, inches": (Harvest(*IOWA, width=30 * FT), lambda p, h: ag_leader(
        p / "a.txt", h, height=1.0, status=("Down", "Up"))),
    "advanced": (Harvest(*IOWA, width=30 * FT), lambda p, h: ag_leader(p / "a.txt", h)),
    "advanced in feet": (Harvest(*IOWA, width=30 * FT), lambda p, h: ag_leader(p / "a.txt", h, width="ft")),
    "16 columns, no PDOP": (Harvest(*IOWA, width=30 * FT), lambda p, h: ag_leader(
        p / "a.txt", h, drop=(15,))),
    "16 columns, no status": (Harvest(*IOWA, width=20 * FT), lambda p, h: ag_leader(
        p / "a.txt", h, drop=(14,))),
    "15 columns": (Harvest(*KANSAS, width=30 * FT), lambda p, h: ag_leader(p / "a.txt", h, drop=(14, 15))),
    "16 columns, no load": (Harvest(*IOWA, width=20 * FT), lambda p, h: ag_leader(
        p / "a.txt", h, drop=(12,))),
    "16 columns, no serial, feet": (Harvest(*IOWA, width=20 * FT), lambda p, h: ag_leader(
        p / "a.txt", h, drop=(10,), width="ft", height=1.0, status=("Down", "Up"))),
    # names that dBASE cut
    "german": (Harvest(), lambda p, h: shapes(p / "s", h, {
        "Uhrzeit": stamps(h, "%H:%M:%S"), "Geschw_kmh": 7.2 * h.one, "Arbeitsbreite": 9 * h.one,
        "Ertrag_t_ha": h.wet * 10, "Kornfeuchte": 14 * h.one, "Hoehe_m": h.z})),
    "german, no units": (Harvest(), lambda p, h: shapes(p / "s", h, {
        "Zeitstempel": stamps(h), "Geschwindigkeit": 7.2 * h.one, "Schnittbreite": 9 * h.one,
        "Ertrag": h.wet * 100, "Feuchtigkeit": 14 * h.one, "Hoehe": h.z})),
    "german, dry yield": (Harvest(moisture=0.16), lambda p, h: shapes(p / "s", h, {
        "Zeitstempel": stamps(h), "Fahrgeschwindigkeit": 7.2 * h.one, "Schneidwerksbreite": 9 * h.one,
        "Trockenertrag": h.dry() * 100, "Kornfeuchtigkeit": 16 * h.one})),
    "french": (Harvest(), lambda p, h: shapes(p / "s", h, {
        "Horodatage": stamps(h), "Vitesse_km_h": 7.2 * h.one, "Largeur_de_coupe": 9 * h.one,
        "Rendement_t_ha": h.wet * 10, "Humidite_grain": 14 * h.one, "Altitude": h.z})),
    "french, brackets": (Harvest(), lambda p, h: shapes(p / "s", h, {
        "Horodatage": stamps(h), "Vitesse (km/h)": 7.2 * h.one, "Largeur (m)": 9 * h.one,
        "Rendement (q/ha)": h.wet * 100, "Humidite (%)": 14 * h.one})),
    "french flow": (Harvest(width=7.5), lambda p, h: shapes(p / "s", h, {
        "Horodatage": stamps(h), "Vitesse_avancement": 7.2 * h.one, "Largeur_travail": 7.5 * h.one,
        "Debit_grain": h.flow, "Humidite_grain": 14 * h.one})),
    "english": (Harvest(), lambda p, h: shapes(p / "s", h, {
        "Timestamp": stamps(h), "Ground_Speed": 7.2 * h.one, "Working_Width": 9 * h.one,
        "Grain_Mass_Flow": h.flow, "Grain_Moisture": 14 * h.one, "Elevation_m": h.z})),
    "no speed": (Harvest(), lambda p, h: shapes(p / "s", h, {
        "Uhrzeit": stamps(h, "%H:%M:%S"), "Schnittbreite": 9 * h.one, "Ertrag": h.wet * 100})),
    "no speed, 6 s late": (Harvest(late=6), lambda p, h: shapes(p / "s", h, {
        "Uhrzeit": stamps(h, "%H:%M:%S"), "Schnittbreite": 9 * h.one, "Ertrag": h.wet * 100})),
    "no speed, 11 s late": (Harvest(late=11, width=7.5, seed=4), lambda p, h: bare(
        p, h, Width=7.5 * h.one, Flow=h.flow)),
    # what counts on, and what is not there
    "distance from the start": (Harvest(), lambda p, h: table(p / "a.csv", {
        **h.places(), "time": h.t, "width_m": 9 * h.one, "distance": np.cumsum(2 * h.one),
        "flow_kg_s": h.flow})),
    "no clock": (Harvest(passes=12, length=250.0), lambda p, h: table(p / "a.csv", {
        **h.places(), "width": 9 * h.one, "speed": 7.2 * h.one, "flow": h.flow})),
    "no clock, 2 s": (Harvest(interval=2.0, length=400.0), lambda p, h: table(p / "a.csv", {
        **h.places(), "width": 9 * h.one, "speed_kmh": 7.2 * h.one, "flow": h.flow})),
}  # fmt: skip


def shown(log):
    """What a log says, in numbers: header [m], speed [m/s], flow [kg/s], yield [kg/m2], delay [s], passes."""
    cleaned = clean(log)
    grain = float(np.mean(cleaned.grain[cleaned.kept])) if cleaned.kept.any() else np.nan
    return {
        "records": len(log), "width": float(np.median(log.width)), "speed": float(np.median(log.speed)),
        "flow": float(np.mean(log.flow)), "yield": grain,
        "delay": cleaned.delays[0].seconds, "error": cleaned.delays[0].error,
        "passes": int(cleaned.pass_id.max()) + 1,
    }  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_the_field_is_the_one_that_was_harvested(tmp_path, form):
    harvest, write = FORMS[form]
    log = read_log(write(tmp_path, harvest))
    said = shown(log)
    assert said["records"] == len(harvest)
    assert said["passes"] == harvest.passes
    assert said["width"] == pytest.approx(harvest.width, rel=0.01), log.notes
    assert said["speed"] == pytest.approx(harvest.speed, rel=0.01), log.notes
    assert said["flow"] == pytest.approx(harvest.flow.mean(), rel=0.01), log.notes
    assert said["yield"] == pytest.approx(harvest.wet[harvest.wet > 0].mean(), rel=0.02), log.notes
    assert said["delay"] == pytest.approx(harvest.late, abs=max(0.5, 2.0 * said["error"]))
    if "elevation" in log.column_map.columns:
        assert np.abs(log.elevation - harvest.z).max() < 0.5, log.notes
    if "moisture" in log.column_map.columns:
        assert np.median(log.moisture) == pytest.approx(harvest.moisture, abs=1e-3), log.notes


REFUSED = {
    "width_ft": (r"width = header_width: width_ft in ft.*passes lie 9 m apart.* be in m.*--columns",
                 lambda h: {"width_ft": 9 * h.one, "flow_kg_s": h.flow}),
    "speed_kmh": (r"plausible = speed: speed_kmh in km/h.*7\.2 km/h by positions.*in m/s.*--columns",
                  lambda h: {"width_m": 9 * h.one, "speed_kmh": 2 * h.one, "flow_kg_s": h.flow}),
    "speed_mph": (r"plausible = speed: speed_mph in mph.*in km/h", lambda h: {
        "width_m": 9 * h.one, "speed_mph": 7.2 * h.one, "flow_kg_s": h.flow}),
    "flow_kg_s": (r"yield = grain_flow: flow_kg_s in kg/s.*yield_t_ha.*in lb/s", lambda h: {
        "width_m": 9 * h.one, "flow_kg_s": h.flow / LB, "yield_t_ha": h.wet * 10}),
    "no yield of any crop": (r"yield = yield: Yield without a unit.*wheat yields 0\.9 to 18 t/ha.*no unit",
                             lambda h: {
        "Width": 9 * h.one, "Yield": h.wet * 1e7}),
    "a crop that failed": (r"yield = yield: Yield without a unit.*wheat yields 0\.9 to 18 t/ha", lambda h: {
        "Width": 9 * h.one, "Yield": h.wet}),
    "no clock at all": (r"timeline = time: by it as s the machine drives .* both to agree.*time: null",
                        lambda h: {"time": h.t * 100.0, "width_m": 9 * h.one, "flow_kg_s": h.flow}),
    "no moisture of grain": (r"moisture = moisture: Moisture without a unit", lambda h: {
        "Width": 9 * h.one, "Yield": h.wet * 10, "Moisture": 1400 * h.one}),
}  # fmt: skip


def test_other_causes_are_told_and_not_refused(tmp_path):
    h = Harvest()
    columns = {**h.places(), "time": h.t, "width_m": 9 * h.one, "speed_kmh": 7.8 * h.one, "flow_kg_s": h.flow}
    log = read_log(table(tmp_path / "a.csv", columns | {"distance_m": 5 * h.one}))
    assert "plausible: speed: speed_kmh in km/h, though 7.2 km/h by positions and times" in log.notes
    assert "unused: distance: distance_m not used: the positions show it otherwise" in log.notes
    other = Harvest(width=24.0)
    columns = {
        **other.places(),
        "time": h.t,
        "Width": 12 * h.one,
        "speed_kmh": 7.2 * h.one,
        "flow_kg_s": h.flow,
    }
    log = read_log(table(tmp_path / "b.csv", columns))
    assert log.width[0] == 12.0
    assert "width: header_width: Width taken as m, though passes lie 24 m apart" in log.notes


@pytest.mark.parametrize("wrong", REFUSED)
def test_what_the_data_contradicts_is_refused_with_the_flag_that_settles_it(tmp_path, wrong):
    message, columns = REFUSED[wrong]
    h = Harvest()
    path = table(tmp_path / "log.csv", {**h.places(), "time": h.t, **columns(h)})
    with pytest.raises(InputError, match=message):
        read_log(path)


def test_the_users_word_wins_and_the_contradiction_is_told(tmp_path):
    h = Harvest()
    path = table(
        tmp_path / "log.csv", {**h.places(), "time": h.t, "width_ft": 9 * h.one, "flow_kg_s": h.flow}
    )
    (tmp_path / "map.yaml").write_text("header_width: {unit: ft}\n")
    log = read_log(path, tmp_path / "map.yaml")
    assert log.width[0] == pytest.approx(9 * FT)
    assert "width: header_width: width_ft in ft, though passes lie 9 m apart" in log.notes
    (tmp_path / "map.yaml").write_text("header_width: {unit: m}\n")
    assert read_log(path, tmp_path / "map.yaml").width[0] == pytest.approx(9.0)
    (tmp_path / "map.yaml").write_text("crop_height: {unit: m}\n")
    with pytest.raises(InputError, match="expected its column, too"):
        read_log(path, tmp_path / "map.yaml")


def test_a_result_that_cannot_be_is_refused(tmp_path):
    h = Harvest()
    path = table(tmp_path / "log.csv", {
        **h.places(), "time": h.t, "width_m": 9 * h.one, "yield_kg_ha": 10 * h.wet})  # fmt: skip
    with pytest.raises(
        InputError, match=r"yield = 0\.0054\d t/ha.*yield_kg_ha in kg/ha.*of wheat.*--columns"
    ):
        import_log(path, tmp_path / "f", progress=False)
    assert not (tmp_path / "f").exists()
    twice = {k: np.concatenate([v, v]) for k, v in (
        *h.places().items(), ("time", h.t), ("width_m", 9 * h.one), ("flow_kg_s", h.flow))}  # fmt: skip
    twice["time"][len(h) :] += h.t[-1] + 60.0
    report = import_log(table(tmp_path / "b.csv", twice), tmp_path / "g", progress=False)
    assert any(re.match(r"yield: .* t logged, .* t on the map", note) for note in report.notes)


def test_rows_without_names_are_numbered_and_can_be_named(tmp_path):
    h = Harvest()
    text = table(tmp_path / "log.csv", {**h.places(), "t": h.t, "w": 9 * h.one, "f": h.flow}).read_text()
    (tmp_path / "log.csv").write_text(text.partition("\n")[2])
    with pytest.raises(InputError, match=r"column 1, column 2.*expected columns for lat and lon"):
        read_log(tmp_path / "log.csv")
    names = ("lat", "lon", "time", "header_width", "grain_flow")
    lines = [f"{name}: {{column: column {i + 1}}}" for i, name in enumerate(names)]
    (tmp_path / "map.yaml").write_text("\n".join(lines))
    assert read_log(tmp_path / "log.csv", tmp_path / "map.yaml").flow.mean() == pytest.approx(h.flow.mean())


def test_a_clock_of_coarse_steps_is_spread_and_told(tmp_path):
    h = Harvest(length=250.0)
    log = read_log(clocked(tmp_path, h, time=[f"{45127.4166 + s / 86400:.4f}" for s in h.t]))
    assert any("steps of 9 records" in note for note in log.notes)
    assert shown(log)["yield"] == pytest.approx(h.wet.mean(), rel=0.01)
    assert shown(log)["passes"] == h.passes


CUT = {
    "Arbeitsbre": ("header_width", "m", True), "Geschw_kmh": ("speed", "km/h", False),
    "Distance_f": ("distance", "ft", False), "Distance_m": ("distance", "m", False),
    "Speed_mph_": ("speed", "mph", False), "Yld_Mass_W": ("yield", "kg/ha", True),
    "Yld_Vol_Dr": ("dry_yield", "bu/ac", True), "Ertrag__t_": ("yield", "t/ha", False),
    "Ertrag_t_h": ("yield", "t/ha", False), "Vitesse__k": ("speed", "m/s", True),
    "Track_deg_": ("course", "deg", True), "Elevation_": ("elevation", "m", True),
    "Largeur_de": ("header_width", "m", True),
}  # fmt: skip


@pytest.mark.parametrize("name", CUT)
def test_names_of_ten_letters_are_known_where_only_one_begins_so(name):
    ((key, column),) = guess([name], Path("log.shp")).columns.items()
    assert (key, column.unit, column.is_assumed) == CUT[name]


@pytest.mark.parametrize("name", ["Operator__", "Prod_ac_h_", "Yield", "Arbeits", "Wind_speed"])
def test_other_names_are_not_taken_for_those_that_begin_alike(name):
    found = guess([name], Path("log.shp")).columns
    assert list(found) == (["yield"] if name == "Yield" else [])


NUMBERS = ("ID", "No.", "Nr", "number", "Serial", "serial number", "S/N", "SerialNo")


@pytest.mark.parametrize("form", ["{} {}", "{}_{}", "{}{}"])
def test_a_machine_goes_by_its_number_and_nothing_else_does(form):
    def found(things):
        names = [form.format(thing, number) for thing in things for number in NUMBERS]
        return {name: guess([name], Path("log.csv")).columns.keys() for name in names}

    assert all(keys == {"machine"} for keys in found(("Machine", "combine", "Mähdrescher")).values())
    others = ("Product", "Field", "Load", "Region", "Farm", "Task", "Display", "Sensor", "Header", "Record")
    assert not any("machine" in keys for keys in found(others).values())
    ways = ("Machine Speed", "Combine Hours", "Vehicle_Sp", "Machine Width", "S/N", "No.", "Number")
    assert not any("machine" in guess([name], Path("log.csv")).columns for name in ways)
    assert "machine" in guess(["Combine_Se"], Path("log.shp")).columns


HEADINGS = {"yield": "Yield (t/furlong)", "speed": "Speed [knotz]", "header_width": "Width (m x 10)",
            "moisture": "Moisture (per mille)"}  # fmt: skip
SAID = {"yield": "t/ha", "speed": "km/h", "header_width": "m", "moisture": '"%"'}


@pytest.mark.parametrize("key", HEADINGS)
def test_a_unit_that_cannot_be_read_is_said_or_the_column_dropped(tmp_path, key):
    h = Harvest()
    names = {
        "yield": "yield_t_ha",
        "speed": "speed_kmh",
        "header_width": "width_m",
        "moisture": "moisture_pct",
    }
    columns = {"yield": 10 * h.wet, "speed": 7.2 * h.one, "header_width": 9 * h.one, "moisture": 14 * h.one}
    rest = {"time_s": h.t, **{names[k]: v for k, v in columns.items() if k != key}}
    log = table(tmp_path / "log.csv", {**h.places(), HEADINGS[key]: columns[key], **rest})
    (tmp_path / "map.yaml").write_text(f"{key}: {{unit: {SAID[key]}}}")
    read = read_log(log, tmp_path / "map.yaml")
    assert read.flow.mean() == pytest.approx(h.flow.mean(), rel=1e-3)
    assert read.moisture == pytest.approx(0.14)
    (tmp_path / "map.yaml").write_text(f"{key}: null")
    if key == "yield":
        with pytest.raises(InputError, match="grain_flow or yield"):
            read_log(log, tmp_path / "map.yaml")
        return
    width = 9.0 if key == "header_width" else None
    read = read_log(log, tmp_path / "map.yaml", header_width=width)
    assert read.flow.mean() == pytest.approx(h.flow.mean(), rel=0.01)


def without_unit(name):
    """A heading without the unit at its end or in brackets."""
    name = re.sub(r"\s*[\[(](?!M\)|Wet|Dry)[^\])]*[\])]$", "", name.strip('"'))
    ends = r"_(kg_s|m_s|kg_ha_wheat60lb|kg_ha|bu_ac|pct|kmh|mph|deg|ft|l_h|ha_h|m|s)$"
    return re.sub(ends, "", name)


def stripped(source, path, separator=",", encoding="utf-8", names=None):
    """The log with headings that say no unit."""
    opened = gzip.open if source.suffix == ".gz" else open
    with opened(source, "rt", encoding=encoding) as stream:
        head, rest = stream.read().split("\n", 1)
    cells = [name.strip('"\r') for name in head.split(separator)]
    named = names or [without_unit(cell) for cell in cells]
    path.write_text(separator.join(named) + "\n" + rest, encoding=encoding)
    return path


SI = DATA / "wheat_combine_logs_msu" / "si"
PLAIN = ["Longitude", "Latitude", "Grain flow", "Time", "Interval", "Distance", "Moisture", "Elevation"]
BUNDLED = Path(__file__).parents[2] / "src" / "swath" / "data" / "logs" / "sample-log.csv.gz"
SEVEN = {
    "montana 2018": (lambda p: SI / "farmerI_henrys_2018_wheat.csv.gz", {}, {}),
    "minnesota": (lambda p: DATA / "agridat_cereal" / "gartner.corn.txt", {"separator": "\t", "names": PLAIN},
                  {"header_width": 9.144, "crop": "maize"}),
    "bundled": (lambda p: BUNDLED, {}, {}),
    "sms": (lambda p: made_exports.sms(p / "sms.txt"), {}, {}),
    "platform": (lambda p: made_exports.farm_platform(p / "platform.csv"), {}, {}),
    "german": (lambda p: made_exports.german(p / "ernte.csv"), {"separator": ";", "encoding": "cp1252"}, {}),
    "bushels": (lambda p: table(p / "bushels.csv", (lambda h: {
        **h.places(), "time_s": h.t, "swath_ft": 30 * h.one, "speed_mph": 2 / MPH * h.one,
        "elevation_ft": h.z / FT, "dry_yield_bu_ac": h.bushels(), "moisture_pct": 14 * h.one})(
            Harvest(*KANSAS, width=30 * FT))), {}, {}),
}  # fmt: skip


@pytest.mark.parametrize("log", SEVEN)
def test_a_log_without_its_units_reads_to_the_same_field(tmp_path, log):
    made, strip, options = SEVEN[log]
    source = made(tmp_path)
    if not source.is_file():
        pytest.skip("needs real yield logs: SWATH_DATA")
    plain = read_log(source, **options)
    bare_log = read_log(stripped(source, tmp_path / f"bare {source.stem}.csv", **strip), **options)
    assert len(bare_log) == len(plain)
    for key in ("time", "width", "speed", "flow", "elevation", "moisture"):
        np.testing.assert_allclose(getattr(bare_log, key), getattr(plain, key), rtol=1e-3, err_msg=key)


@pytest.mark.parametrize(("also", "told"), [({}, []), ({"speed_mph": 4.5}, ["yield"])])
def test_a_yield_whose_unit_only_the_place_decides_is_in_doubt(tmp_path, also, told):
    """26 bu/ac and 26 dt/ha of soy both grow in Nebraska: metres decide, metres and miles do not."""
    h = Harvest(40.7, -96.4, level=0.26)
    columns = {**h.places(("lat", "lon")), "time_s": h.t, "width_m": 9.0 * h.one, "yield": 100.0 * h.wet}
    columns |= {name: value * h.one for name, value in also.items()}
    log = read_log(table(tmp_path / "log.csv", columns), crop="soy")
    assert doubts(log.notes) == told
