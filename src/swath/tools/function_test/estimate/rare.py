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

from swath.signals import F64, Mask
from swath.tools.function_test.search.boundary import sobol_points

# Shares, counts and factors of the search, without unit. Where no source is named they were chosen on the
# shapes under `BUILT_WITH` of benchmarks/rare_failures.py, so that intervals hold what they should.
# Where runs are drawn
WIDE = (1.5, 2.25)  # scales of the densities that reach beyond the exposure: 2.25 finds 1e-4 in 1 of 20
FIRST = 0.2  # share of the runs of the search that are spread evenly before anything is known
ROUNDS, ROUND_LEAST = 12, 16  # of the search after these; runs of a round, which are done together
# Shares of a round: near the failures, away from those known, everywhere
NEAR, AWAY, WIDELY = 0.4, 0.35, 0.25
KNOWN_LEAST = 2  # failures from which on a part of each round goes away from them
CORRECTING = 4  # rounds at the dear level that correct where the cheap one found failures
# The last round
DEFENSIVE, WIDENED = 0.1, 0.1  # shares drawn as the exposure (Owen & Zhou: 0.1), and more widely
STARTED = 0.15  # share drawn as the cheap level proposes
TAILS, TAIL = 0.25, 1.8  # share of the fitted components that is this much wider: few runs know no tails
# What a density is fitted to, and how
ELITE = 0.1  # share of the runs, while the level is above 0 (Au & Beck 2001)
# Runs at least: a mean and a variance of each dimension, and a reserve
ELITE_LEAST, ELITE_PER_DIMENSION = 20, 3
TEMPERED = 0.5  # share of the runs of a fit that stays effective
MOST_REGIONS = 8  # components of a fitted mixture
HEAVY = 0.95  # share of the weight from which components start: light outliers are no region
ALIKE = 0.5  # share of the runs that components get alike, the rest by their weight: few runs know no shares
INFLATED = 1.2  # of the covariances of fitted components
# Runs that this variance counts for: failures are narrower than the exposure's 1
PRIOR, PRIOR_VARIANCE = 4.0, 0.3
COVERED = 3.0  # standard deviations around a component within which a run belongs to it
DIGITS = 4  # of fitted parameters, so that the last bits of a linear algebra library change no draw
# Numerics
STEPS, ENOUGH = 40, 1e-3  # of expectation maximisation: at most; less log-likelihood a run is no gain
HALVINGS = 12  # of the power of tempered weights: to 1 / 4096
NO_MASS, JUST_BELOW = 1e-9, 1e-12  # added to the share of a component; margins below 0 by less count as kept
# What a probability is computed from
Z_95 = 1.96  # standard deviations of a normal variable that hold 95 %
ESS_LEAST = 30.0  # effective failures (as ESS of importance weights: 30 make a mean nearly normal)
OVERLOOKED_MOST = 0.2  # of the probability that may lie outside the regions that the search found


@dataclass(frozen=True)
class Mixture:
    """Normal densities. shares: (k,), sum 1; means: (k, d); factors: lower Cholesky ones, (k, d, d)."""

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

    def covers(self, at: F64) -> Mask:
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


def _spread_evenly(dimensions: int, count: int, rng: np.random.Generator) -> F64:
    """Places of Sobol's sequence, moved by chance, as the exposure and more widely in turn, (count, d)."""
    from scipy.special import ndtri

    shares = (sobol_points(count, dimensions) + rng.random(dimensions)) % 1.0
    scales = np.resize((1.0, *WIDE), count)
    return np.asarray(scales[:, None] * ndtri(np.clip(shares, NO_MASS, 1.0 - NO_MASS)))


class Hunt:
    """The rounds that look for failures. dimensions: of normal space; budget: runs of all rounds together.

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
        density = self._density() if self._used else self._start
        self._used.append((count, density))
        if self.places.size or self._is_corrected:
            return density.draw(rng, count)
        return _spread_evenly(self._dimensions, count, rng)

    def tell(self, places: F64, margins: F64) -> None:
        """What came of them: margins (n,), < 0 where the limit is broken; nan counts for nothing."""
        self.places = np.vstack([self.places, places])
        self.margins = np.append(self.margins, margins)

    def last(self) -> Mixture:
        """The density of the last round, which fixes the regions that were found."""
        self._found = self._fitted(self._elite(np.ones(len(self.margins), dtype=bool)))
        parts = [(DEFENSIVE, exposure(self._dimensions)), (WIDENED, exposure(self._dimensions, WIDE))]
        rest = 1.0 - DEFENSIVE - WIDENED
        if self._is_corrected:
            parts.append((STARTED, self._start))
            rest -= STARTED
        return joined([*parts, ((1.0 - TAILS) * rest, self._found), (TAILS * rest, self._found.spread(TAIL))])

    def overlooked(self, places: F64) -> Mask:
        """Whether places (n, d) of the last round lie outside the regions that were found, (n,) of bool."""
        return ~self._found.covers(places)

    def _density(self) -> Mixture:
        """Where margins are least, where they are least away from the failures that are known, everywhere."""
        everywhere = np.ones(len(self.margins), dtype=bool)
        main = self._fitted(self._elite(everywhere))
        parts = [(NEAR, main), (WIDELY, exposure(self._dimensions, (1.0, *WIDE)))]
        failing = self.margins < 0.0
        if np.sum(failing) >= KNOWN_LEAST:
            known = self._fitted(failing)
            away = ~known.covers(self.places) & ~np.isnan(self.margins)
            if np.sum(away) > self._least:
                parts.append((AWAY, self._fitted(self._elite(away))))
        return joined(parts)

    @property
    def _least(self) -> int:
        return ELITE_LEAST + ELITE_PER_DIMENSION * self._dimensions

    def _elite(self, among: Mask) -> Mask:
        """The runs with the least margins, all that fail if these are enough, (n,) of bool."""
        margins = np.where(among & ~np.isnan(self.margins), self.margins, np.inf)
        count = int(np.sum(np.isfinite(margins)))
        wanted = min(count, max(self._least, int(ELITE * count)))
        level = max(-JUST_BELOW, float(np.sort(margins)[max(0, wanted - 1)]))
        return np.asarray(margins <= level) & np.isfinite(margins)

    def _fitted(self, chosen: Mask) -> Mixture:
        if not np.any(chosen):
            return exposure(self._dimensions, (1.0, *WIDE))
        places = self.places[chosen]
        whole = len(self.places)
        drawn = np.logaddexp.reduce(
            [log(count / whole) + density.log_density(places) for count, density in self._used], axis=0
        )
        return fit(places, tempered(log_exposure(places) - drawn))


def tempered(logs: F64) -> F64:
    """Weights from their logarithms, raised to the greatest power up to 1 that leaves enough of them
    effective.
    """
    logs = logs - np.max(logs)
    low, high = 0.0, 1.0
    if effective(np.exp(logs)) >= TEMPERED * len(logs):
        return np.asarray(np.exp(logs))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (
            (middle, high) if effective(np.exp(middle * logs)) >= TEMPERED * len(logs) else (low, middle)
        )
    return np.asarray(np.exp(low * logs))


def fit(places: F64, weights: F64) -> Mixture:
    """The mixture of a few normal densities for weighted places: expectation maximisation from each number of
    components, the number by the Bayesian information criterion.
    """
    dimensions = places.shape[1]
    share = weights / np.sum(weights)
    sure = effective(weights)
    best, least = None, np.inf
    for k in range(1, MOST_REGIONS + 1):
        size = 1 + dimensions + dimensions * (dimensions + 1) // 2
        if k > 1 and sure < k * (dimensions + 2):
            break
        made = _maximised(places, share, sure, k)
        cost = -2.0 * sure * float(share @ made.log_density(places)) + k * size * log(max(2.0, sure))
        if cost < least:
            best, least = made, cost
    assert best is not None
    grown = sqrt(INFLATED) * best.factors
    shares = np.round((1.0 - ALIKE) * best.shares + ALIKE / len(best.shares), DIGITS)
    return Mixture(shares / shares.sum(), np.round(best.means, DIGITS), np.round(grown, DIGITS))


def _maximised(places: F64, share: F64, sure: float, count: int) -> Mixture:
    dimensions = places.shape[1]
    order = np.argsort(-share, kind="stable")
    heavy = places[order[: 1 + int(np.searchsorted(np.cumsum(share[order]), HEAVY))]]
    centres = [heavy[0]]
    for _ in range(count - 1):  # the farthest from those before, as regions lie apart
        far = np.min([np.sum((heavy - c) ** 2, axis=1) for c in centres], axis=0)
        centres.append(heavy[int(np.argmax(far))])
    nearest = np.argmin([np.sum((places - c) ** 2, axis=1) for c in centres], axis=0)
    belongs = (nearest[:, None] == np.arange(count)).astype(float)
    before = -np.inf
    prior = PRIOR * PRIOR_VARIANCE * np.eye(dimensions)
    for _ in range(STEPS):
        each = belongs * share[:, None]
        mass = np.sum(each, axis=0) + NO_MASS
        means = each.T @ places / mass[:, None]
        off = places - means[:, None, :]
        spread = (off * each.T[:, :, None]).transpose(0, 2, 1) @ off
        covariances = (sure * spread + prior) / (sure * mass + PRIOR)[:, None, None]
        made = Mixture(mass / mass.sum(), means, np.linalg.cholesky(covariances))
        parts = made.log_parts(places)
        whole = np.logaddexp.reduce(parts, axis=1)
        belongs = np.exp(parts - whole[:, None])
        now = float(share @ whole)
        if now - before < ENOUGH:
            break
        before = now
    return made


@dataclass(frozen=True)
class Rate:
    """What the last round shows.

    runs, failures: of it
    value: probability of failure, with its interval of 95 %
    ess: effective failures
    overlooked: share of the value from failures outside the regions that the search found
    """

    runs: int
    failures: int
    value: float
    low: float
    high: float
    ess: float
    overlooked: float

    @property
    def half_width(self) -> float:
        """Half width of the interval, as a share of the value."""
        return 0.5 * (self.high - self.low) / self.value if self.value > 0.0 else np.inf


def rate_of(weights: F64, fails: Mask, overlooked: Mask | None = None) -> Rate:
    """The probability of failure from independent runs with weights p / q, (n,), and whether each fails.

    overlooked: whether each lies outside the regions that the search found

    The interval is that of the central limit theorem for the logarithm, which the skewness of weights moves
    less than the value itself.
    """
    count = len(weights)
    hit = np.where(fails, weights, 0.0)
    value = float(np.mean(hit)) if count else 0.0
    if value <= 0.0:
        return Rate(count, 0, 0.0, 0.0, 1.0, 0.0, 0.0)
    relative = float(np.std(hit, ddof=1)) / value / sqrt(count) if count > 1 else np.inf
    factor = exp(min(700.0, Z_95 * relative))
    whole = count * value
    return Rate(
        count, int(np.sum(hit > 0.0)), value, value / factor, min(1.0, value * factor), effective(hit),
        0.0 if overlooked is None else float(np.sum(hit[overlooked])) / whole,
    )  # fmt: skip
