"""A slot as a Velodyne VLP-16: what velodyne-decoder makes of its packets; loss, reordering, garbage."""

import re
import socket
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.schedule import NS
from swath.link.device import velodyne
from swath.record.read.files import open_log
from swath.record.read.scans import cloud_table
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario
from swath.sensing.mount import Mount
from swath.sensing.scanner import Scanner, ScannerParams
from swath.signals import Scan
from swath.signals.scan import beam_directions
from tests.link.device_rig import device, plane_scan
from tests.waiting import PATIENCE_S

PERIOD = 0.1
FIRES = [-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15]  # VLP-16 manual, chapter 9


def turn(t, rng, *, first=-180.0, last=179.8, step=0.2, period=PERIOD):
    """A drawn turn of the VLP-16 of the data sheet, in swath's own order: azimuths rise, lines within."""
    azimuth = np.radians(np.arange(first, last + 0.1, step))
    lines = np.arange(-15.0, 16.0, 2.0)
    fires = np.array([FIRES.index(line) for line in lines]) * 2.304e-6  # after the first of its firing [s]
    late = np.tile(fires, len(azimuth))
    azimuth, elevation = np.repeat(azimuth, 16), np.radians(np.tile(lines, len(azimuth)))
    beam_t = (azimuth[0] - azimuth) / (2 * np.pi) * period - (late.max() - late)
    azimuth = azimuth - late / period * 2 * np.pi
    ranges = rng.uniform(1.0, 100.0, (len(azimuth), 1)).astype(np.float32)
    ranges[rng.uniform(size=ranges.shape) < 0.2] = np.nan
    intensity = np.where(np.isnan(ranges), np.nan, rng.uniform(0, 1, ranges.shape)).astype(np.float32)
    return Scan(t, beam_t, azimuth, elevation, ranges, intensity)


def nearest_in_range_and_line(points, wanted):
    """For each point the one of the same line and within 2 mm of range that points most alike [rad]."""
    ranges, found = np.linalg.norm(points, axis=1), np.full(len(points), np.pi)
    lines = np.round(np.degrees(np.arcsin(points[:, 2] / ranges)))
    want_r = np.linalg.norm(wanted, axis=1)
    want_lines = np.round(np.degrees(np.arcsin(wanted[:, 2] / want_r)))
    azimuth, want_a = np.arctan2(points[:, 1], points[:, 0]), np.arctan2(wanted[:, 1], wanted[:, 0])
    for line in np.unique(want_lines):
        mine, theirs = np.flatnonzero(lines == line), np.flatnonzero(want_lines == line)
        near = np.abs(ranges[mine][:, None] - want_r[theirs]) <= 0.5 * velodyne.UNIT + 1e-4
        apart = np.abs((azimuth[mine][:, None] - want_a[theirs] + np.pi) % (2 * np.pi) - np.pi)
        found[mine] = np.where(near, apart, np.pi).min(axis=1)
    return found


def decoded(packets):
    """Points of packets by velodyne-decoder [m], (n, 3).

    In swath all lines start at one point; in the sensor they lie up to 11 mm above or below it.
    """
    decoder = pytest.importorskip("velodyne_decoder")
    text = decoder.get_bundled_calibration("VLP-16.yml").to_string()
    text = re.sub(r"vert_offset_correction: [-0-9.e]+", "vert_offset_correction: 0.0", text)
    config = decoder.Config(model=decoder.Model.VLP16, cut_angle=None, min_range=0.0, max_range=200.0)
    config.calibration = decoder.Calibration.from_string(text)
    _, cloud = decoder.ScanDecoder(config).decode([decoder.VelodynePacket(0.0, p) for p in packets])
    return np.asarray(cloud)[:, :3].astype(float)


def scan_of_the_sheet(rate_hz, **params):
    """A scan of the bundled sensor as its level makes it, drawn ranges."""
    setup = SimpleNamespace(period=1.0 / rate_hz, base=None, machine=None, edge_side="left", field=None)
    mount = Mount(at="axle", z_m=3.0)
    scanner = Scanner(ScannerParams(sensor="velodyne-vlp16", mount=mount, **params), setup)
    rng, shape = np.random.default_rng(8), (len(scanner.azimuth), 1)
    ranges = rng.uniform(1.0, 100.0, shape).astype(np.float32)
    intensity = rng.uniform(0.0, 1.0, shape).astype(np.float32)
    return Scan(5 * NS, scanner.beam_t, scanner.azimuth, scanner.elevation, ranges, intensity)


@pytest.mark.parametrize(
    "make",
    [
        lambda: turn(3_600_000_000_000 + 123_456_000, np.random.default_rng(1)),
        lambda: scan_of_the_sheet(10.0),
        lambda: scan_of_the_sheet(10.0, sector_deg=(-50.0, 50.13)),
        lambda: scan_of_the_sheet(10.0, sector_deg=(-60.0, 60.0), step_deg=0.4),  # every other firing
        lambda: scan_of_the_sheet(5.0, sector_deg=(-60.0, 60.0)),  # as well
        lambda: scan_of_the_sheet(20.0, step_deg=0.4),
    ],
)
def test_velodyne_decoder_gives_the_points_of_the_scan(make):
    scan = make()
    points = decoded(velodyne.packets(scan, velodyne.grid_of(scan)))
    wanted = scan.points()[:, 0][np.isfinite(scan.ranges[:, 0])]
    assert len(points) == len(wanted)
    apart = np.degrees(nearest_in_range_and_line(points, wanted))
    print(f"directions within {apart.max():.4f} deg, ranges within {500 * velodyne.UNIT:g} mm")
    assert apart.max() <= 0.01 + 2e-3  # half a hundredth in the packet, half in the decoder


def test_velodyne_decoder_gives_the_points_of_the_recording(tmp_path):
    """A run as a user starts it: what went out of it beside what run.mcap has."""
    mount = "{at: axle, x_m: 2, z_m: 3.8, pitch_deg: 20}"
    lidar = (
        f"{{level: empirical, sensor: velodyne-vlp16, rate_hz: 10, sector_deg: [-20, 20], mount: {mount}}}"
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.bind(("127.0.0.1", 0))
        heard.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        address = f"velodyne://127.0.0.1:{heard.getsockname()[1]}"
        sets = [f"combine.lidar={lidar}", f"combine.lidar.device={address}", "combine.edge=truth"]
        sets += ["realtime.pace=real_time", "run.max_duration_s=0.85", "run.record=full", "expect={}"]
        run_job(load_scenario("straight", sets=sets), tmp_path / "run")
        heard.setblocking(False)
        packets = [heard.recv(2000) for _ in range(8 * 9)]  # 201 firings each
    clouds = open_log(tmp_path / "run").messages(["/combine/lidar/scan_points"])
    scans = 0
    for _, t, message in clouds:
        table = cloud_table(message)
        if len(table):
            first = 9 * (round(t * 1e-8) - 1)
            points = decoded(packets[first : first + 9])
            wanted = np.stack([table[axis] for axis in "xyz"], axis=1).astype(float)
            assert len(points) == len(wanted)
            assert np.degrees(nearest_in_range_and_line(points, wanted)).max() <= 0.01
            scans += 1
    assert scans >= 4


def test_read_again_every_range_and_time_is_the_scan_s():
    scan = turn(123_456_000, np.random.default_rng(2))
    turns, later = velodyne.Turns(), turn(223_456_000, np.random.default_rng(3))
    found = []
    for one in (scan, later):
        found += [turns.feed(packet, PERIOD) for packet in velodyne.packets(one, velodyne.grid_of(one))]
    found = [whole for whole in found if whole is not None]
    assert (turns.lost, turns.late, turns.wrong) == (0, 0, 0)
    (told, end) = found[0]
    assert abs(end - scan.t // 1000) < 200  # us
    order = velodyne.grid_of(scan).order
    np.testing.assert_allclose(
        told.ranges[:, 0], scan.ranges[order.ravel(), 0], atol=0.5 * velodyne.UNIT + 1e-4
    )
    apart = beam_directions(told.azimuth, told.elevation) - beam_directions(
        scan.azimuth[order.ravel()], scan.elevation[order.ravel()]
    )
    assert np.linalg.norm(apart, axis=1).max() < np.radians(0.012)
    np.testing.assert_allclose(told.beam_t, scan.beam_t[order.ravel()], atol=3e-4)


def test_loss_reordering_and_garbage_are_counted_and_the_next_turn_is_whole():
    rng, turns, found = np.random.default_rng(4), velodyne.Turns(), []
    for n in range(4):
        scan = turn(round(n * PERIOD * 1e9), rng)
        packets = velodyne.packets(scan, velodyne.grid_of(scan))
        if n == 1:
            del packets[10:13]
            packets[20], packets[21] = packets[21], packets[20]
            packets.insert(30, b"\xff\xee" + bytes(1204))
            packets.insert(31, b"hello")
        found += [whole for packet in packets if (whole := turns.feed(packet, PERIOD)) is not None]
    assert (turns.lost, turns.late, turns.wrong) == (4, 1, 2)  # the late one is lost as well
    assert [len(scan.ranges) for scan, _ in found] == [28_800, 28_800 - 4 * 24 * 16, 28_800]


def test_packets_go_out_over_udp_at_each_scan():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.bind(("127.0.0.1", 0))
        heard.settimeout(PATIENCE_S)
        made, rng = (
            device(f"velodyne://127.0.0.1:{heard.getsockname()[1]}", Scan, period=0.1),
            np.random.default_rng(5),
        )
        scan = turn(0, rng, first=-30, last=30)
        made("combine.slot", 0, {"scan": scan})
        made("combine.slot", 100_000_000, {"scan": turn(100_000_000, rng, first=-30, last=30)})
        sizes = [len(heard.recv(2000)) for _ in range(13)]  # 301 firings
        assert sizes == [velodyne.SIZE] * 13
        assert (made.sample_count, made.sent_count) == (1, 1)
        made.close()


def test_another_scanner_is_refused():
    made = device("velodyne://127.0.0.1:2368", Scan)
    with pytest.raises(InputError, match="16 lines of a VLP-16"):
        made("combine.slot", 0, {"scan": plane_scan(0, np.random.default_rng(6))})
    left = turn(0, np.random.default_rng(7))
    left = Scan(0, left.beam_t[::-1].copy(), left.azimuth, left.elevation, left.ranges, left.intensity)
    with pytest.raises(InputError, match="turns to the right"):
        made("combine.slot", 0, {"scan": left})
    at_once = turn(0, np.random.default_rng(7))
    at_once = replace(at_once, azimuth=np.repeat(at_once.azimuth[::16], 16))
    with pytest.raises(InputError, match=r"fire one after another, 2\.304 us apart.*scan\.line_delay_us"):
        made("combine.slot", 0, {"scan": at_once})
    with pytest.raises(InputError, match=r"at 10 Hz a VLP-16 fires every 0\.2 deg: expected step_deg"):
        made("combine.slot", 0, {"scan": turn(0, np.random.default_rng(7), step=0.3)})
    made.close()
