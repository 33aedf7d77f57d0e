"""Both ends of declared spans are taken or refused, never a mistake of swath: a part of all of them.

`python -m tests.spans.run` walks all, and random ends together.
"""

from random import Random

import pytest

from swath.core.errors import SwathError
from tests.spans import inputs, keys, sheets
from tests.spans.moment import moment

DRAWN_KEYS, DRAWN_SHEETS, TOGETHER = 14, 8, 3
HEAVY = ("camera", "lidar", "radar")
LEVELS = [pair for pair in inputs.levels() if pair[0] not in HEAVY]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("spans")
    keys.files(made)
    return made


def test_there_are_as_many_spans_as_levels_declare(folder):
    walked = {str(key) for key in keys.every_key()}
    assert len(walked) > 1300
    assert len({key.level for key in keys.every_key() if key.level}) > 60
    assert len(sheets.numbers()) > 2000


@pytest.mark.draws
@pytest.mark.parametrize(("slot", "level"), LEVELS, ids=[".".join(pair) for pair in LEVELS])
def test_a_level_takes_what_its_inputs_may_hold(slot, level, folder):
    part = inputs.alone(slot, level, folder)
    try:
        inputs.drive_some(part, inputs.spans(slot, level, part), Random(f"{slot} {level}"), TOGETHER)
    finally:
        part.world.close()


@pytest.mark.draws
@pytest.mark.parametrize("number", range(DRAWN_KEYS))
def test_keys_of_scenarios_at_their_ends(number, folder):
    rng = Random(number)
    key = rng.choice([k for k in keys.every_key() if k.is_quick])
    end = rng.choice(sorted(key.ends().values()))
    moment(key.scenario(end), folder)


@pytest.mark.draws
@pytest.mark.parametrize("number", range(DRAWN_SHEETS))
def test_numbers_of_data_sheets_at_their_limits(number, folder):
    drawn = Random(number).choice(sheets.numbers())
    try:
        scenario = drawn.scenario(folder)
    except SwathError:
        return
    moment(scenario, folder)
