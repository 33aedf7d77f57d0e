"""A Laser Pilot box of your own, without a line of swath: scanner in over TCP, steering out over UDP.

    python examples/devices/my_box.py --telegrams CoLaB &
    swath run examples/devices/wire.yaml

It logs in to a SICK LMS, wants every scan, finds the crop edge in it and sends the steering angle as
AgOpenGPS does (PGN 254); with `--can udp_multicast`, or another interface of python-can, as the guidance
command of ISO 11783, with `--volts HOST:PORT` as a voltage. The same two functions run inside swath in
`examples/devices/memory.yaml`, by `examples/devices/in_memory.py`: what the wire adds is the difference of
the two runs.
"""

import argparse
import math
import socket
import statistics
import struct
import threading
import time

import numpy as np

HEIGHT, PITCH = 2.4, math.radians(16.0)  # of the scanner above the ground; it looks down [m, rad]
AHEAD_OF_AXLE, WHEELBASE = 4.0, 3.9  # of the scanner; of the machine [m]
STAND = 0.45  # what is higher is crop [m]
OVERLAP = 0.10  # how far the header end, where the scanner sits, is to be outside the crop [m]
STEER_MAX = math.radians(35.0)


def crop_edge(azimuth: np.ndarray, ranges: np.ndarray) -> tuple[float, float] | None:
    """(ahead, left) of the edge from the scanner [m], the crop to its right; None where there is none.

    The place that leaves the fewest high echoes to the left of it and the fewest low ones to its right.
    """
    seen = ranges > 0.0
    forward, left = ranges[seen] * np.cos(azimuth[seen]), ranges[seen] * np.sin(azimuth[seen])
    ahead = forward * math.cos(PITCH)
    height = HEIGHT - forward * math.sin(PITCH)
    near = np.abs(left) < 4.0
    ahead, left, is_crop = ahead[near], left[near], height[near] > STAND
    if is_crop.sum() < 5 or (~is_crop).sum() < 5:
        return None
    order = np.argsort(left)
    is_crop, left, ahead = is_crop[order], left[order], ahead[order]
    wrong = np.cumsum(~is_crop) + is_crop.sum() - np.cumsum(is_crop)  # edge behind the n-th from the right
    place = int(np.argmin(wrong[:-1]))
    return float(np.median(ahead[~is_crop])), 0.5 * float(left[place] + left[place + 1])


def steering_angle(edge: tuple[float, float]) -> float:
    """Of a circle from the fixed axle that brings the header end to the edge, > 0 to the left [rad]."""
    ahead, left = edge
    way = AHEAD_OF_AXLE + ahead
    curvature = 2.0 * (left + OVERLAP) / (way * way)
    return max(-STEER_MAX, min(STEER_MAX, math.atan(curvature * WHEELBASE)))


class Smooth:
    """The angle, smoothed from scan to scan; held where there is no edge."""

    def __init__(self, share: float = 0.25) -> None:
        self.share, self.angle = share, None

    def __call__(self, edge: tuple[float, float] | None) -> float | None:
        if edge is not None:
            new = steering_angle(edge)
            self.angle = new if self.angle is None else self.angle + self.share * (new - self.angle)
        return self.angle


def main() -> None:
    parser = argparse.ArgumentParser(description="a box between a SICK LMS and a steering module")
    parser.add_argument("--scanner", default="127.0.0.1:2111", help="host:port of the LMS")
    parser.add_argument("--module", default="127.0.0.1:8888", help="host:port of the steering module")
    parser.add_argument("--can", metavar="INTERFACE", help="steer over CAN instead, by python-can")
    parser.add_argument("--channel", default="239.74.163.2", help="of the CAN interface")
    parser.add_argument("--can-port", type=int, help="of udp_multicast")
    parser.add_argument("--volts", metavar="HOST:PORT", help="steer by a voltage instead")
    parser.add_argument("--telegrams", choices=("CoLaA", "CoLaB"), default="CoLaB")
    parser.add_argument("--speed", type=float, default=7.0, help="told to the module [km/h]")
    args = parser.parse_args()
    out: Module | Can | Voltage = Module(args.module, args.speed)
    if args.can:
        out = Can(args.can, args.channel, args.can_port)
    elif args.volts:
        out = Voltage(args.volts)
    link = Scanner(args.scanner, binary=args.telegrams == "CoLaB")
    smooth, lags, intervals, last = Smooth(), [], [], None
    while (scan := link.scan()) is not None:
        came = time.monotonic()
        angle = smooth(crop_edge(*scan))
        if angle is not None:
            out.steer(angle)
            lags.append(time.monotonic() - came)
        if last is not None:
            intervals.append(came - last)
        last = came
    if len(intervals) > 10:
        median, p99 = (
            1e3 * f(intervals) for f in (statistics.median, lambda x: sorted(x)[len(x) * 99 // 100])
        )
        print(f"{len(intervals)} scans, every {median:.1f} ms, p99 {p99:.1f} ms")
        print(f"answered within {1e3 * statistics.median(lags):.2f} ms, {1e3 * max(lags):.2f} ms at most")


class Module:
    """A steering module of AgOpenGPS. speed: told to it [km/h]."""

    def __init__(self, where: str, speed: float) -> None:
        host, _, port = where.rpartition(":")
        self.where, self.speed = (host, int(port)), speed
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def steer(self, angle: float) -> None:
        """PGN 254: speed, on, angle > 0 to the right there."""
        numbers = round(10 * self.speed), 1, -round(math.degrees(angle) * 100)
        body = struct.pack("<BBBHBhBBB", 0x7F, 254, 8, *numbers, 255, 0, 0)
        self.socket.sendto(b"\x80\x81" + body + bytes([sum(body) & 0xFF]), self.where)


class Can:
    """A machine that steers by the guidance command of ISO 11783-7 (PGN 44288)."""

    ADDRESS, COMMAND, STATUS, CLAIMED = 28, 0xAD00, 0xAC00, 0xEE00

    def __init__(self, interface: str, channel: str, port: int | None) -> None:
        import can

        options = {"fd": False, **({"port": port} if port else {})} if interface == "udp_multicast" else {}
        self.can, self.bus = can, can.Bus(interface=interface, channel=channel, **options)
        self.must_release = False
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self) -> None:
        """Claim the address five times a second; hear whether the machine wants us to let go once."""
        due = time.monotonic()
        while True:
            if time.monotonic() >= due:
                self.send(self.CLAIMED, 6, (1 << 63 | 2 << 60 | 255 << 40 | 1234).to_bytes(8, "little"))
                due = time.monotonic() + 0.2
            frame = self.bus.recv(0.2)
            if frame is not None and frame.arbitration_id >> 16 & 0x3FF == self.STATUS >> 8:
                self.must_release = frame.data[2] >> 6 == 1

    def steer(self, angle: float) -> None:
        """Curvature [1/km], > 0 to the right there, in steps of 0.25 from -8032 on; 1 = we steer."""
        curvature = round((-1000.0 * math.tan(angle) / WHEELBASE + 8032.0) / 0.25)
        steers = 0xFC | int(not self.must_release)
        self.send(self.COMMAND, 3, struct.pack("<HB", curvature, steers) + b"\xff" * 5)

    def send(self, pgn: int, priority: int, data: bytes) -> None:
        identifier = priority << 26 | (pgn | 0xFF) << 8 | self.ADDRESS
        self.bus.send(self.can.Message(arbitration_id=identifier, data=data))


class Voltage:
    """An input for 0.4 (full right) to 4.6 V, behind a converter whose samples are NMEA 0183 XDR."""

    def __init__(self, where: str) -> None:
        host, _, port = where.rpartition(":")
        self.where, self.socket = (host, int(port)), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def steer(self, angle: float) -> None:
        """Volts of the angle."""
        body = f"IIXDR,U,{2.5 + 2.1 * angle / STEER_MAX:.4f},V,STEER"
        check = 0
        for byte in body.encode():
            check ^= byte
        self.socket.sendto(f"${body}*{check:02X}\r\n".encode(), self.where)


class Scanner:
    """A SICK LMS: CoLa A is text between 02 and 03, CoLa B has 02 02 02 02, a length and a checksum."""

    def __init__(self, where: str, binary: bool) -> None:
        host, _, port = where.rpartition(":")
        self.binary, self.rest = binary, b""
        for _ in range(300):
            try:
                self.link = socket.create_connection((host, int(port)), timeout=10.0)
                break
            except ConnectionRefusedError:
                time.sleep(0.2)
        else:
            raise SystemExit(f"there is no scanner at {where}")
        self.link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.ask("sMN SetAccessMode 03 F4724744", struct.pack(">bI", 3, 0xF4724744))
        self.ask("sMN Run", b"")
        self.ask("sEN LMDscandata 1", b"\x01")

    def ask(self, text: str, parameters: bytes) -> None:
        if self.binary:
            content = " ".join(text.split()[:2]).encode() + (b" " + parameters if parameters else b"")
            check = 0
            for byte in content:
                check ^= byte
            self.link.sendall(b"\2\2\2\2" + struct.pack(">I", len(content)) + content + bytes([check]))
        else:
            self.link.sendall(b"\2" + text.encode() + b"\3")
        self.telegram()

    def telegram(self) -> bytes | None:
        """The next one; None when the scanner is gone."""
        while True:
            if self.binary and len(self.rest) >= 8:
                end = 9 + struct.unpack(">I", self.rest[4:8])[0]
                if len(self.rest) >= end:
                    content, self.rest = self.rest[8 : end - 1], self.rest[end:]
                    return content
            elif not self.binary and b"\3" in self.rest:
                content, _, self.rest = self.rest[1:].partition(b"\3")
                return content
            try:
                data = self.link.recv(1 << 16)
            except OSError:
                return None
            if not data:
                return None
            self.rest += data

    def scan(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Azimuth, 0 ahead [rad], and range [m], 0 = no echo, of the newest scan."""
        content = self.telegram()
        if content is None:
            return None
        if self.binary:  # 60 bytes from the command to the first channel, whose name is DIST1
            at = content.index(b"DIST1") + 5
            scale, _, start, step, count = struct.unpack(">ffiHH", content[at : at + 16])
            values = np.frombuffer(content[at + 16 : at + 16 + 2 * count], ">u2").astype(float)
        else:
            words = content.split(b" ")
            at = words.index(b"DIST1") + 1
            (scale,) = struct.unpack(">f", bytes.fromhex(words[at].decode()))
            start, step, count = (int(word, 16) for word in words[at + 2 : at + 5])
            start -= (1 << 32) if start >> 31 else 0
            values = np.array([int(word, 16) for word in words[at + 5 : at + 5 + count]], float)
        azimuth = np.radians((start + step * np.arange(len(values))) * 1e-4 - 90.0)
        return azimuth, values * scale * 1e-3


if __name__ == "__main__":
    main()
