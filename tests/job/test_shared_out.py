"""Passes shared out among combines before the job, as with sensors, at the other levels."""

import json

import pytest

from swath.commands.main import main
from swath.core.errors import SwathError
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.machines import fleet_of
from swath.job.spread import DRAWS, spread_of
from swath.job.work import plan_of, work_off
from swath.tools.fleet import whole
from swath.tools.fleet.work_plan import share_out
from tests.job.jobs import finished
from tests.job.layouts import both_levels, layout_file

TWO = "combines.second.machine=lexion-700"


@pytest.fixture(scope="module")
def told():
    """Layout 18 with one cart: file, passes in their order, combine of each."""
    file = layout_file(18, 1)
    fleet = fleet_of(file)
    return file, *share_out(file, plan_of(file, fleet, None), fleet)


def test_each_combine_cuts_its_own_passes_in_their_order(told):
    file, plan, by = told
    job = Job(file, plan, fleet_of(file), Events(), by)
    job.run()
    for combine in job.combines:
        cut = [s.pass_index for s in combine.timeline.spans if s.state == "cut"]
        own = [i for i, number in enumerate(by) if number == combine.number]
        assert list(dict.fromkeys(cut)) == own
    assert len(set(by)) == 2
    assert job.passes.left() == 0


def test_both_levels_take_as_long_where_each_combine_cuts_the_same_passes(told):
    """As they come to them, driven machines share out otherwise on this layout and take 8 % longer."""
    file, plan, by = told
    cheap, dear, _, unsolved = both_levels(file, is_shared_out=True)
    assert 3600.0 * cheap == finished(file, plan, by=by).time
    assert dear == pytest.approx(cheap, rel=0.02)
    assert unsolved == 0
    assert 3600.0 * cheap > 1.05 * finished(file).time


def test_the_hours_of_speeds_that_differ_are_those_of_these_passes(told):
    file, plan, by = told
    fleet = fleet_of(file)
    found = spread_of(file, plan, fleet, 0.01, by=by)
    assert len(found.durations) == DRAWS
    assert found.mean == pytest.approx(finished(file, plan, by=by).time, rel=0.01)
    assert found.mean > 1.05 * spread_of(file, plan_of(file, fleet, None), fleet, 0.01).mean


def test_with_sensors_the_hours_by_events_of_the_same_passes_are_told(told, monkeypatch):
    """One that does not end there loses nothing of the run."""
    file, plan, by = told
    fleet, hours = fleet_of(file), finished(file, plan, by=by).time / 3600.0
    assert whole._by_events(file, plan, fleet, by).startswith(f"{hours:.2f} h by events")

    def fails(job):
        raise SwathError("the job does not end")

    monkeypatch.setattr(Job, "run", fails)
    assert whole._by_events(file, plan, fleet, by).endswith("the job does not end")


def test_a_job_without_a_second_combine_is_the_same():
    file = layout_file(3, 1)
    assert work_off(file, share_out=share_out).duration == work_off(file).duration


def test_the_command_shares_out(tmp_path, capsys):
    run = ["fleet", "run", "small-field", "--set", TWO, "--out"]
    assert main([*run, str(tmp_path / "a"), "--shared-out"]) == 0
    assert main([*run, str(tmp_path / "b")]) == 0
    capsys.readouterr()
    shared, taken = (json.loads((tmp_path / n / "results.json").read_text()) for n in "ab")
    assert shared["digest"] != taken["digest"]
    assert "shared out" in " ".join(shared["notes"])
    assert "shared out" not in " ".join(taken["notes"])
    assert shared["grain_kg"] == pytest.approx(taken["grain_kg"], rel=1e-9)


def test_what_cannot_be_shared_out_is_refused(capsys):
    more = [f"combines.c{n}.machine=lexion-700" for n in range(3)]
    sets = [part for s in more for part in ("--set", s)]
    assert main(["fleet", "run", "small-field", *sets, "--shared-out"]) != 0
    assert "combines = 4: expected 3 at most" in capsys.readouterr().err
