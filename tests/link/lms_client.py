"""A client for a SICK LMS, written from the vendor's telegram listing (8014631, 8023198) alone.

It shares no code with swath and reads strictly: every field of LMDscandata, in its order, nothing left over.
"""

import socket
import struct

PASSWORD = 0xF4724744  # authorised client


class Lms:
    def __init__(self, port, binary):
        self.socket = socket.create_connection(("127.0.0.1", port), 5.0)
        self.socket.settimeout(5.0)
        self.binary, self.rest = binary, b""

    def close(self):
        self.socket.close()

    def send(self, text, parameters=b""):
        """text: as CoLa A says it; parameters: the same as bytes, for CoLa B"""
        if not self.binary:
            self.socket.sendall(b"\x02" + text.encode() + b"\x03")
            return
        command = " ".join(text.split(" ")[:2]).encode()
        content = command + (b" " + parameters if parameters else b"")
        check = 0
        for byte in content:
            check ^= byte
        self.socket.sendall(b"\x02\x02\x02\x02" + struct.pack(">I", len(content)) + content + bytes([check]))

    def receive(self):
        """The content of the next telegram."""
        while True:
            if not self.binary and b"\x03" in self.rest:
                assert self.rest[0] == 2, self.rest[:20]
                content, _, self.rest = self.rest[1:].partition(b"\x03")
                return content
            if self.binary and len(self.rest) >= 8:
                assert self.rest[:4] == b"\x02\x02\x02\x02", self.rest[:20]
                (length,) = struct.unpack(">I", self.rest[4:8])
                if len(self.rest) >= 9 + length:
                    content, check = self.rest[8 : 8 + length], self.rest[8 + length]
                    for byte in content:
                        check ^= byte
                    assert check == 0
                    self.rest = self.rest[9 + length :]
                    return content
            data = self.socket.recv(1 << 16)
            assert data, "the sensor has closed the connection"
            self.rest += data

    def ask(self, text, parameters=b""):
        self.send(text, parameters)
        return self.receive()

    def login(self):
        answer = self.ask("sMN SetAccessMode 03 F4724744", struct.pack(">bI", 3, PASSWORD))
        assert answer == (b"sAN SetAccessMode \x01" if self.binary else b"sAN SetAccessMode 1"), answer

    def subscribe(self, on=True):
        answer = self.ask(f"sEN LMDscandata {int(on)}", bytes([on]))
        wanted = b"sEA LMDscandata " + (bytes([on]) if self.binary else str(int(on)).encode())
        assert answer == wanted, answer

    def scan(self):
        """The next telegram, which must be a scan."""
        content = self.receive()
        return parse(content, self.binary)


class _Text:
    def __init__(self, words):
        self.words = words

    def number(self, size, signed=False):
        value = int(self.words.pop(0), 16)
        assert value < 1 << 8 * size
        return value - (1 << 8 * size) if signed and value >> (8 * size - 1) else value

    def real(self):
        return struct.unpack(">f", bytes.fromhex(self.words.pop(0).decode().zfill(8)))[0]

    def name(self):
        return self.words.pop(0).decode()

    def left(self):
        return len(self.words)


class _Bytes:
    def __init__(self, data):
        self.data = data

    def take(self, count):
        assert len(self.data) >= count
        taken, self.data = self.data[:count], self.data[count:]
        return taken

    def number(self, size, signed=False):
        return int.from_bytes(self.take(size), "big", signed=signed)

    def real(self):
        return struct.unpack(">f", self.take(4))[0]

    def name(self):
        return self.take(5).decode()

    def left(self):
        return len(self.data)


def parse(content, binary):
    """A scan as a dict; channels: name -> (scale, offset, start [deg], step [deg], numbers)."""
    head, name, rest = content.split(b" ", 2)
    assert name == b"LMDscandata", content[:40]
    assert head in (b"sSN", b"sRA"), head
    read = _Bytes(rest) if binary else _Text(rest.split(b" "))
    scan = {"version": read.number(2), "device": read.number(2), "serial": read.number(4)}
    scan["status"] = read.number(1), read.number(1)
    scan["telegrams"], scan["scans"] = read.number(2), read.number(2)
    scan["since_start_us"], scan["sent_us"] = read.number(4), read.number(4)
    scan["inputs"], scan["outputs"] = (read.number(1), read.number(1)), (read.number(1), read.number(1))
    scan["layer"], scan["frequency_hz"] = read.number(2), read.number(4) / 100
    scan["measurements_hz"] = read.number(4) * 100
    assert read.number(2) == 0, "no encoder"
    scan["channels"] = {}
    for size in (2, 1):
        for _ in range(read.number(2)):
            channel = read.name()
            scale, offset = read.real(), read.real()
            start, step, count = read.number(4, signed=True) / 1e4, read.number(2) / 1e4, read.number(2)
            numbers = [read.number(size) for _ in range(count)]
            scan["channels"][channel] = (scale, offset, start, step, numbers)
    assert [read.number(2) for _ in range(5)] == [0] * 5, "no position, name, comment, time, event"
    assert read.left() == 0
    return scan
