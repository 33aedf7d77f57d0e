"""Standard normal numbers of many streams at once: those of `core.random.Normals`, bit for bit."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from swath.core import portable
from swath.core.random import Normals, Stream
from swath.kernels import Repeated, repeatable, shared

LEVELS = 256  # of numpy's ziggurat (Marsaglia and Tsang 2000, doi:10.18637/jss.v005.i08)
ONE = 1 << 52  # what its 52 bits count to
DOUBT = 64  # bounds of levels are known to this, in shares of ONE; what is nearer to one numpy draws itself


class AllNormals:
    """rows: where the numbers go, a row for each stream, (n, k) float64 whose rows have no gaps."""

    def __init__(self, rows: np.ndarray) -> None:
        self._rows, self._alone = rows, list[Normals]()
        self._keys, self._slow = np.zeros((len(rows), 2), np.uint64), np.ones(len(rows), np.bool_)

    def reset(self, streams: Sequence[Stream]) -> None:
        """Draw from these streams from now on."""
        self._alone = [Normals(stream) for stream in streams]
        self._keys[:] = [stream.key for stream in streams]

    def launch(self, counter: np.ndarray, needs: np.ndarray) -> Repeated:
        """A launch that draws number `counter` (1,) int64 (a time in ns; >= 0) of every stream.

        It sets `needs` where `finish` has to complete it.
        """
        from swath.sensing.native.normals_kernel import draw_normals

        given = (self._keys, counter.view(np.uint64), *ziggurat(), self._rows, self._slow, needs)
        return repeatable(draw_normals, [shared(array) for array in given])

    def finish(self, counter: int) -> None:
        """Draw what numpy has to draw itself."""
        for k in np.flatnonzero(self._slow).tolist():
            self._alone[k].into(counter, self._rows[k])


@cache
def ziggurat() -> tuple[Any, Any, Any]:
    """Widths of numpy's levels over ONE, heights of the density there (the greatest is 1), and how far of ONE
    a number of each level is taken without more.

    numpy gives the widths: given a word of the level and a power of two it returns their product.
    """
    words = (1 << 49) + np.roll(np.arange(LEVELS), -2)  # level 1 last, which takes a second word
    halves = np.zeros(624, np.uint64)
    halves[0 : 2 * LEVELS : 2], halves[1 : 2 * LEVELS : 2] = words >> 32, words & 0xFFFFFFFF
    source = np.random.MT19937(0)
    source.state = {"bit_generator": "MT19937", "state": {"key": _untempered(halves), "pos": 0}}
    numbers = np.random.Generator(source).standard_normal(LEVELS) / (1 << 40)
    widths = np.roll(numbers, 2)
    bounds = (np.roll(widths, 1) / widths * ONE).astype(np.int64) - DOUBT
    bounds[1] = 0
    heights = portable.exp(-0.5 * (widths * ONE) ** 2)
    heights[0] = 1.0
    if (np.diff(widths[1:]) <= 0.0).any():  # another numpy, which then draws all itself
        bounds[:], heights[:] = 0, np.nan
    return widths, heights, bounds


def _untempered(words: np.ndarray) -> np.ndarray:
    """The state of a Mersenne twister whose next words are these (Matsumoto and Nishimura 1998)."""
    steps = [(18, 0xFFFFFFFF), (-15, 0xEFC60000), (-7, 0x9D2C5680), (11, 0xFFFFFFFF)]
    for by, mask in steps:
        made = words
        for _ in range(5):
            words = made ^ ((words >> by if by > 0 else words << -by) & mask)
    return words.astype(np.uint32)
