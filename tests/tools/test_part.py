"""One slot alone gives what it gave in the machine, from the recording and from a table."""

import csv
import re
from math import atan, radians
from pathlib import Path

import pytest

from swath import load_scenario
from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.machine.machine_sheet import open_machine, read_machine
from swath.runtime.job import run_job
from swath.tools.part.isolate import IsolatedPart
from swath.tools.part.table import columns_of, read_table, write_table

SETS = ["run.distance_m=4", "combine.lidar.level=empirical", "expect={}"]
TUTORIAL = Path(__file__).parents[2] / "docs/tutorials/one-part.md"
WHEELBASE = read_machine(open_machine("lexion-700-class")).wheelbase
DEAD_BAND = radians(0.15)  # rest error of the valve's dead band is 0.12 deg


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("part") / "run"
    run_job(load_scenario("straight", sets=SETS), out)
    return out


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("slot", ["edge", "steer", "combine.motion", "header"])
def test_from_a_recording_every_sample_is_the_same(run, slot, tmp_path, capsys):
    assert main(["part", slot, "--input", str(run), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "identical to the recording" in printed
    assert int(printed.split("recording, ")[1].split()[0]) == len(rows(tmp_path / "outputs.csv")) > 20


def test_a_change_of_the_part_shows_itself(run, tmp_path, capsys):
    change = ["--set", "combine.edge.level=otsu"]
    assert main(["part", "edge", "--input", str(run), "--out", str(tmp_path), *change]) == 0
    assert "differs from" in capsys.readouterr().out


def test_its_inputs_as_a_table_give_the_same_again(run, tmp_path):
    """Scans with arrays, states with poses; half the table is half the run."""
    again, narrow = tmp_path / "again", tmp_path / "narrow"
    assert main(["part", "edge", "--input", str(run), "--out", str(tmp_path)]) == 0
    table = tmp_path / "inputs.csv"
    assert main(["part", "edge", "--input", str(table), "--scenario", str(run), "--out", str(again)]) == 0
    first, second = rows(tmp_path / "outputs.csv"), rows(again / "outputs.csv")
    assert len(first) == len(second) > 20
    for a, b in zip(first, second, strict=True):
        assert a.keys() == b.keys()
        for name in a:
            if a[name] != b[name]:  # poses lose their last digits as angles
                assert float(b[name]) == pytest.approx(float(a[name]), rel=1e-9, abs=1e-9)
    lines = table.read_text().splitlines()
    narrow.mkdir()
    (narrow / "half.csv").write_text("\n".join(lines[: len(lines) // 2]) + "\n")
    half = ["part", "edge", "--input", str(narrow / "half.csv"), "--scenario", str(run), "--out", str(narrow)]
    assert main(half) == 0
    assert len(rows(narrow / "outputs.csv")) == pytest.approx(len(first) / 2, abs=2)


def test_a_table_by_hand_drives_the_steering_to_its_closed_form(tmp_path):
    """The ideal actuator is at once where a path of curvature k needs it, |atan(wheelbase * k)|."""
    part = IsolatedPart(load_scenario("straight", sets=["combine.steering=ideal"]), "combine.steering")
    table = tmp_path / "steer.csv"
    lines = ("0,0.02,true", "0.2,,", "0.5,0.05,true", "1,,")
    table.write_text("\n".join(("t_s,steer.command.curvature,steer.command.is_engaged", *lines)))
    arrivals, end = read_table(table, part)
    assert end == NS
    given = part.run(arrivals, end=end)
    part.world.close()
    angle = {a.t: abs(a.sample.angle) for a in given}
    wheelbase = part.world.leader.sheet.wheelbase
    for t, curvature in ((400_000_000, 0.02), (max(angle), 0.05)):
        assert angle[t] == pytest.approx(atan(wheelbase * curvature), rel=1e-9)
    write_table(tmp_path / "out.csv", part, given)
    assert len(rows(tmp_path / "out.csv")) == len(angle)


def test_the_bend_of_the_tutorial_is_steered(tmp_path, monkeypatch, capsys):
    """Its table ends with a time only; by then the wheels stand at atan(wheelbase / 50 m), valve aside."""
    text = TUTORIAL.read_text()
    name, written = "bend.csv", re.search(r"printf '%s.n' (.*) > bend.csv", text)[1]
    line = re.search(r"swath (part steering --scenario straight --input bend.csv .*)", text)[1]
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text("\n".join(written.split()) + "\n")
    assert main(line.split()) == 0
    table = rows(tmp_path / "parts/steering/outputs.csv")
    assert float(table[-1]["t_s"]) == 3.0
    wanted = atan(WHEELBASE * 0.02)
    assert float(table[-1]["steering.steering.angle"]) == pytest.approx(wanted, abs=DEAD_BAND)
    assert all(abs(float(r["steering.steering.angle"])) < 1e-9 for r in table if float(r["t_s"]) < 0.65)
    fed = rows(tmp_path / "parts/steering/inputs.csv")
    assert [r["t_s"] for r in fed] == ["0.0", "0.5", "3.0"]  # feeds the same again


def drive(tmp_path, *lines, sets=("combine.steering=ideal",)):
    """Angles over time of the steering, fed from a table."""
    part = IsolatedPart(load_scenario("straight", sets=list(sets)), "combine.steering")
    table = tmp_path / "steer.csv"
    table.write_text("\n".join(("t_s,steer.command.curvature,steer.command.is_engaged", *lines)) + "\n")
    try:
        arrivals, end = read_table(table, part)
        return {a.t / NS: a.sample.angle for a in part.run(arrivals, end=end)}
    finally:
        part.world.close()


@pytest.mark.parametrize("last", ["2", "2,", "2,,", " 2 ,, ", "1,,\n1.5,,\n2,,\n,,\n"])
def test_a_last_row_with_a_time_only_says_how_long_it_lasts(tmp_path, last):
    angles = drive(tmp_path, "0,0.02,true", "0.5,-0.03,true", last)
    assert max(angles) == 2.0
    assert angles[2.0] == pytest.approx(-atan(WHEELBASE * 0.03), rel=1e-9)
    assert angles[0.4] == pytest.approx(atan(WHEELBASE * 0.02), rel=1e-9)


@pytest.mark.parametrize("lines", [("0,,", "0.7,,"), ("0.3,0.02,true", "0.7,,")])
def test_what_it_needs_has_to_be_there_by_its_first_step(tmp_path, lines):
    with pytest.raises(
        InputError, match=r"combine.steer.command: expected a sample by its first step at 0.0"
    ):
        drive(tmp_path, *lines)


def test_decimal_commas_are_refused_not_cut(tmp_path):
    with pytest.raises(InputError, match=r"decimals with a point \(.*steer.csv:3\)"):
        drive(tmp_path, "0,0.02,true", "0,5,0,03,true")


def test_every_unknown_and_every_missing_column_is_named_at_once(tmp_path, capsys):
    table = tmp_path / "log.csv"
    table.write_text("t_s,motion.state.spead,rain_mm\n0,1,2\n")
    assert main(["part", "header", "--input", str(table), "--out", str(tmp_path / "o")]) == 2
    said = capsys.readouterr().err
    assert "motion.state.spead: combine.header does not take it, did you mean motion.state.speed?" in said
    for name in ("rain_mm", "motion.state.pose.x", "motion.state.distance", "log.csv:1"):
        assert name in said
    assert not (tmp_path / "o").exists()


def test_bad_cells_are_named_with_their_lines(tmp_path):
    part = IsolatedPart(load_scenario("straight"), "combine.steering")
    names = list(columns_of(part, part.ports))
    table = tmp_path / "log.csv"
    row = ["x", *["1"] * (len(names) - 1)]
    table.write_text(",".join(("t_s", *names)) + "\n" + "\n".join(",".join(("0", *row)) for _ in range(2)))
    with pytest.raises(InputError) as caught:
        read_table(table, part)
    assert [e.line for e in (caught.value, *caught.value.others)] == [2, 3]
    part.world.close()


def test_without_an_input_the_columns_are_printed(capsys):
    assert main(["part", "process", "--scenario", "feed-rate"]) == 0
    said = capsys.readouterr().out
    for name in ("header.flow.grain", "process.load.tank_grain", "powertrain.engine.speed"):
        assert name in said


def test_a_recording_without_every_sample_is_refused_by_name(tmp_path, capsys):
    run_job(
        load_scenario("straight", sets=["run.distance_m=1", "run.record=standard", *SETS[1:]]), tmp_path / "r"
    )
    assert main(["part", "steer", "--input", str(tmp_path / "r"), "--out", str(tmp_path / "o")]) == 2
    assert "combine.edge.edge" in capsys.readouterr().err
