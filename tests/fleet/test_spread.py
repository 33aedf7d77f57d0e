"""Spread: draws are jobs of their own, close to what was given, the same each time; a stopped one goes on."""

import json
from dataclasses import replace

import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.fleet import spread
from swath.fleet.schedule import schedule_of
from swath.fleet.spread import drawn, spread_of
from tests.fleet.drawn import drawn_job

JOB = drawn_job(131, (0.5, 1.0))


@pytest.fixture
def three(monkeypatch):
    monkeypatch.setattr(spread, "DRAWS", 3)


def test_draws_differ_by_no_more_than_the_share_and_are_the_same_each_time():
    made = [drawn(JOB, n, 0.1) for n in range(40)]
    yields = [m.field.yield_t_ha / JOB.field.yield_t_ha for m in made]
    assert 0.9 <= min(yields) < 0.92
    assert 1.08 < max(yields) <= 1.1
    for name, c in JOB.combines.items():
        speeds = {m.combines[name].speed_kmh / c.speed_kmh for m in made}
        assert len(speeds) == 40
        assert all(0.9 <= s <= 1.1 for s in speeds)
    assert drawn(JOB, 5, 0.1) == drawn(JOB, 5, 0.1)


def test_hours_are_those_of_the_drawn_jobs_and_a_stopped_spread_goes_on(three, tmp_path, monkeypatch):
    hours, refused = spread_of(JOB, None, 5.0, tmp_path)
    assert (len(hours), refused) == (3, [])
    assert hours[1] == pytest.approx(schedule_of(drawn(JOB, 1, 0.05)).ends, rel=0.02)
    kept = json.loads((tmp_path / "draws.json").read_text())
    (tmp_path / "draws.json").write_text(json.dumps({**kept, "draws": kept["draws"][:2]}))
    looked = []
    monkeypatch.setattr(spread, "drawn", lambda job, n, share: looked.append(n) or drawn(job, n, share))
    assert spread_of(JOB, None, 5.0, tmp_path)[0] == hours
    assert looked == [2]
    (tmp_path / "draws.json").write_text('{"job": "another", "draws": [1.0, 2.0, 3.0]}')
    monkeypatch.setattr(spread, "schedule_of", lambda *_: (_ for _ in ()).throw(InputError("x", None, "no")))
    assert spread_of(JOB, None, 5.0, tmp_path) == ([], ["x: no"] * 3)


def test_draws_of_another_dispatcher_under_the_same_name_are_not_kept(tmp_path, monkeypatch):
    def refused(said):
        raise InputError("x", None, said)

    monkeypatch.setattr(spread, "DRAWS", 1)
    job = replace(JOB, fleet=replace(JOB.fleet, dispatcher="mine.py:Mine"))
    for code, said, kept in (("1", "one", "one"), ("1", "one again", "one"), ("2", "two", "two")):
        (tmp_path / "mine.py").write_text(code)
        monkeypatch.setattr(spread, "schedule_of", lambda *_, said=said: refused(said))
        assert spread_of(job, tmp_path, 5.0, tmp_path / "out")[1] == [f"x: {kept}"]


@pytest.mark.parametrize("percent", [0.0, -1.0, 21.0])
def test_a_percentage_that_is_none_is_refused(percent):
    with pytest.raises(InputError, match="--spread"):
        spread_of(JOB, None, percent)


def test_the_command_says_the_range_and_which_draws_are_refused(tmp_path, capsys, monkeypatch):
    asked = []

    def made(job, base, percent, out, told):
        asked.append((job.name, percent, out))
        return [1800.0, 3600.0], ["x: no"]

    monkeypatch.setattr(spread, "spread_of", made)
    out = tmp_path / "out"
    arguments = ["fleet", "run", "small-field", "--spread", "5", "--out", str(out), "--set", "fleet.plans=1"]
    assert main(arguments) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert asked == [("small-field", 5.0, out)]
    assert "0.5 to 1, mean 0.75" in said
    assert "a draw of the spread is refused: x: no" in said
    assert json.loads((out / "results.json").read_text())["draws_s"] == [1800.0, 3600.0]
