"""Velodyne VLP-16: its data packets, written and read.

A packet is 12 blocks of two firings of 16 lines, 1,206 bytes in one datagram: per block FF EE, azimuth
(1/100 deg, clockwise), 32 times distance (2 mm) and reflectivity; then the time past the hour [us], return
mode and product. The block's azimuth is that of its first firing; the second stands half way to the next
block's. Source: Velodyne, VLP-16 User Manual 63-9243 rev. E, chapter 9; velodyne_decoder
(github.com/valgur/velodyne_decoder) reads it alike.
"""

from dataclasses import dataclass

import numpy as np

from swath.core.errors import InputError
from swath.core.units import DEG
from swath.signals import Scan

PORT = 2368
SIZE = 1206
BLOCKS, LINES = 12, 16
ELEVATION = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)  # of the lines as they fire [deg]
STRONGEST, VLP16 = 0x37, 0x22
UNIT = 0.002  # m
HUNDREDTH = 0.01 * DEG
HOUR = 3_600_000_000  # us
LINE_S, FIRING_S = 2.304e-6, 55.296e-6  # from a line to the next, from a firing to the next
UNEVEN = 0.01  # what the time between firings may be off: 0.001 deg in the direction of the last line
WHITE = 100.0  # reflectivity of a white diffuse target; above it are reflectors

RETURN = np.dtype([("distance", "<u2"), ("reflectivity", "u1")])
BLOCK = np.dtype([("flag", ">u2"), ("azimuth", "<u2"), ("returns", RETURN, (2, LINES))])
PACKET = np.dtype([("blocks", BLOCK, (BLOCKS,)), ("time", "<u4"), ("mode", "u1"), ("product", "u1")])


@dataclass
class Grid:
    """How the beams of a scan lie: order: of beams, (firing_count, LINES), in the order of the packets, whose
    azimuth grows; azimuth: of the first lines, clockwise [1/100 deg]; beam_t: of them [s]; every: firings of
    the sensor from one of the scan to the next, those between are reported without returns.
    """

    order: np.ndarray
    azimuth: np.ndarray
    beam_t: np.ndarray
    every: int


def grid_of(scan: Scan) -> Grid:
    """InputError where the beams are not those of a VLP-16 that turns to the right."""
    lines = np.round(scan.elevation / DEG, 3)
    column = np.argsort(np.argsort(ELEVATION, kind="stable"), kind="stable")
    by_line = [np.flatnonzero(lines == e) for e in sorted(ELEVATION)]
    counts = {len(beams) for beams in by_line}
    if len(counts) != 1 or not counts.pop() or len(lines) != LINES * len(by_line[0]):
        raise InputError("device", "velodyne", "expected the 16 lines of a VLP-16 (sensor: velodyne-vlp16)")
    beams = np.stack(by_line, axis=1)[:, column]
    beams = beams[np.argsort(-scan.azimuth[beams[:, 0]], kind="stable")]
    azimuth, beam_t = -scan.azimuth[beams], scan.beam_t[beams]
    turned, took = azimuth[-1, 0] - azimuth[0, 0], beam_t[-1, 0] - beam_t[0, 0]
    if took < 0.0:
        raise InputError(
            "device", "velodyne", "expected a scanner that turns to the right, as the VLP-16 does"
        )
    rate = turned / took if took > 0.0 else 0.0
    delay = np.arange(LINES) * LINE_S
    is_right = np.abs(beam_t - beam_t[:, :1] - delay).max() < 0.1 * LINE_S
    if not is_right or np.abs(azimuth - azimuth[:, :1] - rate * delay).max() > 0.2 * HUNDREDTH:
        expected = f"expected lines that fire one after another, {LINE_S * 1e6:g} us apart, in its order"
        raise InputError("device", "velodyne", f"{expected} (scan.line_delay_us of the sensor's sheet)")
    apart = took / max(len(beams) - 1, 1) / FIRING_S
    every = max(round(apart), 1)
    if took > 0.0 and abs(apart - every) > UNEVEN * every:
        step = f"{rate * FIRING_S / DEG:.2g}"
        hertz = f"at {rate / (2.0 * np.pi):.3g} Hz a VLP-16 fires every {step} deg"
        raise InputError("device", "velodyne", f"{hertz}: expected step_deg of it, or of a multiple")
    return Grid(beams, azimuth[:, 0] / HUNDREDTH, beam_t[:, 0], every)


def packets(scan: Scan, grid: Grid) -> list[bytes]:
    """The packets of a scan. What is left of the last one has no returns."""
    count = (len(grid.azimuth) - 1) * grid.every + 1  # firings
    step = (grid.azimuth[-1] - grid.azimuth[0]) / max(count - 1, 1)
    padded = -(-count // (2 * BLOCKS)) * 2 * BLOCKS
    azimuth = grid.azimuth[0] + step * np.arange(padded)
    ranges, intensity = scan.ranges[:, 0][grid.order], scan.intensity[:, 0][grid.order]
    returns = np.zeros((padded, LINES), RETURN)
    distance = np.round(ranges.astype(np.float64) / UNIT)
    is_told = np.isfinite(ranges) & (distance < 1 << 16)
    returns["distance"][: count : grid.every] = np.where(is_told, distance, 0.0)
    reported = np.round(intensity.astype(np.float64) * WHITE).clip(0, 255)
    returns["reflectivity"][: count : grid.every] = np.where(is_told & np.isfinite(reported), reported, 0.0)
    blocks = np.zeros(padded // 2, BLOCK)
    blocks["flag"], blocks["returns"] = 0xFFEE, returns.reshape(-1, 2, LINES)
    blocks["azimuth"] = np.round(azimuth[::2]).astype(np.int64) % 36_000
    made = np.zeros(padded // (2 * BLOCKS), PACKET)
    made["blocks"] = blocks.reshape(-1, BLOCKS)
    firing = np.arange(0, padded, 2 * BLOCKS)
    begun = np.interp(firing, np.arange(0, count, grid.every), grid.beam_t)
    made["time"] = (scan.t // 1000 + np.round(begun * 1e6).astype(np.int64)) % HOUR
    made["mode"], made["product"] = STRONGEST, VLP16
    return [packet.tobytes() for packet in made]


@dataclass
class Firings:
    """What a packet says. time: past the hour [us]; azimuth: (24,) clockwise [1/100 deg] of the firings.

    ranges: (24, LINES) [m], nan = no return
    intensity: relative to a white target
    """

    time: int
    azimuth: np.ndarray
    ranges: np.ndarray
    intensity: np.ndarray


def read_packet(data: bytes) -> Firings | None:
    """A packet; None where it is none of a VLP-16 with one return."""
    if len(data) != SIZE:
        return None
    packet = np.frombuffer(data, PACKET)[0]
    blocks = packet["blocks"]
    if np.any(blocks["flag"] != 0xFFEE) or packet["product"] != VLP16 or packet["mode"] == 0x39:
        return None
    first = blocks["azimuth"].astype(np.float64)
    gap = np.diff(first) % 36_000
    gap = np.append(gap, gap[-1])
    azimuth = (np.stack([first, first + 0.5 * gap], axis=1).ravel()) % 36_000
    returns = blocks["returns"].reshape(-1, LINES)
    ranges = returns["distance"] * UNIT
    ranges[ranges == 0.0] = np.nan
    intensity = np.where(np.isnan(ranges), np.nan, returns["reflectivity"] / WHITE)
    return Firings(int(packet["time"]), azimuth, ranges, intensity)


class Turns:
    """Gathers the firings of packets to whole turns.

    lost: firings that are missing by the times
    wrong: datagrams that were no packets
    late: packets that were older than one before, left out
    """

    def __init__(self) -> None:
        self._firings: list[Firings] = []
        self.lost = self.wrong = self.late = 0

    def feed(self, data: bytes, period: float) -> tuple[Scan, int] | None:
        """One datagram; a turn when it is complete, with t = 0, and its end past the hour [us].

        period: of a turn [s]
        """
        one = read_packet(data)
        if one is None:
            self.wrong += 1
            return None
        whole = None
        if self._firings:
            last = self._firings[-1]
            since = (one.time - last.time + HOUR // 2) % HOUR - HOUR // 2
            if since <= 0:
                self.late += 1
                return None
            turned = (one.azimuth[0] - last.azimuth[0]) % 36_000
            expected = 2 * BLOCKS * np.median(np.diff(last.azimuth) % 36_000)
            self.lost += int(max(round(turned / max(expected, 1.0)) - 1, 0)) if turned < 18_000 else 0
            covered = (last.azimuth[-1] - self._firings[0].azimuth[0]) % 36_000
            is_next = (one.azimuth[-1] - self._firings[0].azimuth[0]) % 36_000 < covered
            if is_next or since > 0.5e6 * period:
                whole = self._turn(period)
                self._firings = []
        self._firings.append(one)
        return whole

    def _turn(self, period: float) -> tuple[Scan, int]:
        azimuth = np.concatenate([f.azimuth for f in self._firings])
        ranges = np.concatenate([f.ranges for f in self._firings])
        intensity = np.concatenate([f.intensity for f in self._firings])
        turned = (azimuth - azimuth[0]) % 36_000 * HUNDREDTH
        end = self._firings[-1].time + round(2 * BLOCKS * FIRING_S * 1e6)
        rate = 2.0 * np.pi / period
        start = np.concatenate([np.full(len(f.azimuth), f.time - end) * 1e-6 for f in self._firings])
        start = (start + HOUR * 0.5e-6) % (HOUR * 1e-6) - HOUR * 0.5e-6
        since = turned - np.repeat([(f.azimuth[0] - azimuth[0]) % 36_000 * HUNDREDTH for f in self._firings],
                                   2 * BLOCKS)  # fmt: skip
        line = np.arange(LINES) * LINE_S
        beam_t = ((start + since / rate)[:, None] + line).ravel().clip(max=0.0)
        at = -(azimuth * HUNDREDTH)[:, None] - line * rate
        at = (at + np.pi) % (2.0 * np.pi) - np.pi
        elevation = np.tile(np.array(ELEVATION) * DEG, len(azimuth))
        scan = Scan(
            t=0, beam_t=beam_t, azimuth=at.ravel(), elevation=elevation,
            ranges=ranges.reshape(-1, 1).astype(np.float32),
            intensity=intensity.reshape(-1, 1).astype(np.float32),
        )  # fmt: skip
        return scan, end % HOUR
