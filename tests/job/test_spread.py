"""Hours of a job where speeds of its machines differ by a little."""

import json
import random
from dataclasses import replace

import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.job.machines import fleet_of
from swath.job.spread import DRAWS, drawn, spread_of
from swath.job.work import plan_of
from tests.job.jobs import finished, job_file

SMALL = {"boundary_m": [(0.0, 0.0), (200.0, 0.0), (200.0, 100.0), (0.0, 100.0)]}


def made(file, percent):
    fleet = fleet_of(file)
    return spread_of(file, plan_of(file, fleet, None), fleet, percent)


def test_one_combine_alone_takes_longer_by_its_time_in_the_crop():
    """In closed form, to 2 s of up to 45: turns and ways to the truck hardly depend on its speed there."""
    file = job_file(carts=0, yield_t_ha=2.0, **SMALL)
    combine = fleet_of(file).combines[0]
    assert combine.speed_in(2.0) == combine.speed  # the header limits it, not the threshing
    job, draw = finished(file), random.Random(1)
    cuts = job.combines[0].timeline.time("cut")
    found = made(file, 5.0)
    shares = [draw.uniform(-0.05, 0.05) for _ in range(DRAWS)]
    expected = [job.time + cuts * (1.0 / (1.0 + share) - 1.0) for share in shares]
    assert found.durations == pytest.approx(expected, abs=2.0)
    assert max(expected) - min(expected) > 80.0
    assert found.mean == pytest.approx(sum(found.durations) / DRAWS)


def test_the_draws_are_those_of_machines_with_other_speeds():
    file = job_file(2, 1, **SMALL)
    fleet = fleet_of(file)
    other = drawn(fleet, random.Random(1), 0.03, 0.03)
    for before, after in zip((*fleet.combines, *fleet.carts), (*other.combines, *other.carts), strict=True):
        assert 0.0 < abs(after.speed / before.speed - 1.0) <= 0.03
        assert replace(after, speed=before.speed) == before
    found = made(file, 3.0)
    assert found == made(file, 3.0)
    assert len(set(found.durations)) == DRAWS
    first = replace(
        file,
        combines={m.name: replace(file.combines[m.name], speed_kmh=3.6 * m.speed) for m in other.combines},
        carts={m.name: replace(file.carts[m.name], speed_kmh=3.6 * m.speed) for m in other.carts},
    )
    assert found.durations[0] == pytest.approx(finished(first).time, rel=1e-9)


@pytest.mark.parametrize("percent", [0.0, -1.0, 21.0, float("nan")])
def test_a_percentage_that_is_none_is_refused(percent):
    with pytest.raises(InputError, match="expected more than 0 and at most 20 percent"):
        made(job_file(**SMALL), percent)


def test_the_command_says_the_range(tmp_path, capsys):
    out = tmp_path / "job"
    assert main(["fleet", "run", "small-field", "--spread", "2", "--out", str(out)]) == 0
    spread = json.loads((out / "results.json").read_text())["spread"]
    low, high = (
        f"{seconds / 3600.0:.3f}" for seconds in (min(spread["duration_s"]), max(spread["duration_s"]))
    )
    assert f"{low} to {high}, mean" in capsys.readouterr().out
    assert f"{low} to {high}, mean" in (out / "report.html").read_text()
    assert spread["percent"] == 2.0


def test_it_is_for_events_only(capsys):
    assert main(["fleet", "run", "small-field", "--spread", "2", "--level", "kinematic"]) != 0
    assert "--spread = 2.0: expected the level events, not kinematic" in capsys.readouterr().err
