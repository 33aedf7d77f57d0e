"""What is heavy is imported where it is used: `swath --help` and the like start quickly."""

import subprocess
import sys

import pytest

ALWAYS_LATE = {"warp", "matplotlib", "pyarrow", "rosbags", "mujoco", "rasterio", "rclpy", "scipy", "jinja2"}
STARTS = {  # what is done -> packages that it does without
    "import swath": {"numpy", "pydantic", "ruamel", "rich", "argparse", "swath.core"},
    "import swath.commands.main as m; m.main(['--help'])": {"numpy", "pydantic", "ruamel", "rich"},
    "import swath.commands.main as m; m.main(['scenarios'])": {"numpy", "swath.scenario", "swath.field"},
    "import swath; swath.load_scenario('straight')": {"swath.field_io", "swath.link", "multiprocessing.pool"},
}


@pytest.mark.parametrize("start", STARTS)
def test_a_start_does_without(start):
    code = f"import sys\ntry:\n {start}\nexcept SystemExit: pass\nprint('\\n' + ' '.join(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.splitlines()[-1].split())
    assert "swath" in loaded
    assert sorted(loaded & (ALWAYS_LATE | STARTS[start])) == []
