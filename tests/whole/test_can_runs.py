"""Guidance over CAN in whole runs: MIL, SIL and HIL, two processes, a box that dies, the tutorial."""

import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pyarrow.parquet import read_table

from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.link.can.steering import BoxError
from swath.runtime.assembly import assemble
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job
from swath.runtime.loop import drive
from swath.runtime.pacing import make_pacer, paced
from swath.scenario.scenario import load_scenario
from tests.fake_clock import FakeClock
from tests.link.device_rig import free_port

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples" / "can"
SHORT = "run.distance_m=20"
QUICK = ["combine.lidar=off", "combine.edge=truth", "combine.edge.rate_hz=25"]
PATIENT = ["combine.steer.answer_s=300", "combine.steer.wait_s=300"]
GROUP = "239.74.163.2"


@pytest.fixture(scope="module")
def port():
    """A port on which multicast comes back to this machine."""
    import can

    number = free_port(socket.SOCK_DGRAM)
    try:
        with can.Bus(interface="udp_multicast", channel=GROUP, port=number, fd=False) as bus:
            bus.send(can.Message(arbitration_id=1, data=b"x"))
            heard = bus.recv(2.0)  # as long as loopback ever takes; without it there is nothing to test
    except (can.CanError, OSError) as error:
        pytest.skip(f"no UDP multicast here: {error}")
    if heard is None:
        pytest.skip("no UDP multicast here: nothing came back")
    return number


def set_flags(sets):
    return [word for text in sets for word in ("--set", text)]


def run(file, out, *sets):
    return run_job(load_scenario(file, sets=sets), out).summary


class Box:
    """`swath can box` in a process of its own."""

    def __init__(self, *words):
        command = [sys.executable, "-m", "swath.commands.main", "can", "box", *words]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout.readline().startswith("box at address 28")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.communicate()


def header_path(out):
    table = read_table(out / "tracks.parquet").to_pydict()
    return np.array([table["header_end_x_m"], table["header_end_y_m"]]).T


def across(a, b):
    """How far the points of path b lie beside path a [m]."""
    found = []
    for point in b[50:-50:5]:
        k = int(np.argmin(np.hypot(*(a - point).T)))
        k = min(max(k - 1, 0), len(a) - 3)
        along = a[k + 2] - a[k]
        beside = point - a[k]
        found.append(abs(along[0] * beside[1] - along[1] * beside[0]) / np.hypot(*along))
    return np.array(found)


def test_the_three_files_are_the_same_test():
    plain = {name: load_scenario(FOLDER / f"{name}.yaml").plain() for name in ("mil", "sil", "hil")}
    for each in plain.values():
        each["machines"]["combine"].pop("steer")
        for key in ("name", "summary", "realtime"):
            each.pop(key, None)
    assert plain["mil"] == plain["sil"] == plain["hil"]


@pytest.fixture(scope="module")
def sil(tmp_path_factory):
    out = tmp_path_factory.mktemp("can") / "sil"
    return out, run(FOLDER / "sil.yaml", out, SHORT, *QUICK)


def test_the_law_behind_the_bus_stays_within_a_centimetre_of_the_law_in_process(sil, tmp_path):
    out, summary = sil
    level = "combine.steer.crab=0"  # the bus has no inclination
    mil = run(FOLDER / "mil.yaml", tmp_path / "mil", SHORT, *QUICK, level)
    apart = across(header_path(tmp_path / "mil"), header_path(out))
    assert 0.0 < apart.max() < 0.01
    assert abs(summary["lateral_rms_m"] - mil["lateral_rms_m"]) < 0.01


def test_another_process_in_lock_step_gives_the_same_bytes(sil, port, tmp_path):
    outside = ["combine.steer.box=outside", "combine.steer.interface=udp_multicast"]
    outside += [f"combine.steer.options.port={port}", *PATIENT]
    with Box(str(FOLDER / "sil.yaml"), *set_flags(outside), "--once") as box:
        summary = run(FOLDER / "sil.yaml", tmp_path / "out", SHORT, *QUICK, *outside)
        said, _ = box.process.communicate(timeout=600)
    assert summary["digest"] == sil[1]["digest"]
    assert box.process.returncode == 0
    assert re.search(r"switched off after \d{3} commands", said)


class Kills(RunHook):
    """Kills a box half a second of the run after its start."""

    def __init__(self, box):
        self.process = box.process

    def begin(self, run):
        run.observers.append(self)

    def __call__(self, slot, t, outputs):
        if t >= NS // 2 and self.process.poll() is None:
            self.process.kill()
            self.process.wait()


def test_a_box_that_dies_is_a_named_error_and_the_folder_is_kept(port, tmp_path):
    outside = [f"combine.steer.options.port={port}", "combine.steer.lock_step=true"]
    outside += ["combine.steer.answer_s=5", "combine.steer.wait_s=300", "realtime.factor=2"]
    out = tmp_path / "out"
    said = r"combine.steer: the box 28 on udp_multicast .* did not answer within 5 s, at"
    with Box(str(FOLDER / "hil.yaml"), *set_flags(outside)) as box:
        with pytest.raises(BoxError, match=said):
            run_job(load_scenario(FOLDER / "hil.yaml", sets=[*QUICK, *outside]), out, hooks=[Kills(box)])
        assert box.process.stdout.readline().startswith("machine connected")
    summary = json.loads((out / "summary.json").read_text())
    assert summary["incomplete"] is True
    assert summary["realtime"]["ticks"] >= 20


def test_a_paced_loop_over_the_bus_between_two_processes(port, tmp_path):
    sets = [f"combine.steer.options.port={port}", "realtime.factor=4", "run.distance_m=8", *PATIENT]
    with Box(str(FOLDER / "hil.yaml"), *set_flags(sets), "--once") as box:
        summary = run(FOLDER / "hil.yaml", tmp_path / "out", *QUICK, *sets)
        box.process.communicate(timeout=600)
    assert summary["incomplete"] is False
    assert summary["realtime"]["factor"] == 4.0
    engaged = read_table(tmp_path / "out" / "tracks.parquet").column("engaged").to_numpy()
    assert engaged[-100:].any()


def test_without_pacing_or_lock_step_it_is_refused():
    with pytest.raises(InputError, match=r"combine.steer: .*real time: .*--real-time"):
        assemble(load_scenario(FOLDER / "hil.yaml", sets=["realtime.pace=free", *QUICK]))


def test_a_box_that_falls_silent_releases_the_steering_and_is_noted(monkeypatch):
    inside = ["combine.steer.box=inside", "combine.steer.interface=virtual", "run.max_duration_s=4"]
    world = assemble(load_scenario(FOLDER / "hil.yaml", sets=[*QUICK, *inside]))
    part = world.leader.parts["steer"]
    engaged = {}

    def look(slot, t, outputs):
        if slot == "combine.steer" and t:
            engaged[t // 1_000_000] = outputs["command"].is_engaged
        if slot == "combine.steer" and t == 2_000_000_000:
            part._box.serve = lambda timeout=0.0: None

    with paced(world.graph, make_pacer(world, clock=FakeClock())):
        drive(world, [look])
    world.close()
    assert engaged[1900]
    assert engaged[2300]
    assert not engaged[2340]
    assert not engaged[3900]
    assert world.leader.notes == [
        "combine: steer: no guidance command of the box 28 for 300 ms, the last one at 2.02 s; "
        "the steering was released at 2.34 s"
    ]


@pytest.mark.draws
def test_the_commands_of_the_tutorial_run(port, tmp_path):
    text = (ROOT / "docs" / "how-to" / "hil.md").read_text(encoding="utf-8")
    commands = "\n".join(re.findall(r"```sh\n(.*?)```", text, flags=re.S)).replace("swath new examples\n", "")
    assert "examples/can/my_controller.py" in commands
    assert "swath can box" in commands
    folder = tmp_path / "examples" / "can"
    folder.mkdir(parents=True)
    for file in FOLDER.iterdir():
        if file.suffix in (".yaml", ".py"):
            changed = file.read_text().replace("udp_multicast,", f"udp_multicast, options: {{port: {port}}},")
            (folder / file.name).write_text(
                changed.replace("distance_m: 70", "distance_m: 15").replace("max: 0.10", "max: 1.0")
            )
    commands = commands.replace("$(swath can dbc)", f"$(swath can dbc) --port {port}")
    commands = commands.replace("swath can listen", f"swath can listen --option port={port}")
    quick = " ".join(set_flags(QUICK))
    shell = f"""set -e
swath() {{
  if [ "$1" = run ]; then
    case "$2" in *hil*) extra="--set realtime.factor=2";; *) extra="";; esac
    {sys.executable} -m swath.commands.main "$@" --no-report --no-replay {quick} $extra
  else {sys.executable} -m swath.commands.main "$@"; fi
}}
python() {{ {sys.executable} "$@"; }}
{commands}
wait
"""
    done = subprocess.run(
        ["bash", "-c", shell], cwd=tmp_path, env=os.environ, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr + done.stdout
    found = {p.name for p in (tmp_path / "runs").iterdir()}
    assert {"mil", "sil", "hil", "mine"} <= found
    assert "GuidanceSystemCommand" in done.stdout
