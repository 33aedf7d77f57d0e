"""Passes shared out among combines before the job, as with sensors, at the other levels."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import SwathError
from swath.job import spread, ways
from swath.job.combine_ways import axle_pose
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.kinematic import Kinematic
from swath.job.machines import fleet_of
from swath.job.path import Pose, path_of
from swath.job.spread import spread_of
from swath.job.work import plan_of, work_off
from swath.tools.fleet import whole
from swath.tools.fleet.combine_turns import following
from swath.tools.fleet.work_plan import share_out
from tests.job.jobs import finished
from tests.job.layouts import both_levels, layout_file

TWO = "combines.second.machine=lexion-700"


@pytest.fixture(scope="module")
def told():
    """Layout 18 with one cart: its file, and the passes shared out."""
    file = layout_file(18, 1)
    fleet = fleet_of(file)
    return file, share_out(file, plan_of(file, fleet, None), fleet)


def test_each_combine_cuts_its_own_passes_in_their_order(told):
    file, shared = told
    job = Job(file, shared, fleet_of(file), Events())
    job.run()
    for combine in job.combines:
        cut = [s.pass_index for s in combine.timeline.spans if s.state == "cut"]
        own = [i for i, number in enumerate(shared.by) if number == combine.number]
        assert list(dict.fromkeys(cut)) == own
    assert len(set(shared.by)) == 2
    assert job.passes.left() == 0


def test_both_levels_take_as_long_where_each_combine_cuts_the_same_passes(told):
    """As they come to them, driven machines share out otherwise on this layout and take 8 % longer."""
    file, shared = told
    cheap, dear, _, unsolved = both_levels(file, is_shared_out=True)
    assert 3600.0 * cheap == finished(file, shared).time
    assert dear == pytest.approx(cheap, rel=0.02)
    assert unsolved == 0
    assert 3600.0 * cheap > 1.05 * finished(file).time


def test_the_hours_of_speeds_that_differ_are_those_of_these_passes(told, monkeypatch):
    monkeypatch.setattr(spread, "DRAWS", 4)
    file, shared = told
    fleet = fleet_of(file)
    found = spread_of(file, shared, fleet, 0.01)
    assert len(found.durations) == 4
    assert found.mean == pytest.approx(finished(file, shared).time, rel=0.01)
    assert found.mean > 1.05 * spread_of(file, plan_of(file, fleet, None), fleet, 0.01).mean


def test_with_sensors_the_hours_by_events_of_the_same_passes_are_told(told, monkeypatch):
    """One that does not end there loses nothing of the run."""
    file, shared = told
    fleet, hours = fleet_of(file), finished(file, shared).time / 3600.0
    assert whole._by_events(file, shared, fleet).startswith(f"{hours:.2f} h by events")

    def fails(job):
        raise SwathError("the job does not end")

    monkeypatch.setattr(Job, "run", fails)
    assert whole._by_events(file, shared, fleet).endswith("the job does not end")


def test_a_job_without_a_second_combine_is_the_same_but_for_its_turns():
    file = layout_file(3, 1)
    fleet = fleet_of(file)
    shared = share_out(file, plan_of(file, fleet, None), fleet)
    assert finished(file, shared._replace(turns={})).time == work_off(file).duration
    assert work_off(file, share_out=share_out).duration == finished(file, shared).time
    assert finished(file, shared).time != work_off(file).duration


@pytest.mark.parametrize("motion", [Events, Kinematic])
def test_between_passes_combines_drive_the_ways_planned_for_sensors(told, motion):
    file, shared = told
    driven = sorted(np.hypot(*np.diff(way, axis=0).T).sum() for way in finished(file, shared, motion()).ways)
    planned = sorted(sum(piece.length for piece in way) for way in shared.turns.values())
    assert driven == pytest.approx(planned, abs=0.05)


def test_not_where_these_come_near_to_the_truck(told):
    """With sensors it stands farther off."""
    file, shared = told
    combine = SimpleNamespace(spec=fleet_of(file).combines[shared.by[0]], before=0)
    combine.place = shared.plan.passes[0].end
    job = SimpleNamespace(turns=shared.turns, places=[], fleet=fleet_of(file))
    way = ways.planned_way(job, combine)
    assert way is not None
    job.places = [Pose(*way.points[len(way.points) // 2], 0.0)]
    assert ways.planned_way(job, combine) is None


def test_a_planned_way_leads_from_the_end_of_a_pass_to_the_begin_of_the_next(told):
    file, shared = told
    fleet = fleet_of(file)
    for i, k in following(shared.by):
        combine = fleet.combines[shared.by[i]]
        here, goal = (
            axle_pose(pose, combine.sheet.knife_x)
            for pose in (shared.plan.passes[i].end, shared.plan.passes[k].start)
        )
        end = path_of(shared.turns[i], here).end
        assert end[:2] == pytest.approx(goal[:2], abs=0.05)
        assert math.cos(end.heading - goal.heading) == pytest.approx(1.0, abs=1e-4)


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
