"""How much of the header's width cuts crop, as a smooth number."""

from math import exp

from swath.core.component import KeepsState

OVER_M = 1.0  # of travel: the field cuts whole cells of 1.6 cm, so that less scatters by more than 1 %


class FillGauge(KeepsState):
    """Area cut over area swept, forgetting exponentially over a metre of travel; at most 1.

    width: of the header [m]
    """

    kept = ("_cut", "_swept")

    def __init__(self, width: float) -> None:
        self._width = width
        self.clear()

    def clear(self) -> None:
        """Nothing swept yet."""
        self._cut = self._swept = 0.0

    def read(self, cut: float, swept: float) -> float:
        """Share of the width that cuts, 0..1, after a step that swept and cut so much [m2].

        0 in a step that swept nothing: a machine that stands cuts nothing.
        """
        if swept <= 0.0:
            return 0.0
        kept = exp(-swept / (self._width * OVER_M))
        self._cut = self._cut * kept + cut
        self._swept = self._swept * kept + swept
        return min(self._cut / self._swept, 1.0)
