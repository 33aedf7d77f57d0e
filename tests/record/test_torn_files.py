"""Files that end too early, are damaged, or are none: read as far as they go, or refused by name."""

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from swath.commands.main import main
from swath.core.errors import InputError
from swath.record.read.feed import exact_samples, exact_topic, own_outputs
from swath.record.read.files import open_log
from swath.record.read.mcap_log import BROKEN, CUT_OFF, DAMAGED, McapLog
from swath.record.recorder import Recorder
from tests.bags import BEGIN, Bag
from tests.fake_run import ArcEdge, GridField, drive, machine
from tests.record.test_exact_samples import same_bits

MANY = settings(max_examples=15, suppress_health_check=list(HealthCheck))
SLOTS = ("combine.motion", "combine.lidar", "combine.edge", "combine.steering")


def read_all(path):
    """Every exact sample of some slots, and the log that was read."""
    log = McapLog(path)
    found = {}
    for slot in SLOTS:
        for output, is_exact in own_outputs(log, slot).items():
            if is_exact:
                found[slot] = list(exact_samples(log.messages((exact_topic(slot, output),))))
    return found, log


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    with Recorder(folder, [machine()]) as recorder:
        drive([recorder], GridField(ArcEdge(40.0)), seconds=6.0)
    path = folder / "run.mcap"
    found, log = read_all(path)
    assert not log.notes
    return path.read_bytes(), found, folder


def attempt(call):
    """(result, "") or (None, what the InputError says)."""
    try:
        return call(), ""
    except InputError as error:
        return None, str(error)


def end_of_data(data):
    """Where the DataEnd record lies: what follows is only the index."""
    at = 8
    while data[at] != 0x0F:
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return at


@given(share=st.floats(0.0, 1.0))
@MANY
def test_half_a_file_gives_half_the_run(whole, share):
    data, all_samples, folder = whole
    cut = int(share * len(data))
    path = folder / "cut.mcap"
    path.write_bytes(data[:cut])
    if cut < 8:
        with pytest.raises(InputError, match=r"cut\.mcap: expected an MCAP file"):
            open_log(path)
        return
    found, log = read_all(path)
    for slot, samples in found.items():
        assert len(samples) <= len(all_samples[slot])
        assert all(
            t == at and same_bits(a, b) for (t, a), (at, b) in zip(samples, all_samples[slot], strict=False)
        )
    if cut > end_of_data(data) + 9:
        assert not log.notes
        assert {s: len(v) for s, v in found.items()} == {s: len(v) for s, v in all_samples.items()}
        return
    [note] = log.notes
    reached = float(re.fullmatch(rf"{CUT_OFF} after (\d+\.\d\d) s", note)[1])
    latest = max((samples[-1][0] for samples in found.values() if samples), default=0)
    assert latest / 1e9 - 0.01 <= reached <= 6.0
    assert reached >= 6.0 * cut / len(data) - 1.5  # what is lost is part of a chunk, and a block


@given(places=st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(1, 255)), min_size=1, max_size=20))
@MANY
def test_a_damaged_file_is_read_or_refused_by_name(whole, places):
    data, all_samples, folder = whole
    damaged = bytearray(data)
    for share, change in places:
        damaged[min(int(share * len(data)), len(data) - 1)] ^= change
    path = folder / "damaged.mcap"
    path.write_bytes(bytes(damaged))
    read, refusal = attempt(lambda: read_all(path))
    if read is None:
        assert "recording" in refusal
        return
    found, log = read
    for slot, samples in found.items():
        known = dict(all_samples.get(slot, ()))
        assert len(samples) <= len(known)
        assert all(same_bits(sample, known[t]) for t, sample in samples)  # nothing wrong comes through
    assert all(note.startswith((CUT_OFF, BROKEN, DAMAGED, "lost: messages of ")) for note in log.notes)


@pytest.mark.draws
@given(data=st.binary(max_size=400), name=st.sampled_from(["x.mcap", "x.bag", "x.db3", "x", "run/run.mcap"]))
@MANY
def test_garbage_is_refused_by_name(tmp_path_factory, data, name):
    assume(not data.startswith((b"\x89MCAP0\r\n", b"#ROSBAG")))
    path = tmp_path_factory.mktemp("garbage") / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        open_log(path.parent if name.startswith("run/") else path)
    assert path.name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.draws
@given(data=st.binary(min_size=1, max_size=300), form=st.sampled_from([b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n"]))
@MANY
def test_garbage_behind_a_good_beginning(tmp_path_factory, data, form):
    path = tmp_path_factory.mktemp("garbage") / ("x.mcap" if form[0] == 0x89 else "x.bag")
    path.write_bytes(form + data)
    log, refusal = attempt(lambda: open_log(path))
    if log is None:
        assert path.name in refusal
        return
    assert log.topics() == {}
    assert list(log.messages(("/scan",))) == []
    assert all(note.startswith(CUT_OFF) for note in log.notes)
    assert log.notes or b"\x0f" in data  # the mark of an end, by chance


@given(text=st.text(max_size=200))
@settings(max_examples=20)
def test_a_folder_with_odd_metadata(tmp_path_factory, text):
    folder = tmp_path_factory.mktemp("odd")
    (folder / "metadata.yaml").write_text(text, encoding="utf-8")
    (folder / "odd_0.db3").touch()
    with pytest.raises(InputError, match="readable rosbag"):
        open_log(folder)


@pytest.fixture(scope="module")
def counted(tmp_path_factory):
    """A rosbag 1 of 1000 numbers, its bytes and its folder."""
    path = tmp_path_factory.mktemp("counted") / "a.bag"
    bag = Bag(path, "rosbag1")
    for k in range(1000):
        bag.write("/x", 0.01 * k, bag.make("std_msgs/Float64", data=float(k)))
    bag.close()
    return path.read_bytes(), path.parent


@given(share=st.floats(0.0, 1.0))
@MANY
def test_half_a_rosbag_1(counted, share):
    data, folder = counted
    path = folder / "torn.bag"
    path.write_bytes(data[: int(share * len(data))])
    log, refusal = attempt(lambda: open_log(path))
    if log is None:
        assert share < 0.1
        assert "expected a readable rosbag" in refusal
        return
    numbers = [message.data for _, _, message in log.messages(("/x",))]
    assert numbers == list(range(len(numbers)))
    if len(numbers) < 1000:
        [note] = log.notes
        reached = float(re.fullmatch(rf"{CUT_OFF} after (\d+\.\d\d) s", note)[1])
        assert reached == pytest.approx(0.01 * numbers[-1], abs=0.006)
        assert log.begin() == BEGIN
        assert log.end() == BEGIN + round(0.01 * numbers[-1] * 1e9)


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_half_a_packed_rosbag_1(tmp_path, compression):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    path = tmp_path / "packed.bag"
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat[compression.upper()])
    writer.chunk_threshold = 20_000
    with writer:
        connection = writer.add_connection("/x", "std_msgs/msg/Float64", typestore=store)
        kind = store.types["std_msgs/msg/Float64"]
        for k in range(5000):
            writer.write(connection, BEGIN + k, store.serialize_ros1(kind(float(k)), "std_msgs/msg/Float64"))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    log = open_log(path)
    numbers = [message.data for _, _, message in log.messages(("/x",))]
    assert numbers == list(range(len(numbers)))
    assert 1500 < len(numbers) < 4500


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_a_torn_database_says_what_to_do(tmp_path, share):
    bag = Bag(tmp_path / "a", "sqlite")
    for k in range(1000):
        bag.write("/x", 0.01 * k, bag.make("std_msgs/Float64", data=float(k)))
    bag.close()
    path = next((tmp_path / "a").glob("*.db3"))
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    log, refusal = attempt(lambda: open_log(path))
    if log is None:
        assert "a broken one needs a new index first" in refusal
        return
    assert sum(1 for _ in log.messages(("/x",))) < 1000
    assert any(note.startswith(CUT_OFF) for note in log.notes)


@pytest.mark.parametrize("command", [["rerun"], ["height-map", "build", "--out", "h.npz"]])
def test_one_line_on_the_command_line(tmp_path, capsys, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    Path("bad.mcap").write_bytes(b"not a recording")
    assert main([*command, "bad.mcap"]) == 2
    text = capsys.readouterr().err
    assert text.startswith("swath: recording = bad.mcap: expected an MCAP file")
    assert text.count("\n") == 1
    assert main([*command, "nothing.mcap"]) == 2
    assert "nothing.mcap" in capsys.readouterr().err
