"""The tutorials, from their own text, in an empty folder: files saved, commands run, what is shown came out.

Only packages of swath itself and of the extras that the page tells to install can be imported.

A listing in `yaml` or `python` is saved under the last name above it that ends in .yaml or .py; listings in
`sh` run in one shell after another; each line of a listing in `text` is in what the commands above printed.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from docs.make.typed import write_hiding

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
LISTING = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAME = re.compile(r"`([\w-]+\.(?:yaml|py))`")
NEEDS = {
    "my-field": "rasterio",
    "my-function-test": "scipy",
    "my-odd": "openodd",
    "my-simulink-model": "pythonfmu",
}
ELSEWHERE = {"my-ros2-node"}  # needs a ROS 2 domain: tests/link/test_ros2_tutorial.py


def test_each_tutorial_is_linked_and_tried():
    names = {page.stem for page in PAGES}
    listed = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert names == set(re.findall(r"^tutorials/([\w-]+)$", listed, re.MULTILINE))
    assert len(names - ELSEWHERE) >= 8


@pytest.mark.parametrize("page", [p for p in PAGES if p.stem not in ELSEWHERE], ids=lambda p: p.stem)
def test_a_tutorial(page, tmp_path):
    if module := NEEDS.get(page.stem):
        pytest.importorskip(module)
    text = page.read_text(encoding="utf-8")
    printed, commands, end = "", 0, 0
    folder, hiding = tmp_path / "empty", tmp_path / "hiding"
    folder.mkdir()
    hiding.mkdir()
    write_hiding(hiding, text)
    for found in LISTING.finditer(text):
        language, content = found.groups()
        if language == "sh":
            printed += run(content, folder, hiding)
            commands += 1
        elif language == "text":
            missing = [line for line in content.splitlines() if squeezed(line) not in squeezed(printed)]
            assert missing == [], printed
            printed = ""
        else:
            (folder / NAME.findall(text[end : found.start()])[-1]).write_text(content, encoding="utf-8")
        end = found.end()
    assert commands > 0


def run(commands, folder, hiding):
    """What a shell prints; it stops at the first command that fails."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    imports = os.pathsep.join(filter(None, [str(hiding), os.environ.get("PYTHONPATH", "")]))
    environment = {**os.environ, "PATH": path, "PYTHONPATH": imports, "MPLBACKEND": "agg"}
    shell = ["bash", "-e", "-o", "pipefail", "-c", commands]
    done = subprocess.run(
        shell, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


def squeezed(text):
    return " ".join(text.split())
