"""`swath test estimate`: rare failures of known probability, what is refused, the same however interrupted.

Coverage is asked of so many repeats that a right interval of 95 % fails with the stated chance.
"""

import json
from math import factorial, sqrt
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from scipy.special import ndtr, ndtri
from scipy.stats import binom

from swath.commands.main import main
from swath.core.errors import InputError
from swath.tools.function_test.case import Varied
from swath.tools.function_test.estimate import Estimate, distribution_of, open_estimate, run_estimate
from swath.tools.function_test.journal import Journal, read_journals
from swath.tools.function_test.judged import UNJUDGED
from swath.tools.function_test.one_run import no_result
from swath.tools.function_test.rare import Hunt, effective, exposure, fit, log_exposure, rate_of, tempered

CASE = """
format: swath test case 1
objective: keeps an analytic limit
source: made
scenario: straight
set: {"field.edge.gaps": [{start_m: 20, end_m: 22, depth_m: 1}]}
vary:
  end_m: {key: field.edge.gaps.0.end_m, at: [22], range: [21, 31]}
  stems: {key: field.stand.stems_per_m2, at: [400], range: [100, 600]}
expect: {edge_rmse_m: {max: 0.3}}
"""
RARE = 1e-4
SIDE = sqrt(2 * RARE)  # of the corner in which the two shares add up to more than 2 - SIDE: RARE of the square


@pytest.fixture
def case_file(tmp_path):
    path = tmp_path / "analytic.yaml"
    path.write_text(CASE, encoding="utf-8")
    return path


class Formula:
    """Instead of runs: a limit of 0.3 that is broken where both shares of the ranges add up to more.

    shift: by which a run with fewer stubble, the cheap level here, is nearer to it; stop: after so many
    """

    def __init__(self, side=SIDE, shift=0.0, stop=None, verdict=None):
        self.side, self.shift, self.stop, self.verdict, self.done = side, shift, stop, verdict, 0

    def __call__(self, runs, folder, workers, done):
        journal = Journal(folder, "here")
        try:
            for run in runs:
                if self.done == self.stop:
                    raise KeyboardInterrupt
                self.done += 1
                result = self.result(run)
                journal.add(result)
                done(result)
        finally:
            journal.close()

    def result(self, run):
        shares = (run.point["end_m"] - 21) / 10, (run.point["stems"] - 100) / 500
        is_cheap = any("stubble_height_m" in text for text in run.sets)
        value = 0.3 * (1 + sum(shares) - 2 + self.side + (self.shift if is_cheap else 0.0))
        entry = {"subject": "combine", "name": "edge_rmse_m", "limit": {"max": 0.3}, "value": value,
                 "result": "fail" if value > 0.3 else "pass"}  # fmt: skip
        known = {"metrics": {"edge_rmse_m": value}, "expect": [entry], "digest": f"{value}"}
        found = {**no_result(run, ""), "verdict": entry["result"], "reason": "too far", **known}
        return found if self.verdict is None else self.verdict(run, found)


@pytest.fixture
def runs(monkeypatch):
    """Sets what a run comes to."""

    def set_to(formula):
        monkeypatch.setattr("swath.tools.function_test.session.run_all", formula)
        return formula

    return set_to


def none(result):
    """For each new result."""


def half_space(d, rare):
    return lambda z: (-ndtri(rare) - z.sum(axis=1) / sqrt(d)) / 4


def simplex(d, rare):
    return lambda z: d - (rare * factorial(d)) ** (1 / d) - ndtr(z).sum(axis=1)


def corner(d, rare):
    return lambda z: 1 - rare ** (1 / d) - ndtr(z).min(axis=1)


def two_sides(d, rare):
    return lambda z: np.minimum(-ndtri(0.7 * rare) - z[:, 0], -ndtri(0.3 * rare) + z[:, 0]) / 4


def estimated(margin, d, budget, seed):
    hunt = Hunt(d, budget // 2)
    while hunt.left:
        places = hunt.next(np.random.default_rng([seed, hunt.left]))
        hunt.tell(places, np.clip(margin(places), -1, 1))
    rng = np.random.default_rng([seed, 0])
    density = hunt.last(rng)
    places = density.draw(rng, budget - budget // 2)
    return rate_of(np.exp(log_exposure(places) - density.log_density(places)), margin(places) < 0.0)


@pytest.mark.parametrize(
    ("shape", "d"), [(half_space, 2), (half_space, 6), (simplex, 2), (corner, 2), (two_sides, 2)]
)
def test_the_interval_covers_a_known_probability(shape, d):
    """25 repeats; fewer than 20 of a right interval are inside with a chance of 0.7 %."""
    assert binom.cdf(19, 25, 0.95) < 0.01
    found = [estimated(shape(d, RARE), d, 2000, seed) for seed in range(25)]
    assert sum(rate.low <= RARE <= rate.high for rate in found) >= 20
    assert np.median([rate.half_width for rate in found]) < 0.25
    assert np.mean([rate.value for rate in found]) == pytest.approx(RARE, rel=0.1)
