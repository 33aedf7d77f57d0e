"""What is heavy is imported where it is used: `swath --help` and the like start quickly. What scripts that no
test runs import is there.
"""

import ast
import importlib
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPTS = sorted(p for name in ("benchmarks", "docs") for p in (ROOT / name).rglob("*.py"))

ALWAYS_LATE = {"warp", "matplotlib", "pyarrow", "rosbags", "mujoco", "rasterio", "rclpy", "scipy", "jinja2"}
STARTS = {  # what is done -> packages that it does without
    "import swath": {"numpy", "pydantic", "ruamel", "rich", "argparse", "swath.core"},
    "import swath.commands.main as m; m.main(['--help'])": {
        *("numpy", "pydantic", "ruamel", "rich", "subprocess", "ctypes", "pickle", "difflib")
    },
    "import swath.commands.main as m; m.main(['scenarios'])": {"numpy", "swath.scenario", "swath.field"},
    "import swath; swath.load_scenario('straight')": {"swath.field_io", "swath.link", "multiprocessing.pool"},
}


@pytest.mark.parametrize("start", STARTS)
def test_a_start_does_without(start):
    code = (
        f"import sys\nbefore = set(sys.modules)\ntry:\n {start}\nexcept SystemExit: pass\n"
        "print('\\n' + ' '.join(set(sys.modules) - before))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.splitlines()[-1].split())
    assert "swath" in loaded
    assert sorted(loaded & (ALWAYS_LATE | STARTS[start])) == []


def test_what_scripts_import_from_here_is_there():
    wanted = set()
    for script in SCRIPTS:
        for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] in ("swath", "tests", "docs"):
                wanted |= {(node.module, alias.name) for alias in node.names}
    missing = set()
    for module, name in wanted:
        try:
            found = importlib.import_module(module)
        except pytest.skip.Exception:  # it needs an extra
            continue
        if not hasattr(found, name) and not (hasattr(found, "__path__") and find_spec(f"{module}.{name}")):
            missing.add(f"{module}.{name}")
    assert len(wanted) > 100
    assert missing == set()
