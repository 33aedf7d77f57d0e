"""What an error says of the value that was wrong."""

from pathlib import Path

from swath.core.errors import InputError


def test_a_long_value_is_cut_and_a_path_is_not():
    assert str(InputError("name", "z" * 200, "expected less")) == f"name = {'z' * 77}...: expected less"
    place = Path("/a") / ("x" * 90) / "b.fmu"
    assert str(InputError("file", place, "expected a file")) == f"file = {place}: expected a file"
    deep = "/" + "x/" * 300 + "end.fmu"
    assert str(InputError("file", deep)).startswith("file = ...")
    assert str(InputError("file", deep)).endswith("x/end.fmu")
