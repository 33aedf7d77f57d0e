"""The base of everything that flows between components."""

from swath.core.frozen import frozen


@frozen
class Signal:
    """Base of all samples. t: simulated time [ns]."""

    t: int
