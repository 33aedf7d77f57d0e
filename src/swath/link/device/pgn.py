"""Messages between AgOpenGPS and its steering module, in datagrams.

80 81, source, number (PGN), length, data, sum of the bytes from the source on; low byte first. Source:
`docs/pgn-protocol.md` and `SourceCode/AgIO/Source/Forms/NMEA.Designer.cs` of
github.com/AgOpenGPS-Official/AgOpenGPS; the module's side: `ArduinoModules/UDP/Autosteer_UDP_v5` of
github.com/AgOpenGPS-Official/Boards. Steering angles there are > 0 to the right, here > 0 to the left.
"""

import math
from dataclasses import dataclass
from functools import reduce
from operator import add

HEAD = b"\x80\x81"
FROM_MODULE = 0x7E
STEER_DATA, STEER_RESPONSE, HELLO = 254, 253, 200
LISTENS, ANSWERS_TO = 8888, 9999  # ports of the module and of AgOpenGPS
NO_HEADING, NO_ROLL = 9999, 8888
SLOWEST = 0.1 / 3.6  # below this speed the module does not steer [m/s]
WATCHDOG_MS = 2500.0  # 100 rounds of 25 ms without PGN 254, and the module lets go
STEER_SWITCH_OFF = 2  # bit of the switches: a person must steer


@dataclass(frozen=True)
class SteerData:
    """PGN 254. speed [m/s]; is_on: it steers; angle: wanted, > 0 turns left [rad]."""

    speed: float
    is_on: bool
    angle: float


def framed(source: int, number: int, data: bytes) -> bytes:
    """A message."""
    body = bytes([source, number, len(data)]) + data
    return HEAD + body + bytes([_check(body)])


def unframed(data: bytes) -> tuple[int, int, bytes] | None:
    """Source, number and data of a message; None where it is none.

    The hello of AgIO ends on a constant 47h, not on its sum (`AgIO/Source/Forms/UDP.designer.cs`).
    """
    if len(data) < 6 or data[:2] != HEAD or len(data) != 6 + data[4]:
        return None
    if data[3] != HELLO and _check(data[2:-1]) != data[-1]:
        return None
    return data[2], data[3], data[5:-1]


def read_steer_data(data: bytes) -> SteerData | None:
    """PGN 254 out of its data."""
    if len(data) != 8:
        return None
    angle = int.from_bytes(data[3:5], "little", signed=True)
    return SteerData(
        int.from_bytes(data[:2], "little") / 36.0, bool(data[2] & 1), -math.radians(angle * 0.01)
    )


def steer_response(angle: float, *, is_free: bool) -> bytes:
    """PGN 253. angle: of the wheels, > 0 turns left [rad], nan = not known; is_free: it may steer."""
    switches = 0 if is_free else STEER_SWITCH_OFF
    heading, roll = NO_HEADING.to_bytes(2, "little"), NO_ROLL.to_bytes(2, "little")
    data = _hundredths(angle) + heading + roll + bytes([switches, 0])
    return framed(FROM_MODULE, STEER_RESPONSE, data)


def hello(angle: float) -> bytes:
    """The module's answer to a hello of AgOpenGPS."""
    return framed(FROM_MODULE, FROM_MODULE, _hundredths(angle) + bytes(3))


def _check(body: bytes) -> int:
    """The low byte of the sum."""
    return reduce(add, body, 0) & 0xFF


def _hundredths(angle: float) -> bytes:
    """An angle [rad] as the other side counts it."""
    value = 0 if math.isnan(angle) else -round(math.degrees(angle) * 100.0)
    return max(-(1 << 15), min((1 << 15) - 1, value)).to_bytes(2, "little", signed=True)
