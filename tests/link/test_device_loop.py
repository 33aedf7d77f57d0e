"""The box closed: scans out over TCP, a process of its own, steering in over UDP; and runs with devices."""

import os
import re
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack, suppress
from pathlib import Path

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError, SwathError
from swath.core.foreign_code import allow_code
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job, run_unrecorded
from swath.scenario.scenario import load_scenario
from tests.link.device_rig import free_port, heard_by
from tests.link.independent_lms import Deviation, Lms
from tests.waiting import PATIENCE_S, ended, until

EXAMPLES = Path(__file__).parents[2] / "examples" / "devices"
BEND = ["field.edge.run_in_m=10", "run.distance_m=20"]  # a run is judged from 10 m on


class Follows(RunHook):
    """Each tick of a run waits until the box has answered all scans before it. heard: its answers."""

    def __init__(self, heard):
        self.heard = heard

    def begin(self, run):
        (self.device,) = run.world.devices
        run.world.graph.before_tick.append(lambda t: until(self.is_answered, "the box has answered"))

    def is_answered(self):
        return len(self.heard) >= self.device.sent_count


def closed(flags, sets, heard):
    """The run with `my_box.py` in a process of its own: its summary, and what the box printed."""
    scanner = free_port()
    box = [sys.executable, str(EXAMPLES / "my_box.py"), "--scanner", f"127.0.0.1:{scanner}", *flags]
    device = f"combine.lidar.device=lms://127.0.0.1:{scanner}?wait_s=300"
    sets = [*BEND, "realtime.spin_ms=0", device, *sets]
    env = {**os.environ, "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(box, stdout=subprocess.PIPE, text=True, env=env) as process:
        try:
            summary = run_unrecorded(load_scenario(EXAMPLES / "wire.yaml", sets=sets), hooks=[Follows(heard)])
            said = process.communicate(timeout=PATIENCE_S)[0]
        finally:
            process.kill()
    return summary, said


@pytest.fixture(scope="module")
def in_memory():
    with allow_code(None):
        return run_unrecorded(load_scenario(EXAMPLES / "memory.yaml", sets=BEND))


def over_udp(monkeypatch, held):
    module = f"127.0.0.1:{free_port()}"
    sets = [f"combine.steer.listen={module}", f"combine.steer.reply=127.0.0.1:{free_port()}"]
    return ["--module", module], sets, heard_by(monkeypatch)


def over_can(monkeypatch, held):
    can = pytest.importorskip("can")
    port, heard = free_port(socket.SOCK_DGRAM), []
    bus = can.Bus(interface="udp_multicast", channel="239.74.163.2", port=port, fd=False)
    commands = can.Notifier(bus, [lambda f: f.arbitration_id >> 16 & 0xFF == 0xAD and heard.append(f)])
    held.callback(bus.shutdown)
    held.callback(commands.stop)
    level = f"combine.steer={{level: can, overlap_m: 0.1, options: {{port: {port}}}}}"
    return ["--can", "udp_multicast", "--can-port", str(port)], [level], heard


def as_volts(monkeypatch, held):
    where = f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    level = f"combine.steer={{level: analog, full_deg: 35, address: 'analog+udp://{where}'}}"
    return ["--volts", where], [level], heard_by(monkeypatch)


@pytest.mark.parametrize(("way", "telegrams"), [
    (over_udp, "CoLaA"), (over_can, "CoLaB"), pytest.param(as_volts, "CoLaB", marks=pytest.mark.draws),
])  # fmt: skip
def test_the_box_on_the_wire_steers_as_it_does_in_memory(in_memory, way, telegrams, monkeypatch):
    with ExitStack() as held:
        flags, sets, heard = way(monkeypatch, held)
        summary, said = closed([*flags, "--telegrams", telegrams], sets, heard)
    wire, memory = summary["lateral_rms_m"], in_memory["lateral_rms_m"]
    device = summary["devices"]["combine.lidar"]
    print(f"{telegrams} {way.__name__}: lateral RMS {wire:.4f} m on the wire, {memory:.4f} m in memory")
    print(f"scans sent: {device['sent']}, jitter {device['jitter_ms']}; the box: {said.strip()}")
    assert abs(wire - memory) <= 0.01
    assert device["sent"] == device["samples"] >= 240
    assert int(re.search(r"(\d+) scans", said).group(1)) == device["sent"] - 1


def test_a_device_needs_the_pace_of_the_clock():
    with pytest.raises(InputError, match=r"combine.lidar.device = lms://: expected a run with --real-time"):
        run_unrecorded(load_scenario("straight", sets=["combine.lidar.device=lms://"]))


def test_a_port_in_use_ends_the_command_before_there_is_a_folder(tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"lidar=lms://127.0.0.1:{taken.getsockname()[1]}"
        code = main(
            ["run", "straight", "--real-time", "--device", address, "--out", str(tmp_path / "r"), "--quiet"]
        )
    assert code == 2
    assert "could not listen: the port is in use" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()


@pytest.mark.parametrize(
    ("flag", "expected"),
    [
        ("lidar", "expected SLOT=ADDRESS, such as lidar=lms://127.0.0.1:2111"),
        ("lidar=sick://", "combine.lidar.device = sick://: expected lms://"),
        ("steer=lms://", "expected a slot such as lidar, that sends a Scan"),
        ("gnss=nmea+tcp://", "expected a field that lies on Earth: set field.origin"),
        ("nothing=lms://", "unknown key"),
    ],
)
def test_a_flag_that_does_not_fit_is_one_error(flag, expected, capsys):
    assert main(["run", "straight", "--real-time", "--device", flag, "--quiet"]) == 2
    assert expected in capsys.readouterr().err


def test_a_slot_of_several_machines_has_to_be_named(capsys):
    assert main(["run", "two-combines", "--real-time", "--device", "lidar=lms://", "--quiet"]) == 2
    assert re.search(r"expected one of the machines: \w+\.lidar or \w+\.lidar", capsys.readouterr().err)


def test_nobody_who_asks_within_wait_s_is_one_error():
    address = f"lms://127.0.0.1:{free_port()}?wait_s=0.5"
    sets = ["realtime.pace=real_time", f"combine.lidar.device={address}", "run.distance_m=1"]
    with pytest.raises(SwathError, match=r"nobody asked lms://127\.0\.0\.1:\d+ for data within wait_s"):
        run_unrecorded(load_scenario("straight", sets=sets))


def test_a_device_changes_no_result_and_the_port_is_free_again():
    port = free_port()
    sets = ["run.distance_m=1", "combine.lidar.level=empirical"]
    paced = [*sets, "realtime.pace=real_time", f"combine.lidar.device=lms://127.0.0.1:{port}"]
    digests = {run_unrecorded(load_scenario("straight", sets=s))["digest"] for s in (sets, paced, paced)}
    assert len(digests) == 1
    with socket.create_server(("127.0.0.1", port)):
        pass


def test_one_run_s_scanner_is_another_s_sensor():
    """Level `device` fed by a slot that is served: the scans arrive, and the run of the other goes on."""
    over = threading.Event()

    class Over(Exception):
        pass

    class Lasts(RunHook):
        """The feeding run lasts as long as the fed one."""

        def begin(self, run):
            run.world.graph.before_tick.append(self.look)

        def look(self, t):
            if over.is_set():
                raise Over

    class Fed(RunHook):
        """Each period of the fed run waits for a scan."""

        def begin(self, run):
            part = run.world.leader.parts["lidar"]
            run.world.graph.before_tick.append(
                lambda t: t % 40_000_000 or until(lambda: part._reader._pieces, "a scan")
            )

    address = f"lms://127.0.0.1:{free_port()}"
    paced, level = "realtime.pace=real_time", "combine.lidar.level=empirical"
    feeding = [paced, level, "run.distance_m=60", f"combine.lidar.device={address}?wait_s=300"]
    fed = [paced, "run.distance_m=2.4"]
    fed += [f"combine.lidar={{level: device, address: '{address}', mount: {{}}, wait_s: 300}}"]
    scenarios = [load_scenario("straight", sets=sets) for sets in (feeding, fed)]

    def feed():
        with suppress(Over):
            run_unrecorded(scenarios[0], hooks=[Lasts()])

    thread = threading.Thread(target=feed)
    thread.start()
    notes = "\n".join(run_unrecorded(scenarios[1], hooks=[Fed()])["notes"])
    over.set()
    ended(thread)
    count = int(re.search(r"lidar: (\d+) samples from lms", notes).group(1))
    assert count >= 25


class Watch(RunHook):
    """The samples of a run."""

    def __init__(self):
        self.scans = {}

    def begin(self, run):
        run.observers.append(self)

    def __call__(self, slot, t, outputs):
        if slot == "combine.lidar" and t:
            self.scans[t] = outputs["scan"]


def test_a_client_hears_the_scans_that_the_recording_gets(tmp_path):
    port, heard = free_port(), []

    def listen():
        with connected(port) as client, suppress(Deviation):  # the sensor closes the connection
            client.stream(is_on=True)
            while True:
                heard.append(client.scan())

    sets = [
        "realtime.pace=real_time", "run.distance_m=2", "combine.lidar.level=empirical",
        f"combine.lidar.device=lms://127.0.0.1:{port}?wait_s=300",
    ]  # fmt: skip
    thread, watch = threading.Thread(target=listen), Watch()
    thread.start()
    run_job(load_scenario("straight", sets=sets), tmp_path / "run", hooks=[watch])
    ended(thread)
    assert len(heard) >= 20
    for told in heard:
        scan, dist = watch.scans[told.sent * 1000], told.channels16["DIST1"]
        azimuth = np.radians((dist.start + dist.step * np.arange(len(dist.data))) * 1e-4 - 90.0)
        np.testing.assert_allclose(azimuth, scan.azimuth, atol=1e-6 * len(dist.data))
        ranges = np.nan_to_num(scan.ranges[:, 0].astype(float))
        told_m = np.array(dist.data) * dist.scale * 1e-3
        np.testing.assert_allclose(told_m, ranges, atol=0.5e-3 * dist.scale + 1e-6)


def connected(port):
    """A client, once there is a sensor."""

    def client():
        with suppress(ConnectionRefusedError):
            return Lms("127.0.0.1", port, is_binary=True)

    return until(client, "there is a sensor")
