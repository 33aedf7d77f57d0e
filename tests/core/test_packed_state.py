"""States as bytes: they come back as they were, and nothing that they name is run."""

import os
import pickle
from array import array
from collections import deque

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.packed_state import UnpackableState, pack, unpack
from swath.signals import SteerCommand


class Mine:
    """A class that is not swath's."""


class Run:
    def __reduce__(self):
        return os.system, ("exit 1",)


def test_what_parts_remember_comes_back():
    held = np.arange(3.0)
    state = {
        "array": np.eye(3, dtype=np.float32)[:, ::2],
        "number": np.float64(0.1),
        "queue": deque([(1, 2.5)], maxlen=4),
        "rows": array("d", [1.0, float("nan")]),
        "pose": Pose.from_euler([1.0, 2.0, 3.0], yaw=0.3),
        "sample": SteerCommand(5, 0.25, True),
        ("key", SteerCommand): {1, 2},
        "same": [held, held],
    }
    back = unpack(pack(state))
    assert np.array_equal(back["array"], state["array"])
    assert (back["number"], back["queue"], back["queue"].maxlen) == (np.float64(0.1), state["queue"], 4)
    assert back["rows"].tobytes() == state["rows"].tobytes()
    assert np.array_equal(back["pose"].rotation, state["pose"].rotation)
    assert (back["sample"], back["key", SteerCommand]) == (state["sample"], {1, 2})
    assert back["same"][0] is back["same"][1]


def test_what_is_shared_is_left_out_and_replaced():
    mine, other = Mine(), Mine()
    data = pack({"field": mine, "again": [mine]}, {"field": mine})
    back = unpack(data, {"field": other})
    assert back["field"] is back["again"][0] is other
    with pytest.raises(UnpackableState, match="refers to field"):
        unpack(data)


@pytest.mark.parametrize(
    "value", [print, lambda: 0, "x".join, os.system, Mine, Mine(), os.stat("."), deque([Mine()])]
)
def test_what_cannot_be_saved_is_refused_at_once(value):
    with pytest.raises(UnpackableState, match="cannot be saved"):
        pack({"value": value})


def test_what_others_wrote_runs_nothing(tmp_path):
    for evil in (Run(), os.system, getattr):
        with pytest.raises(UnpackableState, match="which is not read"):
            unpack(pickle.dumps(evil))
    file = tmp_path / "made"
    made = b"cswath.record.mcap_file\nMcapFile\n(V" + str(file).encode() + b"\ntR."
    with pytest.raises(UnpackableState, match="which is not read"):
        unpack(made)
    assert not file.exists()
    named = pickle.dumps(("swath.core.packed_state", "made"))[:-1]
    with pytest.raises(UnpackableState):
        unpack(b"cswath.core.packed_state\nmade\n(Vos\nVsystem\ntR.")
    with pytest.raises(UnpackableState):
        unpack(named)
