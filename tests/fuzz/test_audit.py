"""What parsers of files make happen, seen by a hook; for long: `python -m tests.fuzz.audit --cases 100`."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
KINDS = {  # by the package that reads; not laz, whose reader ends its process
    "asammdf": "mf4-conversions,mf4-odd,mf4-frames",
    "can": "frames-blf,frames-asc",
    "rosbags": "bag-mcap,bag-sqlite,bag-ros1,bag-packed",
    "rasterio": "geotiff",
    "trimesh": "mesh-glb,mesh-obj",
    "laspy": "cloud-las",
    "fmpy": "fmu",
}
ACTS = {
    "eval": "eval('1 + 1')",
    "exec": "exec('x = 1')",
    "a formula by numexpr": "import numexpr; numexpr.evaluate('1.5 + 1.5')",
    "an expression by sympy's way": "compile('1', '<lambdifygenerated-1>', 'eval')",
    "os.system": "import os; os.system('true')",
    "subprocess": "import subprocess; subprocess.run(['true'])",
    "open": "open('made', 'w')",
    "os.open": "import os; os.open('made', os.O_WRONLY | os.O_CREAT)",
    "connect": "import socket; socket.socket().connect_ex(('127.0.0.1', 9))",
}


@pytest.mark.parametrize("act", ACTS)
def test_the_hook_sees(act, tmp_path):
    lines = ["from tests.fuzz.audit import Hook", "hook = Hook()", "hook.is_on = True", ACTS[act]]
    code = "\n".join([*lines, "hook.is_on = False", "print(len(hook.seen))"])
    own = tmp_path / "acts.py"  # code in a file: what it does is not the hook's own compiling
    own.write_text(code)
    ran = subprocess.run([sys.executable, own], cwd=tmp_path, env={"PYTHONPATH": f"{ROOT}:{ROOT / 'src'}"},
                         capture_output=True, text=True, check=True)  # fmt: skip
    assert int(ran.stdout) >= 1


@pytest.mark.draws
def test_nothing_that_a_file_says_acts():
    kinds = ",".join(kinds for package, kinds in KINDS.items() if find_spec(package))
    assert kinds
    ran = subprocess.run(
        [sys.executable, "-m", "tests.fuzz.audit", "--cases", "2", "--kinds", kinds],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stdout[-2000:] + ran.stderr[-2000:]
