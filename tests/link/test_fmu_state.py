"""The saved state of an exported FMU is data: it comes back as it was, and foreign bytes run nothing."""

import dataclasses
import json
import pickle
import random
from collections import deque
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.link.fmi.export_slave import Fmi2Slave, Fmi3Slave
from swath.link.fmi.state_bytes import LENGTH, MAGIC, state_from_bytes, state_to_bytes
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.signals import CropEdge, SteerCommand
from tests.whole.small import small

PLAIN = {
    "numbers": [0, -1, 2**80, 0.1, -0.0, 1e300, float("inf")],
    "texts": ["", "a\0b", "ä"],
    "none": None,
    ("combine.motion", 3): (True, False, (1, [2])),
    "set": {1, 2},
    "queue": deque([1, 2, 3], maxlen=3),
    "bytes": b"\x00\xff",
    "array": np.arange(6, dtype=np.float32).reshape(2, 3),
    "empty": np.zeros((0, 4), dtype=bool),
    "scalar": np.float64(1.5),
    "records": np.array([(1, 2.5)], dtype=[("id", "<i4"), ("x", "<f8")]),
    "sample": SteerCommand(5, 0.25, True),
    "pose": Pose.from_euler([1.0, 2.0, 3.0], yaw=0.5),
    "edge": CropEdge(7, *[float("nan")] * 7),
}


def assert_same(a, b):
    assert type(a) is type(b)
    if isinstance(a, dict):
        assert list(a) == list(b)
        for key in a:
            assert_same(a[key], b[key])
    elif isinstance(a, list | tuple | deque):
        assert len(a) == len(b)
        assert not isinstance(a, deque) or a.maxlen == b.maxlen
        for x, y in zip(a, b, strict=True):
            assert_same(x, y)
    elif isinstance(a, np.ndarray):
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    elif dataclasses.is_dataclass(a):
        for field in dataclasses.fields(a):
            assert_same(getattr(a, field.name), getattr(b, field.name))
    else:
        assert a == b or (a != a and b != b)


def test_everything_comes_back_as_it_was():
    back = state_from_bytes(state_to_bytes(PLAIN))
    assert_same(PLAIN, back)
    assert back["array"].flags.writeable


def test_the_state_of_a_whole_world_comes_back():
    world = assemble(small("combine.motion.level=single_track"))
    drive(world, until_s=0.5)
    state = world.save()
    assert_same(state, state_from_bytes(state_to_bytes(state)))


def test_what_is_no_data_is_refused():
    for value in (open, Path(), SimpleNamespace(a=1), np.array([object()], dtype=object)):
        with pytest.raises(InputError, match="expected plain data, arrays and dataclasses"):
            state_to_bytes({"a": value})


def tree(plain):
    text = json.dumps(plain).encode()
    return MAGIC + LENGTH.pack(len(text)) + text


class Evil:
    """Leaves a mark where it is unpickled."""

    def __reduce__(self):
        return Path.touch, (Path("mark"),)


FOREIGN = {
    "a pickle": pickle.dumps(Evil()),
    "nothing": b"",
    "no tree": MAGIC + LENGTH.pack(9) + b"{",
    "another module": tree({"object": ["subprocess:Popen", {"args": "touch mark"}]}),
    "no dataclass": tree({"object": ["swath.link.fmi.child_process:ChildProcess", {}]}),
    "other fields": tree({"object": ["swath.signals:SteerCommand", {"t": 1}]}),
    "a function": tree({"object": ["swath.commands.main:main", {}]}),
    "objects in an array": tree({"array": ["|O", [1], 0]}),
    "a length beyond the end": tree({"bytes": 10**12}),
    "a negative length": tree({"bytes": -1}),
    "deep": MAGIC + LENGTH.pack(200_000) + b"[" * 200_000,
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_foreign_bytes_are_refused_and_run_nothing(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="expected the bytes of a state of this FMU"):
        state_from_bytes(FOREIGN[kind])
    for slave in (Fmi2Slave, Fmi3Slave):
        assert slave._fmu_state_from_bytes(FOREIGN[kind]) == {}  # refused when it is loaded
    assert not (tmp_path / "mark").exists()


def test_damaged_bytes_are_read_or_refused():
    whole, rng = state_to_bytes(PLAIN), random.Random(1)
    for _ in range(500):
        data = bytearray(whole)
        for _ in range(rng.choice((1, 3))):
            data[rng.randrange(len(MAGIC), len(data))] = rng.randrange(256)
        assert isinstance(Fmi3Slave._fmu_state_from_bytes(bytes(data[: rng.randrange(len(data))])), dict)
        assert isinstance(Fmi3Slave._fmu_state_from_bytes(bytes(data)), dict)
