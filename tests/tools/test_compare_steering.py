"""Steering and motion of a machine, fitted to logs: the numbers that made a log lie within the intervals."""

import json

import numpy as np
import pytest

pytest.importorskip("scipy")

from swath.commands.main import main
from swath.core.units import DEG
from swath.field_io.logs.steer_log import read_steer_log
from swath.machine.machine_sheet import open_machine, read_machine
from swath.tools.compare_log.steering_fit import compare_steering, run_motion, run_steering

pytestmark = pytest.mark.usefixtures("code_allowed_in_module")

TRUE = {
    "steering.dead_time_s": 0.27, "steering.lag_s": 0.35, "steering.rate_deg_s": 11.0,
    "tyres.understeer_deg_per_g": 2.5, "tyres.front_relaxation_m": 1.3, "tyres.rear_relaxation_m": 0.975,
}  # fmt: skip
ANTENNA = (1.5, 0.4)


def write_log(path, *, seed=1, passes=12, seconds=15.0, rate=20, noise=1.0, truth=TRUE):
    """A log of passes with steps and waves of the steering, at 1.5 to 5.5 m/s; noise of RTK and gyroscope."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    lines = ["pass,t_s,speed_m_s,command_curvature_1_km,steer_angle_deg,yaw_rate_deg_s,x_m,y_m"]
    rows = []
    for k in range(passes):
        steps = np.repeat(rng.uniform(-0.05, 0.05, len(t) // (2 * rate) + 1), 2 * rate)[: len(t)]
        wave = 0.02 * np.sin(2.0 * np.pi * t * rng.uniform(0.2, 0.8))
        speed = np.full(len(t), rng.uniform(1.5, 5.5)) + 0.2 * np.sin(t)
        blank = np.zeros(len(t))
        rows.append(
            np.stack(
                [np.full(len(t), k), 100.0 * k + t, speed, 1e3 * (steps + wave), blank, blank, blank, blank]
            )
        )
    table = np.concatenate(rows, axis=1).T
    path.write_text("\n".join([*lines, *(",".join(f"{v:.9g}" for v in row) for row in table)]) + "\n")
    log = read_steer_log(path)
    machine = read_machine(open_machine("lexion-700").changed(truth, new=truth))
    angle = run_steering(machine, log)
    went = run_motion(machine, log, angle)
    c, s = np.cos(went.yaw), np.sin(went.yaw)
    turn = rng.uniform(-3.0, 3.0, passes)[log.block]
    x, y = went.x + ANTENNA[0] * c - ANTENNA[1] * s, went.y + ANTENNA[0] * s + ANTENNA[1] * c
    table[:, 4] = angle / DEG + 0.4 + noise * rng.normal(0.0, 0.1, len(x))
    table[:, 5] = went.yaw_rate / DEG + noise * rng.normal(0.0, 0.15, len(x))
    table[:, 6] = 300.0 + np.cos(turn) * x - np.sin(turn) * y + noise * rng.normal(0.0, 0.01, len(x))
    table[:, 7] = 500.0 + np.sin(turn) * x + np.cos(turn) * y + noise * rng.normal(0.0, 0.01, len(x))
    path.write_text("\n".join([*lines, *(",".join(f"{v:.9g}" for v in row) for row in table)]) + "\n")
    return path


LAW = '''
from math import sin
from swath.core.component import KeepsState, Port
from swath.signals import Odometry, SpeedCommand, SteerCommand


class Weave(KeepsState):
    """Steps of curvature, a wave upon them."""

    kept = ()
    inputs = (Port("odometry", Odometry),)
    outputs = (Port("command", SteerCommand),)

    def __init__(self, params, setup):
        pass

    def reset(self, stream):
        return {"command": SteerCommand(0, 0.0, True)}

    def step(self, t, dt, inputs):
        s = (t + dt) * 1e-9
        step = (0.05, -0.03, -0.05, 0.02, 0.04, -0.04, 0.0)[int(s / 2.2) % 7]
        return {"command": SteerCommand(t + dt, step + 0.015 * sin(2.5 * s), True)}
'''
SCENARIO = """
format: swath scenario 2
name: weave
seed: {seed}
run: {{max_duration_s: 70, distance_m: 1000}}
field:
  terrain: {{level: formula, slope_percent: 0, roughness_class: C}}
  stand: {{level: uniform}}
  edge: {{shape: straight, length_m: 600}}
machines:
  combine:
    machine: machine.yaml
    lidar: off
    edge: off
    header: off
    process: off
    steer: "law.py:Weave"
    steering: actuator
    motion: {{level: single_track, start_speed_kmh: 9}}
    speed: {{level: constant, speed_kmh: 14}}
expect: {{}}
"""


@pytest.fixture(scope="module")
def weaved(tmp_path_factory):
    """Tracks of a run of a machine with other numbers, with noise, as logs of 50 and 12.5 Hz; its numbers."""
    import pyarrow.parquet as pq

    from swath.documents.yaml_document import dump
    from swath.runtime.job import run_job
    from swath.scenario.scenario import load_scenario

    folder = tmp_path_factory.mktemp("weave")
    truth = {**TRUE, "tyres.understeer_deg_per_g": -1.5, "steering.rate_deg_s": 18.0}
    sheet = open_machine("lexion-700").changed(truth, new=truth)
    (folder / "machine.yaml").write_text(dump(sheet.document.data, width=110))
    (folder / "law.py").write_text(LAW)
    (folder / "weave.yaml").write_text(SCENARIO.format(seed=5))
    run_job(load_scenario(folder / "weave.yaml"), folder / "run")
    tracks = pq.read_table(folder / "run" / "tracks.parquet").to_pydict()
    rng = np.random.default_rng(9)
    noise = {"steer_rad": 0.1 * DEG, "yaw_rate_rad_s": 0.1 * DEG, "x_m": 0.01, "y_m": 0.01}
    names = ["t_s", "speed_m_s", "command_curvature_1_m", *noise]
    columns = [
        np.array(tracks[n], float) + noise.get(n, 0.0) * rng.normal(size=len(tracks["t_s"])) for n in names
    ]
    columns.append(columns[0] // 10.0)
    rows = [",".join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)]
    for name, step in (("log.csv", 1), ("coarse.csv", 4)):
        (folder / name).write_text("\n".join([",".join([*names, "pass"]), *rows[::step]]) + "\n")
    return folder, truth


def within(part, truth):
    """Which of the true numbers lie in 1.5 times the interval of 95 %, where all but 3 in 1000 lie."""
    return {
        f.key: abs(f.value - truth[f.key]) <= 0.75 * (f.high - f.low) for f in part.fitted if f.key in truth
    }


@pytest.mark.draws
def test_a_run_of_another_machine_gives_its_numbers_back(weaved):
    folder, truth = weaved
    (steering,) = compare_steering("lexion-700", folder / "log.csv", fit=list(truth)[:3]).parts
    (motion,) = compare_steering("lexion-700", folder / "coarse.csv", fit=list(truth)[3:5]).parts
    assert within(steering, truth) == dict.fromkeys(list(truth)[:3], True)
    assert within(motion, truth) == {"tyres.understeer_deg_per_g": True, "tyres.front_relaxation_m": True}
    for f in (*steering.fitted[:3], motion.fitted[1]):
        assert f.high - f.low < 0.2 * truth[f.key]
    for part in (steering, motion):
        assert part.rmse[2] < 0.5 * part.rmse[0]


@pytest.mark.draws
def test_positions_alone_tell_the_motion(weaved):
    folder, truth = weaved
    keys = ["tyres.understeer_deg_per_g", "tyres.front_relaxation_m"]
    (motion,) = compare_steering("lexion-700", folder / "coarse.csv", on="place", fit=keys).parts
    assert within(motion, truth) == dict.fromkeys(keys, True)
    # of positions: what stiffness and wheelbase of the sheet may be off is in it
    assert motion.fitted[1].high - motion.fitted[1].low < 0.6 * 1.3
    assert motion.rmse[1] == pytest.approx(1.0, abs=0.2)  # cm: the noise of the positions


def test_positions_of_an_antenna_and_a_command_tell_both(tmp_path):
    path = write_log(tmp_path / "log.csv", seed=2, passes=7, seconds=14.0, rate=10)
    made = compare_steering("lexion-700", path, on="place", antenna=ANTENNA)
    steering, motion = made.parts
    assert all(within(steering, TRUE).values())
    assert all(within(motion, TRUE).values())
    assert steering.fitted[-1].value == pytest.approx(0.4, abs=0.02)
    front, rear = (made.sheet.number(f"tyres.{axle}_relaxation_m") for axle in ("front", "rear"))
    assert rear == pytest.approx(0.75 * front)


def test_what_a_log_does_not_show_is_left_as_it_was(tmp_path):
    gentle = {**TRUE, "steering.rate_deg_s": 60.0}
    path = write_log(tmp_path / "log.csv", truth=gentle, passes=7, seconds=8.0, rate=10)
    made = compare_steering("lexion-700", path, fit=["steering.rate_deg_s", "steering.lag_s"])
    rows = path.read_text().splitlines()
    slow = [rows[0], *(",".join([*r.split(",")[:3], "0", *r.split(",")[4:]]) for r in rows[1:])]
    path.write_text("\n".join(slow) + "\n")
    straight = compare_steering("lexion-700", path, fit=["steering.rate_deg_s"])
    assert not straight.parts[0].fitted[0].is_seen
    assert straight.sheet.number("steering.rate_deg_s") == 15.0
    assert any("does not show" in note for note in straight.notes)
    assert made.parts[0].fitted[0].is_seen


def test_latitude_and_longitude_are_metres(tmp_path):
    pyproj = pytest.importorskip("pyproj")
    east, north = np.arange(60) * 2.0, np.arange(60) * 1.5
    back = pyproj.Transformer.from_crs(
        "+proj=aeqd +lat_0=51.5 +lon_0=9.2 +datum=WGS84", "EPSG:4326", always_xy=True
    )
    lon, lat = back.transform(east, north)
    rows = [f"{k / 10},2.0,1.0,{la:.10f},{lo:.10f}" for k, (la, lo) in enumerate(zip(lat, lon, strict=True))]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time,speed_m_s,Lenkwinkel,lat,lon", *rows]) + "\n")
    log = read_steer_log(path)
    assert log.place == pytest.approx(np.stack([east, north], axis=1), abs=5e-3)
    assert log.angle[0] == pytest.approx(1.0 * DEG)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (
            ["t_s,speed_m_s,steer_deg,yaw_rate_deg_s", *(f"{k},2,1,1" for k in range(40))],
            "four records per second",
        ),
        (
            ["t_s,speed_m_s,steer_deg,yaw_rate_deg_s", *(f"{k / 10},2,1,1" for k in range(400))],
            "at least 6 passes",
        ),
        (["t_s,steer_deg,yaw_rate_deg_s", *(f"{k / 10},1,1" for k in range(40))], "columns for speed"),
        (
            ["t_s,speed_m_s,steer_deg", *(f"{k / 10},2,1" for k in range(40))],
            "yaw_rate, positions or steer_command",
        ),
    ],
)
def test_logs_that_cannot_tell_are_refused(tmp_path, capsys, rows, message):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(rows) + "\n")
    assert main(["compare", "log", "lexion-700", str(path)]) == 2
    assert message in capsys.readouterr().err


def test_the_command_writes_a_sheet_that_runs(tmp_path, capsys):
    path = write_log(tmp_path / "log.csv", passes=6, seconds=8.0, rate=10)
    assert main(["compare", "log", "lexion-700", str(path), "--out", str(tmp_path / "out")]) == 0
    assert "steering.dead_time_s" in capsys.readouterr().out
    found = json.loads((tmp_path / "out" / "results.json").read_text())["parts"]
    machine = read_machine(open_machine(str(tmp_path / "out" / "machine.yaml")))
    by_key = {f["key"]: f["value"] for part in found.values() for f in part["fitted"]}
    assert machine.dynamics.steer_dead_time == pytest.approx(by_key["steering.dead_time_s"], rel=1e-3)
    assert machine.dynamics.understeer != 0.0
    assert main(["compare", "log", "lexion-700", str(path), "--friction", "5"]) == 2
    assert "--friction" in capsys.readouterr().err
