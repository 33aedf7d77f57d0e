"""Addresses, buses and terminals that lead out of this program are opened only where the user names them."""

import socket

import pytest

import swath
from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.foreign_code import allow_code, only_code
from swath.link.can.bus import Where, check_bus
from swath.link.device.address import is_loopback, read_address
from swath.link.device.output import PROTOCOLS
from swath.scenario.scenario import load_scenario

SCENARIO = """
format: swath scenario 2
name: strange
run: {{distance_m: 0.3, max_duration_s: 1, record: none}}
realtime: {{}}
field:
  {{stand: {{level: uniform}}, edge: {{shape: straight}}, origin: {{latitude_deg: 51, longitude_deg: 8}}}}
machines:
  combine: {{motion: kinematic, {slot}}}
"""
STRANGE = {  # a row of the report each, with its siblings: slot, the address that has to be named
    "scanner on all interfaces": (
        "lidar: {level: empirical, device: 'lms://0.0.0.0:0'}", "lms://0.0.0.0:0"),
    "scanner on all of IPv6": ("lidar: {level: empirical, device: 'lms://[::]:0'}", "lms://[::]:0"),
    "scanner as a short zero": ("lidar: {level: empirical, device: 'lms://0:0'}", "lms://0:0"),
    "packets to the network": (
        "lidar: {level: empirical, sensor: velodyne-vlp16, device: 'velodyne://255.255.255.255'}",
        "velodyne://255.255.255.255"),
    "receiver by a name": ("gnss: {level: ideal, device: 'nmea+tcp://example.org'}", "nmea+tcp://example.org"),
    "a link anywhere": ("gnss: {level: ideal, device: 'nmea+pty://LINK'}", "nmea+pty://LINK"),
    "a file as a serial port": (
        "gnss: {level: device, address: 'nmea+pty://SECRET', antenna_m: [0, 0, 3]}", "nmea+pty://SECRET"),
    "a device elsewhere": (
        "lidar: {level: device, address: 'lms://192.0.2.1', mount: {z_m: 2}}", "lms://192.0.2.1"),
    "steered from the network": ("steer: {level: agopengps, listen: '0.0.0.0:0'}", "0.0.0.0:0"),
    "steered by volts": ("steer: {level: analog, address: 'analog://0.0.0.0:0'}", "analog://0.0.0.0:0"),
    "answers to the network": ("steer: {level: agopengps, reply: '192.0.2.1:9999'}", "192.0.2.1:9999"),
    "a spy that writes a file": (
        "steer: {level: can, interface: slcan, channel: 'spy://loop://?file=SECRET'}",
        "slcan:spy://loop://?file=SECRET"),
    "a bus over the network": ("steer: {level: can, interface: socketcand, channel: c}", "socketcand:c"),
    "a bus that is wired": ("steer: {level: can, interface: socketcan, channel: can0}", "socketcan:can0"),
    "a library as an option": (
        "steer: {level: can, interface: virtual, channel: a, options: {dll: ./evil.so}}", "./evil.so"),
    "other machines on the bus": (
        "steer: {level: can, channel: 239.0.0.9, options: {peers: 192.0.2.1}}", "192.0.2.1"),
    "datagrams that travel": ("steer: {level: can, channel: 239.0.0.9, options: {hop_limit: 9}}", "9"),
    "datagrams to one machine": ("steer: {level: can, channel: 192.0.2.1}", "udp_multicast:192.0.2.1"),
}  # fmt: skip


def written(folder, slot):
    (folder / "secret.txt").write_text("years of work")
    slot = slot.replace("SECRET", str(folder / "secret.txt")).replace("LINK", str(folder / "link"))
    (folder / "s.yaml").write_text(SCENARIO.format(slot=slot))


@pytest.mark.parametrize("kind", STRANGE)
def test_a_scenario_alone_opens_nothing_and_one_line_says_what_to_type(
    kind, tmp_path, monkeypatch, capsys, reached
):
    slot, address = STRANGE[kind]
    address = address.replace("SECRET", str(tmp_path / "secret.txt")).replace("LINK", str(tmp_path / "link"))
    written(tmp_path, slot)
    monkeypatch.chdir(tmp_path)
    had = sorted(tmp_path.iterdir())
    assert main(["run", "s.yaml", "--quiet", "--no-report", "--no-replay", "--out", "out"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1, said
    assert "--allow-address" in said
    assert address in said
    assert "s.yaml:" in said
    assert reached == []
    assert sorted(p for p in tmp_path.iterdir() if p.name != "out") == had
    assert (tmp_path / "secret.txt").read_text() == "years of work"
    with pytest.raises(InputError, match="addresses="):
        swath.run("s.yaml", "out", report=False)
    assert reached == []


@pytest.mark.parametrize("line", [
    ["--allow-address", "lms://0.0.0.0:0"],
    ["--device", "lidar=lms://0.0.0.0:0"],
    ["--set", "combine.lidar.device=lms://0.0.0.0:0"],
    ["--set", "combine.lidar={level: empirical, device: 'lms://0.0.0.0:0'}"],
])  # fmt: skip
def test_what_the_command_line_names_is_opened(line, tmp_path, monkeypatch, reached):
    written(tmp_path, "edge: truth, lidar: {level: empirical, device: 'lms://0.0.0.0:0'}")
    monkeypatch.chdir(tmp_path)
    assert main(["run", "s.yaml", *line, "--quiet", "--no-report", "--no-replay", "--out", "out"]) in (
        0,
        1,
        3,
    )
    assert [at for how, at in reached if how == "bind"] == [("0.0.0.0", 0)]


def test_what_python_names_is_opened_and_a_scenario_remembers_it(tmp_path, reached):
    written(tmp_path, "edge: truth, lidar: {level: empirical, device: 'lms://0.0.0.0:0'}")
    scenario = swath.load_scenario(tmp_path / "s.yaml", addresses=["lms://0.0.0.0:0"])
    swath.run(scenario, tmp_path / "out", report=False)
    assert ("0.0.0.0", 0) in [at for _, at in reached]


def test_a_change_of_a_run_names_no_address(tmp_path):
    """What comes from outside while a run goes on may open what the user named before, nothing else."""
    with allow_code(None, ["lms://192.0.2.1"]), only_code([]):
        assert read_address("lms://192.0.2.1", PROTOCOLS).host == "192.0.2.1"
        with pytest.raises(InputError, match="--allow-address"):
            read_address("lms://192.0.2.2", PROTOCOLS)


@pytest.mark.parametrize("where", [
    Where("virtual", "a", {"receive_own_messages": True}), Where("socketcan", "vcan0", {"fd": True}),
    Where("udp_multicast", "239.74.163.2", {"port": 5000}), Where("udp_multicast", "ff11::1"),
])  # fmt: skip
def test_virtual_buses_are_free(where):
    pytest.importorskip("can")
    assert check_bus(where) is where


def test_a_bus_is_named_as_one_or_by_its_two_keys():
    pytest.importorskip("can")
    for named in (["socketcan:can0"], ["socketcan", "can0"]):
        with allow_code((), named):
            check_bus(Where("socketcan", "can0"))
    with allow_code((), ["socketcan"]), pytest.raises(InputError, match="socketcan:can0"):
        check_bus(Where("socketcan", "can0"))


def test_only_addresses_of_this_machine_are_loopback():
    free = ["127.0.0.1", "127.8.9.1", "::1", "localhost"]
    others = [
        "0.0.0.0",
        "::",
        "0",
        "127.1",
        "10.0.0.1",
        "localhost.example",
        "::ffff:192.0.2.1",
        socket.gethostname(),
    ]
    assert [host for host in free + others if is_loopback(host)] == free


def test_looking_at_a_scenario_needs_no_address(tmp_path):
    written(tmp_path, STRANGE["scanner on all interfaces"][0])
    assert load_scenario(str(tmp_path / "s.yaml")).name == "strange"
