"""Level `device`: what a sensor sends fills a slot; and level `agopengps`: what AgOpenGPS sends steers."""

import math
import re
import socket
import threading
from contextlib import contextmanager
from dataclasses import replace
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
from swath.link.levels.device import DRIFT, DeviceClock, DeviceSlot, Params, _NmeaStream
from swath.machine.machine_sheet import load_machine
from swath.sensing.mount import Mount
from swath.signals import Fix, Odometry, Scan, SteerCommand
from swath.signals.setup import ControlSetup, LinkSetup
from tests.link.device_rig import STEP, device, drawn_fix, free_port, heard_by, plane_scan
from tests.link.independent_agopengps import HELLO, answer_of, hello_angle_of, steer_command
from tests.link.test_device_velodyne import PERIOD, turn
from tests.waiting import PATIENCE_S, ended, until

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


@contextmanager
def first_sample(part):
    """The slot waits for its first sample, which is to be sent meanwhile; it is in the list afterwards."""
    found = []
    waiting = threading.Thread(target=lambda: found.append(part.reset(Stream(0, "x"))["out"]))
    waiting.start()
    until(lambda: part._reader is not None, "it listens")
    yield found
    ended(waiting)


def newest(part, t):
    """What comes at t [ns] of the run, or has come."""
    return until(lambda: part.step(t - STEP, STEP, {}), "a sample")["out"]


@pytest.mark.parametrize("dialect", ["a", "b"])
def test_a_slot_filled_by_an_lms_has_its_scans(dialect):
    made, rng = device("lms://127.0.0.1:0", Scan), np.random.default_rng(1)
    scans = {n: plane_scan(n * STEP, rng) for n in range(30)}
    made("slot", 0, {"scan": scans[0]})
    part = DeviceSlot(
        Params(f"lms://127.0.0.1:{made.port}?cola={dialect}", mount=Mount(), wait_s=PATIENCE_S),
        setup("lidar", Scan),
    )
    with first_sample(part) as first:
        until(made._is_met, "it asks for scans")
        made("slot", STEP, {"scan": scans[1]})
    assert first[0].t == 0
    begun = 2 * round(PATIENCE_S) * NS  # what has waited since its arrival came after the start
    for n in range(2, 30):
        made("slot", n * STEP, {"scan": scans[n]})
        scan = newest(part, begun + n * STEP)
        assert 0 < scan.t <= begun + n * STEP
        told, sent = (np.nan_to_num(each.ranges) for each in (scan, scans[n]))
        np.testing.assert_allclose(told, sent, atol=6e-4)
        np.testing.assert_allclose(scan.azimuth, scans[n].azimuth, atol=lms.TICK)
        np.testing.assert_allclose(scan.beam_t, scans[n].beam_t, atol=2e-6)
        np.testing.assert_allclose(scan.intensity, scans[n].intensity, atol=1e-4)
    part.close(), made.close()


def lms_bytes(counter, rng, t=None):
    scan = plane_scan((counter if t is None else t) * STEP, rng, count=11)
    plane = lms.plane_of(scan, "LMS1xx", 0.04, 40.0)
    return cola.telegram(
        "sSN", "LMDscandata", lms.scan_items(plane, scan, counter, lms.Wanted()), binary=True
    )


def test_lost_late_and_broken_telegrams_are_told_and_the_last_scan_counts(monkeypatch):
    rng, heard = np.random.default_rng(2), heard_by(monkeypatch)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"lms://127.0.0.1:{server.getsockname()[1]}"
        part = DeviceSlot(Params(address, mount=Mount(), wait_s=PATIENCE_S), setup("lidar", Scan))
        with first_sample(part):
            connection, _ = server.accept()
            connection.sendall(lms_bytes(65_534, rng, 1))
        broken = bytearray(lms_bytes(65_535, rng, 2))
        broken[40] ^= 1
        heard.clear()
        sent = bytes(broken) + lms_bytes(0, rng, 3) + lms_bytes(3, rng, 4) + lms_bytes(2, rng, 5)
        sent += b"noise" + cola.telegram("sFA", "", binary=True) + lms_bytes(4, rng, 6)
        connection.sendall(sent)
        until(lambda: b"".join(heard) == sent, "all has come")
        out = part.step(0, STEP, {})["out"]
        assert len(out.ranges) == 11
        told = len(part._events.list)
        connection.close()
        until(lambda: len(part._events.list) > told, "the end of the connection is told")
        assert part.step(STEP, NS, {}) == {}
        part.close()
    notes = "\n".join(part.notes)
    assert "3 scans were lost" in notes  # 65535, which was broken, 1 and 2
    assert "1 scans came late and were left out" in notes
    assert "bytes were no telegram" in notes
    assert "the connection broke off" in notes or "has closed the connection" in notes
    assert "no sample for 1000 ms" in notes


def test_a_slot_filled_by_a_velodyne_has_its_turns(monkeypatch):
    rng, heard, port = np.random.default_rng(3), heard_by(monkeypatch), free_port(socket.SOCK_DGRAM)
    address = f"velodyne://127.0.0.1:{port}"
    part = DeviceSlot(Params(address, mount=Mount(), wait_s=PATIENCE_S), setup("lidar", Scan, period=PERIOD))
    scans = [turn(n * 100_000_000, rng) for n in (1, 2)]
    packets = [packet for scan in scans for packet in velodyne.packets(scan, velodyne.grid_of(scan))]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender, first_sample(part) as first:
        for n, packet in enumerate(packets, 1):
            sender.sendto(packet, ("127.0.0.1", port))
            if n % 20 == 0:  # no more than fit into the buffer of a socket
                until(lambda n=n: len(heard) == n, "they have come")
    part.close()
    (scan,) = first
    assert len(scan.ranges) == 28_800
    assert np.isnan(scan.ranges).mean() == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("transport", ["tcp", "udp", "pty"])
def test_a_slot_filled_by_a_receiver_has_its_fixes(transport, tmp_path):
    kind = socket.SOCK_DGRAM if transport == "udp" else socket.SOCK_STREAM
    where = str(tmp_path / "gnss") if transport == "pty" else f"127.0.0.1:{free_port(kind)}"
    address = f"nmea+{transport}://{where}"
    with allow_code((), addresses=[address]):
        made = device(address, Fix, origin=ORIGIN, period=0.1)
        params = Params(address, antenna_m=(1.0, 0.0, 3.9), wait_s=PATIENCE_S)
        part = DeviceSlot(params, setup("gnss", Fix, period=0.1))
    fixes = {}
    rng = np.random.default_rng(4)
    for n in range(1, 30):
        x, y = rng.uniform(-300, 300, 2)
        (lon, lat), z = np.radians(ORIGIN.to_lon_lat([[x, y]])[0]), rng.uniform(50, 90)
        fixes[n] = drawn_fix(
            n * 100_000_000, rng, longitude=lon, latitude=lat, height=z, x=x, y=y, z=z, heading=n / 10
        )

    def send(n):
        made("slot", n * 100_000_000, {"fix": fixes[n]})

    with first_sample(part):
        until(made._is_met, "it is connected")
        send(1)
        send(2)
    for n in range(3, 30):
        send(n)
        fix = fixes[n]
        told = until(lambda fix=fix: with_heading(part, fix.t, fix.heading), "the fix")
        assert abs(told.x - fix.x) < 1e-3
        assert abs(told.y - fix.y) < 1e-3
        assert abs(told.z - fix.z) < 1e-3
        assert abs(told.speed - fix.speed) < 1e-4
        assert abs(math.sin(told.course - fix.course)) < 2e-5
        assert (told.quality, told.satellites) == (4, 14)
    part.close(), made.close()


def with_heading(part, t, heading):
    """The fix that comes at t [ns] of the run where it has this heading [rad]."""
    told = part.step(t - STEP, STEP, {}).get("out")
    return told if told is not None and abs(told.heading - heading) < 2e-5 else None


def test_sentences_that_come_late_or_broken_are_left_out_and_told(monkeypatch):
    port, heard = free_port(socket.SOCK_DGRAM), heard_by(monkeypatch)
    params = Params(f"nmea+udp://127.0.0.1:{port}", antenna_m=(1.0, 0.0, 3.9), wait_s=PATIENCE_S)
    part = DeviceSlot(params, setup("gnss", Fix, period=0.1))
    rng, begun = np.random.default_rng(6), nmea.utc_of("2026-07-15T23:59:59.6Z")  # over midnight
    sent = [nmea.sentences(drawn_fix(n * 100_000_000, rng), ("GGA", "VTG"), begun, 0.0) for n in range(8)]
    broken = [b"noise\r\n", b"\xff" * 900, b"\n"]
    stream = [sent[2], *broken, *(sent[n] for n in (4, 3, 6, 5, 7))]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        with first_sample(part):
            for piece in sent[:2]:
                sender.sendto(piece, ("127.0.0.1", port))
        for piece in stream:
            sender.sendto(piece, ("127.0.0.1", port))
        until(lambda: len(heard) == 2 + len(stream), "all has come")
    assert part.step(0, NS, {})
    part.close()
    notes = "\n".join(part.notes)
    assert "timeline: positions that came late and were left out (2)" in notes
    assert "damaged: lines that were no sentence (2)" in notes
    assert "4 samples from nmea" in notes  # the first two came before the run began


def test_fixes_that_no_machine_reaches_are_told_at_the_door_and_stay_as_they_are():
    stream = _NmeaStream(None, setup("gnss", Fix))
    begun, lats = nmea.utc_of(nmea.BEGUN), []
    for k in range(60):
        lats.append(math.radians(52.0 + 1e-6 * k + (k % 10 == 5) / 60.0))
        fix = replace(drawn_fix(0, np.random.default_rng(1)), t=k * NS // 10, latitude=lats[-1],
                      longitude=math.radians(10.9), height=80.0, quality=4, speed=1.1)  # fmt: skip
        for made in stream.feed(nmea.sentences(fix, ("GGA", "VTG"), begun, 0.0), fix.t):
            assert min(abs(lat - made.latitude) for lat in lats) < 1e-10
    (told,) = [note for note in stream.notes if note.startswith("place:")]
    assert re.match(r"place: positions that lie up to 1,85\d\.\d m farther .*\(6\)$", told)


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
def steered(monkeypatch):
    """The machine's side, a socket that plays AgOpenGPS, and what to step with."""
    heard, port = heard_by(monkeypatch), free_port(socket.SOCK_DGRAM)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as box:
        box.bind(("127.0.0.1", 0))
        box.settimeout(PATIENCE_S)
        inputs = (Port("odometry", Odometry, optional=True),)
        params = agopengps.Params(f"127.0.0.1:{port}", f"127.0.0.1:{box.getsockname()[1]}", timeout_ms=300.0)
        part = agopengps.AgOpenGpsSteering(params, setup("steer", SteerCommand, inputs=inputs))
        part.reset(Stream(0, "x"))

        def step(t, *messages):
            heard.clear()
            for message in messages:
                box.sendto(message, ("127.0.0.1", port))
            until(lambda: all(message in heard for message in messages), "they have come")
            seen = {"odometry": Odometry(t, 2.0, 0.0, 0.1)}
            return part.step(t, 20_000_000, seen)["command"]

        yield part, step, box, port
        part.close()


def told_to_steer(speed_kmh, is_on, angle_deg):
    return steer_command(angle_deg, speed_kmh=speed_kmh, is_on=is_on)


def test_pgn_254_steers_and_is_answered_by_pgn_253(steered):
    _, step, box, _ = steered
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
    part, step, *_ = steered
    assert step(0, told_to_steer(7.2, True, 5.0)).is_engaged
    assert not step(20_000_000, told_to_steer(7.2, False, 5.0)).is_engaged
    assert not step(40_000_000, told_to_steer(0.0, True, 5.0)).is_engaged
    assert step(60_000_000, told_to_steer(7.2, True, 5.0)).is_engaged
    assert step(340_000_000).is_engaged
    assert not step(400_000_000).is_engaged
    assert any("no PGN 254 for 0.34 s; the steering was released" in note for note in part.notes)
    assert step(500_000_000, told_to_steer(7.2, True, 5.0)).is_engaged


def test_a_second_box_and_garbage_do_not_steer(steered):
    part, step, _, port = steered
    assert step(0, told_to_steer(7.2, True, 5.0)).is_engaged
    wrong = bytearray(told_to_steer(7.2, True, 20.0))
    wrong[13] ^= 1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(told_to_steer(7.2, True, 30.0), ("127.0.0.1", port))
        command = step(20_000_000, bytes(wrong), b"", b"\x80\x81" * 700)
    assert command.curvature == pytest.approx(-math.tan(math.radians(5.0)) / 3.75, rel=0.5)
    notes = "\n".join(part.notes)
    assert "3 datagrams were no message of AgOpenGPS" in notes
    assert "1 datagrams of other senders were left out" in notes


def test_a_hello_is_answered(steered):
    _, step, box, _ = steered
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
