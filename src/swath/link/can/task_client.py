"""The client of a task controller (ISO 11783-10): what the machine can report, and the reports asked for.

It waits for a task controller's status message, says what it is (working set master, version), hands its
description over (device descriptor object pool, by the transport protocol of J1939-21), and then answers
requests for values, once or in intervals of time, way or change. Message numbers and object layouts: ISO
11783-10:2015 annexes A and B, as in the public AgIsoStack++; data identifiers: isobus.net. A pool is sent
whole, anew at each start: nothing is kept by label.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from swath.core.schedule import NS

PROCESS_DATA, WORKING_SET_MASTER = 0xCB00, 0xFE0D
TP_CONTROL, TP_DATA = 0xEC00, 0xEB00
RTS, CTS, ACK, ABORT = 16, 17, 19, 255
VERSION = 3  # of the standard's task controller interface: second edition
ASK_VERSION, ASK_LABEL, ASK_TRANSFER, TRANSFER, ACTIVATE = 0x00, 0x01, 0x41, 0x61, 0x81
VERSION_IS, LABEL_IS, MAY_TRANSFER, TRANSFERRED, ACTIVATED = 0x10, 0x11, 0x51, 0x71, 0x91
ASK_VALUE, VALUE, BY_TIME, BY_WAY, BY_LEAST, BY_MOST, BY_CHANGE = 2, 3, 4, 5, 6, 7, 8
NOT_DONE, STATUS, TASK = 0xD, 0xE, 0xF
STATUS_EVERY = 2 * NS
LOST_AFTER, ANSWER_WITHIN = 6 * NS, 6 * NS  # without a status message; without an answer
LEAST_INTERVAL = NS // 10
SUPPORTED = BY_TIME, BY_WAY, BY_CHANGE
TRIGGERS = 0b1011  # of the object pool: in intervals of time, of way, on change
SETTABLE, DEFAULT = 0b10, 0b01
Send = Callable[[int, bytes, int], None]


def _nothing_is_set(ddi: int, value: float) -> bool:
    return False


@dataclass(frozen=True)
class Datum:
    """What the machine reports.

    ddi: data identifier
    element: 0 the machine, 1 its header
    scale: unit of the data over that of the value
    unit: of the value, as shown
    is_set: a task controller may set it
    """

    ddi: int
    element: int
    name: str
    scale: float
    unit: str
    is_set: bool = False


@dataclass
class _Report:
    """A value that is sent by itself.

    every: ns, mm or steps
    last: of the time or way, or value, sent last
    """

    how: int
    every: float
    last: float


@dataclass
class TaskClient:
    """send: PGN, data, destination; data: what it reports; name: NAME of ISO 11783-5.

    designator: of the device
    width_mm, offset_mm: of the header, and how far ahead of the axle its knife is
    put: sets a value, DDI and value, False where that cannot be
    """

    send: Send
    data: tuple[Datum, ...]
    name: bytes
    designator: str
    width_mm: int
    offset_mm: int
    put: Callable[[int, float], bool] = _nothing_is_set
    controller: int | None = None
    state: str = "waiting"
    asked_at: int = 0
    heard_at: int = 0
    status_due: int = 0
    reports: dict[tuple[int, int], _Report] = field(default_factory=dict)
    events: list[str] = field(default_factory=list)
    refused: bool = False

    @property
    def is_active(self) -> bool:
        """The task controller has taken the description."""
        return self.state == "active"

    @property
    def pool(self) -> bytes:
        """The device descriptor object pool."""
        return object_pool(self.data, self.name, self.designator, self.width_mm, self.offset_mm)

    def hear(self, pgn: int, data: bytes, source: int, t: int, values: Mapping[int, float]) -> None:
        """A message to this client or to all at t [ns]. values: by DDI, in the unit of the value."""
        if pgn == PROCESS_DATA and data[0] & 0xF == STATUS and self.controller in (None, source):
            self.controller, self.heard_at = source, t
            if self.state == "waiting" and not self.refused:
                self._say_what_it_is(t)
        elif source != self.controller:
            return
        elif pgn == TP_CONTROL:
            self._transport(data)
        elif pgn == PROCESS_DATA:
            self._answer(data, t, values)

    def tick(self, t: int, way_mm: float, values: Mapping[int, float]) -> None:
        """What is due at t [ns]."""
        if self.state == "waiting" or self.controller is None:
            return
        if t - self.heard_at > LOST_AFTER:
            self._back(f"the task controller {self.controller} is silent since {self.heard_at / NS:g} s")
            self.controller = None
            return
        if not self.is_active and t - self.asked_at > ANSWER_WITHIN:
            self._back(f"the task controller {self.controller} did not answer while {self.state}")
            return
        if t >= self.status_due:
            self.status_due = t + STATUS_EVERY
            self._tell(bytes([0xFF, 0xFF, 0xFF, 0xFF, int(self.is_active), 0, 0, 0]))
        for (element, ddi), report in self.reports.items():
            value = values.get(ddi)
            if (
                value is not None
                and (now := self._is_due(report, t, way_mm, self._raw(ddi, value))) is not None
            ):
                report.last = now
                self._value(element, ddi, value)

    def leave(self) -> None:
        """Say that the description counts no more."""
        if self.is_active:
            self._tell(bytes([ACTIVATE, 0, *[0xFF] * 6]))
        self.state = "waiting"

    def _say_what_it_is(self, t: int) -> None:
        self.send(WORKING_SET_MASTER, bytes([1, *[0xFF] * 7]), 0xFF)
        self._ask(ASK_VERSION, t, "asking its version")

    def _ask(self, what: int, t: int, state: str, more: bytes = b"") -> None:
        self.state, self.asked_at = state, t
        self._tell(bytes([what]) + more.ljust(7, b"\xff"))

    def _answer(self, data: bytes, t: int, values: Mapping[int, float]) -> None:
        first = data[0]
        if first == VERSION_IS and self.state == "asking its version":
            self._ask(ASK_LABEL, t, "asking for a label")
        elif first == ASK_VERSION:
            self._tell(bytes([VERSION_IS, VERSION, 0xFF, 0, 0, 1, 1, 0]))
        elif first == LABEL_IS and self.state == "asking for a label":
            self._ask(ASK_TRANSFER, t, "asking to transfer", len(self.pool).to_bytes(4, "little"))
        elif first == MAY_TRANSFER and self.state == "asking to transfer":
            self._begin_transfer(data[1], t)
        elif first == TRANSFERRED and self.state == "transferring":
            self._go_on(
                data[1],
                "the transfer of the description",
                lambda: self._ask(ACTIVATE, t, "activating", b"\xff"),
            )
        elif first == ACTIVATED and self.state == "activating":
            self._go_on(data[1], "the description", self._activated)
        elif self.is_active and first & 0xF in (ASK_VALUE, VALUE, *range(BY_TIME, BY_CHANGE + 1)):
            self._command(data, t, values)

    def _begin_transfer(self, error: int, t: int) -> None:
        def begin() -> None:
            self.state, self.asked_at = "transferring", t
            size = len(self._stream)
            self._control(RTS, size.to_bytes(2, "little") + bytes([-(-size // 7), 0xFF]))

        self._go_on(error, "to take a description", begin)

    @property
    def _stream(self) -> bytes:
        return bytes([TRANSFER]) + self.pool

    def _transport(self, data: bytes) -> None:
        """Clear to send: so many packets from a number on."""
        if data[0] == ABORT and self.state == "transferring":
            self._back(f"the task controller {self.controller} broke the transfer off, reason {data[1]}")
        if data[0] != CTS or self.state != "transferring":
            return
        for number in range(data[2], data[2] + data[1]):
            part = self._stream[7 * (number - 1) : 7 * number]
            if part and self.controller is not None:
                self.send(TP_DATA, bytes([number]) + part.ljust(7, b"\xff"), self.controller)

    def _control(self, what: int, more: bytes) -> None:
        if self.controller is not None:
            self.send(TP_CONTROL, bytes([what]) + more + PROCESS_DATA.to_bytes(3, "little"), self.controller)

    def _activated(self) -> None:
        self.state = "active"
        self.events.append(f"the task controller {self.controller} has taken the description")

    def _go_on(self, error: int, what: str, then: Callable[[], None]) -> None:
        if error == 0:
            then()
        else:
            self.refused = True
            self._back(f"the task controller {self.controller} refused {what}, error {error}")

    def _back(self, why: str) -> None:
        self.events.append(why)
        self.state = "waiting"
        self.reports.clear()

    def _command(self, data: bytes, t: int, values: Mapping[int, float]) -> None:
        """A request for a value, once or by itself, or a value to set; everything else is not done."""
        how, element, ddi = data[0] & 0xF, data[0] >> 4 | data[1] << 4, data[2] | data[3] << 8
        number = int.from_bytes(data[4:8], "little", signed=True)
        asked = next((d for d in self.data if (d.element, d.ddi) == (element, ddi)), None)
        if asked is None:
            self._not_done(element, ddi, 0b00000100 if any(d.ddi == ddi for d in self.data) else 0b00000010)
        elif how == ASK_VALUE:
            self._value(element, ddi, values.get(ddi, 0.0))
        elif how == VALUE:
            if not (asked.is_set and self.put(ddi, number * asked.scale)):
                self._not_done(element, ddi, 0b00010000)
        elif how not in SUPPORTED:
            self._not_done(element, ddi, 0b00001000)
        elif number <= 0:
            self.reports.pop((element, ddi), None)
        else:
            every = max(number * 1_000_000, LEAST_INTERVAL) if how == BY_TIME else number
            self.reports[element, ddi] = _Report(how, every, float("-inf"))

    @staticmethod
    def _is_due(report: _Report, t: int, way_mm: float, raw: int) -> float | None:
        now = {BY_TIME: t, BY_WAY: way_mm, BY_CHANGE: raw}[report.how]
        return now if abs(now - report.last) >= report.every else None

    def _raw(self, ddi: int, value: float) -> int:
        scale = next(d.scale for d in self.data if d.ddi == ddi)
        return int(min(max(round(value / scale), -(2**31)), 2**31 - 1))

    def _value(self, element: int, ddi: int, value: float) -> None:
        head = bytes([VALUE | (element & 0xF) << 4, element >> 4]) + ddi.to_bytes(2, "little")
        self._tell(head + self._raw(ddi, value).to_bytes(4, "little", signed=True))

    def _not_done(self, element: int, ddi: int, why: int) -> None:
        head = bytes([NOT_DONE | (element & 0xF) << 4, element >> 4]) + ddi.to_bytes(2, "little")
        self._tell(head + bytes([why, 0xFF, 0xFF, 0xFF]))

    def _tell(self, data: bytes) -> None:
        if self.controller is not None:
            self.send(PROCESS_DATA, data, self.controller)


def object_pool(
    data: tuple[Datum, ...], name: bytes, designator: str, width_mm: int, offset_mm: int
) -> bytes:
    """The description: a device with two elements, the machine and its header, the data of each, the
    header's width (DDI 70) and how far ahead it is mounted (134), and the unit of each.
    """
    objects: list[bytes] = []
    kinds = sorted({(d.scale, d.unit) for d in data})
    first_data, first_unit = 10, 200
    unit_of = {kind: first_unit + i for i, kind in enumerate(kinds)}
    lengths = first_unit + len(kinds)
    numbers = {(d.element, d.ddi): first_data + i for i, d in enumerate(data)}
    width, offset = 100, 101
    elements = ((1, 1, "machine", 0, 0), (2, 2, "header", 1, 1))
    for number, kind, title, element, parent in elements:
        own = [n for (e, _), n in numbers.items() if e == element] + ([width, offset] if element == 1 else [])
        head = b"DET" + struct.pack("<HB", number, kind) + _text(title)
        objects.append(
            head + struct.pack("<HHH", element, parent, len(own)) + struct.pack(f"<{len(own)}H", *own)
        )
    for datum in data:
        number, unit = numbers[datum.element, datum.ddi], unit_of[datum.scale, datum.unit]
        flags = DEFAULT | SETTABLE if datum.is_set else DEFAULT
        head = b"DPD" + struct.pack("<HHBB", number, datum.ddi, flags, TRIGGERS)
        objects.append(head + _text(datum.name) + struct.pack("<H", unit))
    for number, ddi, value, title in ((width, 70, width_mm, "width"), (offset, 134, offset_mm, "ahead")):
        objects.append(
            b"DPT" + struct.pack("<HHi", number, ddi, value) + _text(title) + struct.pack("<H", lengths)
        )
    for (scale, shown), number in [*unit_of.items(), ((1e-3, "m"), lengths)]:
        objects.append(b"DVP" + struct.pack("<HifB", number, 0, scale, 3) + _text(shown))
    body = b"".join(objects)
    device = b"DVC" + struct.pack("<H", 0) + _text(designator) + _text("swath") + name + _text("1")
    return device + _label(body) + b"en\x00\x00\x00\x00\xff" + body


def _label(body: bytes) -> bytes:
    """Seven bytes that stand for a description."""
    import hashlib

    return hashlib.sha256(body).digest()[:7]


def _text(text: str) -> bytes:
    """At most 32 characters, their number first."""
    data = text.encode("ascii", "replace")[:32]
    return bytes([len(data)]) + data
