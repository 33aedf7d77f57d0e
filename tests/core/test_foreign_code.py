"""A user's Python files: each folder imports its own, as they are, or as they were where there are copies."""

import os

import pytest

from swath.core.foreign_code import Gate, load_python, through

PART = """
import helper
import pack.inner as inner
from pack import deep


def said():
    import lazy

    return helper.SAID, inner.SAID, deep.SAID, lazy.SAID
"""
NAMES = ("helper.py", "pack/__init__.py", "pack/inner.py", "pack/deep.py", "lazy.py")


def written(folder, said, package=True):
    (folder / "pack").mkdir(parents=True)
    (folder / "part.py").write_text(PART)
    for name in NAMES if package else [name for name in NAMES if "__init__" not in name]:
        of = (
            "import helper\nfrom pack import inner\nSAID = inner.SAID + helper.SAID\n"
            if "deep" in name
            else ""
        )
        (folder / name).write_text(of or f"SAID = {said!r}\n")
    return folder


def loaded(folder, copies=None):
    with through(Gate(files=None, copies=copies or {})):
        return load_python("key", folder / "part.py")


def all_said(text):
    return text, text, text + text, text


@pytest.mark.parametrize("package", [True, False])
def test_each_folder_imports_its_own(tmp_path, package):
    """Also where names are alike, and while it runs."""
    modules = {text: loaded(written(tmp_path / text, text, package)) for text in ("a", "b", "c")}
    for text in ("b", "c", "a"):
        assert modules[text].said() == all_said(text)


def test_parts_of_a_folder_share_what_they_import_until_it_is_edited(tmp_path):
    folder = written(tmp_path / "a", "a")
    first, second = loaded(folder), loaded(folder)
    assert first.helper is second.helper
    (folder / "helper.py").write_text("SAID = 'edited'\n")
    os.utime(folder / "helper.py", (1, 1))
    assert loaded(folder).said()[:3] == ("edited", "a", "aedited")
    assert first.said() == all_said("a")


@pytest.mark.parametrize("is_gone", [True, False])
def test_copies_are_read_in_the_place_of_files(tmp_path, is_gone):
    folder, kept = written(tmp_path / "a", "new"), written(tmp_path / "kept", "old")
    copies = {folder / name: kept / name for name in (*NAMES, "part.py")}
    now = loaded(folder)
    for name in (*NAMES, "part.py") if is_gone else ():
        (folder / name).unlink()
    module = loaded(folder, copies)
    assert module.said() == all_said("old")
    assert module.__file__ == str(folder / "part.py")  # data that lies beside it is found
    if not is_gone:
        assert now.said() == all_said("new")
        assert loaded(folder).said() == all_said("new")


def test_what_is_imported_by_a_name_made_while_it_runs_is_found(tmp_path):
    (tmp_path / "late_of_a_test.py").write_text("SAID = 1\n")
    (tmp_path / "part.py").write_text("from importlib import import_module\nimport json, collections.abc\n"
                                      "late = import_module('late_of_' + 'a_test')\n")  # fmt: skip
    assert loaded(tmp_path).late.SAID == 1
