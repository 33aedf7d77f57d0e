"""Which of the keys that were set the parts of a run ask for.

What a scenario chose becomes a copy in which every field that differs from its default tells when it is read.
What is made of fields early and used late tells in their place (`gathered`, `telling`), so that a key
counts as asked for when somebody uses what was made of it. Reads while no part is made or stepped, such as
those of a judge, do not count for the field.
"""

import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass, replace
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

T = TypeVar("T")
P = ParamSpec("P")
Tell = Callable[[], bool]  # a field was read; True: it need not be told again
ALL = ""  # asks for a key in the name of all parts: the field while it is made, a part for its own keys
TELLS = "_tells"  # among the attributes of an object: its fields that tell, with what they call


class _Present(threading.local):
    """part: the slot that is made or stepped, ALL while the field is made, None = neither: reads do not count
    heard: takes in what fields have to tell, None = they tell it.
    """

    part: str | None = None
    heard: list[Tell] | None = None


PRESENT = _Present()


@contextmanager
def asking(part: str | None) -> Iterator[None]:
    """Inside the block this part asks."""
    before, PRESENT.part = PRESENT.part, part
    try:
        yield
    finally:
        PRESENT.part = before


def gathered(make: Callable[[], T]) -> tuple[T, Tell]:
    """What is made, and what tells that all was asked for that was read to make it."""
    before, PRESENT.heard = PRESENT.heard, []
    try:
        made, heard = make(), tuple(dict.fromkeys(PRESENT.heard))
    finally:
        PRESENT.heard = before

    def tell() -> bool:
        done = [own() for own in heard]
        return all(done)

    return made, tell


def unasked(make: Callable[P, T]) -> Callable[P, T]:
    """A function whose reads ask for nothing, such as one that writes a scenario down."""

    @wraps(make)
    def made(*args: P.args, **kwargs: P.kwargs) -> T:
        return gathered(lambda: make(*args, **kwargs))[0]

    return made


def _own(held: Any) -> dict[str, Any]:
    """The attributes of an object, whatever its class says of `__dict__`."""
    return object.__getattribute__(held, "__dict__")  # type: ignore[no-any-return]


@cache
def _watching(kind: type) -> type:
    """A class like another one, whose objects tell when fields are read that they have under TELLS; those
    that go by all attributes (`vars`, pickle) read every one of them.
    """

    def read(held: Any, name: str) -> Any:
        if name == "__class__":
            return kind
        own = _own(held)
        tells = own.get(TELLS, {})
        if name in ("__dict__", "__reduce_ex__"):
            for each in [*tells]:
                getattr(held, each)
            return object.__getattribute__(bare(held), name)
        if name in tells:
            if PRESENT.heard is not None:
                PRESENT.heard.append(tells[name])
            elif tells[name]():  # told for good: where all are, it is read as fast as any other object
                tells.pop(name, None)
                if not tells and own.pop(TELLS, None) is not None:
                    object.__setattr__(held, "__class__", kind)
        return object.__getattribute__(held, name)

    own = {"__getattribute__": read, "__module__": kind.__module__, "__doc__": kind.__doc__}
    return type.__new__(type(kind), kind.__name__, (kind,), own)  # pydantic builds no validator for it


def _copy(held: T, tells: Mapping[str, Tell], changes: Mapping[str, Any]) -> T:
    """The same with other attributes, telling when these fields are read."""
    kind: Any = held.__class__
    made: Any = object.__new__(_watching(kind) if tells else kind)
    for base in kind.__mro__:
        for name in vars(base).get("__slots__", ()):
            if name not in ("__dict__", "__weakref__"):
                object.__setattr__(made, name, object.__getattribute__(held, name))
    own = {**_own(held), **changes, TELLS: {**tells}}
    _own(made).update(own if tells else {name: value for name, value in own.items() if name != TELLS})
    return made  # type: ignore[no-any-return]


def _tells_of(held: Any) -> Mapping[str, Tell]:
    """The fields of an object that tell when they are read."""
    return {} if type(held) is held.__class__ else _own(held).get(TELLS, {})


def bare(held: T) -> T:
    """The same without telling."""
    return held if type(held) is held.__class__ else _copy(held, {}, {})


def telling(held: T, tells: Mapping[str, Tell], changes: Mapping[str, Any] | None = None) -> T:
    """A copy that tells when these fields are read, too. changes: fields that become something else."""
    return _copy(held, {**_tells_of(held), **tells}, changes or {}) if tells or changes else held


def made_of(made: T, held: Any, names: Mapping[str, str]) -> T:
    """What was made of an object, telling in its place. names: field of what was made -> of the object."""
    tells = _tells_of(held)
    return telling(made, {name: tells[own] for name, own in names.items() if own in tells})


def replaced(held: T, **changes: Any) -> T:
    """As `dataclasses.replace`; the fields that stay go on telling."""
    made: T = replace(bare(held), **changes)  # type: ignore[type-var]
    return telling(made, {name: tell for name, tell in _tells_of(held).items() if name not in changes})


class Asked:
    """Who asks for which of the keys that were set.

    by: key -> the parts that asked so far; about: key -> class, name and value of its field
    is_of_parts: nobody but the run reads what has the keys: every read counts
    """

    def __init__(self, *, is_of_parts: bool = False) -> None:
        self.by: dict[str, set[str]] = {}
        self.about: dict[str, tuple[Any, str, Any]] = {}
        self._begun: dict[str, set[str]] = {}
        self._is_of_parts, self._found = is_of_parts, 0

    def watched(self, held: T, path: str, each: Collection[str] = ()) -> T:
        """A copy of parameters, or of a section, that tells what is read of it; anything else as it is.

        path: their key
        each: fields of which it matters which part asks, in each run anew; the others, once somebody has
            read them, count for all
        """
        if not _has_keys(held) or not hasattr(held, "__dict__"):
            return held
        tells, changes = {}, {}
        for name, value in _set_in(held):
            key, found = f"{path}.{name}", self._found
            changes[name] = self._inside(value, key, is_each=name in each)
            if self._found == found:  # nothing inside was set
                tells[name] = self.key(key, held, name, is_each=name in each)
        return telling(held, tells, changes)

    def _inside(self, value: Any, key: str, *, is_each: bool) -> Any:
        if isinstance(value, tuple | list) and any(is_dataclass(item) for item in value):
            return type(value)(
                [self._inside(item, f"{key}.{i}", is_each=is_each) for i, item in enumerate(value)]
            )
        if not _has_keys(value):
            return value
        return self.watched(value, key, [name for name, _ in _set_in(value)] if is_each else ())

    def key(self, key: str, held: Any, name: str, *, is_each: bool = False) -> Tell:
        """What tells that somebody asks for a key, a field of an object. is_each: as in `watched`."""
        self.by.setdefault(key, set())
        self.about[key] = type(held), name, getattr(held, name)
        self._found += 1
        if is_each:
            self._begun[key] = set()

        def tell() -> bool:
            part = ALL if self._is_of_parts else PRESENT.part
            if part is not None:
                self.by[key].add(part if is_each else ALL)
            return part is not None and not is_each

        return tell

    def begin(self) -> None:
        """What was asked for so far was asked for at the start of every run."""
        self._begun = {key: set(self.by[key]) for key in self._begun}

    def begin_again(self) -> None:
        """Another run begins."""
        self.by |= {key: set(parts) for key, parts in self._begun.items()}


def _has_keys(held: Any) -> bool:
    """Whether it is parameters, or a section of a scenario."""
    return (is_dataclass(held) or hasattr(held, "model_fields_set")) and not isinstance(held, type)


def _set_in(held: Any) -> Iterator[tuple[str, Any]]:
    """Fields that differ from their defaults, with their values."""
    if is_dataclass(held):
        usual = {
            own.name: own.default if own.default_factory is MISSING else own.default_factory()
            for own in fields(held)
            if own.init
        }
    else:
        own_fields = type(held).model_fields.items()
        usual = {name: own.get_default(call_default_factory=True) for name, own in own_fields}
    for name, default in usual.items():
        value = getattr(held, name)
        if value is not default and (value == default) is not True:
            yield name, value
