"""Which of the keys that were set the parts of a run ask for.

A part gets its parameters as a copy in which every field that differs from its default tells when it is read.
What is made of parameters early and used late tells in their place (`gathered`, `telling`), so that a key
counts as asked for when somebody uses what was made of it. Reads while no part is made or stepped, such as
those of a judge, do not count.
"""

import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from typing import Any, TypeVar

T = TypeVar("T")
Tell = Callable[[], bool]  # a field was read; True: it need not be told again
ALL = ""  # asks for a key in the name of all parts: the field while it is made, a part for its own keys
TELLS, KINDS = "_tells", "_kinds"  # of a class whose fields tell, and of its copies with changes


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


class _Telling:
    """A field that tells when it is read."""

    def __init__(self, name: str, tell: Tell, raw: Callable[[Any], dict[str, Any]]) -> None:
        self.name, self.tell, self.raw = name, tell, raw

    def __get__(self, held: Any, kind: Any = None) -> Any:
        if held is None:
            return self
        if PRESENT.heard is not None:
            PRESENT.heard.append(self.tell)
        elif self.tell() and self.name in vars(type(held)):
            delattr(type(held), self.name)  # told for good: from now on it is read as fast as any other
        return self.raw(held)[self.name]

    def __set__(self, held: Any, value: Any) -> None:
        self.raw(held)[self.name] = value


def _raw_of(kind: type) -> Callable[[Any], dict[str, Any]]:
    """What gives the attributes of an object of a class, whatever the class says of `__dict__`."""
    found: Any = next(vars(base)["__dict__"] for base in kind.__mro__ if "__dict__" in vars(base))
    return found.__get__  # type: ignore[no-any-return]


def telling_kind(kind: type[T], tells: Mapping[str, Tell]) -> type[T]:
    """A class like another one, whose objects tell when these fields are read; those that go by all
    attributes (`vars`, pickle) read every field.
    """
    raw = _raw_of(kind)

    def read_all(held: Any) -> dict[str, Any]:
        for name in tells:
            getattr(held, name)
        return raw(held)

    def reduced(held: Any, protocol: Any) -> Any:
        read_all(held)
        return bare(held).__reduce_ex__(protocol)

    members: dict[str, Any] = {name: _Telling(name, tell, raw) for name, tell in tells.items()}
    members |= {"__class__": property(lambda held: kind), "__dict__": property(read_all)}
    members |= {"__module__": kind.__module__, "__reduce_ex__": reduced, "__doc__": kind.__doc__}
    members |= {TELLS: tells, KINDS: {}}
    return type(kind.__name__, (kind,), members)


def _copy(held: Any, kind: type, changes: Mapping[str, Any]) -> Any:
    made: Any = object.__new__(kind)
    raw = _raw_of(held.__class__)
    raw(made).update({**raw(held), **changes})
    return made


def bare(held: T) -> T:
    """The same without telling."""
    return _copy(held, held.__class__, {}) if TELLS in vars(type(held)) else held


def telling(held: T, tells: Mapping[str, Tell], changes: Mapping[str, Any] | None = None) -> T:
    """A copy that tells when these fields are read, too. changes: fields that become something else."""
    if not tells and not changes:
        return held
    known: Mapping[str, Tell] = vars(type(held)).get(TELLS, {})
    kind = telling_kind(held.__class__, {**known, **tells})
    return _copy(held, kind, changes or {})  # type: ignore[no-any-return]


def replaced(held: T, **changes: Any) -> T:
    """As `dataclasses.replace`; the fields that stay go on telling."""
    made: T = replace(bare(held), **changes)  # type: ignore[type-var]
    if not (tells := vars(type(held)).get(TELLS)):
        return made
    kinds, named = vars(type(held))[KINDS], frozenset(changes)
    if named not in kinds:
        left = {name: tell for name, tell in tells.items() if name not in changes}
        kinds[named] = telling_kind(held.__class__, left)
    return _copy(made, kinds[named], {})  # type: ignore[no-any-return]


class Asked:
    """Who asks for which of the keys that were set.

    by: key -> the parts that asked so far; about: key -> class and name of its field
    is_of_parts: the keys are a part's own, and nobody else has its parameters: every read counts
    """

    def __init__(self, *, is_of_parts: bool = False) -> None:
        self.by: dict[str, set[str]] = {}
        self.about: dict[str, tuple[Any, str]] = {}
        self._begun: dict[str, set[str]] = {}
        self._is_of_parts, self._found = is_of_parts, 0

    def watched(self, params: T, path: str, each: Collection[str] = ()) -> T:
        """A copy of parameters that tells what is read of them; None and what is no dataclass as it is.

        path: their key
        each: fields of which it matters which part asks, in each run anew; the others, once somebody has
            read them, count for all
        """
        if not is_dataclass(params) or not hasattr(params, "__dict__"):
            return params
        tells, changes, kind = {}, {}, type(params)
        for own in fields(params):
            value = getattr(params, own.name)
            if not own.init or _is_usual(value, own):
                continue
            key, found = f"{path}.{own.name}", self._found
            changes[own.name] = self._inside(value, key, is_each=own.name in each)
            if self._found == found:  # nothing inside was set
                tells[own.name] = self._tell(key, (kind, own.name), own.name in each)
        return telling(params, tells, changes)

    def tells(self, section: Any, path: str) -> dict[str, Tell]:
        """Keys of a section of a scenario that are set -> what tells, in each run anew, who asks for them."""
        kind, said = type(section), section.model_fields_set
        usual = {n: own.get_default(call_default_factory=True) for n, own in kind.model_fields.items()}
        own = [n for n in usual if n in said and getattr(section, n) != usual[n]]
        return {n: self._tell(f"{path}.{n}", (kind, n), is_each=True) for n in own}

    def _inside(self, value: Any, key: str, *, is_each: bool) -> Any:
        if isinstance(value, tuple | list) and any(is_dataclass(item) for item in value):
            return type(value)(
                [self._inside(item, f"{key}.{i}", is_each=is_each) for i, item in enumerate(value)]
            )
        if not is_dataclass(value) or isinstance(value, type):
            return value
        return self.watched(value, key, [own.name for own in fields(value)] if is_each else ())

    def _tell(self, key: str, about: tuple[Any, str], is_each: bool) -> Tell:
        self.by.setdefault(key, set())
        self.about[key] = about
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


def _is_usual(value: Any, own: "Field[Any]") -> bool:
    """Whether a field has its default."""
    usual = own.default if own.default_factory is MISSING else own.default_factory()
    return value is usual or (value == usual) is True
