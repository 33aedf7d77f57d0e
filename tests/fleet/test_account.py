"""Grain over time, ways, litres, waits; and the page that plays a job from above."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from swath.core.number_text import num
from swath.fleet.driven import driven
from swath.fleet.report import (
    NEAR,
    collected,
    machine_rows,
    pair_rows,
    result_rows,
    thinned,
    to_dict,
    write_replay,
)
from swath.fleet.schedule import schedule_of
from swath.fleet.worked import (
    IDLE,
    WAITS,
    Span,
    by_events,
    checked,
    grain,
    litres_per_ha,
    stays,
    used,
)
from tests.fleet.check import over_each_other
from tests.fleet.drawn import drawn_job, scheduled
from tests.replay.browser import Browser, NoBrowser

LEVELS = ("events", "driven")


@pytest.fixture(scope="module")
def done():
    schedule = scheduled(130)
    return {"events": by_events(schedule), "driven": driven(schedule)}


@pytest.mark.parametrize("level", LEVELS)
def test_all_grain_that_is_cut_is_somewhere_all_the_time(level, done):
    w = done[level]
    held = grain(w)
    cut = [(into, into + s.spent, w.schedule.grain[s.number]) for s, into, _ in stays(w)
           if s.number in w.schedule.grain]  # fmt: skip
    for t in np.linspace(0.0, w.ends + 100.0, 60):
        there = math.fsum(float(np.interp(t, *levels)) for levels in held.values())
        come = math.fsum(kg * min(max((t - a) / (b - a), 0.0), 1.0) for a, b, kg in cut)
        assert there == pytest.approx(come, abs=1e-9 * w.schedule.harvested)
    assert held["truck"][1][-1] == pytest.approx(w.schedule.harvested, rel=1e-9)
    assert w.mass_error <= 1e-9
    (printed,) = [value for what, value, _ in result_rows(w) if what.startswith("mass error")]
    assert float(printed) <= 1e-9
    for m in (*w.schedule.machines.combines, *w.schedule.machines.carts):
        most = m.tank if hasattr(m, "tank") else m.load
        assert held[m.name][1].min() >= -1e-6
        assert held[m.name][1].max() <= most * (1.0 + 1e-9)


@pytest.mark.parametrize("percent", [0.0, 60.0])
def test_efficiency_is_by_the_crop_of_the_field_not_by_what_tanks_begin_with(percent):
    job = drawn_job(130, (0.5, 1.0))
    combines = {n: replace(c, tank_start_percent=percent) for n, c in job.combines.items()}
    w = by_events(schedule_of(replace(job, combines=combines, field=replace(job.field, yield_t_ha=25.0))))
    (combine,) = w.schedule.machines.combines
    rate = combine.width * combine.speed_in(2.5 * combine.width)
    assert combine.speed_in(2.0 * combine.width) > 1.1 * combine.speed_in(2.5 * combine.width)
    assert w.efficiency == pytest.approx(w.schedule.plan.area / (rate * w.cut), rel=1e-6)
    levels = grain(w)[combine.name][1]
    assert levels[0] == pytest.approx(0.01 * percent * combine.tank)
    assert 0.8 * combine.tank < levels.max() <= combine.tank * (1.0 + 1e-9)


@pytest.mark.parametrize("level", LEVELS)
def test_ways_are_those_of_the_paths_and_litres_are_of_a_combine_harvest(level, done):
    took = used(done[level])
    for name, u in took.items():
        segments = [s for s in done[level].schedule.table.segments if s.machine == name]
        ends = {id(s.path): float(s.path.track.distance[s.path.last[s.index]]) for s in segments}
        whole = math.fsum(ends.values())
        assert u.way == pytest.approx(whole, rel=0.02)
    assert 10.0 < litres_per_ha(done[level]) < 60.0  # a small odd field: much turning
    driven_way = np.hypot(*np.diff(done["driven"].places["cart_1"][:, :2], axis=0).T).sum()
    assert took["cart_1"].way == pytest.approx(driven_way, rel=0.02)


def test_contact_of_driven_bodies_is_printed_and_is_what_another_look_finds(done):
    w = done["driven"]
    assert ("machines over each other", "0", "s") in result_rows(w)
    assert to_dict(w)["contact_s"] == {}
    assert to_dict(done["events"])["contact_s"] is None
    a, b, *_ = w.places
    moved = dict(w.places)
    moved[b] = w.places[b] + (*(w.places[a][1000, :2] - w.places[b][1000, :2] + (5.0, 2.0)), 0.0, 0.0)
    found = replace(w, places=moved).contact
    machines = w.schedule.machines.by_name
    there = 0.1 * over_each_other(machines[a].body, moved[a], machines[b].body, moved[b])
    assert found[a, b] == pytest.approx(there, abs=0.05)
    assert there > 0.0


def test_waits_are_shown_by_what_is_waited_for():
    spans = [Span("wait", 0, 1, reason) for reason in ("cart_1", "ground of cart_1", "the next truck")]
    assert [s.shown for s in spans] == list(WAITS)
    assert Span(IDLE, 0, 1).shown == IDLE


def test_a_cart_that_takes_no_load_is_told(done):
    w = done["events"]
    assert not any("takes no load" in note for note in checked(w))
    without = replace(w, poured=[p for p in w.poured if p.target == "truck"])
    assert [note for note in checked(without) if note.startswith("cart_1 takes no load")]


def test_the_table_says_where_all_minutes_of_a_machine_are(done):
    w = done["driven"]
    head, rows = machine_rows(w)
    first, last = head.index("cut"), head.index("idle")
    for name, *cells in rows:
        total = math.fsum(map(float, cells[first - 1 : last]))
        assert name in w.spans
        assert total == pytest.approx(w.ends / 60.0, abs=0.6)
    assert sum(float(row[2]) for row in pair_rows(w)) == pytest.approx(w.schedule.harvested / 1000.0, abs=0.2)


def test_a_track_is_thinned_to_what_lies_off_the_line():
    t = np.arange(0.0, 100.0, 0.5)
    bent = np.column_stack([t, t, np.where(t > 60.0, (t - 60.0) ** 2 / 40.0, 0.0), 0.0 * t, 0.0 * t])
    kept = thinned(bent)
    assert len(kept) < 0.4 * len(bent)
    for column in (1, 2):
        off = np.abs(np.interp(t, kept[:, 0], kept[:, column]) - bent[:, column]).max()
        assert off < 8.0 * NEAR[0]
    assert (kept[[0, -1]] == bent[[0, -1]]).all()


@pytest.mark.parametrize("level", LEVELS)
def test_the_page_has_machines_where_they_were(level, done):
    w = done[level]
    values, arrays = collected(w)
    frame = w.schedule.ground.frame
    for k, m in enumerate(values["machines"]):
        t, x, y, *_ = arrays[f"track_{k}"]
        assert all(a < b for a, b in pairwise(t.tolist()))
        if level == "driven":
            there = frame.to_map(w.places[m["name"]][:, :2]) - (frame.x, frame.y)
            off = np.hypot(np.interp(w.clock, t, x) - there[:, 0], np.interp(w.clock, t, y) - there[:, 1])
            assert off.max() < 0.5
        assert [s[3] for s in m["spans"]] == [s.reason for s in w.spans[m["name"]]]
    cut = arrays["cuts"]
    area = (np.hypot(cut[:, 2] - cut[:, 0], cut[:, 3] - cut[:, 1]) * cut[:, 4]).sum()
    assert area > w.schedule.plan.area


def test_a_browser_plays_it(done, tmp_path: Path):
    w = done["driven"]
    page = write_replay(w, "drawn <b>", "level driven", tmp_path)
    begin, end = next((p.begins, p.ends) for p in w.poured if p.target != "truck")
    try:
        with Browser((900, 600)) as browser:
            browser.open(page, f"t={0.5 * (begin + end):.1f}")
            first = browser.ask("document.querySelector('.machine span').textContent")
            bar = browser.ask("document.querySelector('.machine i').style.width")
            browser.ask("swath.chooseMachine('cart_1')")
            browser.ask("new Promise((done) => setTimeout(done, 300))")
            scale = browser.ask("swath.scale")
            browser.ask("document.getElementById('play').click()")
            moved = f"swath.time > {0.5 * (begin + end)} || Date.now() > stop"
            look = f"const look = () => ({moved} ? done() : setTimeout(look, 100)); look();"
            browser.ask(f"new Promise((done) => {{ const stop = Date.now() + 60000; {look} }})")
            later = browser.ask("swath.time")
            browser.ask("document.dispatchEvent(new KeyboardEvent('keydown', {key: 'b', bubbles: true}))")
            assert browser.told == []
    except NoBrowser as error:
        pytest.skip(str(error))
    assert "t · " in first
    assert float(bar.rstrip("%")) > 0.0
    assert scale >= 4.0
    assert later > 0.5 * (begin + end)


@pytest.mark.parametrize(("times", "is_told"), [(1.9, False), (2.5, True)])
def test_a_job_far_over_its_bound_says_what_waits_longest(times, is_told, done):
    w = done["events"]
    w = replace(w, schedule=replace(w.schedule, bound=w.ends / times))
    notes = [note for note in checked(w) if "as long as the least" in note]
    assert len(notes) == is_told
    if is_told:
        longest = max((minutes, name) for name in w.spans for minutes in w.waited(name).values())
        assert f"{times} times" in notes[0]
        assert f"the longest wait: {longest[1]}, {num(longest[0])} min" in notes[0]
