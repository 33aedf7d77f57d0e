"""Results that detectors share: those in shadow of one run see the same scans, and ask the same where they
know the same so far.
"""

from collections.abc import Callable, Hashable
from functools import lru_cache, wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
KEPT = 16  # results of a function, the newest


class _Asked:
    """Arguments, equal where their keys are."""

    __slots__ = ("args", "key", "options")

    def __init__(self, key: Hashable, args: tuple[Any, ...], options: dict[str, Any]) -> None:
        self.key, self.args, self.options = key, args, options

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Asked) and self.key == other.key


def shared(key: Callable[P, Hashable]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A function of its arguments alone whose last results are kept, so that it is not done twice.

    key: all that the result depends on, None where it cannot be told; nobody writes into a result
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @lru_cache(maxsize=KEPT)
        def kept(asked: _Asked) -> R:
            return function(*asked.args, **asked.options)

        @wraps(function)
        def found(*args: P.args, **options: P.kwargs) -> R:
            asked = key(*args, **options)
            return function(*args, **options) if asked is None else kept(_Asked(asked, args, options))

        return found

    return decorate
