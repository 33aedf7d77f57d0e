"""Two runs beside each other: what is named, the first difference, the page."""

from types import SimpleNamespace

import numpy as np
import pytest

import swath
from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.number_text import num
from swath.record.read.feed import unlike
from swath.tools.diff.compare import compare

SETS = {
    "run.distance_m": 2,
    "field.stand.stems_per_m2": 100,
    "combine.lidar": "off",
    "combine.edge.level": "truth",
    "combine.motion.start_speed_kmh": 7,
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    changes = {"a": {}, "again": {}, "slower": {"combine.speed.speed_kmh": 4}}
    for name, change in changes.items():
        swath.run("straight", folder / name, sets={**SETS, **change}, report=False)
    return folder


def test_equal_runs_have_the_same_digest(runs):
    found = compare(runs / "a", runs / "again")
    assert found.is_same
    assert found.headline == "same digest: a and again are equal to the last bit"
    assert (found.settings, found.differences, found.metrics) == ([], [], [])


def test_the_first_difference_is_where_the_change_acts(runs):
    found = compare(runs / "a", runs / "slower")
    assert found.settings == [("combine.speed.speed_kmh", "7", "4")]
    first = found.differences[0]
    assert (first.slot, first.what) == ("combine.speed.command", "speed")
    assert first.values[0] == num(7 / 3.6) == "1.94"
    slots = [d.slot for d in found.differences]
    assert slots.index("combine.speed.command") < slots.index("combine.motion.state")
    names = {row[0] for row in found.metrics}
    assert {"simulated_s", "mean_throughput_t_h"} & names
    assert "real_time_factor" not in names


@pytest.mark.drawn
def test_the_command_prints_and_writes_the_page(runs, capsys):
    assert main(["diff", str(runs / "a"), str(runs / "slower")]) == 0
    said = capsys.readouterr().out
    assert "combine.speed.speed_kmh" in said
    page = (runs / "slower" / "diff.html").read_text()
    assert "combine.speed.command" in page
    assert page.count("<img") == 2


def test_what_is_no_run_is_refused(runs, tmp_path):
    with pytest.raises(InputError, match=r"expected a run folder, it has no scenario.yaml"):
        compare(runs / "a", tmp_path)


def test_numbers_have_digits_that_tell_them_apart():
    from swath.tools.diff.compare import shown_value

    assert (shown_value(1 / 3, 0.5), shown_value(0.5, 1 / 3)) == ("0.333", "0.5")
    near = 0.1 + 0.2
    assert (shown_value(near, 0.3), shown_value(0.3, near)) == ("0.30000000000000004", "0.3")
    assert shown_value("straight", "curve") == "straight"
    assert shown_value(0.5, "-") == "0.5"


def test_a_changed_file_is_named(tmp_path):
    code = tmp_path / "mine.py"
    for name, factor in (("a", 1.0), ("again", 1.0), ("other", 1.001)):
        code.write_text(OWN_SPEED.format(factor=factor))
        sets = {**SETS, "combine.speed": {"level": f"{code}:Own"}}
        swath.run("straight", tmp_path / name, sets=sets, report=False, code=True)
    assert compare(tmp_path / "a", tmp_path / "again").settings == []
    (row,) = compare(tmp_path / "a", tmp_path / "other").settings
    assert row[0] == "contents of mine.py"
    assert len(set(row[1:])) == 2


OWN_SPEED = """
from swath.core.component import Port
from swath.signals import SpeedCommand


class Own:
    inputs = ()
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params, setup):
        pass

    def reset(self, stream):
        return {{"command": SpeedCommand(0, {factor})}}

    def step(self, t, dt, inputs):
        return {{"command": SpeedCommand(t, {factor})}}
"""


def test_blocks_that_are_alike_are_passed_over():
    def blocks(*data):
        return iter([("a_exact", 0, SimpleNamespace(data=np.array(d, np.uint8))) for d in data])

    found = unlike(blocks([1], [2, 3], [4], [5]), blocks([1], [2, 3], [4, 0], [6], [7]))
    assert [[list(block.data) for *_, block in one] for one in found] == [[[4], [5]], [[4, 0], [6], [7]]]
    assert [list(one) for one in unlike(blocks([1]), blocks([1], [2]))] == [[], []]
