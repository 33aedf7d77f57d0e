"""Folders that an earlier command of swath left, and what lies beside them, for the fuzz.

Their runs are not driven: a formula makes their results.
"""

import shutil
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from tests.fuzz.command_kinds import _run_folder, command
from tests.fuzz.kind import Kind, written

CASE = """format: swath test case 1
objective: keeps its line
source: made
scenario: straight
set: {run.distance_m: 12, combine.lidar.level: empirical, combine.edge: {level: truth}}
vary:
  end_m: {key: field.stand.stems_per_m2, at: [300, 400], range: [100, 600]}
  speed: {key: combine.speed.speed_kmh, at: [4], range: [3, 6]}
seeds: 2
expect: {lateral_rms_m: {max: 0.5}}
"""


@contextmanager
def not_driven() -> Iterator[None]:
    """Runs are a formula of their point."""
    from swath.tools.function_test.journal import Journal
    from swath.tools.function_test.one_run import no_result

    def run_all(runs: Any, folder: Path, workers: int, done: Callable[[Any], None]) -> None:
        journal = Journal(folder, "here")
        for run in runs:
            value = 1e-3 * float(run.point.get("end_m", 300)) + 1e-3 * (run.seed % 7)
            entry = {"subject": "combine", "name": "lateral_rms_m", "limit": {"max": 0.5}, "value": value,
                     "result": "fail" if value > 0.5 else "pass", "reason": "made"}  # fmt: skip
            made = {"verdict": entry["result"], "expect": [entry], "metrics": {"lateral_rms_m": value}}
            done(journal.add({**no_result(run, ""), **made, "digest": run.id}))
        journal.close()

    with patch("swath.tools.function_test.session.run_all", run_all):
        yield


def _unsaid(_result: Any) -> None:
    pass


def _case(folder: Path) -> Path:
    """The case of a folder, beside it: what is damaged inside does not change it."""
    (file := folder.parent / "case.yaml").write_text(CASE)
    return file


def _tested(*names: str) -> Callable[[Path], None]:
    """Function tests, finished."""

    def make(folder: Path) -> None:
        from swath.tools.function_test.plan import Plan
        from swath.tools.function_test.session import begin

        for name in names:
            session = begin(folder / name, Plan(str(_case(folder))))
            with not_driven():
                session.do(1, _unsaid)
            session.table()

    return make


def _campaign(folder: Path) -> None:
    from tests.tools.odd_files import conducted, small_odd

    with ExitStack() as kept:

        def replaced(target: str, value: Any) -> None:
            kept.enter_context(patch(target, value))

        odd = small_odd(folder)
        conducted(
            SimpleNamespace(setattr=replaced), folder / "out", odd, 20, 1, lambda run, share: share < 0.1
        )


def _searched(folder: Path) -> None:
    from swath.tools.function_test.search.search import Search, run_search

    with not_driven():
        run_search(folder / "out", Search(str(_case(folder)), "lateral_rms_m"), 24, 1, _unsaid)


def _estimated(folder: Path) -> None:
    from swath.tools.function_test.estimate.estimate import Estimate, run_estimate

    with not_driven():
        run_estimate(folder / "out", Estimate(str(_case(folder)), "lateral_rms_m", 60), 1, _unsaid)


def _tune(folder: Path) -> Any:
    """A tuning, or the rest of one; what its journals lack is made again."""
    from swath.tools.tune.tune import Tune, run_tune

    how = {"aims": ("lateral_rms_m",), "tries": 10, "each": 2, "proof": 10}
    with not_driven():
        asked = Tune((str(_case(folder)),), ("combine.steer.lookahead_m=2..8",), **how)
        return run_tune(folder / "out", asked, 1, _unsaid).verdict


def _journal(folder: Path) -> Any:
    """A worker goes on with its journal."""
    from swath.tools.function_test.journal import Journal

    Journal(next(folder.glob("*/journal")), "here").close()


def _planned(folder: Path) -> None:
    from swath.tools.function_test.evidence import EVIDENCE
    from swath.tools.function_test.field_plan.form import write_form

    write_form(_field_plan(folder))
    (folder / "out" / EVIDENCE).write_text(
        "pass,conditions,compared,number,value\n1,speed 5,scans,heights,0.012\n"
    )


def _field_plan(folder: Path) -> Any:
    from swath.tools.function_test.field_plan.plan import FieldPlan, plan_field

    with not_driven():
        asked = FieldPlan(str(_case(folder)), metric="lateral_rms_m", pairs=10, runs=2)
        return plan_field(folder / "out", asked, 1, _unsaid)


def _filled(folder: Path) -> Any:
    from swath.tools.function_test.evidence import evidence_table
    from swath.tools.function_test.field_plan.form import FORM, compared

    evidence_table(folder / "out")
    with patch("swath.runtime.job.run_job"):  # of a pass that damage says was driven
        return compared(_field_plan(folder), folder / "out" / FORM)


# ---- runs with saves, pictures, plans of jobs, fields of AgOpenGPS, recordings for ROS 2


def _saved(folder: Path) -> None:
    from swath.runtime.job import run_job
    from swath.runtime.saves import Saves
    from swath.scenario.scenario import parse_scenario
    from tests.whole.test_strangers import PLAIN

    if not (folder.parent / "a-saved-run").is_dir():
        run_job(parse_scenario(PLAIN), folder.parent / "a-saved-run", hooks=[Saves(0.1)])
    shutil.copytree(folder.parent / "a-saved-run", folder / "run")


def _crop(folder: Path) -> None:
    from swath.documents.data_sheets import find_sheet
    from tests.fuzz.measured_kinds import SCENARIO

    shutil.copy(find_sheet("crops", "wheat"), folder / "crop.yaml")
    text = SCENARIO.replace("WEATHER", "").replace("MORE", "").replace("crop: wheat", "crop: crop.yaml")
    (folder / "mine.yaml").write_text(text)


def _read_scenario(folder: Path) -> Any:
    from swath.scenario.scenario import load_scenario

    return load_scenario(folder / "mine.yaml").resolved()


CAMERA = "combine.camera={level: rays, reach_m: 14, mount: {at: axle, x_m: 2, z_m: 3, pitch_deg: 20}}"
PICTURES = ("--count", "1", "--width-px", "64", "--height-px", "48", "--per-scene", "1", "--set", CAMERA)


def _pictures(folder: Path) -> None:
    from swath.tools.dataset.dataset import make_dataset, make_scene, missing, settings_of

    how = {"count": 1, "per_scene": 1, "width": 64, "height": 48, "sets": (CAMERA,)}
    settings = settings_of("straight", **how)
    for name in ("images", "masks", "parts"):
        (folder / "out" / name).mkdir(parents=True)
    for job in missing(settings, folder / "out"):
        make_scene(settings, folder / "out", job)
    make_dataset(settings, folder / "out", workers=1)


SCANS = (
    *("--scans", "--count", "1", "--set", "run.distance_m=1", "--set", "run.max_duration_s=1"),
    *("--set", "combine.lidar={level: empirical, step_deg: 5}"),
)


def _drives(folder: Path) -> None:
    from swath.tools.dataset.scans import file_of, settings_of, write_drive

    (folder / "out").mkdir()
    settings = settings_of("straight", count=1, sets=tuple(SCANS[4::2]))
    write_drive(settings, folder / "out", 0)
    assert file_of(folder / "out", 0).is_file()


def _drawn_jobs(folder: Path) -> Any:
    """How a job's hours spread, kept and gone on with."""
    from swath.fleet.files import read_job
    from swath.fleet.spread import spread_of

    ended = patch("swath.fleet.spread.by_events", lambda found: SimpleNamespace(ends=3600.0))
    with ended, patch("swath.fleet.spread.schedule_of", lambda job, base: None):
        return spread_of(read_job("small-field")[0], None, 10.0, folder / "out")


def _agopengps(folder: Path) -> None:
    from tests.field.test_agopengps import as_agopengps_writes

    as_agopengps_writes(folder / "Back Forty")


def _read_agopengps(folder: Path) -> Any:
    from swath.field_io.agopengps import read_agopengps

    return read_agopengps(folder / "Back Forty").part("field")


def _seen(folder: Path) -> Any:
    """People that sensors see: all conditions, or the rest of them."""
    from swath.tools.reda.reda import Cell, Found, run_reda
    from swath.tools.reda.scene import Settings

    cell = Cell(-3.0, 0.0, 1.0, 0.0, 1, "")
    made = lambda settings, condition: Found(condition, {"lidar": [cell]}, {("lidar", 1.8): cell})  # noqa: E731
    one = {"heights": (0.6,), "densities": (300.0,), "weathers": ("clear",), "sensors": ("lidar",)}
    settings = Settings(**one, repeats=1, looks=1)
    with patch("swath.tools.reda.reda.measure", made):
        return run_reda(settings, processes=1, kept=folder / "kept.jsonl")


def _doubtful(folder: Path) -> None:
    """An FMU whose description is read after repairs alone."""
    from tests.link.made_fmus import process_xml

    text = process_xml().replace('causality="input"', 'causality="input" variability="constant"', 1)
    with zipfile.ZipFile(folder / "model.fmu", "w") as made:
        made.writestr("modelDescription.xml", text)


def _read_fmu(folder: Path) -> Any:
    from swath.link.fmi.description import read_fmu

    return read_fmu(folder / "model.fmu")


class _Unheard:
    """A publisher without ROS 2."""

    count, replaced = 0, frozenset[str]()

    def declare(self, *_about: Any) -> None:
        """A topic."""

    def __call__(self, *_message: Any) -> None:
        self.count += 1


def _sent(folder: Path) -> Any:
    """A recording as messages of ROS 2, with nobody there."""
    from swath.link.ros2 import player

    with ExitStack() as kept:
        for name in ("open_node", "close_node", "_wait"):
            kept.enter_context(patch.object(player, name))
        kept.enter_context(patch.object(player, "Publisher", lambda node, store: _Unheard()))
        kept.enter_context(patch.object(player, "Clock", lambda node: SimpleNamespace(due=1 << 64)))
        return player.play(next(folder.rglob("*.mcap")), wait_s=0.0)


def _told(folder: Path) -> Any:
    """What a page says of a run that is made again."""
    from swath.tools.function_test.command import _told_of
    from swath.tools.function_test.session import open_session

    run = next(open_session(folder / "out", same_code=False).runs())
    return _told_of(folder / "out", run, "")


def _scanned(folder: Path) -> Any:
    """What the scan in a folder is of."""
    from swath.runtime.folder import scan_in

    return scan_in(folder)


def _results(folder: Path) -> None:
    (folder / "results.json").write_text('{"name": "small-field", "set": ""}')


def _read_results(folder: Path) -> Any:
    from swath.fleet.report import check_target

    return check_target(folder, "small-field")


def _shown(folder: Path) -> Any:
    """A run in a notebook, and a detector over its scans."""
    import swath
    from swath.judge.summary import read_summary
    from swath.report.notebook import run_html

    with patch("swath.report.plots.as_image", return_value=""):
        html = run_html("run", read_summary(folder / "run" / "summary.json"), folder / "run")
    return html, swath.detect(folder / "run")


def _twins(folder: Path) -> None:
    """A twin of a bank, one of a scanner that stood still, and a check."""
    import json

    import numpy as np

    from swath.tools.function_test.session import claim_folder
    from swath.tools.height_map.build import open_source
    from swath.tools.height_map.source import Wanted
    from swath.tools.twin.bank import ASKED, BANK
    from swath.tools.twin.fit import write_twin
    from swath.tools.twin.looks import NAMES, Recorded
    from swath.tools.twin.still import fit_still
    from swath.tools.twin.structure import NAMES as STRUCTURE

    rng = np.random.default_rng(1)
    asked = _bank_asked()
    claim_folder((bank := folder / "bank") / ASKED, asked, "a bank")
    unknowns = len(asked.parameters)
    shares, numbers = rng.random((40, unknowns)), rng.random((40, len(NAMES)))
    tuned = np.tile([15.0, 1.0, 0.1], (unknowns, 1))
    structure = rng.random((40, len(STRUCTURE)))
    np.savez_compressed(bank / BANK, shares=shares, numbers=numbers, structure=structure, tuned=tuned)
    ranges, bright = rng.uniform(3.0, 9.0, (2, 20, 1, asked.beams)).astype(np.float32)
    seen = Recorded(asked.view, ranges, 25.0, bright, [0.04 * np.arange(20)])
    write_twin(folder / "twin", _asked_bank(folder), seen, [SimpleNamespace(name="a.mcap")], [12.0])
    ranges, angle = rng.uniform(2.0, 2.01, (40, 61)), np.arange(61) - 30.0
    np.savez(folder.parent / "still.npz", ranges_m=ranges, angle_deg=angle, scan_time_s=0.02 * np.arange(40))
    source = open_source(folder.parent / "still.npz", Wanted(is_still=True))
    fit_still(folder / "still", [source], "sick-lms111", 1)
    (folder / "check.json").write_text(json.dumps({"rows": [{"compared": "twin", "value": "0.02"}]}))


def _bank_asked() -> Any:
    from swath.tools.twin.bank import BankAsked

    return BankAsked("sick-lms511-hr", (0.0, 2.7, 2.4, 0.0, 16.0, 0.0), -1.0, 0.05, 41, (0.0,), runs=40)


def _asked_bank(folder: Path) -> Any:
    from swath.tools.twin.bank import make_bank

    return make_bank(folder / "bank", _bank_asked(), 1, _unsaid)


def _read_twins(folder: Path) -> Any:
    from swath.tools.function_test.evidence import checked_rows
    from swath.tools.height_map.build import open_source
    from swath.tools.height_map.source import Wanted
    from swath.tools.twin.fit import read_twin
    from swath.tools.twin.still import check_still

    bank, twin = _asked_bank(folder), read_twin(folder / "twin")
    found = twin.answer.apart(bank.ask(bank.numbers[0])), twin.sets(twin.values, 9.0)
    source = open_source(folder.parent / "still.npz", Wanted(is_still=True))
    return found, check_still(folder / "still", source, 20, 1).verdict, checked_rows(folder)


def kept_kinds(known: dict[str, Kind]) -> dict[str, Kind]:
    """Kinds of what swath kept. known: kinds whose files they need."""
    report = ("test", "report", "out")
    return {
        "test-results": command(_tested("out"), *report),
        "test-compared": command(_tested("old", "new"), "test", "compare", "old", "new"),
        "test-campaign": command(_campaign, *report, "--cod"),
        "test-told": Kind(_campaign, _told),
        "test-search": command(_searched, *report),
        "test-estimate": command(_estimated, *report),
        "test-journal": Kind(_tested("out"), _journal),
        "odd": command(lambda folder: write_odd(folder), "odd", "check", "small.odd.yaml"),
        "tuning": Kind(_tune, _tune),
        "twins": Kind(_twins, _read_twins),
        "field-plan": Kind(_planned, _filled),
        "saves": command(_saved, "branch", "run", "--at", "0.4", "--out", "out", "--quiet"),
        "run-log": command(_run_folder("run"), "run-log", "run", "--out", "x.mf4"),
        "run-shown": Kind(_run_folder("run"), _shown),
        "exported": command(_crop, "fmu", "export", "mine.yaml", "--slot", "combine.steer", "--out", "x.fmu"),
        "run-again": command(_saved, "run", "run/scenario.yaml", "--out", "run", "--quiet"),
        "own-crop": Kind(_crop, _read_scenario),
        "pictures": command(_pictures, "dataset", "straight", *PICTURES, "--out", "out"),
        "drives": command(_drives, "dataset", "straight", *SCANS, "--out", "out"),
        "scan-kept": Kind(written("scan.of.txt", "straight, seed 1, at 0 s"), _scanned),
        "job-results": Kind(_results, _read_results),
        "drawn-jobs": Kind(_drawn_jobs, _drawn_jobs),
        "agopengps": Kind(_agopengps, _read_agopengps),
        "seen-people": Kind(_seen, _seen),
        "fmu-doubtful": Kind(_doubtful, _read_fmu),
        "mcap-sent": Kind(known["bag-mcap"].make, _sent),
    }


def write_odd(folder: Path) -> Any:
    """A small domain and its binding."""
    from tests.tools.odd_files import write_odd

    return write_odd(folder)
