"""Integer hash of lattice indices: the same number anywhere, in any order, without state.

Finalizer of splitmix64: Steele, Lea, Flood 2014, doi:10.1145/2660193.2660195.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def hash_cells(seed: int, *indices: Any) -> NDArray[np.uint64]:
    """64 random bits per index tuple; indices are integer arrays that broadcast, results >= 1-D."""
    h = np.full(1, seed, dtype=np.uint64)
    for index in indices:
        h = _mix(h ^ _mix(np.atleast_1d(np.asarray(index, dtype=np.int64)).view(np.uint64)))
    return h


def hash_uniform(seed: int, *indices: Any) -> NDArray[np.float64]:
    """Uniform numbers in [0, 1) per index tuple."""
    return (hash_cells(seed, *indices) >> np.uint64(11)).astype(np.float64) * 2.0**-53


def _mix(h: NDArray[np.uint64]) -> NDArray[np.uint64]:
    h = h + np.uint64(0x9E3779B97F4A7C15)
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return h ^ (h >> np.uint64(31))
