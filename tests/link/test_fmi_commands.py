"""`swath fmu show` and `swath fmu check`, as printed."""

import subprocess
import sys
from importlib.metadata import requires

import pytest

from swath.commands.main import main
from tests.link.made_fmus import PROCESS, engine_fmu, needs_cc, store_fmu

pytest.importorskip("fmpy")
pytestmark = [needs_cc, pytest.mark.usefixtures("code_allowed")]


def printed(capsys, *argv):
    code = main(["fmu", *map(str, argv)])
    captured = capsys.readouterr()
    return code, [" ".join(line.split()) for line in (captured.out + captured.err).splitlines()]


def test_show(tmp_path, capsys):
    code, lines = printed(capsys, "show", engine_fmu(tmp_path))
    assert code == 0
    assert "FMI 3.0, co-simulation" in lines
    assert "ground_speed input Float64 km/h 0.277778 m s-1 0" in lines
    assert "x[3] input Float64 0 0 0" in lines
    assert "events yes" in lines


def test_check_of_a_good_one(tmp_path, capsys):
    code, lines = printed(capsys, "check", store_fmu(tmp_path))
    assert code == 0
    assert "state ok saved as bytes, going back gives the same outputs" in lines
    assert "it can fill a slot" in lines


@pytest.mark.parametrize(
    ("mode", "row"),
    [
        (1, "steps bad at t = 0.5 s: its process crashed (SIGSEGV), its step"),
        (3, "steps bad tank_grain is not a finite number at t = 0.6 s"),
        (4, "steps bad at t = 0.5 s: fmi2DoStep gave error; it says: belt 7 is torn"),
    ],
    ids=["crash", "nan", "error"],
)
def test_check_of_a_bad_one(tmp_path, capsys, mode, row):
    # the binary starts with the mode that its parameter would set
    file = store_fmu(tmp_path, flags=(f"-DFIRST_MODE={mode}",))
    code, lines = printed(capsys, "check", file)
    assert code == 1
    assert row in lines
    assert "it cannot fill a slot as it is" in lines


def test_check_without_a_binary_for_this_system(tmp_path, capsys):
    file = store_fmu(tmp_path, binary="binaries/win64/store.dll")
    code, lines = printed(capsys, "check", file)
    assert code == 1
    assert "binary bad none for this system; it has: win64" in lines


def test_faults_are_listed(tmp_path, capsys):
    bare = [(n, c, u, None if c == "input" else s) for n, c, u, s in PROCESS]
    code, lines = printed(capsys, "check", store_fmu(tmp_path, variables=bare))
    assert code == 0
    faults = [line for line in lines if line.startswith("standard note")]
    assert len(faults) == 5
    assert 'Variable "grain_in"' in faults[0]
    assert "has no start value" in faults[0]


def test_a_description_that_cannot_be_read(tmp_path, capsys):
    code, lines = printed(capsys, "show", store_fmu(tmp_path, extra='numberOfEventIndicators="many"'))
    assert code == 2
    assert "its description cannot be read" in lines[0]


def test_what_is_no_fmu(tmp_path, capsys):
    (tmp_path / "x.fmu").write_bytes(b"")
    code, lines = printed(capsys, "show", tmp_path / "x.fmu")
    assert code == 2
    assert "expected an FMU, a zip archive" in lines[0]


def test_neither_cmake_nor_nbformat_is_needed(tmp_path):
    """Nor does the version that the extra takes bring cmake."""
    assert not any(needed.startswith("cmake") for needed in requires("fmpy") or ())
    fmu = str(store_fmu(tmp_path))
    program = f"""
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("cmake", "nbformat"):
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Absent())
from swath.commands.main import main
sys.exit(main(["fmu", "show", {fmu!r}]) or main(["fmu", "check", {fmu!r}, "--allow-code"]))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert "it can fill a slot" in done.stdout
