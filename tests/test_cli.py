"""The command line: what it prints, its exit codes, and what it does not load."""

import json
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import pytest

import swath
from swath.commands.main import main
from swath.core.errors import InputError
from swath.runtime.folder import choose_run_folder, choose_scan_folder, clear_run_folder
from tests.fake_levels import FAKE, GOOD

HEAVY = {
    "warp",
    "matplotlib",
    "pyarrow",
    "rasterio",
    "rosbags",
    "scipy",
    "shapely",
    "pydantic",
    "numpy",
    "rich",
    "yaml",
}


class Job:
    """Stands for `swath.runtime.job`; keeps what it was asked for."""

    def __init__(self):
        self.calls = []
        self.exit_code = 0
        self.error = None

    def run_job(self, scenario, out, progress, events=(), hooks=(), begun=None, allow=()):
        self.calls.append((scenario, out, progress))
        if self.error is not None:
            raise self.error
        if begun is not None:
            begun()
        out.mkdir(parents=True, exist_ok=True)
        (out / "report.html").touch()
        (out / "scenario.yaml").write_text(scenario.resolved())
        (out / "summary.json").write_text("{}")
        limit = {"subject": "combine", "name": "lateral_rms_m", "limit": {"max": 0.05}}
        entry = {**limit, "value": 0.1, "result": "fail", "reason": "0.1 is more than 0.05"}
        summary = {
            "lateral_rms_m": 0.1,
            "ray_count": 12345678,
            "digest": "abc",
            "expect": [entry],
        }
        return SimpleNamespace(summary=summary, exit_code=self.exit_code, folder=out)

    def scan_job(self, scenario, out, at_s, formats, camera, tell):
        self.calls.append((scenario, out, at_s))
        self.formats, self.camera = formats, camera
        return [out / "scan.png", out / "scan.csv"]


@pytest.fixture
def job(monkeypatch, tmp_path):
    fake = Job()
    monkeypatch.setitem(sys.modules, "swath.runtime.job", fake)
    monkeypatch.setitem(sys.modules, "swath.tools.scan.scan", fake)
    monkeypatch.setattr("swath.runtime.job", fake, raising=False)
    monkeypatch.setattr("swath.tools.scan.scan", fake, raising=False)
    import swath.scenario.scenario as module

    monkeypatch.setattr(module, "load_scenario", partial(module.load_scenario, catalogue=FAKE))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.yaml").write_text(GOOD)
    return fake


def test_nothing_heavy_is_loaded():
    code = "import sys, swath, swath.commands.main; swath.commands.main.main([]); print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.splitlines()[-1].split())
    assert "swath.commands.main" in loaded
    assert not HEAVY & loaded
    helps = (
        "import sys\nfrom swath.commands.main import main\n"
        "try: main(['run', '--help'])\nfinally: print(*sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", helps], capture_output=True, text=True, check=True)
    assert not HEAVY & set(run.stdout.splitlines()[-1].split())


def test_alone_it_says_in_three_lines_what_to_do_next(capsys):
    from swath.commands.main import make_parser

    assert main([]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("  swath ")]
    assert len(lines) == 3
    assert {line[1] for line in lines} <= {*make_parser()[1], "--help"}


def test_every_command_is_in_the_documentation():
    from swath.commands.main import make_parser

    page = (Path(__file__).parents[1] / "docs" / "reference" / "commands.md").read_text(encoding="utf-8")
    names = make_parser()[1]
    assert len(names) > 12
    assert [name for name in names if f"`swath {name}" not in page] == []


def test_version_and_help(capsys):
    for flag in ("--version", "-V", "--help", "help"):
        with pytest.raises(SystemExit) as caught:
            main([flag])
        assert caught.value.code == 0
    assert f"swath {swath.__version__}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["rnu"], "swath: rnu: no such command, did you mean 'run'?"),
        (["migrate", "a.yaml"], "swath: migrate: no such command any more, `swath migrate` of version 0.2"),
        (["ros2", "play", "x"], "swath: RUN = x: expected a run folder with a run.mcap, or a .mcap file"),
        (["run"], "the following arguments are required: NAME|FILE"),
        (["run", "a", "--fast"], "unrecognized arguments: --fast (see swath run --help)"),
        (["run", "a", "--sed", "3"], "unrecognized arguments: --sed 3, did you mean --seed?"),
        (["run", "nowhere.yaml"], "swath: scenario = nowhere.yaml: there is no such file"),
        (["run", "strait"], "did you mean 'straight'?"),
        (["run", "small.yaml", "--seed", "x"], "--seed: expected a whole number, not 'x'"),
        (["run", "small.yaml", "--set", "combine.speed.speed_kmh=-1"], "(--set combine.speed.speed_kmh=-1)"),
        (["scan", "small.yaml", "--at", "-1"], "swath: --at-s = -1.0: expected 0 to 100000"),
        (["levels", "lidr"], "did you mean 'lidar'?"),
        (["field"], "the following arguments are required: VERB"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(job, capsys, tmp_path, argv, message):
    assert main(argv) == 2
    said = capsys.readouterr()
    assert message in said.err
    assert len(said.err.splitlines()) == 1
    assert said.out == ""
    assert [p.name for p in tmp_path.iterdir()] == ["small.yaml"]


@pytest.mark.parametrize("code", [0, 1])
def test_run(job, capsys, code):
    job.exit_code = code
    assert main(["run", "small.yaml", "--set", "combine.speed.speed_kmh=5", "--seed", "9"]) == code
    scenario, out, progress = job.calls[0]
    assert (scenario.seed, str(out), progress) == (9, "runs/small-9", True)
    assert scenario.machines["combine"].slots["speed"].params.speed_kmh == 5.0
    said = capsys.readouterr().out
    assert "fail    combine.lateral_rms_m: 0.1 is more than 0.05" in said
    assert "12 345 678" not in said  # numbers of the run itself are left to the page
    assert "runs/small-9/report.html" in said


def test_a_run_says_which_defaults_it_uses(job, capsys):
    main(["run", "small.yaml"])
    said = capsys.readouterr().out
    assert "slots use default values: " in said.splitlines()[0]
    assert "--defaults prints them" in said.splitlines()[0]
    assert "echo percentile" not in said
    main(["run", "small.yaml", "--defaults", "--set", "combine.lidar.sub_rays=7"])
    said = capsys.readouterr().out
    assert said.splitlines()[0].startswith("defaults in use, not written in small")
    (lidar,) = [line for line in said.splitlines() if line.startswith("lidar plants")]
    assert "echo percentile" in lidar
    assert "sub_rays" not in said
    for flag in ("--quiet", "--no-defaults"):
        main(["run", "small.yaml", flag])
        assert "echo percentile" not in capsys.readouterr().out
    main(["run", "runs/small-3"])
    assert "defaults" not in capsys.readouterr().out


def test_runs_do_not_overwrite_each_other(job, capsys):
    for _ in range(3):
        main(["run", "small.yaml", "--quiet"])
    assert capsys.readouterr().out.split() == ["runs/small-3", "runs/small-3-2", "runs/small-3-3"]


def test_an_error_while_assembling_gets_its_line(job, capsys):
    job.error = InputError("combine.lidar.mount.z_m", -1, "expected a sensor above the ground")
    assert main(["run", "small.yaml"]) == 2
    expected = "swath: combine.lidar.mount.z_m = -1: expected a sensor above the ground (small.yaml:21)\n"
    said = capsys.readouterr()
    assert said.err == expected
    assert said.out == ""  # no wall of defaults before it


def test_interrupt_and_mistakes(job, capsys, monkeypatch):
    job.error = KeyboardInterrupt()
    assert main(["run", "small.yaml"]) == 130
    job.error = ZeroDivisionError("division\nby zero")
    assert main(["run", "small.yaml"]) == 70
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "swath: stopped"
    assert said[1].startswith("swath: ZeroDivisionError: division by zero. This is a mistake in swath")
    assert len(said) == 2
    monkeypatch.setenv("SWATH_DEBUG", "1")
    assert main(["run", "small.yaml"]) == 70
    assert "Traceback" in capsys.readouterr().err


@pytest.mark.usefixtures("code_allowed")
def test_a_mistake_in_the_users_own_level_is_the_users(job, capsys, tmp_path):
    from swath.core.registry import Registry

    (tmp_path / "own.py").write_text("class Own:\n    def step(self):\n        return 1 / 0\n")
    own = Registry({"steer": []}).get("steer", "own.py:Own", base=tmp_path).component()
    job.run_job = lambda *args, **more: own.step()
    assert main(["run", "small.yaml"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(
        f"swath: {tmp_path}/own.py:3: ZeroDivisionError: division by zero (in your own level"
    )
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("simulated_s", [0.0, 0.5])
def test_interrupt_says_what_is_left(job, capsys, monkeypatch, tmp_path, simulated_s):
    def stopped(scenario, out, progress, events=(), hooks=(), begun=None, allow=()):
        out.mkdir(parents=True, exist_ok=True)
        (out / "report.html").touch()
        (out / "summary.json").write_text(f'{{"simulated_s": {simulated_s}}}')
        raise KeyboardInterrupt

    monkeypatch.setattr(job, "run_job", stopped)
    assert main(["run", "small.yaml"]) == 130
    kept = "; what was recorded is in runs/small-3, to look at: swath report runs/small-3"
    assert capsys.readouterr().err == f"swath: stopped{kept if simulated_s else ' before its first step'}\n"


def test_scan(job, capsys):
    assert main(["scan", "small.yaml", "--at", "4.5"]) == 0
    assert (str(job.calls[0][1]), job.calls[0][2]) == ("runs/small-3-scan", 4.5)
    assert capsys.readouterr().out.split() == ["runs/small-3-scan/scan.png", "runs/small-3-scan/scan.csv"]
    assert job.formats is None
    assert not job.camera
    assert main(["scan", "small.yaml", "--format", "ply, las"]) == 0
    assert job.formats == ["ply", "las"]


def test_field_commands_hand_on_their_arguments(monkeypatch, capsys, tmp_path):
    class Report(str):
        source: ClassVar[dict] = {}
        field: ClassVar[dict] = {"passes": [0]}

    asked = []
    importer = SimpleNamespace(
        import_log=lambda log, out, **more: asked.append((log.name, out.name, more)) or Report("3 records"),
        show=lambda folder: folder / "overview.png",
        Settings=lambda **given: given,
    )
    passes = SimpleNamespace(write_pass_scenario=lambda folder: folder / "scenario.yaml")
    monkeypatch.setitem(sys.modules, "swath.field_io.importer", importer)
    case = SimpleNamespace(write_pass_case=lambda folder: folder / "passes.yaml")
    monkeypatch.setitem(sys.modules, "swath.field_io.pass_scenario", passes)
    monkeypatch.setitem(sys.modules, "swath.field_io.pass_case", case)
    flags = ["--dem", "d.tif", "--grain-g-per-stem", "1.1", "--header-width-m", "9"]
    assert main(["field", "import", "log.csv", "--out", "field", *flags]) == 0
    assert asked[0][:2] == ("log.csv", "field")
    assert str(asked[0][2]["dem"]) == "d.tif"
    assert asked[0][2]["settings"] == {
        "grain_g_per_stem": 1.1,
        "header_width_m": 9.0,
        "as_map": False,
    }
    assert main(["field", "show", "field"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said == [
        "3 records",
        "drive in it: swath run field",
        "along many of them: swath test run field/passes.yaml --out DIR",
        "field/overview.png",
    ]


def test_scenarios(capsys):
    assert main(["scenarios"]) == 0
    said = capsys.readouterr().out
    for name in ("laser-pilot", "straight", "bend"):
        assert name in said


def test_sheets(capsys, tmp_path):
    assert main(["sheets"]) == 0
    assert {"sick-lms111", "lexion-700-class", "wheat"} <= set(capsys.readouterr().out.split())
    assert main(["sheets", "sick-lms111"]) == 0
    (tmp_path / "mine.yaml").write_text(capsys.readouterr().out)
    from swath.sensing.lidar_sheet import load_lidar

    assert load_lidar("mine.yaml", tmp_path).name == load_lidar("sick-lms111").name
    assert main(["sheets", "sick-lms1111"]) == 2
    assert "did you mean 'sick-lms111'?" in capsys.readouterr().err


class TestRunFolder:
    def finished(self, folder, name="small"):
        folder.mkdir(parents=True)
        (folder / "scenario.yaml").write_text(f"name: {name}\n")
        (folder / "summary.json").write_text(json.dumps({}))
        return folder

    def test_new_empty_and_earlier_runs_are_taken(self, tmp_path):
        empty = tmp_path / "empty"
        empty.mkdir()
        earlier = self.finished(tmp_path / "earlier")
        for out in (tmp_path / "new", empty, earlier):
            assert choose_run_folder("small", 1, out) == out
        assert (earlier / "summary.json").exists()

    def test_anything_else_is_refused(self, tmp_path):
        foreign = tmp_path / "foreign"
        foreign.mkdir()
        (foreign / "thesis.doc").write_text("")
        other = self.finished(tmp_path / "other", "bend")
        earlier = "expected a new or empty folder, or an earlier run of small"
        file = "expected a folder, this is a file"
        for out, expected in ((foreign, earlier), (other, earlier), (foreign / "thesis.doc", file)):
            with pytest.raises(InputError, match=f"--out = .*{expected}"):
                choose_run_folder("small", 1, out)
            with pytest.raises(InputError, match="--out"):
                choose_scan_folder("small", 1, out)

    def test_clearing_takes_only_the_files_of_a_run(self, tmp_path):
        folder = self.finished(tmp_path / "run")
        (folder / "notes.txt").write_text("mine")
        clear_run_folder(folder)
        assert {f.name for f in folder.iterdir()} == {"notes.txt", "scenario.yaml"}
