"""Samples in run.mcap come back bit for bit, and every message as it was published."""

import zlib
from dataclasses import dataclass, fields, is_dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.record import packed_columns
from swath.record.mcap_file import McapFile
from swath.record.message_factory import Draft, MessageFactory
from swath.record.read.feed import exact_samples, exact_topic, own_outputs
from swath.record.read.mcap_log import McapLog
from swath.record.recorder import Recorder
from swath.record.samples import Blocks, is_recordable, signal_type, unpack
from swath.signals import F64, Scan, ScanTruth, Signal
from tests.fake_run import ArcEdge, GridField, drive, machine


@dataclass(frozen=True)
class Odd(Signal):
    """Everything a sample may hold."""

    pose: Pose
    real: float
    whole: int
    flag: bool
    array: F64
    scalar: float  # a number of numpy, in fact


@dataclass(frozen=True)
class Turned(Signal):
    azimuth: F64


def rotation(yaw, pitch, roll):
    """Of a machine: about z, then y, then x."""
    (cz, cy, cx), (sz, sy, sx) = np.cos([yaw, pitch, roll]), np.sin([yaw, pitch, roll])
    about_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    return about_z @ about_y @ about_x


def same_bits(a, b):
    if is_dataclass(a):
        return type(a) is type(b) and all(
            same_bits(getattr(a, f.name), getattr(b, f.name)) for f in fields(a)
        )
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if isinstance(a, float):
        return type(a) is type(b) and np.float64(a).tobytes() == np.float64(b).tobytes()
    return type(a) is type(b) and a == b


def read_exact(path, slot, output):
    log = McapLog(path)
    topic = exact_topic(slot, output)
    return list(exact_samples(log.messages((topic,))))


reals = st.floats(width=64, allow_nan=True, allow_infinity=True)
arrays = st.one_of(
    st.lists(reals, max_size=4).map(lambda v: np.array(v, dtype=np.float64)),
    st.lists(st.floats(width=32), min_size=2, max_size=2).map(lambda v: np.array([v], dtype=np.float32)),
)


def made_pose(numbers, way):
    """Of arrays, or of plain numbers; with a 1 also asked for the other."""
    place, rows = numbers[:3], [numbers[3 * k : 3 * k + 3] for k in (1, 2, 3)]
    if way == "narrow":
        pose = Pose(np.array(place, np.float32), np.array(rows, np.float32))
    else:
        pose = Pose.of_numbers(place, rows) if "plain" in way else Pose(np.array(place), np.array(rows))
    if way.endswith("1") or way == "narrow":
        assert len(pose.numbers) == 2
        assert pose.position.shape == (3,)
    return pose


samples = st.builds(
    Odd,
    t=st.integers(0, 10**12),
    pose=st.builds(
        made_pose,
        st.lists(st.floats(width=32), min_size=12, max_size=12),
        st.sampled_from(["arrays", "arrays 1", "plain", "plain 1", "narrow"]),
    ),
    real=reals,
    whole=st.integers(-(2**63), 2**63 - 1),
    flag=st.booleans(),
    array=arrays,
    scalar=reals.map(np.float64),
)


def as_declared(sample):
    """The sample as it is sent: its number of numpy is a float, the numbers of its pose are float64."""
    pose = Pose(sample.pose.position.astype(float), sample.pose.rotation.astype(float))
    return replace(sample, scalar=float(sample.scalar), pose=pose)


@given(st.lists(st.tuples(st.integers(0, 2 * 10**9), samples), min_size=1, max_size=12))
@settings(max_examples=20)
def test_any_sample_comes_back_to_the_last_bit(tmp_path_factory, given_samples):
    folder = tmp_path_factory.mktemp("odd")
    given_samples.sort(key=lambda pair: pair[0])
    with Recorder(folder, [machine()]) as recorder:
        for t, sample in given_samples:
            recorder("combine.odd", t, {"odd": sample})
    found = read_exact(folder / "run.mcap", "combine.odd", "odd")
    assert [t for t, _ in found] == [t for t, _ in given_samples]
    for (_, made), (_, sample) in zip(found, given_samples, strict=True):
        assert same_bits(made, as_declared(sample)), (made, sample)


@pytest.mark.parametrize("moves", [0.0, 1e-3])
def test_poses_of_plain_numbers_take_the_bytes_of_those_of_arrays(moves, tmp_path):
    found = []
    for way in ("arrays", "plain", "plain 1"):
        (tmp_path / way).mkdir()
        with Recorder(tmp_path / way, [machine()]) as recorder:
            for k in range(90):
                numbers = [
                    2.0 + moves * k,
                    -0.0,
                    0.1,
                    *rotation(0.3 + moves * k, 0.02, -0.01).ravel().tolist(),
                ]
                pose = made_pose(numbers, way)
                recorder("combine.odd", k, {"odd": Odd(k, pose, 0.5 * k, k, True, np.ones(2), 1.0)})
        log = McapLog(tmp_path / way / "run.mcap")
        messages = [m for *_, m in log.messages((exact_topic("combine.odd", "odd"),))]
        found.append([(list(m.kinds), list(m.held), bytes(m.data)) for m in messages])
    assert found[0] == found[1] == found[2]
    assert found[0][0][1][2:4] == [not moves, not moves]  # names: published, t, position, rotation


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Whole recording with the truth, every sample, and every message that was handed to the file."""
    folder = tmp_path_factory.mktemp("run")
    kept, written = [], []
    whole = McapFile.write

    def write(self, topic, t, message, **more):
        written.append((topic, t, message.build() if isinstance(message, Draft) else message))
        whole(self, topic, t, message, **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(McapFile, "write", write)
        with Recorder(folder, [machine()], detail="full") as recorder:
            drive([lambda *s: kept.append(s), recorder], GridField(ArcEdge(40.0)), seconds=2.0)
    return folder / "run.mcap", kept, written


def test_every_sample_of_every_slot_is_there_from_zero_on(run):
    path, kept, _ = run
    log = McapLog(path)
    for slot in dict.fromkeys(s for s, _, _ in kept):
        for output in own_outputs(log, slot):
            wanted = [(t, o[output]) for s, t, o in kept if s == slot and output in o]
            if not wanted:
                continue  # a companion for the eye, such as edge_marker
            found = read_exact(path, slot, output)
            assert found[0][0] == 0
            assert len(found) == len(wanted)
            assert all(t == at and same_bits(a, b) for (t, a), (at, b) in zip(found, wanted, strict=True)), (
                slot,
                output,
            )


def test_the_scans_truth_is_a_choice(run, tmp_path):
    path, kept, _ = run
    assert own_outputs(McapLog(path), "combine.lidar")["truth"] is True
    for detail, outputs in (
        ("exact", {"scan": True, "truth": False}),
        ("standard", {"scan": False, "truth": False}),
    ):
        folder = tmp_path / detail
        folder.mkdir()
        with Recorder(folder, [machine()], detail=detail) as recorder:
            for sample in kept[:200]:
                recorder(*sample)
        assert own_outputs(McapLog(folder / "run.mcap"), "combine.lidar") == outputs


def names_of(message):
    """Fields of a message, whichever library made it."""
    names = getattr(message, "__dataclass_fields__", None) or getattr(message, "__slots__", ())
    return sorted({n.lstrip("_") for n in names if not n.startswith("__") and n == n.lower()})


def equal(read, published):
    """Field by field; a float32 field holds what was published, rounded."""
    if names_of(published):
        return names_of(read) == names_of(published) and all(
            equal(getattr(read, n), getattr(published, n)) for n in names_of(published)
        )
    if isinstance(published, np.ndarray | list | bytes):
        a, b = list(read), list(published)
        if len(a) == len(b) > 8 and not names_of(b[0]) and not isinstance(b[0], str):
            return np.array_equal(np.array(a, float), np.array(b, float), equal_nan=True)
        return len(a) == len(b) and all(equal(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(published, float | np.floating):
        return read in (published, np.float32(published)) or (np.isnan(read) and np.isnan(published))
    return read == published


def test_the_decoder_of_the_mcap_project_reads_every_message_as_it_was_published(run):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    path, _, written = run
    left = {}
    for topic, t, message in written:
        left.setdefault(topic, []).append((t, message))
    count = 0
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            t, original = left[channel.topic].pop(0)
            assert message.log_time == message.publish_time == t
            assert equal(decoded, original), channel.topic
            count += 1
    assert count == len(written) > 1400
    assert not any(left.values())


def test_rosbags_reads_every_message_as_it_was_published(run):
    from rosbags.highlevel import AnyReader

    path, _, written = run
    left = {}
    for topic, t, message in written:
        left.setdefault(topic, []).append((t, message))
    with AnyReader([path]) as reader:
        count = 0
        for connection, t, raw in reader.messages():
            at, original = left[connection.topic].pop(0)
            assert t == at
            assert equal(reader.deserialize(raw, connection.msgtype), original), connection.topic
            count += 1
    assert count == len(written)


courses = st.sampled_from(["<f8", "<f4"]).flatmap(
    lambda kind: st.lists(st.floats(width=8 * int(kind[2])), min_size=6, max_size=180).map(
        lambda v: np.array(v[: len(v) // 3 * 3], dtype=kind).reshape(-1, 3)
    )
)


@given(st.one_of(courses, courses.map(lambda c: np.cumsum(np.ones_like(c), axis=0) * c[0])))
@settings(max_examples=60)
def test_packed_columns_keep_every_bit(column):
    how, data = packed_columns.pack(column)
    assert len(data) == column.nbytes
    if how:
        assert packed_columns.unpack(data, how, column.dtype, column.shape).tobytes() == column.tobytes()
    else:
        assert data == column.tobytes()


def test_a_smooth_course_takes_fewer_bytes():
    t = np.arange(100) / 200.0
    place = np.stack([2.0 * t, 0.01 * np.sin(t), 1e-3 * np.cos(3.0 * t)], axis=1)
    how, data = packed_columns.pack(place)
    assert how == packed_columns.SMOOTH
    assert len(zlib.compress(data)) < 0.8 * len(zlib.compress(place.tobytes()))


def test_of_rotations_the_third_column_takes_its_last_bits_alone():
    angle = np.array([0.3, -0.02, 0.01]) + 1e-3 * np.arange(100)[:, None]
    turns = np.stack([rotation(*row) for row in angle])
    how, data = packed_columns.pack(turns)
    assert how == packed_columns.ROTATION
    assert packed_columns.unpack(data, how, turns.dtype, turns.shape).tobytes() == turns.tobytes()
    two = packed_columns.pack(np.ascontiguousarray(turns[:, :, :2]))[1]
    assert len(zlib.compress(data)) < 1.2 * len(zlib.compress(two))


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e300, 0.5, -0.0])
def test_matrices_that_are_no_rotations_keep_their_bits_too(wrong):
    turns = np.tile(np.eye(3), (50, 1, 1))
    turns[7, 2, 1] = wrong
    how, data = packed_columns.pack(turns)
    assert (how == packed_columns.ROTATION) == (wrong == 0.0)
    assert packed_columns.unpack(data, how, turns.dtype, turns.shape).tobytes() == turns.tobytes()


def test_times_and_what_stays_the_same_take_next_to_nothing():
    class File:
        make = MessageFactory()

        def write(self, topic, t, message):
            self.data = message.data.tobytes()

    file, azimuth = File(), np.linspace(-1.0, 1.0, 241)
    blocks = Blocks(file, "/combine/odd")
    for k in range(90):
        blocks.add(k * 5_000_000, Turned(k * 5_000_000 - 1000, azimuth))
    blocks.flush()
    assert len(file.data) == 8 * (2 * 90 + 241)
    assert len(zlib.compress(file.data)) < 450


def test_a_block_of_format_2_is_read():
    """With times as fields of the message, and a held array as it is."""

    class Block:
        signal, published, t = "Turned", np.array([5, 9]), np.array([4, 8])
        names, kinds, held = ["azimuth"], ["<f8 2"], [True]
        data = np.array([0.25, -1.0]).tobytes()

    found = list(unpack(Block()))
    assert [t for t, _ in found] == [5, 9]
    assert [sample.t for _, sample in found] == [4, 8]
    assert all(sample.azimuth.tolist() == [0.25, -1.0] for _, sample in found)


def test_a_recording_without_packed_columns_is_read(tmp_path, monkeypatch):
    """As format 1 has them."""
    monkeypatch.setattr(packed_columns, "pack", lambda column: ("", column.tobytes()))
    samples = [Odd(k, Pose.identity(), 0.5 * k, k, True, np.ones(2), 1.0) for k in range(20)]
    with Recorder(tmp_path, [machine()]) as recorder:
        for sample in samples:
            recorder("combine.odd", sample.t, {"odd": sample})
    found = read_exact(tmp_path / "run.mcap", "combine.odd", "odd")
    assert all(same_bits(made, sample) for (_, made), sample in zip(found, samples, strict=True))


def test_what_cannot_be_kept_is_not(tmp_path):
    @dataclass(frozen=True)
    class Worded(Signal):
        word: str

    assert not is_recordable(Worded(0, "x"))
    with Recorder(tmp_path, [machine()]) as recorder:
        recorder("combine.word", 0, {"word": Worded(0, "x")})
    assert own_outputs(McapLog(tmp_path / "run.mcap"), "combine.word") == {"word": False}


def test_an_unknown_type_is_named():
    with pytest.raises(KeyError):
        signal_type("Nothing")
    assert signal_type("Scan") is Scan
    assert signal_type("ScanTruth") is ScanTruth

    class Block:
        signal, count = "Nothing", 0
        data = names = kinds = held = ()

    with pytest.raises(InputError, match="block of samples"):
        list(unpack(Block()))


def test_a_file_within_the_file(tmp_path):
    with Recorder(tmp_path, [machine()], scenario="name: x\n"):
        pass
    log = McapLog(tmp_path / "run.mcap")
    assert log.attachment("scenario.yaml") == b"name: x\n"
    assert b"swath recording 3" in log.attachment("recording.json")
    assert log.attachment("nothing") is None
