"""A machine along a log: what went into a made log comes back out; real logs give the figures on record."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("scipy")

from benchmarks.engine_logs import CHOPPED, by_load, steady_speed

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.units import RPM
from swath.field_io.logs.machine_log import read_machine_log
from swath.machine.machine_sheet import load_machine, open_machine, read_machine
from swath.machine.powertrain.power_balance import full_torque, governed_torque
from swath.tools.compare_log.compare import (
    Drive,
    _standard_errors,
    best_lag,
    compare_log,
    compare_series,
    run_engine,
    run_process,
    usable,
)
from swath.tools.compare_log.page import _over_flow
from tests.shared_data import DATA

WHEAT = DATA / "wheat_combine_logs_msu" / "si" / "farmerI_henrys_2018_wheat.csv.gz"
FORAGE = DATA / "forage_harvester_isoxml" / "raw"
wheat = pytest.mark.skipif(not WHEAT.is_file(), reason="needs the Montana yield logs: SWATH_DATA")
forage = pytest.mark.skipif(not FORAGE.is_dir(), reason="needs the forage harvester's time logs: SWATH_DATA")
KEYS = ["power.auxiliary_kw", "power.drum_kj_per_kg", "transport.feeder_s"]


def simulate(machine, log, drive):
    return run_engine(machine, log, drive, run_process(machine, log, drive))


def write_log(path, machines=2, count=600, pause=None):
    """A log of machines on rolling ground, its engine columns still zero."""
    lines = ["machine,t_s,lat,lon,z_m,speed_m_s,grain_flow_kg_s,swath_m,engine_load_pct,fuel_l_h"]
    for m in range(machines):
        t = np.arange(count)
        speed = 2.0 + 0.2 * np.sin(t / 37.0)
        flow = 9.0 + 2.5 * np.sin(t / 23.0 + m) + 1.5 * np.sin(t / 7.0)
        way = np.cumsum(speed)
        height = 100.0 + 3.0 * np.sin(way / 90.0)
        clock = t + (0 if pause is None else np.where(t >= pause, 500, 0))
        for k in range(count):
            lat = 47.0 + way[k] / 111_200.0
            lines.append(
                f"{m + 1},{clock[k]},{lat:.8f},-110.{m},{height[k]:.4f},{speed[k]:.4f},{flow[k]:.4f},12,50,60"
            )
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A log whose engine columns come from a sheet with other numbers, and those numbers."""
    true = {"power.auxiliary_kw": 55.0, "power.drum_kj_per_kg": 6.5, "transport.feeder_s": 2.4}
    log = read_machine_log(write_log(tmp_path_factory.mktemp("log") / "log.csv"))
    machine = read_machine(open_machine("lexion-700").changed(true))
    series = simulate(machine, log, Drive())
    rng = np.random.default_rng(1)
    noisy = {q: series[q] * (1.0 + rng.normal(0.0, 0.005, len(log))) for q in log.measured}
    return replace(log, measured=noisy), true


def test_the_log_is_read_with_its_slope_and_its_machines(made):
    log, _ = made
    assert log.machine_names == ("1", "2")
    assert len(log) == 1200
    assert log.gap.sum() == 2
    t = np.arange(600)
    way = np.cumsum(2.0 + 0.2 * np.sin(t / 37.0))
    slope = 3.0 / 90.0 * np.cos(way / 90.0)
    assert np.abs(log.grade[:600] - slope)[10:-10].max() < 0.004


def test_a_pause_starts_anew(tmp_path):
    log = read_machine_log(write_log(tmp_path / "log.csv", machines=1, pause=400))
    assert np.flatnonzero(log.gap).tolist() == [0, 400]
    machine = load_machine("lexion-700")
    load = simulate(machine, log, Drive())["engine_load"]
    empty = log.keep(np.arange(len(log)) == 400)
    assert load[400] == simulate(machine, empty, Drive())["engine_load"][0]
    assert load[400] < load[399] - 0.1


def test_a_fit_finds_the_numbers_that_made_the_log(made):
    log, true = made
    found = compare_log("lexion-700", log, fit=KEYS, machine="1")
    for f in found.fitted:
        assert f.value == pytest.approx(true[f.key], rel=0.03)
    tested = found.statistics["engine_load"]["machine 2"]["model"]
    assert tested.r2 > 0.98
    assert abs(tested.lag_s) < 0.3
    assert found.statistics["engine_load"]["machine 2"]["regression"].r2 < tested.r2 - 0.1
    assert found.sheet["power"]["auxiliary_kw"]["value"] == pytest.approx(55.0, rel=0.03)


def test_an_error_counts_what_is_alike_within_a_stretch_once():
    """Slopes of drawn lines whose errors are those of whole stretches: two of three lie within one error."""
    rng, stretch, within = np.random.default_rng(1), np.repeat(np.arange(30), 20), []
    for _ in range(300):
        x = rng.normal(size=30)[stretch] + 0.3 * rng.normal(size=600)
        y = rng.normal(size=30)[stretch]
        slope = float(x @ y / (x @ x))
        within.append(abs(slope) < _standard_errors(x[:, None], y - slope * x, stretch)[0])
    assert 0.58 < np.mean(within) < 0.75
    assert np.isnan(_standard_errors(np.ones((9, 1)), np.ones(9), np.zeros(9, dtype=int))).all()


def test_the_lag_of_a_shifted_series_is_found(made):
    log, _ = made
    flow = log.flow
    for shift in (-6, 0, 4, 11):
        lag, r = best_lag(flow, np.roll(flow, shift), usable(log), log)
        assert lag == pytest.approx(shift, abs=0.1)
        assert r > 0.99


def test_figures_are_those_of_their_definitions(made):
    log, _ = made
    rng = np.random.default_rng(2)
    real, model = rng.normal(50.0, 8.0, len(log)), rng.normal(52.0, 8.0, len(log))
    mask = np.arange(len(log)) < 1000
    found = compare_series(real, model, mask, log)
    error = (model - real)[:1000]
    assert found.rmse == pytest.approx(np.sqrt(np.mean(error**2)))
    assert found.bias == pytest.approx(error.mean())
    assert found.r2 == pytest.approx(1.0 - np.mean(error**2) / real[:1000].var())
    assert compare_series(real, real, mask, log).r2 == 1.0


def test_the_settled_speed_balances_the_torques():
    machine = load_machine("forage-harvester")
    e = machine.drivetrain.engine
    loads = np.array([15.0, 40.0, 80.0, 86.0, 92.0, 96.0])
    speeds = steady_speed(machine, {"engine_load": loads}, CHOPPED) * RPM
    peak = (1.0 + e.torque_rise) * e.rated_power / e.rated_speed
    for load, speed in zip(loads, speeds, strict=True):
        torque = (load / 100.0 - 0.12) / 0.88 * peak
        assert governed_torque(speed, e) == pytest.approx(torque, rel=1e-9)
        assert full_torque(speed, e) >= torque * (1.0 - 1e-9)


@pytest.mark.drawn
def test_the_command_writes_what_it_says(tmp_path, capsys):
    log = write_log(tmp_path / "log.csv", machines=1, count=300)
    out = tmp_path / "out"
    assert main(["compare", "log", "lexion-700", str(log), "--out", str(out)]) == 0
    assert "engine load" in capsys.readouterr().out
    results = json.loads((out / "results.json").read_text())
    assert set(results["statistics"]) == {"engine_load", "fuel"}
    assert (out / "comparison.png").read_bytes()[:4] == b"\x89PNG"
    assert "<h2>Simulated and measured</h2>" in (out / "report.html").read_text()
    assert load_machine(str(out / "machine.yaml")).name == "Combine, 700 class, 12 m header"
    (out / "mine.txt").write_text("x")
    assert main(["compare", "log", "lexion-700", str(log), "--out", str(out)]) == 2


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--machine", "9"], "machine = 9: expected one of 1"),
        (["--fit", "power.nothing"], "power.nothing"),
        (["--fit", "name"], "name"),
        (["--on", "engine_speed"], "expected one of engine_load, fuel"),
        (["--share", "2"], "share"),
        (["--process", "nothing"], "process.level = nothing"),
        (["--friction", "99"], "--friction"),
    ],
)
def test_bad_input_is_one_line(tmp_path, capsys, options, expected):
    log = write_log(tmp_path / "log.csv", machines=1, count=120)
    assert main(["compare", "log", "lexion-700", str(log), *options]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1


def test_a_log_without_engine_is_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("lat,lon,flow,speed\n" + "47,-110,9,2\n" * 50)
    with pytest.raises(InputError, match="engine_load or engine_speed or fuel"):
        read_machine_log(path)


@pytest.mark.parametrize("seed", range(6))
def test_broken_cells_are_missing_values_or_a_clean_error(tmp_path, seed):
    rng = np.random.default_rng(seed)
    rows = [line.split(",") for line in write_log(tmp_path / "log.csv", count=200).read_text().split("\n")]
    odd = ["", "nan", "inf", "-1e300", "x", "1e400", "-", "9" * 30, "2020-13-01"]
    for _ in range(120):
        row = rows[int(rng.integers(1, len(rows) - 1))]
        row[int(rng.integers(0, len(row)))] = odd[int(rng.integers(0, len(odd)))]
    path = tmp_path / "broken.csv"
    path.write_text("\n".join(",".join(r) for r in rows))
    try:
        log = read_machine_log(path)
        found = compare_log("lexion-700", log)
    except InputError:
        return
    assert (log.duration > 0.0).all()
    assert np.isfinite(found.simulated["engine_load"]).all()


@wheat
def test_the_shipped_machine_follows_the_load_closer_than_a_regression():
    """By correlation: the flow sensors differ by some percent. On parts of the log, to be quick."""
    log = read_machine_log(WHEAT)
    assert len(log) == 31_276
    start = [int(np.flatnonzero(log.machine == m)[0]) + 2000 for m in range(3)]
    index = np.arange(len(log))
    part = np.zeros(len(log), dtype=bool)
    for first in start:
        part |= (index >= first) & (index < first + 3000)
    load = compare_log("lexion-700", log.keep(part), machine="1").statistics["engine_load"]
    for name in ("machine 1", "machine 2", "machine 3"):
        assert load[name]["model"].r > load[name]["regression with lag"].r > load[name]["regression"].r
        assert abs(load[name]["model"].lag_s) < 1.0
        assert 3.0 < load[name]["regression"].lag_s < 5.0


@wheat
def test_the_plain_regression_is_the_one_on_record():
    """engine load = 42.7 + 2.19 flow + 0.47 v, R2 0.48, 6 %, 4 s late; the record's mask is not known."""
    log = read_machine_log(WHEAT)
    mask = (log.flow > 2.5) & (log.speed > 1.0)
    load = 100.0 * log.measured["engine_load"]
    terms = np.stack([np.ones(len(log)), log.flow, log.speed], axis=1)
    found = np.linalg.lstsq(terms[mask], load[mask], rcond=None)[0]
    figures = compare_series(load, terms @ found, mask, log)
    assert found[:2] == pytest.approx([42.7, 2.19], rel=0.03)
    assert figures.r2 == pytest.approx(0.48, abs=0.05)
    assert figures.rmse == pytest.approx(6.0, abs=0.2)
    assert best_lag(log.flow, load, usable(log), log)[0] == pytest.approx(4.0, abs=0.5)


@pytest.fixture(scope="module")
def harvest():
    """The whole log of the forage harvester, judged on every other stretch."""
    log = read_machine_log(FORAGE)
    assert len(log) == 61_314
    return compare_log("forage-harvester", log, drive=CHOPPED, alternate=True)


@pytest.mark.draws
@forage
def test_engine_speed_over_load_is_that_of_the_forage_harvester(harvest):
    mask = harvest.parts["even stretches"]
    steady = steady_speed(load_machine("forage-harvester"), harvest.measured, CHOPPED)
    found = by_load(harvest.measured, harvest.simulated, mask, steady)
    rows = {(r["from_percent"], r["to_percent"]): r for r in found}
    measured = {(0, 75): 1898.0, (85, 92): 1841.0, (92, 97): 1710.0}
    for between, rpm in measured.items():
        assert rows[between]["measured_rpm"] == pytest.approx(rpm, rel=0.002)
        assert rows[between]["simulated_rpm"] == pytest.approx(rpm, rel=0.015)
        assert rows[between]["settled_rpm"] == pytest.approx(rpm, rel=0.015)
    flat = [rows[b]["simulated_rpm"] for b in ((30, 50), (50, 65), (65, 75))]
    assert max(flat) - min(flat) < 0.005 * 1898.0


@pytest.mark.draws
@forage
def test_fuel_over_flow_is_that_of_the_forage_harvester(harvest):
    """Up to 90 kg/s; beyond, the engine is at its limit and burns no more, in the log as in the model."""
    mask, flow = harvest.parts["even stretches"], harvest.log.flow
    for low in range(20, 90, 10):
        inside = mask & (flow >= low) & (flow < low + 10)
        line = 9.8 + 1.047 * flow[inside].mean()
        assert harvest.simulated["fuel"][inside].mean() == pytest.approx(line, rel=0.05)
    limit = mask & (flow >= 90)
    assert harvest.measured["fuel"][limit].mean() == pytest.approx(94.3, rel=0.01)
    assert harvest.simulated["fuel"][limit].mean() == pytest.approx(94.3, rel=0.03)


@forage
def test_load_and_fuel_of_the_forage_harvester_are_predicted():
    """On a part of the log, to be quick."""
    log = read_machine_log(FORAGE)
    log = log.keep(np.arange(len(log)) < 6000)
    harvest = compare_log("forage-harvester", log, drive=CHOPPED, alternate=True)
    load, fuel = (harvest.statistics[q]["even stretches"]["model"] for q in ("engine_load", "fuel"))
    assert load.r2 > 0.89
    assert fuel.r2 > 0.89
    assert abs(load.lag_s) < 0.5


def test_a_log_needs_no_positions_and_missing_columns_make_a_map_beside_the_folder(tmp_path, capsys):
    path = write_log(tmp_path / "log.csv", machines=1, count=120)
    header, *rows = path.read_text().splitlines()
    odd = header.replace("grain_flow_kg_s", "a.flow [t/h]").replace("lat,lon", "a,b")
    odd = odd.replace("speed_m_s", "v [m/s]").replace("engine_load_pct", "b.load").replace("fuel_l_h", "b.f")
    path.write_text("\n".join([odd, *rows]) + "\n")
    line = ["compare", "log", "lexion-700-class", str(path), "--out", str(tmp_path / "out")]
    assert main(line) == 2
    made = tmp_path / "log.columns.yaml"
    assert str(made) in capsys.readouterr().err.replace("\n", "")
    text = made.read_text()
    for unit, column in (("m/s", "v"), ("kg/s", "a.flow"), ('"%"', "b.load")):
        text = text.replace(f'{{column: "?", unit: {unit}}}', column)
    made.write_text(text)
    log = read_machine_log(path, made)
    assert log.column_map.columns["grain_flow"].unit == "t/h"  # of the column's own name
    assert 1.7 < log.speed.mean() < 2.3


def test_a_whole_crop_is_grain_and_straw_where_the_straw_is_said(made):
    log = made[0]
    whole = replace(log, flow=1.5 * log.flow)
    machine = load_machine("lexion-700-class")
    apart = run_process(machine, log, Drive(straw=0.5))[-1]
    together = run_process(machine, whole, Drive(straw=0.5, whole_crop=True))[-1]
    assert together.grain_flow == pytest.approx(apart.grain_flow)
    assert run_process(machine, whole, Drive(whole_crop=True))[-1].grain_flow == 0.0


@pytest.mark.parametrize("flow", [np.full(60, 9.0), np.linspace(8.0, 10.0, 60), np.linspace(8.0, 10.0, 5)])
def test_few_records_are_drawn_over_their_flow_too(made, flow):
    from matplotlib.figure import Figure

    log = made[0].keep(np.arange(len(made[0])) < len(flow))
    part = SimpleNamespace(log=replace(log, flow=flow), measured=log.measured, simulated=log.measured)
    axes = Figure().add_subplot()
    _over_flow(axes, part, "engine_load", np.ones(len(flow), dtype=bool))
    assert all(len(line.get_xdata()) for line in axes.lines)
