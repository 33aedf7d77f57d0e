"""Levels: sibling files of a slot, chosen by name.

A built-in level is a module in one of the slot's packages; its file name is the level's name. It defines

    LEVEL = Level(SomeComponent, summary="...", cost="...", tolerance="...")

and, where it has other names with other defaults or inputs, `PRESETS`: name -> Level.

A level may also come from an entry point (group `swath.levels`, name `slot.level`; its package is loaded when
the level is chosen; evaluators, readers of logs and commands come the same way) or from a user's file
(`path/to/file.py:Class`). In every case the class has a nested or module-level dataclass of parameters,
`Params`, and is made by `Class(params, setup)`; `setup` is what the slot may know (see `signals/setup.py`).
Levels that stand for somebody else's part (an FMU, a ROS 2 node, a log) may fill any slot of a machine.
"""

import importlib
import importlib.util
import inspect
import pkgutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, make_dataclass, replace
from functools import cache
from importlib.metadata import Distribution, EntryPoint, entry_points
from pathlib import Path
from typing import Any

from swath.core.errors import InputError, near_miss
from swath.core.foreign_code import USER_MODULE, is_left, load_python, refusal
from swath.core.number_text import span

GROUP, OWN = "swath.levels", "swath"  # of entry points; the package whose own come first


WITNESSES = {
    "measured": "recordings",
    "peer": "software that we did not write",
    "closed form": "a formula that another method or a hand solved",
    "sibling": "a level that has another law",
    "truth": "the simulated world, of what control makes of it",
    "own law": "the level's own law, written once more: it says that the code is right, not that the law is",
    "left out": "nothing, the level has nothing of it",
}
"""Against what a level can be checked."""
OWN_LAW = "own law"


@dataclass(frozen=True)
class Beyond:
    """By how much metrics differed at most where a quantity was beyond its range, over drawn runs.

    low, high: as far as runs were drawn
    moved: by metric, in its unit
    heard_by: kinds of slots that heard the level in these runs, with their levels
    source: what measured it
    """

    low: float
    high: float
    moved: Mapping[str, float]
    heard_by: Mapping[str, str]
    source: str


@dataclass(frozen=True)
class Checked:
    """Range of a quantity of a run in which a level was checked.

    quantity: of `runtime/met.py`, or one that the level's parts meet themselves (`core.abilities.Meets`)
    low, high: in the unit of its name
    source: the test or page that checked it there
    witness: of WITNESSES, "" = nothing is said of it
    beyond: what use beyond the range changed, None = nobody measured it
    """

    quantity: str
    low: float
    high: float
    source: str
    witness: str = ""
    beyond: Beyond | None = field(default=None, hash=False)

    @property
    def span(self) -> str:
        """`0 to 20`."""
        return span((self.low, self.high))


@dataclass(frozen=True)
class KnownError:
    """How far off a metric may be at a level. size: in the metric's unit; against: what was compared with.

    source: what measured it
    """

    metric: str
    size: float
    against: str
    source: str


@dataclass(frozen=True)
class Level:
    """One level of a slot.

    component: class, called as component(params, setup)
    params: dataclass of its parameters
    summary: one line
    cost: what it costs
    tolerance: against the next dearer level, or what it was checked against
    sees_truth: a control level that is given the field although control is not (for isolating a part)
    is_link: somebody else's part, which may fill any slot: made with a `core.setup.LinkSetup`
    checked: ranges in which it was checked; nothing is known of a quantity that is not among them
    errors: of metrics, where a comparison measured them
    numbers: sections of the machine's data sheet that its results depend on
    steady: function `steady(machine, state, load)` that gives metrics by name in a steady state; from it
        follows how much each number of the data sheet matters
    given: metrics that are an input of the level, and no result
    """

    component: Any
    params: Any
    summary: str
    cost: str = ""
    tolerance: str = ""
    sees_truth: bool = False
    is_link: bool = False
    checked: tuple[Checked, ...] = ()
    errors: tuple[KnownError, ...] = ()
    numbers: tuple[str, ...] = ()
    steady: Any = None
    given: tuple[str, ...] = ()

    def preset(self, summary: str, cost: str, component: Any = None, **fixed: Any) -> "Level":
        """The level with the keys `fixed` at these values, as a level of its own, which counts as exact.

        A scenario cannot set these keys. component: class instead of that of this level
        """
        values = [(key, Any, field(default=value, init=False)) for key, value in fixed.items()]
        params = make_dataclass("Params", values, bases=(self.params,), frozen=True)
        made = self.component if component is None else component
        return replace(
            self, component=made, params=params, summary=summary, cost=cost, tolerance="exact", errors=()
        )

    @property
    def is_unread(self) -> bool:
        """True where its code was left unread: nothing is known of it."""
        return isinstance(self.component, Unread)


class Registry:
    """Which packages hold the levels of which slot kind.

    links: package of the levels that any kind in `linkable` may have, with `is_link` set
    gone: `kind.level` of levels of version 0.2 -> what to use instead
    """

    def __init__(
        self,
        packages: Mapping[str, Sequence[str]],
        *,
        links: str | None = None,
        linkable: Sequence[str] = (),
        gone: Mapping[str, str] | None = None,
    ) -> None:
        self.packages = dict(packages)
        self._links, self._linkable, self._gone = links, tuple(linkable), gone or {}

    def names(self, kind: str) -> list[str]:
        """Names of the built-in levels of a slot kind, in alphabetical order; no links."""
        return [name for package in self._packages(kind) for name in _levels_in(package)]

    def installed(self, kind: str) -> dict[str, str]:
        """Levels of a slot kind in installed packages, with the package, which is not loaded for this."""
        return installed(kind)

    def links(self) -> list[str]:
        """Names of the levels that any linkable slot may have."""
        return [*_levels_in(self._links)] if self._links else []

    def get(self, kind: str, level: str, *, base: Path | None = None) -> Level:
        """The level, from a built-in file, an entry point, or `file.py:Class` (relative to `base`)."""
        if level in HERE:
            return _level_of_class(HERE[level])
        if ".py:" in level:
            return _from_file(kind, level, base or Path.cwd())
        linked = [self._links] if self._links and kind in self._linkable else []
        for package in [*self._packages(kind), *linked]:
            if level.isidentifier() and importlib.util.find_spec(f"{package}.{level}") is not None:
                return self._checked(importlib.import_module(f"{package}.{level}"), kind, level)
        for package in self._packages(kind):
            if level in (presets := _levels_in(package)):
                return presets[level]
        if (loaded := installed_part(kind, level)) is not None:
            return loaded if isinstance(loaded, Level) else _level_of_class(loaded)
        if instead := self._gone.get(f"{kind}.{level}"):
            raise InputError(f"{kind}.level", level, f"expected another level: it is gone, {instead}")
        names = [*self.names(kind), *self.installed(kind), *(self.links() if linked else [])]
        if level.endswith(".py"):
            raise InputError(f"{kind}.level", level, f"expected the class in it, too: {level}:MyClass")
        expected = f"expected one of {', '.join(names)}, or file.py:Class{near_miss(level, names)}"
        raise InputError(f"{kind}.level", level, expected)

    def _packages(self, kind: str) -> Sequence[str]:
        if kind not in self.packages:
            raise InputError("slot", kind, f"expected one of {', '.join(sorted(self.packages))}")
        return self.packages[kind]

    def _checked(self, module: Any, kind: str, level: str) -> Level:
        found = getattr(module, "LEVEL", None)
        if not isinstance(found, Level):
            raise InputError(f"{kind}.level", level, f"expected one of {', '.join(self.names(kind))}")
        return found


@cache
def _levels_in(package: str) -> dict[str, Level]:
    """The levels of a package by name: its files that are one, and their presets."""
    path = importlib.import_module(package).__path__
    files = [i.name for i in pkgutil.iter_modules(path) if not i.name.startswith("_")]
    found: dict[str, Level] = {}
    for name in files:
        module = importlib.import_module(f"{package}.{name}")
        if isinstance(level := getattr(module, "LEVEL", None), Level):
            found |= {name: level, **getattr(module, "PRESETS", {})}
    return dict(sorted(found.items()))


def installed(kind: str) -> dict[str, str]:
    """Names of what installed packages have of a kind (a slot, `evaluator`, `log`, `command`), with the
    package, which is not loaded for this.
    """
    points = [e for e in _entry_points() if e.name.startswith(f"{kind}.")]
    return {e.name.partition(".")[2]: _package(e) for e in sorted(points, key=lambda e: _package(e) == OWN)}


def installed_part(kind: str, name: str) -> Any:
    """What an installed package has under a name of a kind, loaded; None where there is none.

    InputError where two packages have that name.
    """
    found = [e for e in _entry_points() if e.name == f"{kind}.{name}"]
    found = [e for e in found if _package(e) == OWN] or found
    if len(found) > 1:
        packages = " and ".join(sorted(map(_package, found)))
        raise InputError(kind, name, f"expected one installed package with that name, {packages} have it")
    return found[0].load() if found else None


def _package(point: EntryPoint) -> str:
    return _name_of(point.dist) if point.dist else point.value


@cache
def _name_of(package: Distribution) -> str:
    """Parsed once: a command asks for each entry point."""
    return str(package.name)


@cache
def _entry_points() -> tuple[EntryPoint, ...]:
    """What installed packages have for swath."""
    return tuple(entry_points(group=GROUP))


HERE: dict[str, Any] = {}
"""Classes of this process by the level that stands for them: those that a notebook or script hands over."""


def level_here(component: type) -> str:
    """The level that stands for a class in this process: `here:Name`.

    A later class of that name takes its place, as a cell that is run again does.
    """
    name = f"here:{component.__name__}"
    HERE[name] = component
    return name


def _from_file(kind: str, reference: str, base: Path) -> Level:
    key, class_name = f"{kind}.level", reference.rpartition(":")[2]
    if is_left(reference, base):
        return Level(Unread(key, reference), None, "code that was not read")
    module = load_python(key, reference, base)
    found = getattr(module, class_name, None)
    if found is None:
        raise InputError(key, reference, f"{module.__file__} has no {class_name}")
    return found if isinstance(found, Level) else _level_of_class(found)


@dataclass(frozen=True)
class Unread:
    """In the place of the class of a level whose code was left unread: it cannot be made."""

    key: str
    reference: str

    def __call__(self, *_: Any) -> Any:
        """InputError."""
        raise InputError(self.key, self.reference, refusal())


def _level_of_class(component: Any) -> Level:
    params = getattr(component, "Params", None)
    summary = (component.__doc__ or component.__name__).strip().splitlines()[0]
    return Level(component, params, summary, cost="not stated", tolerance="not stated")


def user_line(error: BaseException) -> tuple[str, int] | None:
    """File and line of the innermost call of a user's own level on the way to an error; None without one.

    Of what such a level inherits from a built-in one, where its class begins.
    """
    found, trace = None, error.__traceback__
    while trace is not None:
        frame, part = trace.tb_frame, type(trace.tb_frame.f_locals.get("self"))
        if str(frame.f_globals.get("__name__", "")).startswith(USER_MODULE):
            found = frame.f_code.co_filename, trace.tb_lineno
        elif found is None and part.__module__.startswith(USER_MODULE):
            with suppress(OSError, TypeError):  # its file is gone
                found = inspect.getfile(part), inspect.getsourcelines(part)[1]
        trace = trace.tb_next
    return found
