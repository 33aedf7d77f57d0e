"""Exported FMUs, stepped by fmpy, against the same slots inside swath."""

import dataclasses
import json
import signal

import numpy as np
import pytest

from swath.core.process.stopping import raise_if_lost
from swath.core.schedule import NS
from swath.runtime.assembly import assemble
from swath.runtime.job import run_job
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario, parse_scenario
from swath.signals.flat import flat_fields, read
from tests.link.fmu_host import Host
from tests.link.fmu_scenario import TEXT

pytest.importorskip("fmpy", reason="needs the extra fmi")
pytest.importorskip("pythonfmu3", reason="needs the extra fmi")
pytest.importorskip("pythonfmu", reason="needs the extra fmi")
from swath.link.fmi.export import export_fmu
from swath.link.fmi.export_slave import Session

LONG = TEXT.replace("distance_m: 3, max_duration_s: 6", "distance_m: 40, max_duration_s: 10")
PROCESS = {
    "constant": {"level": "constant"},
    "delay_line": {"level": "delay_line", "grain_delay_s": 5, "straw_delay_s": 4},
    "threshing": {"level": "threshing", "straw": "chop", "tank_start_percent": 20},
}
SCAN_SETS = ["run.max_duration_s=4", "combine.motion.start_speed_kmh=5", "combine.lidar.sub_rays=7"]


def scenario(process="threshing"):
    keys = ", ".join(f"{k}: {v}" for k, v in PROCESS[process].items())
    return parse_scenario(LONG + f"    process: {{{keys}}}\n    powertrain: {{level: hydrostat}}\n")


class Spy:
    """A component that keeps what it is given and what it answers."""

    def __init__(self, inner):
        self.inner, self.seen = inner, []

    def __getattr__(self, name):
        return getattr(self.inner, name)

    def step(self, t, dt, inputs):
        outputs = self.inner.step(t, dt, inputs)
        self.seen.append((t + dt, dict(inputs), outputs))
        return outputs


def spied(scenario, *slots):
    """(t, inputs, outputs) of every step of some slots in a real run, in a list for each."""
    world = assemble(scenario)
    nodes = {n.slot.name: n for n in world.graph.nodes}
    spies = []
    for slot in slots:
        node = nodes[f"combine.{slot}"]
        node.component = Spy(node.component)
        spies.append(node.component)
    world.graph.lockstep.connect()
    drive(world)
    return [spy.seen for spy in spies]


def give(host, port, sample):
    for name in flat_fields(type(sample)):
        host[f"{port}.{name}"] = read(sample, name)


def differences(host, port, sample):
    """Largest absolute difference of each number to the FMU's, nan equal to nan."""
    found = {}
    for name in flat_fields(type(sample)):
        ours, theirs = np.asarray(read(sample, name), dtype=float), host[f"{port}.{name}"]
        if name == "dt":
            continue
        np.testing.assert_array_equal(np.isnan(ours).ravel(), np.isnan(theirs).ravel())
        found[name] = np.nanmax(np.abs(ours.ravel() - theirs), initial=0.0) if ours.size else 0.0
    return found


def grain_inside(host, port):
    """Grain [kg] that came into a process since the start."""
    tank = host[f"{port}.tank_grain"] - host[f"{port}.tank_start"] + host[f"{port}.unloaded_grain"]
    return tank + host[f"{port}.lost_grain"] + host[f"{port}.held_grain"]


def summed(samples):
    sums = {n: sum(getattr(s, n) for s in samples) for n in ("grain", "straw", "area", "stem_count", "dt")}
    return dataclasses.replace(samples[-1], **sums)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(scope="module")
def run():
    """Steps of process, motion and steering."""
    return spied(scenario(), "process", "motion", "steering")


@pytest.fixture(scope="module")
def process_fmu(folder):
    export_fmu(scenario(), ["process"], folder / "process.fmu")
    return folder / "process.fmu"


@pytest.fixture(scope="module")
def process_fmu2(folder):
    export_fmu(scenario(), ["process"], folder / "process2.fmu", version=2)
    return folder / "process2.fmu"


def follow(host, steps):
    """Drive a process FMU along a recorded run; the largest difference of any number."""
    worst = 0.0
    for _, inputs, outputs in steps:
        give(host, "flow", summed(inputs["flow"]))
        give(host, "state", inputs["state"])
        if inputs.get("engine") is not None:
            give(host, "engine", inputs["engine"])
        host.step(0.1)
        worst = max(worst, *differences(host, "load", outputs["load"]).values())
    return worst


@pytest.mark.parametrize("level", PROCESS)
def test_a_process_is_the_same_outside(level, folder, process_fmu, run):
    file, steps = process_fmu, run[0]
    if level != "threshing":
        file = folder / f"{level}.fmu"
        export_fmu(scenario(level), ["process"], file)
        (steps,) = spied(scenario(level), "process")
    assert len(steps) == 100
    assert steps[-1][2]["load"].tank_grain > 20.0
    host = Host(file)
    assert follow(host, steps) < 1e-9
    host.close()


def test_fmi2_gives_the_same(process_fmu2, run):
    host = Host(process_fmu2)
    assert follow(host, run[0]) < 1e-9
    host.close()


def test_going_back_resetting_and_two_at_once(process_fmu, process_fmu2, run):
    steps = run[0][:80]
    for file in (process_fmu, process_fmu2):
        host = Host(file)
        follow(host, steps[:40])
        state = host.fmu.getFMUState() if host.is3 else host.fmu.getFMUstate()
        if host.is3:
            data = host.fmu.serializeFMUState(state)
        else:
            data = host.fmu.serializeFMUstate(state)
        follow(host, steps[40:])
        end = host["load.tank_grain"], host["load.held_grain"], host["load.drum_flow"]
        other = Host(file, name="two")
        if host.is3:
            other.fmu.setFMUState(other.fmu.deserializeFMUState(data))
            host.fmu.setFMUState(state)
        else:
            other.fmu.setFMUstate(other.fmu.deSerializeFMUstate(data))
            host.fmu.setFMUstate(state)
        for instance in (host, other):  # turn by turn: what one is given must not reach the other
            instance.t = 4.0
        for step in steps[40:]:
            follow(host, [step])
            give(other, "state", step[1]["state"])
            other["flow.grain"] = 0.0
            other.step(0.1)
        assert (host["load.tank_grain"], host["load.held_grain"], host["load.drum_flow"]) == end
        assert other["load.held_grain"] < host["load.held_grain"]
        host.fmu.reset()
        host.begin({})
        assert follow(host, steps) < 1e-9
        assert (host["load.tank_grain"], host["load.held_grain"], host["load.drum_flow"]) == end
        host.close()
        other.close()


def test_a_whole_machine_is_the_same_outside(folder, run):
    """Motion, header, process, powertrain and steering, driven by the commands of a real run."""
    names = ["motion", "header", "process", "powertrain", "steering"]
    export_fmu(scenario(), names, folder / "machine.fmu")
    processed, moved, steered = run
    commands = {t: inputs["command"] for t, inputs, _ in steered}
    host = Host(folder / "machine.fmu")
    assert not [n for n in host.table if n.startswith(("header.flow", "motion.")) and "input" in n]
    worst, cut = {}, 0.0
    for t, inputs, outputs in moved[:1000]:
        give(host, "speed.command", inputs["speed"])
        give(host, "steer.command", commands[t])
        host["steer.command.t"] = commands[t].t / NS
        host.step(0.005)
        cut += host["header.flow.grain"]
        for name, gap in differences(host, "motion.state", outputs["state"]).items():
            worst[name] = max(gap, worst.get(name, 0.0))
    assert max(worst.values()) < 1e-9, worst
    load = processed[49][2]["load"]
    assert load.t == moved[999][0]
    assert max(differences(host, "process.load", load).values()) < 1e-9
    assert grain_inside(host, "process.load") == pytest.approx(cut, rel=1e-12)
    assert cut > 10.0
    host.close()


def test_amounts_survive_any_communication_step(folder, process_fmu):
    """Header and process as two FMUs, stepped by what is no multiple of their periods."""
    export_fmu(scenario(), ["header"], folder / "header.fmu")
    header, process = Host(folder / "header.fmu"), Host(process_fmu)
    cut = 0.0
    for _ in range(100):
        y = header["state.pose.y"] + 2.0 * 0.03
        header["state.pose.y"] = y
        header.step(0.03)
        cut += header["flow.grain"]
        for name in ("grain", "straw", "area", "stem_count", "dt", "header_fill"):
            process[f"flow.{name}"] = header[f"flow.{name}"]
        process["state.pose.y"] = y
        process.step(0.03)
    process["flow.grain"] = process["flow.straw"] = 0.0
    process.step(0.2)
    assert grain_inside(process, "load") == pytest.approx(cut, rel=1e-12)
    assert cut > 20.0
    header.close()
    process.close()


@pytest.mark.parametrize("rates", [(15, 15), (29.97, 59.94), (7, 29.97)])
def test_a_communication_step_of_any_rate_ends_with_its_sample(folder, rates):
    text = LONG.replace("start_speed_kmh: 7", f"start_speed_kmh: 7, rate_hz: {rates[0]}")
    text += f"    process: {{rate_hz: {rates[1]}}}\n"
    export_fmu(parse_scenario(text), ["motion", "process"], folder / "rates.fmu")
    host, step = Host(folder / "rates.fmu"), 1 / max(rates)
    assert float(host.model.defaultExperiment.stepSize) == pytest.approx(step, rel=1e-9)
    for n in range(1, 40):
        host.step(step)
        for output, rate in zip(("motion.state", "process.load"), rates, strict=True):
            last = int(n * step * rate + 1e-6)
            assert host[f"{output}.t"] == pytest.approx(last / rate, abs=1e-9), (output, n)
    host.close()


def test_an_edge_detector_gets_arrays(folder):
    drive_by = load_scenario("straight", sets=SCAN_SETS)
    export_fmu(drive_by, ["edge"], folder / "edge.fmu")
    (steps,) = spied(drive_by, "edge")
    host = Host(folder / "edge.fmu")
    assert host["scan.ranges"].shape == (241,)
    for _, inputs, outputs in steps:
        # several between two steps of the detector: one communication step each; at t = 0 the start values
        felt = [sample for sample in inputs["inertial"] if sample.t > 0]
        for sample in felt:
            give(host, "inertial", sample)
            host["inertial.t"] = sample.t / NS
            if sample is felt[-1]:
                give(host, "scan", inputs["scan"])
                give(host, "odometry", inputs["odometry"])
            host.step(0.04 / len(felt))
        assert max(differences(host, "edge", outputs["edge"]).values()) < 1e-9
    assert steps[-1][2]["edge"].is_found
    host.close()


def test_a_scanner_sees_what_its_header_cuts(folder):
    drive_by = load_scenario("straight", sets=[*SCAN_SETS, "combine.motion.rate_hz=50"])
    export_fmu(drive_by, ["lidar", "header"], folder / "lidar.fmu")
    world = assemble(drive_by)
    rows = {}

    def watch(slot, t, outputs):
        rows.setdefault(t, {}).update({slot: outputs})

    drive(world, [watch], until_s=2.0)
    host = Host(folder / "lidar.fmu")
    assert "lidar.truth.points" not in host.table
    scans = 0
    for t in sorted(rows)[1:]:
        if "combine.motion" not in rows[t]:
            continue
        give(host, "motion.state", rows[t]["combine.motion"]["state"])
        host.step(0.02)
        if "combine.lidar" in rows[t]:
            gaps = differences(host, "lidar.scan", rows[t]["combine.lidar"]["scan"])
            assert max(gaps.values()) < 1e-5, gaps  # single precision
            scans += 1
        if "combine.header" in rows[t]:
            assert host["header.flow.grain"] == pytest.approx(
                rows[t]["combine.header"]["flow"].grain, rel=1e-9
            )
    assert scans == 50
    assert float(np.isfinite(host["lidar.scan.ranges"]).mean()) > 0.5
    host.close()


@pytest.mark.usefixtures("code_allowed")
def test_ctrl_c_inside_an_fmu_stops_the_run_as_anywhere(folder, process_fmu, tmp_path, monkeypatch):
    """The binary of an FMU made of Python runs it in this process: the interrupt was a fatal error."""
    monkeypatch.setattr(Session, "step", lambda self, t, h: signal.raise_signal(signal.SIGINT))
    made = parse_scenario(LONG + f"    process: {{level: fmu, file: {process_fmu}}}\n")
    with pytest.raises(KeyboardInterrupt):
        run_job(made, tmp_path / "run")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["incomplete"] is True
    raise_if_lost()  # what runs next in this process is not stopped
