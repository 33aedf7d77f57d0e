"""Small files that would fill the memory or never end are refused, or read, in bounded time and memory."""

import json
import os
import subprocess
import sys

import pytest

from tests.documents.bombs import BOMBS, SECONDS, SLOW

READ = ("OBJ of blanks", "OBJ of tabs", "DEM of 40,000 x 40,000", "GeoTIFF with one known cell")
MEMORY_MIB = 1000


@pytest.fixture(scope="module")
def outcomes():
    command = [sys.executable, "-W", "ignore", "-m", "tests.documents.bombs"]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, env=environment)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    return {name: (seconds, peak, said) for name, seconds, peak, said in rows}


@pytest.mark.draws
@pytest.mark.parametrize("name", [name for name in BOMBS if name not in SLOW])
def test_a_small_file_stays_small(outcomes, name):
    seconds, peak, said = outcomes[name]
    assert said == "read" if name in READ else said.startswith("refused: ")
    assert seconds < SECONDS
    assert peak < MEMORY_MIB
    assert len(said) < 320
