"""GNSS as NMEA 0183 sentences: GGA, VTG, RMC, HDT, THS, GST, and PANDA and PAOGI of AgOpenGPS.

Courses and headings are from true north: the grid's convergence is taken off. Heights are above the
ellipsoid, told as a geoid separation of 0. Sources: NMEA 0183 as in the receivers' manuals (u-blox M8
interface description UBX-13003221, 31); PANDA and PAOGI as AgOpenGPS reads them,
`AgIO/Source/Forms/NMEA.Designer.cs` (github.com/AgOpenGPS-Official/AgOpenGPS), 65535 = no IMU as its
firmware sends it.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import reduce
from operator import xor
from typing import Any

from swath.signals import Fix

TALKER = "GN"
SENTENCES = ("GGA", "VTG", "RMC", "GST", "HDT", "THS", "PANDA", "PAOGI")
USUAL = ("GGA", "VTG", "RMC", "GST", "HDT")
KNOT = 1852.0 / 3600.0  # m/s
FOOT = 0.3048  # m
BEGUN = "2026-07-15T10:00:00Z"  # the receiver's clock where a run begins, unless it is stated
GGA_QUALITY = (0, 1, 2, 5, 4)  # by number of a Fix: none, single, dgps, float, fix
FIX_QUALITY = {0: 0, 1: 1, 2: 2, 3: 1, 4: 4, 5: 3, 9: 2}
RMC_MODE = "NADFR"
LONGEST = 4096  # bytes without an end of line
MOST_WORDS = 15  # of a sentence that is read
DAY_S = 86_400.0
SILENT_S = 2.0  # without a position of the source that counts, after which another's counts
APART_M = 0.2  # between two positions of one time, more than the last of four digits of a minute
EARTH_M = 6_371_000.0  # mean radius
CARRIER = 3  # quality of a Fix from which on it is one of carrier phase

Fields = dict[str, Any]  # fields of an Epoch


def utc_of(text: str) -> datetime:
    """A date and time of ISO 8601. ValueError where it is none."""
    at = datetime.fromisoformat(text)
    return at.replace(tzinfo=UTC) if at.tzinfo is None else at.astimezone(UTC)


def sentence(body: str) -> bytes:
    """A sentence with its checksum and end of line."""
    return f"${body}*{reduce(xor, body.encode('ascii'), 0):02X}\r\n".encode("ascii")


def body_of(line: bytes) -> tuple[bytes, bool]:
    """What stands between $ and * of a line, and whether a checksum follows. ValueError for a wrong one."""
    body, star, check = line.removeprefix(b"$").partition(b"*")
    if line[:1] != b"$" or (star and int(check[:2], 16) != reduce(xor, body, 0)):
        raise ValueError
    return body, bool(star)


def split_lines(data: bytes) -> tuple[list[bytes], bytes]:
    """The lines that are whole, and the rest, of which none stays where it is longer than any sentence."""
    *lines, rest = data.split(b"\n")
    found = [line.strip() for line in lines if line.strip()]
    return ([*found, rest], b"") if len(rest) > LONGEST else (found, rest)


def sentences(fix: Fix, names: Sequence[str], begun: datetime, convergence: float) -> bytes:
    """The sentences of a fix, those of a heading where there is one.

    convergence: of the grid, from true to grid north, clockwise [rad]
    """
    at = begun + timedelta(microseconds=fix.t // 1000)
    made = (WRITERS[name](fix, at, convergence) for name in names)
    return b"".join(sentence(body) for body in made if body)


def _time(at: datetime) -> str:
    hundredths = (at.microsecond + 5_000) // 10_000
    at = at + timedelta(microseconds=hundredths * 10_000 - at.microsecond)
    return f"{at:%H%M%S}.{at.microsecond // 10_000:02d}"


def _angle(value: float, degrees: int) -> str:
    """An angle [rad] as degrees and minutes, to 0.2 mm."""
    units = round(math.degrees(abs(value)) * 60e7)
    whole, rest = divmod(units, 600_000_000)
    return f"{whole:0{degrees}d}{rest // 10_000_000:02d}.{rest % 10_000_000:07d}"


def _place(fix: Fix) -> str:
    if fix.quality == 0 or math.isnan(fix.latitude) or math.isnan(fix.longitude):
        return ",,,"
    north, east = "N" if fix.latitude >= 0.0 else "S", "E" if fix.longitude >= 0.0 else "W"
    return f"{_angle(fix.latitude, 2)},{north},{_angle(fix.longitude, 3)},{east}"


def _number(value: float, form: str) -> str:
    return "" if math.isnan(value) else format(value, form)


def _bearing(angle: float, convergence: float) -> float:
    """An angle from grid east [rad, nan where not known] as degrees clockwise from true north."""
    turned = math.degrees(math.pi / 2.0 - angle + convergence) % 360.0
    return 0.0 if turned >= 359.9995 else turned


def _used(fix: Fix) -> int:
    return 0 if fix.quality == 0 else max(fix.satellites, 12) if fix.satellites < 0 else fix.satellites


def _gga(fix: Fix, at: datetime, convergence: float) -> str:
    height, age = _number(fix.height, ".3f"), _number(fix.age, ".1f")
    hdop = _number(1.0 if math.isnan(fix.hdop) and fix.quality else fix.hdop, ".1f")
    if fix.quality == 0:
        return f"{TALKER}GGA,{_time(at)},,,,,0,00,99.9,,,,,,"
    quality = GGA_QUALITY[fix.quality]
    place = _place(fix)
    return f"{TALKER}GGA,{_time(at)},{place},{quality},{_used(fix):02d},{hdop},{height},M,0.0,M,{age},"


def _vtg(fix: Fix, at: datetime, convergence: float) -> str:
    course, speed = _number(_bearing(fix.course, convergence), ".3f"), fix.speed
    knots, kmh = _number(speed / KNOT, ".4f"), _number(speed * 3.6, ".4f")
    return f"{TALKER}VTG,{course},T,,M,{knots},N,{kmh},K,{RMC_MODE[fix.quality]}"


def _rmc(fix: Fix, at: datetime, convergence: float) -> str:
    valid = "A" if fix.quality else "V"
    knots, course = _number(fix.speed / KNOT, ".4f"), _number(_bearing(fix.course, convergence), ".3f")
    mode = RMC_MODE[fix.quality]
    return f"{TALKER}RMC,{_time(at)},{valid},{_place(fix)},{knots},{course},{at:%d%m%y},,,{mode}"


def _gst(fix: Fix, at: datetime, convergence: float) -> str:
    if fix.quality == 0 or math.isnan(fix.horizontal_sd):
        return f"{TALKER}GST,{_time(at)},,,,,,,"
    sd, up = f"{fix.horizontal_sd:.4f}", _number(fix.vertical_sd, ".4f")
    return f"{TALKER}GST,{_time(at)},{sd},{sd},{sd},0.0,{sd},{sd},{up}"


def _hdt(fix: Fix, at: datetime, convergence: float) -> str:
    return "" if math.isnan(fix.heading) else f"{TALKER}HDT,{_bearing(fix.heading, convergence):.3f},T"


def _ths(fix: Fix, at: datetime, convergence: float) -> str:
    if math.isnan(fix.heading):
        return f"{TALKER}THS,,V"
    return f"{TALKER}THS,{_bearing(fix.heading, convergence):.3f},A"


def _agopengps(name: str, heading: str, fix: Fix, at: datetime, roll: str = "0", pitch: str = "0") -> str:
    """Angles in degrees, roll > 0 right side down, pitch > 0 nose up; 0 = not known, as the yaw rate."""
    if fix.quality == 0:
        return f"{name},{_time(at)},,,,,0,0,99.9,,,,{heading},0,0,0"
    knots, height = _number(fix.speed / KNOT, ".4f"), _number(fix.height, ".3f")
    hdop = "1.0" if math.isnan(fix.hdop) else f"{fix.hdop:.1f}"
    age = _number(fix.age, ".1f") or "0.0"
    quality = GGA_QUALITY[fix.quality]
    return (
        f"{name},{_time(at)},{_place(fix)},{quality},{_used(fix)},{hdop},{height},{age},{knots},"
        f"{heading},{roll},{pitch},0"
    )


def _panda(fix: Fix, at: datetime, convergence: float) -> str:
    return _agopengps("PANDA", "65535", fix, at)


def _paogi(fix: Fix, at: datetime, convergence: float) -> str:
    if math.isnan(fix.heading):
        return ""
    roll, pitch = (_number(math.degrees(angle), ".3f") or "0" for angle in (fix.roll, -fix.pitch))
    return _agopengps("PAOGI", f"{_bearing(fix.heading, convergence):.3f}", fix, at, roll, pitch)


WRITERS: dict[str, Callable[[Fix, datetime, float], str]] = {
    "GGA": _gga, "VTG": _vtg, "RMC": _rmc, "GST": _gst, "HDT": _hdt, "THS": _ths, "PANDA": _panda,
    "PAOGI": _paogi,
}  # fmt: skip


@dataclass
class Epoch:
    """What the sentences of one time of day said.

    seconds: of the day; angles [rad], bearings from north, roll and pitch as in Fix
    """

    seconds: float
    latitude: float = math.nan
    longitude: float = math.nan
    height: float = math.nan
    quality: int = 0
    satellites: int = -1
    hdop: float = math.nan
    age: float = math.nan
    speed: float = math.nan
    course: float = math.nan
    heading: float = math.nan
    roll: float = math.nan
    pitch: float = math.nan
    horizontal_sd: float = math.nan
    vertical_sd: float = math.nan


@dataclass
class Listener:
    """Epochs out of a stream of sentences, however it is cut.

    An epoch is complete when it has each kind of sentence from as many talkers as the two before it had, or
    one of another time of day begins. Receivers change their talker with the satellites that they use: who
    speaks alone of its time is the same source. Talkers whose positions of one time lie apart are several:
    the one with the best fix of the first epoch counts until it is silent. So is one that takes turns with
    it, of another phase (code, carrier). What only another says is taken from it.

    A sentence counts whole or not at all. Checksums are left away by all lines of a stream or by none.

    wrong: lines so far that were no sentence, or had another checksum
    unknown: what sentences did not say, and what did not count, with how often
    """

    wrong: int = 0
    unknown: Counter[str] = field(default_factory=Counter)
    _rest: bytes = b""
    _is_told: bool = False
    _seconds: float = math.nan  # of the newest epoch
    _said: dict[str, dict[str, Fields]] = field(default_factory=dict)  # in it: talker -> kind -> fields
    _talker: str = ""  # whose positions count
    _others: set[str] = field(default_factory=set)  # talkers of other sources
    _heard: float = math.nan  # second of the day of the last position that counted
    _quality: int = 0  # of it
    _kinds: tuple[Counter[str], ...] = field(default_factory=lambda: (Counter(), Counter(), Counter()))
    """Of the newest epoch first: kinds, from how many talkers."""
    _done: list[Epoch] = field(default_factory=list)
    _are_checked: bool | None = None  # None: of a stream that has not shown it yet

    def feed(self, data: bytes) -> list[Epoch]:
        """More bytes; the epochs that are complete."""
        lines, self._rest = split_lines(self._rest + data)
        for line in lines:
            self._take(line)
        done, self._done = self._done, []
        return done

    @property
    def epoch(self) -> Epoch | None:
        """The newest, still None before the first."""
        return self._epoch(self._source() or self._talker) if self._said else None

    def _take(self, line: bytes) -> None:
        try:
            body, star = body_of(line)
            is_first, self._are_checked = self._are_checked is None, self._are_checked or star
            name, *words = body.decode("ascii").split(",")
            talker, kind = ("P", name) if name.startswith("P") else (name[:2], name[2:])
            if kind not in READERS or (is_first and not star):
                return
            least, read = READERS[kind]
            if not star and (self._are_checked or len(words) < least):
                raise ValueError
            words += [""] * MOST_WORDS  # receivers leave away what is empty
            seconds = self._seconds if kind in UNTIMED else _second(words[0])
            if math.isnan(seconds):
                return
            fields = read(words)
        except ValueError:
            self.wrong += 1
            return
        if seconds != self._seconds:
            self._tell()
            self._kinds = (Counter(), *self._kinds[:2])
            self._seconds, self._said, self._is_told = seconds, {}, False
        said = self._said.setdefault(talker, {})
        is_new = kind not in said
        said[kind] = fields
        self._kinds[0][kind] += is_new
        if is_new and self._is_told and kind in PLACES:
            self._find_others((talker,) if talker != self._talker else tuple(self._said))
        usual = self._kinds[1] | self._kinds[2]
        if usual and usual <= self._kinds[0]:
            self._tell()

    def _tell(self) -> None:
        """The newest epoch is complete."""
        if self._is_told or not self._said:
            return
        self._is_told = True
        placed = self._placed()
        source = self._source()
        is_silent = (self._seconds - self._heard) % DAY_S > SILENT_S
        if placed and self._talker not in placed and (not self._talker or is_silent):
            if source in self._others:
                self._others = self._others - {source} | {self._talker}
            self._talker = source or ""
        self._find_others(placed)
        for other in placed:
            if other != source and (other in self._others or source is None):
                self.unknown[f"sources: positions of {other}, those of {self._talker} count"] += 1
        if source is None:
            return  # another's position between two of the source that counts
        epoch = self._epoch(source)
        if source in placed:
            self._heard, self._quality = self._seconds, epoch.quality
        if placed and epoch.quality and math.isnan(epoch.height):
            self.unknown["heights: positions without a height above the ellipsoid"] += 1
        self._done.append(epoch)

    def _placed(self) -> list[str]:
        """Who says a position in the newest epoch, or that there is none."""
        return [talker for talker, said in self._said.items() if not PLACES.isdisjoint(said)]

    def _source(self) -> str | None:
        """Whose position counts in the newest epoch, '' without any, None where only others say one."""
        placed = self._placed()
        if not placed or self._talker in placed:
            return self._talker
        if not self._talker or (self._seconds - self._heard) % DAY_S > SILENT_S:
            return self._best(placed, is_fixed=True)
        return self._best([t for t in placed if t not in self._others and self._goes_on(t)]) or None

    def _goes_on(self, talker: str) -> bool:
        """Whether a fix may be of the receiver of the last one: it does not leap between code and carrier."""
        quality = self._place(talker).get("quality", 0)
        return not quality or not self._quality or (quality >= CARRIER) == (self._quality >= CARRIER)

    def _find_others(self, talkers: Sequence[str]) -> None:
        """Those whose positions lie apart from the one of the talker that counts are other sources."""
        one = self._place(self._talker)
        for talker in talkers:
            other = self._place(talker)
            if one.get("quality") and other.get("quality"):
                north = one.get("latitude", 0.0) - other.get("latitude", 0.0)
                east = one.get("longitude", 0.0) - other.get("longitude", 0.0)
                east = math.remainder(east, 2.0 * math.pi) * math.cos(one.get("latitude", 0.0))
                if math.hypot(north, east) * EARTH_M > APART_M:
                    self._others.add(talker)

    def _best(self, talkers: Sequence[str], is_fixed: bool = False) -> str:
        """The talker with the best fix of the newest epoch, '' without any. is_fixed: with a fix."""
        fixes = {t: self._place(t).get("quality", 0) for t in talkers}
        those = (t for t in fixes if fixes[t] or not is_fixed)
        return max(those, key=lambda t: (fixes[t], t == TALKER, t), default="")

    def _place(self, talker: str) -> Fields:
        """What a talker says of its place in the newest epoch."""
        said, found = self._said.get(talker, {}), dict[str, Any]()
        for kind in TOGETHER[0]:
            found |= {name: value for name, value in said.get(kind, {}).items() if not math.isnan(value)}
        return found

    def _epoch(self, talker: str) -> Epoch:
        """The newest epoch, positions of a talker, of any where none counts; the rest of it or of another."""
        epoch = Epoch(self._seconds)
        for kinds in TOGETHER:
            saying = [t for t, said in self._said.items() if not said.keys().isdisjoint(kinds)]
            if {*kinds} <= PLACES and talker:
                saying = [t for t in saying if t == talker]
            best = max(saying, key=lambda t: (t == talker, t == TALKER, t), default="")
            for kind in kinds:
                found = self._said.get(best, {}).get(kind, {})
                vars(epoch).update({name: value for name, value in found.items() if not math.isnan(value)})
        return epoch


def _second(text: str) -> float:
    """The second of a time of day."""
    return int(text[:2]) * 3600.0 + int(text[2:4]) * 60.0 + float(text[4:])


def _read(text: str, factor: float = 1.0) -> float:
    return float(text) * factor if text else math.nan


def _read_angle(text: str, side: str) -> float:
    """Degrees, of two or three digits by the side, and minutes [rad]."""
    if not text:
        return math.nan
    count = {"N": 2, "S": 2, "E": 3, "W": 3}.get(side, 0)
    degrees, minutes = text[:count], text[count:]
    if not (degrees.isdigit() and minutes[:2].isdigit() and float(minutes) < 60.0):
        raise ValueError
    angle = math.radians(int(degrees) + float(minutes) / 60.0)
    return -angle if side in ("S", "W") else angle


def _read_height(text: str, unit: str) -> float:
    """[m]. A unit that is none of a height makes the sentence none."""
    factor = {"": 1.0, "M": 1.0, "F": FOOT}.get(unit.upper())
    if factor is None:
        raise ValueError
    return _read(text, factor)


def _read_place(words: Sequence[str]) -> Fields:
    """Latitude, longitude, quality, satellites and HDOP. Without satellites there is no fix."""
    latitude, longitude = _read_angle(words[1], words[2]), _read_angle(words[3], words[4])
    quality, used = FIX_QUALITY.get(int(words[5] or 0), 0), int(words[6] or -1)
    quality = quality if used else 0
    fields = {"latitude": latitude, "longitude": longitude, "quality": quality, "satellites": used}
    return {**fields, "hdop": _read(words[7])}


def _read_gga(words: Sequence[str]) -> Fields:
    height = _read_height(words[8], words[9]) + _read_height(words[10], words[11])
    return {**_read_place(words), "height": height, "age": _read(words[12])}


def _read_vtg(words: Sequence[str]) -> Fields:
    if words[8] == "N":
        return {}
    speed = _read(words[6], 1.0 / 3.6) if words[6] else _read(words[4], KNOT)
    return {"course": math.radians(_read(words[0])), "speed": speed}


def _read_rmc(words: Sequence[str]) -> Fields:
    if words[1] != "A":
        return {}
    return {"speed": _read(words[6], KNOT), "course": math.radians(_read(words[7]))}


def _read_gst(words: Sequence[str]) -> Fields:
    north, east = _read(words[5]), _read(words[6])
    return {
        "horizontal_sd": math.sqrt(0.5 * (north * north + east * east)),
        "vertical_sd": _read(words[7]),
    }


def _read_heading(words: Sequence[str]) -> Fields:
    return {} if words[1] == "V" else {"heading": math.radians(_read(words[0]))}


def _read_panda(words: Sequence[str]) -> Fields:
    fields = {"height": _read(words[8]), "age": _read(words[9]), "speed": _read(words[10], KNOT)}
    return {**_read_place(words), **fields}


def _read_paogi(words: Sequence[str]) -> Fields:
    heading, roll, pitch = (math.radians(_read(word)) for word in words[11:14])
    return {**_read_panda(words), "heading": heading, "roll": roll, "pitch": -pitch}


UNTIMED = ("VTG", "HDT", "THS")
PLACES = frozenset(("GGA", "PANDA", "PAOGI"))
TOGETHER = (("GGA", "PANDA", "PAOGI"), ("RMC", "VTG"), ("GST",), ("HDT", "THS"))
"""Kinds of sentences that one talker says; of two that say the same, the later here counts."""
READERS: dict[str, tuple[int, Callable[[Sequence[str]], Fields]]] = {
    "GGA": (14, _read_gga), "VTG": (8, _read_vtg), "RMC": (11, _read_rmc), "GST": (8, _read_gst),
    "HDT": (2, _read_heading), "THS": (2, _read_heading), "PANDA": (15, _read_panda),
    "PAOGI": (15, _read_paogi),
}  # fmt: skip
"""Of each kind of sentence: its fields, and what they say of an epoch. ValueError where they are none."""
