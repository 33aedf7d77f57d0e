"""A part of control may end the run and say why; the summary carries its words."""

import pytest

from swath.runtime.job import run_job
from swath.scenario.scenario import parse_scenario

pytestmark = pytest.mark.usefixtures("code_allowed")

LEVEL = '''
from swath.control.edge.likelihood_ratio import LEVEL as BUILT_IN
from swath.core.schedule import NS


class GivesUp(BUILT_IN.component):
    """Finds the edge, and stops the machine after a second."""

    Params = BUILT_IN.params

    def end_reason(self, t):
        return "no edge that I would steer by" if t > NS else ""
'''
TEXT = """\
format: swath scenario 2
name: gives-up
run: {distance_m: 20}
field: {edge: {shape: straight}}
machines:
  combine: {lidar: {level: empirical}, edge: "gives_up.py:GivesUp"}
"""


def test_a_detector_ends_the_run(tmp_path):
    (tmp_path / "gives_up.py").write_text(LEVEL)
    summary = run_job(parse_scenario(TEXT, base=tmp_path), tmp_path / "run").summary
    assert 0.99 < summary["simulated_s"] < 1.05
    assert summary["incomplete"] is False
    (note,) = [n for n in summary["notes"] if "ended at" in n]
    assert note.endswith("combine.edge: no edge that I would steer by")
    assert summary["ended"] == {"reason": "other", "text": note}
