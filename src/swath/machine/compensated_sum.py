"""Running totals that stay exact over hours."""

from swath.core.component import KeepsState


class Total(KeepsState):
    """Neumaier's compensated sum: the error does not grow with the number of terms.

    Neumaier 1974, doi:10.1002/zamm.19740540106.
    """

    kept = ("_total", "_rest")

    def __init__(self, total: float = 0.0, rest: float = 0.0) -> None:
        self._total, self._rest = total, rest

    def add(self, value: float) -> None:
        """Add one term."""
        new = self._total + value
        if abs(self._total) >= abs(value):
            self._rest += (self._total - new) + value
        else:
            self._rest += (value - new) + self._total
        self._total = new

    @property
    def value(self) -> float:
        """The sum so far."""
        return self._total + self._rest
