"""Results stay what they are, to the bit (tests/proof/proof.py)."""

import itertools
import json
import re

import pytest

from tests.proof.proof import differences, kept, made, stored, stored_rows

ROWS = stored_rows()


@pytest.mark.parametrize("name", ROWS)
def test_a_row_is_what_it_was(name):
    said = [*itertools.islice(differences(stored(name), kept(made(ROWS[name]))), 20)]
    assert not said, f"python -m tests.proof.proof '{name}' prints it:\n" + "\n".join(said)


def test_rows_are_numbers_and_no_two_the_same():
    texts = {name: json.dumps(found) for name in ROWS if not isinstance(found := stored(name), str)}
    assert not [name for name, text in texts.items() if re.search(r'"[0-9a-f]{16,}"', text)]
    assert len({*texts.values()}) == len(texts) > 20


def test_a_difference_says_what_was_when_to_the_last_bit():
    was = {"combine": {"t_s": [0.0, 0.02], "x_m": [1.0, 0.3], "seen": [[1.0], [2.0, float("nan")]]}, "n": 1}
    for change, said in (
        ({"x_m": [1.0, 0.1 + 0.2]}, "combine/x_m at 0.02 s: was 0.3, is 0.30000000000000004"),
        ({"seen": [[1.0], [2.0, 3.0]]}, "combine/seen at 0.02 s[1]: was nan, is 3.0"),
        ({"seen": [[1.0], [2.0]]}, "combine/seen at 0.02 s: had 2 values, has 1"),
        ({"x_m": [1, 0.3]}, "combine/x_m at 0 s: was 1.0, is 1"),
        ({"y_m": [0.0, 0.0]}, "combine/y_m: was (nothing), is [0.0, 0.0]"),
    ):
        assert [*differences(was, {**was, "combine": {**was["combine"], **change}})] == [said]
    assert not [*differences(was, json.loads(json.dumps(was)))]
    all_new = {**was, "combine": {**was["combine"], "x_m": [0.0, 0.0]}}
    first = "combine/x_m at 0 s: was 1.0, is 0.0"
    assert [*differences(was, all_new)] == [first, "combine/x_m: and 1 more of 2"]


def test_what_is_kept_is_the_begin_and_the_end():
    times = [0.02 * k for k in range(200)]
    found = kept({"tracks": [{"t_s": times, "x_m": times}], "summary": {"figures": times}})
    assert found["summary"]["figures"] == times
    (table,) = found["tracks"]
    assert table["x_m"] == table["t_s"] == times[:6] + times[-25:]
