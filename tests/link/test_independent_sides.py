"""Runs as a user starts them, served to clients that were written from the makers' descriptions alone."""

import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from collections import namedtuple
from contextlib import suppress

import numpy as np
import pyarrow.parquet as pq
import pytest

from swath.commands.main import main
from swath.record.read.feed import exact_samples, exact_topic
from swath.record.read.files import open_log
from swath.record.read.frames import own_mounting
from tests.link.device_rig import free_port
from tests.link.independent_agopengps import HELLO, answer_of, hello_angle_of, position_of, steer_command
from tests.link.independent_lms import Lms, Refused
from tests.waiting import PATIENCE_S, ended, until

ENDED = (0, 1, 3)  # a limit that fails is no matter here
SCANS = 24
OVER = b"over"  # nothing more comes
PERIOD_US = 40_000  # of 25 Hz
ORIGIN = 52.1, 10.2
FROM_MERIDIAN = math.radians(ORIGIN[1] - 9)  # of UTM zone 32
CONVERGENCE = math.atan(math.tan(FROM_MERIDIAN) * math.sin(math.radians(ORIGIN[0])))
DUAL = ("antenna.y_m=-1", "second_antenna={x_m: 1, y_m: 1, z_m: 3.9}")  # 2 m apart

Served = namedtuple("Served", "in_ascii, in_binary, polled, log")
Drive = namedtuple("Drive", "positions, answers, hellos, heard_count, track, log")


def words(out, keys, device):
    """The command line of a run that is served to a client."""
    options = (word for key in keys for word in ("--set", key))
    command = ["run", "straight", "--real-time", "--no-report", "--no-replay", "--out", str(out)]
    return [*command, *options, "--device", device]


def samples(log, slot, output):
    return [sample for _, sample in exact_samples(log.messages([exact_topic(slot, output)]))]


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """Scans in both dialects, one connection after the other, of one run."""
    out, port = tmp_path_factory.mktemp("lms") / "run", free_port()
    keys = ("run.max_duration_s=300", "combine.lidar.level=empirical")
    keys += ("combine.lidar.sector_deg=[-95,95]", "combine.edge=truth")
    with (out.parent / "out.txt").open("w") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "swath", *words(out, keys, f"lidar=lms://127.0.0.1:{port}")],
            stdout=file, stderr=subprocess.STDOUT, env=os.environ | {"SWATH_THREADS": "1"},
        )  # fmt: skip
    try:

        def scans():
            assert process.poll() is None, (out.parent / "out.txt").read_text()
            with suppress(ConnectionRefusedError):
                return ascii_client(port)

        in_ascii = until(scans, "it serves")
        in_binary, polled = binary_client(port)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 130, (out.parent / "out.txt").read_text()
        return Served(in_ascii, in_binary, polled, open_log(out))
    finally:
        process.kill()
        process.wait()


def ascii_client(port):
    """As the manual has it: wait until it measures, ask for one scan, then for all."""
    with Lms("127.0.0.1", port, is_binary=False) as lms:
        until(lambda: lms.state() == 7, "it measures")
        first = lms.one_scan()
        frequency, step, start_angle, stop_angle = lms.scan_config()
        assert (frequency, step) == (2500, 5000)
        assert lms.output_range() == (step, start_angle, stop_angle) == (5000, -50_000, 1_850_000)
        name, version = lms.identity()
        assert name == "LMS5xx_FieldEval_PRO", "as an LMS511 does, whatever its reach is set to"
        assert version
        with pytest.raises(Refused, match="sFA 3"):
            lms.ask("sRN Nonsense")
        with pytest.raises(Refused):
            lms.data_config(rssi_bits=8)  # nobody has logged in
        lms.login()
        lms.data_config(rssi_bits=8)
        lms.first_echo()
        assert lms.scan_config(lms.scan_config()) == (frequency, step, start_angle, stop_angle)
        lms.run()
        lms.stream(is_on=True)
        scans = [lms.scan() for _ in range(SCANS)]
        lms.stream(is_on=False)
        assert first.scans <= scans[0].scans
        return scans


def binary_client(port):
    with Lms("127.0.0.1", port, is_binary=True) as lms:
        lms.login()
        lms.data_config(rssi_bits=16)
        lms.first_echo()
        lms.output_range((5000, 300_000, 1_350_000))
        assert lms.output_range() == (5000, 300_000, 1_350_000)
        lms.run()
        lms.stream(is_on=True)
        scans = [lms.scan() for _ in range(SCANS)]
        lms.stream(is_on=False)
        polled = lms.one_scan()
    with Lms("127.0.0.1", port, is_binary=True) as lms:
        assert lms.output_range() == (5000, 300_000, 1_350_000), "what is set stays"
    return scans, polled


@pytest.mark.parametrize("dialect", ["in_ascii", "in_binary"])
def test_scans_of_an_lms_are_those_recorded(served, dialect):
    scans = getattr(served, dialect)
    recorded = samples(served.log, "combine.lidar", "scan")
    begins_us = np.array([(sample.t * 1e-9 + sample.beam_t[0]) * 1e6 for sample in recorded])
    missing, shifts = 0, set()
    for scan in (*scans, served.polled) if dialect == "in_binary" else scans:
        dist = scan.channels16["DIST1"]
        i = int(np.argmin(np.abs(begins_us - scan.since_start)))
        shifts.add(i - scan.scans)
        assert begins_us[i] - PERIOD_US < scan.since_start <= begins_us[i] + 1
        assert recorded[i].t // 1000 <= scan.sent < recorded[i].t // 1000 + PERIOD_US

        angles = 90 + np.degrees(recorded[i].azimuth)  # 90 deg is ahead, counter-clockwise from above
        stop = dist.start + (len(dist.data) - 0.5) * dist.step
        kept = (angles > dist.start / 1e4 - 1e-6) & (angles < stop / 1e4)
        assert kept.sum() == len(dist.data)
        served_angles = (dist.start + dist.step * np.arange(len(dist.data))) / 1e4
        assert np.abs(served_angles - angles[kept]).max() < 0.5e-4

        ranges = recorded[i].ranges[kept, 0].astype(float)
        raw = np.array(dist.data)
        assert np.array_equal(raw == 0, np.isnan(ranges))
        assert raw[raw > 0].min() >= 16, "1 to 15 mean something else"
        off = np.abs(raw * dist.scale / 1000 - ranges)[raw > 0]
        assert off.max() < 1e-3 + 4e-6  # what float32 adds
        missing += int((raw == 0).sum())

        rssi = (scan.channels8 if dialect == "in_ascii" else scan.channels16)["RSSI1"]
        assert (rssi.start, rssi.step, len(rssi.data)) == (dist.start, dist.step, len(dist.data))
        strength = np.array(rssi.data)
        assert np.array_equal(strength > 0, raw > 0), "a valid distance has an RSSI of at least 1"
        intensity = recorded[i].intensity[kept, 0][raw > 0]
        assert (np.diff(strength[raw > 0][np.argsort(intensity, kind="stable")]) >= 0).all()
        assert (scan.status, scan.scan_hz) == ((0, 0), 25)
        assert scan.shots_hz == 25 * 360 / 0.5
        assert scan.time is None
    assert len(shifts) == 1, "scan counters count scans"
    assert missing > 0 or dialect == "in_binary", "a sector of 190 deg sees the sky"
    assert {scan.kind for scan in scans} == {"sSN"}
    assert [scan.telegrams - scans[0].telegrams for scan in scans] == list(range(len(scans)))
    assert (np.diff([scan.scans for scan in scans]) >= 1).all()


@pytest.fixture(scope="module", params=["PANDA", "PAOGI"])
def drive(request, tmp_path_factory):
    """Of one antenna to the right, of two to the left."""
    out = tmp_path_factory.mktemp(request.param) / "run"
    angle_deg = 5 if request.param == "PANDA" else -5
    positions, answers, hellos = [], [], []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as agio:
        agio.bind(("127.0.0.1", 0))
        agio.settimeout(PATIENCE_S)
        port, module = agio.getsockname()[1], free_port(socket.SOCK_DGRAM)

        def play():
            while True:
                datagram = agio.recv(2048)
                if datagram == OVER:
                    return
                if datagram[:1] == b"$":
                    positions.append(position_of(datagram))
                    if len(positions) % 10 == 1:
                        agio.sendto(HELLO, ("127.0.0.1", module))
                    wanted = steer_command(angle_deg, speed_kmh=positions[-1].speed_kmh, is_on=True)
                    agio.sendto(wanted, ("127.0.0.1", module))
                elif datagram[3] == 126:
                    hellos.append(hello_angle_of(datagram))
                else:
                    answers.append(answer_of(datagram))

        keys = [f"field.origin.latitude_deg={ORIGIN[0]}", f"field.origin.longitude_deg={ORIGIN[1]}"]
        steer = f"{{level: agopengps, listen: '127.0.0.1:{module}', reply: '127.0.0.1:{port}'}}"
        dual = DUAL if request.param == "PAOGI" else ()
        keys += [
            "run.max_duration_s=6",
            "field.terrain.slope_percent=8",
            "field.terrain.slope_azimuth_deg=90",
        ]
        keys += ["combine.lidar=off", "combine.edge=truth", "realtime.spin_ms=0"]
        keys += [f"combine.steer={steer}", *(f"combine.gnss.{key}" for key in dual)]
        agopengps = threading.Thread(target=play)
        agopengps.start()
        try:
            assert main([*words(out, keys, f"gnss=agopengps://127.0.0.1:{port}"), "--quiet"]) in ENDED
        finally:
            agio.sendto(OVER, ("127.0.0.1", port))
            ended(agopengps)
    notes = " ".join(json.loads((out / "summary.json").read_text())["notes"])
    heard_count = int(re.search(r"(\d+) messages PGN 254", notes).group(1))
    table = pq.read_table(out / "tracks.parquet")
    track = {name: table[name].to_numpy() for name in table.schema.names if name != "machine"}
    return request.param, angle_deg, Drive(positions, answers, hellos, heard_count, track, open_log(out))


def place_of(position):
    """East, north [m] of the origin in the grid of UTM, by radii, scale and convergence there."""
    latitude = math.radians(ORIGIN[0])
    a, e2 = 6378137.0, 0.00669437999014
    w = 1 - e2 * math.sin(latitude) ** 2
    across, along = a / math.sqrt(w) * math.cos(latitude), a * (1 - e2) / w**1.5
    scale = 0.9996 * (1 + (FROM_MERIDIAN * math.cos(latitude)) ** 2 / 2)
    east = scale * math.radians(position.longitude - ORIGIN[1]) * across
    north = scale * math.radians(position.latitude - ORIGIN[0]) * along
    c, s = math.cos(CONVERGENCE), math.sin(CONVERGENCE)
    return np.array((c * east - s * north, s * east + c * north))


def test_agopengps_reads_where_the_antenna_is(drive):
    kind, _, seen = drive
    fixes = {fix.t: fix for fix in samples(seen.log, "combine.gnss", "fix")}
    antenna = own_mounting(seen.log, "combine.gnss").position
    times = zip(seen.positions, sorted(fixes)[1:], strict=False)  # at 0 there is none
    day_s = {round(position.time_s - t * 1e-9, 3) for position, t in times}
    assert len(day_s) == 1, "the clock of the sentences goes as that of the samples"
    leans = []
    for position in seen.positions:
        fix = fixes[round((position.time_s - next(iter(day_s))) * 1000) * 1_000_000]
        t = fix.t * 1e-9
        x, y, yaw, pitch, roll, speed = (
            np.interp(t, seen.track["t_s"], seen.track[name])
            for name in ("x_m", "y_m", "yaw_rad", "pitch_rad", "roll_rad", "speed_m_s")
        )
        ahead = antenna[0] * math.cos(pitch) + antenna[2] * math.sin(pitch)
        left = antenna[1] * math.cos(roll) - antenna[2] * math.sin(roll)
        c, s = math.cos(yaw), math.sin(yaw)
        truth = x + ahead * c - left * s, y + ahead * s + left * c

        assert position.kind == kind
        assert np.linalg.norm(place_of(position) - (fix.x, fix.y)) < 1e-3
        assert np.linalg.norm(place_of(position) - truth) < 0.02 + 3 * fix.horizontal_sd
        assert abs(position.altitude - fix.height) < 1e-3
        assert position.quality == 4
        assert position.satellites >= 4
        assert abs(position.speed_kmh / 3.6 - fix.speed) < 1e-3
        assert abs(position.speed_kmh / 3.6 - speed) < 0.15
        if kind == "PAOGI":
            off = (position.heading - (90 + math.degrees(CONVERGENCE - yaw)) + 180) % 360 - 180
            assert abs(off) < 0.5, "clockwise from true north"
            leans.append((position.roll, math.degrees(roll)))
        else:
            assert position.heading is None, "it has no IMU"
    if kind == "PAOGI":
        told, true = np.transpose(leans)
        assert abs(true.mean()) > 4, "it drives along a side slope of 8 %"
        assert abs(told.mean() - true.mean()) < 0.1, "> 0 right side down"
        assert np.abs(told - true).max() < 1.2, "5 sd of two antennas 2 m apart"
    times = np.array([position.time_s for position in seen.positions])
    assert np.diff(times).min() > 0.070, "AgOpenGPS drops what comes within 70 ms"
    assert len(times) >= 50


def test_agopengps_steers_and_hears_the_angle(drive):
    _, angle_deg, seen = drive
    assert len(seen.answers) == seen.heard_count > 40, "every PGN 254 is answered"
    assert len(seen.hellos) >= 3, "else AgIO shows the module as lost"
    heading = np.degrees(seen.track["yaw_rad"])
    turned = heading[-1] - heading[0]
    assert turned * -np.sign(angle_deg) > 2, "> 0 turns right"
    last = seen.answers[-1]
    recorded = samples(seen.log, "combine.odometry", "odometry")[-50:]
    off = [abs(last.angle_deg + math.degrees(sample.steer_angle)) for sample in recorded]
    assert min(off) < 0.006, "of its own sensor, > 0 to the right"
    assert abs(last.angle_deg - angle_deg) < 0.5
    assert not last.is_steer_switch_high, "it steers"
