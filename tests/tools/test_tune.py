"""`swath tune` on closed forms in the place of runs: what is tried, what is proven, and how it is resumed."""

import json
from contextlib import suppress
from functools import partial
from math import isclose
from zlib import crc32

import numpy as np
import pytest

import swath
from swath.commands.main import main
from swath.core.errors import InputError
from swath.tools.function_test.candidates import read_candidates
from swath.tools.function_test.compare import compare
from swath.tools.function_test.journal import read_journals
from swath.tools.function_test.one_run import no_result
from swath.tools.tune.optimiser import Measured, Tried, front, optimise, winner
from swath.tools.tune.page import write_tuned
from swath.tools.tune.parameters import Parameter, read_parameter
from swath.tools.tune.tune import (
    BETTER,
    CODES,
    FRESH,
    NO_BETTER,
    TUNED_ONLY,
    UNSEEN,
    Tune,
    draws_of,
    run_tune,
    runs_of,
)
from tests.tools.fake_work import here

CASE = """
format: swath test case 1
objective: keeps a limit
source: made
scenario: straight
set: {run.distance_m: 12, combine.edge: {level: truth}, combine.lidar: "off"}
vary:
  speed_kmh: {key: combine.speed.speed_kmh, at: [4, 5, 6, 7, 8, 9]}
seeds: 3
expect: {lateral_rms_m: {max: 0.5}}
"""
PARAMS = ("combine.steer.lookahead_m=2..8", "combine.steer.lag_s=0..1")


@pytest.fixture(scope="module")
def case_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("case") / "made.yaml"
    path.write_text(CASE, encoding="utf-8")
    return str(path)


@pytest.fixture
def drives(monkeypatch):
    """Runs are not driven: `drives(value, noise, after)` makes each a formula of its settings and point; an
    interrupt comes after so many runs.
    """
    return partial(driven_by, monkeypatch)


def driven_by(patch, value, noise=0.03, after=10**9, draw=0):
    """The count of the runs that are done, so far."""
    count = [0]

    def work(run):
        if count[0] == after:
            raise KeyboardInterrupt
        count[0] += 1
        return made(run, value, noise, draw)

    patch.setattr("swath.tools.function_test.session.run_all", here(work))
    return count


def made(run, value, noise, draw):
    """The result of a run: its noise comes from `draw`, its settings, point and seed."""
    sets = {k: json.loads(v) for k, _, v in (text.partition("=") for text in run.sets) if "steer" in k}
    name = json.dumps([sets, dict(run.point), run.seed], sort_keys=True)  # run.id changes with code and paths
    drawn = np.random.default_rng((draw, crc32(name.encode()))).standard_normal()
    found = value(sets.get("combine.steer.lookahead_m", 4.0), sets.get("combine.steer.lag_s", 0.2), run.point)
    rms, use = (*found, 0.9)[:2] if isinstance(found, tuple) else (found, 0.9)
    rms += noise * drawn
    entry = {"subject": "combine", "name": "lateral_rms_m", "limit": {"max": 0.5}, "value": rms,
             "result": "fail" if rms > 0.5 else "pass", "reason": "too far"}  # fmt: skip
    return {**no_result(run, ""), "verdict": entry["result"], "expect": [entry], "digest": run.id,
            "metrics": {"lateral_rms_m": rms, "header_use": use}}  # fmt: skip


def bowl(lookahead, lag, point):
    return 0.1 + 0.01 * (lookahead - 6.0) ** 2 + 0.3 * (lag - 0.6) ** 2


def tuned(folder, case, **more):
    tune = Tune((case,), PARAMS, **{"aims": ("lateral_rms_m",), "tries": 24, "each": 3, "proof": 16, **more})
    return run_tune(folder, tune, 1, lambda result: None)


@pytest.fixture(scope="module")
def planted(case_file, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        driven_by(patch, bowl, noise=0.01)
        return tuned(tmp_path_factory.mktemp("tuned") / "whole", case_file)


def test_a_planted_optimum_is_found_proven_and_handed_on(planted):
    found = planted
    assert found.verdict == BETTER
    assert found.winner["combine.steer.lookahead_m"] == pytest.approx(6.0, abs=0.6)
    assert found.winner["combine.steer.lag_s"] == pytest.approx(0.6, abs=0.1)
    sides = read_candidates(found.folder / "candidates.yaml")
    assert list(sides) == ["shipped", "tuned"]
    told = compare(f"{found.folder / UNSEEN}:shipped", f"{found.folder / UNSEEN}:tuned", ["lateral_rms_m"])
    assert told.says("lateral_rms_m") == "better"
    page = write_tuned(found).read_text(encoding="utf-8")
    for text in ("better", "What matters", "--set combine.steer.lookahead_m=", "swath tune"):
        assert text in page
    assert f"lookahead_m: {found.winner['combine.steer.lookahead_m']:g}" in (
        found.folder / "winner.yaml"
    ).read_text(encoding="utf-8")


@pytest.mark.draws
def test_the_interval_on_unseen_draws_holds_the_true_gain(case_file, drives, tmp_path):
    held = 0
    for draw in range(1, 6):
        drives(bowl, noise=0.01, draw=draw)
        found = tuned(tmp_path / str(draw), case_file)
        difference = found.proofs[UNSEEN].found.differences["lateral_rms_m"]
        assert difference.high < 0.0
        held += difference.low <= bowl(*found.winner.values(), {}) - bowl(4.0, 0.2, {}) <= difference.high
    assert held >= 4  # of 5 intervals at 95 %: fewer in one of 44 tries


def test_a_tuning_that_is_stopped_goes_on_to_the_same_bytes(case_file, drives, planted, tmp_path):
    total = 0
    for after in (40, 30, 10**9):
        count = drives(bowl, noise=0.01, after=after)
        with suppress(KeyboardInterrupt):
            found = tuned(tmp_path / "stopped", case_file)
        total += count[0]
    assert found.winner == planted.winner
    assert total <= runs_of(planted.tune)
    for part in ("tuned", FRESH, UNSEEN):
        name = f"{part}/results.parquet"
        assert (tmp_path / "stopped" / name).read_bytes() == (planted.folder / name).read_bytes()
    ids = [result["id"] for result in read_journals(tmp_path / "stopped" / "tuned" / "journal")]
    assert len(ids) == len(set(ids))
    with pytest.raises(InputError, match="another tuning"):
        tuned(tmp_path / "stopped", case_file, tries=31)


def test_pure_noise_is_no_better(case_file, drives, tmp_path):
    drives(lambda lookahead, lag, point: 0.2)
    assert tuned(tmp_path / "a", case_file).verdict == NO_BETTER


def test_what_helps_where_it_was_tuned_alone_is_said_so(case_file, drives, tmp_path):
    tune = Tune((case_file,), PARAMS, each=3)
    (draws,) = draws_of(tune)["tuned"].values()
    seen = [point["speed_kmh"] for _, point in draws]
    drives(lambda a, b, point: bowl(a, b, point) if point["speed_kmh"] in seen else 0.2, noise=0.01)
    found = tuned(tmp_path / "a", case_file)
    assert (found.verdict, found.exit_code) == (TUNED_ONLY, CODES[TUNED_ONLY])


def test_a_broken_limit_is_not_bought_by_a_better_mean(case_file, drives, tmp_path):
    """The use of the header grows with lookahead_m, and beyond 5 m the lateral limit breaks."""
    drives(lambda a, b, point: (0.3 + 0.2 * (a - 4.0), 0.1 * a), noise=0.0)
    found = tuned(tmp_path / "a", case_file, aims=("header_use",))
    assert 4.5 < found.winner["combine.steer.lookahead_m"] <= 5.0
    assert found.proofs[UNSEEN].failed == (0, 0)


def test_two_aims_give_a_front_and_its_settings(case_file, drives, tmp_path):
    drives(lambda a, b, point: (0.1 + 0.01 * a + 0.1 * b, 0.1 * a - 0.2 * b), noise=0.0)
    found = tuned(tmp_path / "a", case_file, aims=("lateral_rms_m", "header_use"))
    of = [found.tried[n].measured.values for n in found.front]
    assert len(of) > 3
    assert not any(a[0] <= b[0] and a[1] <= b[1] and a != b for a in of for b in of)
    assert found.best in found.front
    assert len(read_candidates(found.folder / "candidates.yaml")) == 1 + len(of)
    assert "Front" in write_tuned(found).read_text(encoding="utf-8")


def test_draws_share_neither_seeds_nor_conditions(case_file):
    draws = draws_of(Tune((case_file, "bend"), PARAMS, each=8, proof=20))
    for case in ("made", "bend"):
        tuned_, fresh, unseen = (part[case] for part in draws.values())
        seeds = [{seed for seed, _ in part} for part in (tuned_, fresh, unseen)]
        assert len(set.union(*seeds)) == sum(map(len, seeds))
        assert not [point for _, point in unseen if point in [p for _, p in tuned_]]
        assert all(point in [p for _, p in tuned_] for _, point in fresh)
    held = draws_of(Tune((case_file,), PARAMS, proven=("bend",)))
    assert list(held["tuned"]) == ["made"]
    assert list(held["unseen"]) == ["bend"]


def test_choices_and_whole_numbers_are_tried_as_they_are():
    parameters = [read_parameter("a=x,y,z"), read_parameter("b=1..9:whole"), read_parameter("c=0.01..10:log")]

    def measure(shares):
        for at in shares:
            a, b, c = (p.value_at(s) for p, s in zip(parameters, at, strict=True))
            cost = {"x": 1.0, "y": 0.0, "z": 2.0}[a] + 0.1 * (b - 4) ** 2 + (np.log10(c) + 1.0) ** 2
            yield Measured((cost,), 1.0)

    tried = optimise(parameters, 1, 40, 3, lambda shares: list(measure(shares)))
    a, b, c = (p.value_at(s) for p, s in zip(parameters, tried[winner(tried)].shares, strict=True))
    assert (a, b) == ("y", 4)
    assert 0.05 < c < 0.2


def test_the_front_is_what_nobody_beats():
    rng = np.random.default_rng(5)
    tried = [Tried(rng.random(2), Measured(tuple(rng.random(2)), float(s))) for s in rng.uniform(-1, 1, 60)]
    kept = [n for n, t in enumerate(tried) if t.measured.slack >= 0]
    values = np.array([t.measured.values for t in tried])
    assert front(tried) == [n for n in kept if not (values[kept] < values[n]).all(axis=1).any()]


@pytest.mark.parametrize("is_whole", [False, True])
@pytest.mark.parametrize("is_log", [False, True])
def test_a_value_lies_in_its_range_and_keeps_its_share(is_whole, is_log):
    rng = np.random.default_rng(8)
    for share, low, times in rng.uniform((0.0, 0.01, 1.01), (1.0, 5.0, 99.0), (200, 3)).tolist():
        low, high = (1.0, 1.0 + round(times)) if is_whole else (low, low * times)
        parameter = Parameter("k", low, high, is_whole, is_log)
        value = parameter.value_at(share)
        assert low <= value <= high
        again = parameter.value_at(parameter.share_of(value))
        assert again == value if is_whole else isclose(again, value, rel_tol=1e-5)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("combine.steer.lookahead_m", "expected KEY=2..8"),
        ("k=8..2", "the lower end first"),
        ("k=0..2:log", "above 0"),
        ("k=1.5..3:whole", "whole numbers"),
        ("k=1..3:long", "whole or log"),
        ("k=a..b", "expected KEY=2..8"),
        ("k=otsu", "two choices"),
    ],
)
def test_a_parameter_that_is_none_is_refused(text, expected):
    with pytest.raises(InputError, match=expected):
        read_parameter(text)


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        (["--param", "combine.steer.lookahed_m=2..8"], "lookahead_m"),
        (["--param", "combine.speed.speed_kmh=2..8"], "made varies combine.speed.speed_kmh"),
        (["--param", "combine.steer.lookahead_m=2..8", "--aim", "made_up"], "made_up:lower or"),
        (["--param", "combine.steer.lookahead_m=2..8", "--tries", "3"], "expected 10 to 400"),
        (
            ["--param", "combine.steer.lookahead_m=2..8", "--tries", "3", "--proof", "9"],
            "--proof = 9: expected 10",
        ),
    ],
)
def test_what_cannot_be_tuned_is_refused(flags, expected, case_file, drives, tmp_path, capsys):
    drives(bowl)
    assert main(["tune", case_file, *flags, "--out", str(tmp_path / "a")]) == 2
    assert expected in capsys.readouterr().err
    assert not (tmp_path / "a").exists()


def test_the_command_prints_the_winner_and_how_it_is_proven(case_file, drives, planted, capsys):
    """Of a tuning that is done: it drives nothing again."""
    drives(bowl, after=0)
    params = [word for text in PARAMS for word in ("--param", text)]
    more = ["--aim", "lateral_rms_m", "--tries", "24", "--each", "3", "--proof", "16"]
    assert main(["tune", case_file, *params, *more, "--out", str(planted.folder)]) == CODES[BETTER]
    printed = capsys.readouterr().out
    assert f"--set combine.steer.lookahead_m={planted.winner['combine.steer.lookahead_m']:g}" in printed
    assert "verdict better" in printed
    assert json.loads((planted.folder / "tuned.json").read_text())["verdict"] == BETTER


def test_python_tunes_as_the_command_does(planted, case_file, drives, tmp_path):
    drives(bowl, noise=0.01)
    ranges = dict(text.split("=") for text in PARAMS)
    few = {"aims": ["lateral_rms_m"], "each": 3, "proof": 16}
    found = swath.tune(case_file, ranges, tmp_path / "made", tries=24, **few)
    assert (found.winner, found.verdict) == (planted.winner, planted.verdict)
    assert (tmp_path / "made" / "report.html").read_bytes()
    chosen = swath.tune([case_file], {"combine.steer.lag_s": [0.0, 0.5]}, tmp_path / "of", tries=10, **few,
                        sets={"combine.steer.lookahead_m": 6})  # fmt: skip
    assert chosen.winner == {"combine.steer.lag_s": 0.5}
