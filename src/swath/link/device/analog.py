"""An analogue steering signal as samples of a converter: NMEA 0183 XDR, `$IIXDR,U,2.5012,V,STEER*hh`.

A box that sees the crop edge gives the steering angle it wants as a voltage; what reaches a computer are a
converter's samples. XDR: a transducer's type U (voltage), value, unit V, name (E. S. Raymond, NMEA Revealed,
gpsd.gitlab.io/gpsd/NMEA.html).
"""

import json
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import Annotated

from annotated_types import Ge, Gt, Le

from swath.core.errors import InputError
from swath.documents.validation import validate
from swath.documents.yaml_document import Document
from swath.link.device.nmea import body_of, sentence

PORT = 10_112  # not assigned by IANA
OFF = 0.0  # of a line that is cut, or of a box that does not steer: pulled to ground [V]
Volts = Annotated[float, Ge(0), Le(48)]


@dataclass(frozen=True)
class Line:
    """left_v, right_v: volts at full steering angle; linear in between, their middle drives straight on.

    fault_below_v, fault_above_v: beyond these the line is cut or shorted, and nobody steers; from there to
        full angle it is full angle. Estimated: half way to ground and to a supply of 5 V
    range_v, bits: of the converter, whose steps are range_v / (2^bits - 1); estimated
    full_deg: full angle of one wheel per axle, null = the machine's
    """

    left_v: Volts = 4.6
    right_v: Volts = 0.4
    fault_below_v: Volts = 0.2
    fault_above_v: Volts = 4.8
    range_v: Annotated[float, Gt(0), Le(48)] = 5.0
    bits: Annotated[int, Ge(4), Le(24)] = 12
    full_deg: Annotated[float, Gt(0), Le(80)] | None = None

    def __post_init__(self) -> None:
        """InputError where a side, or a fault, has no volts left."""
        low, high = sorted((self.left_v, self.right_v))
        if not OFF < self.fault_below_v <= low < high <= self.fault_above_v < self.range_v:
            expected = (
                f"expected 0 < fault_below_v {self.fault_below_v:g} <= left_v, right_v {self.right_v:g} <= "
                f"fault_above_v {self.fault_above_v:g} < range_v {self.range_v:g}, and two unlike sides"
            )
            raise InputError("left_v", self.left_v, expected)

    def sampled(self, volts: float) -> float:
        """What the converter makes of it [V]."""
        steps = (1 << self.bits) - 1
        return min(max(round(volts / self.range_v * steps), 0), steps) * self.range_v / steps

    def volts(self, angle: float, max_steer: float) -> float:
        """Of a steering angle [rad], > 0 left, nan = it does not steer; beyond full angle it is full."""
        if math.isnan(angle):
            return OFF
        share = min(max(angle / self._full(max_steer), -1.0), 1.0)
        return self.sampled(0.5 * (self.left_v + self.right_v) + 0.5 * share * (self.left_v - self.right_v))

    def angle(self, volts: float, max_steer: float) -> float:
        """Steering angle [rad] of a voltage, > 0 left; nan in a fault band."""
        if not self.fault_below_v <= volts <= self.fault_above_v:
            return math.nan
        share = (2.0 * self.sampled(volts) - self.left_v - self.right_v) / (self.left_v - self.right_v)
        return min(max(share, -1.0), 1.0) * self._full(max_steer)

    def _full(self, max_steer: float) -> float:
        return max_steer if self.full_deg is None else math.radians(self.full_deg)


OPTIONS = tuple(field.name for field in fields(Line))


def line_of(options: Mapping[str, str]) -> Line:
    """The line of an address. InputError."""
    given: dict[str, object] = {name: options[name] for name in OPTIONS if name in options}
    for name in given:
        with suppress(ValueError):  # what is no number is refused below
            given[name] = json.loads(options[name])
    line, errors = validate(Line, given, (), Document(None))
    if errors:
        raise errors[0]
    assert isinstance(line, Line)
    return line


def written(volts: float) -> bytes:
    """A sample [V] as a sentence."""
    return sentence(f"IIXDR,U,{volts:.5f},V,STEER")


def read(line: bytes) -> float:
    """The sample [V] of a sentence, the first voltage in it. ValueError where it has none, or is broken."""
    body, is_checked = body_of(line)
    name, *words = body.decode("ascii").split(",")
    found = [float(words[n + 1]) for n in range(0, len(words) - 3, 4) if words[n] + words[n + 2] == "UV"]
    if name[2:] != "XDR" or not is_checked or not found or not math.isfinite(found[0]):
        raise ValueError("no voltage")
    return found[0]
