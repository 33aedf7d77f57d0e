"""`swath twin`: what is learned on closed forms, how scans become numbers, banks, a still scanner, checks."""

import csv
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.units import DEG
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario
from swath.sensing.lidar_sheet import load_lidar
from swath.tools.function_test.evidence import CHECK, EVIDENCE
from swath.tools.function_test.field_plan.form import compared
from swath.tools.function_test.one_run import no_result
from swath.tools.height_map.build import open_source
from swath.tools.height_map.source import Wanted
from swath.tools.twin.bank import BankAsked, make_bank
from swath.tools.twin.check import Agreement
from swath.tools.twin.fit import SCENARIO, estimates_of
from swath.tools.twin.learned import CENTRAL, ask, learn
from swath.tools.twin.looks import NAMES, Recorded, View, numbers_of, read_looks, view_of
from swath.tools.twin.still import FACTOR, LOST, fit_still, further_than
from swath.tools.twin.structure import COUNT, structure_of
from swath.tools.twin.unlike import unlike
from tests.shared_data import DATA
from tests.tools.fake_work import here

TOLD, NUMBERS, SCATTER = 3, 20, 0.05  # of four unknowns the last one shows nowhere
RNG = np.random.default_rng(1)
SLOPES, BENDS = RNG.normal(size=(TOLD, NUMBERS)), 0.5 * RNG.normal(size=(TOLD, NUMBERS))


def looks(shares, rng):
    """Numbers that bend with the first unknowns, and scatter."""
    some = shares[:, :TOLD]
    return some @ SLOPES + some**2 @ BENDS + SCATTER * rng.standard_normal((len(shares), NUMBERS))


@pytest.fixture(scope="module")
def runs():
    rng = np.random.default_rng(2)
    shares = rng.random((200, TOLD + 1))
    numbers = looks(shares, rng)
    return shares, numbers, learn(shares, numbers)


# ---- What is learned
def test_intervals_hold_and_what_shows_nowhere_is_not_known(runs):
    rng = np.random.default_rng(3)
    truth = rng.random((150, TOLD + 1))
    answers = [ask(*runs, seen) for seen in looks(truth, rng)]
    held = np.array([(a.low <= t) & (t <= a.high) for a, t in zip(answers, truth, strict=True)])
    off = np.array([np.abs(a.mean - t) for a, t in zip(answers, truth, strict=True)])
    assert 0.90 <= held[:, :TOLD].mean() <= 0.99
    assert np.median(off[:, :TOLD]) < 0.25 / np.sqrt(12.0)
    assert all(a.is_known[:TOLD].all() and not a.is_known[TOLD] for a in answers)
    assert all((a.low[TOLD], a.high[TOLD]) == CENTRAL for a in answers)


def test_a_number_that_was_not_seen_is_done_without(runs):
    seen = looks(np.full((1, TOLD + 1), 0.4), np.random.default_rng(4))[0]
    whole = ask(*runs, seen)
    part = ask(*runs, np.where(np.arange(NUMBERS) < 5, np.nan, seen))
    assert part.is_known[:TOLD].all()
    np.testing.assert_allclose(part.mean[:TOLD], whole.mean[:TOLD], atol=0.1)


def test_of_scans_like_none_of_the_bank_nothing_is_known(runs):
    seen = looks(np.full((1, TOLD + 1), 0.5), np.random.default_rng(5))[0]
    answer = ask(*runs, seen + 2.0 * np.where(np.arange(NUMBERS) % 2, 1.0, -1.0))
    assert answer.is_stray
    assert not answer.is_known.any()


def test_answers_of_one_world_are_near_each_other_and_of_two_are_not(runs):
    rng = np.random.default_rng(19)
    one, same, other = (
        [ask(*runs, seen) for seen in looks(np.full((40, TOLD + 1), share), rng)] for share in (0.3, 0.3, 0.6)
    )
    found = [Agreement(1.0, a.apart(b)) for a, b in zip(one, same, strict=True)]
    assert all(np.isnan(f.apart[TOLD]) and np.isfinite(f.apart[:TOLD]).all() for f in found)
    assert np.mean([f.chance <= 0.05 for f in found]) < 0.1
    assert all(Agreement(1.0, a.apart(b)).chance <= 0.01 for a, b in zip(one, other, strict=True))
    assert all(f.chance == 0.01 for f in (Agreement(0.01, np.full(3, np.nan)), Agreement(0.01, np.zeros(3))))


def test_draws_of_an_answer_are_as_wide_as_it_says(runs):
    answer = ask(*runs, looks(np.full((1, TOLD + 1), 0.5), np.random.default_rng(6))[0])
    draws = answer.draws(4000, np.random.default_rng(7))
    np.testing.assert_allclose(draws[:, :TOLD].std(axis=0), answer.sd[:TOLD], rtol=0.1)
    np.testing.assert_allclose(draws[:, TOLD].std(), 1.0 / np.sqrt(12.0), rtol=0.05)


def test_what_is_one_of_the_simulations_fits_and_what_is_none_does_not():
    rng = np.random.default_rng(8)
    own, other = [], []
    for _ in range(30):
        shares = 0.5 + 0.1 * rng.standard_normal((41, TOLD))
        numbers = looks(shares, rng)
        own.append(further_than(numbers[:-1], numbers[-1], shares[:-1]))
        other.append(
            further_than(numbers[:-1], numbers[-1] + np.where(np.arange(NUMBERS) < 4, 0.6, 0.0), shares[:-1])
        )
    assert np.mean(np.array(own) <= 0.05) < 0.2
    assert 0.3 < np.mean(own) < 0.75
    assert np.mean(np.array(other) <= 0.05) > 0.9


def test_a_wider_answer_says_less(runs):
    answer = ask(*runs, looks(np.full((1, TOLD + 1), 0.5), np.random.default_rng(13))[0])
    same, wider, none = (answer.widened(factor) for factor in (1.0, 1.5, 1000.0))
    np.testing.assert_array_equal([same.low, same.high], [answer.low, answer.high])
    np.testing.assert_allclose(
        (wider.high - wider.low)[:TOLD], 1.5 * (answer.high - answer.low)[:TOLD], rtol=1e-9
    )
    assert not none.is_known.any()
    assert all((low, high) == CENTRAL for low, high in zip(none.low, none.high, strict=True))


# ---- Scans unlike those of a bank
def hung(numbers, rng):
    """A structure that goes with numbers."""
    return numbers[:, :8] @ WITH + 0.2 * rng.standard_normal((len(numbers), 12)) @ AMONG


WITH, AMONG = RNG.normal(size=(8, 12)), RNG.normal(size=(12, 12))


@pytest.fixture(scope="module")
def bank_of(runs):
    return *runs[:2], hung(runs[1], np.random.default_rng(14))


def test_what_is_like_a_bank_is_seldom_refused(bank_of):
    rng = np.random.default_rng(15)
    seen = looks(rng.random((80, TOLD + 1)), rng)
    found = [unlike(*bank_of, *both) for both in zip(seen, hung(seen, rng), strict=True)]
    assert np.mean([f.share <= 0.05 for f in found]) < 0.15
    assert 0.35 < np.mean([f.share for f in found]) < 0.65
    assert all((f.over > 1.0) == (f.share <= 0.05) for f in found if abs(f.share - 0.05) > 0.01)


def test_another_structure_and_an_unknown_out_of_range_are_noticed(bank_of):
    """Also without a structure, of what is out of range, and without numbers of the scans."""
    rng = np.random.default_rng(16)
    seen = looks(0.2 + 0.6 * rng.random((40, TOLD + 1)), rng)
    other = hung(seen, rng) + 0.9 * AMONG[:3].sum(axis=0)
    assert np.mean([unlike(*bank_of, *both).share <= 0.05 for both in zip(seen, other, strict=True)]) > 0.9
    beyond = looks(np.tile([1.5, 0.5, 0.5, 0.5], (40, 1)), rng)
    for structure in (hung(beyond, rng), np.full((40, 12), np.nan)):
        assert all(unlike(*bank_of, *both).share <= 0.05 for both in zip(beyond, structure, strict=True))
    nothing = unlike(*bank_of, np.full(NUMBERS, np.nan), np.full(12, np.nan))
    assert (nothing.share, nothing.over) == (1.0, 0.0)


# ---- Scans as numbers
VIEW = View(-60 * DEG, 0.5 * DEG, 241, (0.0,))


def made_scan(rng, count=241):
    azimuth = VIEW.azimuth[:count]
    return azimuth, 0.0 * azimuth, (4.0 + rng.random(len(azimuth))) / np.cos(azimuth)


def test_beams_lie_where_they_point_and_the_first_echo_counts():
    rng = np.random.default_rng(9)
    azimuth, elevation, ranges = made_scan(rng)
    order = rng.permutation(3 * len(azimuth))
    more = np.concatenate([ranges, ranges + 1.0, ranges - 1.0])
    aside = np.concatenate([azimuth, azimuth, azimuth + 0.2 * DEG])
    found = VIEW.laid(aside[order], np.zeros(len(order)), more[order])
    np.testing.assert_array_equal(found[0], ranges.astype(np.float32))
    assert view_of(azimuth, elevation) == replace(VIEW, step=view_of(azimuth, elevation).step)


def test_numbers_do_not_depend_on_how_often_a_scan_comes():
    rng = np.random.default_rng(10)
    stack = np.stack([VIEW.laid(*made_scan(rng)) for _ in range(8)])
    stack[:, :, 100:140][rng.random((8, 1, 40)) < 0.3] = np.nan
    one, twice = (numbers_of(np.repeat(stack, n, axis=0), VIEW) for n in (1, 60))
    known = np.isfinite(one)
    assert known.sum() > 200
    np.testing.assert_allclose(twice[known], one[known], atol=0.2)


def scans_that_hang_together(rng, count, beams):
    """Distances ahead that go on from beam to beam and from scan to scan, and how bright."""
    both = rng.standard_normal((2, count + 8, 1, beams + 8))
    smooth = sum(both[:, n : n + count, :, n : n + beams] for n in range(8)) / np.sqrt(8.0)
    return np.exp(1.5 + 0.05 * smooth[0]), np.exp(0.3 * smooth[1]).astype(np.float32)


def test_structure_says_how_echoes_hang_together_in_any_unit_of_brightness():
    rng = np.random.default_rng(17)
    ahead, bright = scans_that_hang_together(rng, 30, 241)
    smooth = structure_of(ahead, bright)
    assert len(smooth) == COUNT
    assert np.isfinite(smooth).all()
    mixed = structure_of(*(rng.permuted(rng.permuted(a, axis=2), axis=0) for a in (ahead, bright)))
    assert smooth[5] > 0.7  # next beam of the next scan
    assert abs(mixed[5]) < 0.1
    np.testing.assert_allclose(structure_of(ahead, 50.0 * bright), smooth, atol=1e-4)
    dark = structure_of(ahead, np.full_like(bright, np.nan))
    np.testing.assert_array_equal(dark[np.isfinite(dark)], smooth[np.isfinite(dark)])
    assert 0.3 * COUNT < np.isfinite(dark).sum() < 0.7 * COUNT


def test_structure_is_that_of_a_bank_whatever_the_rate_of_a_recording():
    rng = np.random.default_rng(18)
    ranges, bright = (a.astype(np.float32) for a in scans_that_hang_together(rng, 90, 241))
    first, last = (
        Recorded(VIEW, ranges[:n:3], 15.0, bright[:n:3], [0.2 * np.arange(n // 3)]) for n in (90, 45)
    )
    every = Recorded(VIEW, ranges, 15.0, bright, [np.arange(90) / 15.0])
    np.testing.assert_array_equal(every.structure(5.0, [1.0]), first.structure(5.0, [1.0]))
    np.testing.assert_array_equal(every.structure(5.0, [0.49]), last.structure(5.0, [1.0]))
    two = Recorded(VIEW, np.tile(ranges, (2, 1, 1)), 15.0, np.tile(bright, (2, 1, 1)), 2 * every.times)
    np.testing.assert_allclose(two.structure(5.0, [1.0, 1.0]), every.structure(5.0, [1.0]))


@pytest.mark.parametrize("first", [-45.0, -135.0, 0.0, 100.0])
def test_a_table_of_scans_over_any_sector_comes_back(first, tmp_path):
    """Also over the seam at 180 deg, and where scans begin with a beam without an echo."""
    rng = np.random.default_rng(11)
    angle = first + 0.5 * np.arange(541)
    ranges = 2.0 + rng.random((90, 541))
    ranges[rng.random(ranges.shape) < 0.05] = np.nan
    path = tmp_path / "scans.npz"
    np.savez(path, ranges_m=ranges, angle_deg=angle, scan_time_s=0.02 * np.arange(90))
    found = read_looks([open_source(path, Wanted(is_still=True))], load_lidar("sick-lms111"))
    assert found.rate == pytest.approx(50.0)
    lost = np.mean(np.isnan(found.stack[:, 0]) != np.isnan(ranges)) if found.stack.shape[0] == 90 else 1.0
    assert lost < 0.005
    np.testing.assert_allclose(np.nanmedian(found.stack), np.nanmedian(ranges), atol=0.01)


# ---- Banks
def asked(**more):
    return BankAsked(
        "sick-lms511-hr", (0.0, 2.7, 2.4, 0.0, 16.0, 0.0), VIEW.first, VIEW.step, 241, (0.0,), **more
    )


@pytest.fixture
def closed_form(monkeypatch):
    """Runs are not driven: what they look like is a formula of the first unknowns. Counts them."""
    count = []

    def work(run):
        count.append(run.id)
        shares = np.array([[p.share_of(run.point[p.key]) for p in asked().parameters]])
        numbers = looks(shares, np.random.default_rng(run.seed))[0]
        return {
            **no_result(run, ""),
            "verdict": "pass",
            "metrics": dict(zip(NAMES, numbers.tolist(), strict=False)),
        }

    monkeypatch.setattr("swath.tools.function_test.session.run_all", here(work))
    return count


def test_a_bank_is_made_once_and_asked_often(closed_form, tmp_path):
    want = asked(runs=60)
    bank = make_bank(tmp_path / "bank", want, 1, lambda result: None)
    assert len(closed_form) == 60
    again = make_bank(tmp_path / "bank", want, 1, lambda result: None)
    assert len(closed_form) == 60
    seen = np.full(len(NAMES), np.nan)
    shares = np.full((1, len(want.parameters)), 0.3)
    seen[:NUMBERS] = looks(shares, np.random.default_rng(12))[0]
    first, second = (estimates_of(want.parameters, b.ask(seen)) for b in (bank, again))
    assert first == second
    for parameter, estimate in list(zip(want.parameters, first, strict=True))[:TOLD]:
        assert estimate.is_known
        assert estimate.low <= parameter.value_at(0.3) <= estimate.high
    with pytest.raises(InputError, match=r"--bank.*runs"):
        make_bank(tmp_path / "bank", asked(runs=61), 1, lambda result: None)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"runs": 3}, "--runs"),
        ({"params": ("field.stand.stem_per_m2=1..2",)}, "stems_per_m2"),
        ({"scenario": "feed-rate"}, "scanner"),
    ],
)
def test_what_no_bank_can_be_made_of(more, says, tmp_path):
    with pytest.raises(InputError, match=says):
        make_bank(tmp_path, asked(**{"runs": 60, **more}), 1, lambda result: None)


def test_every_value_of_a_bank_makes_a_scenario():
    want = asked()
    for share in (0.0, 1.0):
        values = {p.key: p.value_at(share) for p in [*want.parameters, *want.beside]}
        load_scenario(want.scenario, sets=want.sets_of(values))


# ---- A scanner that stands still
@pytest.mark.draws
@pytest.mark.parametrize("seed", range(4))
def test_noise_and_lost_beams_of_a_still_scanner(seed, tmp_path):
    rng = np.random.default_rng(seed)
    sheet = load_lidar("sick-lms111")
    noise, lost = (float(np.exp(rng.uniform(*np.log(ends)))) for ends in ((0.5, 3.0), (0.1, 10.0)))
    scene = rng.uniform(1.0, 8.0, 541)
    for name in ("one", "two"):
        ranges = scene + noise * sheet.noise_sigma(scene) * rng.standard_normal((90, 541))
        ranges[rng.random(ranges.shape) < 0.01 * lost] = np.nan
        angle, time = -135.0 + 0.5 * np.arange(541), 0.02 * np.arange(90)
        np.savez(tmp_path / f"{name}.npz", ranges_m=np.round(ranges, 3), angle_deg=angle, scan_time_s=time)
    words = ["--still", "--out"]
    one, two = (str(tmp_path / f"{name}.npz") for name in ("one", "two"))
    assert main(["twin", "fit", one, "--sheet", "sick-lms111", *words, str(tmp_path / "twin")]) == 0
    told = {e["key"]: e for e in json.loads((tmp_path / "twin" / "twin-still.json").read_text())["estimates"]}
    for key, truth, ends in (("noise_factor", noise, FACTOR), ("drop_out_percent", lost, LOST)):
        said = told[f"combine.lidar.{key}"]
        assert ends[0] <= said["low"] / 1.1 <= truth <= 1.1 * said["high"] <= ends[1]
    assert not told["combine.lidar.spot_factor"]["is_known"]
    load_scenario(tmp_path / "twin" / SCENARIO)
    assert main(["twin", "check", str(tmp_path / "twin"), two, *words, str(tmp_path / "check")]) == 0
    row = next(csv.DictReader((tmp_path / "check" / EVIDENCE).read_text().splitlines()))
    assert (row["compared"], row["says"]) == ("twin", "fits")


def test_a_recorded_lms111_is_as_its_sheet_says(tmp_path):
    """Halves of a static recording (SICKAG/sick_scan_xd), from which the sheet has its noise below 2 m."""
    path = DATA / "sick_lms111_static" / "lms111_static.npz"
    if not path.is_file():
        pytest.skip("needs the recordings beside the repository (SWATH_DATA)")
    data = np.load(path)
    for name, part in (("one", slice(0, 88)), ("two", slice(88, None))):
        half = {"ranges_m": data["ranges_m"][part], "scan_time_s": data["t"][part]}
        np.savez(tmp_path / f"{name}.npz", **half, angle_deg=data["angles_deg"])
    source = open_source(tmp_path / "one.npz", Wanted(is_still=True))
    found, answer = fit_still(tmp_path / "twin", [source], "sick-lms111", 1)
    noise, lost, _ = found
    assert not answer.is_stray
    assert 0.95 < noise.low < noise.high < 1.2
    assert lost.high < 0.1
    two, out = str(tmp_path / "two.npz"), str(tmp_path / "check")
    assert main(["twin", "check", str(tmp_path / "twin"), two, "--still", "--out", out]) == 0


# ---- Evidence
def test_a_form_takes_the_folder_of_a_check(tmp_path, monkeypatch):
    """No run is driven for it: what the check said is the evidence of the pass."""
    (tmp_path / "checked").mkdir()
    row = {"compared": "twin", "number": "heights, Wasserstein-1", "value": "0.02", "says": "differs"}
    (tmp_path / "checked" / CHECK).write_text(json.dumps({"rows": [row]}), encoding="utf-8")
    form = tmp_path / "passes.csv"
    form.write_text("pass,stems,scans,log,date,note\n3,320,checked,,2026-08-01,\n", encoding="utf-8")
    varied = SimpleNamespace(range=(200.0, 600.0))
    case = SimpleNamespace(file=SimpleNamespace(vary={"stems": varied}))
    planned = SimpleNamespace(case=case, folder=tmp_path)
    monkeypatch.setattr("swath.tools.function_test.field_plan.form.scenario_at", lambda planned, point: None)
    (found,) = compared(planned, form)
    assert found.point == {"stems": 320.0}
    assert [{**row, "pass": "3", "conditions": "stems 320.0", "date": "2026-08-01"}] == list(found.rows)


# ---- Whole
@pytest.mark.draws
def test_a_twin_of_a_run_is_checked_with_another(tmp_path, monkeypatch):
    """A small bank of the simulator itself: height, stems and roll of a run lie in their intervals, and the
    next run along that crop fits; one of crop that is half as high and twice as dense does not.
    """
    monkeypatch.chdir(tmp_path)
    usual = ["--set", "run.distance_m=8", "--set", "combine.edge.level=truth", "--no-report", "--no-replay"]
    for name, seed, height, stems in (("one", 5, 1.0, 300), ("two", 6, 1.0, 300), ("low", 7, 0.55, 600)):
        stand = {"height_factor": height, "stems_per_m2": stems}
        sets = [f"seed={seed}", *(f"field.stand.{key}={value}" for key, value in stand.items())]
        more = [word for text in sets for word in ("--set", text)]
        assert main(["run", "straight", *usual, *more, "--out", name]) in (0, 1, 3)
    words = ["--sheet", "sick-lms511-hr", "--bank", "bank", "--runs", "80", "--workers", "1", "--out", "twin"]
    assert main(["twin", "fit", "one", *words]) == 0
    told = {e["key"]: e for e in json.loads((tmp_path / "twin" / "twin.json").read_text())["estimates"]}
    truth = {
        "field.stand.stems_per_m2": 300.0,
        "field.stand.height_factor": 1.0,
        "combine.lidar.mount.roll_deg": 0.0,
    }
    for key, value in truth.items():
        assert told[key]["low"] <= value <= told[key]["high"]
    assert main(["twin", "check", "twin", "two", "--out", "fits"]) == 0
    assert main(["twin", "check", "twin", "low", "--out", "differs"]) == 1
    assert (tmp_path / "differs" / "report.html").is_file()


@pytest.mark.parametrize(
    "change", [["--param", "nix=1..2"], ["--param", "combine.lidar.mount.z_m=3..2"], ["--set", "nix.x=2"]]
)
def test_a_bank_that_is_refused_leaves_no_folder(change, tmp_path, capsys):
    """So that the right words can be given next."""
    sets = {
        "run.max_duration_s": 3.0,
        "combine.motion.start_speed_kmh": 7,
        "combine.lidar.step_deg": 1.0,
        "combine.edge.level": "truth",
    }
    run_job(load_scenario("straight", sets=[f"{k}={v}" for k, v in sets.items()]), tmp_path / "run")
    line = [
        "twin",
        "fit",
        str(tmp_path / "run"),
        "--sheet",
        "sick-lms511-hr",
        "--bank",
        str(tmp_path / "bank"),
    ]
    assert main([*line, *change, "--out", str(tmp_path / "twin")]) == 2
    assert "nix" in (said := capsys.readouterr().err) or "z_m=3..2" in said
    assert not (tmp_path / "bank").exists()


def test_what_is_no_twin_is_named_as_it_was_given(tmp_path, capsys):
    (tmp_path / "empty").touch()
    for name in ("nowhere", "empty"):
        line = [
            "twin",
            "check",
            str(tmp_path / name),
            str(tmp_path),
            "--still",
            "--out",
            str(tmp_path / "out"),
        ]
        assert main(line) == 2
        assert name in capsys.readouterr().err
