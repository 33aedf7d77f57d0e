"""What someone types in the first hour: mistakes at once, short trials, settings, tables in a pipe."""

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from random import Random

import numpy as np
import pytest

import swath
from swath.commands.main import main
from swath.scenario.scenario import load_scenario
from swath.terminal import tables
from swath.terminal.outcome import print_outcome
from swath.terminal.tables import table
from tests.printed import are_whole, run_of, words_of

SHORT = ["run.distance_m=5", "combine.lidar.level=empirical", "combine.edge=truth", "run.record=none"]


def test_python_m_swath_is_the_command_line():
    done = subprocess.run(
        [sys.executable, "-m", "swath", "--version"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.split()[0]) == (0, "swath")


def test_all_mistakes_of_a_scenario_are_said_at_once(capsys):
    wrong = [
        "combine.steer.lookahed_m=3",
        "combine.lidar.rate_hz=-1",
        "run.distance_m=far",
        "field.stand.crop=spelt",
    ]
    flags = [word for change in wrong for word in ("--set", change)]
    assert main(["run", "straight", *flags]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == len(wrong)
    for change in wrong:
        assert any(change.partition("=")[0].rpartition(".")[2] in line for line in said), change


def test_a_setting_with_a_slip_is_named(capsys, monkeypatch):
    monkeypatch.setenv("SWATH_THREAD", "2")
    assert main(["scenarios"]) == 0
    assert capsys.readouterr().err == (
        "swath: SWATH_THREAD in the environment is no setting, did you mean 'SWATH_THREADS'?\n"
    )


def test_a_trial_of_five_metres_is_open_and_a_long_run_without_a_value_fails(tmp_path, capsys):
    flags = [word for change in SHORT for word in ("--set", change)]
    assert main(["run", "straight", *flags, "--out", str(tmp_path / "r")]) == 3
    assert "open    combine.lateral_rms_m: not measured in so short a run" in capsys.readouterr().out
    expect = json.loads((tmp_path / "r" / "summary.json").read_text())["expect"]
    assert {e["result"] for e in expect if e["name"] == "lateral_rms_m"} == {"not measured"}
    from swath.judge.limits import NOTHING, entry_of, exit_code_of

    expected = load_scenario("straight").expect[0]
    missing, wrong = (None, NOTHING), (1.0, "1 is more than 0.05")
    assert exit_code_of([entry_of(expected, [missing])]) == 1
    unmeasured = entry_of(expected, [missing], is_trial=True)
    assert exit_code_of([unmeasured]) == 3
    assert exit_code_of([unmeasured, entry_of(expected, [wrong], is_trial=True)]) == 1


def test_a_trial_that_ends_before_a_window_opens_is_open(tmp_path, monkeypatch, capsys):
    """The template of a scenario has a limit from 10 m on."""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "scenario"]) == 0
    flags = [word for change in ("run.distance_m=3", *SHORT[1:]) for word in ("--set", change)]
    assert main(["run", "my_scenario.yaml", *flags, "--out", "r"]) == 3
    assert (
        "open    combine.lateral_p95_m from_m 10: not measured in so short a run" in capsys.readouterr().out
    )


def test_the_order_of_set_does_not_matter():
    one = ["combine.lidar.level=plants", "combine.lidar.sub_rays=7", "combine.lidar.spot=fixed"]
    made = [load_scenario("straight", sets=sets) for sets in (one, one[::-1], [one[1], one[0], one[2]])]
    other = [
        load_scenario("straight", sets=s)
        for s in (
            ["combine.imu.rate_hz=10", "combine.imu=ideal"],
            ["combine.imu=ideal", "combine.imu.rate_hz=10"],
        )
    ]
    assert made[0] == made[1] == made[2]
    assert other[0] == other[1]
    assert other[0].machines["combine"].slots["imu"].common.rate_hz == 10


def test_a_table_of_set_lies_where_one_stands(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "cal.npz").write_bytes(b"")
    sets = ["combine.lidar.level=empirical", "combine.lidar.table=runs/cal.npz"]
    params = load_scenario("straight", sets=sets).machines["combine"].slots["lidar"].params
    assert params.table == str(tmp_path / "runs" / "cal.npz")


def test_sets_of_python_read_what_set_reads(tmp_path):
    texts = [
        "combine.speed.speed_kmh=5",
        "combine.lidar.sector_deg=[-30, 30]",
        "combine.lidar.echo=mean",
        "seed=4",
    ]
    values = {
        "combine.speed.speed_kmh": "5",
        "combine.lidar.sector_deg": np.array([-30, 30]),
        "combine.lidar.echo": "mean",
        "seed": np.int64(4),
    }
    assert swath.load_scenario("straight", sets=values) == swath.load_scenario("straight", sets=texts)


def test_runs_of_the_same_moment_get_folders_of_their_own(tmp_path, monkeypatch):
    from swath.runtime.folder import choose_run_folder, remove_empty

    monkeypatch.chdir(tmp_path)
    folders = [choose_run_folder("a", 1) for _ in range(3)]
    assert [f.name for f in folders] == ["a-1", "a-1-2", "a-1-3"]
    for folder in folders:
        remove_empty(folder)
    assert choose_run_folder("a", 1).name == "a-1"


@pytest.mark.parametrize("command", [["levels", "lidar"], ["sheets"], ["metrics"]])
def test_lines_stay_whole_in_a_pipe(command, capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    assert main(command) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) > 80
    rows = [line for line in lines if line.startswith("  ") and line.strip()]
    assert not [row for row in rows if len(row) - len(row.lstrip()) > 12]  # the rest of a folded cell


def test_one_metric_is_told_alone_and_all_with_columns_and_events(capsys):
    for words, is_all in (["metrics"], True), (["metrics", "edge_rmse_m"], False):
        assert main(words) == 0
        said = capsys.readouterr().out
        assert "edge_rmse_m" in said
        assert ("lateral_rms_m" in said, "columns of the tracks" in said) == (is_all, is_all)


@pytest.mark.parametrize("command", ["levels", "metrics", "scenarios", "sheets", "test list"])
def test_lists_fit_the_columns_asked_for_and_come_as_json(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(command.split()) == 0
    text = capsys.readouterr().out
    lines = text.splitlines()
    assert len(lines) > 10
    assert max(map(len, lines)) <= 80
    assert main([*command.split(), "--json"]) == 0
    items = json.loads(capsys.readouterr().out)
    name = "level" if command == "levels" else "name"
    assert len(items) > 10
    assert all(item[name] in text for item in items)


@pytest.mark.parametrize("command", ["", "--help", "levels edge", "test list waves", "fleet list", "docs"])
def test_what_is_read_in_a_terminal_fits_it(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    with suppress(SystemExit):
        main(command.split())
    assert 0 < max(map(len, capsys.readouterr().out.splitlines())) <= 80


@pytest.mark.parametrize("columns", [60, 80, 100])
def test_drawn_tables_break_between_words_and_at_dots(columns, capsys, monkeypatch):
    """Words, keys, paths, numbers and sentences; what is longer than the terminal is the only way past it."""
    monkeypatch.setenv("COLUMNS", str(columns))
    rng, blocks, broken_keys = Random(columns), 0, 0

    def word():
        return "".join(rng.choices("abcdefgh_", k=rng.randint(2, 14)))

    def cell():
        key, way = (between.join(word() for _ in range(rng.randint(2, 5))) for between in (".", "/"))
        number = f"{rng.uniform(-1e6, 1e6):,.3f}".replace(",", " ")
        return rng.choice([key, way, number, word(), "", " ".join(word() for _ in range(rng.randint(1, 12)))])

    for _ in range(60):
        heads = [word() for _ in range(rng.randint(1, 7))]
        rows = [[cell() for _ in heads] for _ in range(rng.randint(1, 5))]
        table("", heads, rows)
        lines = capsys.readouterr().out.splitlines()
        words = words_of(lines)
        is_table = "─" in "".join(lines)  # else each cell is a line, behind its column's name
        for text in (text for row in (heads * is_table, *rows) for text in row):
            for whole in tables.BLANK.split(text):
                assert whole in words or all(piece in words for piece in run_of(whole, words)), (whole, lines)
                broken_keys += whole not in words
        blocks += not is_table
        assert max(map(len, lines)) <= max(columns, max(map(len, heads)) + 2 + 14)
    assert broken_keys > 10
    assert 0 < blocks < 60 or columns == 100


@pytest.mark.parametrize("columns", [60, 80, 100])
def test_tables_of_commands_break_between_words_and_at_dots(columns, capsys, monkeypatch):
    """Those that need no run; every table goes through the same place."""
    monkeypatch.setenv("COLUMNS", str(columns))
    widths, printed, walked = tables._widths, [], []
    monkeypatch.setattr(tables, "_widths", lambda *told: printed.append(told[:2]) or widths(*told))
    for command in ("levels", "levels edge", "levels lidar", "metrics", "metrics lateral_rms_m", "scenarios",
                    "sheets", "docs", "test list waves"):  # fmt: skip
        with suppress(SystemExit):
            main(command.split())
        lines = capsys.readouterr().out.splitlines()
        are_whole(lines, columns, printed)
        walked += [len(rows) for _, rows in printed]
        printed.clear()
    print(f"{len(walked)} tables, {sum(walked)} rows")
    assert len(walked) >= 9


def test_a_run_shows_a_metric_once_and_what_fails_first(capsys):
    def limit(name, result, **more):
        return {
            "subject": "combine",
            "name": name,
            "limit": {"max": 1.0},
            "value": 2.0,
            "result": result,
            **more,
        }

    fails = limit("lateral_p95_m", "fail", window={"from_m": 10}, reason="2 is more than 1")
    expect = [limit("edge_rmse_m", "pass"), fails, limit("edge_bias_m", "not measured")]
    metrics = {"edge_rmse_m": 2.0, "lateral_p95_m": 0.5, "edge_bias_m": None, "distance_m": 20.0}
    print_outcome({"machines": {"combine": metrics}, "expect": expect}, Path("nowhere"))
    text = capsys.readouterr().out
    shown = [line.split("  ")[0].strip() for line in text.splitlines() if "_m" in line and line[0] == " "]
    assert shown == ["lateral_p95_m from_m 10", "edge_bias_m", "edge_rmse_m", "lateral_p95_m", "distance_m"]
    assert "fail    combine.lateral_p95_m from_m 10: 2 is more than 1" in text
    assert "open    combine.edge_bias_m: not measured" in text


def test_a_sheet_comes_as_json_too(capsys):
    assert main(["sheets", "sick-lms111", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["name"] == "SICK LMS1xx"
    assert main(["sheets", "check", "sick-lms111", "--json"]) == 2


def test_what_the_system_refuses_names_the_file_without_a_number(capsys, tmp_path):
    (tmp_path / "out").symlink_to(tmp_path / "nowhere" / "x")
    for line in (["run", "straight"], ["reda", "--sensor", "camera"], ["test", "run", "straight-clean"]):
        assert main([*line, "--out", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        assert str(tmp_path / "out") in said
        assert "Errno" not in said
    (tmp_path / "file").touch()
    assert main(["schema", "--out", str(tmp_path / "file" / "schema.json")]) == 2
    assert "Errno" not in capsys.readouterr().err


LOADED = """
import os, runpy, signal, sys

class Hook:
    def find_spec(self, name, path=None, target=None):
        if name == loaded:
            os.kill(os.getpid(), signal.SIGINT)

_, loaded, *sys.argv = sys.argv
sys.meta_path.insert(0, Hook())
runpy.run_module("swath", run_name="__main__")
"""


@pytest.mark.parametrize(
    "loaded", ["swath.commands.main", "importlib.metadata", "swath.core.errors", "swath.tools.reda"]
)
def test_ctrl_c_while_it_is_loaded_is_one_line(loaded):
    line = [sys.executable, "-c", LOADED, loaded, "swath", "--help"]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "swath: stopped\n")


def test_ctrl_c_while_a_command_imports_is_no_other_error(monkeypatch, capsys):
    def importing(_):
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise ImportError("numpy.core.multiarray failed to import")  # as its C code makes of it

    monkeypatch.setattr("swath.commands.metrics.run", importing)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    assert main(["metrics"]) == 130
    signal.signal(signal.SIGINT, before)
    assert capsys.readouterr().err == "swath: stopped\n"


def test_levels_is_a_line_for_each_slot_with_its_default(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["levels"]) == 0
    lines = [line.split(None, 1) for line in capsys.readouterr().out.splitlines() if line.startswith(" ")]
    found = {line[0]: line[1] for line in lines[2:] if len(line) == 2}
    from swath.scenario.slots import CATALOGUE

    assert set(found) == {*CATALOGUE.field_levels, *(slot.name for slot in CATALOGUE.slots)}
    assert "plants*" in found["lidar"]
    assert "empirical*" not in found["lidar"]


def test_the_help_has_every_command_once_in_a_group(capsys):
    from swath.commands.main import GROUPS, make_parser

    parser, names = make_parser()
    shown = parser.format_help().splitlines()
    for name in names:
        assert len([line for line in shown if line.startswith(f"  {name} ")]) == 1
    assert [f"{group}:" for group in GROUPS.values() if f"{group}:" not in shown] == []


def test_a_camera_without_a_lidar_is_seen(tmp_path, capsys):
    flags = ["--set", "combine.lidar=off", "--set", "combine.edge=truth"]
    assert main(["scan", "straight", "--camera", *flags, "--out", str(tmp_path / "s")]) == 0
    assert sorted(os.listdir(tmp_path / "s")) == ["scan.camera.npz", "scan.camera.png", "scan.of.txt"]


DRIVING = """format: swath scenario 2
name: driving
run: {distance_m: 2, max_duration_s: 4, record: none}
field: {terrain: plane, stand: uniform}
machines:
  tug: {machine: tractor-grain-cart, start: {x_m: 150, y_m: 150, heading_deg: 30}}
"""


def test_a_machine_that_only_drives_needs_no_edge(tmp_path):
    from swath.core.errors import InputError
    from swath.runtime.assembly import assemble
    from swath.scenario.scenario import parse_scenario

    world = assemble(parse_scenario(DRIVING))
    assert world.field.why_outside(150.0, 150.0) == ""
    world.close()
    with pytest.raises(InputError, match=r"tug\.start: expected x_m, y_m and heading_deg"):
        parse_scenario(DRIVING.replace(", start: {x_m: 150, y_m: 150, heading_deg: 30}", ""))
    with pytest.raises(InputError, match=r"field\.edge\.shape: expected one of"):
        parse_scenario(DRIVING.replace("tractor-grain-cart", "combine-5m"))


def test_levels_of_a_slot_that_hears_another_machine(capsys):
    assert main(["levels", "peer_link"]) == 0
    said = capsys.readouterr().out
    assert "inputs   " in said
    assert "loss_percent" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("run", "straight", "--set", "field.wind.speed_m_s=3"), "did you mean field.stand.wind?"),
        (
            ("run", "harvest-field"),
            "this is a job, the work on a whole field: swath fleet run harvest-field; expected a scenario",
        ),
        (("run", "straight", "--set", "field.slope_percent=3"), "did you mean field.terrain.slope_percent?"),
        (("test", "run", "my.py", "--out", "t"), "swath test run bend --set combine.edge.level=my.py:Class"),
    ],
)
def test_a_first_try_is_told_the_way(capsys, words, said):
    assert main(list(words)) == 2
    assert said in capsys.readouterr().err


def test_a_machine_is_printed_by_the_name_that_scenarios_take(capsys):
    assert main(["sheets", "lexion-700"]) == 0
    assert "wheelbase_m" in capsys.readouterr().out


def test_a_flag_with_a_unit_says_it_in_its_name():
    from swath.commands.main import make_parser, subcommands

    units = {"M": "-m", "S": "-s", "DEG": "-deg", "PX": "-px", "PERCENT": "-percent"}
    flags = {
        (flag, units[action.metavar])
        for parser in subcommands(make_parser()[0])
        for action in parser._actions
        for flag in action.option_strings
        if isinstance(action.metavar, str) and action.metavar in units and "fleet" not in parser.prog
    }
    assert len(flags) > 10
    assert [flag for flag, unit in flags if not flag.endswith(unit)] == []


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("diff nowhere other", "RUN = nowhere: expected a run folder, there is none of this name"),
        ("view here.py", "RUN = here.py: expected a run folder, this is a file"),
        ("run tab.yaml", "expected blanks, not a tab, before a key, column 1 (tab.yaml:2)"),
        ("run straight --set speed=9", "speed: unknown key, did you mean 'combine.speed'?"),
        ("run straight --set combine.edge.level=here.py", "expected the class in it, too: here.py:MyClass"),
        ("run straight --set combine.speed.speed_kmh 8", "combine.speed.speed_kmh: expected KEY=VALUE"),
        (
            "field import nowhere.csv --out f",
            "log = nowhere.csv: expected a yield log, there is no such file",
        ),
    ],
)
def test_usual_slips_are_told_with_what_to_type(line, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("here.py").touch()
    Path("tab.yaml").write_text("machines:\n\tcombine: {}\n")
    if line.startswith("field"):
        pytest.importorskip("rasterio")
    assert main(line.split()) == 2
    assert said in capsys.readouterr().err


def test_a_file_of_another_kind_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "report.html").write_text("<!doctype html>\n<p>a: b</p>")
    (tmp_path / "mine.py").write_text("import math\nclass Mine:\n    pass\n")
    (tmp_path / "case.yaml").write_text("format: swath test case 1\nobjective: none\n")
    (tmp_path / "scenario.yaml").write_text("format: swath scenario 2\nname: one\n")
    (tmp_path / "sheet.yaml").write_text("format: swath sensor 2\nname: one\n")
    for line, said in (
        ("run report.html", "expected a YAML file, this is an HTML page"),
        ("run mine.py", "expected a YAML file, this is a Python file"),
        ("run case.yaml", "expected a scenario; this file is for: swath test run FILE"),
        ("run sheet.yaml", "expected a scenario; this file is for: swath sheets check FILE"),
        ("test run scenario.yaml --out o", "expected a test case; this file is for: swath run FILE"),
    ):
        assert main(line.split()) == 2, line
        assert said in capsys.readouterr().err, line


@pytest.mark.parametrize("name", ["runs", "detector.py.part"])
def test_a_folder_that_cannot_be_written_is_named(name):
    from swath.commands.main import of_system

    refused = of_system(PermissionError(13, "Permission denied", name))
    assert refused == (
        ".: expected a folder that can be written: Permission denied; use --out, or work in another folder"
    )
    assert of_system(PermissionError(13, "Permission denied", __file__)) == f"{__file__}: Permission denied"


def test_a_stopped_test_says_that_it_goes_on():
    from swath.tools.function_test.progress import engine

    kept = "what is done is kept, the same command goes on"
    with pytest.raises(KeyboardInterrupt, match=kept), engine("", 1):
        raise KeyboardInterrupt


def test_an_import_does_not_replace_a_field_unasked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "f").mkdir()
    (tmp_path / "f" / "field.yaml").write_text("made: before\n")
    (tmp_path / "f" / "scenario.yaml").write_text("mine: 1\n")
    assert main(["field", "import", "sample-log", "--out", "f"]) == 2
    assert "--replace" in capsys.readouterr().err
    assert (tmp_path / "f" / "scenario.yaml").read_text() == "mine: 1\n"
    assert main(["field", "import", "sample-log", "--out", "f", "--replace"]) == 0
    assert "mine" not in (tmp_path / "f" / "scenario.yaml").read_text()
