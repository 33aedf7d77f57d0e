"""Some of the edits of tests/fuzz/folders.py, read in this process; that does all, by command."""

import os

import pytest

from swath.core.errors import SwathError
from swath.tools.function_test.journal import read_table
from swath.tools.function_test.session import begin, open_session
from swath.tools.function_test.stored_line import read_line
from tests.fuzz.folders import Folders, command, verdict

EDITS = 24


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    return Folders(tmp_path_factory.mktemp("folders"))


@pytest.mark.draws
def test_an_edited_folder_of_results_is_read_or_refused(folders, capfd):
    ended = {"taken": 0, "refused": 0}
    for number in range(EDITS):
        place, _, what = folders.edited("campaign", number)
        before = os.getcwd()
        os.chdir(place)
        try:
            session = open_session(place / "campaign")
            begun = begin(place / "campaign", session.plan)
            assert len(list(begun.left())) + len(begun.results()) == 4, what
            begun.cells()
            read_table(begun.table())
            ended["taken"] += 1
        except (SwathError, OSError):
            ended["refused"] += 1
        except Exception as error:
            raise AssertionError(f"{number}, {what}: {error}") from error
        finally:
            os.chdir(before)
    assert min(ended.values()) > EDITS // 5, ended


@pytest.mark.parametrize("number", [0, 3])
def test_a_command_goes_on_with_an_edited_folder_or_refuses_it(folders, number):
    place, line, what = folders.edited("campaign", number)
    ended = command(place, line)
    assert verdict(*ended) in ("taken", "refused"), (what, line, ended)


LINE = (
    b'{"id": "00ff", "case": "a", "candidate": "b", "point": {"v": 4}, "seed": 1, "verdict": "pass", '
    b'"reason": "", "metrics": {"x": 1, "y": null}, "expect": [], "incidents": [], "digest": ""}'
)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b'"x": 1', b'"x": 1' + b"0" * 400),
        (b'"x": 1', b'"x": 1e999'),
        (b'"x": 1', b'"x": NaN'),
        (b'"x": 1', b'"x": "1"'),
        (b'"x": 1', b'"x": true'),
        (b'{"x": 1, "y": null}', b"null"),
        (b'"seed": 1', b'"seed": 1.5'),
        (b'"point": {"v": 4}', b'"point": {"v": [4]}'),
        (b'"expect": []', b'"expect": [{}]'),
        (b'"expect": []', b'"expect": ' + b"[" * 9000 + b"]" * 9000),
        (b'"verdict": "pass"', b'"verdict": "passed"'),
        (b'"digest": ""', b'"digest": "", "met": {"t_s": [0, 1], "distance_m": [0]}'),
        (b'"digest": ""', b'"digest": "", "met": {"t_s": [null], "distance_m": [0]}'),
        (b'"digest": ""', b'"digest": "", "steering": {"classes": [[1]], "squares": 0.0}'),
        (b'"digest": ""', b'"digest": "\xff"'),
        (b"}", b""),
    ],
)
def test_a_line_that_is_no_result(old, new):
    assert read_line(LINE)["metrics"] == {"x": 1, "y": None}
    assert read_line(LINE.replace(old, new)) is None
