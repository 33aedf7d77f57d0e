"""The auger and its stream: times, throw, wind, what misses the box."""

import dataclasses
import math

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.field.site_setup import Bodies
from swath.field.solid.solids import trailer_body
from swath.machine.heap import height_map
from swath.machine.heap.open_box import Params
from swath.machine.machine_sheet import load_machine
from swath.machine.unload import auger
from swath.machine.unload.auger import fall_time
from swath.signals import MachineLoad, MachineState, UnloadCommand
from tests.machine.machine_fakes import STREAM, Ground, site

COMBINE, CART = load_machine("lexion-700"), load_machine("tractor-grain-cart")
OUT = UnloadCommand(0, math.pi / 2, True)
DT = NS // 20


def setup_with_box(box_at=None):
    """A combine at the origin; box_at: place of a cart's trailer, parallel to it."""
    setup = dataclasses.replace(site(Ground(), COMBINE), name="combine", bodies=Bodies())
    heap = None
    if box_at is not None:
        cart = dataclasses.replace(setup, name="cart", machine=CART)
        heap = height_map.HeightMap(Params(repose_deg=25.0), cart)
        heap.reset(STREAM)
        setup.bodies.add(
            "cart.trailer", trailer_body(CART.hitch, 3.6, CART.box), Pose.from_euler((*box_at, 0.0))
        )
    return setup, heap


def pour(level, setup, seconds, inflow=0.0, speed=0.0, **params):
    """Pipe out, the tank full at first: (state of the pipe, seconds in which it poured at least half)."""
    part = level.component(level.params(**params), setup)
    part.reset(STREAM)
    full = COMBINE.drivetrain.tank
    drawn = lasted = 0.0
    for i in range(round(seconds * 20)):
        grain = full + inflow * 0.05 * (i + 1) - drawn
        load = MachineLoad(i, grain, *[0.0] * 6, unloaded_grain=drawn)
        pose = Pose.from_euler((speed * 0.05 * (i + 1), 0.0, 0.0))
        state = MachineState(i, pose, speed, 0.0, 0.0, 0.0, 0.0)
        found = part.step(i * DT, DT, {"command": OUT, "load": load, "state": state})["unload"]
        lasted += 0.05 if found.drawn - drawn > 0.5 * 92.4 * 0.05 else 0.0
        drawn = found.drawn
    return found, lasted


def test_while_cutting_it_takes_longer():
    """12 m3 at 120 l/s while 23.8 kg/s come in: 9240 / (92.4 - 23.8) = 135 s."""
    setup, _ = setup_with_box()
    _, lasted = pour(auger.PRESETS["ideal"], setup, 150.0, inflow=23.8)
    assert lasted == pytest.approx(9240.0 / (92.4 - 23.8), rel=0.01)
    assert lasted == pytest.approx(135.0, rel=0.01)


def test_run_up_and_run_out():
    """Ramps of 2 and 1.5 s carry half of what the full flow would."""
    setup, _ = setup_with_box()
    part = auger.Auger(auger.Params(), setup)
    part.reset(STREAM)
    load = MachineLoad(0, 5000.0, *[0.0] * 6)
    flows, swing = [], 0.0
    for i in range(700):
        command = OUT if i < 500 else UnloadCommand(0, math.pi / 2, False)
        state = MachineState(0, Pose.identity(), 0.0, 0.0, 0.0, 0.0, 0.0)
        found = part.step(i * DT, DT, {"command": command, "load": load, "state": state})["unload"]
        swing = swing or (i + 1) * 0.05 * (found.flow > 0.0)
        flows.append(found.flow)
    full = max(flows)
    assert full == pytest.approx(92.4)
    assert swing == pytest.approx(0.97 * 90.0 / 8.0, abs=0.1)  # no grain before the pipe is out
    out = (500 * 0.05 - swing - 1.0) * full + 0.5 * 1.5 * full
    assert found.drawn == pytest.approx(out, rel=0.01)
    assert found.held == 0.0


def test_the_stream_falls_ballistically():
    """From the mouth, 2.5 m/s at 45 deg: to the ground in 0.81 s, 1.43 m on, less what the air takes."""
    setup, _ = setup_with_box()
    pour(auger.PRESETS["ideal"], setup, 5.0)
    pipe = COMBINE.pipe
    seconds = fall_time(pipe.z, 2.5 * math.sqrt(0.5))
    assert 2.5 * math.sqrt(0.5) * seconds + 0.5 * 9.81 * seconds**2 == pytest.approx(pipe.z)
    x, y, _ = np.mean(setup.field.grain, axis=0)
    throw = 2.5 * math.sqrt(0.5) * seconds
    drag = 0.5 * 0.2 * 2.5 * math.sqrt(0.5) * seconds**2
    assert x == pytest.approx(pipe.x, abs=1e-6)
    assert y == pytest.approx(pipe.y + pipe.length + throw - drag, abs=1e-3)


def test_wind_carries_the_stream():
    still, windy = setup_with_box()[0], setup_with_box()[0]
    pour(auger.LEVEL, still, 16.0)
    pour(auger.LEVEL, windy, 16.0, wind_east_m_s=5.0)
    east = [np.mean([g[0] for g in s.field.grain]) for s in (still, windy)]
    assert east[1] - east[0] == pytest.approx(0.5 * 0.2 * 5.0 * 0.81**2, abs=0.03)


def test_what_falls_into_the_box_and_beside_it():
    """The box under the stream takes all, one 3 m aside nothing; every kilogram is somewhere."""
    for aside, share in ((8.4, 1.0), (12.0, 0.0)):
        setup, heap = setup_with_box((-0.9, aside))
        found, _ = pour(auger.LEVEL, setup, 40.0)
        on_ground = sum(g[2] for g in setup.field.grain)
        assert found.caught == pytest.approx(share * (found.caught + found.missed))
        assert heap.gained == pytest.approx(found.caught, rel=1e-12)
        assert on_ground == pytest.approx(found.missed, rel=1e-12)
        assert found.drawn == pytest.approx(found.caught + found.missed + found.held, rel=1e-12)
        assert found.drawn > 1000.0


def test_saved_and_loaded():
    setup, heap = setup_with_box((-0.9, 8.4))
    part = auger.Auger(auger.Params(), setup)
    part.reset(STREAM)
    inputs = {
        "command": OUT,
        "load": MachineLoad(0, 5000.0, *[0.0] * 6),
        "state": MachineState(0, Pose.identity(), 0.0, 0.0, 0.0, 0.0, 0.0),
    }
    for i in range(300):
        part.step(i * DT, DT, inputs)
    second, other_heap = setup_with_box((-0.9, 8.4))
    other = auger.Auger(auger.Params(), second)
    other.reset(STREAM)
    other.load(part.save())
    other_heap.load(heap.save())
    a, b = (p.step(300 * DT, DT, inputs)["unload"] for p in (part, other))
    assert (a.drawn, a.held, a.caught) == (b.drawn, b.held, b.caught)
