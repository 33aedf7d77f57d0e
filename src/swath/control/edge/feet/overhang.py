"""How far the tops of a stand hang over the edge: what its height says of that, and how wide the header cuts.

A stand that leans out over the edge shows a wall as sharp as that of an upright one, only further out, by
z tan(lean) where its tops are at z. It is lower than one that stands, but how high that would be is known to
a tenth or two of itself: one scanner on one side cannot tell a short stand that stands from a tall one that
leans out. So the chance of every lean in every direction is kept. They make two modes, standing and leaning
out; what is reported is the likelier one, with deviation and confidence of both, and the other one beside it.

How wide the header cuts says where the feet stand: as far from its end as is missing of its width. It may
miss more, tramlines and holes, never less.
"""

from dataclasses import dataclass
from functools import cached_property
from math import acos, cos, erf, exp, hypot, isnan, pi, sin, sqrt
from typing import NamedTuple, Protocol

import numpy as np

from swath.control.edge.profile import TOLERANCE, Clears
from swath.core import portable
from swath.core.units import DEG, PERCENT
from swath.signals import F64

# of a stand's usual height, mean and standard deviation of what is seen of it where it stands, and share of
# the rays that it stops: 26 upright stands of six crops, five scanners, `empirical` and `plants`
DENSE, THIN = (0.965, 0.03, 1.0), (0.77, 0.06, 0.75)
WALL = 0.92  # of the height of the tops: where the wall of wheat that leans out by 20 to 32 deg was seen
# chances that the header misses crop elsewhere, too, estimated: holes, evenly up to so much [m], and the two
# wheel tracks of a tramline, tyres of 0.3 to 0.65 m; passes with one where lines lie 24 to 36 m apart
MISSED, HOLES_M = 0.1, 2.0
TRAMLINES, TRACKS_M = 0.3, (0.6, 1.3)
UNEVEN = 0.05  # m, standard deviation of the width over a metre of a ragged edge, estimated
CUT_M = 10.0  # m of travel over which what the header cuts says how the stand leans, estimated
STEEP, STEEPER = 0.2, 0.35  # tangents of a lean inward that may, and that must show a ramp
STANDS = 15.0 * DEG  # smaller leans are those of a stand that stands
MISTAKEN = 0.1  # chance that stands lean by anything, against what the driver says, estimated
RAMPS = 0.98  # chance at most that what seems a ramp is one, estimated
_LEANS, _DIRECTIONS = DEG * np.arange(0.0, 75.0, 2.5), pi * ((np.arange(8) + 0.5) / 8 - 0.5)
PLACE, NEVER = 0.025, 1e-6  # m between places that a hang may have; chance that is none
PLACES = PLACE * np.arange(-20.0, 80.0)
_OUTSIDE = PLACES > TOLERANCE
_NORMAL = np.arange(-2.5, 2.6, 0.25)  # deviations that stand for a normal
_OF_NORMAL = portable.exp(-0.5 * _NORMAL**2) / float(portable.exp(-0.5 * _NORMAL**2).sum())
_TALL = np.array([cos(lean) for lean in _LEANS.tolist()])
# tangents of the lean out over the edge, in half a turn of directions
_OUT = portable.tan(_LEANS)[:, None] * np.array([sin(turn) for turn in _DIRECTIONS.tolist()])
_HANGS = WALL * np.maximum(_OUT, -STEEPER)  # of the feet behind the edge of the tops, of their height
_NO_RAMP = 1.0 - np.clip((-_OUT - STEEP) / (STEEPER - STEEP), 0.0, 1.0)  # chance that a lean in shows none


class Mode(NamedTuple):
    """How far the feet stand behind the edge of the tops, and its deviation [m], with what chance."""

    chance: float = 1.0
    place: float = 0.0
    sd: float = 0.0


@dataclass(frozen=True)
class Hang:
    """How far the feet stand behind the edge of the tops. chance: of each place of PLACES, (places,)."""

    chance: F64

    @classmethod
    def of(cls, hangs: F64, chance: F64) -> "Hang":
        """From hangs [m] and their chances up to a factor, (n,)."""
        k = np.clip(np.rint((hangs - PLACES[0]) / PLACE), 0.0, len(PLACES) - 1.0).astype(np.int64)
        counts = np.bincount(k, chance, len(PLACES))
        return cls(counts / float(counts.sum()))

    @classmethod
    def normal(cls, *modes: Mode) -> "Hang":
        """From modes that are each normal."""
        means, sds = (np.repeat([mode[k] for mode in modes], len(_NORMAL)) for k in (1, 2))
        chance = np.repeat([mode.chance for mode in modes], len(_NORMAL)) * np.tile(_OF_NORMAL, len(modes))
        return cls.of(means + sds * np.tile(_NORMAL, len(modes)), chance)

    @cached_property
    def modes(self) -> tuple[Mode, Mode]:
        """Leaning out by more than TOLERANCE, and not: the less likely one first."""
        one, other = sorted(_mode(self.chance[side], PLACES[side]) for side in (_OUTSIDE, ~_OUTSIDE))
        return one, other

    @property
    def told(self) -> float:
        """Median of the likelier mode [m]."""
        return self.modes[1].place

    @property
    def sd(self) -> float:
        """Deviation of all places from `told` [m]."""
        return sqrt(float((self.chance * (PLACES - self.told) ** 2).sum()))

    def within(self, known: float) -> float:
        """Chance of feet within TOLERANCE of where they are told, all else known to `known` [m]."""
        is_held, scale = self.chance > NEVER, 1.0 / (sqrt(2.0) * known)
        chance, away = self.chance[is_held], PLACES[is_held] - self.told
        ends = [((TOLERANCE + sign * away) * scale).tolist() for sign in (-1.0, 1.0)]
        before, after = (np.array([*map(erf, each)]) for each in ends)
        return float(np.cumsum(np.append(0.0, 0.5 * chance * (before + after)))[-1])  # in their order


class CutWidth(Clears):
    """How wide the header cuts beside where the canopy's edge is seen, over the last metres.

    sd: standard deviation of the width's error that a whole run has alike [m]
    """

    kept = ("_way", "_missing", "_beside")

    def __init__(self, sd: float) -> None:
        self._sd = sd
        super().__init__()

    def clear(self) -> None:
        """Nothing cut yet."""
        self._way = 0.0  # of travel, as much as is remembered [m]
        self._missing = self._beside = 0.0  # sums over it

    def add(self, missing: float, beside: float, travel: float) -> None:
        """Over a travel [m] so much of the header's width cut nothing [m], while feet at the canopy's edge
        would stand `beside` the header's end [m], > 0 toward the crop.
        """
        keep = exp(-travel / CUT_M)
        self._way = keep * self._way + travel
        self._missing = keep * self._missing + travel * missing
        self._beside = keep * self._beside + travel * beside

    def likelihood(self, hangs: F64) -> F64:
        """Of the feet so far behind the canopy's edge [m]; 1 where nothing was cut."""
        if not self._way > 0.0:
            return np.ones_like(hangs)
        sd = hypot(self._sd, UNEVEN / sqrt(max(self._way, 1.0)))
        more = self._missing / self._way - np.maximum(self._beside / self._way + hangs, 0.0)
        own = portable.exp(-0.5 * (more / sd) ** 2) / (sqrt(2.0 * pi) * sd)
        holes = MISSED / HOLES_M * ((more > 0.0) & (more < HOLES_M))
        tracks = TRAMLINES / (TRACKS_M[1] - TRACKS_M[0]) * ((more > TRACKS_M[0]) & (more < TRACKS_M[1]))
        return np.asarray((1.0 - MISSED - TRAMLINES) * own + holes + tracks + 1e-9)


class Overhang(Protocol):
    """How far the feet stand behind the edge of the tops."""

    def of(self, crop: float, crop_sd: float, stopped: float, ramp: Mode, cut: CutWidth) -> Hang:
        """For a crop height and its deviation [m], a share of rays stopped, a ramp, and what is cut."""


class HeightOverhang:
    """What one scanner can know, and the header.

    upright: height of the crop where it stands upright [m], 0 = unknown; percent: its standard deviation
    lean_deg: how far stands lean in the mean, in any direction
    view: height of the scanner [m], over which it sees no tops
    """

    def __init__(self, upright: float, percent: float, lean_deg: float, view: float) -> None:
        self._upright, self._most = upright, min(view / upright, 1.0) if upright > 0.0 else 1.0
        self._sd = PERCENT * percent
        prior = portable.exp(-_LEANS / (DEG * max(lean_deg, 0.1)))
        prior = (1.0 - MISTAKEN) * prior / float(prior.sum()) + MISTAKEN / len(_LEANS)
        self._prior = prior[:, None]

    def lean(self, crop: float, stopped: float) -> float:
        """Lean of the stems off the vertical [rad], 0 where crop of this height [m] may as well stand.

        stopped: share of the rays in the crop that it stopped
        """
        if not (self._upright > 0.0 and float(self._chance(crop, 0.0, stopped)[_LEANS < STANDS].sum()) < 0.5):
            return 0.0
        return acos(min(max(crop, 0.0) / (self._upright * _seen(stopped)[0]), 1.0))

    def of(self, crop: float, crop_sd: float, stopped: float, ramp: Mode, cut: CutWidth) -> Hang:
        """As `Overhang`. crop: over the ground, and its deviation [m]; ramp: of a stand that leans inward."""
        ramp = ramp._replace(chance=min(ramp.chance, RAMPS))
        rest = 1.0 - ramp.chance
        if isnan(crop) or not self._upright > 0.0:  # any height up to that, leaning or not
            return Hang.normal(Mode(rest, 0.0, self._upright / 3.0), ramp)
        chance = self._chance(crop, crop_sd, stopped) * _NO_RAMP
        tops = min(crop, self._upright * (1.0 + self._sd))  # higher: it is no crop of that height
        hangs = np.concatenate([(tops * _HANGS).ravel(), ramp.place + ramp.sd * _NORMAL])
        rest /= float(chance.sum())
        chance = np.concatenate([rest * chance.ravel(), ramp.chance * _OF_NORMAL])
        return Hang.of(hangs, chance * cut.likelihood(hangs))

    def _chance(self, crop: float, crop_sd: float, stopped: float) -> F64:
        """Chance of every lean in every direction after a height was seen, (leans, 1)."""
        mean, seen_sd = _seen(stopped)
        tall = mean * np.minimum(_TALL, self._most)
        sd = np.sqrt(seen_sd**2 + (crop_sd / self._upright) ** 2 + (self._sd * tall) ** 2)
        away = (min(crop / self._upright, mean + seen_sd) - tall) / sd
        chance = self._prior * (portable.exp(-0.5 * away**2) / sd)[:, None]
        return np.asarray(chance / max(float(chance.sum()), 1e-300))


def density(stopped: float) -> float:
    """How dense a stand is that stops a share of the rays, 0 = thin .. 1."""
    return min(max((stopped - THIN[2]) / (DENSE[2] - THIN[2]), 0.0), 1.0)


def _mode(chance: F64, hangs: F64) -> Mode:
    """At its median."""
    total = max(float(chance.sum()), 1e-12)
    place = float(np.interp(0.5 * total, np.cumsum(chance) - 0.5 * chance, hangs))
    return Mode(total, place, sqrt(float((chance * (hangs - place) ** 2).sum()) / total))


def _seen(stopped: float) -> tuple[float, float]:
    """Mean and standard deviation of the height at which a stand is seen that stands, of its usual one."""
    share = density(stopped)
    return THIN[0] + share * (DENSE[0] - THIN[0]), THIN[1] + share * (DENSE[1] - THIN[1])


def mixed(share: float, one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Mean and standard deviation of two that may hold, the first with a chance `share`."""
    rest = 1.0 - share
    variance = share * one[1] ** 2 + rest * other[1] ** 2 + share * rest * (one[0] - other[0]) ** 2
    return share * one[0] + rest * other[0], sqrt(variance)
