"""SICK LMS1xx and LMS5xx: the telegram of a scan, and what the sensor answers to commands.

Angles of the sensor are in 1/10000 deg, counter-clockwise seen from above, 90 deg straight ahead; a distance
is in mm times the scale factor, 0 where there is no echo. Source: as `cola`; `LMDscandata`: its table 16.

An echo's RSSI is its intensity relative to a white target times RSSI_WHITE (16 bit) or RSSI_WHITE / 100 (8
bit): the sensors' own curve is not published.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.units import DEG
from swath.link.device.cola import Garbage, Item, Splitter, Values, framed, telegram
from swath.signals import Scan

TICK = 1e-4 * DEG  # of the sensor's angles [rad]
AHEAD = 900_000  # of them: straight ahead
RSSI_WHITE = 10_000.0
PASSWORDS = {2: 0xB21ACE26, 3: 0xF4724744, 4: 0x81BE23AA}  # of user levels, as delivered
ACCESS_DENIED, UNKNOWN_METHOD, UNKNOWN_VARIABLE, INVALID_DATA, UNKNOWN_COMMAND = 1, 2, 3, 5, 12
MOST_ECHOES = 5
NO_MODEL = "LMS"  # of a sensor whose sheet does not say what it calls itself
READY = 7  # of STlms: it measures
MICRO = 1_000  # ns
WRAP = 1 << 32


@dataclass(frozen=True)
class Telegram:
    """A scan as it was sent. begun, sent: the sensor's clock [us], which wraps; counter: of scans, wraps.

    ranges, intensity: (beam_count, echo_count), nan = no echo, or not reported; start, step [rad], 0 is ahead
        frequency [Hz]
    """

    begun: int
    sent: int
    counter: int
    frequency: float
    start: float
    step: float
    ranges: np.ndarray
    intensity: np.ndarray

    def scan(self, t: int) -> Scan:
        """As a sample that ends at t [ns]."""
        count = len(self.ranges)
        azimuth = self.start + self.step * np.arange(count, dtype=np.float64)
        turn = 1.0 / self.frequency if self.frequency > 0.0 else 0.0
        beam_t = (np.arange(count, dtype=np.float64) - (count - 1)) * (self.step / (2.0 * np.pi) * turn)
        return Scan(
            t=t, beam_t=beam_t, azimuth=azimuth, elevation=np.zeros(count),
            ranges=self.ranges.astype(np.float32), intensity=self.intensity.astype(np.float32),
        )  # fmt: skip


@dataclass
class Plane:
    """The scans of a slot as the sensor describes them.

    model: its name
    scale: of the distances [mm] frequency [Hz]
    start, step, count: of the beams, angles of the sensor in ticks
    """

    model: str
    frequency: float
    scale: float
    start: int
    step: int
    count: int

    @property
    def stop(self) -> int:
        """The last beam [tick]."""
        return self.start + self.step * (self.count - 1)


def plane_of(scan: Scan, model: str, period: float, range_max: float) -> Plane:
    """What a sensor with such scans is. InputError where it is no plane with beams at even angles."""
    azimuth, steps = scan.azimuth, np.diff(scan.azimuth)
    is_even = len(azimuth) > 1 and np.all(steps > 0) and np.ptp(steps) < 0.5 * TICK
    if not is_even or np.ptp(scan.elevation) > TICK:
        raise InputError(
            "device", "lms", "expected scans of one plane at even angles, as a SICK LMS has them"
        )
    scale = 1.0 if range_max < 65.5 else 2.0  # mm; the LMS5xx doubles it beyond 65 m
    start, step = round(azimuth[0] / TICK) + AHEAD, round(steps.mean() / TICK)
    return Plane(model, 1.0 / period, scale, start, step, len(azimuth))


@dataclass
class Wanted:
    """What a client asked to be in its telegrams. echoes: 0 first, 1 all, 2 last; every: n-th scan.

    first, last: angles of the sensor [tick]
    """

    rssi: bool = True
    wide: bool = True
    echoes: int = 0
    every: int = 1
    first: int = -(1 << 31)
    last: int = (1 << 31) - 1


def scan_items(plane: Plane, scan: Scan, counter: int, wanted: Wanted) -> list[Item]:
    """Content of LMDscandata. counter: of scans."""
    angles = plane.start + plane.step * np.arange(plane.count)
    kept = (angles >= wanted.first) & (angles <= wanted.last)
    ranges, intensity = _echoes(scan.ranges[kept], scan.intensity[kept], wanted.echoes)
    start = int(angles[kept][0]) if kept.any() else plane.start
    begun = scan.t + (round(float(scan.beam_t[0]) * 1e9) if len(scan.beam_t) else 0)
    items: list[Item] = [
        ("u16", 1), ("u16", 1), ("u32", 1), ("u8", 0), ("u8", 0), ("u16", counter & 0xFFFF),
        ("u16", counter & 0xFFFF), ("u32", begun // MICRO % WRAP), ("u32", scan.t // MICRO % WRAP),
        ("u8", 0), ("u8", 0), ("u8", 0), ("u8", 0), ("u16", 0), ("u32", round(plane.frequency * 100)),
        ("u32", round(plane.frequency * 360.0 / (plane.step * 1e-4) / 100.0)), ("u16", 0),
    ]  # fmt: skip
    dist = [_digits(ranges[:, i] * (1e3 / plane.scale), 0xFFFF) for i in range(ranges.shape[1])]
    white, top = (RSSI_WHITE, 0xFFFF) if wanted.wide else (RSSI_WHITE / 100, 0xFE)
    rssi = [_digits(intensity[:, i] * white, top) for i in range(ranges.shape[1])] if wanted.rssi else []

    def channels(name: str, scale: float, values: list[np.ndarray], kind: str) -> list[Item]:
        made: list[Item] = []
        for i, numbers in enumerate(values):
            made += [
                ("text", f"{name}{i + 1}"), ("f32", scale), ("f32", 0.0), ("i32", start),
                ("u16", plane.step), ("u16", len(numbers)), *([(kind, numbers)] if len(numbers) else []),
            ]  # fmt: skip
        return made

    wide = rssi if wanted.wide else []
    narrow = [] if wanted.wide else rssi
    items += [("u16", len(dist) + len(wide)), *channels("DIST", plane.scale, dist, "u16s")]
    items += channels("RSSI", 1.0, wide, "u16s")
    items += [("u16", len(narrow)), *channels("RSSI", 1.0, narrow, "u8s")]
    return [*items, ("u16", 0), ("u16", 0), ("u16", 0), ("u16", 0), ("u16", 0)]


def read_scan(values: Values) -> Telegram:
    """A scan out of LMDscandata. Garbage where it is none."""
    for kind in ("u16", "u16", "u32", "u8", "u8", "u16"):
        values.read(kind)
    counter, begun, sent = values.read("u16"), values.read("u32"), values.read("u32")
    for kind in ("u8", "u8", "u8", "u8", "u16"):
        values.read(kind)
    frequency = values.read("u32") / 100.0
    values.read("u32")
    for _ in range(_few(values.read("u16"))):  # encoders
        values.read("u32")
        values.read("u16")
    found: dict[str, np.ndarray] = {}
    start, step = 0, 0
    for kind in ("u16", "u8"):
        for _ in range(_few(values.read("u16"))):
            name = values.text(5)
            scale, offset = values.read("f32"), values.read("f32")
            start, step = values.read("i32"), values.read("u16")
            numbers = values.numbers(kind, values.read("u16"))
            found[name] = (numbers * scale + offset) * (100.0 if kind == "u8" and name[:4] == "RSSI" else 1.0)
    dist = [found[f"DIST{i}"] for i in range(1, MOST_ECHOES + 1) if f"DIST{i}" in found]
    rssi = [found.get(f"RSSI{i + 1}") for i in range(len(dist))]
    if not dist or any(len(d) != len(dist[0]) for d in dist) or step == 0:
        raise Garbage("no distances in the scan")
    ranges = np.stack(dist, axis=1) * 1e-3
    ranges[ranges <= 0.0] = np.nan
    intensity = np.full_like(ranges, np.nan)
    for i, one in enumerate(rssi):
        if one is not None and len(one) == len(ranges):
            intensity[:, i] = one / RSSI_WHITE
    intensity[np.isnan(ranges)] = np.nan
    return Telegram(
        begun, sent, counter, frequency, (start - AHEAD) * TICK, step * TICK, ranges, intensity
    )  # fmt: skip


def _few(count: int) -> int:
    if count > 16:
        raise Garbage(f"{count} channels")
    return count


def _digits(values: np.ndarray, top: int) -> np.ndarray:
    """Whole numbers of a telegram, 0 for nan."""
    return np.nan_to_num(np.round(values.astype(np.float64)), nan=0.0).clip(0, top).astype(np.int64)


def _echoes(ranges: np.ndarray, intensity: np.ndarray, which: int) -> tuple[np.ndarray, np.ndarray]:
    """The first echo, all, or the last. (n, m) each."""
    if which == 1:
        return ranges[:, :MOST_ECHOES], intensity[:, :MOST_ECHOES]
    if which == 0 or ranges.shape[1] < 2:
        return ranges[:, :1], intensity[:, :1]
    last = np.maximum(np.isfinite(ranges).sum(axis=1) - 1, 0)
    rows = np.arange(len(ranges))
    return ranges[rows, last][:, None], intensity[rows, last][:, None]


@dataclass
class Session:
    """What the sensor knows of one client.

    is_subscribed: it wants every scan
    is_asked: it waits for the first
    plane: of the sensor
    newest: the scan of now and its number, None before there is one
    tell: an event for the user
    wanted: one of the sensor's, clients share it
    """

    plane: Plane
    newest: Callable[[], tuple[Scan, int] | None]
    tell: Callable[[str], None]
    is_subscribed: bool = False
    is_asked: bool = False
    binary: bool = False
    level: int = 0
    wanted: Wanted = field(default_factory=Wanted)
    _splitter: Splitter = field(default_factory=Splitter)
    _told: int = 0

    def feed(self, data: bytes) -> bytes:
        """Bytes of the client; the answers."""
        answers = b""
        for content, binary in self._splitter.feed(data):
            self.binary = binary
            try:
                values = Values(content, binary=binary)
                answers += self._answer(values)
            except Garbage as error:
                self.tell(f"a telegram that was not understood: {error}")
                answers += self._failed(INVALID_DATA)
        if self._splitter.skipped > self._told:
            self._told = self._splitter.skipped
            self.tell(f"{self._told} bytes of garbage so far")
        return answers

    def scan(self, scan: Scan, counter: int) -> bytes:
        """The telegram of a scan for a client that wants every one; empty where it is not its turn."""
        if not self.is_subscribed or counter % self.wanted.every:
            return b""
        return self._scan("sSN", scan, counter)

    def asked(self, scan: Scan, counter: int) -> bytes:
        """The first scan for a client that asked for one before; empty where it did not."""
        if not self.is_asked:
            return b""
        self.is_asked = False
        return self._scan("sRA", scan, counter)

    def key(self, counter: int) -> Any:
        """Clients of the same key get the same bytes."""
        w = self.wanted
        turn = self.is_subscribed and not counter % w.every
        return turn, self.binary, w.rssi, w.wide, w.echoes, w.first, w.last

    def _scan(self, command: str, scan: Scan, counter: int) -> bytes:
        items = scan_items(self.plane, scan, counter, self.wanted)
        return telegram(command, "LMDscandata", items, binary=self.binary)

    def _answer(self, values: Values) -> bytes:
        command, name = values.command, values.name
        verb = {"sRN": self._read, "sWN": self._write, "sMN": self._do, "sEN": self._subscribe}.get(command)
        if verb is None:
            return self._failed(UNKNOWN_COMMAND)
        return verb(name, values)

    def _failed(self, error: int) -> bytes:
        content = b"sFA" + error.to_bytes(2, "big") if self.binary else b"sFA %X" % error
        return framed(content, binary=self.binary)

    def _say(self, command: str, name: str, items: list[Item] | None = None) -> bytes:
        return telegram(command, name, items or [], binary=self.binary)

    def _read(self, name: str, values: Values) -> bytes:
        plane = self.plane
        if name == "LMDscandata":
            newest = self.newest()
            self.is_asked = newest is None
            return b"" if newest is None else self._scan("sRA", *newest)
        if name == "DeviceIdent":
            return self._say("sRA", name, [("string", plane.model), ("string", "V1.0")])
        if name == "STlms":
            items: list[Item] = [("u16", READY), ("u8", 0), ("string", "00:00:00"), ("string", "01.01.00")]
            return self._say("sRA", name, [*items, ("u16", 0), ("u16", 0), ("u16", 0)])
        if name == "SCdevicestate":
            return self._say("sRA", name, [("u8", 1)])
        if name in ("FirmwareVersion", "SerialNumber", "LocationName"):
            text = {"FirmwareVersion": "V1.0", "SerialNumber": "00000001", "LocationName": "swath"}[name]
            return self._say("sRA", name, [("string", text)])
        if name == "LMPscancfg":
            return self._say("sRA", name, _config(plane))
        if name == "LMPoutputRange":
            first, last = max(self.wanted.first, plane.start), min(self.wanted.last, plane.stop)
            return self._say("sRA", name, [("u16", 1), ("u32", plane.step), ("i32", first), ("i32", last)])
        return self._failed(UNKNOWN_VARIABLE)

    def _write(self, name: str, values: Values) -> bytes:
        if self.level < 3:
            return self._failed(ACCESS_DENIED)
        w = self.wanted
        if name == "LMDscandatacfg":
            values.read("u8"), values.read("u8")
            w.rssi, w.wide = values.read("u8") != 0, values.read("u8") != 0
            for kind in ("u8", "u8", "u8", "u8", "u8", "u8", "u8"):
                values.read(kind)
            w.every = max(1, values.read("u16"))
        elif name == "LMPoutputRange":
            values.read("u16"), values.read("u32")
            w.first, w.last = values.read("i32"), values.read("i32")
        elif name == "FREchoFilter":
            w.echoes = values.read("u8")
        elif name not in ("LSPsetdatetime", "EIHstCola", "LocationName"):
            return self._failed(UNKNOWN_VARIABLE)
        return self._say("sWA", name)

    def _do(self, name: str, values: Values) -> bytes:
        plane = self.plane
        if name == "SetAccessMode":
            level, password = values.read("i8"), values.read("u32")
            is_right = PASSWORDS.get(level) == password
            self.level = level if is_right else self.level
            return self._say("sAN", name, [("u8", int(is_right))])
        if name in ("Run", "mEEwriteall"):
            return self._say("sAN", name, [("u8", 1)])
        if name in ("LMCstartmeas", "LMCstopmeas"):
            return self._say("sAN", name, [("u8", 0)])
        if name == "mLMPsetscancfg":
            if self.level < 3:
                return self._failed(ACCESS_DENIED)
            frequency, _, step = values.read("u32"), values.read("i16"), values.read("u32")
            is_other = frequency != round(plane.frequency * 100), step != plane.step
            if any(is_other):
                self.tell(
                    f"a client asked for {frequency / 100:g} Hz and {step / 1e4:g} deg, "
                    f"the scenario says {plane.frequency:g} Hz and {plane.step / 1e4:g} deg"
                )
            status = 1 if is_other[0] else 2 if is_other[1] else 0
            return self._say("sAN", name, [("u8", status), *_config(plane)])
        return self._failed(UNKNOWN_METHOD)

    def _subscribe(self, name: str, values: Values) -> bytes:
        if name != "LMDscandata":
            return self._failed(15)
        self.is_subscribed = values.read("u8") == 1
        return self._say("sEA", name, [("u8", int(self.is_subscribed))])


def _config(plane: Plane) -> list[Item]:
    return [
        ("u32", round(plane.frequency * 100)), ("u16", 1), ("u32", plane.step), ("i32", plane.start),
        ("i32", plane.stop),
    ]  # fmt: skip
