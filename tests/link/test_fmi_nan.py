"""FMUs whose inputs may be nan, and PythonFMU's parameters without a variability."""

import json
import math
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import pytest

from swath import load_scenario
from swath.core.component import Port
from swath.core.errors import InputError, SwathError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.link.fmi.description import read_fmu
from swath.link.levels.fmu import Params, make_part
from swath.machine.machine_sheet import load_machine
from swath.runtime.assembly import assemble
from swath.signals import CropEdge, SteerCommand
from swath.signals.setup import ControlSetup, LinkSetup
from tests.link.made_fmus import python_fmu

pytest.importorskip("pythonfmu")
pytest.importorskip("fmpy")
STEP = 40_000_000  # of the slot `steer` [ns]
LAW = """
from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Integer, Real, String


class {name}(Fmi2Slave):
    def __init__(self, **keys):
        super().__init__(**keys)
        self.gain, self.teeth, self.is_quick, self.word = 0.25, 3, True, "x"
        self.offset, self.heading, self.kappa, {more} = 0.5, 0.0, 0.0, 0.0
        for name, kind in (("gain", Real), ("teeth", Integer), ("is_quick", Boolean), ("word", String)):
            self.register_variable(kind(name, causality=Fmi2Causality.parameter))  # no variability
        for name in ("offset", "heading", {listed}):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        self.register_variable(Real("kappa", causality=Fmi2Causality.output))

    def do_step(self, t, h):
        self.kappa = {law}
        return True
"""


@cache
def law(text="-self.gain * self.offset", more="seen"):
    """An FMU by PythonFMU with default variabilities."""
    listed = "" if more == "seen" else f'"{more}"'
    name = f"PLaw{abs(hash((text, more)))}"  # PythonFMU knows modules of a process by name
    script = LAW.format(law=text, more=f"self.{more}", listed=listed, name=name)
    return python_fmu(mkdtemp(), script, "pythonfmu")


KEYS = {"outputs": {"command.curvature": "kappa"}, "constants": {"command.is_engaged": True}}


def part(file, **keys):
    control = ControlSetup(load_machine("lexion-700-class"), {"scan": Pose.identity()}, "left", STEP / NS)
    ports = (Port("edge", CropEdge),), (Port("command", SteerCommand),)
    setup = LinkSetup("combine", "steer", *ports, control, Path())
    return make_part(Params(file=str(file), **{**KEYS, **keys}), setup)


def edge(t, offset):
    known = 0.0 if math.isnan(offset) else 0.9
    return CropEdge(t, offset, offset * 0.0, offset * 0.0, offset * 0.0 + 10.0, known, 0.8, 0.1)


def curvatures(made, offsets):
    made.reset(Stream(1, "steer"))
    found = []
    for k, offset in enumerate(offsets):
        inputs = {"edge": edge((k + 1) * STEP, offset)}
        found.append(made.step(k * STEP, STEP, inputs)["command"].curvature)
    return found


def test_parameters_without_a_variability_are_used_and_said():
    found = read_fmu(law())
    assert [f for f in found.faults if "default" in f] == [
        f"variable {name} is parameter and continuous (the default), which do not go together"
        for name in ("gain", "teeth", "is_quick", "word")
    ]
    assert {v.name: v.variability for v in found.of("parameter")} == dict.fromkeys(
        ("gain", "teeth", "is_quick", "word"), "fixed"
    )
    assert curvatures(part(law(), parameters={"gain": 0.1}), [2.0]) == [pytest.approx(-0.2)]


def test_a_number_that_is_not_there_leaves_the_one_before():
    """At first the start value of the FMU, 0.5."""
    made = part(law())
    given = [math.nan, math.nan, 1.0, math.nan, -2.0]
    assert curvatures(made, given) == pytest.approx([-0.125, -0.125, -0.25, -0.25, 0.5])
    (note,) = [n for n in made.notes if "edge.offset was nan" in n]
    assert "in 3 steps" in note
    assert "edge.offset.is_known" in note


@pytest.mark.parametrize("name", ["offset_is_known", "seen_by_wire"])
def test_a_flag_says_whether_it_is_there(name):
    """By its name, or by wire: straight on where no edge is seen."""
    made = part(
        law(f"-self.gain * self.offset * self.{name}", name),
        inputs={} if name == "offset_is_known" else {name: "edge.offset.is_known"},
    )
    assert curvatures(made, [math.nan, 1.0, math.nan]) == pytest.approx([0.0, -0.25, 0.0])
    assert not [n for n in made.notes if "edge.offset was nan" in n]


def test_nan_that_is_passed_on_is_named_with_its_input():
    made = part(law(), nan="pass")
    with pytest.raises(SwathError, match=r"kappa is nan.*edge.offset is nan \(no edge\)"):
        curvatures(made, [1.0, math.nan])


def test_what_is_always_known_has_no_flag():
    with pytest.raises(InputError, match="it is always known"):
        part(law(), inputs={"offset": "edge.confidence.is_known"})


def test_a_saved_state_keeps_what_is_held():
    made = part(law())
    curvatures(made, [1.0, math.nan])
    saved = made._feed.save()
    again = part(law())._feed
    again.load(saved)
    assert again.numbers(0, STEP) == made._feed.numbers(0, STEP)
    assert again.held == {"edge.offset": 1, "edge.heading": 1}


def test_a_plain_law_steers_a_run():
    """The first scan comes after the first step: the run ended there at once."""
    inputs = {"offset": "edge.offset", "heading": "edge.heading"}
    file = str(law("0.02 * self.offset - 0.4 * self.heading"))
    keys = json.dumps({"level": "fmu", "file": file, "inputs": inputs, **KEYS})
    sets = ["combine.lidar.level=empirical", "run.distance_m=5", "expect={}", f"combine.steer={keys}"]
    scenario = load_scenario("straight", sets=sets)
    world = assemble(scenario)
    try:
        world.reset()
        world.graph.run(2 * NS)
        assert world.graph.latest("combine.motion", "state").distance > 0.5
    finally:
        world.close()
