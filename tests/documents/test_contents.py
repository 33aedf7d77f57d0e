"""Hashes of the files that plain data names."""

import hashlib

from swath.documents.contents import hashes


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


def test_python_counts_with_what_lies_beside_it(tmp_path):
    own, helper = tmp_path / "own.py", tmp_path / "helper.py"
    own.write_text("import helper\n")
    helper.write_text("")
    before = hashes({"level": f"{own}:Own"})
    helper.write_text("changed = True\n")
    assert hashes({"level": f"{own}:Own"})["own.py"] != before["own.py"]


def test_two_files_of_one_name_are_both_there(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "x.csv").write_text(folder)
    assert len(hashes([str(tmp_path / "a" / "x.csv"), str(tmp_path / "b" / "x.csv")])) == 2
