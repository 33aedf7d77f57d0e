"""A machine with straw walkers: by hand, and against what such machines took."""

import math

import numpy as np
import pytest

from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.machine_sheet import load_machine
from swath.machine.separation.walkers import Params, Walkers
from swath.scenario.scenario import parse_scenario
from tests.machine.machine_fakes import STREAM, site
from tests.machine.organ_trends import FLOW, steady
from tests.machine.process_rig import state

MACHINE = load_machine("combine-walkers")
MOG = drivetrain_of(MACHINE).threshing.straw


WALKERS = (MACHINE, {"separation": "walkers"}, MOG)
ROTORS = (None, {}, FLOW[1])


def capacity(crop, machine, levels, nominal):
    """Straw and chaff [t/h], 0.65 of the grain, at which 3 % of the grain is lost."""
    feeds = np.linspace(0.3, 2.0, 18) * nominal
    each = [steady(crop, machine=machine, levels=levels, nominal=(mog / 0.65, mog))[:3] for mog in feeds]
    lost = np.sum(each, axis=1)
    over = int(np.argmax(lost > 0.03))  # with little straw more grain is blown out
    return 3.6 * float(np.interp(0.03, lost[over - 1 : over + 1], feeds[over - 1 : over + 1]))


def test_capacity_is_that_of_measured_machines():
    """16.3 t/h (John Deere 7721), 13.9 t/h (Gleaner L2) in wheat. Barley over wheat 0.48 to 0.5, walkers,
    and 0.7, rotors (PAMI).
    """
    wheat = capacity("wheat", *WALKERS)
    assert 13.0 < wheat < 19.0
    assert 0.47 < capacity("barley", *WALKERS) / wheat < 0.51
    assert 0.68 < capacity("barley", *ROTORS) / capacity("wheat", *ROTORS) < 0.72


def passage(ratio=1.0, moisture=0.12, roll=0.0):
    walkers = Walkers(Params(), site(machine=MACHINE))
    walkers.reset(STREAM)
    engine = type("Engine", (), {"speed_ratio": ratio})
    inputs = {"settings": None, "engine": engine, "state": state(0, 0.0, 1.0, roll=roll)}
    return walkers._passage(inputs, 0.1, moisture)


def test_walkers_by_hand():
    """20 % in, four sections of 1.17: 0.186 % out; a crank 1 rad/s slow separates 15 % less."""
    assert 0.2 * math.exp(-drivetrain_of(MACHINE).threshing.rotor_separation) == pytest.approx(
        0.00186, rel=5e-3
    )
    assert (passage().threshing, passage().separation) == (0.0, 1.0)
    assert passage(ratio=21.5 / 22.5).separation == pytest.approx(0.85, abs=2e-3)
    assert passage(moisture=0.2).separation == pytest.approx(math.exp(-0.2))
    slope = passage(roll=math.atan(0.1)).separation
    assert 1.2 < math.exp(4.68 * (1.0 - slope)) < 1.5


def test_the_walkers_come_with_the_organs():
    text = """
format: swath scenario 2
name: walkers
field: {edge: {shape: straight}}
machines: {combine: {machine: combine-walkers%s}}
"""
    slots = parse_scenario(text % ", process: organs").machines["combine"].slots
    assert (slots["separation"].level, slots["cleaning"].level) == ("walkers", "model")
    assert "separation" not in parse_scenario(text % "").machines["combine"].slots
