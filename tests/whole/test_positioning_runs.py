"""Runs with a satellite receiver and an inertial unit: rates, played again, read by a part of one's own."""

import json

import numpy as np
import pytest

from swath.core.schedule import NS
from swath.record.read.feed import exact_samples, exact_topic
from swath.record.read.mcap_log import McapLog
from swath.runtime.job import run_job
from swath.tools.rerun.rerun import plan_rerun
from tests.whole.small import small

pytestmark = pytest.mark.usefixtures("code_allowed")

LAW = '''
from swath.core.component import Port
from swath.signals import Fix, SpeedCommand


class Law:
    """Drives 2 m/s while there is a fix, else 1 m/s."""

    inputs = (Port("fix", Fix),)
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params, setup):
        pass

    def reset(self, stream):
        return {"command": SpeedCommand(0, 2.0)}

    def step(self, t, dt, inputs):
        return {"command": SpeedCommand(t + dt, 2.0 if inputs["fix"].quality == 4 else 1.0)}

    def save(self):
        return {}

    def load(self, state):
        pass
'''
SETS = (
    "run.record=full",
    "run.max_duration_s=1.5",
    "combine.gnss={level: error, losses: [{from_s: 0.7, to_s: 0.9}]}",
    "combine.imu=ideal",
)


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    folder = tmp_path_factory.mktemp("positioned")
    law = folder / "law.py"
    law.write_text(LAW)
    speed = f"combine.speed={{level: '{law}:Law', wires: {{fix: gnss.fix}}}}"
    run_job(small(*SETS, speed), folder / "run")
    return folder / "run"


def samples(folder, slot, output):
    log = McapLog(folder / "run.mcap")
    return list(exact_samples(log.messages((exact_topic(slot, output),))))


def test_fixes_come_at_their_rate_and_are_the_antenna_of_then(driven):
    fixes = samples(driven, "combine.gnss", "fix")
    assert [t for t, _ in fixes] == [k * NS // 10 for k in range(16)]
    states = dict(samples(driven, "combine.motion", "state"))
    for t, fix in fixes[1:]:
        assert fix.t == t - 50_000_000
        lost = 0.7 * NS <= fix.t < 0.9 * NS
        assert (fix.quality == 0) == lost
        if not lost:
            antenna = states[fix.t].pose.apply([1.0, 0.0, 3.9])
            assert np.linalg.norm(antenna - (fix.x, fix.y, fix.z)) < 0.08
            assert fix.speed == pytest.approx(states[fix.t].speed, abs=0.15)


def test_an_inertial_unit_adds_up_to_what_the_machine_did(driven):
    felt = samples(driven, "combine.imu", "inertial")
    assert [t for t, _ in felt] == [k * NS // 100 for k in range(151)]
    states = dict(samples(driven, "combine.motion", "state"))
    turn = sum(s.rate_z for _, s in felt) * 0.01
    assert turn == pytest.approx(states[NS * 3 // 2].pose.euler()[2] - states[0].pose.euler()[2], abs=2e-4)
    assert np.mean([s.force_z for _, s in felt]) == pytest.approx(9.81, abs=0.1)


def test_a_part_of_ones_own_reads_them(driven):
    for t, command in samples(driven, "combine.speed", "command")[2:]:
        assert (command.speed == 1.0) == (0.75 * NS <= t < 0.95 * NS)


def test_it_is_played_again_to_the_last_bit(driven, tmp_path):
    plan = plan_rerun(driven, slots=None, sets=["run.record=full"])
    assert {"combine.gnss", "combine.imu"} <= set(plan.played)
    summary = plan.run(tmp_path / "out", report=False).summary
    assert all(told["identical"] for told in summary["rerun"]["slots"].values())
    assert summary["digest"] == json.loads((driven / "summary.json").read_text())["digest"]
