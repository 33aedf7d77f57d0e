"""Files of a stranger run no code unasked: every kind of file that brings code along.

Each kind of run folder and scenario meets `run` and a third of the commands, each command a third of
the kinds.
"""

import json
import shutil
import zipfile
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

import swath
from swath.commands.main import main, make_parser, subcommands
from swath.core import registry
from swath.core.errors import InputError
from swath.documents.data_sheets import find_sheet
from swath.runtime.job import run_job
from swath.runtime.saves import Saves
from swath.scenario.scenario import parse_scenario

pytestmark = pytest.mark.apart

HEAD = """
format: swath scenario 2
name: foreign
run: {distance_m: 0.6, max_duration_s: 2, record: exact}
field:
  edge: {shape: straight}
"""
MACHINE = """
machines:
  combine:
    lidar: off
    edge: truth
"""
PLAIN = HEAD + "  stand: {level: uniform}\n" + MACHINE
LAW = "{level: can, interface: virtual, channel: a, box: inside, law: mine.py:Part}"
KINDS = {
    "slot": PLAIN + "    speed: {level: mine.py:Part}\n",
    "slot, short": PLAIN + "    speed: mine.py:Part\n",
    "slot of another name": PLAIN + "    gnss_left: mine.py:Part\n",
    "terrain": HEAD + "  terrain: {level: mine.py:Part}\n" + MACHINE,
    "stand": HEAD + "  stand: {level: mine.py:Part}\n" + MACHINE,
    "evaluator": PLAIN + "evaluators: [mine.py:Part]\nexpect: {mine_m: {max: 1}}\n",
    "cheaper level": PLAIN + "realtime: {degrade: [{slot: combine.edge, level: mine.py:Part}]}\n",
    "FMU": PLAIN + "    process: {level: fmu, file: part.fmu}\n",
    "SSP": PLAIN + "    process: {level: fmu, file: part.ssp}\n",
    "SSD": PLAIN + "    process: {level: fmu, file: part.ssd}\n",
    "CAN law": PLAIN + f"    steer: {LAW}\n",
    "machine's data sheet": PLAIN + "    machine: mine.yaml\n",
    "crop habit": HEAD + "  stand: {level: uniform, crop: crop.yaml}\n" + MACHINE,
    "beside a mistake": PLAIN + "    speed: {level: mine.py:Part}\n    steering: {bogus: 1}\n",
    "recorded change": PLAIN,
}
CODE = """
import pathlib
pathlib.Path({mark!r}).touch()
from swath.control.speed import constant
class Part(constant.ConstantSpeed):
    "As the built-in one."
    Params = constant.Params
"""
CASE = """
format: swath test case 1
objective: none
source: none
scenario: {scenario}
vary:
  speed: {{key: combine.motion.start_speed_kmh, at: [5], range: [4, 6]}}
seeds: 1
expect:
  distance_m: {{min: 0.1}}
"""


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """A run folder of the scenario without code, with saves."""
    out = tmp_path_factory.mktemp("ran") / "run"
    run_job(parse_scenario(PLAIN), out, hooks=[Saves(0.1)])
    return out


class Folder:
    """What a stranger sends: scenario, run folder, case, candidates, sheets, FMUs, job. mark: it ran"""

    def __init__(self, path, kind, ran):
        self.path, self.mark = path, path / "mark"
        (path / "mine.py").write_text(CODE.format(mark=str(self.mark)))
        for name in ("part.fmu", "part.ssp"):
            with zipfile.ZipFile(path / name, "w") as made:
                made.writestr("modelDescription.xml", "<a/>")
        (path / "part.ssd").write_text("<a/>")
        sheet = find_sheet("machines", "lexion-700-class").read_text()
        (path / "mine.yaml").write_text(sheet + "\nslots: {speed: mine.py:Part}\n")
        crop = find_sheet("crops", "wheat").read_text()
        (path / "crop.yaml").write_text(crop.replace("habit: cereal", "habit: mine.py"))
        text = KINDS[kind]
        (path / "s.yaml").write_text(text)
        shutil.copytree(ran, path / "run")
        for name in ("mine.py", "part.fmu", "part.ssp", "part.ssd", "mine.yaml", "crop.yaml"):
            text = text.replace(name, str(path / name))
        (path / "run" / "scenario.yaml").write_text(text)
        if kind == "recorded change":
            told = json.loads((path / "run" / "summary.json").read_text())
            change = {"t_s": 0.1, "set": "combine.speed.level", "value": f"{path}/mine.py:Part"}
            (path / "run" / "summary.json").write_text(json.dumps({**told, "events": [change]}))
        (path / "case.yaml").write_text(CASE.format(scenario="s.yaml"))
        (path / "plain.yaml").write_text(PLAIN)
        (path / "plain-case.yaml").write_text(CASE.format(scenario="plain.yaml"))
        (path / "with.yaml").write_text("mine: {combine.speed.level: mine.py:Part}\n")
        job = find_sheet("jobs", "small-field").read_text()
        (path / "job.yaml").write_text(job.replace("machine: lexion-700", f"machine: {path}/mine.yaml"))
        (path / "dispatched.yaml").write_text(job + "\nfleet: {dispatcher: mine.py:Part}\n")

    def of_runs(self):
        """Command lines by command that read the run folder."""
        run, new = f"{self.path}/run", iter(f"{self.path}/new-{i}" for i in range(99))
        return {
            "run": [
                [run, "--out", next(new)],
                [f"{self.path}/plain.yaml", "--events", run, "--out", next(new)],
            ],
            "report": [[run]],
            "view": [[run, "--out", next(new)]],
            "branch": [[run, "--at", "0.3", "--out", next(new)]],
            "diff": [[run, run]],
            "rerun": [[run, "--out", next(new)]],
            "run-log": [[run, "--out", f"{next(new)}.asc"]],
            "yield-log": [[run, "--out", f"{next(new)}.csv"]],
            "ros2 play": [[run]],
            "osi": [[run, "--out", f"{next(new)}.osi"]],
            "height-map build": [[run, "--out", f"{next(new)}.npz"]],
            "field show": [[run]],
            "field export": [[run, "--to", "sdf", "--out", next(new)]],
            "field agopengps": [[run, "--out", next(new)]],
        }

    def of_scenarios(self):
        """Those that read the scenario, or a test case with it."""
        p, new = self.path, iter(f"{self.path}/made-{i}" for i in range(99))
        s, case, tests = f"{p}/s.yaml", f"{p}/case.yaml", f"{p}/tests"
        return {
            "run": [[s, "--out", next(new)]],
            "scenarios": [[s]],
            "test list": [[case]],
            "test run": [[case, "--plan-only", "--out", tests], [case, "--out", next(new)]],
            "test search": [[case, "--out", next(new)]],
            "test estimate": [[case, "--out", next(new)]],
            "test levels": [[case]],
            "test plan-field": [[case, "--out", next(new)]],
            "tune": [[case, "--param", "combine.speed.speed_kmh=4..6", "--out", next(new)]],
            "twin fit": [
                [
                    f"{p}/run",
                    "--sheet",
                    "sick-lms511-hr",
                    "--scenario",
                    s,
                    "--bank",
                    next(new),
                    "--out",
                    next(new),
                ]
            ],
            "test work": [[tests, "--shard", "1/1"]],
            "test report": [[tests]],
            "test compare": [[tests, tests]],
            "test again": [[tests, ""]],
            "part": [["process", "--scenario", s, "--out", next(new)]],
            "scan": [[s, "--out", next(new)]],
            "field export": [[s, "--to", "sdf", "--out", next(new)]],
            "dataset": [[s, "--count", "1", "--out", next(new)]],
            "fmu export": [[s, "--slot", "process", "--out", f"{next(new)}.fmu"]],
            "can box": [[s, "--interface", "virtual", "--once"]],
        }

    def of_others(self):
        """Those that read other files, or none."""
        p, new = self.path, iter(f"{self.path}/other-{i}" for i in range(99))
        crop, models = (
            ["--crop", f"{p}/crop.yaml", "--out"],
            [[f"{p}/part.{s}"] for s in ("fmu", "ssp", "ssd")],
        )
        case, others = [f"{p}/plain-case.yaml", "--with", f"{p}/with.yaml"], ["--out", next(new)]
        log = str(find_sheet("jobs", "small-field").parents[1] / "logs" / "sample-log.csv.gz")
        return {
            "scenarios": [[]],
            "docs": [[]],
            "paper": [["--out", f"{p}/plain-case.yaml"]],
            "new": [["scenario", f"{next(new)}.yaml"]],
            "levels": [[], ["edge"]],
            "metrics": [[]],
            "odd check": [["wheat-harvest"]],
            "sheets": [[], ["check", f"{p}/crop.yaml"], ["check", f"{p}/mine.yaml"]],
            "field import": [[log, *crop, next(new)]],
            "fleet run": [
                [f"{p}/job.yaml", "--set", "field.yield_t_ha=x"],
                [f"{p}/s.yaml"],
                [f"{p}/dispatched.yaml"],
            ],
            "fleet list": [[]],
            "lab stand": [[*crop, next(new)]],
            "reda": [[*crop, next(new)]],
            "test run": [[*case, "--plan-only", "--out", next(new)], [*case, *others]],
            "calibrate lidar": [[*crop, next(new)]],
            "calibrate engine": [[f"{p}/mine.yaml", f"{p}/run"]],
            "compare log": [[f"{p}/mine.yaml", f"{p}/run"]],
            "compare scans": [[f"{p}/run", f"{p}/run"]],
            "twin check": [[f"{p}/run", f"{p}/run", "--out", next(new)]],
            "fmu show": models,
            "fmu check": models,
            "ros2 package": [["--out", next(new)]],
            "can listen": [["--interface", "virtual", "--channel", "a", "--duration-s", "0.1"]],
            "can dbc": [[]],
            "schema": [[]],
            "completion": [["bash"]],
        }


def run_all(folder, lines, monkeypatch, capfd):
    """Run command lines; none may run the code, or end in a mistake of swath's."""
    monkeypatch.chdir(folder.path)
    for command, each in lines.items():
        for line in each:
            code = main([*command.split(), *line])
            said = capfd.readouterr().err
            assert not folder.mark.exists(), [command, *line]
            assert code in (0, 1, 2, 3), (command, line, said)


def some(lines, kind):
    """Every third command and `run`, from another one for the next kind; of recorded changes all."""
    step = 1 if kind == "recorded change" else 3
    chosen = {"run", *list(lines)[list(KINDS).index(kind) % step :: step]}
    return {command: each for command, each in lines.items() if command in chosen}


@pytest.mark.draws
@pytest.mark.parametrize("kind", KINDS)
def test_run_folders_run_no_code_in_any_command(kind, ran, tmp_path, monkeypatch, capfd):
    folder = Folder(tmp_path, kind, ran)
    lines = folder.of_runs()
    if kind != "recorded change":
        del lines["run"][1:]  # the changes of a run with another scenario
    run_all(folder, some(lines, kind), monkeypatch, capfd)


@pytest.mark.draws
@pytest.mark.parametrize("kind", [k for k in KINDS if k != "recorded change"])
def test_scenarios_and_cases_run_no_code_in_any_command(kind, ran, tmp_path, monkeypatch, capfd):
    folder = Folder(tmp_path, kind, ran)
    run_all(folder, some(folder.of_scenarios(), kind), monkeypatch, capfd)


def test_other_files_run_no_code_in_any_command(ran, tmp_path, monkeypatch, capfd):
    folder = Folder(tmp_path, "slot", ran)
    run_all(folder, folder.of_others(), monkeypatch, capfd)
    looked_at = {*folder.of_runs(), *folder.of_scenarios(), *folder.of_others()}
    assert looked_at == {leaf.prog.removeprefix("swath ") for leaf in subcommands(make_parser()[0])}


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ("FMU", "SSP", "SSD")])
def test_the_one_switch_lets_it_run(kind, ran, tmp_path, monkeypatch, capfd):
    folder = Folder(tmp_path, kind, ran)
    monkeypatch.chdir(tmp_path)
    source = (
        ["plain.yaml", "--events", "run", "--allow", "mine.py"] if kind == "recorded change" else ["s.yaml"]
    )
    main(["run", *source, "--allow-code", "--quiet", "--no-report", "--no-replay", "--out", "out"])
    assert folder.mark.exists()
    assert "names code" not in capfd.readouterr().err


def test_a_refusal_says_what_to_type(ran, tmp_path, monkeypatch, capsys):
    Folder(tmp_path, "slot", ran)
    monkeypatch.chdir(tmp_path)
    assert main(["run", "s.yaml"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    for part in ("combine.speed.level = mine.py:Part", "--allow-code", "s.yaml:"):
        assert part in said


@pytest.mark.parametrize("line", [
    ["--set", "combine.speed=mine.py:Part"],
    ["--set", "combine.speed={level: mine.py:Part}"],
    ["--set", "evaluators=[mine.py:Part]"],
    ["--allow", "mine.py:Part", "--set", "run.distance_m=0.5"],
])  # fmt: skip
def test_what_the_command_line_names_runs(line, ran, tmp_path, monkeypatch):
    kind = "slot" if "--allow" in line else "recorded change"
    folder = Folder(tmp_path, kind, ran)
    monkeypatch.chdir(tmp_path)
    main(["run", "s.yaml", *line, "--quiet", "--no-report", "--no-replay", "--out", "out"])
    assert folder.mark.exists()


def test_a_sheet_that_the_command_line_names_does_not_bring_code_along(ran, tmp_path, monkeypatch, capsys):
    folder = Folder(tmp_path, "recorded change", ran)
    monkeypatch.chdir(tmp_path)
    for change in ("field.stand.crop=crop.yaml", "combine.machine=mine.yaml"):
        assert main(["run", "s.yaml", "--set", change, "--out", "out"]) == 2
        assert "--allow-code" in capsys.readouterr().err
    assert not folder.mark.exists()


def test_from_python(ran, tmp_path, monkeypatch):
    folder = Folder(tmp_path, "slot", ran)
    monkeypatch.chdir(tmp_path)
    acts = [
        lambda: swath.load_scenario("s.yaml"),
        lambda: swath.run("s.yaml"),
        lambda: swath.scan("s.yaml"),
        lambda: swath.branch("run", 0.3),
        lambda: swath.detect("run"),
        lambda: next(iter(swath.batch(["s.yaml"]))).summary,
        lambda: next(iter(swath.batch(["s.yaml"], workers=2))).summary,
    ]
    for act in acts:
        with pytest.raises(InputError, match=r"code=True"):
            act()
        assert not folder.mark.exists()
    scenario = swath.load_scenario("s.yaml", code=True)
    assert folder.mark.exists()
    assert swath.run(scenario, "a", report=False).folder == Path("a")
    found = swath.run("plain.yaml", "b", sets={"combine.speed.level": "mine.py:Part"}, report=False)
    assert found.folder == Path("b")


def test_an_installed_package_is_loaded_only_where_it_is_named(tmp_path, monkeypatch, capsys):
    mark = tmp_path / "mark"
    (tmp_path / "swath_guest.py").write_text(CODE.format(mark=str(mark)))
    monkeypatch.syspath_prepend(str(tmp_path))
    guests = [
        EntryPoint(f"{k}.guest", "swath_guest:Part", registry.GROUP) for k in ("speed", "lidar", "evaluator")
    ]
    points = *registry._entry_points(), *guests
    monkeypatch.setattr(registry, "_entry_points", lambda: points)
    (tmp_path / "s.yaml").write_text(PLAIN)
    for line in (
        ["levels"],
        ["levels", "speed"],
        ["metrics"],
        ["schema"],
        ["completion", "bash"],
        ["scenarios"],
    ):
        assert main(line) == 0
    assert "guest" in capsys.readouterr().out
    line = ["run", str(tmp_path / "s.yaml"), "--quiet", "--no-report", "--no-replay", "--out"]
    assert main([*line, str(tmp_path / "a")]) == 0
    assert not mark.exists()
    assert main([*line, str(tmp_path / "b"), "--set", "combine.speed=guest"]) == 0
    assert mark.exists()


def test_compiled_code_beside_a_file_does_not_take_its_place(ran, tmp_path, monkeypatch):
    import py_compile

    folder = Folder(tmp_path, "slot", ran)
    evil = tmp_path / "evil.py"
    evil.write_text(CODE.format(mark=str(folder.mark)))
    (tmp_path / "mine.py").write_text(CODE.format(mark=str(tmp_path / "good")))
    place = tmp_path / "__pycache__" / f"mine.{__import__('sys').implementation.cache_tag}.pyc"
    py_compile.compile(str(evil), str(place), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
    monkeypatch.chdir(tmp_path)
    swath.load_scenario("s.yaml", code=True)
    assert (tmp_path / "good").exists()
    assert not folder.mark.exists()
