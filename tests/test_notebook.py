"""What a notebook does: a class of its own as a level, a scan, a run, a field, and what is shown of them."""

import json
from pathlib import Path

import nbclient
import nbformat
import pytest

import swath
from swath.core.errors import InputError

CELL = """
from swath.core.component import Port
from swath.signals import SteerCommand


class Straight:
    \'\'\'Wheels straight ahead.\'\'\'

    inputs = ()
    outputs = (Port("command", SteerCommand),)

    def __init__(self, params, setup):
        self.calls = 0

    def reset(self, rng):
        self.calls = 0
        return {"command": SteerCommand(0, 0.0, True)}

    def step(self, t, dt, inputs):
        self.calls += 1
        return {"command": SteerCommand(t + dt, 0.0, True)}

    def save(self):
        return {}

    def load(self, state):
        pass
"""
SETS = {"run.distance_m": 3, "combine.lidar.level": "empirical", "combine.edge": "truth"}


@pytest.mark.drawn
def test_a_class_of_a_cell_is_a_level_of_a_run(tmp_path):
    cell = {"__name__": "__main__"}
    exec(CELL, cell)
    result = swath.run(
        "straight", tmp_path / "r", sets={**SETS, "combine.steer": cell["Straight"]}, report=False
    )
    assert "here:Straight" in (tmp_path / "r" / "scenario.yaml").read_text()
    shown = result._repr_html_()
    assert "lateral_rms_m" in shown
    assert "data:image/svg+xml;base64," in shown


@pytest.mark.drawn
def test_scan_and_scenario_are_shown(tmp_path):
    made = swath.scan("straight", tmp_path / "s", sets={"combine.lidar.level": "empirical"})
    assert made.data
    assert "data:image/png;base64," in made._repr_html_()
    assert "single_track" in swath.load_scenario("straight")._repr_html_()


def test_an_error_is_a_line_not_frames():
    with pytest.raises(InputError) as caught:
        swath.load_scenario("straight", sets={"combine.lidar.rate_hz": -1, "run.distance_m": "far"})
    lines = caught.value._render_traceback_()
    assert len(lines) == 2
    assert all("expected" in line for line in lines)


@pytest.mark.draws
def test_the_notebook_of_the_examples_runs_in_a_kernel(tmp_path):
    """Its scan, run and plot are shown, and its law holds the header end near the line."""
    book = nbformat.read(Path(__file__).parents[1] / "examples" / "notebook.ipynb", as_version=4)
    where = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(book, timeout=600, startup_timeout=600, resources=where).execute()
    shown = [out.get("data", {}) for cell in book.cells for out in cell.get("outputs", [])]
    scan, run, plot = (data for data in shown if data)
    assert "data:image/png;base64," in scan["text/html"]
    assert "lateral_rms_m" in run["text/html"]
    assert "image/png" in plot
    (summary,) = tmp_path.glob("runs/*/summary.json")
    assert json.loads(summary.read_text())["lateral_rms_m"] < 0.05
