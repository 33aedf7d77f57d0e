"""How likely a rare failure is: importance sampling with densities that the runs themselves teach.

Every parameter is a standard normal number z behind its distribution, so a run is a place in normal space and
its exposure the density p(z). Rounds of runs look for failures: each fits mixtures of normal densities to the
runs with the least margins (cross-entropy method, Rubinstein & Kroese 2004, ISBN 978-0-387-21240-1; levels
that fall to 0 as in subset simulation, Au & Beck 2001, doi:10.1016/S0266-8920(01)00019-4), one everywhere,
one away from the failures that are known, so that a second region of failure is looked for as hard as the
first. What comes before the last round only says where to look. The last round is drawn from one density q
that is fixed by then, with runs as the exposure has them among it (defensive, Owen & Zhou 2000,
doi:10.1080/01621459.2000.10473909), and the mean of its weights p / q over failures is an unbiased estimate
of their probability, whatever the rounds before found.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, log, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from swath.signals import F64

Flags = NDArray[np.bool_]
WIDE = (1.5, 2.25)  # scales of the densities that reach beyond the exposure: 2.25 finds 1e-4 in 1 of 20
FIRST = 0.1  # share of the runs of the search that are drawn before anything is known
ROUNDS = 12  # of the search after these
ROUND_LEAST = 16  # runs of a round: they are done together
CORRECTING = 4  # rounds at the dear level that correct where the cheap one found failures
ELITE = 0.1  # share of the runs that a density is fitted to, while the level is above 0
ELITE_LEAST, ELITE_PER_DIMENSION = 20, 3
DEFENSIVE, WIDENED = 0.1, 0.1  # shares of the last round drawn as the exposure, and more widely
STARTED = 0.15  # share of the last round drawn as the cheap level proposes
TAILS, TAIL = 0.25, 1.8  # share of the fitted components that is this much wider: few runs know no tails
MOST_REGIONS = 4  # components of a fitted mixture
COVERED = 3.0  # standard deviations around a component within which a run belongs to it
INFLATED = 1.2  # of the covariances of fitted components
PRIOR, PRIOR_VARIANCE = 4.0, 0.3  # runs that this variance counts for in a fit: failures are narrower than 1
ESS_LEAST = 30.0  # effective failures that a probability is told from


@dataclass(frozen=True)
class Mixture:
    """Normal densities. shares: (k,), sum 1; means: (k, d); factors: lower Cholesky ones, (k, d, d)"""

    shares: F64
    means: F64
    factors: F64

    def draw(self, rng: np.random.Generator, count: int) -> F64:
        """Places, (count, d)."""
        which = rng.choice(len(self.shares), count, p=self.shares)
        normal = rng.standard_normal((count, self.means.shape[1]))
        return np.asarray(self.means[which] + np.einsum("nij,nj->ni", self.factors[which], normal))

    def log_parts(self, at: F64) -> F64:
        """Logarithm of each component's density with its share, at places (n, d), (n, k)."""
        scales = np.sum(np.log(np.diagonal(self.factors, axis1=1, axis2=2)), axis=1)
        constants = np.log(self.shares) - scales - 0.5 * at.shape[1] * log(2.0 * pi)
        return np.asarray(constants - 0.5 * self.distances(at))

    def log_density(self, at: F64) -> F64:
        """Logarithm of the density at places (n, d), (n,)."""
        return np.asarray(np.logaddexp.reduce(self.log_parts(at), axis=1))

    def distances(self, at: F64) -> F64:
        """Squared distances from the means in standard deviations, (n, k)."""
        off = (at - self.means[:, None, :]) @ np.linalg.inv(self.factors).transpose(0, 2, 1)
        return np.asarray(np.einsum("knd,knd->nk", off, off))

    def spread(self, scale: float) -> "Mixture":
        """Each component this much wider."""
        return Mixture(self.shares, self.means, scale * self.factors)

    def covers(self, at: F64) -> Flags:
        """Whether places (n, d) belong to a component, (n,) of bool."""
        bound = (sqrt(at.shape[1] - 0.5) + COVERED) ** 2  # of chi, whose median is about sqrt(d - 1/2)
        return np.asarray(np.min(self.distances(at), axis=1) <= bound)


def exposure(dimensions: int, scales: Sequence[float] = (1.0,)) -> Mixture:
    """The exposure itself, or in equal shares the same more widely spread."""
    count = len(scales)
    factors = np.stack([scale * np.eye(dimensions) for scale in scales])
    return Mixture(np.full(count, 1.0 / count), np.zeros((count, dimensions)), factors)


def joined(parts: Sequence[tuple[float, Mixture]]) -> Mixture:
    """Mixtures in shares."""
    whole = sum(share for share, _ in parts)
    return Mixture(
        np.concatenate([share / whole * part.shares for share, part in parts]),
        np.concatenate([part.means for _, part in parts]),
        np.concatenate([part.factors for _, part in parts]),
    )


def log_exposure(at: F64) -> F64:
    """Logarithm of the exposure's density at places (n, d), (n,)."""
    return np.asarray(-0.5 * np.sum(at**2, axis=1) - 0.5 * at.shape[1] * log(2.0 * pi))


def effective(weights: F64) -> float:
    """How many equal weights are as sure as these (Kish 1965): (sum w)^2 / sum w^2."""
    squares = float(np.sum(weights**2))
    return float(np.sum(weights)) ** 2 / squares if squares > 0.0 else 0.0


class Hunt:
    """The rounds that look for failures. dimensions: of normal space; budget: runs of all rounds together;
    start: the density of the first round, None = as the exposure and more widely
    """

    def __init__(self, dimensions: int, budget: int, start: Mixture | None = None) -> None:
        self._budget, self._dimensions = budget, dimensions
        first = int(FIRST * budget) if start is None else -(-budget // CORRECTING)
        rest = -(-(budget - first) // (ROUNDS if start is None else CORRECTING - 1))
        self._first, self._rest = max(first, ROUND_LEAST), max(rest, ROUND_LEAST)
        self._is_corrected = start is not None
        self._start = start or exposure(dimensions, (1.0, *WIDE))
        self._used: list[tuple[int, Mixture]] = []
        self.places: F64 = np.empty((0, dimensions))
        self.margins: F64 = np.empty(0)

    @property
    def left(self) -> int:
        """Runs of the rounds to come."""
        return self._budget - len(self.places)

    def next(self, rng: np.random.Generator) -> F64:
        """Places of the next round, (n, d)."""
        count = min(self.left, self._rest if self._used else self._first)
        density = self._density(rng) if self._used else self._start
        self._used.append((count, density))
        return density.draw(rng, count)

    def tell(self, places: F64, margins: F64) -> None:
        """What came of them: margins (n,), < 0 where the limit is broken; nan counts for nothing."""
        self.places = np.vstack([self.places, places])
        self.margins = np.append(self.margins, margins)

    def last(self, rng: np.random.Generator) -> Mixture:
        """The density of the last round."""
        found = self._fitted(self._elite(np.ones(len(self.margins), dtype=bool)), rng)
        parts = [(DEFENSIVE, exposure(self._dimensions)), (WIDENED, exposure(self._dimensions, WIDE))]
        rest = 1.0 - DEFENSIVE - WIDENED
        if self._is_corrected:
            parts.append((STARTED, self._start))
            rest -= STARTED
        return joined([*parts, ((1.0 - TAILS) * rest, found), (TAILS * rest, found.spread(TAIL))])

    def _density(self, rng: np.random.Generator) -> Mixture:
        """Half where margins are least, a quarter where they are least away from the failures that are
        known, a quarter everywhere.
        """
        everywhere = np.ones(len(self.margins), dtype=bool)
        main = self._fitted(self._elite(everywhere), rng)
        parts = [(0.5, main), (0.25, exposure(self._dimensions, (1.0, *WIDE)))]
        failing = self.margins < 0.0
        if np.sum(failing) >= 2:
            known = self._fitted(failing, rng)
            away = ~known.covers(self.places)
            if np.sum(away) > self._least:
                parts.append((0.25, self._fitted(self._elite(away), rng)))
        return joined(parts)

    @property
    def _least(self) -> int:
        return ELITE_LEAST + ELITE_PER_DIMENSION * self._dimensions

    def _elite(self, among: Flags) -> Flags:
        """The runs with the least margins, all that fail if these are enough, (n,) of bool."""
        margins = np.where(among & ~np.isnan(self.margins), self.margins, np.inf)
        count = int(np.sum(np.isfinite(margins)))
        wanted = min(count, max(self._least, int(ELITE * count)))
        level = max(-1e-12, float(np.sort(margins)[max(0, wanted - 1)]))
        return np.asarray(margins <= level) & np.isfinite(margins)

    def _fitted(self, chosen: Flags, rng: np.random.Generator) -> Mixture:
        places = self.places[chosen]
        whole = len(self.places)
        drawn = np.logaddexp.reduce(
            [log(count / whole) + density.log_density(places) for count, density in self._used], axis=0
        )
        return fit(places, tempered(log_exposure(places) - drawn), rng)


def tempered(logs: F64) -> F64:
    """Weights from their logarithms, raised to the greatest power up to 1 that leaves half of them
    effective.
    """
    logs = logs - np.max(logs)
    low, high = 0.0, 1.0
    if effective(np.exp(logs)) >= 0.5 * len(logs):
        return np.asarray(np.exp(logs))
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective(np.exp(middle * logs)) >= 0.5 * len(logs) else (low, middle)
    return np.asarray(np.exp(low * logs))


def fit(places: F64, weights: F64, rng: np.random.Generator) -> Mixture:
    """The mixture of a few normal densities for weighted places: expectation maximisation from each number of
    components, the number by the Bayesian information criterion. Parameters are rounded, so that the last
    bits of a linear algebra library do not change what is drawn.
    """
    dimensions = places.shape[1]
    share = weights / np.sum(weights)
    sure = effective(weights)
    best, least = None, np.inf
    for k in range(1, MOST_REGIONS + 1):
        size = 1 + dimensions + dimensions * (dimensions + 1) // 2
        if k > 1 and sure < k * (dimensions + 2):
            break
        made = _maximised(places, share, sure, k, rng)
        cost = -2.0 * sure * float(share @ made.log_density(places)) + k * size * log(max(2.0, sure))
        if cost >= least:
            break
        best, least = made, cost
    assert best is not None
    grown = sqrt(INFLATED) * best.factors
    shares = np.round(np.maximum(best.shares, 0.02), 4)
    return Mixture(shares / shares.sum(), np.round(best.means, 4), np.round(grown, 4))


def _maximised(places: F64, share: F64, sure: float, count: int, rng: np.random.Generator) -> Mixture:
    dimensions = places.shape[1]
    centres = [places[rng.choice(len(places), p=share)]]
    for _ in range(count - 1):  # k-means++
        far = share * np.min([np.sum((places - c) ** 2, axis=1) for c in centres], axis=0)
        total = float(far.sum())
        centres.append(places[rng.choice(len(places), p=far / total if total > 0.0 else share)])
    nearest = np.argmin([np.sum((places - c) ** 2, axis=1) for c in centres], axis=0)
    belongs = (nearest[:, None] == np.arange(count)).astype(float)
    before = -np.inf
    prior = PRIOR * PRIOR_VARIANCE * np.eye(dimensions)
    for _ in range(40):
        each = belongs * share[:, None]
        mass = np.sum(each, axis=0) + 1e-9
        means = each.T @ places / mass[:, None]
        off = places - means[:, None, :]
        spread = (off * each.T[:, :, None]).transpose(0, 2, 1) @ off
        covariances = (sure * spread + prior) / (sure * mass + PRIOR)[:, None, None]
        made = Mixture(mass / mass.sum(), means, np.linalg.cholesky(covariances))
        parts = made.log_parts(places)
        whole = np.logaddexp.reduce(parts, axis=1)
        belongs = np.exp(parts - whole[:, None])
        now = float(share @ whole)
        if now - before < 1e-3:
            break
        before = now
    return made


@dataclass(frozen=True)
class Rate:
    """What the last round shows. runs, failures: of it; value: probability of failure, with its interval of
    95 %; ess: effective failures; strayed: share of the value from failures where the search did not draw
    more often than the exposure does
    """

    runs: int
    failures: int
    value: float
    low: float
    high: float
    ess: float
    strayed: float

    @property
    def half_width(self) -> float:
        """Of the interval, as a share of the value."""
        return 0.5 * (self.high - self.low) / self.value if self.value > 0.0 else np.inf


def rate_of(weights: F64, fails: Flags) -> Rate:
    """The probability of failure from independent runs with weights p / q, (n,), and whether each fails.

    The interval is that of the central limit theorem for the logarithm, which the skewness of weights moves
    less than the value itself.
    """
    count = len(weights)
    hit = np.where(fails, weights, 0.0)
    value = float(np.mean(hit)) if count else 0.0
    if value <= 0.0:
        return Rate(count, 0, 0.0, 0.0, 1.0, 0.0, 0.0)
    relative = float(np.std(hit, ddof=1)) / value / sqrt(count) if count > 1 else np.inf
    factor = exp(min(700.0, 1.96 * relative))
    whole = count * value
    return Rate(
        count, int(np.sum(hit > 0.0)), value, value / factor, min(1.0, value * factor), effective(hit),
        float(np.sum(hit[hit >= 1.0])) / whole,
    )  # fmt: skip
