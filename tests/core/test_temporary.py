"""What a killed process leaves in the system's temporary folder goes with the next start of its user."""

import os
import signal
import subprocess
import sys
import tempfile

import pytest

from swath.commands.main import main
from swath.core.files.temporary import OPENING_S, PREFIX, TemporaryFolder

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="locks as of POSIX")
HOLDS = """
from swath.core.files.temporary import TemporaryFolder
made = TemporaryFolder("ssp")
(made.path / "inner").mkdir()
(made.path / "inner" / "file").write_text("x" * 1000)
print(made.path, flush=True)
input()
"""


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def aged(path):
    then = path.stat().st_mtime - 2 * OPENING_S
    os.utime(path, (then, then))


def test_only_what_a_killed_process_of_this_user_left_goes(place, capsys):
    said = [sys.executable, "-c", HOLDS]
    holding = [
        subprocess.Popen(said, stdin=-1, stdout=-1, text=True, env={**os.environ, "TMPDIR": str(place)})
        for _ in range(2)
    ]
    killed, living = (place / each.stdout.readline().strip() for each in holding)
    holding[0].send_signal(signal.SIGKILL)
    holding[0].wait()
    foreign, link, young = place / "swath-warp-7", place / f"{PREFIX}link", place / f"{PREFIX}young"
    (place / "precious").mkdir()
    link.symlink_to(place / "precious")
    for folder in (foreign, young):
        folder.mkdir()
    for folder in (killed, living, foreign, place / "precious"):
        aged(folder)
    assert main(["levels", "steer"]) == 0
    capsys.readouterr()
    assert not killed.exists()
    assert (living / "inner" / "file").is_file()
    assert foreign.is_dir()
    assert link.is_symlink()
    assert young.is_dir()
    holding[1].communicate("\n")
    assert not living.exists()
    for each in holding:
        each.stdout.close()
        each.stdin.close()


def test_a_folder_goes_with_its_object_and_its_block(place):
    made = TemporaryFolder("fmu")
    assert made.path.stat().st_mode & 0o077 == 0
    with TemporaryFolder("lab") as other:
        assert other.parent == made.path.parent == place
    del made
    assert not list(place.iterdir())
