"""Names of slot instances: `lidar_left` is an instance of the slot kind `lidar`."""

from collections.abc import Iterable

from swath.core.errors import InputError
from swath.scenario.slots import SLOTS


def kind_of(instance: str) -> str:
    """The slot kind of an instance: `lidar` and `lidar_left` -> `lidar`. InputError for no known kind."""
    names = [slot.name for slot in SLOTS if instance == slot.name or instance.startswith(f"{slot.name}_")]
    if not names:
        raise InputError("slot", instance, f"expected one of {', '.join(slot.name for slot in SLOTS)}")
    return max(names, key=len)


def first_of_kind(kind: str, instances: Iterable[str]) -> str | None:
    """The first instance of a kind, in the order given; None without one."""
    return next((name for name in instances if kind_of(name) == kind), None)
