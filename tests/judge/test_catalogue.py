"""What is derived from the evaluators' declarations, and a user's own evaluator."""

import subprocess
import sys
from pathlib import Path

import pytest
from docs.make.metrics import BEGIN, END

from swath.commands.main import main
from swath.core.errors import InputError
from swath.judge.catalogue import GROUPS, load_evaluators
from swath.scenario.scenario import load_scenario, parse_scenario

pytestmark = pytest.mark.usefixtures("code_allowed")

ROOT = Path(__file__).parents[2]
OWN = ROOT / "examples" / "my_evaluator.py"
NAME = "steering_reversals_per_100_m"


def test_the_page_of_metrics_is_up_to_date():
    page = (ROOT / "docs" / "reference" / "metrics.md").read_text(encoding="utf-8")
    made = page.partition(BEGIN)[2].partition(END)[0]
    code = "from docs.make.metrics import *; print(markdown(CATALOGUE.judged()), end='')"
    # in a process of its own, as other tests declare signals with columns of theirs
    fresh = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert made == fresh.stdout, "run: python -m docs.make.metrics"


def test_every_metric_says_what_lists_and_reports_need():
    for metric in load_evaluators().metrics.values():
        assert metric.group in GROUPS
        assert len(metric.meaning) > 8
        assert metric.name.islower()


def test_the_command_explains_metrics(capsys):
    assert main(["metrics", "lateral_p95_m"]) == 0
    assert "95th percentile" in capsys.readouterr().out
    assert main(["metrics"]) == 0
    assert "edge_lost" in capsys.readouterr().out
    assert main(["metrics", "lateral_p59_m"]) == 2
    assert "did you mean 'lateral_p95_m'" in capsys.readouterr().err


def test_a_metric_of_the_users_own_takes_one_file(tmp_path):
    """The example alone: no other file of examples, docs or source names its metric."""
    folders = [ROOT / "src", ROOT / "examples"]
    found = [f for folder in folders for f in folder.rglob("*.py") if NAME in f.read_text(encoding="utf-8")]
    assert found == [OWN]
    scenario = load_scenario(
        "straight", sets=[f"evaluators=[{OWN}:SteeringReversals]", f"expect.{NAME}={{max: 500}}"]
    )
    assert scenario.expect[-1].name == NAME
    assert parse_scenario(scenario.resolved()) == scenario


def test_an_evaluator_that_cannot_work_is_refused(tmp_path):
    (tmp_path / "own.py").write_text(
        "class Bare:\n    pass\n\n\n"
        "from swath.judge.evaluators.driving import Driving\n\n\nclass Twice(Driving):\n    pass\n"
    )
    for name, what in (
        ("Bare", "; expected a class as in examples/my_evaluator.py"),
        ("Twice", "distance_m exists"),
        ("No", "has no No"),
    ):
        with pytest.raises(InputError) as error:
            load_scenario("straight", sets=[f"evaluators=[{tmp_path / 'own.py'}:{name}]"])
        assert what in str(error.value)
