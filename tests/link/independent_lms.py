"""A client of a SICK LMS1xx or LMS5xx, written from the maker's descriptions alone: the other side in tests.

It shares nothing with the served sensor. Sources: SICK 8014631 (telegram listing), 8013796/UL20 (LMS500, 10.2
Messages, p. 76 to 94), 8013796/1ALS (LMS5xx, 3.7.1), 8023202 (LMS4400, 12.1: frames with their checksums);
the offsets of sick_scan_xd (sick_lmd_scandata_parser.cpp).
"""

import socket
import struct
from collections import deque
from dataclasses import dataclass, field

STX, ETX = b"\x02", b"\x03"
CLIENT = 0x03, 0xF4724744  # authorised client and the hash of its password
BITS = {"B": 8, "b": 8, "H": 16, "h": 16, "I": 32, "i": 32}  # as in struct
FLAGS = 0, 1


class Deviation(Exception):
    """Something is not as the maker describes it: field, offset, what was expected, what came."""

    def __init__(self, name, offset, expected, got):
        super().__init__(f"{name} at byte {offset}: expected {expected}, got {got!r}")


class Refused(Exception):
    """sFA: the sensor refuses a command; `code` as in the listing (3: unknown variable)."""

    def __init__(self, code):
        super().__init__(f"sFA {code:X}")
        self.code = code


class Fields:
    """The fields of one telegram behind its name, in either dialect."""

    def __init__(self, data, begin, *, is_binary):
        self.data, self.at, self.is_binary = data, begin, is_binary

    def take(self, name, count):
        if self.at + count > len(self.data):
            raise Deviation(name, self.at, f"{count} bytes", self.data[self.at :])
        self.at += count
        return self.data[self.at - count : self.at]

    def word(self, name, count=None):
        """CoLa A: what stands behind one space, up to the next one or `count` bytes long."""
        if self.take(name, 1) != b" ":
            raise Deviation(name, self.at - 1, "a space", self.data[self.at - 1 : self.at])
        if count is None:
            end = self.data.find(b" ", self.at)
            count = (len(self.data) if end < 0 else end) - self.at
        return self.take(name, count)

    def number(self, name, code, allowed=None):
        begin = self.at
        if self.is_binary:
            (value,) = struct.unpack(">" + code, self.take(name, struct.calcsize(code)))
        else:
            value = self._hex(name, code)
        if allowed is not None and value not in allowed:
            raise Deviation(name, begin, f"one of {allowed}", value)
        return value

    def _hex(self, name, code):
        """Upper case, no leading zeros but in a float; negative numbers as their complement of two."""
        begin, word = self.at, self.word(name)
        is_hex = word != b"" and not word.strip(b"0123456789ABCDEF")
        if code == "f":
            if not is_hex or (len(word) != 8 and word != b"0"):
                raise Deviation(name, begin, "8 hexadecimal digits of a float", word)
            return struct.unpack(">f", bytes.fromhex(word.decode().zfill(8)))[0]
        if not is_hex or (word[:1] == b"0" and word != b"0") or int(word, 16) >> BITS[code]:
            raise Deviation(name, begin, f"a hexadecimal number of {BITS[code]} bits", word)
        value = int(word, 16)
        return value - (1 << BITS[code]) if code.islower() and value >> (BITS[code] - 1) else value

    def text(self, name, count=None):
        """Of `count` characters, or behind its length."""
        if count is None:
            count = self.number(name + " length", "H")
        return (self.take(name, count) if self.is_binary else self.word(name, count)).decode("ascii")

    def end(self):
        if self.at != len(self.data):
            raise Deviation("end", self.at, "nothing more", self.data[self.at :])


@dataclass(frozen=True)
class Channel:
    scale: float
    offset: float
    start: int  # 1/10000 deg
    step: int  # 1/10000 deg
    data: tuple


@dataclass(frozen=True)
class Scan:
    """LMDscandata: times in us, frequencies in Hz."""

    kind: str  # sRA as asked for, sSN of the stream
    version: int
    device: int
    serial: int
    status: tuple
    telegrams: int
    scans: int
    since_start: int
    sent: int
    inputs: tuple
    outputs: tuple
    scan_hz: float
    shots_hz: float
    encoders: tuple
    channels16: dict = field(default_factory=dict)
    channels8: dict = field(default_factory=dict)
    time: tuple | None = None


def scan_of(kind, f):
    """8013796/UL20 p. 81 to 84, 8014631 "Read / send scan data"."""

    def pair(name):
        return f.number(name, "B"), f.number(name, "B")

    version, device = f.number("version", "H", FLAGS), f.number("device", "H")
    serial = f.number("serial", "I")
    status = f.number("status", "B", (0,)), f.number("status", "B", (0, 1, 2, 4))
    telegrams, scans = f.number("telegram counter", "H"), f.number("scan counter", "H")
    since_start, sent = f.number("time since start", "I"), f.number("time of transmission", "I")
    inputs, outputs = pair("inputs"), pair("outputs")
    f.number("layer angle", "H", (0,))  # reserved
    scan_hz = f.number("scan frequency", "I", (2500, 3500, 5000, 7500, 10000)) / 100
    shots_hz = f.number("measurement frequency", "I") * 100
    encoders = tuple(
        (f.number("encoder position", "I"), f.number("encoder speed", "H"))
        for _ in range(f.number("encoders", "H", range(4)))
    )
    channels = [_channels(f, code) for code in "HB"]
    for name in ("position", "name", "comment"):  # never asked for by this client
        f.number(name, "H", (0,))
    time = None
    if f.number("time", "H", FLAGS):
        parts = ("year", "H", range(10000)), ("month", "B", range(13)), ("day", "B", range(32))
        parts += ("hour", "B", range(24)), ("minute", "B", range(60)), ("second", "B", range(60))
        time = tuple(f.number(*part) for part in (*parts, ("microsecond", "I", range(1_000_000))))
    f.number("event", "H", (0,))
    f.end()
    return Scan(
        kind, version, device, serial, status, telegrams, scans, since_start, sent, inputs, outputs,
        scan_hz, shots_hz, encoders, *channels, time,
    )  # fmt: skip


def _channels(f, code):
    """Output channels of 16 (H) or 8 (B) bits by name."""
    found = {}
    for _ in range(f.number(f"{BITS[code]}-bit channels", "H", range(11))):
        begin, name = f.at, f.text("content", 5)
        if name[:4] not in ("DIST", "RSSI") or name[4] not in "12345" or name in found:
            raise Deviation("content", begin, "DIST1 to RSSI5, each once", name)
        scale = f.number(name + " scale", "f", (1.0, 2.0))
        offset = f.number(name + " offset", "f", (0.0,))
        start = f.number(name + " start angle", "i", range(-450_000, 2_250_001))
        step = f.number(name + " step", "H", range(1667, 10_001))
        amount = f.number(name + " amount", "H", range(1142))
        data = tuple(f.number(f"{name} {i}", code) for i in range(amount))
        found[name] = Channel(scale, offset, start, step, data)
    return found


class Lms:
    """A connection in CoLa A, or CoLa B where `is_binary`; parameters are (code of struct, value)."""

    def __init__(self, host, port, *, is_binary, timeout_s=300):
        self.is_binary = is_binary
        self.socket = socket.create_connection((host, port), timeout=timeout_s)
        self._file = self.socket.makefile("rb")
        self._scans = deque()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._file.close()
        self.socket.close()

    def send(self, command, *parameters):
        """`command` such as sRN LMDscandata."""
        data = command.encode()
        if self.is_binary:
            data += b" " * bool(parameters)
            data += b"".join(struct.pack(">" + code, value) for code, value in parameters)
            checksum = 0
            for byte in data:
                checksum ^= byte
            self.socket.sendall(STX * 4 + struct.pack(">I", len(data)) + data + bytes([checksum]))
        else:  # with a sign decimal, without one hexadecimal
            words = (f"{value:+d}" if code.islower() else f"{value:02X}" for code, value in parameters)
            self.socket.sendall(STX + b" ".join((data, *(word.encode() for word in words))) + ETX)

    def receive(self):
        """The next telegram between its frame: (type, name, fields)."""
        data = self._binary_frame() if self.is_binary else self._ascii_frame()
        if data[:3] == b"sFA":  # the listing prints it with and without the space
            f = Fields(data, 4 if self.is_binary and data[3:4] == b" " else 3, is_binary=self.is_binary)
            raise Refused(f.number("error code", "H"))
        kind, space, rest = data.partition(b" ")
        name, behind, _ = rest.partition(b" ")
        if kind not in (b"sRA", b"sWA", b"sAN", b"sEA", b"sSN") or not space or not name.isalnum():
            raise Deviation("name", 0, "sRA, sWA, sAN, sEA or sSN and a name", data[:32])
        begin = len(kind) + 1 + len(name) + (len(behind) if self.is_binary else 0)
        return kind.decode(), name.decode(), Fields(data, begin, is_binary=self.is_binary)

    def _exactly(self, count, what):
        data = self._file.read(count)
        if len(data) != count:
            raise Deviation(what, 0, f"{count} bytes", data)
        return data

    def _binary_frame(self):
        head = self._exactly(8, "frame")
        length = struct.unpack(">I", head[4:])[0]
        if head[:4] != STX * 4 or not 3 < length < 65536:
            raise Deviation("frame", 0, "4 x 02h and a length", head)
        *data, checksum = self._exactly(length + 1, "data and checksum")
        for byte in data:
            checksum ^= byte
        if checksum:
            raise Deviation("checksum", 8 + length, "the XOR of all data bytes", checksum)
        return bytes(data)

    def _ascii_frame(self):
        if (first := self._exactly(1, "frame")) != STX:
            raise Deviation("frame", 0, "02h", first)
        data = bytearray()
        while (byte := self._exactly(1, "frame")) != ETX:
            data += byte
        if not data.isascii() or min(data, default=0) < 0x20:
            raise Deviation("frame", 1, "printable ASCII", bytes(data[:64]))
        return bytes(data)

    def ask(self, command, *parameters):
        """The fields of the answer; scans of the stream that come before it are kept for `scan`."""
        self.send(command, *parameters)
        kind, _, name = command.partition(" ")
        expected = {"sRN": "sRA", "sWN": "sWA", "sMN": "sAN", "sEN": "sEA"}[kind], name
        while True:
            *got, fields = self.receive()
            if tuple(got) == expected:
                return fields
            if got != ["sSN", "LMDscandata"]:
                raise Deviation("answer", 0, expected, got)
            self._scans.append(scan_of("sSN", fields))

    def done(self, command, *parameters, result=None):
        """A command whose answer has no parameter, or one that must be `result`: (code, allowed values)."""
        f = self.ask(command, *parameters)
        if result:
            f.number("result", *result)
        elif f.data[f.at :] == b" ":  # as sensors end an answer without parameters
            f.at += 1
        f.end()

    def login(self):
        self.done("sMN SetAccessMode", ("B", CLIENT[0]), ("I", CLIENT[1]), result=("B", (1,)))

    def run(self):
        """Logs out; only then a sensor measures again."""
        self.done("sMN Run", result=("B", FLAGS))

    def state(self):
        return self.ask("sRN STlms").number("state", "H", range(8))

    def identity(self):
        f = self.ask("sRN DeviceIdent")
        found = f.text("name"), f.text("version")
        f.end()
        return found

    def scan_config(self, wanted=None):
        """(frequency [1/100 Hz], step, start, stop [1/10000 deg]), read or set."""
        if wanted is None:
            f = self.ask("sRN LMPscancfg")
        else:
            frequency, step, start, stop = wanted
            sent = ("i", frequency), ("h", 1), ("i", step), ("i", start), ("i", stop)
            f = self.ask("sMN mLMPsetscancfg", *sent)
            f.number("status", "B", (0,))
        frequency = f.number("frequency", "I", (2500, 3500, 5000, 7500, 10000))
        f.number("segments", "H", (1,))
        found = frequency, f.number("step", "I"), f.number("start", "i"), f.number("stop", "i")
        f.end()
        return found

    def output_range(self, wanted=None):
        """(step, start, stop) [1/10000 deg], read or set."""
        if wanted is not None:
            self.done("sWN LMPoutputRange", ("h", 1), *(("i", value) for value in wanted))
            return wanted
        f = self.ask("sRN LMPoutputRange")
        f.number("segments", "H", (1,))
        found = f.number("step", "I"), f.number("start", "i"), f.number("stop", "i")
        f.end()
        return found

    def data_config(self, *, rssi_bits=0, every=1):
        """DIST1 and, of 8 or 16 bits, RSSI1; no encoder, position, name, comment or time."""
        channel, rssi = (("B", 1), ("B", 0)), (("B", int(rssi_bits > 0)), ("B", int(rssi_bits == 16)))
        self.done("sWN LMDscandatacfg", *channel, *rssi, *(("B", 0),) * 7, ("h", every))

    def first_echo(self):
        self.done("sWN FREchoFilter", ("B", 0))

    def stream(self, *, is_on):
        self.done("sEN LMDscandata", ("B", int(is_on)), result=("B", (int(is_on),)))

    def scan(self):
        """The next of the stream."""
        if self._scans:
            return self._scans.popleft()
        *got, fields = self.receive()
        if got != ["sSN", "LMDscandata"]:
            raise Deviation("stream", 0, "sSN LMDscandata", got)
        return scan_of("sSN", fields)

    def one_scan(self):
        return scan_of("sRA", self.ask("sRN LMDscandata"))
