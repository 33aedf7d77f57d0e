"""Every socket that a command opens is in the table of SECURITY.md, at the address that it says."""

import ast
import os
import re
from contextlib import suppress
from pathlib import Path
from subprocess import TimeoutExpired

import pytest

import swath
from swath.commands.main import main
from tests.link.ros2_rig import domain, needs_ros2, start  # noqa: F401

ROOT = Path(__file__).parents[2]
SCENARIO = """
format: swath scenario 2
name: heard
run: {distance_m: 0.3, max_duration_s: 1}
realtime: {}
field: {stand: {level: uniform}, edge: {shape: straight},
  origin: {latitude_deg: 51, longitude_deg: 8}}
machines:
  combine: {lidar: {level: empirical}, gnss: {level: ideal}, edge: truth}
"""
MODULES = {  # of src that make sockets, and the rows of the table that they are for
    "runtime/served.py": "run --view, run --foxglove, run --device",
    "link/device/wires.py": "run --device, level device, level agopengps, level analog",
    "link/can/bus.py": "run --isobus, can box, level can",
    "link/can/udp.py": "can box",
    "field_io/logs/frames.py": "",  # of python-can the readers of files alone
    "tools/run_log/write.py": "",
    "link/ros2/middleware.py": "run --ros2, ros2 play, level ros2",
    "link/fmi/child_process.py": "",  # a pair without an address
    "link/ros2/bridge.py": "run --ros2",
    "link/ros2/slotnode.py": "level ros2",
    "link/ros2/drive_node.py": "ros2 play",
    "link/foxglove.py": "run --foxglove",
    "replay/live/view.py": "run --view",
    "tools/function_test/cluster.py": "test run --cluster local",
}
LIBRARIES = {"socket", "socketserver", "http.server", "http.client", "asyncio", "websockets", "can", "rclpy",
             "distributed", "dask", "dask_jobqueue", "xmlrpc", "ftplib", "smtplib", "ssl", "zmq"}  # fmt: skip
LINES = {  # words behind `run`: what is bound, and where
    "": set(),
    "--foxglove 127.0.0.1:0": {"127.0.0.1"},
    "--view": {"127.0.0.1"},
    "--device lidar=lms://:0": {"127.0.0.1"},
    "--device gnss=nmea://:0": {"127.0.0.1"},
    "--device gnss=nmea+udp://:9": set(),  # sends
    "--set combine.steer.level=agopengps --set combine.steer.listen=127.0.0.1:0": {"127.0.0.1"},
    "--set combine.steer.level=analog --set combine.steer.address=analog://:0": {"127.0.0.1"},
    "--isobus virtual:heard": set(),
}


def rows():
    table = (ROOT / "SECURITY.md").read_text().split("## Sockets")[1].split("\n## ")[0]
    return re.findall(r"^\| (.+?) \| (.+?) \| (.+?) \|$", table, re.MULTILINE)[1:]


@pytest.mark.parametrize("words", LINES)
def test_a_command_binds_what_the_table_says_and_nothing_else(words, tmp_path, monkeypatch, reached):
    pytest.importorskip("websockets")
    monkeypatch.chdir(tmp_path)
    Path("heard.yaml").write_text(SCENARIO)
    line = ["run", "heard.yaml", *words.split(), "--set", "run.max_duration_s=0.1", "--quiet"]
    line += ["--no-report", "--no-replay", "--out", "out"]
    assert main(line) in (0, 1, 3)
    assert {at[0] for how, at in reached if how == "bind" and isinstance(at, tuple)} == LINES[words]


@pytest.mark.parametrize("words", ["box heard.yaml", "listen --count 0"])
def test_can_binds_one_port_that_every_interface_reaches(words, tmp_path, monkeypatch, reached):
    pytest.importorskip("can")
    monkeypatch.chdir(tmp_path)
    Path("heard.yaml").write_text(SCENARIO)
    monkeypatch.setattr("swath.link.can.box.run_box", lambda *args, **options: None)
    assert main(["can", *words.split(), "--interface", "udp_multicast", "--channel", "239.74.163.7"]) == 0
    bound = {at for how, at in reached if how == "bind"}
    assert bound == {("", 43113)}  # others' frames are dropped: tests/link/test_can_udp.py


def opened(pid):
    """(kind, address, port) of the internet sockets of a process, the address as the system writes it."""
    own = {os.readlink(fd) for fd in Path(f"/proc/{pid}/fd").iterdir() if os.path.lexists(fd)}
    files = [Path("/proc/net", kind) for kind in ("udp", "udp6", "tcp", "tcp6")]
    rows = [(f.name, line.split()) for f in files if f.exists() for line in f.read_text().splitlines()[1:]]
    places = [(kind, *row[1].split(":")) for kind, row in rows if f"socket:[{row[9]}]" in own]
    return {(kind, address, int(port, 16)) for kind, address, port in places}


class TestRos2Play:
    pytestmark = needs_ros2

    @pytest.mark.skipif(not Path("/proc/net/udp").exists(), reason="needs Linux")
    def test_it_opens_nothing_beyond_this_machine(self, domain, tmp_path, monkeypatch):  # noqa: F811
        monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
        monkeypatch.chdir(tmp_path)
        Path("heard.yaml").write_text(SCENARIO)
        run = ["run", "heard.yaml", "--quiet", "--no-report", "--no-replay", "--out", "out"]
        assert main(run) in (0, 1, 3)
        process = start("-m", "swath", "ros2", "play", "out")
        found = set()
        while process.poll() is None:
            try:
                found |= opened(process.pid)
            except OSError:  # it has ended since
                continue
            with suppress(TimeoutExpired):
                process.wait(0.02)
        assert process.returncode == 0
        sending = range(*map(int, Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()))
        assert {place[:2] for place in found if place[2] not in sending} == {("udp", "0100007F")}


def test_what_makes_sockets_is_in_the_table():
    listed = " ".join(row[0] for row in rows()).replace("`", "")
    source = Path(swath.__file__).parent
    found = set()
    imports = re.compile(rf"\b(import|from)\b.*\b({'|'.join(LIBRARIES)})\b")
    texts = {file: file.read_text(encoding="utf-8") for file in source.rglob("*.py")}
    for file in filter(lambda file: imports.search(texts[file]), texts):
        for node in ast.walk(ast.parse(texts[file])):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if LIBRARIES.intersection({*names, *(name.split(".")[0] for name in names)}):
                found.add(str(file.relative_to(source)))
    assert found == set(MODULES)
    for module, commands in MODULES.items():
        for command in filter(None, commands.split(", ")):
            assert command.split(" --")[-1].split()[-1] in listed, (module, command)
    for opened, at, known in rows():
        assert "`" in opened
        assert at
        assert known
