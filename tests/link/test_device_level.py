"""Level `device`: what a sensor sends fills a slot; and level `agopengps`: what AgOpenGPS sends steers."""

import math
import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from swath.core.component import Port
from swath.core.errors import InputError, SwathError
from swath.core.foreign_code import allow_code
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.field.maps.projection import origin_at
from swath.link.device import cola, lms, nmea, pgn, velodyne
from swath.link.levels import agopengps
from swath.link.levels.device import DRIFT, DeviceClock, DeviceSlot, Params
from swath.machine.machine_sheet import load_machine
from swath.sensing.mount import Mount
from swath.signals import Fix, Odometry, Scan, SteerCommand
from swath.signals.setup import ControlSetup, LinkSetup
from tests.link.device_rig import STEP, device, drawn_fix, free_port, plane_scan
from tests.link.independent_agopengps import HELLO, answer_of, hello_angle_of, steer_command
from tests.link.test_device_velodyne import PERIOD, turn

ORIGIN = origin_at(52.0, 10.9)


def setup(slot, signal, *, period=0.04, origin=ORIGIN, inputs=()):
    machine = load_machine("lexion-700-class")
    control = ControlSetup(machine, {}, "left", period)
    to_local = None if origin is None else origin.to_field
    port = Port("out", signal, shape=(None,)) if signal is Scan else Port("out", signal)
    return LinkSetup("combine", slot, inputs, (port,), control, Path(), to_local=to_local)


def opened(address, signal, **keys):
    """A slot that has its first sample."""
    keys = {"mount": Mount()} | keys if signal is Scan else {"antenna_m": (1.0, 0.0, 3.9)} | keys
    part = DeviceSlot(Params(address, **keys), setup("slot", signal))
    return part, part.reset(Stream(0, "x"))


@pytest.mark.parametrize("dialect", ["a", "b"])
def test_a_slot_filled_by_an_lms_has_its_scans(dialect):
    made, rng = device("lms://127.0.0.1:0", Scan), np.random.default_rng(1)
    scans = {n: plane_scan(n * STEP, rng) for n in range(30)}
    made("slot", 0, {"scan": scans[0]})
    part = DeviceSlot(
        Params(f"lms://127.0.0.1:{made.port}?cola={dialect}", mount=Mount()), setup("lidar", Scan)
    )

    def send():
        for n in range(1, 30):
            time.sleep(0.02)
            made("slot", n * STEP, {"scan": scans[n]})

    sender = threading.Thread(target=send)
    sender.start()
    first = part.reset(Stream(0, "x"))["out"]
    assert first.t == 0
    found, t = [], 0
    for _ in range(60):
        time.sleep(0.01)
        out = part.step(t, 10_000_000, {})
        t += 10_000_000
        found += list(out.values())
    sender.join()
    part.close(), made.close()
    assert 20 <= len(found) <= 29
    assert all(0 < scan.t <= t for scan in found)
    told = {n: scan for n in scans for scan in found if len(scan.ranges) and np.allclose(
        np.nan_to_num(scan.ranges), np.nan_to_num(scans[n].ranges), atol=6e-4)}  # fmt: skip
    assert len(told) == len(found)
    for n, scan in told.items():
        np.testing.assert_allclose(scan.azimuth, scans[n].azimuth, atol=lms.TICK)
        np.testing.assert_allclose(scan.beam_t, scans[n].beam_t, atol=2e-6)
        np.testing.assert_allclose(scan.intensity, scans[n].intensity, atol=1e-4)


def lms_bytes(counter, rng, t=None):
    scan = plane_scan((counter if t is None else t) * STEP, rng, count=11)
    plane = lms.plane_of(scan, "LMS1xx", 0.04, 40.0)
    return cola.telegram(
        "sSN", "LMDscandata", lms.scan_items(plane, scan, counter, lms.Wanted()), binary=True
    )


def test_lost_late_and_broken_telegrams_are_told_and_the_last_scan_counts():
    rng = np.random.default_rng(2)
    with socket.create_server(("127.0.0.1", 0)) as server:
        part = DeviceSlot(
            Params(f"lms://127.0.0.1:{server.getsockname()[1]}", mount=Mount()), setup("lidar", Scan)
        )
        threading.Thread(target=part.reset, args=(Stream(0, "x"),)).start()
        connection, _ = server.accept()
        connection.sendall(lms_bytes(65_534, rng, 1))
        time.sleep(0.3)
        broken = bytearray(lms_bytes(65_535, rng, 2))
        broken[40] ^= 1
        connection.sendall(bytes(broken) + lms_bytes(0, rng, 3) + lms_bytes(3, rng, 4) + lms_bytes(2, rng, 5))
        connection.sendall(b"noise" + cola.telegram("sFA", "", binary=True) + lms_bytes(4, rng, 6))
        time.sleep(0.3)
        out = part.step(0, STEP, {})["out"]
        assert len(out.ranges) == 11
        connection.close()
        time.sleep(0.2)
        assert part.step(STEP, NS, {}) == {}
        part.close()
    notes = "\n".join(part.notes)
    assert "3 scans were lost" in notes  # 65535, which was broken, 1 and 2
    assert "1 scans came late and were left out" in notes
    assert "bytes were no telegram" in notes
    assert "the connection broke off" in notes or "has closed the connection" in notes
    assert "no sample for 1000 ms" in notes


def test_a_slot_filled_by_a_velodyne_has_its_turns():
    rng = np.random.default_rng(3)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        part = DeviceSlot(
            Params("velodyne://127.0.0.1:23681", mount=Mount()),
            setup("lidar", Scan, period=PERIOD),
        )

        def send():
            time.sleep(0.1)
            for n in (1, 2):
                scan = turn(n * 100_000_000, rng)
                for packet in velodyne.packets(scan, velodyne.grid_of(scan)):
                    sender.sendto(packet, ("127.0.0.1", 23681))
                    time.sleep(0.0005)

        thread = threading.Thread(target=send)
        thread.start()
        scan = part.reset(Stream(0, "x"))["out"]
        thread.join()
        part.close()
    assert len(scan.ranges) == 28_800
    assert np.isnan(scan.ranges).mean() == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("transport", ["tcp", "udp", "pty"])
def test_a_slot_filled_by_a_receiver_has_its_fixes(transport, tmp_path):
    port = 10_111
    where = str(tmp_path / "gnss") if transport == "pty" else f"127.0.0.1:{port}"
    address = f"nmea+{transport}://{where}"
    with allow_code((), addresses=[address]):
        made = device(address, Fix, origin=ORIGIN, period=0.1)
        part = DeviceSlot(Params(address, antenna_m=(1.0, 0.0, 3.9)), setup("gnss", Fix, period=0.1))
    fixes = {}
    rng = np.random.default_rng(4)
    for n in range(1, 30):
        x, y = rng.uniform(-300, 300, 2)
        (lon, lat), z = np.radians(ORIGIN.to_lon_lat([[x, y]])[0]), rng.uniform(50, 90)
        fixes[n] = drawn_fix(
            n * 100_000_000, rng, longitude=lon, latitude=lat, height=z, x=x, y=y, z=z, heading=n / 10
        )

    def send():
        for n, fix in fixes.items():
            time.sleep(0.03)
            made("slot", n * 100_000_000, {"fix": fix})

    thread = threading.Thread(target=send)
    thread.start()
    part.reset(Stream(0, "x"))
    found, t = [], 0
    while thread.is_alive():
        time.sleep(0.01)
        found += list(part.step(t, 10_000_000, {}).values())
        t += 10_000_000
    part.close(), made.close()
    assert len(found) >= 15
    for told in found:
        fix = min(fixes.values(), key=lambda f: abs(f.heading - told.heading))
        assert abs(told.x - fix.x) < 1e-3
        assert abs(told.y - fix.y) < 1e-3
        assert abs(told.z - fix.z) < 1e-3
        assert abs(told.speed - fix.speed) < 1e-4
        assert abs(math.sin(told.course - fix.course)) < 2e-5
        assert abs(told.heading - fix.heading) < 2e-5
        assert (told.quality, told.satellites) == (4, 14)


def test_sentences_that_come_late_or_broken_are_left_out_and_told():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        port = free_port()
        part = DeviceSlot(
            Params(f"nmea+udp://127.0.0.1:{port}", antenna_m=(1.0, 0.0, 3.9)), setup("gnss", Fix, period=0.1)
        )
        rng, begun = np.random.default_rng(6), nmea.utc_of("2026-07-15T23:59:59.6Z")  # over midnight
        sent = [nmea.sentences(drawn_fix(n * 100_000_000, rng), ("GGA", "VTG"), begun, 0.0) for n in range(8)]
        order = [0, 1, 2, 4, 3, 6, 5, 7]
        stream = [sent[n] for n in order[:3]] + [b"noise\r\n", b"\xff" * 900, b"\n"]
        stream += [sent[n] for n in order[3:]]

        def send():
            time.sleep(0.2)
            for piece in stream:
                sender.sendto(piece, ("127.0.0.1", port))
                time.sleep(0.02)

        thread = threading.Thread(target=send)
        thread.start()
        found = [part.reset(Stream(0, "x"))["out"]]
        while thread.is_alive():
            time.sleep(0.005)
            found += part.step(len(found) * NS, NS, {}).values()
        part.close()
    notes = "\n".join(part.notes)
    assert "timeline: positions that came late and were left out (2)" in notes
    assert "damaged: lines that were no sentence (2)" in notes
    assert "4 samples from nmea" in notes  # the first two came before the run began


def test_a_device_s_clock_is_put_onto_the_run_s_by_the_quickest_arrival():
    clock, rng = DeviceClock(4_294_967_296_000), np.random.default_rng(5)
    at = 4_294_000_000_000  # shortly before it begins anew
    off = []
    for n in range(200):
        sent = n * 20_000_000
        late = int(rng.exponential(5e6))
        device_time = (at + round(sent * (1 + 2e-5))) % 4_294_967_296_000  # a crystal of 20 ppm
        off.append(clock.of(device_time, sent + late) - sent)
    assert max(off[50:]) - min(off[50:]) < 1e6 + DRIFT * 4e9
    assert clock.of(at + 3_600 * NS, 5 * NS) == 5 * NS  # it was set


@pytest.mark.parametrize(
    ("address", "signal", "keys", "expected"),
    [
        ("lms://", Scan, {}, "mount: expected where the scanner sits"),
        ("nmea+udp://", Fix, {}, "antenna_m: expected x, y, z of the antenna"),
        ("nmea+udp://", Scan, {"mount": Mount()}, "expected a slot that sends a Fix"),
        ("agopengps://", Fix, {}, "expected lms://, velodyne://, nmea://"),
        ("lms://?model=x", Scan, {"mount": Mount()}, "unknown"),
    ],
)
def test_what_cannot_fill_a_slot_is_refused(address, signal, keys, expected):
    with pytest.raises(InputError, match=expected):
        DeviceSlot(Params(address, **keys), setup("slot", signal))


@pytest.mark.parametrize(
    ("address", "signal", "keys"),
    [("velodyne", Scan, {"mount": Mount()}), ("nmea+udp", Fix, {"antenna_m": (1.0, 0.0, 3.9)})],
)
def test_where_it_listens_for_datagrams_a_port_in_use_is_one_error(address, signal, keys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        part = DeviceSlot(Params(f"{address}://:{port}", **keys), setup("slot", signal))
        with pytest.raises(SwathError, match=f"127.0.0.1:{port}: could not listen: the port is in use"):
            part.reset(Stream(0, "x"))


def test_a_device_that_is_not_there_is_one_error():
    part = DeviceSlot(Params("lms://127.0.0.1:1", mount=Mount(), wait_s=0.6), setup("lidar", Scan))
    with pytest.raises(
        SwathError,
        match=r"no sample from lms://127\.0\.0\.1:1 within 0\.6 s: not connected: Connection refused",
    ):
        part.reset(Stream(0, "x"))


# AgOpenGPS


@pytest.fixture
def steered():
    """The machine's side, a socket that plays AgOpenGPS, and what to step with."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as box:
        box.bind(("127.0.0.1", 0))
        box.settimeout(2.0)
        inputs = (Port("odometry", Odometry, optional=True),)
        params = agopengps.Params("127.0.0.1:18888", f"127.0.0.1:{box.getsockname()[1]}", timeout_ms=300.0)
        part = agopengps.AgOpenGpsSteering(params, setup("steer", SteerCommand, inputs=inputs))
        part.reset(Stream(0, "x"))

        def step(t, *messages):
            for message in messages:
                box.sendto(message, ("127.0.0.1", 18888))
            time.sleep(0.05 if messages else 0.0)
            seen = {"odometry": Odometry(t, 2.0, 0.0, 0.1)}
            return part.step(t, 20_000_000, seen)["command"]

        yield part, step, box
        part.close()


def told_to_steer(speed_kmh, is_on, angle_deg):
    return steer_command(angle_deg, speed_kmh=speed_kmh, is_on=is_on)


def test_pgn_254_steers_and_is_answered_by_pgn_253(steered):
    _, step, box = steered
    command = step(0, told_to_steer(7.2, True, 5.0))
    assert command.is_engaged
    wheelbase = load_machine("lexion-700-class").wheelbase
    assert command.curvature == pytest.approx(-math.tan(math.radians(5.0)) / wheelbase)
    answer = answer_of(box.recv(100))
    assert answer.angle_deg == pytest.approx(-math.degrees(0.1), abs=0.005)
    assert (answer.heading_deg, answer.roll_deg) == (None, None)
    assert not answer.is_steer_switch_high  # closed: on


def test_pgn_254_is_read_as_it_was_sent():
    told = pgn.read_steer_data(pgn.unframed(told_to_steer(7.2, True, -12.34))[2])
    assert told == pgn.SteerData(pytest.approx(2.0), True, pytest.approx(math.radians(12.34)))


def test_off_or_too_slow_or_silent_is_not_steered(steered):
    part, step, _ = steered
    assert step(0, told_to_steer(7.2, True, 5.0)).is_engaged
    assert not step(20_000_000, told_to_steer(7.2, False, 5.0)).is_engaged
    assert not step(40_000_000, told_to_steer(0.0, True, 5.0)).is_engaged
    assert step(60_000_000, told_to_steer(7.2, True, 5.0)).is_engaged
    assert step(340_000_000).is_engaged
    assert not step(400_000_000).is_engaged
    assert any("no PGN 254 for 0.34 s; the steering was released" in note for note in part.notes)
    assert step(500_000_000, told_to_steer(7.2, True, 5.0)).is_engaged


def test_a_second_box_and_garbage_do_not_steer(steered):
    part, step, _ = steered
    assert step(0, told_to_steer(7.2, True, 5.0)).is_engaged
    wrong = bytearray(told_to_steer(7.2, True, 20.0))
    wrong[13] ^= 1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(told_to_steer(7.2, True, 30.0), ("127.0.0.1", 18888))
        command = step(20_000_000, bytes(wrong), b"", b"\x80\x81" * 700)
    assert command.curvature == pytest.approx(-math.tan(math.radians(5.0)) / 3.75, rel=0.5)
    notes = "\n".join(part.notes)
    assert "3 datagrams were no message of AgOpenGPS" in notes
    assert "1 datagrams of other senders were left out" in notes


def test_a_hello_is_answered(steered):
    _, step, box = steered
    step(0, HELLO)
    assert hello_angle_of(box.recv(100)) == pytest.approx(-math.degrees(0.1), abs=0.005)


def test_a_port_in_use_is_one_error():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        part = agopengps.AgOpenGpsSteering(
            agopengps.Params(f"127.0.0.1:{port}"), setup("steer", SteerCommand)
        )
        with pytest.raises(SwathError, match="the port is in use"):
            part.reset(Stream(0, "x"))
    with pytest.raises(InputError, match="listen = elsewhere:x: expected host:port"):
        agopengps.AgOpenGpsSteering(agopengps.Params("elsewhere:x"), setup("steer", SteerCommand))
