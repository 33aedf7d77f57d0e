"""Rates of sensors: each that a bundled data sheet offers goes, and is told in the user's own number."""

import pytest

from swath.commands.new import TEMPLATES
from swath.core.graph import make_plan
from swath.documents.data_sheets import read_sheet, sheet_names
from swath.runtime.assembly import assemble
from swath.scenario.scenario import load_scenario
from swath.sensing.lidar_sheet import load_lidar

SCANNERS = [name for name in sheet_names("sensors") if read_sheet("sensors", name).value("kind") == "lidar"]
ROWS = [(name, rate) for name in SCANNERS for rate in load_lidar(name).rates_hz]


def begun(*sets):
    world = assemble(load_scenario(str(TEMPLATES["scenario"].path), sets=[f"combine.{s}" for s in sets]))
    world.graph.reset()
    return world


def rates_told(*sets):
    return [note for note in begun(*sets).leader.notes if "rate_hz" in note]


@pytest.mark.parametrize(("name", "rate"), ROWS)
def test_the_template_takes_each_scanner_at_each_of_its_rates(name, rate):
    world = begun(f"lidar.sensor={name}", f"lidar.rate_hz={rate}")
    world.graph.run(2 * round(1e9 / rate))
    assert world.graph.latest("combine.lidar", "scan").t > 0
    assert not any("not a rate" in note for note in world.leader.notes)


def test_rounds_of_the_plan_change_nothing(monkeypatch):
    sent = []
    for most in (make_plan.__kwdefaults__["most"], 211):
        monkeypatch.setitem(make_plan.__kwdefaults__, "most", most)
        world = begun("lidar.step_deg=2")
        assert world.graph.plan.is_every == (most > 211)
        world.graph.run(1_500_000_000)
        state, edge = (world.graph.latest(f"combine.{slot}", name) for slot, name in
                       (("motion", "state"), ("edge", "edge")))  # fmt: skip
        sent.append((state.t, state.distance, state.pose.position.tolist(), edge))
    assert repr(sent[0]) == repr(sent[1])


def test_a_rate_is_told_in_the_number_that_was_typed():
    [other, driven] = rates_told("lidar.rate_hz=30")
    assert other.startswith(
        "combine.lidar.rate_hz: 30 Hz is not a rate of the SICK LMS5xx HR, which has 25, "
    )
    assert driven.startswith("combine.lidar.rate_hz: 30 Hz runs at 30.03 Hz")
    [motion] = rates_told("motion.rate_hz=300")
    assert motion.startswith("combine.motion.rate_hz: 300 Hz runs at 303 Hz")
    assert rates_told("lidar.rate_hz=100") == []


def test_a_sector_wider_than_the_view_is_cut_and_told():
    [note] = [n for n in begun("lidar.sensor=sick-ld-mrs").leader.notes if "sector_deg" in n]
    assert "sector_deg [-60, 60]" in note
    assert note.endswith("[-50, 35] is used")
