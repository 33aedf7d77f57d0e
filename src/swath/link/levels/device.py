"""Level `device`: a real sensor fills a slot, by its own telegrams.

A `lidar` by a SICK LMS1xx or LMS5xx (`lms://HOST:PORT`) or a Velodyne VLP-16 (`velodyne://ADDRESS:PORT`,
where its packets are heard), a `gnss` by NMEA 0183 (`nmea+tcp://`, `nmea+udp://`, `nmea+pty://PATH`, which
may be a serial port). A sample's time is the device's own, put onto the clock of the run by the arrival that
was quickest so far. `link/device/output.py` is the other way round.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Gt, Le

from swath.core.component import Inputs, KeptElsewhere, Outputs, Port
from swath.core.errors import InputError, SwathError
from swath.core.frames import Pose, wrapped
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.link.device import cola, lms, nmea, velodyne
from swath.link.device.address import read_address
from swath.link.device.output import PROTOCOLS, SENT
from swath.link.device.wires import Events, Reader
from swath.record.read.leaps import Leaps
from swath.sensing.mount import Mount
from swath.signals import Fix, Scan
from swath.signals.setup import LinkSetup

DRIFT = 1e-4  # of a device's clock against ours, at most: a crystal's
STEP_DEG = 1e-5  # to the north, of which the grid's convergence is taken
DAY_S, LATE_S = 86_400, 10.0  # what lies further back is no late one: the receiver's clock was set
OPTIONS = {"lms": ("cola",), "velodyne": (), "nmea": ()}


@dataclass(frozen=True)
class Params:
    """address: of the device, or where it is heard, as in docs/how-to/devices.md.

    mount: of a scanner on the machine
    antenna_m: x, y, z of a receiver's antenna on it
    wait_s: how long to wait for the first sample
    timeout_ms: longest time without a sample
    on_timeout: `note` says so and goes on, `fail` ends the run with an error
    """

    address: str
    mount: Mount | None = None
    antenna_m: tuple[float, float, float] | None = None
    wait_s: Annotated[float, Gt(0), Le(3600)] = 10.0
    timeout_ms: Annotated[float, Gt(0), Le(60_000)] = 500.0
    on_timeout: Literal["note", "fail"] = "note"


class DeviceClock:
    """A device's clock on the run's. turn: after which it begins anew [ns]."""

    def __init__(self, turn: int) -> None:
        self._turn = turn
        self._last: tuple[int, int] | None = None  # its time, unwrapped, and the run's [ns]
        self._offset = 0

    def of(self, device: int, arrived: int) -> int:
        """Time in the run [ns] of a device's time [ns] that was heard at `arrived` [ns]."""
        if self._last is None:
            self._last, self._offset = (device, arrived), arrived - device
            return arrived
        then, before = self._last
        since = (device - then + self._turn // 2) % self._turn - self._turn // 2
        now = then + since
        late = self._offset + round(DRIFT * max(arrived - before, 0))
        self._offset = min(late, arrived - now)
        if abs(since) > 10 * NS:  # it was switched off, or set
            self._offset = arrived - now
        self._last = (now, arrived)
        return now + self._offset


class DeviceSlot(KeptElsewhere):
    """A slot whose samples come from outside."""

    def __init__(self, params: Params, setup: LinkSetup) -> None:
        protocols = {name: PROTOCOLS[name] for name in OPTIONS}
        self._where = read_address(params.address, protocols, "address")
        self._where.known(OPTIONS[self._where.protocol], "address")
        signal = SENT[self._where.protocol]
        port = next((p for p in setup.outputs if p.signal is signal), None)
        if port is None:
            expected = f"expected a slot that sends a {signal.__name__}"
            raise InputError("address", params.address, expected)
        self._p, self._setup, self._name = params, setup, setup.name
        self.whose = f"{setup.name}: a slot played by a device"
        self.inputs: tuple[Port, ...] = ()
        self.outputs = (port,)
        self._output = port.name
        self.mounting = self._mounting(signal)
        make = {"lms": _LmsStream, "velodyne": _VelodyneStream, "nmea": _NmeaStream}[self._where.protocol]
        self._make = make
        self._reader: Reader | None = None
        self._events = Events()
        self._stream: Any = None
        self._count = self._skipped = 0
        self._newest_at = 0
        self._is_silent = False

    @property
    def needs_real_time(self) -> str:
        """Why the run has to be paced."""
        return "a device sends in real time"

    @property
    def notes(self) -> list[str]:
        """How many samples came, what was wrong with the stream, what happened."""
        name = self._setup.slot
        found = [f"{name}: {self._count} samples from {self._where}"]
        if self._skipped:
            found[0] += f", {self._skipped} of them left out for a newer one"
        notes = [] if self._stream is None else self._stream.notes
        events = [f"at {t:.2f} s: {text}" for t, text in list(self._events.list)]
        return found + [f"{name}: {text}" for text in [*notes, *events]]

    def reset(self, stream: Stream) -> Outputs:
        """Connect, and wait for the first sample. SwathError where there is none in time."""
        self.close()
        self._events = Events()
        self._stream = self._make(self._where, self._setup)
        self._count = self._skipped = 0
        self._is_silent = False
        self._reader = Reader(self._where, self._events, hello=self._stream.hello)
        until = time.monotonic() + self._p.wait_s
        while (left := until - time.monotonic()) > 0.0:
            self._reader.wait(min(left, 0.2))
            found = self._take(0)
            if found:
                self._newest_at = 0
                return {self._output: replace(found[-1], t=0)}
        said = self._events.list[-1][1] if self._events.list else "nothing was heard"
        self.close()
        raise SwathError(f"{self._name}: no sample from {self._where} within {self._p.wait_s:g} s: {said}")

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The newest sample that has come; nothing where none has."""
        end = self._events.t = t + dt
        found = self._take(end)
        if found:
            self._count += len(found)
            self._skipped += len(found) - 1
            self._newest_at = end
            if self._is_silent:
                self._events("samples come again")
            self._is_silent = False
            return {self._output: found[-1]}
        silent = (end - self._newest_at) * 1e-6
        if silent > self._p.timeout_ms and not self._is_silent:
            self._is_silent = True
            if self._p.on_timeout == "fail":
                text = f"no sample from {self._where} for {silent:g} ms"
                raise SwathError(f"{self._name}: {text}, at {end / NS:g} s of simulated time")
            self._events(f"no sample for {silent:g} ms")
        return {}

    def close(self) -> None:
        """Let the device go. Calling it again does nothing."""
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()

    def _take(self, end: int) -> list[Any]:
        """The samples that have come, oldest first; end: the run's time now [ns]."""
        if self._reader is None:
            raise SwathError(f"{self._name}: the device is closed")
        now = time.monotonic_ns()
        found: list[Any] = []
        for arrived, data, _ in self._reader.take():
            samples = self._stream.feed(data, end - (now - arrived))
            found += [replace(sample, t=min(sample.t, end)) for sample in samples]
        return found

    def _mounting(self, signal: type) -> Pose:
        p, control = self._p, self._setup.control
        if signal is Scan:
            if p.mount is None or p.antenna_m is not None:
                raise InputError("mount", None, "expected where the scanner sits on the machine")
            return p.mount.pose(control.machine, control.edge_side)
        if p.antenna_m is None or p.mount is not None:
            raise InputError("antenna_m", None, "expected x, y, z of the antenna on the machine")
        return Pose.from_euler(p.antenna_m)


class _LmsStream:
    """Scans of a SICK LMS."""

    def __init__(self, where: Any, setup: LinkSetup) -> None:
        binary = where.choice("cola", ("b", "a")) == "b"
        run = cola.telegram("sMN", "Run", binary=binary)
        self.hello = run + cola.telegram("sEN", "LMDscandata", [("u8", 1)], binary=binary)
        self._splitter = cola.Splitter()
        self._clock = DeviceClock(lms.WRAP * lms.MICRO)
        self._counter: int | None = None
        self._lost = self._late = self._wrong = 0

    @property
    def notes(self) -> list[str]:
        """What was wrong."""
        counts = (("scans were lost", self._lost), ("scans came late and were left out", self._late),
                  ("telegrams were not understood", self._wrong),
                  ("bytes were no telegram", self._splitter.skipped))  # fmt: skip
        return [f"{count} {text}" for text, count in counts if count]

    def feed(self, data: bytes, arrived: int) -> Iterator[Scan]:
        """Scans of more bytes."""
        for content, binary in self._splitter.feed(data):
            try:
                values = cola.Values(content, binary=binary)
                if values.name != "LMDscandata" or values.command not in ("sSN", "sRA"):
                    continue
                reported = lms.read_scan(values)
            except cola.Garbage:
                self._wrong += 1
                continue
            if self._counter is not None:
                ahead = (reported.counter - self._counter + (1 << 15)) % (1 << 16) - (1 << 15)
                if -1000 < ahead <= 0:
                    self._late += 1
                    continue
                self._lost += ahead - 1 if 0 < ahead < 1000 else 0
            self._counter = reported.counter
            sweep = reported.step * (len(reported.ranges) - 1) / (2.0 * np.pi) / max(reported.frequency, 1e-3)
            ended = reported.begun * lms.MICRO + round(sweep * NS)
            yield reported.scan(self._clock.of(ended, arrived))


class _VelodyneStream:
    """Turns of a VLP-16."""

    hello = b""

    def __init__(self, where: Any, setup: LinkSetup) -> None:
        self._turns = velodyne.Turns()
        self._period = setup.control.period
        self._clock = DeviceClock(velodyne.HOUR * 1000)

    @property
    def notes(self) -> list[str]:
        """What was wrong."""
        t = self._turns
        counts = (("packets were lost", t.lost), ("packets came late and were left out", t.late),
                  ("datagrams were no packets", t.wrong))  # fmt: skip
        return [f"{count} {text}" for text, count in counts if count]

    def feed(self, data: bytes, arrived: int) -> Iterator[Scan]:
        """Turns of more packets."""
        found = self._turns.feed(data, self._period)
        if found is not None:
            scan, end = found
            yield replace(scan, t=self._clock.of(end * 1000, arrived))


class _NmeaStream:
    """Fixes of a receiver."""

    hello = b""

    def __init__(self, where: Any, setup: LinkSetup) -> None:
        if setup.to_local is None:
            raise InputError("address", where.text, "expected a field that lies on Earth: set field.origin")
        self._to_local = setup.to_local
        self._listener, self._leaps = nmea.Listener(), Leaps()
        self._clock = DeviceClock(DAY_S * NS)
        self._newest: float | None = None  # second of the day
        self._late = 0

    @property
    def notes(self) -> list[str]:
        """What was wrong, or not said."""
        counts = (("damaged: lines that were no sentence", self._listener.wrong),
                  ("timeline: positions that came late and were left out", self._late),
                  *self._listener.unknown.items(), *self._leaps.notes.items())  # fmt: skip
        return [f"{text} ({count})" for text, count in counts if count]

    def feed(self, data: bytes, arrived: int) -> Iterator[Fix]:
        """Fixes of more sentences."""
        for epoch in self._listener.feed(data):
            before, self._newest = self._newest, epoch.seconds
            if before is not None and 0.0 < (before - epoch.seconds) % DAY_S < LATE_S:
                self._newest, self._late = before, self._late + 1
                continue
            fix = self._fix(epoch, self._clock.of(round(epoch.seconds * NS), arrived))
            self._leaps.take(fix.t, fix)
            yield fix

    def _fix(self, epoch: nmea.Epoch, t: int) -> Fix:
        lon, lat = epoch.longitude, epoch.latitude
        x = y = z = north = math.nan
        if epoch.quality and math.isfinite(lon) and math.isfinite(lat):
            place = [math.degrees(lon), math.degrees(lat), epoch.height]
            places = np.array([place, [place[0], place[1] + STEP_DEG, epoch.height]])
            here, there = self._to_local(places)
            x, y, z = here.tolist()
            north = math.atan2(there[1] - y, there[0] - x)
        return Fix(
            t, x, y, z, epoch.speed, _turned(north, epoch.course), epoch.horizontal_sd, epoch.vertical_sd,
            math.nan, epoch.quality, lon, lat, epoch.height, _turned(north, epoch.heading), math.nan,
            epoch.age, epoch.satellites, epoch.hdop, epoch.roll, epoch.pitch,
        )  # fmt: skip


def _turned(north: float, bearing: float) -> float:
    """A bearing clockwise from north as an angle from east; north: where that lies, from east [rad]."""
    angle = (math.pi / 2.0 if math.isnan(north) else north) - bearing
    return wrapped(angle) if math.isfinite(angle) else math.nan


LEVEL = Level(
    DeviceSlot,
    Params,
    summary="slots lidar and gnss: a real device, by its own telegrams",
    cost="0.1 to 0.3 ms per scan of a SICK LMS, 4 ms per turn of a VLP-16",
    tolerance="as exact as the telegrams; depends on the clock on the wall",
    is_link=True,
)
