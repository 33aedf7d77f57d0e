"""Against other tools: fmpy's own stepping, FMUs and systems made and run by the FMU Manipulation Toolbox."""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from swath.link.fmi.composite import Composite, describe_system
from swath.link.fmi.description import read_fmu
from swath.link.fmi.make_instance import make_instance
from swath.link.fmi.ssp import read_system
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from tests.link.fmu_scenario import scenario
from tests.link.made_fmus import component, connection, connector, needs_cc, package, store_fmu, system

pytest.importorskip("fmpy")
toolbox = pytest.mark.skipif(
    importlib.util.find_spec("fmu_manipulation_toolbox") is None, reason="needs fmu-manipulation-toolbox"
)
pytestmark = [needs_cc, pytest.mark.usefixtures("code_allowed")]
RULES = """rule;from_fmu;from_port;to_fmu;to_port
FMU;store.fmu;;;
INPUT;;grain_in;store.fmu;grain_in
INPUT;;straw_in;store.fmu;straw_in
"""


def container(folder, source, step, version=2):
    """An FMU that holds others, made and run by the toolbox."""
    tool = [sys.executable, "-m", "fmu_manipulation_toolbox.cli.fmucontainer"]
    command = [*tool, "-fmi", str(version), "-container", f"{source.name}:{step}"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return folder / f"{source.stem}.fmu"


@toolbox
@pytest.mark.parametrize("version", [2, 3])
def test_a_container_as_the_process(tmp_path, version):
    """It steps the same model in tenths of the slot's period; its units are lost, the scenario gives them."""
    store = store_fmu(tmp_path)
    (tmp_path / "box.csv").write_text(RULES, encoding="utf-8")
    box = container(tmp_path, tmp_path / "box.csv", 0.01, version)
    assert read_fmu(box).major == version
    feed = {"grain_in": "flow.grain", "straw_in": "flow.straw"}
    loads = []
    for file, units in ((box, dict.fromkeys(feed, "kg/s")), (store, {})):
        keys = {"level": "fmu", "file": str(file), "inputs": feed, "units": units}
        world = assemble(scenario(process=keys))
        drive(world)
        loads.append(world.graph.latest("combine.process", "load"))
        world.close()
    boxed, own = loads
    assert own.tank_grain > 1.0
    for name in ("tank_grain", "lost_grain", "held_grain", "dropped_straw", "held_straw"):
        assert getattr(boxed, name) == pytest.approx(getattr(own, name), rel=1e-9), name


@toolbox
def test_a_system_as_another_tool_runs_it(tmp_path):
    """B before A in both: each sees what the other gave in the step before, to the bit."""
    store = store_fmu(tmp_path)
    ends = [
        connection("feed", "A.grain_in"),
        connection("A.grain_flow", "B.grain_in"),
        connection("B.grain_flow", "out"),
        connection("A.held_grain", "held"),
    ]
    connectors = [connector("feed", "input", "kg/s"), connector("out", "output"), connector("held", "output")]
    parts = [component(n, "resources/store.fmu") for n in "BA"]
    file = package(tmp_path, "two.ssp", system("two", connectors, parts, ends), store)
    boxed = read_fmu(container(tmp_path, file, 0.1))
    read = read_system(file)
    found = describe_system(read)[0].variables
    ours = Composite(read, "ours", [found["feed"]], [found["held"], found["out"]])
    theirs = make_instance(
        boxed, "theirs", [boxed.variables["feed"]], [boxed.variables[n] for n in ("held", "out")]
    )
    assert ours.start({}) == theirs.start({})
    rows = [(ours.run([s]), theirs.run([s])) for s in ((0.1 * k, 0.1, [5.0 + k]) for k in range(20))]
    ours.close()
    theirs.close()
    assert all(a == b for a, b in rows)
    assert rows[-1][0][1] > 1.0
    shutil.rmtree(tmp_path / "two.dir", ignore_errors=True)


def test_every_number_is_that_of_fmpy(tmp_path):
    from fmpy import extract
    from fmpy.fmi2 import FMU2Slave

    fmu = read_fmu(store_fmu(tmp_path))
    folder = extract(str(fmu.file), tmp_path / "unpacked")
    theirs = FMU2Slave(
        guid=fmu.token,
        unzipDirectory=str(folder),
        modelIdentifier=Path(fmu.library).stem,
        instanceName="theirs",
    )
    outputs = [v for v in fmu.of("output") if v.kind == "real"]
    ours = make_instance(fmu, "ours", [fmu.variables[n] for n in ("grain_in", "straw_in")], outputs)
    ours.start({"time_constant": 0.7})
    theirs.instantiate()
    theirs.setupExperiment()
    theirs.setReal([2], [0.7])
    theirs.enterInitializationMode()
    theirs.exitInitializationMode()
    refs = [v.refs[0] for v in outputs]
    for k in range(50):
        theirs.setReal([0, 1], [5.0 + k, 3.0])
        theirs.doStep(0.1 * k, 0.1)
        assert ours.step(0.1 * k, 0.1, [5.0 + k, 3.0]) == theirs.getReal(refs)
    ours.close()
    theirs.terminate()
    theirs.freeInstance()
