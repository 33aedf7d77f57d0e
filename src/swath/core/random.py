"""Counter-based random numbers: one stream per component name.

A draw depends on (seed, name, counter) alone, so results do not change with the number of threads, the
order in which components run, or what else is in the scenario, and a resumed run needs no generator state.
Philox 4x64: Salmon et al. 2011, doi:10.1145/2063384.2063405 (numpy's implementation).
"""

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Stream:
    """Random stream of one component.

    seed: the scenario's seed
    name: the component's full name, e.g. `combine.lidar`
    """

    seed: int
    name: str

    def at(self, counter: int = 0) -> np.random.Generator:
        """Generator of draw number `counter` (a step index or a time in ns; >= 0)."""
        words = np.zeros(4, dtype=np.uint64)
        words[3] = np.uint64(counter)
        return np.random.Generator(np.random.Philox(counter=words, key=self._key()))

    @property
    def key(self) -> np.ndarray:
        """The generator's key, two words of 64 bits, for kernels that draw themselves.

        The words 4 n to 4 n + 3 that `at(counter)` draws are block n + 1 of Philox 4x64: its counter words
        are (n + 1, 0, 0, counter).
        """
        return self._key()

    def child(self, name: str) -> "Stream":
        """Stream of a part of this component."""
        return Stream(self.seed, f"{self.name}.{name}")

    def integer(self) -> int:
        """A fixed 31-bit number of this stream: a seed for hashes inside kernels."""
        return int(self._key()[0] & np.uint64(0x7FFFFFFF))

    def _key(self) -> np.ndarray:
        return _key_of(self.seed, self.name)


class Normals:
    """Standard normal numbers of a stream, quicker, for sensors that draw at every sample.

    They are those of `stream.at(counter).standard_normal(shape)`, bit for bit; one generator is wound to each
    counter.
    """

    def __init__(self, stream: Stream) -> None:
        self._philox = np.random.Philox(counter=0, key=stream.key)
        self._generator = np.random.Generator(self._philox)
        state: Any = self._philox.state  # of nothing drawn yet
        self._counter = [0, 0, 0, 0]
        key = tuple(state["state"]["key"].tolist())
        plain = {"state": {"counter": self._counter, "key": key}, "buffer": tuple(state["buffer"].tolist())}
        self._state: Any = {**state, **plain}  # plain numbers are taken over in a third of the time

    def at(self, counter: int, shape: int | tuple[int, ...]) -> np.ndarray:
        """Draw number `counter` (a step index or a time in ns; >= 0)."""
        self._counter[3] = counter
        self._philox.state = self._state
        return self._generator.standard_normal(shape)

    def then_uniform(self) -> float:
        """The number of [0, 1) that `stream.at(counter)` draws after those that were drawn last."""
        return float(self._generator.random())

    def into(self, counter: int, place: np.ndarray) -> None:
        """The same numbers into an array that is there, of its shape."""
        self._counter[3] = counter
        self._philox.state = self._state
        self._generator.standard_normal(out=place)


@lru_cache(maxsize=1024)
def _key_of(seed: int, name: str) -> np.ndarray:
    digest = hashlib.sha256(f"{seed}/{name}".encode()).digest()
    return np.frombuffer(digest[:16], dtype="<u8")  # read-only
