"""Recordings are read chunk by chunk in the order of time, with little of them in memory."""

import bz2
import os
import struct
import subprocess
import sys
import tracemalloc
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swath.core.errors import InputError
from swath.documents import packed
from swath.record.formats import TRACKS
from swath.record.mcap_file import Container
from swath.record.read.definitions import Definitions
from swath.record.read.feed import WAITING, Demux
from swath.record.read.files import open_log
from swath.record.read.mcap_log import BROKEN, in_time_order
from swath.record.tracks import signal_columns
from swath.signals import MachineState
from swath.tools.function_test.journal import TABLE, read_table, write_rows
from tests.bags import BEGIN, KINDS, Bag

MIB = 1 << 20
COUNT, SIZE = 48, MIB  # messages, bytes of each


def blob(bag, data):
    """A message with so many bytes in it."""
    layout = bag.make("std_msgs/MultiArrayLayout", dim=[], data_offset=0)
    return bag.make("std_msgs/UInt8MultiArray", layout=layout, data=np.frombuffer(data, np.uint8))


def peak_of(read):
    """(result, most memory that Python held meanwhile [bytes])."""
    tracemalloc.start()
    try:
        return read(), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def times_of(path):
    """(log time, first byte) of every message on /x, and what was noted."""
    log = open_log(path)
    log.topics(), log.begin(), log.end()
    found = [(t, int(message.data[0])) for _, t, message in log.messages(("/x",))]
    return found, log.notes


@pytest.mark.parametrize("kind", KINDS)
def test_a_long_bag_is_never_whole_in_memory(tmp_path, kind):
    path = tmp_path / ("a.bag" if kind == "rosbag1" else "a")
    bag = Bag(path, kind)
    for k in range(COUNT):
        bag.write("/x", 0.1 * k, blob(bag, bytes([k]) * SIZE))
    bag.close()
    (found, notes), peak = peak_of(lambda: times_of(path))
    assert [value for _, value in found] == list(range(COUNT))
    assert not notes
    assert peak < 16 * MIB < COUNT * SIZE / 2


@pytest.mark.parametrize("kind", KINDS)
def test_messages_that_were_written_late_come_in_the_order_of_time(tmp_path, kind):
    path = tmp_path / ("a.bag" if kind == "rosbag1" else "a")
    bag = Bag(path, kind)
    seconds = np.random.default_rng(1).permutation(40)
    for k in seconds:
        bag.write("/x", float(k), blob(bag, bytes([k]) * (MIB // 8)))
    bag.close()
    found, notes = times_of(path)
    assert found == [(BEGIN + k * 10**9, k) for k in range(40)]
    assert not notes


def test_chunks_of_a_single_file_in_any_order(tmp_path):
    """Channels are declared in the first chunk, which is not the earliest."""
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        container = Container(file, chunk_bytes=200, profile="ros2", library="test")
        schema = container.add_schema("std_msgs/msg/UInt8", "ros2msg", b"uint8 data\nuint8[100] rest\n")
        channel = container.add_channel("/x", "cdr", schema, {})
        for k in (5, 6, 7, 0, 1, 2, 3, 4, 9, 8):
            container.add(channel, k, b"\x00\x01\x00\x00" + bytes([k]) + bytes(100))
        container.finish()
    assert [(t, m.data) for _, t, m in open_log(path).messages(("/x",))] == [(k, k) for k in range(10)]


def test_memory_does_not_grow_with_the_number_of_chunks_written(tmp_path):
    path, count = tmp_path / "a.mcap", 1500
    with path.open("wb") as file:
        container = Container(file, chunk_bytes=200, profile="ros2", library="test")
        schema = container.add_schema("std_msgs/msg/UInt8", "ros2msg", b"uint8 data\nuint8[100] rest\n")
        channels = [container.add_channel(f"/x{k}", "cdr", schema, {}) for k in range(20)]

        def write(first, end):
            for t in range(first, end):
                for channel in channels:
                    container.add(channel, t, b"\x00\x01\x00\x00" + bytes(101))
                container.flush()

        write(0, count // 3)
        tracemalloc.start()
        write(count // 3, count)
        grown, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        container.finish()
    assert grown < 20_000  # bytes; the index of these chunks takes 300,000
    log = open_log(path)
    assert (sum(1 for _ in log.messages(("/x7",))), log.notes) == (count, {})


@given(st.lists(st.lists(st.integers(0, 99), min_size=1, max_size=5), max_size=8))
def test_order_of_time_is_kept_whatever_lies_in_the_chunks(chunks):
    chunks.sort(key=min)
    stream = [x for chunk in chunks for x in (min(chunk), *((None, None, t, b"1234") for t in chunk))]
    times = [t for _, _, t, _ in in_time_order(stream)]
    assert times == sorted(t for chunk in chunks for t in chunk)


def test_no_more_than_was_said_waits():
    """Chunks that all claim to begin at 0 are given out when too much of them waits."""
    held = most = 0

    def stream():
        nonlocal held, most
        for k in range(200):
            yield 0
            held += 1000
            most = max(most, held)
            yield None, None, 1000 - k, bytes(1000)

    for _ in in_time_order(stream(), held_bytes=10_000):
        held -= 1000
    assert held == 0
    assert most <= 11_000


def number(value, kind="I"):
    """Bytes of a field."""
    return struct.pack(f"<{kind}", value)


def fields(**values):
    """name=value, each after its length."""
    return b"".join(number(len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in values.items())


def record(data, **header):
    """A record of a rosbag 1."""
    return number(len(fields(**header))) + fields(**header) + number(len(data)) + data


def packed_bag(path, declared):
    """A rosbag 1 with a chunk of bz2 that unpacks to 100 MiB of zeros; declared: what its header says."""
    squeezer = bz2.BZ2Compressor()
    squeezed = squeezer.compress(record(b"\x07", op=b"\x02", conn=number(0), time=bytes(8)))
    for _ in range(100):
        squeezed += squeezer.compress(bytes(MIB))
    squeezed += squeezer.flush()
    chunk = record(squeezed, op=b"\x05", compression=b"bz2", size=number(declared))
    magic, begin = b"#ROSBAG V2.0\n", 200
    sizes = {"conn_count": number(1), "chunk_count": number(1)}
    header = {"op": b"\x03", "index_pos": number(begin + len(chunk), "Q"), **sizes}
    room = begin - len(magic) - len(record(b"", **header))
    about = {"type": b"std_msgs/UInt8", "md5sum": b"0" * 32, "message_definition": b"uint8 data\n"}
    connection = record(fields(topic=b"/x", **about), op=b"\x07", conn=number(0), topic=b"/x")
    times = {"start_time": bytes(8), "end_time": bytes(8), "count": number(1)}
    info = record(number(0) + number(1), op=b"\x06", ver=number(1), chunk_pos=number(begin, "Q"), **times)
    path.write_bytes(magic + record(b" " * room, **header) + chunk + connection + info)


def test_a_chunk_that_unpacks_to_far_more_than_the_file(tmp_path):
    path = tmp_path / "a.bag"
    packed_bag(path, 2**32 - 1)
    log = open_log(path)
    assert log.topics() == {"/x": "std_msgs/msg/UInt8"}
    found, peak = peak_of(lambda: [message.data for _, _, message in log.messages(("/x",))])
    assert found == [7]
    assert peak < 64 * MIB


@pytest.mark.parametrize("kind", ["SQLITE3", "MCAP"])
def test_messages_that_unpack_to_far_more_than_the_file(tmp_path, kind):
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    bag = Bag(tmp_path / "unused", "sqlite")
    bag.close()
    writer = Writer(tmp_path / "a", version=8, storage_plugin=StoragePlugin[kind])
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        name = "std_msgs/msg/UInt8MultiArray"
        connection = writer.add_connection("/x", name, typestore=bag.store)
        for k, size in enumerate((10, 64 * MIB, 10)):
            data = bag.store.serialize_cdr(blob(bag, bytes(size)), name)
            writer.write(connection, BEGIN + k, data)
    (found, notes), peak = peak_of(lambda: times_of(tmp_path / "a"))
    assert [t - BEGIN for t, _ in found] == [0, 2]
    assert notes == {BROKEN: 1}
    assert peak < 40 * MIB


def test_a_file_that_unpacks_to_far_more_than_it_can_hold(tmp_path):
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Writer

    bag = Bag(tmp_path / "unused", "sqlite")
    bag.close()
    writer = Writer(tmp_path / "a", version=8)
    writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/x", "std_msgs/msg/UInt8MultiArray", typestore=bag.store)
        writer.write(connection, BEGIN, bytes(64 * MIB))
    with pytest.raises(InputError, match="bytes unpacked"):
        open_log(tmp_path / "a")


def test_a_reader_far_behind_goes_through_the_recording_by_itself():
    """/rare comes at the end only: what /often has until then must not wait in memory."""
    passes = []

    def open_pass(topics):
        passes.append(tuple(topics))
        for k in range(5000):
            if "/often" in topics:
                yield "/often", k, k
        if "/rare" in topics:
            yield "/rare", 5000, -1

    demux = Demux(open_pass, ("/often", "/rare"))
    often, rare = demux.read("/often"), demux.read("/rare")
    assert [next(often)[2] for _ in range(3)] == [0, 1, 2]
    assert next(rare)[2] == -1
    assert max(len(queue.records) for waiting in demux._waiting.values() for queue in waiting) <= WAITING
    rest = [k for _, k, _ in often]
    assert rest == list(range(3, 5000))
    assert all(a < b for a, b in pairwise(rest))
    assert next(rare, None) is None
    assert passes == [("/often", "/rare"), ("/often",)]
    demux.close()


def test_reading_tracks_leaves_no_threads(tmp_path):
    """A run ends soon after that."""
    if not Path("/proc/self/task").is_dir():
        pytest.skip("counts threads as Linux tells them")
    columns = {c.name: [0.0] for c in signal_columns(MachineState, MachineState)} | {"machine": ["a"]}
    pq.write_table(pa.table(columns, metadata={"format": TRACKS}), tmp_path / "tracks.parquet")
    code = (
        "import os, pathlib, sys, pyarrow.parquet\n"
        "from swath.record.tracks import read_tracks\n"
        "count = lambda: len(os.listdir('/proc/self/task'))\n"
        "before = count()\n"
        "assert 't_s' in read_tracks(pathlib.Path(sys.argv[1]))\n"
        "print(count() - before)\n"
    )
    made = [sys.executable, "-c", code, str(tmp_path / "tracks.parquet")]
    env = os.environ | {"NUMEXPR_NUM_THREADS": "1"}  # where pandas is there, Arrow imports it
    assert subprocess.run(made, capture_output=True, text=True, check=True, env=env).stdout.strip() == "0"


SECTION = "\n" + "=" * 80 + "\nMSG: "
HOSTILE = {
    "texts in an array": "string[30000000] x",
    "messages in an array": "a/B[9000] b" + SECTION + "a/B\nuint8 x",
    "arrays in arrays": "a/B[1000] b" + SECTION + "a/B\na/C[1000] c" + SECTION + "a/C\nfloat64[1000] x",
    "as many of nothing as a message says": "a/B[] b" + SECTION + "a/B\n",
    "nothing within nothing": "a/B b\na/B c" + SECTION + "a/B\na/C b\na/C c" + SECTION + "a/C\n",
    "itself": "a/B b" + SECTION + "a/B\na/B b",
    "more numbers than bytes": "float64[30000000] x",
    "a text of definitions without end": "uint8 x\n" * 200_000,
}


def written(path, text, data, name="a/msg/A"):
    """A recording of one message."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(name, "ros2msg", text.encode())
        channel = writer.register_channel("/x", "cdr", schema)
        writer.add_message(channel, 0, data, 0)
        writer.finish()
    return open_log(path)


@pytest.mark.parametrize("what", HOSTILE)
def test_a_definition_costs_no_more_than_the_message_has_bytes(tmp_path, what):
    data = b"\0\1\0\0" + b"\xff\xff\xff\x7f" * 200
    log = written(tmp_path / "a.mcap", HOSTILE[what], data)
    found, peak = peak_of(lambda: list(log.messages(("/x",))))
    assert found == []
    assert log.notes == {BROKEN: 1}
    assert peak < 20 * MIB


def test_the_least_length_is_that_of_a_message_without_anything_in_it():
    from rosbags.typesys import Stores, get_typestore

    from swath.record.message_factory import MessageFactory

    definitions = Definitions(get_typestore(Stores.ROS2_JAZZY).fielddefs)
    factory, checked = MessageFactory(), 0
    for name in definitions.types:
        if name.endswith(("LaserScan", "Odometry", "Image", "PointCloud2", "TFMessage", "Imu", "NavSatFix")):
            made = factory(name)
            least, size = definitions.least(name), len(factory.store.serialize_cdr(made, name))
            assert least <= size <= 2 * least + 32
            checked += 1
    assert checked > 7


def test_a_standard_message_without_a_standard_field_says_so(tmp_path):
    log = written(
        tmp_path / "a.mcap", "float32 range_min", b"\0\1\0\0" + bytes(4), "sensor_msgs/msg/LaserScan"
    )
    ((_, _, message),) = log.messages(("/x",))
    assert message.range_min == 0.0
    assert getattr(message, "header", None) is None
    with pytest.raises(InputError, match="expected a field header, the definition in the file has none"):
        print(message.header.stamp)


@pytest.mark.parametrize("held", ["pipe", "bytes", "many values"])
def test_a_table_of_results_is_read_within_bounds(tmp_path, monkeypatch, held):
    path = tmp_path / TABLE
    if held == "pipe":
        if not hasattr(os, "mkfifo"):
            pytest.skip("pipes as of POSIX")
        os.mkfifo(path)
    elif held == "bytes":
        path.write_bytes(b"PAR1" + bytes(range(60)) + b"PAR1")
    else:
        monkeypatch.setattr(packed, "MOST_VALUES", 0)
        pq.write_table(pa.table({"a": pa.array([1] * 1_000_000)}), path)
    with pytest.raises(InputError, match="results"):
        read_table(path)
    write_rows(tmp_path, iter(()), ())  # a damaged one is made anew
    assert read_table(path) == []
