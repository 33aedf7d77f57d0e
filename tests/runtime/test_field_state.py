"""A run that begins on the field as another left it."""

import json

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.field.field import Field
from swath.field.paging.state_file import read_state, write_state
from swath.record.digest import Digest
from swath.runtime.assembly import assemble
from swath.runtime.field_state import about
from swath.runtime.job import run_unrecorded
from swath.runtime.loop import drive
from swath.scenario.overrides import layered
from swath.scenario.scenario import load_scenario

STRAIGHT = [
    "run.distance_m=8",
    "combine.lidar=off",
    "combine.edge=truth",
    "combine.steer=constant",
    "combine.motion.level=kinematic",
    "combine.process.level=constant",
    "expect={}",
]
SMALL = ["field.stand.stems_per_m2=60"]


def scenario(*sets):
    return load_scenario("straight", sets=layered(STRAIGHT, SMALL, sets))


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """The first 8 m, by the command."""
    folder = tmp_path_factory.mktemp("state")
    words = [w for s in (*STRAIGHT, *SMALL) for w in ("--set", s)]
    out, state = folder / "first", folder / "after.npz"
    run = ["run", "straight", *words, "--out", str(out), "--save-field", str(state), "--quiet", "--no-replay"]
    assert main(run) == 0
    return json.loads((out / "summary.json").read_text()), state


def test_two_drives_with_the_field_in_a_file_are_the_one_driven_through(tmp_path):
    """Machines and graph go on in memory, the field through the file: every later sample is the same."""
    plan, half = scenario("combine.lidar.level=empirical", "combine.edge.level=likelihood_ratio"), 2.0
    whole, seen = assemble(plan), Digest()
    drive(whole, until_s=half)
    saved = whole.save()
    write_state(tmp_path / "half.npz", whole.field.save(), about(plan))
    drive(whole, [seen], until_s=2 * half, resume=True)

    again, twice = assemble(plan), Digest()
    state = read_state(tmp_path / "half.npz", about(plan))
    again.load({**saved, "field": state})
    drive(again, [twice], until_s=2 * half, resume=True)
    assert whole.graph.t == again.graph.t > half * NS
    assert twice.hex == seen.hex
    assert again.field.recount() == whole.field.recount()
    whole.close(), again.close()


def test_a_run_on_the_field_of_another_finds_it_cut(first):
    """The same 8 m again yield nothing, and the balance counts from the start of the run."""
    summary, state = first
    repeated = run_unrecorded(scenario(f"field.state_file={state}"))
    assert summary["area_cut_m2"] > 0
    assert repeated["area_cut_m2"] == 0.0
    assert repeated["mass_balance_error"] < 1e-9


def test_two_runs_in_a_row_cut_what_one_driven_through_cuts(first):
    summary, state = first
    on = scenario(f"field.state_file={state}", "combine.start.along_edge_m=8")
    through = scenario("run.distance_m=16")
    second, one = (run_unrecorded(s) for s in (on, through))
    both = summary["area_cut_m2"] + second["area_cut_m2"]
    assert both == pytest.approx(one["area_cut_m2"], rel=2e-3)
    assert second["mass_balance_error"] < 1e-9


def test_a_world_that_is_reset_starts_on_it_again(first):
    world = assemble(scenario(f"field.state_file={first[1]}"))
    world.reset()
    begun = world.field.save()
    drive(world, until_s=1.0)
    world.reset()
    after = world.field.save()
    np.testing.assert_array_equal(begun["keys"], after["keys"])
    assert (begun["codes"], begun["straw"]) == (after["codes"], after["straw"])
    assert world.field.recount().area == 0.0
    world.close()


def test_grain_on_the_ground_comes_along(tmp_path):
    world = assemble(scenario())
    world.field.deposit_grain(1.2, -3.4, 5.0)
    write_state(tmp_path / "grain.npz", world.field.save(), {})
    other: Field = assemble(scenario()).field
    other.start_from(read_state(tmp_path / "grain.npz", {}))
    assert other.grain.piles() == world.field.grain.piles()
    assert other.ground_grain_kg == 0.0
    world.close()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("field.stand.stems_per_m2=61", "field.stand.stems_per_m2 60.0, here 61.0"),
        ("seed=9", "field.seed 1, here 9"),
        ("field.terrain={level: plane, slope_percent: 3}", "field.terrain."),
    ],
)
def test_the_state_of_another_field_is_refused_by_name(first, change, said):
    with pytest.raises(InputError) as caught:
        assemble(scenario(f"field.state_file={first[1]}", change))
    assert caught.value.key == "field.state_file"
    assert said in str(caught.value)


def test_a_damaged_file_is_refused(first, tmp_path, capsys):
    broken = tmp_path / "broken.npz"
    broken.write_bytes(first[1].read_bytes()[:-2000])
    assert main(["run", "straight", "--field-state", str(broken), "--out", str(tmp_path / "r")]) == 2
    assert "expected a field state" in capsys.readouterr().err
    assert main(["run", "straight", "--field-state", "nowhere.npz"]) == 2
    assert "there is no such file" in capsys.readouterr().err


def test_what_changes_no_crop_does_not_matter(first):
    plan = scenario(f"field.state_file={first[1]}", "combine.speed.speed_kmh=4")
    assert about(plan) == about(scenario())
