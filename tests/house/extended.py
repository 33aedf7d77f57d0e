"""A copy of the package with something added, run in a process of its own."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from swath.record.tracks import read_tracks

SOURCE = Path(__file__).parents[2] / "src" / "swath"
SCENARIO = """
format: swath scenario 2
name: toy
seed: 3
run: {distance_m: 3, max_duration_s: 6}
field:
  terrain: plane
  stand: {level: uniform, stems_per_m2: 300}
  edge: {shape: straight}
machines:
  combine:
    motion: {start_speed_kmh: 7}
    lidar: {sub_rays: 3, sector_deg: [-40, 40], step_deg: 1.0}
"""
MAIN = """
import contextlib, io, json, sys
from swath.commands.main import main
for words in json.load(sys.stdin):
    with contextlib.redirect_stdout(io.StringIO()) as said:
        code = main(words)
    print(json.dumps([code, said.getvalue()]))
"""


class Extended:
    """The package in a folder of its own, to which files are added or in which they are changed."""

    def __init__(self, folder: Path):
        self.folder, self.package = folder, folder / "src" / "swath"
        # with the compiled files, which stay valid as times are kept, but none that is being written
        shutil.copytree(SOURCE, self.package, ignore=shutil.ignore_patterns("*.pyc.*"))

    def write(self, path, text):
        """Write a file of the package, new or anew."""
        file = self.package / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")

    def change(self, path, old, new):
        """Replace a piece of a file that is there once."""
        text = (self.package / path).read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{path}: {old!r} stands there {text.count(old)} times"
        self.write(path, text.replace(old, new))

    def touched(self):
        """Files of the package that are not what they were: new, changed or gone."""
        own, first = _files(self.package), _files(SOURCE)
        return {path for path in own.keys() | first.keys() if own.get(path) != first.get(path)}

    def commands(self, *lines):
        """Command lines of the copy, all in one process: (exit code, what it printed) of each."""
        done = subprocess.run(
            [sys.executable, "-c", MAIN],
            input=json.dumps([[str(word) for word in words] for words in lines]),
            env={**os.environ, "PYTHONPATH": str(self.package.parent)},
            cwd=self.folder,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return [json.loads(line) for line in done.stdout.splitlines()]


def _files(package):
    found = (p for p in package.rglob("*") if p.is_file() and "__pycache__" not in p.parts)
    return {str(p.relative_to(package)): p.read_bytes() for p in found}


def summary(out):
    return json.loads((out / "summary.json").read_text(encoding="utf-8"))


def columns(out):
    """Columns of the first machine's tracks."""
    return read_tracks(out / "tracks.parquet")


def messages(out, topic):
    """(schema name, decoded message) of all messages of a topic."""
    with (out / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [(m.schema.name, m.decoded_message) for m in reader.iter_decoded_messages(topics=[topic])]


def finite(values):
    values = np.asarray(values, dtype=float)
    return values[np.isfinite(values)]
