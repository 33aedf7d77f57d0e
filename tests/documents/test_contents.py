"""Hashes of the files that plain data names."""

import hashlib
import os

import pytest

from swath.documents.contents import changed_since, hashes, hashes_by_path, part_of


def test_files_are_named_once_and_folders_whole(tmp_path):
    sheet, field = tmp_path / "crop.yaml", tmp_path / "field"
    sheet.write_text("a: 1\n")
    field.mkdir()
    (field / "outline.geojson").write_text("{}")
    data = {
        "a": [str(sheet), {"b": str(sheet)}],
        "field": str(field),
        "n": 3,
        "no": ["/", ".", "..", "1.5", "a/b"],
    }
    before = hashes(data)
    assert set(before) == {"crop.yaml", "field"}
    assert before["crop.yaml"] == hashlib.sha256(b"a: 1\n").hexdigest()
    (field / "outline.geojson").write_text("{} ")
    after = hashes(data)
    assert (after["crop.yaml"], after["field"] == before["field"]) == (before["crop.yaml"], False)


FILES = {
    "own.py": """import helper as h
from pack import deep
class Own:
    def step(self):
        import lazy
        from importlib import import_module
        return lazy, import_module("late"), open(HERE / "weights.bin"), HERE / "tables" / "a.csv"
""",
    "helper.py": "", "lazy.py": "import of_lazy", "of_lazy.py": "", "late.py": "",
    "pack/__init__.py": "from . import inner", "pack/inner.py": "", "pack/deep.py": "from ..no import x",
    "weights.bin": "1", "tables/a.csv": "1",
    "unrelated.py": "", "pack/unrelated.py": "", "other.bin": "1", "tables/b.csv": "1",
}  # fmt: skip
IMPORTED = {
    "own.py",
    "helper.py",
    "lazy.py",
    "of_lazy.py",
    "pack/__init__.py",
    "pack/inner.py",
    "pack/deep.py",
}
NAMED = {"late.py", "weights.bin", "tables/a.csv"}


@pytest.fixture
def part(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_a_part_is_what_it_imports_and_names(part):
    imported, named = (
        {file.relative_to(part).as_posix() for file in some} for some in part_of(part / "own.py")
    )
    assert (imported, named) == (IMPORTED, NAMED)


@pytest.mark.parametrize("name", FILES)
def test_what_was_changed_is_named_and_nothing_else(part, name):
    made_of, file = hashes_by_path({"level": f"{part / 'own.py'}:Own"}), part / name
    os.utime(file, (1, 1))
    (part / "new.py").write_text("")
    assert changed_since(made_of) == ""
    is_of_it = name in IMPORTED | NAMED
    file.write_text("# another\n")
    assert changed_since(made_of) == (f"{file.name} (changed)" if is_of_it else "")
    file.rename(file.with_name("renamed"))
    assert changed_since(made_of) == (f"{file.name} (gone)" if is_of_it else "")


def test_of_two_files_of_one_name_the_one_that_was_changed_is_named(tmp_path):
    files = [tmp_path / folder / "x.csv" for folder in ("a", "b")]
    for file in files:
        file.parent.mkdir()
        file.write_text("1")
    made_of = hashes_by_path([str(file) for file in files])
    files[1].write_text("22")
    assert changed_since(made_of) == f"{files[1]} (changed)"


def test_two_files_of_one_name_are_both_there(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "x.csv").write_text(folder)
    assert len(hashes([str(tmp_path / "a" / "x.csv"), str(tmp_path / "b" / "x.csv")])) == 2
