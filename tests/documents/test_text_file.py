"""Texts, JSON, XML and zip archives of a user's: read, or refused in one line that names the file."""

import zipfile

import pytest

from swath.core.errors import InputError
from swath.documents.json_file import read_json, read_object
from swath.documents.packed import is_archive, member_names, open_archive
from swath.documents.text_file import LONGEST_LINE, read_text, text_lines
from swath.documents.xml_file import XmlError, read_xml


def test_a_text_comes_as_it_is(tmp_path):
    file = tmp_path / "a.txt"
    file.write_bytes("\ufeffä,1\r\n\r\nb,2".encode())
    assert read_text(file, "key", "a table") == "ä,1\r\n\r\nb,2"
    assert list(text_lines(file, "key", "a table")) == ["ä,1\r\n", "\r\n", "b,2"]


BAD = {
    "no such file": None,
    "in UTF-8": b"\xff\xfe,1\n",
    "in lines of at most": b"1," * LONGEST_LINE,
}


@pytest.mark.parametrize("said", BAD)
def test_what_is_no_text_is_refused(said, tmp_path):
    file = tmp_path / "a.txt"
    if BAD[said] is not None:
        file.write_bytes(BAD[said])
    with pytest.raises(InputError, match=rf"key.*expected a table.*{said}") as caught:
        list(text_lines(file, "key", "a table"))
    assert "a.txt" in str(caught.value)
    with pytest.raises(InputError):
        read_text(file, "key", "a table", most=100)


def test_a_text_is_no_longer_than_it_may_be(tmp_path):
    file = tmp_path / "a.txt"
    file.write_text("1\n" * 100)
    for read in (read_text, lambda *args: list(text_lines(*args))):
        with pytest.raises(InputError, match="of at most 150"):
            read(file, "key", "a table", 150)
        assert read(file, "key", "a table", 200)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '"\\ud800', "1" * 5000, "nul"])
def test_what_is_no_json_is_refused(text, tmp_path):
    file = tmp_path / "a.json"
    file.write_text(text)
    with pytest.raises(InputError, match=r"key: expected GeoJSON.*a\.json"):
        read_json(file, "key", "GeoJSON")


def test_an_object_is_asked_for(tmp_path):
    file = tmp_path / "a.json"
    file.write_text("[1]")
    with pytest.raises(InputError, match="a JSON object"):
        read_object(file, "key", "a summary")


@pytest.mark.parametrize(
    "text", ["", "<a>", "<!DOCTYPE a><a/>", "<a>" * 100 + "</a>" * 100, "<a></b>", "\x00"]
)
def test_what_is_no_plain_xml_is_refused(text):
    with pytest.raises(XmlError, match="line 1: "):
        read_xml(text.encode())


@pytest.mark.parametrize("cut", range(5, 200, 13))
def test_an_archive_that_is_cut_or_bent_is_refused(cut, tmp_path):
    file = tmp_path / "a.zip"
    with zipfile.ZipFile(file, "w") as made:
        made.writestr("doc.kml", "<kml/>" * 20)
    whole = file.read_bytes()
    bent = bytearray(whole)
    bent[-cut % len(whole)] ^= 0xFF
    for data in (whole[:-cut], bytes(bent), whole[:cut], b""):
        file.write_bytes(data)
        assert isinstance(is_archive(file), bool)
        assert isinstance(member_names(file), list)
        said = "a.zip"
        try:
            with open_archive(file, "key") as archive:
                archive.read("doc.kml")
        except InputError as error:
            said = str(error)
        assert "a.zip" in said
