"""Results stay what they are, bit by bit (tests/proof/proof.py)."""

import pytest

from tests.proof.proof import QUICK, chosen, stored, value_of

ROWS, STORED = chosen(QUICK), stored()


@pytest.mark.parametrize("name", ROWS)
def test_a_row_is_what_it_was(name):
    assert value_of(ROWS[name]) == STORED[name], f"python -m tests.proof.proof --show '{name}' prints it"
