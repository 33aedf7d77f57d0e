"""Files of others: regular ones, of a bounded size, opened in one place."""

import ast
import os
from pathlib import Path

import pytest

from swath.core.errors import InputError
from swath.core.files.read_file import check_readable, open_to_read
from swath.documents.packed import member_names, open_archive, read_arrays
from swath.documents.text_file import read_bytes, read_text, text_lines
from swath.documents.yaml_document import read_document

PACKAGE = Path(__file__).parents[2] / "src" / "swath"
READERS = {
    "packed archives": lambda path: open_archive(path, "file").__enter__(),
    "arrays": lambda path: read_arrays(path, "file", "arrays"),
    "bytes": lambda path: read_bytes(path, "file", "a file"),
    "text": lambda path: read_text(path, "file", "a file"),
    "lines": lambda path: next(text_lines(path, "file", "a file")),
    "YAML": read_document,
    "what a library opens": lambda path: check_readable(path, "file", "a file"),
}
# The package's own files, and what the system tells; each by what the call is made on.
OWN = (
    "__file__",
    "_HERE",
    "PAGE",
    "TEMPLATES",
    "find_sheet",
    "job_sheet",
    "examples()",
    "template.path",
    "/proc/",
    "named",
)
MADE = {  # what was written a moment ago, or lies in an installed package
    "field_io/folder.py", "tools/scan/scan.py", "api.py", "link/fmi/export.py",
    "tools/function_test/odd/openodd.py", "tools/function_test/odd/campaign.py", "link/fmi/export_slave.py",
    "tools/function_test/journal.py", "kernels.py", "commands/docs.py", "tools/reda/reda.py",
    "report/html.py", "replay/writer.py",
}  # fmt: skip


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("kind", ["device", "pipe", "folder"])
def test_what_is_no_regular_file_is_refused_before_it_is_read(tmp_path, reader, kind):
    path = tmp_path / "input"
    if kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.mkdir()
    with pytest.raises(InputError, match=r"regular file, not a device or pipe|Is a directory"):
        READERS[reader](path)
    assert member_names(path) == []


def test_a_file_of_more_bytes_is_refused_and_one_of_as_many_is_read(tmp_path):
    path = tmp_path / "input"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # a file with a hole takes no room
    with pytest.raises(InputError, match="expected a save of at most 100 bytes"):
        open_to_read(path, "save", "a save", 100)
    path.write_bytes(b"x" * 100)
    with open_to_read(path, "save", "a save", 100) as file:
        assert len(file.read()) == 100


def test_no_file_of_others_is_opened_elsewhere():
    found = []
    for file in PACKAGE.rglob("*.py"):
        name = file.relative_to(PACKAGE).as_posix()
        if name.startswith(("data/", "core/")) or name in MADE:
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            call = ast.unparse(node)
            reads = getattr(node.func, "attr", "") in ("read_bytes", "read_text")
            opens = getattr(node.func, "attr", getattr(node.func, "id", "")) == "open" and "'rb'" in call
            if (reads or opens) and not any(own in call for own in OWN):
                found.append(f"{name}:{node.lineno}: {call[:80]}")
    assert found == []
