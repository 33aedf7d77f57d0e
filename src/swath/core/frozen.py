"""Frozen dataclasses that are quick to make: samples are made some hundred times per simulated second."""

from dataclasses import MISSING, dataclass, fields
from typing import Any, TypeVar, dataclass_transform

T = TypeVar("T")


@dataclass_transform(frozen_default=True)
def frozen(cls: type[T]) -> type[T]:
    """`dataclass(frozen=True)` whose `__init__` writes its dictionary at once, in a quarter of the time.

    TypeError for a class with slots, `__post_init__`, or fields that are made by a factory.
    """
    made = dataclass(frozen=True)(cls)
    is_plain = all(f.default_factory is MISSING and f.init for f in fields(made))  # type: ignore[arg-type]
    if not is_plain or hasattr(made, "__post_init__") or "__slots__" in vars(made):
        raise TypeError(f"{cls.__name__}: expected plain fields")
    names = [f.name for f in fields(made)]  # type: ignore[arg-type]
    defaults = {f.name: f.default for f in fields(made) if f.default is not MISSING}  # type: ignore[arg-type]
    taken = ", ".join(f"{n}=defaults[{n!r}]" if n in defaults else n for n in names)
    kept = "; ".join(f"d[{n!r}] = {n}" for n in names)
    space: dict[str, Any] = {"defaults": defaults}
    exec(f"def __init__(self, {taken}):\n d = self.__dict__; {kept}", space)
    quick = space["__init__"]
    quick.__qualname__, quick.__module__ = f"{cls.__qualname__}.__init__", cls.__module__
    made.__init__ = quick  # type: ignore[method-assign]
    return made
