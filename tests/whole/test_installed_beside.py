"""A package of somebody else, installed beside swath: a sensor level, a metric, a file format, a command."""

import json
import os
import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest

from swath.core import registry
from swath.core.errors import InputError

CODE = """
import csv
from dataclasses import dataclass

import numpy as np

from swath.core.component import Port
from swath.core.registry import Level
from swath.field_io.logs.table import Table
from swath.judge.evaluator import Metric
from swath.signals import GroundSpeed, MachineState


@dataclass(frozen=True)
class Params:
    scale: float = 1.0


class Wheel:
    inputs = (Port("state", MachineState),)
    outputs = (Port("ground_speed", GroundSpeed),)

    def __init__(self, params, setup):
        self.scale = params.scale

    def reset(self, stream):
        return {"ground_speed": GroundSpeed(0, 0.0, 0.0)}

    def step(self, t, dt, inputs):
        state = inputs["state"]
        return {"ground_speed": GroundSpeed(t + dt, self.scale * state.speed, state.distance)}


WHEEL = Level(Wheel, Params, "a wheel of a known scale", cost="1 us", tolerance="exact")


class Fastest:
    OF_FIELD = False
    SIGNALS = (GroundSpeed,)
    METRICS = (Metric("fastest_wheel_m_s", "m/s", "largest wheel speed told", "Guest", "", "fastest"),)

    def __init__(self, setup):
        self.largest = 0.0

    def see(self, slot, t, outputs):
        self.largest = max([self.largest, *(s.speed for s in outputs.values() if isinstance(s, GroundSpeed))])

    def metrics(self):
        return {"fastest_wheel_m_s": self.largest}


def read(path):
    with path.open(newline="") as file:
        head, *rows = csv.reader(file, delimiter="|")
    columns = {name: [row[i] for row in rows] for i, name in enumerate(head)}
    return Table(columns, np.arange(1, len(rows) + 1), None, "", {})


def add(parsers):
    parsers.add_parser("greet", help="say hello").set_defaults(run=lambda args: print("hello") or 0)
"""
ENTRIES = """[swath.levels]
ground_speed.guest = swath_guest:WHEEL
evaluator.guest = swath_guest:Fastest
log.pipes = swath_guest:read
command.greet = swath_guest
"""
SCENARIO = """format: swath scenario 2
name: beside
run: {distance_m: 3}
field: {stand: {stems_per_m2: 100}, edge: {shape: straight}}
machines:
  combine:
    lidar: off
    edge: truth
    ground_speed: {level: guest, scale: 2.0}
evaluators: [guest]
expect: {fastest_wheel_m_s: {min: 2.0}}
"""


@pytest.fixture(scope="module")
def swath(tmp_path_factory):
    site = tmp_path_factory.mktemp("site")
    (site / "swath_guest.py").write_text(CODE)
    about = site / "swath_guest-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: swath-guest\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(ENTRIES)
    paths = [str(site), *filter(None, [os.environ.get("PYTHONPATH")])]

    def call(*arguments, cwd):
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
        command = [sys.executable, "-m", "swath", *arguments]
        return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=600)

    return call


def test_a_level_and_a_metric_of_an_installed_package_run(swath, tmp_path):
    (tmp_path / "s.yaml").write_text(SCENARIO)
    done = swath("run", "s.yaml", "--no-report", "--no-replay", "--quiet", "--out", "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert not list((tmp_path / "out").glob("*.html"))
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["fastest_wheel_m_s"] > 2.0
    assert {"name": "fastest_wheel_m_s", "result": "pass"}.items() <= summary["expect"][0].items()
    assert "guest" in swath("levels", "ground_speed", cwd=tmp_path).stdout


def test_a_file_of_its_own_format_is_read_and_its_reader_named(swath, tmp_path):
    head = "longitude|latitude|gps_time|speed_m_s|header_width_m|grain_flow_kg_s"
    rows = [f"{9 + 2e-5 * i:.7f}|52.0|{1.7e9 + i:.0f}|1.37|6.0|6.5" for i in range(200)]
    (tmp_path / "log.pipes").write_text("\n".join([head, *rows]) + "\n")
    done = swath("field", "import", "log.pipes", "--out", "field", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    written = (p for p in (tmp_path / "field").rglob("*") if p.suffix in (".html", ".json", ".yaml"))
    told = done.stdout + "".join(p.read_text() for p in written)
    assert "read by the installed package swath-guest" in told


def test_a_command_is_listed_and_runs(swath, tmp_path):
    assert "of the installed package swath-guest" in swath("--help", cwd=tmp_path).stdout
    assert swath("greet", cwd=tmp_path).stdout == "hello\n"
    assert swath("greeet", cwd=tmp_path).stderr.endswith("did you mean 'greet'?\n")


def test_two_packages_with_one_name_are_refused(monkeypatch):
    points = tuple(EntryPoint("log.twice", f"{name}:read", registry.GROUP) for name in ("one", "two"))
    monkeypatch.setattr(registry, "_entry_points", lambda: points)
    with pytest.raises(InputError, match="package with that name, one:read and two:read have it"):
        registry.installed_part("log", "twice")
