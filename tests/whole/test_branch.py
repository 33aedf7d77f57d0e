"""Back and branch: what goes on from a save is the run that a fresh start with the same events gives."""

import json
import pickle
import shutil
import zlib
from itertools import pairwise

import pytest

import swath
from swath.commands.main import main
from swath.core.errors import InputError
from swath.runtime.branch import Start, branch_folder, branched_events
from swath.runtime.folder import clear_run_folder
from swath.runtime.job import run_job
from swath.runtime.saves import MOST, SAVES, Saves, saves_in, superfluous
from swath.tools.branch.branch import plan_branch
from tests.whole.small import small

SETS = ("run.distance_m=2.5", "combine.lidar.sub_rays=1")
WINDOW = "expect={lateral_rms_m: {max: 1, from_m: 0.5, to_m: 2}}"
WALKER = "{kind: person, x_m: 9, y_m: 5, path: {to: [[9, -5]]}}"
EARLY = [
    {"t_s": 0.6, "set": "obstacles.walker", "value": WALKER},
    {"t_s": 0.7, "set": "combine.edge.level", "value": "otsu"},
]
AT_S, CHANGE = 1.3, {"combine.speed.speed_kmh": "5", "obstacles.pole": "{kind: post, x_m: 8, y_m: 3}"}
FILES = ("tracks.parquet", "run.mcap", "metadata.yaml", "scenario.yaml")


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A run with saves, changed on the way already."""
    out = tmp_path_factory.mktemp("runs") / "saved"
    run_job(small(*SETS), out, hooks=[Saves(0.5)], events=EARLY)
    return out


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    """What a start from the beginning gives with the same changes."""
    out = tmp_path_factory.mktemp("runs") / "fresh"
    run_job(small(*SETS), out, events=branched_events(EARLY, AT_S, CHANGE))
    return out


def summary_of(folder):
    kept = json.loads((folder / "summary.json").read_text())
    for key in ("wall_s", "real_time_factor", "cost", "branch", "saves"):
        kept.pop(key, None)
    return kept


def assert_same(folder, fresh):
    for name in FILES:
        assert (folder / name).read_bytes() == (fresh / name).read_bytes(), name
    assert summary_of(folder) == summary_of(fresh)


def test_a_branch_is_the_fresh_run_with_that_event(saved, fresh, tmp_path):
    made = swath.branch(saved, AT_S, tmp_path / "branch", sets=CHANGE, report=False)
    assert made.summary["branch"] == {"of": "saved", "at_s": AT_S, "saved_s": 1.0}
    assert [e["t_s"] for e in made.summary["events"]] == [0.6, 0.7, AT_S, AT_S]
    assert_same(tmp_path / "branch", fresh)


def test_a_branch_of_a_branch_uses_the_saves_of_the_first(saved, tmp_path):
    run_job(
        small(*SETS), tmp_path / "one", events=branched_events(EARLY, AT_S, {}), hooks=[Saves(0.5)],
        start=Start(saved, 1_300_000_000),
    )  # fmt: skip
    assert list(saves_in(tmp_path / "one"))[:2] == [500_000_000, 1_000_000_000]
    second = swath.branch(tmp_path / "one", 0.9, tmp_path / "two", sets=CHANGE, report=False)
    assert second.summary["branch"] == {"of": "one", "at_s": 0.9, "saved_s": 0.5}
    run_job(small(*SETS), tmp_path / "fresh", events=branched_events(EARLY, 0.9, CHANGE))
    assert_same(tmp_path / "two", tmp_path / "fresh")


def test_without_saves_or_with_torn_ones_it_begins_at_the_start(saved, fresh, tmp_path, capsys):
    torn = tmp_path / "torn"
    shutil.copytree(saved, torn)
    [_, second, *_] = saves_in(torn).values()
    second.write_bytes(second.read_bytes()[:-40])  # the one before serves
    made = swath.branch(torn, AT_S, tmp_path / "a", sets=CHANGE, report=False)
    assert made.summary["branch"]["saved_s"] == 0.5
    (torn / "run.mcap").write_bytes(
        (torn / "run.mcap").read_bytes()[:2000]
    )  # saves, but no beginning of the recording
    made = swath.branch(torn, AT_S, tmp_path / "b", sets=CHANGE, report=False)
    assert made.summary["branch"]["saved_s"] == 0.0
    shutil.rmtree(torn / SAVES)
    line = ["branch", str(torn), "--at-s", str(AT_S), "--out", str(tmp_path / "c"), "--no-code"]
    assert main([*line, *(f"--set={k}={v}" for k, v in CHANGE.items())]) == 0
    assert "(swath run --save-every-s), so it is computed again from 0 s" in capsys.readouterr().out
    digest = json.loads((fresh / "summary.json").read_text())["digest"]
    for name in "abc":
        assert json.loads((tmp_path / name / "summary.json").read_text())["digest"] == digest
        assert (tmp_path / name / "run.mcap").read_bytes() == (fresh / "run.mcap").read_bytes()


def test_saves_of_another_version_are_not_read_and_told(saved, tmp_path):
    shutil.copytree(saved, tmp_path / "old")
    for save in saves_in(tmp_path / "old").values():
        save.write_bytes(zlib.compress(pickle.dumps({"swath": "0.2.0", "world": {}})))
    plan = plan_branch(tmp_path / "old", AT_S, CHANGE)
    assert (plan.saved_s, plan.has_unreadable) == (0.0, True)
    plan = plan_branch(saved, AT_S, CHANGE)
    assert (plan.saved_s, plan.has_unreadable) == (1.0, False)


@pytest.mark.parametrize(
    ("at", "key", "words"),
    [
        ("9", "combine.speed.speed_kmh=5", "expected a time of the run, above 0 and up to"),
        ("0", "combine.speed.speed_kmh=5", "expected a time of the run"),
        ("1", "combine.speed.speed_kmh=-5", "combine.speed.speed_kmh"),
        ("1", "combine.speed", "expected KEY=VALUE"),
        ("1", "combine.motion.rate_hz=50", "rhythm and wires stay"),
    ],
)
def test_what_cannot_be_is_said_and_leaves_no_folder(saved, tmp_path, capsys, at, key, words):
    assert main(["branch", str(saved), "--at-s", at, "--set", key, "--out", str(tmp_path / "no")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def test_runs_that_do_not_repeat_are_refused(saved, tmp_path):
    paced = tmp_path / "paced"
    shutil.copytree(saved, paced)
    told = json.loads((paced / "summary.json").read_text())
    (paced / "summary.json").write_text(json.dumps({**told, "realtime": {"factor": 1.0}}))
    with pytest.raises(InputError, match="without --real-time"):
        swath.branch(paced, 1.0, tmp_path / "no")
    node = tmp_path / "node"
    shutil.copytree(saved, node)
    plan = small(*SETS, "combine.steer={level: ros2}")
    (node / "scenario.yaml").write_text(plan.resolved())
    with pytest.raises(InputError, match=r"combine\.steer\.level = ros2: .* cannot be saved"):
        swath.branch(node, 1.0, tmp_path / "no")
    assert not (tmp_path / "no").exists()


@pytest.mark.usefixtures("code_allowed")
@pytest.mark.parametrize("is_without", [False, True])
def test_a_part_that_cannot_be_saved_is_named_and_the_run_goes_on(tmp_path, is_without):
    text = PART.replace("def save", "def keep").replace("def load", "def back") if is_without else PART
    (tmp_path / "mine.py").write_text(text)
    plan = small("run.distance_m=1.2", *SETS[1:], f"combine.steer.level={tmp_path / 'mine.py'}:Straight")
    summary = run_job(plan, tmp_path / "run", hooks=[Saves(0.5)]).summary
    assert summary["saves"]["refused"].startswith("combine.steer")
    assert not summary["incomplete"]
    assert not saves_in(tmp_path / "run")


PART = """
from swath.core.component import Port
from swath.signals import SteerCommand

class Straight:
    inputs = ()
    outputs = (Port("command", SteerCommand),)
    def __init__(self, params, setup): self.draw = lambda: 0.0
    def reset(self, rng): return {"command": SteerCommand(0, 0.0, True)}
    def step(self, t, dt, inputs): return {"command": SteerCommand(t + dt, self.draw(), True)}
    def save(self): return {"draw": self.draw}
    def load(self, state): self.draw = state["draw"]
"""


def test_windows_and_their_evaluators_are_saved_too(tmp_path):
    run_job(small(*SETS, WINDOW), tmp_path / "run", hooks=[Saves(0.5)])
    swath.branch(tmp_path / "run", 1.3, tmp_path / "branch", report=False)
    whole, branch = summary_of(tmp_path / "run"), summary_of(tmp_path / "branch")
    [judged] = [e for e in whole["expect"] if "window" in e]
    assert judged["result"] == "pass"
    assert judged["value"] > 0.0
    assert branch == whole


def test_saves_are_bounded_and_gone_with_the_run(saved, tmp_path):
    times = list(range(0, 400, 5))
    kept = []
    for t in times:
        kept.append(t)
        if len(kept) > MOST:
            kept.pop(superfluous(kept))
    gaps = [b - a for a, b in pairwise(kept)]
    assert len(kept) == MOST
    assert (kept[0], kept[-4:]) == (0, times[-4:])
    assert max(gaps) <= 0.25 * times[-1]
    shutil.copytree(saved, tmp_path / "run")
    clear_run_folder(tmp_path / "run")
    assert [f.name for f in (tmp_path / "run").iterdir()] == ["scenario.yaml"]
    with pytest.raises(InputError, match="at least"):
        Saves(0.01)


def test_folders_of_branches_have_numbers(tmp_path):
    first = branch_folder(tmp_path / "demo")
    first.mkdir()
    assert first.name == "demo-branch"
    assert branch_folder(first).name == branch_folder(tmp_path / "demo").name == "demo-branch-2"


def test_the_command_leaves_out_the_replay_where_that_is_wanted(saved, tmp_path, capsys):
    from swath.commands.main import main

    more = ["--at-s", "1.2", "--set", "combine.speed.speed_kmh=5", "--quiet"]
    main(["branch", str(saved), *more, "--no-replay", "--out", str(tmp_path / "branch")])
    assert (tmp_path / "branch" / "report.html").is_file()
    assert not (tmp_path / "branch" / "replay.html").exists()


def test_a_run_that_was_changed_says_how_it_is_repeated(fresh, tmp_path, capsys):
    digest = json.loads((fresh / "summary.json").read_text())["digest"]
    head = (fresh / "scenario.yaml").read_text().splitlines()[0]
    assert head.startswith("# changed on the way: swath run THIS --events THIS repeats it")
    again = [
        "run",
        str(fresh),
        "--no-report",
        "--no-replay",
        "--quiet",
        "--out",
        str(tmp_path / "again"),
        "--replace",
    ]
    for more, is_same in (([], False), (["--events", str(fresh)], True)):
        assert main([*again, *more]) in (0, 1, 3)
        made = json.loads((tmp_path / "again" / "summary.json").read_text())["digest"]
        assert (made == digest) is is_same
        told = f"swath: {fresh} was changed on its way, --events {fresh} repeats that\n"
        assert capsys.readouterr().err == ("" if is_same else told)
