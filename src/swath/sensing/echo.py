"""The receiver: which distances a sensor reports for a bundle of sub-rays.

Two families of rules. `nearest`, `percentile`, `mean` and `leading_edge` take the whole bundle for one echo,
however far apart its hits lie. `first`, `last`, `strongest` and `all` first sort the hits into echoes: hits
closer together than c tau / 2 (tau: length of the pulse) reach the receiver as one merged pulse; `within`
says where in such an echo its range lies. Phenomenological: energies per sub-ray, no waveform.

Energies: `percentile` counts the beam's own energy (the weights of the pattern, the paper's rule); `mean`,
`leading_edge` and `strongest` the received energy weight * reflectance * cos(incidence) * transmission / r2.
Pulses below the least detectable energy (a 10 % target that fills the spot at the reach given) are not seen,
by the rules for one echo neither.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swath.rays.spots import Spots
from swath.signals import F64

Within = Literal["nearest", "percentile", "mean", "leading_edge"]
EchoRule = Literal["nearest", "percentile", "mean", "leading_edge", "first", "last", "strongest", "all"]
LIGHT_SPEED = 299_792_458.0  # [m/s]
_ONE_ECHO: dict[EchoRule, Within] = {
    "nearest": "nearest",
    "percentile": "percentile",
    "mean": "mean",
    "leading_edge": "leading_edge",
}
_EPS = 1e-9


@dataclass(frozen=True)
class Bundle:
    """What the sub-rays of n beams met.

    distance [m]: (n, s), nan = nothing; weight: share of the beam's energy, (s,)
    albedo: reflectance * cos(incidence) * transmission there and back, (n, s), anything where nothing was hit
    """

    distance: F64
    weight: F64
    albedo: F64


@dataclass(frozen=True)
class Receiver:
    """How a sensor turns bundles into echoes.

    within: where in an echo its range lies; percentile 0..100
    threshold: share of the echo's received energy at which `leading_edge` triggers, 0 = as soon as the energy
    is detectable; gap: hits closer than this belong to one echo [m]; count: most echoes per beam
    least_energy: albedo / r2 that is just detected [1/m2]
    """

    rule: EchoRule = "percentile"
    within: Within = "percentile"
    percentile: float = 50.0
    threshold: float = 0.1
    gap: float = 0.75
    count: int = 1
    least_energy: float = 0.0

    @property
    def echo_count(self) -> int:
        """Echoes per beam that `receive` returns."""
        return self.count if self.rule == "all" else 1


@dataclass(frozen=True)
class Echoes:
    """Echoes of n beams, nearest first.

    distance [m], nan = none; intensity: received, relative to a white target that fills the spot at the same
    range, nan = none; signal: received energy over the least detectable, 0 = none; all (n, k)
    share: of each sub-ray in the echo's place, (n, k, s), sums to 1 for an echo; distance = sum share * hits
    """

    distance: F64
    intensity: F64
    signal: F64
    share: F64

    def places(self, spots: Spots, hits: F64) -> F64:
        """World points of the echoes (n, k, 3), nan = no echo; hits: of the sub-rays, (n, s) [m]."""
        is_lost = np.isnan(self.distance)
        if np.count_nonzero(self.share) == np.count_nonzero(~is_lost):  # each echo is one of the hits
            sub = self.share.argmax(axis=2)
            beam = np.broadcast_to(np.arange(len(hits))[:, None], sub.shape)
            placed = spots.places(beam, sub, hits[beam, sub])
        else:
            starts, directions = spots.rays()
            points = np.nan_to_num(starts + hits[:, :, None] * directions)
            placed = np.einsum("nks,nsc->nkc", self.share, points)
        placed[is_lost] = np.nan
        return placed


def merging_gap(pulse: float) -> float:
    """Range difference [m] below which two echoes of a pulse of this length [s] merge: c tau / 2."""
    return 0.5 * LIGHT_SPEED * pulse


def least_energy(range_10: float) -> float:
    """albedo / r2 that is just detected [1/m2]: that of a 10 % target at the reach given for it [m]."""
    return 0.1 / range_10**2


def receive(bundle: Bundle, receiver: Receiver) -> Echoes:
    """Echoes of every beam; never raises on beams without a hit or on no beams at all."""
    order = np.argsort(bundle.distance, axis=1, kind="stable")  # nan sorts last
    place = order + order.shape[1] * np.arange(len(order))[:, None]  # in arrays taken as one row
    distance = bundle.distance.take(place)
    is_hit = np.isfinite(distance)
    weight = np.where(is_hit, bundle.weight.take(order), 0.0)
    albedo = np.where(is_hit, bundle.albedo.take(place), 0.0)
    distance = np.where(is_hit, distance, 0.0)
    hits = _Sorted(distance, is_hit, weight, weight * albedo)
    group = _groups(distance, is_hit, receiver.gap)
    most = int(group.max()) + 1 if group.size else 0
    within = _ONE_ECHO.get(receiver.rule)
    if within is None:
        groups = [_echo(hits, group == g, receiver.within, receiver) for g in range(most)]
    else:
        groups = [_echo(hits, _detectable(hits, group, most, receiver.least_energy), within, receiver)]
    picked = _pick(groups, receiver, bundle.distance.shape)
    share = np.zeros_like(picked.share)
    np.put_along_axis(share, np.broadcast_to(order[:, None], share.shape), picked.share, axis=2)
    return Echoes(picked.distance, picked.intensity, picked.signal, share)


@dataclass(frozen=True)
class _Sorted:
    """Hits of every beam by distance, (n, s); 0 where nothing was hit."""

    distance: F64
    is_hit: NDArray[np.bool_]
    weight: F64
    albedo: F64  # times weight

    @cached_property
    def energy(self) -> F64:
        """Received, albedo / r2 [1/m2]."""
        return np.asarray(self.albedo / np.maximum(self.distance, 1e-3) ** 2)


def _groups(distance: F64, is_hit: NDArray[np.bool_], gap: float) -> NDArray[np.int64]:
    """Number of the echo that each sorted hit belongs to, -1 = no hit."""
    if distance.shape[1] == 0:
        return np.zeros(distance.shape, np.int64)
    is_new = np.zeros(distance.shape, dtype=bool)
    is_new[:, 1:] = np.diff(distance, axis=1) >= gap
    return np.where(is_hit, np.cumsum(is_new, axis=1), -1)


def _detectable(hits: _Sorted, group: NDArray[np.int64], most: int, least_energy: float) -> NDArray[np.bool_]:
    """Hits that arrive in a pulse strong enough to be seen by itself, (n, s)."""
    energy, seen = hits.energy, np.zeros(group.shape, dtype=bool)
    for g in range(most):
        member = group == g
        seen |= member & (np.where(member, energy, 0.0).sum(axis=1) >= least_energy)[:, None]
    return seen


def _echo(hits: _Sorted, member: NDArray[np.bool_], within: Within, receiver: Receiver) -> Echoes:
    """One echo per beam made of its members, (n, 1): lost when it is too weak."""
    weight, albedo = np.where(member, hits.weight, 0.0), np.where(member, hits.albedo, 0.0)
    energy = np.where(member, hits.energy, 0.0)
    total = energy.sum(axis=1)
    if within == "mean":
        share = energy / np.where(total > 0.0, total, 1.0)[:, None]
    else:
        if within == "nearest":
            reached = member
        elif within == "percentile":
            part = receiver.percentile / 100.0 * weight.sum(axis=1)
            reached = member & (np.cumsum(weight, axis=1) >= part[:, None] - _EPS)
        else:
            part = np.maximum(receiver.threshold * total, np.minimum(receiver.least_energy, total))
            reached = member & (np.cumsum(energy, axis=1) >= part[:, None] * (1.0 - _EPS))
        share = reached & (np.cumsum(reached, axis=1) == 1)  # the first that reached it
    share = share.astype(np.float64)
    signal = total / max(receiver.least_energy, 1e-12)
    is_seen = member.any(axis=1) & (signal >= 1.0) & (share.sum(axis=1) > 0.5)
    return Echoes(
        np.where(is_seen, (share * hits.distance).sum(axis=1), np.nan)[:, None],
        np.where(is_seen, albedo.sum(axis=1), np.nan)[:, None],
        np.where(is_seen, signal, 0.0)[:, None],
        np.where(is_seen[:, None], share, 0.0)[:, None],
    )


def _pick(groups: list[Echoes], receiver: Receiver, shape: tuple[int, ...]) -> Echoes:
    """The echoes that are reported, of those in order of range: (n, echo_count)."""
    if len(groups) == 1 and receiver.echo_count == 1:
        return groups[0]
    n, s = shape
    none = Echoes(np.full((n, 1), np.nan), np.full((n, 1), np.nan), np.zeros((n, 1)), np.zeros((n, 1, s)))
    found = [*groups, *([none] * max(receiver.echo_count - len(groups), 0))]
    table = [np.concatenate([getattr(e, k) for e in found], axis=1)
             for k in ("distance", "intensity", "signal", "share")]  # fmt: skip
    seen, signal = np.isfinite(table[0]), table[2]
    order = np.argsort(~seen, axis=1, kind="stable")  # those that are seen, nearest first
    if receiver.rule == "last":
        order = np.maximum(seen.shape[1] - 1 - np.argmax(seen[:, ::-1], axis=1), 0)[:, None]
    elif receiver.rule == "strongest":
        order = np.argmax(signal, axis=1)[:, None]
    order = order[:, : receiver.echo_count]
    flat = [np.take_along_axis(a, order, axis=1) for a in table[:3]]
    return Echoes(flat[0], flat[1], flat[2], np.take_along_axis(table[3], order[:, :, None], axis=1))
