"""All parts of `straight` with LiDAR `empirical` are ops: what each does at a step, by its launches."""

import pytest

from swath.api import load_scenario
from swath.core.ops import Program
from swath.runtime.job import run_unrecorded

SHIPPED = {"combine.lidar.level": "empirical", "run.max_duration_s": 1.5}
OTHERS = {
    "combine.lidar.level": "profile",
    "combine.header.level": "profile",
    "combine.motion.level": "kinematic",
    "combine.edge": "otsu",
}
ALIKE = {
    "process": ["pass_on", "drop_straw", "lay_straw"],
    "odometry": ["draw_normals", "measure"],
    "imu": ["draw_normals", "sample_each"],
    "steer": ["gather", "take_samples", "take_samples", "steer"],
    "speed": ["bound_speeds"],
    "steering": ["turn_wheels"],
}
OWN = {
    "motion": ["weigh", "drive"],
    "header": ["sweep_lines", "cut_polygons", "tell_flows"],
    "lidar": ["take_states", "aim_sweeps", "look", "cast_bodies", "report_sweeps"],
    "edge": ["take_samples", "take_samples", "drive", "take", "look", "report"],
}
PROFILE = {
    "motion": ["drive_arcs", "stand_on"],
    "header": ["cut_along"],
    "lidar": ["take_states", "aim_sweeps", "cast_profiles", "report_sweeps"],
    "edge": ["take_samples", "detect"],
}


def launches(monkeypatch, sets):
    """Names of the launches of each op, by slot; slots that step in Python."""
    programs, begin = [], Program.__init__

    def kept(self, *args, **kwargs):
        begin(self, *args, **kwargs)
        programs.append(self)

    monkeypatch.setattr(Program, "__init__", kept)
    run_unrecorded(load_scenario("straight", sets={**SHIPPED, **sets}))
    program = programs[-1]
    found = {
        program._slots[place].name.partition(".")[2]: [
            each._recorded.kernel.key for each in member.op._launches
        ]
        for place, member in program.by_place.items()
    }
    rest = [slot.name for place, slot in enumerate(program._slots) if place not in program.by_place]
    return found, rest


@pytest.mark.parametrize(("sets", "own"), [({}, OWN), (OTHERS, PROFILE)], ids=["as shipped", "profile"])
def test_each_part_is_walked_by_compiled_code(sets, own, monkeypatch):
    found, rest = launches(monkeypatch, sets)
    assert rest == []
    assert found == {**ALIKE, **own}


def test_a_part_in_python_and_who_hears_it_are_none_of_them(monkeypatch):
    found, rest = launches(monkeypatch, {"combine.lidar.level": "plants"})
    assert rest == ["combine.lidar", "combine.edge"]  # whose scans are objects, with arrays of any length
    assert "lidar" not in found
