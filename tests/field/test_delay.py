"""The flow delay of drawn logs: near the true one, or not known."""

import numpy as np
import pytest

pytest.importorskip("scipy")

from swath.documents.witness import Estimate, agreed
from swath.field_io.delay import estimate_delays, neighbour_pairs
from swath.field_io.logs.log import read_log
from tests.field.drawn_logs import draw


def errors(seeds, tmp_path):
    """Of each machine: error of its delay [s], nan = not known, and whether it has six turns or ends."""
    for seed in seeds:
        made = draw(seed)
        for delay in estimate_delays(read_log(made.write(tmp_path / "log.csv"))):
            yield seed, delay.seconds - made.delays[delay.machine], made.turns[delay.machine] >= 6


@pytest.mark.draws
def test_a_delay_is_right_or_not_known(tmp_path):
    found = list(errors(range(1000, 1040), tmp_path))
    assert not [(seed, error) for seed, error, _ in found if abs(error) > 2.0]
    shown = [error for _, error, is_shown in found if is_shown]
    assert len(shown) > 20
    assert np.mean(np.abs(np.nan_to_num(shown, nan=9.0)) < 0.5) >= 0.9


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ([], None),
        ([(3.0, 0.5)], (3.0, 0.5)),
        ([(3.0, 0.1), (3.4, 0.1)], (3.2, 0.1414)),  # the spread counts
        ([(24.0, 0.1), (0.0, 0.4), (0.0, 0.5)], None),
        ([(24.0, 9.0), (0.0, 0.4)], (0.0473, 0.752)),
    ],
)
def test_an_estimate_counts_where_its_parts_agree(parts, expected):
    found = agreed([Estimate(*part) for part in parts])
    assert (found and (found.value, found.error)) == (expected and pytest.approx(expected, rel=0.02))


@pytest.mark.parametrize("seed", [3, 11])
def test_a_pair_of_records_counts_once(seed, tmp_path):
    """Counted twice, a pass that is left out would still be there."""
    log = read_log(draw(seed).write(tmp_path / "log.csv"))
    first, second, _ = neighbour_pairs(log)
    pairs = {tuple(sorted(pair)) for pair in zip(first.tolist(), second.tolist(), strict=True)}
    assert len(pairs) == len(first) > 0
