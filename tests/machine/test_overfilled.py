"""Grain tanks and boxes that get more than they hold: none is above its volume, nothing is lost untold."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.core.together import Samples
from swath.field.memory_layout import Solids
from swath.field.site_setup import Bodies, Landing
from swath.judge.evaluators.overfilled import LEVEL
from swath.machine.heap import cones, height_map
from swath.machine.machine_sheet import load_machine
from swath.machine.process import constant, threshing
from swath.signals import CropFlow, MachineState
from tests.machine.machine_fakes import STREAM, Ground, site

LEVELS = (constant.LEVEL, constant.PRESETS["delay_line"], threshing.LEVEL)
STEP = NS // 2
GRAIN, STRAW = 3.0, 2.0  # of a step [kg]
MACHINE = load_machine("combine-5m")
HOLDS = MACHINE.drivetrain.tank


def of_steps(made, times, resumed=None):
    """Loads of a process that is fed until its tank is full 1.3 times over, and then runs empty.

    resumed: another process that goes on from a save of it when it is all but full
    """
    loads = [made.reset(STREAM)["load"]]
    fed = math.ceil(1.3 * HOLDS / GRAIN)
    for i in range(fed + times):
        if resumed is not None and loads[-1].tank_grain > 0.995 * HOLDS:
            resumed.reset(STREAM)
            resumed.load(made.save())
            made, resumed = resumed, None
        mass = (GRAIN, STRAW) if i < fed else (0.0, 0.0)
        t = i * STEP
        state = MachineState(t + STEP, Pose.from_euler((0.5 * i, 0.0, 0.0)), 1.0, 0.0, 0.0, 0.0, 0.5 * i)
        flow = CropFlow(t + STEP, *mass, 1.0, 500, 1.0, 0.5)
        loads.append(made.step(t, STEP, {"flow": (flow,), "state": state})["load"])
    return loads, fed * GRAIN


def judged(loads, machine=MACHINE):
    bodies = Bodies()
    bodies.add("combine", Solids(), Pose.identity())
    seen = LEVEL.component(SimpleNamespace(name="combine", machine=SimpleNamespace(geometry=machine)))
    for load in loads:
        seen.see("combine.process", load.t, {"load": load})
    return seen


@pytest.mark.parametrize("level", LEVELS)
def test_a_full_tank_spills_what_comes_and_says_so(level):
    loads, grain = of_steps(level.component(level.params(), site(machine=MACHINE)), 120)
    assert max(load.tank_grain for load in loads) <= HOLDS * (1.0 + 1e-12)
    end = loads[-1]
    assert end.tank_grain == pytest.approx(HOLDS, rel=1e-12)
    assert end.tank_gain + end.lost_grain + end.held_grain == pytest.approx(grain, rel=1e-12)
    seen = judged(loads)
    over_the_rear = math.fsum(x.threshing_loss + x.separation_loss + x.cleaning_loss for x in loads) * 0.5
    assert seen.metrics()["tank_spilled_kg"] == pytest.approx(end.lost_grain - over_the_rear, rel=1e-9)
    (event,) = seen.events()
    assert event.kind == "spill"
    assert "grain tank of combine" in event.text
    full = next(load.t for load in loads if load.tank_grain >= HOLDS * (1.0 - 1e-9))
    assert event.t == pytest.approx(full, abs=2 * STEP)
    assert seen.end_reason(0) == ""


@pytest.mark.parametrize("level", LEVELS)
def test_a_tank_that_was_all_but_full_in_a_save_spills_as_if_it_had_gone_on(level):
    """Also where what it begins with is said otherwise meanwhile: what is in it does not change by that."""
    start, other = ({"tank_start_percent": v} if level is threshing.LEVEL else {} for v in (20.0, 0.0))
    made, alone, resumed = (level.component(level.params(**v), site(machine=MACHINE))
                            for v in (start, start, other))  # fmt: skip
    assert of_steps(made, 5, resumed)[0] == of_steps(alone, 5)[0]


@pytest.mark.parametrize("level", LEVELS)
def test_a_tank_that_is_not_full_is_not_touched(level):
    made = level.component(level.params(), site(machine=MACHINE))
    loads = of_steps(made, 0)[0][: int(0.9 * HOLDS / GRAIN)]
    seen = judged(loads)
    assert seen.metrics() == {"tank_spilled_kg": 0.0}
    assert not seen.events()


def test_a_machine_whose_sheet_says_so_stops():
    bulk = dataclasses.replace(MACHINE.drivetrain.bulk, when_full="stops")
    machine = dataclasses.replace(MACHINE, drivetrain=dataclasses.replace(MACHINE.drivetrain, bulk=bulk))
    loads, _ = of_steps(constant.ConstantProcess(constant.Params(), site(machine=machine)), 0)
    assert "rim of the grain tank" in judged(loads, machine).end_reason(0)


def test_worlds_in_step_spill_as_one_does():
    alone, _ = of_steps(constant.ConstantProcess(constant.Params(), site(machine=MACHINE)), 0)
    parts = [constant.ConstantProcess(constant.Params(), site(machine=MACHINE)) for _ in range(2)]
    for part in parts:
        part.field.profile = SimpleNamespace(straw=np.zeros(1))
    both = constant.ConstantProcess.together(parts)
    both.reset([STREAM, STREAM])
    flows = [CropFlow(0, *masses, 1.0, 500, 1.0, 0.5) for masses in ((GRAIN, STRAW), (0.0, 0.0))]
    where = Samples.joined([MachineState(0, Pose.identity(), 1.0, 0.0, 0.0, 0.0, 0.0)] * 2)
    for i in range(len(alone) - 1):
        inputs = {"flow": (Samples.joined(flows),), "state": where}
        found = both.step(i * STEP, STEP, inputs)["load"]
        assert found.of(0) == alone[i + 1]
    assert found.of(1).tank_grain == found.of(1).lost_grain == 0.0


def test_a_process_from_elsewhere_with_more_than_its_tank_holds_is_told():
    loads, _ = of_steps(constant.ConstantProcess(constant.Params(), site(machine=MACHINE)), 0)
    more = [dataclasses.replace(load, tank_grain=1.3 * load.tank_grain, tank_start=0.0) for load in loads]
    assert judged(more).events()
    less = [dataclasses.replace(load, tank_grain=0.9 * load.tank_grain) for load in loads]
    assert not judged(less).events()


@pytest.mark.parametrize("level", [height_map, cones])
@pytest.mark.parametrize("name", ["tractor-grain-cart", "grain-truck"])
@pytest.mark.parametrize("start", [0.0, 100.0])
@pytest.mark.parametrize("changed", [None, {"start_percent": 40.0, "density_kg_m3": 500.0}])
def test_a_box_that_is_overfilled_everywhere_holds_its_heap_and_no_more(level, name, start, changed):
    """changed: said otherwise where it goes on from a save in which it is all but full"""
    bodies, ground = Bodies(), Ground()
    setup = dataclasses.replace(site(ground, load_machine(name)), name="cart", bodies=bodies)
    bodies.add(setup.carrier, Solids(), Pose.identity())
    heap = level.LEVEL.component(level.LEVEL.params(start_percent=start), setup)
    box, landing, poured = heap.box, Landing(ground, bodies), 0.0
    rng = np.random.default_rng(3)
    most = 1.5 * heap.largest * heap.density
    while poured < most:
        if changed is not None and heap.grain > 0.9 * heap.largest * heap.density:
            state, heap = heap.save(), level.LEVEL.component(level.LEVEL.params(**changed), setup)
            heap.load(state)
            changed = None
        x, y = rng.uniform(-0.5, 0.5, 2) * (box.length, box.width)
        landing.land(400.0, np.array([box.x + x, y, 4.0]))
        poured += 400.0
    told = heap.step(0, NS, {})["heap"]
    assert told.grain <= heap.largest * heap.density * 1.01  # of cells
    assert heap._surface.volume * heap.density == pytest.approx(told.grain, rel=1e-9)
    spilled = math.fsum(mass for _, _, mass in ground.grain)
    assert told.spilled == pytest.approx(spilled, rel=1e-9)
    assert spilled > 0.2 * poured
    assert heap.gained + spilled == pytest.approx(poured, rel=1e-9)
    seen = LEVEL.component(SimpleNamespace(name="cart", machine=SimpleNamespace(geometry=setup.machine)))
    seen.see("cart.heap", 0, {"heap": told})
    assert [event.kind for event in seen.events()] == ["spill"]
    assert not seen.metrics()
