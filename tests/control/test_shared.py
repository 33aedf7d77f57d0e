"""What detectors share of a scan: done once for all that ask the same, never where it cannot be told."""

import numpy as np

from swath.control.edge.height_step import Gates, find_step
from swath.control.edge.max_likelihood import split_by_likelihood
from swath.control.edge.profile import Profile
from swath.control.edge.shared import KEPT, shared


def test_a_result_is_worked_out_once_while_it_is_kept():
    done = []

    @shared(lambda x: None if x < 0 else x)
    def twice(x):
        done.append(x)
        return 2 * x

    assert [twice(3), twice(3), twice(4), twice(-1), twice(-1)] == [6, 6, 8, -2, -2]
    assert done == [3, 4, -1, -1]
    for x in range(100, 100 + KEPT):
        twice(x)
    assert twice(3) == 6
    assert done.count(3) == 2


def test_a_split_rule_with_a_memory_is_asked_every_time():
    u = np.linspace(-2.0, 2.0, 60)
    z = np.where(u > 0.3, 0.8, 0.1) + 0.02 * np.sin(40.0 * u)
    profile = Profile(np.full(60, 8.0), u, z, (3.0, 0.0, 2.5))
    asked = []

    class Rule:
        def split(self, z, min_points):
            asked.append(len(z))
            return split_by_likelihood(z, min_points)

    steps = [find_step(profile, None, 0.0, rule, Gates()) for rule in 2 * [Rule().split]]
    count = len(asked)
    assert count == 4  # two splits each
    plain = find_step(profile, None, 0.0, split_by_likelihood, Gates())
    assert [step.u for step in steps] == 2 * [plain.u]
    assert find_step(profile, None, 0.0, split_by_likelihood, Gates()) is plain
    other = Profile(profile.x, u + 0.1, z, profile.sensor)
    assert find_step(other, None, 0.0, split_by_likelihood, Gates()).u != plain.u
