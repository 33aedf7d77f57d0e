"""What an error says of the value that was wrong, how long it gets, and that it survives a process pool."""

import errno
import importlib
import os
import pickle
import pkgutil
import re
import threading
from pathlib import Path

import pytest

import swath
from swath.core.errors import LONGEST, InputError, MissingExtra, SwathError, absence_of, capped, some_of
from swath.field_io.folder_files import read_info
from swath.runtime.folder import check_run_folder
from swath.scenario.reader import ScenarioError
from swath.scenario.scenario import find_scenario


def test_a_long_value_is_cut_and_a_path_is_not():
    text = str(InputError("name", "y" * 100 + "z" * 100, "expected less"))
    assert text.startswith("name = yyy")
    assert text.endswith("zz: expected less")
    assert "y...z" in text
    place = Path("/a") / ("x" * 90) / "b.fmu"
    assert str(InputError("file", place, "expected a file")) == f"file = {place}: expected a file"
    deep = "/" + "x/" * 300 + "end.fmu"
    assert str(InputError("file", deep)).startswith("file = /x/")
    assert str(InputError("file", deep)).endswith("x/end.fmu")


@pytest.mark.parametrize(
    "error",
    [
        InputError("k" * 5000, "v" * 5000, "e" * 5000, file="/f" * 2000, line=10**9),
        InputError("/k" * 5000, ["v"] * 5000, "e\0" * 5000),
        InputError("\0" * 5000, "\ud800" * 5000, "\n" * 5000, file="\0" * 5000),
        SwathError("a\n" * 5000),
        MissingExtra("geo", "x" * 5000),
    ],
)
def test_no_error_quotes_more_than_a_few_lines(error):
    assert 250 < len(str(error)) <= LONGEST
    assert str(error).isprintable()


def test_what_was_expected_keeps_its_hint_at_the_end():
    names = ", ".join(f"some-long-name-{i}" for i in range(100))
    assert str(InputError("level", "x", f"expected one of {names}, did you mean 'y'?")).endswith("mean 'y'?")


def _errors(kind: type[Exception] = SwathError) -> list[type[Exception]]:
    return [kind, *(e for sub in kind.__subclasses__() for e in _errors(sub))]


def _all_modules() -> None:
    for module in pkgutil.walk_packages(swath.__path__, "swath."):
        if "__main__" not in module.name and ".data." not in module.name:
            try:
                importlib.import_module(module.name)
            except (ImportError, SwathError):
                continue


def test_every_error_comes_back_from_a_worker_as_it_was():
    _all_modules()
    kinds = _errors()
    assert len(kinds) >= 8
    inputs = {"key": "crop.stems_per_m2", "value": -5, "expected": "expected > 0", "file": "field.yaml"}
    for kind in kinds:
        if issubclass(kind, ScenarioError):
            error = kind([InputError(**inputs), InputError("b")])
        elif issubclass(kind, InputError):
            error = kind(**inputs, line=3)
        else:
            error = kind("what is wrong")
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is kind
        assert str(again) == str(error)
        assert {k: str(v) for k, v in vars(again).items()} == {k: str(v) for k, v in vars(error).items()}


def test_a_value_that_cannot_be_pickled_becomes_its_text():
    again = pickle.loads(pickle.dumps(InputError("law", threading.Lock(), "expected a number")))
    assert "lock" in again.value
    assert again.expected == "expected a number"


def test_a_list_is_never_cut_within_a_name():
    """Whole names, those nearest to what was typed, and how many more."""
    names = [f"/robot/sensor_{k}/state" for k in range(60)] + ["/lidar/points", "/scan"]
    for key, value in (("topics", "/lidar/point"), ("topics", None), ("columns", ", ".join(names))):
        listed = ", ".join(f"{n} (PointCloud2)" if value is None else n for n in names)
        text = str(InputError(key, value, f"expected one of {listed}", file="/home/somebody/data/day.bag"))
        assert len(text) <= 300
        assert "..." not in text
        (count,) = re.findall(r"and (\d+) more \(/home", text)
        kept = text.rpartition("one of ")[2].partition(" and ")[0].split(", ")
        assert len(kept) + int(count) == len(names)
        assert {name.partition(" (")[0] for name in kept} <= set(names)
        if value == "/lidar/point":
            assert kept[0] == "/lidar/points"


def test_a_list_that_fits_stays_as_it_is():
    text = "expected one of a, b, c, d, e"
    assert str(InputError("key", "d", text)) == f"key = d: {text}"
    assert str(SwathError(text)) == text


def test_a_list_that_is_cut_says_how_many_more_there_are():
    names = [f"n{k}" for k in range(7)]
    assert some_of(names, 7) == "n0, n1, n2, n3, n4, n5, n6"
    assert some_of(iter(names), 2, " + ") == "n0 + n1 and 5 more"
    assert capped(names, 2) == ["n0", "n1", "and 5 more"]
    assert capped(names[:2], 2) == ["n0", "n1"]


def test_a_list_that_is_cut_twice_counts_once():
    names = [f"combine.steer.command.c{k}" for k in range(90)]
    text = str(InputError("log.header", some_of(names, 60), "expected a column of time"))
    kept, _, rest = text.removeprefix("log.header = ").partition(" and ")
    count, _, rest = rest.partition(" more")
    assert len(kept.split(", ")) + int(count) == len(names)
    assert rest == ": expected a column of time"


def test_a_folder_that_may_not_be_entered_is_why_nothing_is_found(tmp_path, monkeypatch):
    closed, usual = tmp_path / "closed", os.stat

    def stat(path, **how):
        if str(path).startswith(f"{closed}/"):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return usual(path, **how)

    monkeypatch.setattr(os, "stat", stat)
    assert absence_of(closed / "a", "there is none") == "Permission denied"
    assert absence_of(tmp_path / "a", "there is none") == "there is none"
    for find in (find_scenario, check_run_folder, lambda path: read_info(path, dict)):
        with pytest.raises(InputError, match="Permission denied"):
            find(closed / "a.yaml")
