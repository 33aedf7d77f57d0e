"""Why a machine stopped: a limit on stops because of a person is not kept by a stop before a phantom wall."""

from dataclasses import dataclass

import pytest

from swath.core.component import KeepsState, Port
from swath.core.errors import InputError
from swath.core.registry import level_here
from swath.runtime.job import run_unrecorded
from swath.scenario.scenario import find_scenario, load_scenario
from swath.signals import Objects
from swath.signals.objects import objects_of

WALL = [1, 0, 9.0, 0.0, 0.0, 0.5, 12.0, 2.0, 0.0, 0.0, 0.9, 0.0]  # 9 m ahead, as wide as the header
KEPT = ["contact_count", "least_clearance_m", "rollover_count"]


class Phantom(KeepsState):
    """From 3 s on tells of a wall that is not there, and of nothing else."""

    kept = ()
    inputs = ()
    outputs = (Port("objects", Objects),)

    @dataclass(frozen=True)
    class Params:
        """None."""

    def __init__(self, params, setup):
        pass

    def reset(self, stream):
        return {"objects": objects_of(0, [])}

    def step(self, t, dt, inputs):
        return {"objects": objects_of(t + dt, [WALL] if t > 3e9 else [])}


def run(*sets):
    summary = run_unrecorded(load_scenario("person-at-edge", sets=sets))
    return {entry["name"]: entry for entry in summary["expect"]}, summary["incidents"]


@pytest.fixture(scope="module")
def before_a_phantom():
    return run(f"combine.objects={level_here(Phantom)}", "combine.lidar=off", "run.max_duration_s=14")


def test_a_phantom_wall_is_no_person(before_a_phantom):
    """The combine stands, touches nobody and keeps its distance: all but the reason is right."""
    found, incidents = before_a_phantom
    assert [e["kind"] for e in incidents] == ["stop"]
    assert all(found[name]["result"] == "pass" for name in KEPT)
    assert found["stop_count"]["result"] == "fail"
    expected = "0 is less than 1 because of person; 1 in all, because of nothing that is there"
    assert found["stop_count"]["reason"] == expected


def test_the_person_is_one():
    found, incidents = run("combine.objects=truth", "combine.lidar=off")
    assert found["stop_count"]["result"] == "pass"
    assert incidents[0]["because"] == ["person 1", "person"]


def test_only_stops_know_why():
    for limit, part in (
        ("contact_count={max: 0, because: person}", "expected it of stop_count alone"),
        ("stop_count={min: 1, because: person, to_m: 5}", "expected no window beside it"),
    ):
        with pytest.raises(InputError, match=part):
            load_scenario("person-at-edge", sets=[f"expect.{limit}"])


def test_a_cause_is_the_name_or_kind_of_what_may_be_there(tmp_path):
    text = find_scenario("person-at-edge").read_text()
    file = tmp_path / "mine.yaml"
    for cause in ("person 1", "machine", "stone", "obstacles.dog"):  # the last one may come as the run goes
        file.write_text(text.replace("because: person", f"because: {cause}"))
        assert load_scenario(file).expect[-1].limit.because == cause
    file.write_text(text.replace("because: person", "because: persn"))
    with pytest.raises(InputError, match="did you mean 'person'") as told:
        load_scenario(file)
    line = 1 + next(k for k, row in enumerate(text.splitlines()) if "because: person" in row)
    assert (told.value.key, told.value.value) == ("expect.stop_count.because", "persn")
    assert (str(told.value.file), told.value.line) == (str(file), line)
    file.write_text(text.replace("because: person", "because: person 2"))
    with pytest.raises(InputError, match="expected a name or kind of obstacles or machines"):
        load_scenario(file)
