"""The flow delay of drawn logs: near the true one, or not known."""

import numpy as np
import pytest

pytest.importorskip("scipy")

from swath.documents.witness import Estimate, agreed
from swath.field_io.delay import estimate_delays, neighbour_pairs
from swath.field_io.logs.log import read_log
from tests.field.drawn_logs import draw
from tests.field.made_log import COLUMNS, LENGTH, NORTH, MadeLog


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


@pytest.mark.parametrize(
    ("work_state", "is_zeroed", "expected"),
    [
        ("", False, 12.0),  # a quick sensor at a record a second
        ("always", False, 12.0),
        ("in the crop", False, 12.0),
        ("in the crop", True, 12.0),  # turns show half of it
        ("", True, np.nan),
        ("always", True, np.nan),
    ],
)
def test_turns_count_alone_unless_the_flow_ends_at_once(work_state, is_zeroed, expected, tmp_path):
    made = MadeLog(passes=12)
    for row in made.rows:
        is_in = -0.01 <= row["northing"] - NORTH <= LENGTH - 1.99
        row |= {"flow": row["flow"] * (is_in or not is_zeroed)}
        row |= {"state": str(int(is_in or work_state == "always"))} if work_state else {}
    columns = tmp_path / "columns.yaml"
    columns.write_text(COLUMNS + "work_state: {column: state, unit: text}\n" * bool(work_state))
    (delay,) = estimate_delays(read_log(made.write(tmp_path / "log.csv"), columns))
    assert delay.seconds == pytest.approx(expected, abs=0.6, nan_ok=True)
    assert bool(delay.doubt) == np.isnan(expected)
    assert delay.is_cut_off == (is_zeroed and bool(expected > 0.0))
