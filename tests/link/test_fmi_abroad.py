"""FMUs as other tools make them: FMI 1, without states, once per process, an event mode that is none."""

import re
import subprocess
import zipfile
from math import exp

import pytest

from swath.core.errors import InputError
from swath.link.fmi.calls import FmuError, why_not_loaded
from swath.link.fmi.check import check_fmu
from swath.link.fmi.child_process import ChildProcess
from swath.link.fmi.description import read_fmu
from swath.link.fmi.make_instance import make_instance
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from tests.link.fmu_scenario import process_part, scenario
from tests.link.made_fmus import CC, FEED, engine_fmu, needs_cc, process_xml, store1_fmu, store_fmu

pytest.importorskip("fmpy")
pytestmark = [needs_cc, pytest.mark.usefixtures("code_allowed")]
SEEN = ("tank_grain", "held_grain", "steps")


def opened(fmu, inputs, outputs, make=make_instance, *more):
    return make(fmu, "part", *([fmu.variables[n] for n in names] for names in (inputs, outputs)), *more)


@pytest.fixture
def store1(tmp_path):
    return read_fmu(store1_fmu(tmp_path))


@pytest.mark.parametrize("own", [False, True], ids=["here", "own"])
def test_fmi_1_against_the_closed_form(store1, own):
    part = opened(store1, ("grain_in",), SEEN, *((ChildProcess, 5.0) if own else ()))
    assert part.start({"time_constant": 0.5, "loss": 0.0}) == [0.0] * 3
    for k in range(10):
        tank, held, steps = part.step(0.1 * k, 0.1, [5.0])
    part.close()
    expected = 5.0 * 0.5 * (1.0 - exp(-1.0 / 0.5))
    assert held == pytest.approx(expected, rel=1e-12)
    assert tank == pytest.approx(5.0 - expected, rel=1e-12)
    assert steps == 10.0


def test_fmi_1_says_what_it_can(store1):
    assert (store1.major, store1.variable_step, store1.saves_state) == (1, True, False)
    assert store1.faults == ()
    assert store1.variables["ranges"].refs == (13, 14, 15)
    assert store1.variables["loss"].causality == "parameter"
    assert store1.variables["grain_in"].unit.name == "kg/s"


def test_fmi_1_goes_on_after_a_short_step_and_fails_in_its_own_words(store1):
    part = opened(store1, ("grain_in",), SEEN)
    part.start({"fail_at": 0.3, "digits": 1.0})
    assert part.step(0.0, 0.1, [1.0])[2] == 8.0  # of 13 ms
    with pytest.raises(FmuError, match="store_fmiDoStep gave error; it says: belt 7 is torn"):
        part.step(0.3, 0.1, [1.0])
    part.close()


def test_fmi_1_fills_a_slot_as_fmi_2_does(tmp_path):
    loads = []
    for file in (store1_fmu(tmp_path), store_fmu(tmp_path)):
        world = assemble(scenario(process={"level": "fmu", "file": str(file), "inputs": FEED}))
        drive(world, until_s=2.0)
        loads.append(world.graph.latest("combine.process", "load"))
        world.close()
    assert loads[0] == loads[1]
    assert loads[0].tank_grain > 0.5


@pytest.mark.parametrize("says", ["", 'canGetAndSetFMUstate="true"'], ids=["says so", "says it has"])
def test_one_without_states_fills_a_slot(tmp_path, says):
    attributes = f'canHandleVariableCommunicationStepSize="true" {says}'
    file = store_fmu(tmp_path, flags=("-DNO_STATES",), attributes=attributes)
    rows = {what: (result, text) for what, result, text in check_fmu(file, duration_s=0.2)}
    assert rows["state"][0] == "note"
    assert "cannot be saved, nor can a run with it" in rows["state"][1]
    assert rows["again"] == ("ok", "same outputs as at first")
    world = assemble(scenario(process={"level": "fmu", "file": str(file), "inputs": FEED}))
    drive(world, until_s=0.5)
    told = " ".join(world.leader.notes)
    world.close()
    assert ("its state cannot be saved" in told) is (not says)


def test_one_that_crashes_at_its_second_start_gets_a_new_process(tmp_path):
    file = store_fmu(tmp_path, flags=("-DSTARTS_ONCE",))
    rows = {what: (result, text) for what, result, text in check_fmu(file, duration_s=0.2)}
    assert rows["again"] == ("note", "it cannot be started again in one process and got a new one")


def test_an_event_mode_that_the_binary_refuses_is_left_out(tmp_path):
    outputs = ("speed", "events")
    sound, odd = (
        opened(read_fmu(engine_fmu(tmp_path, name, clock=False, flags=flags)), ("ground_speed",), outputs)
        for name, flags in (("sound.fmu", ()), ("odd.fmu", ("-DNO_EVENT_MODE",)))
    )
    for part in (sound, odd):
        part.start({})
        part.step(0.0, 0.1, [3.0])
    assert sound.outputs()[1] > 0.0
    assert odd.outputs()[1] == 0.0
    assert odd.notes == ("it says that it has an event mode but starts only without it",)
    sound.close()
    odd.close()


def test_a_missing_system_library_is_named_with_its_package(tmp_path):
    library = tmp_path / "libgfortran.so.77"
    (tmp_path / "x.c").write_text("int x(void) { return 1; }")
    command = [CC, "-shared", "-fPIC", "-Wl,-soname,libgfortran.so.77", "-o", library, tmp_path / "x.c"]
    subprocess.run(command, check=True)
    needed = tmp_path / "store.so"
    (tmp_path / "y.c").write_text("int x(void); int y(void) { return x(); }")
    subprocess.run([CC, "-shared", "-fPIC", "-o", needed, tmp_path / "y.c", library], check=True)
    file = tmp_path / "needs.fmu"
    with zipfile.ZipFile(file, "w") as made:
        made.writestr("modelDescription.xml", process_xml())
        made.write(needed, "binaries/linux64/store.so")
    part = opened(read_fmu(file), ("grain_in",), SEEN)
    expected = r"needs the system library libgfortran\.so\.77, .* package libgfortran77$"
    with pytest.raises(FmuError, match=expected):
        part.start({})
    assert "package libfoo2-3" in why_not_loaded("libfoo2.so.3: cannot open shared object file")


def test_one_for_windows_alone_says_the_way_out(tmp_path):
    file = store_fmu(tmp_path, binary="binaries/win64/store.dll")
    with pytest.raises(InputError) as caught:
        process_part(file=str(file), inputs=FEED)
    expected = r"this one has win64: export it for this system, or run it .* over ROS 2"
    assert re.search(expected, str(caught.value))
