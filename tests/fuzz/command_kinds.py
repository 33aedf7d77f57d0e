"""Command lines over files of every kind: the words of the line are damaged as the files are."""

import io
import os
import shutil
from collections.abc import Callable
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

from tests.fuzz.kind import Kind, bundled, written

LINE = "command.args"  # the words of a command line, one on each line
MISTAKE = 70
TOPICS = ("/scan", "/odom")
ALONE = {"--workers": "1", "--threads": "1"}  # what would take the machine, whatever the damage says


def command(make: Callable[[Path], Any], *words: str) -> Kind:
    """A command line over the files that `make` writes."""

    def both(folder: Path) -> None:
        make(folder)
        (folder / LINE).write_text("\n".join(words) + "\n")

    return Kind(both, lambda folder: run(folder, (folder / LINE).read_bytes()))


def run(folder: Path, line: bytes) -> None:
    """Run a command line in a folder. AssertionError where it calls itself a mistake of swath."""
    from swath.commands.main import main
    from swath.core.errors import InputError

    words = [_harmless(word) for word in line.decode(errors="replace").split("\n")[:-1]]
    for flag, value in ALONE.items():
        words = [value if i and words[i - 1] == flag else word for i, word in enumerate(words)]
    said, errors = io.StringIO(), io.StringIO()
    with _within(folder), redirect_stdout(said), redirect_stderr(errors), _no_pictures():
        try:
            code: Any = main(words)
        except SystemExit as stop:  # --help, --version
            code = stop.code
    assert code != MISTAKE, errors.getvalue()[-400:]
    assert "Traceback" not in errors.getvalue()
    if code == 2:
        raise InputError("command line", None, errors.getvalue()[-200:])


def _harmless(word: str) -> str:
    """No word leads out of the folder, or to a command that serves until it is stopped."""
    outside = (word.startswith(("/", "~")) and word not in TOPICS) or "=/" in word or ".." in word
    return "x" if outside or word in ("play", "box", "listen", "--live", "--ros2") else word


@contextmanager
def _within(folder: Path) -> Any:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


@contextmanager
def _no_pictures() -> Any:
    """Seconds of matplotlib are not what is tried here."""
    image = patch("swath.fleet.report.plots.as_image", return_value="")
    with patch("swath.field_io.importer.draw"), patch("swath.fleet.report._drawn", create=True), image:
        yield


def _run_folder(*names: str) -> Callable[[Path], Any]:
    """Run folders of two metres of a bundled scenario."""

    def make(folder: Path) -> None:
        if not (folder.parent / "a-run").is_dir():
            line = ["run", "straight", "--set", "run.distance_m=2", "--out", "../a-run", "--quiet"]
            from swath.commands.main import main

            with _within(folder), redirect_stdout(io.StringIO()):
                assert main(line) in (0, 1, 3)
        for name in names:
            shutil.copytree(folder.parent / "a-run", folder / name)

    return make


def _field_and_dem(folder: Path) -> None:
    import numpy as np

    from swath.field.maps.raster import Raster
    from tests.fuzz.abroad_kinds import KML

    (folder / "b.kml").write_text(KML)
    y, x = np.mgrid[0:120, 0:80] * 10.0
    values = (100.0 + 0.01 * x + 0.02 * y).astype(np.float32)
    Raster(values, 499_700.0, 5_760_900.0, 10.0, 32632).to_geotiff(folder / "d.tif", 32632, unit="m")


def _two_machines(folder: Path) -> None:
    from tests.tools.test_compare_log import write_log

    write_log(folder / "log.csv", count=60)


def kinds(known: dict[str, Kind]) -> dict[str, Kind]:
    """Command lines over the files of the kinds that are known."""
    out, run_1 = ("--out", "out"), _run_folder("run")
    of = {name: kind.make for name, kind in known.items()}
    short = ("--set", "run.distance_m=1", "--out", "out", "--quiet")
    lines: dict[str, tuple[Callable[[Path], Any], tuple[str, ...]]] = {
        "import": (of["log-import"], ("field", "import", "log.csv", "--columns", "map.yaml", *out)),
        "import-zip": (
            of["log-shapefile"], ("field", "import", "log.zip", "--as", "map", "--header-width-m", "6", *out)
        ),
        "import-task": (of["task-plan"], ("field", "import", "log", *out)),
        "import-dem": (
            _field_and_dem, ("field", "import", "b.kml", "--dem", "d.tif", "--header-width-m", "9", *out)
        ),
        "show": (of["field-folder"], ("field", "show", "field")),
        "fleet": (of["job"], ("fleet", "run", "mine.yaml", *out)),
        "sheets": (of["sheet-lidar"], ("sheets", "check", "mine.yaml")),
        "fmu": (of["fmu"], ("fmu", "show", "model.fmu", "--all")),
        "ssp": (of["ssp"], ("fmu", "show", "model.ssp")),
        "height-map": (
            of["scans-csv"], ("height-map", "build", "s.csv", "--poses", "poses.csv", "--out", "g.npz")
        ),
        "height-map-bag": (
            of["bag-mcap"],
            ("height-map", "build", "b", "--scans", TOPICS[0], "--poses", TOPICS[1], "--out", "g.npz"),
        ),
        "test-plan": (of["test-case"], ("test", "run", "mine.yaml", "--plan-only", *out)),
        "compare": (of["log-engine"], ("compare", "log", "lexion-700", "log.csv")),
        "calibrate": (
            _two_machines, ("calibrate", "engine", "lexion-700", "log.csv", "--out", "engine.yaml")
        ),
        "view": (run_1, ("view", "run")),
        "report": (run_1, ("report", "run")),
        "diff": (_run_folder("run", "other"), ("diff", "run", "other", "--out", "d.html")),
        "yield-log": (run_1, ("yield-log", "run", "--out", "y.csv")),
        "osi": (run_1, ("osi", "run", "--out", "x.osi")),
        "part": (
            of["part-table"], ("part", "combine.steer", "--input", "in.csv", "--scenario", "straight", *out)
        ),
        "rerun": (run_1, ("rerun", "run", "--slots", "combine.lidar", "--out", "out", "--quiet")),
        "branch": (run_1, ("branch", "run", "--at", "0.5", "--set", "combine.speed.speed_kmh=3", *out)),
        "run": (of["scenario-straight"], ("run", "mine.yaml", *short)),
        "scan": (of["scenario-straight"], ("scan", "mine.yaml", "--out", "out")),
        "words": (written("x", ""), ("levels", "lidar")),
        "new": (written("x", ""), ("new", "scenario", "mine.yaml")),
        "levels": (bundled("sensors", "sick-lms111"), ("metrics", "edge_rmse_m")),
        "jobs": (written("x", ""), ("fleet", "list", "small-field")),
    }  # fmt: skip
    return {f"command-{name}": command(make, *words) for name, (make, words) in lines.items()}
