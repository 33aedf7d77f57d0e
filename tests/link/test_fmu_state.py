"""The saved state of an exported FMU is data (`tests/core/test_packed_state.py`): it comes back as it was."""

import pickle
from pathlib import Path

import pytest

from swath.core.packed_state import pack, unpack
from swath.link.fmi.export_slave import Fmi2Slave, Fmi3Slave
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from tests.core.same import assert_same
from tests.whole.small import small


class Evil:
    """Leaves a mark where it is unpickled."""

    def __reduce__(self):
        return Path.touch, (Path("mark"),)


def test_the_state_of_a_whole_world_comes_back():
    world = assemble(small("combine.motion.level=single_track"))
    drive(world, until_s=0.5)
    state = world.save()
    assert_same(state, unpack(pack(state)))


@pytest.mark.parametrize("data", [pickle.dumps(Evil()), b"", b"swath FMU state 1\n", pack([1])])
@pytest.mark.parametrize("slave", [Fmi2Slave, Fmi3Slave])
def test_foreign_bytes_run_nothing_and_are_refused_when_they_are_loaded(data, slave, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert slave._fmu_state_from_bytes(data) == {}
    assert not (tmp_path / "mark").exists()
