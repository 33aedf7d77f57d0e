"""FMUs as process and engine of a machine that really drives: masses, states, faults, failures."""

import json
import sys
import zipfile

import pytest

import swath.link.levels.fmu
from swath.core.errors import InputError, MissingExtra, SwathError
from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.job import run_job
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario
from tests.evaluated import metrics_of
from tests.link.fmu_scenario import NO_POWERS, process_part, scenario
from tests.link.made_fmus import (
    CAN,
    ENGINE_PY,
    FEED,
    PROCESS_PY,
    engine_fmu,
    needs_cc,
    process_xml,
    python_fmu,
    store_fmu,
)

pytestmark = pytest.mark.usefixtures("code_allowed")

pytest.importorskip("fmpy")
INSTANT = {"time_constant": 1e-15}


def driven(world):
    """(load, engine, mass balance error) at the end of the run; engine is None without one.

    The load is that of the last full step; a built-in process takes in the last cut after it.
    """
    evaluation, loads = make_evaluation(world), []
    due = next(n.slot for n in world.graph.nodes if n.slot.name == "combine.process")

    def watch(slot, t, outputs):
        if slot == due.name and due.after(t - 1) == t:
            loads.append(outputs["load"])

    try:
        drive(world, [evaluation, watch])
        engine = world.graph.latest("combine.powertrain", "engine")
        return loads[-1], engine, metrics_of(evaluation)["mass_balance_error"]
    finally:
        world.close()


def store_keys(file, **more):
    return {"level": "fmu", "file": str(file), "inputs": FEED, **more}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(scope="module")
def store(folder):
    return store_fmu(folder)


@pytest.fixture(scope="module")
def as_built_in():
    return driven(assemble(scenario(process={"level": "constant"})))[0]


TOTALS = ("tank_grain", "lost_grain", "dropped_straw")


@needs_cc
@pytest.mark.parametrize("more", [{}, {"step_ms": 10}, {"step_ms": 30}, {"process": "own"}], ids=str)
def test_a_process_in_c_equals_the_built_in_one(store, as_built_in, more):
    world = assemble(scenario(process=store_keys(store, parameters=INSTANT, **more)))
    load, _, error = driven(world)
    assert error < 1e-12
    assert 0.5 * load.dropped_straw < world.field.straw_kg <= load.dropped_straw * (1 + 1e-9)
    assert as_built_in.tank_grain > 5.0
    for name in TOTALS:
        assert getattr(load, name) == pytest.approx(getattr(as_built_in, name), rel=1e-9), name


@needs_cc
def test_masses_per_step_and_flows_feed_the_same(store, folder, as_built_in):
    """The same FMU told in tonnes per hour by its unit, and one without units told by the scenario."""
    tonnes = [("grain_in", "input", "t/h", 0.0), *_process()[1:]]
    other = store_fmu(folder, "tonnes.fmu", variables=tonnes)
    # the model takes the number for kg/s: grain comes out 3.6 times, which shows that it was converted
    load, _, _ = driven(assemble(scenario(process=store_keys(other, parameters=INSTANT))))
    assert load.tank_grain == pytest.approx(3.6 * as_built_in.tank_grain, rel=1e-9)
    bare = [(n, c, None, s) for n, c, _, s in _process()]
    other = store_fmu(folder, "bare.fmu", variables=bare, units={})
    load, _, _ = driven(assemble(scenario(process=store_keys(other, parameters=INSTANT))))
    assert load.tank_grain == pytest.approx(as_built_in.tank_grain, rel=1e-9)


def _process():
    from tests.link.made_fmus import PROCESS

    return PROCESS


@needs_cc
def test_an_engine_in_c_with_events_and_units(folder):
    keys = {
        "level": "fmu",
        "file": str(engine_fmu(folder)),
        "inputs": {"ground_speed": "state.speed"},
        "constants": {"engine.speed_ratio": 1, "engine.load": 0.5, "engine.power": 1e5, **NO_POWERS},
    }
    world = assemble(scenario(powertrain=keys))
    _, engine, _ = driven(world)
    speed = world.graph.latest("combine.motion", "state").speed
    assert speed == pytest.approx(7 / 3.6, rel=0.05)
    assert engine.speed == pytest.approx((2000.0 - 36.0 * speed) * 0.10471975511965977, rel=1e-3)
    assert engine.speed_limit == pytest.approx(30 / 3.6)
    notes = world.leader.notes
    assert any("stay at their start values: x, engaged" in n for n in notes)


def test_process_by_pythonfmu_and_engine_by_pythonfmu3(tmp_path, as_built_in):
    process = python_fmu(tmp_path, PROCESS_PY, "pythonfmu")
    engine = python_fmu(tmp_path, ENGINE_PY, "pythonfmu3")
    keys = {"level": "fmu", "file": str(engine), "constants": NO_POWERS}
    keys["inputs"] = {"ground": "state.speed", "flow": "load.drum_flow"}
    world = assemble(scenario(process={"level": "fmu", "file": str(process)}, powertrain=keys))
    load, state, error = driven(world)
    assert error < 1e-12
    for name in TOTALS:
        assert getattr(load, name) == pytest.approx(getattr(as_built_in, name), rel=1e-9), name
    ground = 3.6 * world.graph.latest("combine.motion", "state").speed
    assert state.power == pytest.approx(1e3 * (60.0 + 4.0 * ground), rel=1e-3)
    assert state.speed == pytest.approx((2000.0 - 100.0 * state.load) * 0.10471975511965977)
    assert any("its description breaks the standard" in n for n in world.leader.notes)


@needs_cc
def test_saved_and_loaded_runs_end_alike(store):
    made = scenario(process=store_keys(store, process="own"))
    a, b = assemble(made), assemble(made)
    drive(a, until_s=0.8)
    state = a.save()
    drive(a, until_s=1.5, resume=True)
    b.load(state)
    drive(b, until_s=1.5, resume=True)
    ends = [w.graph.latest("combine.process", "load") for w in (a, b)]
    a.close()
    b.close()
    assert ends[0] == ends[1]


@needs_cc
def test_an_fmu_without_states_refuses_by_name(folder):
    plain = store_fmu(folder, "plain.fmu", attributes='canHandleVariableCommunicationStepSize="true"')
    world = assemble(scenario(process=store_keys(plain)))
    drive(world, until_s=0.3)
    with pytest.raises(SwathError, match=r"combine\.process: plain\.fmu: it cannot save its state"):
        world.save()
    world.close()


@needs_cc
@pytest.mark.parametrize(
    ("mode", "process", "message"),
    [
        (1, "own", r"at t = 0\.5 s: its process crashed \(SIGSEGV\)"),
        (2, "own", r"at t = 0\.5 s: it gave no answer within 0\.5 s"),
        (3, "here", r"at t = 0\.5 s: its variable tank_grain is nan, expected a finite number"),
        (4, "here", r"at t = 0\.5 s: fmi2DoStep gave error; it says: belt 7 is torn"),
    ],
    ids=["crash", "hang", "nan", "error"],
)
def test_a_failing_fmu_is_named_and_the_run_folder_kept(store, tmp_path, mode, process, message):
    keys = store_keys(store, parameters={"mode": mode}, process=process, timeout_s=0.5)
    with pytest.raises(SwathError, match=r"combine\.process: store\.fmu " + message):
        run_job(scenario(process=keys), tmp_path / "run")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["incomplete"] is True
    assert summary["simulated_s"] == pytest.approx(0.6, abs=0.11)
    assert (tmp_path / "run" / "run.mcap").stat().st_size > 0


@needs_cc
def test_one_instance_per_process(folder):
    """Two worlds with an FMU that allows one: each gets a process, also after a reset, and says so."""
    attributes = CAN + ' canBeInstantiatedOnlyOncePerProcess="true"'
    only = store_fmu(folder, "only.fmu", flags=("-DONLY_ONE",), attributes=attributes)
    worlds = [assemble(scenario(process=store_keys(only))) for _ in range(2)]
    for world in worlds:
        drive(world, until_s=0.5)
    loads = [w.graph.latest("combine.process", "load") for w in worlds]
    assert loads[0] == loads[1]
    told = ["runs in its own process" in " ".join(w.leader.notes) for w in worlds]
    for world in worlds:
        world.close()
    assert told == [True, True]


@needs_cc
def test_small_faults_are_one_note(folder):
    faulty = [(n, c, u, None if c == "input" else s) for n, c, u, s in _process()]
    file = store_fmu(folder, "faulty.fmu", variables=faulty, binary="binaries/x86_64-linux/store.so")
    world = assemble(scenario(process=store_keys(file)))
    notes = [n for n in world.leader.notes if "breaks the standard" in n]
    assert len(notes) == 1
    assert "has no start value" in notes[0]
    assert "more, see swath fmu check" in notes[0]
    assert driven(world)[2] < 1e-12


def test_what_is_no_fmu_for_this_system_is_refused(tmp_path):
    bare = tmp_path / "windows.fmu"
    with zipfile.ZipFile(bare, "w") as made:
        made.writestr("modelDescription.xml", process_xml())
        made.writestr("binaries/win64/store.dll", b"")
    with pytest.raises(InputError, match=r"file = .*expected an FMU with a binary for linux64, .* has win64"):
        process_part(file=str(bare), inputs=FEED)
    for text, message in (
        (process_xml().replace("CoSimulation", "ModelExchange"), "this one is for model exchange only"),
        (process_xml().replace('fmiVersion="2.0"', 'fmiVersion="4.0"'), "expected an FMU of FMI 1, 2 or 3"),
        ("<fmiModel", "expected an FMU of FMI 1, 2 or 3"),
    ):
        with zipfile.ZipFile(bare, "w") as made:
            made.writestr("modelDescription.xml", text)
        with pytest.raises(InputError, match=message):
            process_part(file=str(bare))
    bare.write_bytes(b"not a zip")
    with pytest.raises(InputError, match="expected an FMU, a zip archive"):
        process_part(file=str(bare))


MISTAKES = [
    ({"inputs": {"gran_in": "flow.grain"}}, r"inputs\.gran_in = gran_in: .* did you mean 'grain_in"),
    ({"inputs": {"grain_in": "flow.gain"}}, r"inputs\.grain_in = flow\.gain: .* did you mean 'flow\.grain"),
    ({"inputs": {"grain_in": "state.speed"}}, r"expected m/s, but grain_in is in kg/s"),
    ({"inputs": {"grain_in": "state.speed/s"}}, r"only amounts have a rate"),
    ({"inputs": {"ranges": "flow.grain"}}, r"expected an array, like ranges"),
    ({"inputs": {"tank_grain": "flow.grain"}}, r"expected an input of the FMU, it is of causality output"),
    ({"outputs": {"load.tank_grain": "grain_flow"}}, r"expected kg, but grain_flow is in kg/s"),
    ({"outputs": {"load.tank": "tank_grain"}}, r"did you mean 'load\.tank"),
    ({"constants": {"load.tank_grain": [1.0]}}, r"expected a number"),
    ({"parameters": {"losses": 1.0}}, r"did you mean 'loss"),
    ({"parameters": {"loss": "much"}}, r"parameters\.loss = much: expected a number"),
    ({"units": {"grain_in": "bushel"}}, r"units\.grain_in = bushel: expected a unit such as"),
]


@needs_cc
@pytest.mark.parametrize(("keys", "message"), MISTAKES, ids=lambda v: str(v)[:40])
def test_mistakes_name_the_key(store, keys, message):
    with pytest.raises(InputError, match=message):
        process_part(file=str(store), **keys)


@needs_cc
@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"step_ms": 0}, r"combine\.process\.step_ms = 0: expected > 0"),
        ({"process": "there"}, r"process\.process = there: expected one of here, own"),
        ({"file": "nowhere.fmu"}, r"process\.file = nowhere\.fmu: there is no such file"),
        ({"input": {}}, r"process\.input: unknown key, did you mean 'inputs'"),
    ],
    ids=str,
)
def test_mistakes_of_the_file(store, keys, message):
    with pytest.raises(InputError, match=message):
        scenario(process={"level": "fmu", "file": str(store), **keys})


@needs_cc
def test_a_mistake_has_its_full_key_and_its_line(store):
    keys = store_keys(store, inputs={"gran_in": "flow.grain"})
    message = r"^combine\.process\.inputs\.gran_in = gran_in: .* \(text:15\)$"
    with pytest.raises(InputError, match=message):
        assemble(scenario(process=keys))


@needs_cc
def test_steps_that_a_fixed_step_cannot_take(folder):
    fixed = store_fmu(folder, "fixed.fmu", attributes='canGetAndSetFMUstate="true"')
    with pytest.raises(
        InputError, match=r"step_ms = 30.0: expected a whole part of the slot's period of 100 ms"
    ):
        assemble(scenario(process=store_keys(fixed, step_ms=30)))
    assert driven(assemble(scenario(process=store_keys(fixed, step_ms=50))))[2] < 1e-12


@needs_cc
@pytest.mark.parametrize("parts", [None, 1, 2, 7])
def test_a_fixed_step_is_a_part_of_any_rate(folder, parts, monkeypatch):
    """Steps of 15 Hz last 66 666 666 or 66 666 667 ns, and an FMU gets no step of one."""
    fixed = store_fmu(folder, "fixed.fmu", attributes='canGetAndSetFMUstate="true"')
    step_ms = None if parts is None else 1000 / 15 / parts
    lengths, make = [], swath.link.levels.fmu.make_unit

    def spied(*given, **more):
        unit = make(*given, **more)
        run = unit.run
        unit.run = lambda steps: [lengths.append([h for _, h, _ in steps]), run(steps)][1]
        return unit

    monkeypatch.setattr(swath.link.levels.fmu, "make_unit", spied)
    assert driven(assemble(scenario(process=store_keys(fixed, rate_hz=15, step_ms=step_ms))))[2] < 1e-12
    assert {len(each) for each in lengths} == {parts or 1}
    assert all(abs(h - 1 / 15 / (parts or 1)) < 1e-8 for each in lengths for h in each)


@needs_cc
def test_missing_outputs_are_listed(folder):
    lean = [v if v[0] != "held_straw" else ("other", *v[1:]) for v in _process()]
    file = store_fmu(folder, "lean.fmu", variables=lean)
    with pytest.raises(InputError, match=r"outputs: expected .* for load\.held_straw"):
        process_part(file=str(file), inputs=FEED)
    world = assemble(scenario(process=store_keys(file, outputs={"load.held_straw": "other"})))
    assert driven(world)[2] < 1e-12


@needs_cc
def test_the_scenario_of_a_run_gives_the_same_digest(store, tmp_path):
    keys = store_keys(store, step_ms=20, constants={"load.return_flow": 0.25})
    first = run_job(scenario(process=keys), tmp_path / "a")
    again = run_job(load_scenario(str(tmp_path / "a")), tmp_path / "b")
    assert again.summary["digest"] == first.summary["digest"]


def test_without_the_extra_one_line_says_so(monkeypatch, tmp_path):
    file = tmp_path / "x.fmu"
    with zipfile.ZipFile(file, "w") as made:
        made.writestr("modelDescription.xml", "")
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(MissingExtra, match=r"pip install 'swath\[fmi\]'"):
        process_part(file=str(file))


@needs_cc
def test_another_port_by_a_wire_of_the_scenario(store):
    keys = store_keys(
        store, wires={"odo": "odometry.odometry"}, units={"straw_in": "m/s"}, parameters=INSTANT
    )
    keys["inputs"] = {"grain_in": "flow.grain/s", "straw_in": "odo.speed"}
    world = assemble(scenario(process=keys))
    drive(world)
    load, way = (world.graph.latest(*n) for n in (("combine.process", "load"), ("combine.motion", "state")))
    world.close()
    assert load.dropped_straw == pytest.approx(
        way.distance, rel=0.02
    )  # speed taken for a flow: its sum is the way


@needs_cc
def test_steps_unlike_those_it_was_made_for_are_noted(folder):
    attributes = 'canGetAndSetFMUstate="true"'
    file = store_fmu(folder, "paced.fmu", attributes=attributes)
    with zipfile.ZipFile(file) as made:
        parts = {n: made.read(n) for n in made.namelist()}
    text = parts["modelDescription.xml"].decode()
    text = text.replace("<ModelVariables>", '<DefaultExperiment stepSize="0.03"/><ModelVariables>')
    with zipfile.ZipFile(file, "w") as out:
        for name, data in (parts | {"modelDescription.xml": text.encode()}).items():
            out.writestr(name, data)
    told = [n for n in process_part(file=str(file), inputs=FEED).notes if "was made for steps" in n]
    assert told == ["process: paced.fmu: it was made for steps of 30 ms and takes 100 ms; see step_ms"]
