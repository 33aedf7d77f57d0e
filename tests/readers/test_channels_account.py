"""What a file states and does not hold is told; what is whole is read without a doubt."""

import random
import struct
import zlib

import numpy as np
import pytest

from swath.core.apart.call import written_here
from swath.core.errors import InputError
from swath.record.read.files import open_log
from tests.bags import KINDS as BAGS
from tests.bags import write_bag
from tests.readers.made_channels import COUNT, DBC, FLOW, asc, blf, frames, group, mf4, opened, read

for library in ("asammdf", "can", "cantools"):
    pytest.importorskip(library)


def doubts_of(path):
    try:
        return read(path).doubts
    except InputError as error:
        return [error.key]


@pytest.mark.parametrize("kind", ["asc", "blf", "mf4"])
def test_a_whole_file_has_no_doubt_and_a_torn_one_is_never_silent(tmp_path, kind):
    path = tmp_path / f"log.{kind}"
    {"asc": asc, "blf": blf, "mf4": lambda p, _: mf4(p, group())}[kind](path, frames())
    found, whole = read(path), path.read_bytes()
    assert (found.notes, found.rows) == ([], COUNT)
    assert found.stated in (None, COUNT)
    draw = random.Random(1)
    for _ in range(6):
        path.write_bytes(whole[: int(draw.uniform(0.2, 0.98) * len(whole))])
        assert set(doubts_of(path)) & {"damaged", "lost", "log"}


def test_lines_that_are_damaged_are_counted_and_the_rest_is_read(tmp_path):
    path = asc(tmp_path / "log.asc", frames())
    lines = path.read_text().splitlines(keepends=True)
    for k in range(50, 450, 40):
        lines[k] = lines[k][:-4] + "Z\n"  # no number
    for k in range(60, 450, 40):
        lines[k] = lines[k][:-6] + "\n"  # two bytes are missing
    path.write_text("".join(lines))
    found = read(path)
    assert found.notes == ["damaged: lines of frames that cannot be read (20)"]
    assert np.nanmean(found.flow) == pytest.approx(FLOW.mean(), rel=0.01)


def test_a_logger_that_did_not_end_its_file_is_told(tmp_path):
    path = blf(tmp_path / "log.blf", frames())
    data = bytearray(path.read_bytes())
    data[16:40] = bytes(24)  # size and number of objects
    path.write_bytes(data)
    found = read(path)
    assert found.doubts == ["damaged"]
    assert found.rows == COUNT


def test_objects_that_the_head_counts_and_that_are_not_there_are_told(tmp_path):
    path = blf(tmp_path / "log.blf", frames())
    data = bytearray(path.read_bytes())
    at = struct.calcsize("<4sLBBBBBBBBQQ")
    assert struct.unpack_from("<L", data, at)[0] == 3 * COUNT
    struct.pack_into("<L", data, at, 4 * COUNT)
    path.write_bytes(data)
    assert read(path).notes == ["lost: 1 200 objects are stated, 900 are there (300)"]


HEAD_AT = struct.Struct("<4sHHLL")


def packed(data, kind, at_once):
    """The objects of a BLF file as containers of `at_once` bytes, packed or not."""
    head = struct.unpack_from("<L", data, 4)[0]
    inner, at = b"", head
    while at < len(data):
        size = HEAD_AT.unpack_from(data, at)[3]
        inner += zlib.decompress(data[at + 32 : at + size])
        at += size + size % 4
    return data[:head], inner, lambda whole: b"".join(
        HEAD_AT.pack(b"LOBJ", 16, 1, 32 + len(part), 10) + struct.pack("<H6xL4x", kind, len(made)) + part
        + bytes(len(part) % 4)
        for made in (whole[k : k + at_once] for k in range(0, len(whole), at_once))
        for part in [zlib.compress(made) if kind else made]
    )  # fmt: skip


@pytest.mark.parametrize("kind", [0, 2])
@pytest.mark.parametrize("size", [0, 1, 15, 20, 1 << 20, 0xFFFFFFFF])
def test_an_object_of_no_such_size_is_damage_and_the_others_are_read(tmp_path, size, kind):
    path = blf(tmp_path / "log.blf", frames())
    for seed, at_once in enumerate((57, 1000, 1 << 17)):
        head, inner, contained = packed(blf(path, frames()).read_bytes(), kind, at_once)
        starts = [k for k in range(len(inner)) if inner.startswith(b"LOBJ", k)]
        at = starts[random.Random(seed).randrange(1, len(starts) - 1)]
        path.write_bytes(head + contained(inner))
        assert (read(path).notes, read(path).rows) == ([], COUNT)
        path.write_bytes(head + contained(inner[: at + 8] + struct.pack("<L", size) + inner[at + 12 :]))
        found = read(path)
        assert "damaged" in found.doubts
        if size != 1 << 20:
            assert found.rows >= COUNT - 1
            assert np.isfinite(found.flow).sum() >= COUNT - 3


def test_what_follows_no_object_is_not_read_and_that_is_told(tmp_path):
    path = blf(tmp_path / "log.blf", frames())
    head, inner, contained = packed(path.read_bytes(), 2, 8000)
    whole = contained(inner)
    at = whole.index(b"LOBJ", len(whole) // 2)
    for broken in (b"LOBJ\x10\0\1\0" + bytes(8), b"JUNK" + bytes(28)):
        path.write_bytes(head + whole[:at] + broken + whole[at:])
        found = read(path)
        assert found.doubts[0] == "damaged"
        assert COUNT // 3 < found.rows < COUNT


def test_events_that_are_no_frames_are_no_doubt(tmp_path):
    path = asc(tmp_path / "log.asc", frames())
    lines = path.read_text().splitlines(keepends=True)
    for k in range(len(lines) - 2, 5, -10):
        lines.insert(
            k, f"{float(lines[k].split()[0]):11.6f} 1  Statistic: D 3 R 0 XD 0 XR 0 E 0 O 0 B 0.01%\n"
        )
    path.write_text("".join(lines))
    found = read(path)
    assert [note.partition(" (")[0] for note in found.notes] == ["unused: lines that are no frames"]
    assert (found.rows, found.doubts) == (COUNT, [])


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-8-sig"])
def test_a_database_in_either_encoding_says_its_units(tmp_path, encoding):
    path = asc(tmp_path / "log.asc", frames())
    path.with_suffix(".dbc").write_text(DBC.replace('"deg"', '"°"'), encoding=encoding)
    assert opened(path).units["Latitude"] == "°"
    assert read(path).rows == COUNT


@pytest.mark.parametrize("kind", BAGS)
def test_a_bag_that_is_whole_has_no_note(tmp_path, kind):
    path = write_bag(tmp_path / "bag", kind)
    log = opened_bag(path)
    assert sum(1 for _ in log.messages(log.topics())) > 500
    assert not log.notes


def test_messages_that_a_bag_counts_and_does_not_hold_are_told(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channel = writer.register_channel("/speed", "cdr", schema)
        for k in range(50):
            writer.add_message(channel, k * 10**7, b"\0\1\0\0" + struct.pack("<d", 2.0), k * 10**7)
        vars(writer)["_Writer__statistics"].message_count += 7
        writer.finish()
    log = opened_bag(path)
    assert sum(1 for _ in log.messages(["/speed"])) == 50
    assert log.notes == {"lost: messages of 57 that the file states": 7}


def opened_bag(path):
    written_here(path)
    return open_log(path)
