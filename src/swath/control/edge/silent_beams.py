"""Beams that never answer while those beside them do: dirt on the window, or a dead part of the scanner.

Where dust or the open sky swallows beams it swallows their neighbours too, and "no echo" says something of
what is there. A beam that alone is silent says nothing, always of the same place.
"""

import numpy as np
from numpy.typing import NDArray

from swath.control.edge.profile import Clears

WINDOW = 50  # scans that a beam has to miss
NEIGHBOURS = 4  # beams to either side among which one has to answer
ANSWERS = 0.2  # share of the scans that it has to


class SilentBeams(Clears):
    """is_dead: which beams of the scans say nothing, shape (beam_count,); none before enough scans."""

    kept = ("is_dead", "_echoes", "_scans")

    def clear(self) -> None:
        """Let all beams count again."""
        self.is_dead: NDArray[np.bool_] = np.zeros(0, bool)
        self._echoes: NDArray[np.int64] = np.zeros(0, np.int64)
        self._scans = 0

    def take(self, has_echo: NDArray[np.bool_]) -> bool:
        """A scan's beams (beam_count,) that came back. True when others than before are dead."""
        if len(has_echo) != len(self._echoes):
            self.clear()
            self.is_dead, self._echoes = np.zeros(len(has_echo), bool), np.zeros(len(has_echo), np.int64)
        self._echoes += has_echo
        self._scans += 1
        if self._scans < WINDOW:
            return False
        dead = _alone(self._echoes, round(ANSWERS * WINDOW))
        is_new = bool((dead != self.is_dead).any())
        self.is_dead, self._scans = dead, 0
        self._echoes[:] = 0
        return is_new


def _alone(echoes: NDArray[np.int64], enough: int) -> NDArray[np.bool_]:
    """Beams without an echo between two near ones with enough of them."""
    count = len(echoes)
    place = np.arange(count)
    answers = echoes > 0
    before = np.maximum.accumulate(np.where(answers, place, -1))
    after = np.minimum.accumulate(np.where(answers, place, count)[::-1])[::-1]
    padded = np.concatenate([echoes, [0]])  # of places -1 and `count`
    is_near = (place - before <= NEIGHBOURS) & (after - place <= NEIGHBOURS)
    return ~answers & is_near & (padded[before] >= enough) & (padded[after] >= enough)
