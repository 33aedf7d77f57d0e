"""FMUs and systems whose archive or description is damaged: one error in one line, whatever it is."""

import random
import struct
import zipfile

import pytest

from swath.core.errors import SwathError
from swath.link.fmi.description import read_fmu
from swath.link.fmi.instance import unpack
from swath.link.fmi.ssp import read_system
from tests.link.made_fmus import SSD, component, connection, connector, engine_xml, process_xml, system

pytest.importorskip("fmpy")
FLAGS, METHOD = 6, 8  # where the two lie in a local header; in the central directory two bytes later
NASTY = (b"nan", b"1e999", b"-", b'"', b"<", b"\0", b"99999999999999999999", b"0")


def archive(file, **members):
    """A zip; names with __ for a dot."""
    with zipfile.ZipFile(file, "w") as made:
        for name, text in members.items():
            made.writestr(name.replace("__", "."), text)
    return file


def patched(file, place, value):
    """The archive with a number of its headers changed."""
    data = bytearray(file.read_bytes())
    for mark, shift in ((b"PK\x03\x04", 0), (b"PK\x01\x02", 2)):
        at = data.find(mark)
        while at >= 0:
            struct.pack_into("<H", data, at + place + shift, value)
            at = data.find(mark, at + 4)
    file.write_bytes(data)
    return file


@pytest.mark.parametrize("place", [FLAGS, METHOD])
def test_encrypted_or_packed_in_an_unknown_way(place, tmp_path):
    value = 1 if place == FLAGS else 77
    package = patched(archive(tmp_path / "a.ssp", SystemStructure__ssd="<a/>"), place, value)
    with pytest.raises(SwathError, match=r"expected a System Structure Package: .*(encrypted|method)"):
        read_system(package)
    fmu = patched(archive(tmp_path / "a.fmu", modelDescription__xml=process_xml()), place, value)
    with pytest.raises(SwathError, match=r"its description cannot be read: .*(encrypted|method)"):
        read_fmu(fmu)
    with pytest.raises(SwathError, match=r"a\.fmu cannot be unpacked: .*(encrypted|method)"):
        unpack(fmu)


def test_an_archive_that_does_not_fit_on_the_disk_is_not_begun(tmp_path, monkeypatch):
    room = type("Room", (), {"free": 3})()
    monkeypatch.setattr("swath.link.fmi.description.shutil.disk_usage", lambda folder: room)
    with pytest.raises(SwathError, match="it would take 0 MB, there is room for 0"):
        unpack(archive(tmp_path / "a.fmu", modelDescription__xml="<a/>"))


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_damaged_ones_are_read_or_refused_in_one_line(tmp_path):
    rng = random.Random(1)
    wired = system(
        "s", [connector("out", "output")], [component("A", "a.fmu")], [connection("A.grain_flow", "out")]
    )
    texts = {"a.fmu": process_xml(), "b.fmu": engine_xml(), "c.ssp": SSD.format(system=wired)}
    for _ in range(150):
        name = rng.choice(list(texts))
        data = bytearray(texts[name].encode())
        for _ in range(rng.choice((1, 2, 8))):
            at = rng.randrange(len(data))
            data[at : at + rng.randrange(12)] = rng.choice(NASTY) if rng.random() < 0.5 else rng.randbytes(1)
        inside = "SystemStructure__ssd" if name == "c.ssp" else "modelDescription__xml"
        file = archive(tmp_path / name, **{inside: bytes(data)})
        said = refusal(read_system if name == "c.ssp" else read_fmu, file)
        assert len(said) < 600
        assert "\n" not in said


def refusal(read, file):
    """What is said of a file, empty where it can be read."""
    try:
        read(file)
    except SwathError as error:
        return str(error)
    return ""
