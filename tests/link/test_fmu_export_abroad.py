"""Exported FMUs: what the archive holds, other importers, several at once, errors, and back into swath."""

import os
import subprocess
import sys
import threading
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.machine_sheet import load_machine
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from tests.link.fmu_host import Host
from tests.link.fmu_scenario import TEXT
from tests.link.made_fmus import CC, needs_cc

pytest.importorskip("fmpy", reason="needs the extra fmi")
pytest.importorskip("pythonfmu3", reason="needs the extra fmi")
pytest.importorskip("pythonfmu", reason="needs the extra fmi")
from swath.link.fmi.export import export_fmu

pytestmark = pytest.mark.usefixtures("code_allowed_in_module")
WHOLE = TEXT + "    process: {level: threshing, straw: chop}\n    powertrain: {level: hydrostat}\n"
HERE = Path(__file__).parent
VERSIONS = (3, 2)
MINE = """
from swath.machine.powertrain.ideal import IdealPowertrain, Params


class Mine(IdealPowertrain):
    Params = Params
"""


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    """The process of the drive, by version."""
    folder = tmp_path_factory.mktemp("abroad")
    for version in VERSIONS:
        export_fmu(parse_scenario(WHOLE), ["process"], folder / f"{version}.fmu", version=version)
    return {version: folder / f"{version}.fmu" for version in VERSIONS}


def load_steadily(host, steps=150):
    """Feed a process 1 kg of grain and 1.2 kg of straw in each of `steps` steps of 0.1 s."""
    host["flow.grain"], host["flow.straw"] = 1.0, 1.2
    for _ in range(steps):
        host.step(0.1)
    return host["load.tank_grain"], host["load.held_grain"], host["load.lost_grain"]


@pytest.mark.filterwarnings("ignore:module .sre_:DeprecationWarning")  # of the grammar that fmpy loads
def test_the_description_is_clean(fmus):
    from fmpy import read_model_description
    from fmpy.validation import validate_fmu

    for version, file in fmus.items():
        assert validate_fmu(str(file)) == []
        model = read_model_description(str(file), validate=True)
        variables = {v.name: v for v in model.modelVariables}
        assert model.fmiVersion.startswith(str(version))
        assert model.coSimulation.canGetAndSetFMUstate
        assert variables["load.drum_flow"].unit == "kg/s"
        assert "into the threshing drum" in variables["load.drum_flow"].description
        assert variables["engine.speed_ratio"].start.startswith("1.0")  # idling, as at t = 0
        units = {u.name: u.baseUnit for u in model.unitDefinitions}
        assert (units["kg/s"].kg, units["kg/s"].s) == (1, -1)
        assert units["%"].factor in (0.01, "0.01")


def test_the_same_scenario_gives_the_same_bytes(fmus, tmp_path):
    export_fmu(parse_scenario(WHOLE), ["combine.process"], tmp_path / "again.fmu")
    assert (tmp_path / "again.fmu").read_bytes() == fmus[3].read_bytes()


@pytest.mark.filterwarnings("ignore:module .sre_:DeprecationWarning")  # of the grammar that fmpy loads
def test_arrays_have_a_variable_for_each_element_in_fmi_2(tmp_path):
    text = TEXT.replace("lidar: off", "lidar: {level: plants, sector_deg: [-10, 10], step_deg: 1}")
    text = text.replace("edge: truth", "edge: likelihood_ratio")
    export_fmu(parse_scenario(text), ["edge"], tmp_path / "edge.fmu", version=2)
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(tmp_path / "edge.fmu")) == []
    host = Host(tmp_path / "edge.fmu")
    wanted = np.arange(21, dtype=float)
    host["scan.ranges"] = wanted
    np.testing.assert_array_equal(host["scan.ranges"], wanted)
    host.step(0.04)
    assert host["edge.confidence"] == 0.0
    host.close()


def test_files_of_the_user_travel_with_it(tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    text = TEXT + f"    powertrain: {{level: '{tmp_path}/mine.py:Mine'}}\n"
    export_fmu(parse_scenario(text), ["powertrain"], tmp_path / "mine.fmu")
    (tmp_path / "mine.py").unlink()
    with zipfile.ZipFile(tmp_path / "mine.fmu") as archive:
        assert str(tmp_path) not in archive.read("resources/scenario.yaml").decode()
    host = Host(tmp_path / "mine.fmu")
    host["load.drum_flow"] = 20.0
    host.step(0.05)
    work = drivetrain_of(load_machine("lexion-700-class")).consumers.drum_work
    assert host["engine.threshing_power"] == pytest.approx(20.0 * work)
    host.close()


def test_another_importer_gets_the_same_numbers(fmus):
    """libcosim of the Open Simulation Platform: C++, with FMI Library, its own threads, FMI 2."""
    pytest.importorskip("libcosimpy", reason="needs libcosimpy")
    code = f"""
import sys
sys.path.insert(0, {str(fmus[2].parent)!r})
import fmpy
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave
file = {str(fmus[2])!r}
refs = {{v.name: v.valueReference for v in fmpy.read_model_description(file).modelVariables}}
run = CosimExecution.from_step_size(step_size=100_000_000)
fmu = run.add_local_slave(local_slave=CosimLocalSlave(fmu_path=file, instance_name="p"))
hand, eye = CosimManipulator.create_override(), CosimObserver.create_last_value()
run.add_manipulator(manipulator=hand)
run.add_observer(observer=eye)
feed = [refs["flow.grain"], refs["flow.straw"]]
hand.slave_real_values(slave_index=fmu, variable_references=feed, values=[1.0, 1.2])
run.step(150)
load = [refs["load.tank_grain"], refs["load.held_grain"], refs["load.lost_grain"]]
print([repr(x) for x in eye.last_real_values(slave_index=fmu, variable_references=load)])
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    host = Host(fmus[2])
    here = load_steadily(host)
    host.close()
    assert str([repr(x) for x in here]) in told.stdout, told.stderr
    assert here[0] > 1.0


def test_instances_of_several_fmus_in_threads(fmus):
    """They share one Python, and nothing else."""
    alone = Host(fmus[3])
    wanted = load_steadily(alone)
    alone.close()
    hosts = [Host(fmus[v], name=f"{v}-{k}") for v in VERSIONS for k in range(2)]
    found = {}

    def work(host):
        found[id(host)] = load_steadily(host)

    threads = [threading.Thread(target=work, args=(h,)) for h in hosts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [found[id(h)] for h in hosts] == [wanted] * 4
    for host in hosts:
        host.close()


def test_parameters_count_and_errors_reach_the_log(fmus):
    for version, file in fmus.items():
        host = Host(file, start={"process.threshability": 0.5, "process.tank_start_percent": 50.0, "seed": 7})
        assert host["load.tank_start"] > 1000.0
        lossy = load_steadily(host)
        host.t += 0.5
        with pytest.raises(Exception, match=r"error|discard"):
            host.step(0.1)
        assert "communication point = 15.5: expected 15 s, where the FMU stands" in host.log[-1][1]
        host.close()
        host = Host(file)
        assert load_steadily(host)[2] < lossy[2]
        if version == 2:
            host["process.threshability"] = 1.0
            with pytest.raises(Exception, match="discard"):
                host.step(0.1)
            assert "process.threshability = 1.0: expected to be set before" in host.log[-1][1]
        host.close()


def test_a_parameter_out_of_range_is_named(fmus):
    host = Host(fmus[2], start={"process.threshability": 99.0})
    with pytest.raises(Exception, match="discard"):
        host.step(0.1)
    assert "combine.process.threshability=99.0" in host.log[0][1]
    assert "expected <= 3" in host.log[0][1]
    host.close()


def test_a_python_without_swath_says_so(fmus):
    """The module, where swath cannot be imported: the instance, not the import, fails."""
    for version, file in fmus.items():
        code = f"""
import sys, zipfile
sys.modules["swath"] = None
with zipfile.ZipFile({str(file)!r}) as archive:
    name = archive.read("resources/slavemodule.txt").decode()
    text = archive.read(f"resources/{{name}}.py").decode()
space = {{"__name__": name}}
exec(compile(text, name, "exec"), space)
assert "Fmi{version}Slave" in repr(space["Swath"].__mro__)
space["Swath"](instance_name="a", resources="b")
"""
        told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
        assert "RuntimeError: this FMU needs swath" in told.stderr, told.stderr
        assert sys.executable in told.stderr


def test_it_fills_its_slot_in_swath_again(fmus):
    """The whole run, with powertrain and motion behind it, is the one with the process inside."""
    runs = {}
    for name in ("inside", *VERSIONS):
        sets = [] if name == "inside" else ["combine.process.level=fmu", f"combine.process.file={fmus[name]}"]
        world, rows = assemble(parse_scenario(WHOLE, sets=sets)), []
        period = next(n.slot.period for n in world.graph.nodes if n.slot.name == "combine.process")

        def watch(slot, t, outputs, rows=rows, period=period):
            if slot == "combine.motion":
                rows.append([*outputs["state"].pose.position, outputs["state"].speed])
            if slot == "combine.process":
                load = outputs["load"]
                if t % period:  # what the header cut last: no step of an FMU
                    return
                rows.append([load.tank_grain, load.held_grain, load.held_straw, load.drum_flow])
            if slot == "combine.powertrain":
                rows.append(
                    [outputs["engine"].load, outputs["engine"].fuel_used, outputs["engine"].speed, 0.0]
                )

        drive(world, [watch])
        world.close()
        runs[name] = np.array(rows)
    assert runs["inside"][:, 0].max() > 1.0
    for version in VERSIONS:
        np.testing.assert_allclose(runs[version], runs["inside"], rtol=0.0, atol=1e-9)


def test_what_cannot_be_exported_is_named(tmp_path):
    scenario = parse_scenario(WHOLE)
    for slots, extra, text in (
        (["crop_flow"], {}, "expected one of combine.motion"),
        ([], {}, "expected one or more of"),
        (["process"], {"version": 1}, "expected 2 or 3"),
        (["process"], {"parameters": ["field.stand.stems"]}, "field.stand.stems_per_m2"),
    ):
        with pytest.raises(InputError, match=text):
            export_fmu(scenario, slots, tmp_path / "x.fmu", **extra)
    assert not list(tmp_path.iterdir())


def test_keys_of_the_field_become_parameters(tmp_path):
    file = tmp_path / "header.fmu"
    export_fmu(parse_scenario(TEXT), ["header"], file, parameters=["field.stand.stems_per_m2"])
    cut = []
    for stems in (400.0, 200.0):
        host = Host(file, start={"field.stand.stems_per_m2": stems})
        for _ in range(50):
            host["state.pose.y"] = host["state.pose.y"] + 0.04
            host.step(0.02)
            cut.append((stems, host["flow.stem_count"]))
        host.close()
    dense, thin = (sum(n for s, n in cut if s == stems) for stems in (400.0, 200.0))
    assert dense / thin == pytest.approx(2.0, rel=0.1)


@needs_cc
def test_a_program_that_is_no_python_runs_it_by_the_line_that_export_prints(tmp_path, capsys):
    fmu = tmp_path / "process.fmu"
    assert main(["fmu", "export", "feed-rate", "--slot", "process", "--out", str(fmu)]) == 0
    *_, elsewhere, line = capsys.readouterr().out.strip().splitlines()
    for needed in ("Windows", "python3.dll", "PYTHONHOME", "PYTHONPATH"):
        assert needed in elsewhere
    line = line.partition("with: ")[2]
    if not line.endswith(" PROGRAM"):
        pytest.skip(line)
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path / "fmu")
    token = ElementTree.parse(tmp_path / "fmu" / "modelDescription.xml").getroot().get("instantiationToken")
    (binary,) = (tmp_path / "fmu" / "binaries" / "x86_64-linux").glob("*.so")
    program = tmp_path / "importer"
    subprocess.run([CC, "-o", program, HERE / "fmu_importer.c", "-ldl"], check=True)
    resources = f"{tmp_path}/fmu/resources/"
    command = f"{line.removesuffix('PROGRAM')}{program} {binary} '{token}' {resources}"
    bare = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, env=bare, timeout=600)
    assert "status 0 0 0" in done.stdout, done.stdout + done.stderr
    alone = subprocess.run(
        [program, binary, token, resources], capture_output=True, text=True, env=bare, timeout=600
    )
    assert alone.returncode != 0  # without that line
