"""The commands of docs/tutorials/my-ros2-node.md, as they stand there."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from swath.record.tracks import read_tracks
from tests.house.extended import finite
from tests.link.ros2_rig import LEAKS, domain, needs_ros2  # noqa: F401

pytestmark = needs_ros2
ROOT = Path(__file__).parents[2]


def commands():
    text = (ROOT / "docs" / "tutorials" / "my-ros2-node.md").read_text(encoding="utf-8")
    return "".join(re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL))


@pytest.mark.draws
def test_the_tutorial_does_what_it_says(domain, tmp_path):  # noqa: F811
    environment = {k: v for k, v in os.environ.items() if k not in LEAKS}
    environment["PATH"] = f"{Path(sys.executable).parent}:{environment['PATH']}"
    log = tmp_path / "log"
    with log.open("w") as said:
        shell = subprocess.Popen(
            ["bash", "-c", "set -m\n" + commands()],
            cwd=tmp_path,
            env=environment,
            stdout=said,
            stderr=said,
            start_new_session=True,
        )
        try:
            code = shell.wait(200)
        finally:
            shell.kill()
    assert code == 0, log.read_text()
    assert "messages of runs/my-detector/run.mcap" in log.read_text()
    told = [
        finite(read_tracks(tmp_path / "runs" / name / "tracks.parquet")["edge_offset_m"]).size
        for name in ("my-detector", "template")
    ]
    own, template = (
        json.loads((tmp_path / "runs" / name / "summary.json").read_text())
        for name in ("my-detector", "template")
    )
    assert own["simulated_s"] == template["simulated_s"] == 3.0
    assert own["cost"]["combine.edge"]["steps"] == template["cost"]["combine.edge"]["steps"]
    assert told[0] == told[1] > 50
