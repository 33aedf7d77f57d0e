"""The folder that a command writes: nobody else's, one process at a time, whatever a kill left there."""

import os
import signal

import pytest

from swath.commands.main import main, make_parser, subcommands
from swath.core.errors import InputError
from swath.core.files.output_folder import LOCK, check_folder, held
from swath.core.files.whole_file import PART, new_file, write_whole

OWN = ("a.json", "part-*.png")
OTHERWISE = {  # where a command holds its folder: with what writes it
    **dict.fromkeys(("run", "branch", "rerun", "test again"), "runtime.folder.occupied"),
    "scan": "tools.scan.scan.scan_job",
    "field import": "field_io.folder.write",
    "field agopengps": "field_io.agopengps.write_agopengps",
    "fmu export": "a file",
    "ros2 package": "a new folder",
}


def in_fork(work):
    """Do something in a process of its own; its wait status."""
    pid = os.fork()
    if pid == 0:
        try:
            work()
        finally:
            os._exit(0)
    return os.waitpid(pid, 0)[1]


def test_every_command_that_fills_a_folder_holds_it():
    found = {}
    for parser in subcommands(make_parser()[0]):
        name = parser.prog.removeprefix("swath ")
        outs = [a for a in parser._actions if a.dest == "out" and a.metavar == "DIR"]
        if outs and name not in OTHERWISE:
            found[name] = parser.get_default("holds")
    assert [name for name, holds in found.items() if holds is None] == []
    assert len(found) >= 10


def test_what_a_kill_left_is_taken_over(tmp_path):
    def work():
        with held(folder, OWN, "result"):
            for name in (f"a.json{PART}", f"part-1.png{PART}", "part-2.png"):
                (folder / name).write_text("half")
            os.kill(os.getpid(), signal.SIGKILL)

    folder = tmp_path / "out"
    assert os.WTERMSIG(in_fork(work)) == signal.SIGKILL
    assert len(list(folder.iterdir())) == 4
    with held(folder, OWN, "result"):
        assert {f.name for f in folder.iterdir()} == {LOCK, "part-2.png"}
    assert [f.name for f in folder.iterdir()] == ["part-2.png"]


@pytest.mark.parametrize("name", ["letter.txt", f"letter.txt{PART}", "a.json.txt", "part.png"])
def test_files_of_others_are_refused_and_stay(tmp_path, name):
    (tmp_path / name).write_text("dear")
    with (
        pytest.raises(InputError, match="expected a new or empty folder, or an earlier result"),
        held(tmp_path, OWN, "result"),
    ):
        pass
    with held(tmp_path, OWN, "result", alone=False):
        pass
    assert [f.read_text() for f in tmp_path.iterdir()] == ["dear"]


def test_a_folder_that_is_a_file(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="this is a file"):
        check_folder(tmp_path / "out", OWN, "result")
    with (
        pytest.raises(InputError, match="expected a folder that can be made"),
        held(tmp_path / "out" / "in", OWN, "result"),
    ):
        pass


def test_a_second_process_is_told_who_writes(tmp_path, capsys):
    with held(tmp_path / "out", ("lab.csv", "report.html"), "lab"):
        assert main(["lab", "stand", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert f"expected a folder that process {os.getpid()} (lab) does not write to" in said
    assert len(said.splitlines()) == 1


def test_a_command_that_is_refused_leaves_no_folder(tmp_path, capsys):
    assert main(["lab", "stand", "--out", str(tmp_path / "out"), "--sensor", "none"]) == 2
    assert not (tmp_path / "out").exists()


def test_two_writers_of_a_file_never_mix(tmp_path):
    file = tmp_path / "a.json"
    first, second = new_file(file), new_file(file)
    first.__enter__().write(b"first")
    second.__enter__().write(b"second")
    with pytest.raises(InputError, match="no other process writes"):
        first.__exit__(None, None, None)
    assert not file.exists()
    second.__exit__(None, None, None)
    assert file.read_bytes() == b"second"
    assert [f.name for f in tmp_path.iterdir()] == ["a.json"]


def test_what_cannot_be_written_is_named_as_it_was_asked_for(tmp_path):
    (tmp_path / "a.yaml").mkdir()
    with pytest.raises(OSError) as caught:
        write_whole(tmp_path / "a.yaml", "x")
    assert caught.value.filename == str(tmp_path / "a.yaml")


@pytest.mark.parametrize("length", [4090, 5000])
def test_a_path_that_is_too_long_is_one_error(tmp_path, capsys, length):
    folder = str(tmp_path)
    while len(folder) < length - 200:
        folder += f"/{'x' * 150}"
    folder += "/" + "y" * (length - len(folder) - 1)
    line = ["run", "straight", "--set", "run.distance_m=1", "--no-report", "--quiet", "--out", folder]
    assert main(line) == 2
    assert "at most 255 bytes" in capsys.readouterr().err
