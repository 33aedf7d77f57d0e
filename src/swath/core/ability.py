"""Protocols that are asked for often: `isinstance` by the names of their members alone."""

from functools import cache, partial
from typing import Any, _ProtocolMeta


class ByMembers(_ProtocolMeta):
    """Metaclass of a protocol: whatever has its members is an instance.

    Every `runtime_checkable` protocol works so, but up to Python 3.11 the language looks the members up anew
    each time, 20 us.
    """

    def __instancecheck__(self, instance: Any) -> bool:
        return all(map(partial(hasattr, instance), _members(self)))


@cache
def _members(protocol: type) -> tuple[str, ...]:
    named = dict.fromkeys((*vars(protocol), *protocol.__annotations__))
    return tuple(name for name in named if not name.startswith("_"))
