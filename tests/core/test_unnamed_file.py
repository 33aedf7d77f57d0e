"""Bytes out of memory."""

from array import array

from swath.core.files.unnamed_file import UnnamedFile


def test_what_is_appended_is_read_where_it_lies():
    file = UnnamedFile()
    assert (file.size, file.read()) == (0, b"")
    assert file.append(b"one") == 0
    assert file.append(b"") == 0
    assert file.append(array("d", [2.0])) == 3
    assert file.read(0, 3) == b"one"
    assert file.append(b"three") == 11  # behind all, wherever was read before
    assert array("d", file.read(3, 8)) == array("d", [2.0])
    assert (file.size, file.read(11)) == (16, b"three")
