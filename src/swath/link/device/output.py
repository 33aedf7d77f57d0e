"""A slot as a device of its own: what it sends goes out as telegrams, at the pace of the run.

    combine: {lidar: {device: "lms://127.0.0.1:2111"}}      # key of the slot
    swath run S --real-time --device lidar=lms://           # or on the command line

The device hears the samples that everybody hears, faults included, and changes nothing in the run. The other
way round, level `device` fills a slot by a real device.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swath.core.component import Port
from swath.core.errors import InputError, SwathError
from swath.field.maps.projection import Origin
from swath.link.device import analog, lms, nmea, velodyne
from swath.link.device.address import Address, read_address
from swath.link.device.wires import Events, TcpServer, Terminal, UdpSender
from swath.signals import Fix, Scan, Signal, SteerCommand

PROTOCOLS: dict[str, tuple[Sequence[str], int]] = {
    "lms": (("tcp",), 2111),
    "velodyne": (("udp",), velodyne.PORT),
    "nmea": (("tcp", "udp", "pty"), 10_110),
    "agopengps": (("udp",), 9999),
    "analog": (("udp", "tcp", "pty"), analog.PORT),
}
SENT: dict[str, type[Signal]] = {
    "lms": Scan, "velodyne": Scan, "nmea": Fix, "agopengps": Fix, "analog": SteerCommand,
}  # fmt: skip
SENDERS = {Scan: "lidar", Fix: "gnss", SteerCommand: "steer"}  # a slot for example
STAYS = 50.0  # so far from a place its convergence holds, to 1e-5 rad [m]
STEP = 10.0  # to the north, of which the grid's convergence is taken [m]


@dataclass(frozen=True)
class DeviceSetup:
    """name: of the slot, such as `combine.lidar`; outputs: that it has; period: of it [s].

    range_max: that a scanner reports [m], nan where it does not say
    origin: of the field on Earth
    factor: simulated seconds per second
    identity: what the sensor calls itself, empty = not known
    wheelbase, max_steer: of its machine [m], [rad]
    """

    name: str
    outputs: Sequence[Port]
    period: float
    range_max: float
    origin: Origin | None
    factor: float
    identity: str = ""
    wheelbase: float = math.nan
    max_steer: float = math.nan


class Device:
    """What all devices do; one of a protocol overrides `_open`, `_send` and, where it has clients, `_is_met`.

    events: what happened on its wire
    """

    options: tuple[str, ...] = ()

    def __init__(self, where: Address, setup: DeviceSetup) -> None:
        self.where, self.setup = where.known(("wait_s", *self.options)), setup
        self._signal = SENT[where.protocol]
        self._wait = where.number("wait_s", 0.0, 0.0, 3600.0)
        self.events = Events()
        self.sample_count = self.sent_count = 0
        self._late: list[int] = []
        self._last: tuple[int, int] | None = None
        self._is_open = False

    def open(self) -> None:
        """Listen, or be ready to send. SwathError where that cannot be; again it does nothing."""
        if not self._is_open:
            self._open()
            self._is_open = True

    def wait(self, t: int) -> None:
        """Before the first tick: wait for somebody to listen, as long as `wait_s` says. SwathError."""
        if not self._wait or not self._is_open:
            return
        until, self._wait = time.monotonic() + self._wait, 0.0
        while not self._is_met():
            if time.monotonic() > until:
                raise SwathError(f"{self.setup.name}: nobody asked {self.where} for data within wait_s")
            time.sleep(0.01)

    def __call__(self, slot: str, t: int, outputs: Mapping[str, Any]) -> None:
        """What the slot gave at t [ns]."""
        sample = next((s for s in outputs.values() if isinstance(s, self._signal)), None)
        if sample is None or not self._is_open:
            return
        self.events.t = t
        count = self._send(sample, t)
        if t == 0:
            return
        self.sample_count += 1
        self.sent_count += count
        now = time.monotonic_ns()
        if count and self._last is not None:
            before, then = self._last
            self._late.append(abs(now - then - round((t - before) / self.setup.factor)))
        self._last = (t, now) if count else None

    def close(self) -> None:
        """Let the wire go; twice does nothing."""
        if self._is_open:
            self._is_open = False
            self._close()

    def summary(self) -> dict[str, Any]:
        """The entry of this output in summary.json."""
        found = {"address": str(self.where), "samples": self.sample_count, "sent": self.sent_count}
        if self._late:
            jitter = np.percentile(np.array(self._late) * 1e-6, (50, 99, 100))
            found["jitter_ms"] = dict(zip(("p50", "p99", "max"), np.round(jitter, 3).tolist(), strict=True))
        events = [{"t_s": round(t, 3), "what": text} for t, text in list(self.events.list)]
        return {**found, "events": events, **({"left_out": n} if (n := self.events.left_out) else {})}

    @property
    def notes(self) -> list[str]:
        """The same in a line for people, then what happened on the wire."""
        summary = self.summary()
        jitter = f", jitter p99 {summary['jitter_ms']['p99']:.2f} ms" if "jitter_ms" in summary else ""
        head = (
            f"device {self.setup.name} at {self.where}: {self.sample_count} samples, {self.sent_count} sent"
        )
        more = [f"device {self.setup.name} at {t:.2f} s: {text}" for t, text in list(self.events.list)]
        return [head + jitter, *more]

    def _open(self) -> None:
        raise NotImplementedError

    def _send(self, sample: Any, t: int) -> int:
        raise NotImplementedError

    def _close(self) -> None:
        raise NotImplementedError

    def _is_met(self) -> bool:
        return True


class Lms(Device):
    """A SICK LMS1xx or LMS5xx: CoLa A and B on one port, by what the client speaks."""

    options = ("model",)

    def __init__(self, where: Address, setup: DeviceSetup) -> None:
        super().__init__(where, setup)
        self._model = self.where.options.get("model") or setup.identity or lms.NO_MODEL
        self._plane: lms.Plane | None = None
        self._newest: tuple[Scan, int] | None = None
        self._wanted = lms.Wanted()
        self._server: TcpServer | None = None

    @property
    def port(self) -> int:
        """Port that it listens to."""
        assert self._server is not None
        return self._server.port

    def _open(self) -> None:
        def session() -> lms.Session:
            assert self._plane is not None
            return lms.Session(self._plane, lambda: self._newest, self.events, wanted=self._wanted)

        self._server = TcpServer(self.where, session, self.events)

    def _send(self, sample: Any, t: int) -> int:
        assert self._server is not None
        if self._plane is None or len(sample.azimuth) != self._plane.count:
            self._describe(sample)
            self._server.start()
        if t == 0:  # no sweep yet
            return 0
        counter = self.sample_count
        self._newest = (sample, counter)
        made: dict[Any, bytes] = {}

        def of(session: lms.Session) -> bytes:
            key = session.key(counter)
            if key not in made:
                made[key] = session.scan(sample, counter)
            return session.asked(sample, counter) + made[key]

        return self._server.send(of)

    def _describe(self, scan: Scan) -> None:
        """What the sensor is, by a scan of it: the first, or one of another level."""
        limit = 80.0 if math.isnan(self.setup.range_max) else self.setup.range_max
        plane = lms.plane_of(scan, self._model, self.setup.period, limit)
        if self._plane is None:
            self._plane = plane
        else:  # sessions hold it
            self.events(f"the scanner has {plane.count} beams now, {self._plane.count} before")
            vars(self._plane).update(vars(plane))

    def _is_met(self) -> bool:
        if self._plane is None:  # a level that sends nothing at the start
            self.events("nobody was waited for: there is no scan yet to offer")
            return True
        server = self._server
        return server is not None and server.has_client(lambda it: it.is_subscribed or it.is_asked)

    def _close(self) -> None:
        if self._server is not None:
            self._server.close()


class Velodyne(Device):
    """A Velodyne VLP-16: its packets to one address."""

    def __init__(self, where: Address, setup: DeviceSetup) -> None:
        super().__init__(where, setup)
        self._grid: velodyne.Grid | None = None

    def _open(self) -> None:
        self._wire = UdpSender(self.where, self.events)

    def _send(self, sample: Any, t: int) -> int:
        if self._grid is None or self._grid.order.size != len(sample.azimuth):
            self._grid = velodyne.grid_of(sample)
        if t == 0:
            return 0
        made = velodyne.packets(sample, self._grid)
        unsent = [packet for packet in made if not self._wire.send(packet)]
        return int(not unsent)

    def _close(self) -> None:
        self._wire.close()


class _Listener:
    """A client that only listens."""

    def feed(self, data: bytes) -> bytes:
        """What it says does not matter."""
        return b""


class LineDevice(Device):
    """What sends lines to whoever listens, over any transport; one overrides `_lines`."""

    def _lines(self, sample: Any) -> bytes:
        raise NotImplementedError

    @property
    def port(self) -> int:
        """Port that it listens to."""
        return int(self._wire.port)

    def _open(self) -> None:
        where, events = self.where, self.events
        self._wire: Any
        if where.transport == "tcp":
            self._wire = TcpServer(where, _Listener, events)
            self._wire.start()
        else:
            self._wire = (UdpSender if where.transport == "udp" else Terminal)(where, events)

    def _send(self, sample: Any, t: int) -> int:
        if t == 0:
            return 0
        data = self._lines(sample)
        if isinstance(self._wire, TcpServer):
            return self._wire.send(lambda session: data)
        return int(self._wire.send(data))

    def _is_met(self) -> bool:
        return not isinstance(self._wire, TcpServer) or self._wire.has_client()

    def _close(self) -> None:
        self._wire.close()


class Analog(LineDevice):
    """A steering law as a voltage, as a box gives it that sees the crop edge."""

    options = analog.OPTIONS

    def __init__(self, where: Address, setup: DeviceSetup) -> None:
        super().__init__(where, setup)
        self._line = analog.line_of(where.options)

    def _lines(self, sample: Any) -> bytes:
        setup = self.setup
        angle = math.atan(sample.curvature * setup.wheelbase) if sample.is_engaged else math.nan
        return analog.written(self._line.volts(angle, setup.max_steer))


class Nmea(LineDevice):
    """A GNSS receiver. With `agopengps` it sends PANDA, or PAOGI where it knows a heading."""

    options = ("sentences", "utc")

    def __init__(self, where: Address, setup: DeviceSetup) -> None:
        super().__init__(where, setup)
        self._is_agopengps = where.protocol == "agopengps"
        given = self.where.options.get("sentences")
        self._names = tuple(given.upper().split(",")) if given else nmea.USUAL
        for name in self._names:
            if name not in nmea.SENTENCES:
                known = ", ".join(nmea.SENTENCES)
                raise InputError("device", where.text, f"expected sentences out of {known}")
        try:
            self._begun = nmea.utc_of(self.where.options.get("utc", nmea.BEGUN))
        except ValueError:
            expected = f"expected utc as a date and time such as {nmea.BEGUN}"
            raise InputError("device", where.text, expected) from None
        if setup.origin is None:
            expected = "expected a field that lies on Earth: set field.origin, or import one"
            raise InputError("device", where.text, expected)
        self._turned = math.nan, math.nan, 0.0  # place [m] and convergence there [rad]

    def _lines(self, sample: Any) -> bytes:
        x, y, turned = self._turned
        if math.isfinite(sample.x) and not math.hypot(sample.x - x, sample.y - y) < STAYS:
            turned = convergence(self.setup.origin, sample.x, sample.y)
            self._turned = sample.x, sample.y, turned
        names = self._names
        if self._is_agopengps and "sentences" not in self.where.options:
            names = ("PANDA",) if math.isnan(sample.heading) else ("PAOGI",)
        return nmea.sentences(sample, names, self._begun, turned)


def convergence(origin: Origin | None, x: float, y: float) -> float:
    """Angle from true to grid north at a place [m], clockwise [rad]; 0 without an origin."""
    if origin is None:
        return 0.0
    from swath.field.maps.projection import ellipsoid

    (lon, lat), (there_lon, there_lat) = origin.to_lon_lat([[x, y], [x, y + STEP]])
    bearing, _, _ = ellipsoid().inv(lon, lat, there_lon, there_lat)
    return math.radians(bearing)


MAKERS: dict[str, Callable[[Address, DeviceSetup], Device]] = {
    "lms": Lms, "velodyne": Velodyne, "nmea": Nmea, "agopengps": Nmea, "analog": Analog,
}  # fmt: skip


def make_device(text: str, setup: DeviceSetup) -> Device:
    """The device of an address. InputError where it does not fit the slot."""
    where = read_address(text, PROTOCOLS)
    signal = SENT[where.protocol]
    if not any(port.signal is signal for port in setup.outputs):
        expected = f"expected a slot such as {SENDERS[signal]}, that sends a {signal.__name__}"
        raise InputError("device", text, expected)
    return MAKERS[where.protocol](where, setup)
