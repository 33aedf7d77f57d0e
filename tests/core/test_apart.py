"""Files of others are read in a process that can do nothing else, and whose answers are data."""

import json
import os
import socket
import subprocess
import sys
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from swath.core.apart import call
from swath.core.apart.plain import HEAD, KIND, Message, MissingField, Plain, read_plain
from swath.core.errors import InputError
from tests import apart_probe

pytestmark = pytest.mark.apart

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="nothing confines a process on other systems")
READING = {"read the file", "read beside it"}
OF_LANDLOCK = {"read elsewhere", "list elsewhere", "ptrace", "read its environment"}
OF_SECCOMP = {"change rights", "change times", "start a program", "start by a shell", "fork", "kill"}


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "own" / "a.log"
    path.parent.mkdir()
    path.write_text("text")
    path.with_suffix(".beside").write_text("text")
    return path


@pytest.fixture
def fresh(monkeypatch):
    """Readers of this test alone."""
    monkeypatch.setattr(call, "_alive", made := [])
    yield
    for process in made:
        process.close()


@LINUX
@pytest.mark.parametrize("layers", ["landlock,seccomp", "landlock", "seccomp"])
def test_a_reader_reads_and_nothing_else(log, tmp_path, monkeypatch, fresh, layers):
    monkeypatch.setenv(call.LAYERS, layers)
    secret = tmp_path / "elsewhere" / "secret"
    secret.parent.mkdir()
    secret.write_text("secret")
    with socket.create_server(("127.0.0.1", 0)) as server:
        found = apart_probe.attempts(log, str(secret), server.getsockname()[1], os.getpid())
    refused = {name for name, what in found.items() if what != "done"}
    lacking = set()
    if "landlock" not in layers:
        lacking = OF_LANDLOCK
    elif "seccomp" not in layers:
        lacking = refused & OF_SECCOMP ^ OF_SECCOMP  # as far as this version of Landlock goes
    assert refused == found.keys() - READING - lacking, found
    assert (log.read_text(), secret.read_text()) == ("text", "secret")
    assert sorted(p.name for p in log.parent.iterdir()) == ["a.beside", "a.log"]


def test_what_ends_a_reader_is_an_error_of_the_file(log, monkeypatch, fresh):
    monkeypatch.setenv(call.SECONDS, "1")
    for reader, said in ((lambda: apart_probe.much(log, 3.0), "memory"),
                         (lambda: apart_probe.long(log), "more than 1 s"),
                         (lambda: apart_probe.broken(log), "signal 6")):  # fmt: skip
        if said.startswith("more") and sys.platform != "linux":
            continue
        with pytest.raises(InputError, match=said) as caught:
            reader()
        assert caught.value.file == log
    assert apart_probe.much(log, 0.1) > 0  # the next one is read by another


def test_iterators_come_in_blocks_and_tell_errors_in_their_place(log):
    assert [n for n, *_ in apart_probe.counted(log, 5000, -1)] == [*range(5000)]
    met = []
    with pytest.raises(ValueError, match="at 5000"):
        met.extend(apart_probe.counted(log, 9000, 5000))
    number, array, named = met[-1]
    assert len(met) == 5000
    assert (number, named) == (4999, {"name": "4999"})
    np.testing.assert_array_equal(array, [4999] * 3)
    array[0] = 1  # it is the reader's own
    two = [apart_probe.counted(log, 9000, -1) for _ in range(2)]
    assert [[next(each)[0], next(each)[0]] for each in two] == [[0, 1], [0, 1]]
    two[0].close()
    assert next(two[1])[0] == 2


def test_an_object_stays_and_tells_its_notes(log):
    tally = apart_probe.tally(log)
    assert (tally.path, tally.notes) == (log, {})
    assert sum(tally.numbers(100)) == 4950
    assert tally.notes == {"numbers": 100}
    with pytest.raises(KeyError, match="nothing"):
        tally.fail()


def test_another_file_ends_no_object_that_stays(log, fresh):
    tally = apart_probe.tally(log)
    other = log.with_name("other.log")
    other.write_text("other")
    assert apart_probe.content(log) == b"text"  # by the same reader
    assert len(call._alive) == 1
    with pytest.raises(InputError, match="signal 6"):
        apart_probe.broken(other)
    assert sum(tally.numbers(100)) == 4950


def test_a_folder_has_one_reader_and_few_stay(log, tmp_path, fresh):
    for name in ("a", "b", "c"):
        log.with_name(f"{name}.log").write_text(name)
        assert apart_probe.content(log.with_name(f"{name}.log")) == name.encode()
    assert len(call._alive) == 1
    (tmp_path / "far.log").write_text("far")
    log.with_name("link.log").symlink_to(tmp_path / "far.log")
    assert apart_probe.content(log.with_name("link.log")) == b"far"  # by one that may read it, too
    assert len(call._alive) == 2
    for number in range(call.MOST_ALIVE + 2):
        other = tmp_path / str(number) / "a.log"
        other.parent.mkdir()
        other.write_text("")
        apart_probe.much(other, 0.0)
    assert len(call._alive) == call.MOST_ALIVE


def test_a_folder_that_is_made_anew_is_read(tmp_path, fresh):
    path = tmp_path / "made" / "a.log"
    for content in (b"", b"one", b"other", b"third"):
        if path.parent.is_dir():
            path.parent.rename(tmp_path / f"was {content}")  # its number stays taken
        path.parent.mkdir()
        path.write_bytes(content)
        if content:
            assert apart_probe.content(path) == content
        else:
            with pytest.raises(InputError, match="empty"):
                apart_probe.content(path)
    assert len([p for p in call._alive if p.is_alive]) == 1
    (first,) = (p for p in call._alive if p.is_alive)
    first.may_read = False
    assert apart_probe.content(path) == b"third"
    first.may_read = True  # two for a folder, as readers with other libraries have
    path.parent.rename(tmp_path / "was third")
    path.parent.mkdir()
    path.write_bytes(b"fourth")
    assert apart_probe.content(path) == b"fourth"


def test_a_file_of_our_own_is_read_here(log, fresh):
    call.written_here(log)
    assert apart_probe.much(log, 0.0) == 0
    assert not call._alive
    log.write_text("of somebody else")
    assert apart_probe.much(log, 0.0) == 0
    assert call._alive


def test_a_program_with_python_inside_finds_an_interpreter(monkeypatch):
    from swath.core.process.processes import interpreter

    for executable in ("/usr/bin/simulink", "", None):
        monkeypatch.setattr(sys, "executable", executable)
        found = interpreter()
        asked = subprocess.run([found, "-c", "import sys; print(sys.version_info[:2])"], capture_output=True)
        assert asked.stdout.decode().strip() == str(sys.version_info[:2])


@dataclass(frozen=True)
class Place:
    """A record."""

    names: tuple[str, ...]
    pairs: tuple[tuple[int, int], ...]
    values: object
    sizes: list[int]


def there_and_back(value, classes=None, say=Plain.text):
    plain, file = Plain(), BytesIO()
    plain.write(file, say(plain, value))
    file.seek(0)
    return read_plain(lambda size: bytearray(file.read(size)), classes or {}, 1 << 20)


def test_values_come_back():
    value = {"a": [1, 2.5, None, True, "x"], "f": float("inf"), "b": b"\0\1", "p": Path("/x")}
    assert there_and_back(value) == value
    for array in (np.arange(6.0).reshape(2, 3).T, np.zeros((0, 3), np.int16), np.array(3), np.array(["ab"]),
                  np.array([(1, 2.0)], [("i", "<u2"), ("x", ">f8")]), np.array([True, False])):  # fmt: skip
        back = there_and_back(array)
        assert back.dtype == array.dtype
        np.testing.assert_array_equal(back, array)
    place = Place(("a", "b"), ((1, 2),), {"n": [1]}, [3])
    assert there_and_back(place, {"Place": Place}) == place


FIX, HEADER, EMPTY = (
    type(f"sensor_msgs__msg__{name}", (), {"__msgtype__": f"sensor_msgs/msg/{name}"})
    for name in ("Fix", "Header", "Empty")
)


def with_fields(kind, **values):
    made = kind()
    vars(made).update(values)
    return made


def test_messages_are_names_with_values():
    message = with_fields(FIX, header=with_fields(HEADER, stamp=3), ranges=np.arange(3, dtype=np.float32))
    back = there_and_back(message)
    assert isinstance(back, Message)
    assert back.__msgtype__ == "sensor_msgs/msg/Fix"
    assert back.header.stamp == 3
    assert getattr(back, "absent", None) is None
    with pytest.raises(MissingField, match=r"sensor_msgs/msg/Fix.*a field absent"):
        back.absent  # noqa: B018


def same(one, other):
    if hasattr(one, "__msgtype__"):
        return one.__msgtype__ == other.__msgtype__ and all(
            same(value, getattr(other, name)) for name, value in vars(one).items()
        )
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.tobytes() == other.tobytes()
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and (one == other or one != one)


def test_many_messages_come_back_as_they_were():
    rng, messages = np.random.default_rng(3), []
    for k in range(50):
        header = with_fields(HEADER, stamp=k, frame=("a", "ä\n")[k % 2])
        values = np.arange(3.0 if k < 25 else k, dtype=np.float32)
        inner = [with_fields(HEADER, stamp=n, frame="") for n in range(k % 3)]
        fix = with_fields(
            FIX, header=header, values=values, alike=rng.random(4), many=inner, is_ok=k % 2 == 0,
            x=(float("nan"), 1e300, -0.0)[k % 3], large=2**64 - 1 - k, is_text=np.array(["x"]),
        )  # fmt: skip
        messages += [("/fix", 10**18 + k, fix), ("/stamp", k, header), ("/empty", -k, EMPTY())]
    mixed = [("/one", k, with_fields(EMPTY, x=(1, 0.5)[k], ok=(1, True)[k])) for k in range(2)]
    one = [("/one", k, with_fields(EMPTY, only=np.full(9000, k))) for k in range(3)]
    for group in (messages, messages[:1], one, mixed, [("/empty", 0, EMPTY())] * 3, [], [1, ("a", 2, 3)]):
        back = there_and_back(group, say=Plain.many)
        assert len(back) == len(group)
        for given, found in zip(group, back, strict=True):
            assert all(map(same, given, found)) if isinstance(given, tuple) else given == found
    with pytest.raises(MissingField, match=r"sensor_msgs/msg/Empty.*a field absent"):
        there_and_back(one, say=Plain.many)[0][2].absent  # noqa: B018


def answer(tree, *buffers):
    text = json.dumps(tree).encode()
    sizes = np.array([len(b) for b in buffers], "<u8").tobytes()
    return HEAD.pack(len(text), len(buffers)) + sizes + text + b"".join(buffers)


def messages(form, *columns, of=(["/a"], [1], [0])):
    return answer({KIND: "messages", "of": of, "types": [{"form": form, "columns": columns}]})


@pytest.mark.parametrize("data", [
    answer({KIND: "record Popen", "args": ["touch", "ACTED"]}),
    answer({KIND: "record Path", "x": 1}),
    answer({KIND: "message os.system"}),
    answer({KIND: "message " + "x" * 999}),
    answer({KIND: "array", "in": 0, "of": "O", "shape": [1]}, b"\0" * 8),
    answer({KIND: "array", "in": 0, "of": "f8", "shape": [1 << 60]}, b"\0" * 8),
    answer({KIND: "array", "in": 9, "of": "f8", "shape": [1]}),
    answer({KIND: "array", "in": "x"}),
    answer({KIND: ["a"]}),
    messages(["a.b", {}]),
    messages(["a", {"x": 1}], [1]),
    messages(["a", {"x": "y"}], [1]),
    messages(["a", {"x": 0}], [1], of=[["/a"], [1], [9]]),
    messages(["a", {"x": 0}], [1], of=[["/a"], [1, 2], [0]]),
    messages(["a", {"x": 0}], [1], of=[["/a", "/a"], [1, 2], [0, 0]]),
    HEAD.pack(1 << 40, 0),
    HEAD.pack(2, 1 << 30),
    HEAD.pack(2, 1) + (1 << 50).to_bytes(8, "little"),
    HEAD.pack(3, 0) + b"\xff{}",
    HEAD.pack(2000, 0) + b"[" * 2000,
    HEAD.pack(9000, 0) + b"9" * 9000,
], ids=str)  # fmt: skip
def test_an_answer_of_a_broken_reader_is_refused(data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = BytesIO(data)
    with pytest.raises((ValueError, LookupError, TypeError, RecursionError, AttributeError)):
        read_plain(lambda size: bytearray(file.read(size)), {"Place": Place}, 1 << 20)
    assert not [*tmp_path.iterdir()]
