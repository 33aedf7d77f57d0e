"""Grain that leaves a tank: where the pipe ends, and the same for a process from elsewhere."""

import numpy as np
import pytest

from swath.core.component import Port
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.machine.process.straw_laying import LaidStraw
from swath.machine.process.unloading_pipe import UnloadingPipe
from swath.signals import MachineLoad, MachineState
from tests.field.made_field import made_field
from tests.machine.machine_fakes import STREAM, site


def state(t, x, y=0.0, yaw=0.0):
    return MachineState(t, Pose.from_euler((x, y, 0.0), yaw=yaw), 1.0, 0.0, 0.0, 0.0, x)


class Elsewhere:
    """A process that drops 1 kg of straw and unloads 2 kg of grain per step."""

    inputs, outputs = (), (Port("load", MachineLoad),)

    def load_at(self, n):
        return {"load": MachineLoad(n, 0.0, 0.0, 1.0 * n, 0.0, 0.0, 0.0, 0.0, unloaded_grain=2.0 * n)}

    def reset(self, stream):
        self.n = 0
        return self.load_at(0)

    def step(self, t, dt, inputs):
        self.n += 1
        return self.load_at(self.n)

    def save(self):
        return {"n": self.n}

    def load(self, state):
        self.n = state["n"]


def test_the_pipe_ends_to_the_left_of_the_header_wherever_the_machine_heads():
    setup = site()
    pipe = UnloadingPipe(setup)
    beyond = setup.machine.header_y + 0.5 * setup.machine.header_width
    for yaw in (0.0, 1.0, np.pi):
        pipe.pour(3.0, state(0, 10.0, 5.0, yaw))
        x, y, mass = setup.field.grain[-1]
        ahead, left = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]]) @ [x - 10, y - 5]
        assert (ahead, mass) == (pytest.approx(0.0, abs=1e-9), 3.0)
        assert beyond < left < beyond + 3.0
    pipe.pour(0.0, state(0, 0.0))
    assert len(setup.field.grain) == 3


def test_what_a_process_from_elsewhere_unloads_is_on_the_ground():
    field = made_field()
    process = LaidStraw(Elsewhere(), site(field))
    process.reset(STREAM)
    for i in range(50):
        process.step(i * NS, NS, {"state": state(i, 0.3 * i)})
    assert field.ground_grain_kg == pytest.approx(100.0, rel=1e-12)
    kept = process.save()
    other = LaidStraw(Elsewhere(), site(made_field()))
    other.reset(STREAM)
    other.load(kept)
    other.step(50 * NS, NS, {"state": state(50, 15.0)})
    assert other.save()["left"] == (51.0, 102.0)
    assert len(field.grain.piles()) > 10
