"""Which runs come next: a covering array of pairs, filled up where little was driven.

Each run takes the combination of buckets, one an attribute, that fills the most pairs of buckets which are
still short of the number of runs wanted; pairs that no run has driven count first, the others by how often
they are met at work (exposure). It is a greedy covering array (AETG, Cohen et al. 1997,
doi:10.1109/32.605761) that is not ended when every pair is there once. The choice looks at what was driven,
never at whether runs passed: so in every cell the other attributes are spread alike, and the counts of a cell
may be judged as if they had been fixed before.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.signals import F64, I64
from swath.tools.function_test.odd.binding import Odd
from swath.tools.function_test.odd.openodd import Value

TRIES = 12  # combinations of which each run takes the best; with 1 all pairs come later, with 50 no sooner
RETRIES = 200  # draws of values until one lies inside the ODD
UNSEEN = 100.0  # worth of a pair that no run has; that of one which is short of runs is 0 to about 4


@dataclass(frozen=True)
class Design:
    """The draws of a campaign. wanted: runs in every pair of buckets; seed: of the draws."""

    odd: Odd
    wanted: int
    seed: int

    def next(self, done: F64 | I64, number: int, count: int) -> list[dict[str, Value]]:
        """Points of the next runs. done: runs in each pair of buckets, (n, n), a bucket with itself: its own.

        number: of the first of these runs in the campaign. InputError where nothing lies inside the ODD.
        """
        planned = np.array(done, dtype=float)
        points = []
        for place in range(number, number + count):
            rng = Stream(self.seed, f"odd {self.odd.name}").at(place)
            buckets, point = self._one(planned, rng)
            planned[np.ix_(buckets, buckets)] += 1.0
            points.append(point)
        return points

    def _one(self, planned: F64, rng: np.random.Generator) -> tuple[list[int], dict[str, Value]]:
        gain = self._gain(planned)
        tries: list[tuple[float, int, list[int]]] = []
        for _ in range(TRIES):
            buckets = self._combination(gain, rng)
            tries.append((-float(gain[np.ix_(buckets, buckets)].sum()), len(tries), buckets))
        for _, _, buckets in sorted(tries):
            if point := self._inside(buckets, rng):
                return buckets, point
        for _ in range(RETRIES):
            buckets = self._combination(np.zeros_like(gain), rng)
            if point := self._inside(buckets, rng):
                return buckets, point
        raise InputError("odd", self.odd.name, "expected buckets with a combination inside the ODD",
                         file=self.odd.path)  # fmt: skip

    def _gain(self, planned: F64) -> F64:
        """What one more run in each pair of buckets is worth."""
        exposure = np.concatenate([axis.exposure * axis.count for axis in self.odd.axes])
        short = np.clip(1.0 - planned / self.wanted, 0.0, 1.0) * (0.5 + 0.5 * np.outer(exposure, exposure))
        return np.where(self.odd.possible, short + UNSEEN * (planned < 1.0), -UNSEEN)

    def _combination(self, gain: F64, rng: np.random.Generator) -> list[int]:
        """A bucket of each attribute, chosen one after the other in a random order."""
        axes = self.odd.axes
        chosen: dict[int, int] = {}
        for place in rng.permutation(len(axes)).tolist():
            axis = axes[place]
            own = np.arange(axis.first, axis.first + axis.count)
            worth = gain[own][:, list(chosen.values())].sum(axis=1) if chosen else gain[own, own]
            ties = own[worth >= worth.max() - 1e-9]
            weights = axis.exposure[ties - axis.first] + 1e-6
            chosen[place] = int(rng.choice(ties, p=weights / weights.sum()))
        return [chosen[place] for place in range(len(axes))]

    def _inside(self, buckets: Sequence[int], rng: np.random.Generator) -> dict[str, Value]:
        """Values in these buckets that lie inside the ODD, {} where there seem to be none."""
        pairs = self.odd.possible[np.ix_(buckets, buckets)]
        if not pairs.all():
            return {}
        for _ in range(RETRIES):
            point = {
                axis.name: axis.value(bucket - axis.first, float(rng.random()))
                for axis, bucket in zip(self.odd.axes, buckets, strict=True)
            }
            if self.odd.domain.holds(point):
                return point
        return {}
