"""The tutorials, from their own text, in an empty folder: files saved, commands run, what is shown came out.

tests/typed_tutorial.py uses a page. Only packages of swath itself and of the extras that the page tells to
install can be imported. Each line of a listing in `text` is in what the commands above printed.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from docs.make.typed import write_hiding

from tests.typed_tutorial import listings

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
NEEDS = {
    "my-edge-detector": "optuna",
    "my-field": "rasterio",
    "my-network": "onnxruntime",
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


@pytest.mark.draws
@pytest.mark.parametrize(
    "page", [page for page in PAGES if page.stem not in ELSEWHERE], ids=lambda page: page.stem
)
def test_a_tutorial(page, tmp_path):
    if module := NEEDS.get(page.stem):
        pytest.importorskip(module)
    text = page.read_text(encoding="utf-8")
    folder, hiding, out = (tmp_path / name for name in ("empty", "hiding", "out"))
    for made in (folder, hiding, out):
        made.mkdir()
    write_hiding(hiding, text)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    imports = os.pathsep.join(filter(None, [str(hiding), str(ROOT), os.environ.get("PYTHONPATH", "")]))
    environment = {**os.environ, "PATH": path, "PYTHONPATH": imports, "MPLBACKEND": "agg"}
    command = [sys.executable, "-m", "tests.typed_tutorial", str(page), str(out)]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    said = {int(file.stem): file.read_text(encoding="utf-8") for file in out.iterdir()}
    assert done.returncode == 0, done.stderr + "\n".join(said[k] for k in sorted(said))
    assert said
    printed = ""
    for number, (language, content, _) in enumerate(listings(text)):
        printed += said.get(number, "")
        if language == "text":
            missing = [line for line in content.splitlines() if squeezed(line) not in squeezed(printed)]
            assert missing == [], printed
            printed = ""


def squeezed(text):
    return " ".join(text.split())
