"""AgIO, the side of AgOpenGPS that talks to receiver and steer module, written from its source alone.

It shares nothing with the served receiver and module. Sources: AgOpenGPS-Official/AgOpenGPS, SourceCode: AgIO
Forms/NMEA.Designer.cs (ParsePANDA, ParseOGI, ValidateChecksum) and Forms/UDP.designer.cs (PGN 200, 126), GPS
Forms/PGN.Designer.cs (CPGN_FE, CPGN_FD), Forms/Position.designer.cs (how 254 is filled) and
Forms/UDPComm.Designer.cs (253, 70 ms between positions); AgOpenGPS-Official/Boards,
AIO_v4_Firmware (BuildNmea, Autosteer.ino).
"""

import re
from dataclasses import dataclass

KMH_PER_KNOT = 1.852
NO_IMU = 65535
HELLO = bytes((0x80, 0x81, 0x7F, 200, 3, 56, 0, 0, 0x47))  # AgIO's own bytes; their last is not the checksum
_WHOLE = re.compile(r"[+-]?\d+(\.0*)?")  # what short.TryParse with NumberStyles.Float takes
_REAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)")


class Deviation(Exception):
    """Something is not as AgOpenGPS reads it: field, its number or offset, what was expected, what came."""

    def __init__(self, name, at, expected, got):
        super().__init__(f"{name} ({at}): expected {expected}, got {got!r}")


@dataclass(frozen=True)
class Position:
    """A sentence; angles [deg], heading clockwise from north, roll > 0 right side down, nose up > 0."""

    kind: str
    time_s: float  # of the day
    latitude: float
    longitude: float
    quality: int
    satellites: int
    hdop: float
    altitude: float
    age: float
    speed_kmh: float
    heading: float | None
    roll: float | None
    pitch: float | None
    yaw_rate: float | None


def position_of(datagram):
    """The $PANDA or $PAOGI that a datagram holds, one and whole."""
    try:
        text = datagram.decode("ascii")
    except UnicodeDecodeError as error:
        raise Deviation("sentence", error.start, "ASCII", datagram) from None
    if len(text) > 301:  # AgIO throws its buffer away
        raise Deviation("sentence", 301, "at most 301 characters", text)
    match = re.fullmatch(r"\$([^$*\r\n]*)\*([0-9A-F]{2})\r\n", text)
    if not match:
        raise Deviation("sentence", 0, "$...*HH and CR LF", text)
    checksum = 0
    for character in match[1]:
        checksum ^= ord(character)
    if f"{checksum:02X}" != match[2]:
        raise Deviation("checksum", len(text) - 4, f"{checksum:02X}", match[2])
    words = match[1].split(",")
    if words[0] not in ("PANDA", "PAOGI") or len(words) != 16:
        raise Deviation("sentence", 0, "PANDA or PAOGI and 15 fields", words)
    has_imu = words[0] == "PAOGI" or words[12] != str(NO_IMU)
    heading, roll, pitch, yaw_rate = _panda(words) if words[0] == "PANDA" else _paogi(words)
    if not re.fullmatch(r"([01]\d|2[0-3])[0-5]\d[0-5]\d(\.\d+)?", words[1]):
        raise Deviation("time", 1, "hhmmss.ss", words[1])
    return Position(
        words[0],
        int(words[1][:2]) * 3600 + int(words[1][2:4]) * 60 + float(words[1][4:]),
        _angle("latitude", words, 2, "NS", 90),
        _angle("longitude", words, 4, "EW", 180),
        int(_number("fix quality", words, 6, 0, 8, _WHOLE)),
        int(_number("satellites", words, 7, 0, 65534, _WHOLE)),
        _number("HDOP", words, 8, 0, 655.34),
        _number("altitude", words, 9, -1000, 10_000),
        _number("age", words, 10, 0, 655.34) if words[10] else 0.0,
        _number("speed", words, 11, -200, 200) * KMH_PER_KNOT,
        *((heading, roll, pitch, yaw_rate) if has_imu else (None,) * 4),
    )


def _panda(words):
    """Heading and roll in tenths, all whole: AgIO reads them as ushort and short, else as 0."""
    whole = _WHOLE if words[12] != str(NO_IMU) else re.compile(r"([+-]?\d+(\.0*)?)?")
    top = 3599 if words[12] != str(NO_IMU) else NO_IMU
    heading = _number("heading", words, 12, 0, top, _WHOLE) / 10
    names = enumerate(("roll", "pitch", "yaw rate"), 13)
    roll, pitch, yaw_rate = (_number(name, words, i, -32767, 32766, whole) for i, name in names)
    return heading, roll / 10, pitch, yaw_rate


def _paogi(words):
    heading = _number("heading", words, 12, 0, 359.99999)
    return heading, *(
        _number(name, words, i, -180, 180) if words[i] else None
        for i, name in enumerate(("roll", "pitch", "yaw rate"), 13)
    )


def _number(name, words, i, low, high, form=_REAL):
    if not form.fullmatch(words[i]) or not low <= float(words[i] or 0) <= high:
        raise Deviation(name, i, f"{low} to {high}", words[i])
    return float(words[i] or 0)


def _angle(name, words, i, signs, top):
    """Degrees of ddmm.mmm and a letter."""
    digits = 2 if top == 90 else 3
    if not re.fullmatch(rf"\d{{{digits}}}[0-5]\d\.\d+", words[i]) or words[i + 1] not in tuple(signs):
        raise Deviation(name, i, f"{'d' * digits}mm.mmm and one of {signs}", words[i : i + 2])
    degrees = int(words[i][:digits]) + float(words[i][digits:]) / 60
    if degrees > top:
        raise Deviation(name, i, f"at most {top} degrees", words[i])
    return degrees if words[i + 1] == signs[0] else -degrees


def steer_command(angle_deg, *, speed_kmh, is_on, line_distance_mm=None):
    """PGN 254: the wanted steering angle, > 0 to the right, as FormGPS fills it."""
    distance = 255 if line_distance_mm is None else max(-127, min(127, int(line_distance_mm * 0.05))) + 127
    speed, angle = int(abs(speed_kmh) * 10), round(angle_deg * 100)
    payload = speed.to_bytes(2, "little") + bytes([is_on]) + angle.to_bytes(2, "little", signed=True)
    return _with_sum(bytes((0x80, 0x81, 0x7F, 0xFE, 8, *payload, distance, 0, 0)))


@dataclass(frozen=True)
class SteerAnswer:
    """PGN 253; heading and roll None where the module has no IMU."""

    angle_deg: float
    heading_deg: float | None
    roll_deg: float | None
    is_work_switch_high: bool
    is_steer_switch_high: bool  # high: off
    pwm: int


def answer_of(datagram):
    data = _checked(datagram, 0xFD, 14)
    angle, heading, roll = (int.from_bytes(data[i : i + 2], "little", signed=True) for i in (5, 7, 9))
    if heading != 9999 and not 0 <= heading < 3600:
        raise Deviation("heading", 7, "9999 or tenths of a degree", heading)
    if roll != 8888 and not -1800 <= roll <= 1800:
        raise Deviation("roll", 9, "8888 or tenths of a degree", roll)
    if data[11] > 7:
        raise Deviation("switches", 11, "bits 0 to 2", data[11])
    return SteerAnswer(
        angle / 100,
        None if heading == 9999 else heading / 10,
        None if roll == 8888 else roll / 10,
        bool(data[11] & 1),
        bool(data[11] & 2),
        data[12],
    )


def hello_angle_of(datagram):
    """PGN 126, the module's answer to `HELLO`: its angle [deg]; the sum is a fixed 71 in the firmware."""
    if datagram[:5] != bytes((0x80, 0x81, 126, 126, 5)) or len(datagram) != 11:
        raise Deviation("hello", 0, "80 81 7E 7E 05 and 11 bytes", datagram)
    return int.from_bytes(datagram[5:7], "little", signed=True) / 100


def _checked(datagram, pgn, length):
    if datagram[:2] != b"\x80\x81" or len(datagram) != length or datagram[4] != length - 6:
        raise Deviation("message", 0, f"80 81 and {length} bytes, their count in byte 4", datagram)
    if datagram[2] != 126 or datagram[3] != pgn:
        raise Deviation("message", 2, f"source 126, PGN {pgn}", tuple(datagram[2:4]))
    if _with_sum(datagram[:-1]) != datagram:
        raise Deviation("checksum", length - 1, sum(datagram[2:-1]) & 0xFF, datagram[-1])
    return datagram


def _with_sum(data):
    return data + bytes((sum(data[2:]) & 0xFF,))
