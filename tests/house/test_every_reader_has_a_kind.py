"""Each function of swath that reads a file of a stranger is come to by a kind of the fuzz."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.readers import NO_STRANGERS, PARTS_OF_SWATH, of_strangers, places

for extra in ("rasterio", "trimesh", "asammdf", "can", "laspy", "openodd", "fmpy", "onnx", "onnxruntime"):
    pytest.importorskip(extra)


@pytest.mark.draws
def test_each_reader_is_come_to():
    """In a process of its own, in which no file was read before."""
    ran = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "tests.fuzz.readers"],
        cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout[-2000:] + ran.stderr[-2000:]


def test_readers_are_found_and_exceptions_are_there():
    found = places()
    assert len(of_strangers()) > 100
    assert ("field_io/logs/channels.py", "_mdf") in found
    assert {file for file, _ in found} >= PARTS_OF_SWATH
    assert found >= NO_STRANGERS.keys()
