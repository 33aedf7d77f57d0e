"""Channels at the moments of rows: how long a value holds, and which of several sources of a name counts."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.field_io.logs.channels import Channels, si_unit
from swath.field_io.logs.columns import guess
from swath.field_io.logs.frames import LATEST, MANY, Times
from swath.field_io.logs.sources import choose

Array = NDArray[np.float64]
Parts = dict[str, float]  # channels of a name -> factor into its unit
SHORTEST, OLDEST = 50_000_000, 2_000_000_000  # ns: between two rows; how long each value holds at least
PERIODS = 5  # without a record after which one that comes steadily has stopped: ISO 11783-7 takes 3 to 10
FEWEST_STEADY = 10  # records by which a channel shows a period
STEADY = 3.0  # times the usual interval, in nine of ten of a channel that has one
PLACES = ("lat", "lon", "easting", "northing", "elevation")
SIZE_M, METRES = 100.0, 6_371_000.0  # what places are compared by (2 % of it are 2 m); m for each radian


@dataclass
class Held:
    """The values of a channel at the rows of a table: at each the last one, nan where it has grown old.

    read: fills in the values of some channels in one pass, and keeps them
    """

    name: str
    read: Callable[[str], Array]

    def numbers(self) -> Array:
        """One number per row."""
        return self.read(self.name)

    def __iter__(self) -> Iterator[str]:
        return (f"{value:g}" for value in self.numbers())


@dataclass
class _Column:
    """A channel on its way into rows. values, at: the last sample before each row, and when it was [ns]."""

    rows: Times
    count: int = 0
    last: int = -LATEST
    steps: list[tuple[float, float]] = field(
        default_factory=list
    )  # of blocks: usual, and longest but a tenth

    def __post_init__(self) -> None:
        self.values, self.at = np.full(len(self.rows), np.nan), np.full(len(self.rows), -LATEST)

    def take(self, t: Times, values: Array) -> None:
        """The next block of samples."""
        order = np.argsort(t, kind="stable")
        t, values = t[order], values[order]
        if not len(t):
            return
        steps = np.diff(t, prepend=self.last) if self.count else np.diff(t)
        if len(steps):
            self.steps.append((float(np.median(steps)), float(np.quantile(steps, 0.9))))
        begin = int(np.searchsorted(self.rows, t[0]))
        which = np.searchsorted(t, self.rows[begin:], side="right") - 1
        newer = t[which] >= self.at[begin:]
        self.values[begin:][newer], self.at[begin:][newer] = values[which][newer], t[which][newer]
        self.count, self.last = self.count + len(t), int(t[-1])

    def stopped(self) -> NDArray[np.bool_]:
        """Rows at which a channel that comes steadily has not come for too long, shape (n,)."""
        usual, long = np.median(self.steps, axis=0) if self.steps else (0.0, np.inf)
        if self.count < FEWEST_STEADY or long > STEADY * usual:
            return np.zeros(len(self.rows), bool)
        is_old: NDArray[np.bool_] = self.rows - self.at > max(OLDEST, PERIODS * usual)
        is_old &= np.isfinite(self.values)
        return is_old


def at_rows(
    log: Channels, wanted: Mapping[str, Parts], rows: Mapping[str, Times]
) -> tuple[dict[str, Array], dict[str, int]]:
    """Values of names, each at its rows, and notes on those that stop: with how many rows."""
    columns = {name: _Column(rows[name]) for name in wanted}
    into = {part: (columns[name], factor) for name, parts in wanted.items() for part, factor in parts.items()}
    for name, t, values in log.blocks(into):
        into[name][0].take(t, values * into[name][1])
    notes = {}
    for name, column in columns.items():
        stopped = column.stopped()
        is_lost = stopped & (column.rows >= column.last) if log.is_held else stopped
        column.values[is_lost] = np.nan
        goes_on = stopped & np.r_[False, stopped[:-1]]  # not of the first row behind a pause of all
        if goes_on.sum() > MANY * len(column.rows):
            then = "its last value holds" if stopped.sum() > is_lost.sum() else "not known there"
            notes[f"lost: rows without {name}, which else comes steadily: {then}"] = int(goes_on.sum())
    return {name: column.values for name, column in columns.items()}, notes


def times_of(log: Channels, names: Collection[str]) -> dict[str, Times]:
    """Times of channels, the first in each interval of SHORTEST."""
    found: dict[str, list[Times]] = {name: [np.zeros(0, np.int64)] for name in names}
    for name, t, _ in log.blocks(names):
        found[name].append(t[np.unique(t // SHORTEST, return_index=True)[1]])
    return {name: np.unique(np.concatenate(times)) for name, times in found.items()}


def shown_names(log: Channels) -> dict[str, str]:
    """Column as a table shows it, `Speed [km/h]` -> channel, or name of several."""
    units = {**{name: log.units[several[0]] for name, several in log.sources.items()}, **log.units}
    return {f"{name} [{unit}]" if unit else name: name for name, unit in units.items()}


def known_names(log: Channels) -> dict[str, str]:
    """Quantity -> channel, or name of several."""
    shown = shown_names(log)
    return {key: shown[c.column] for key, c in guess([*shown], log.path).columns.items()}


@dataclass
class Chosen:
    """Which channels count for names. refused: name -> why nothing decides."""

    parts: dict[str, Parts] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    refused: dict[str, InputError] = field(default_factory=dict)

    def of(self, name: str) -> Parts:
        """The channels of a name. InputError where it is refused."""
        if name in self.refused:
            raise self.refused[name]
        return self.parts[name]

    def add(self, log: Channels, names: Mapping[str, str], entry: Callable[[str, str], str]) -> None:
        """Choose for names -> quantity: of several sources one, or all where each begins when the one before
        has ended.

        entry: (quantity, source) -> the line that chooses it
        """
        several: dict[str, dict[str, Parts]] = {}
        for name in names:
            sources = log.sources.get(name, [])
            units = {s: si_unit(log.units[s]) or (log.units[s], 1.0) for s in sources}
            alike = [s for s in sources if units[s][0] == units[sources[0]][0]]
            several[name] = {s: {s: units[s][1] / units[sources[0]][1]} for s in alike}
            self.parts[name] = several[name][alike[0]] if alike else {name: 1.0}
        several = {name: of for name, of in several.items() if len(of) > 1}
        parts = {source: own for of in several.values() for source, own in of.items()}
        times = times_of(log, parts) if parts else {}
        steps = {name: _step([times[source] for source in of]) for name, of in several.items()}
        rows = {s: _behind([times[o] for o in of], steps[name]) for name, of in several.items() for s in of}
        values = at_rows(log, parts, rows)[0] if parts else {}
        for name, of in several.items():
            if steps[name]:
                for source in of:
                    values[source][~_is_new(times[source], rows[source], steps[name])] = np.nan
            held = {source: values[source] for source in of if np.isfinite(values[source]).any()}
            order = sorted(held, key=lambda source: log.spans[source])
            spans = [log.spans[source] for source in order]
            if all(len(times[source]) >= FEWEST_STEADY for source in order[:-1]) and all(
                later[0] > earlier[1] for earlier, later in pairwise(spans)
            ):
                one_by_one = {part: factor for source in order for part, factor in of[source].items()}
                self.parts[name] = one_by_one or self.parts[name]
                continue
            symbol, unit = si_unit(log.units[next(iter(of))]) or ("", 1.0)
            is_place = names[name] in PLACES
            size = SIZE_M / abs(unit) / (METRES if symbol == "rad" else 1.0) if is_place else None
            try:
                choice = choose(names[name], held, partial(entry, names[name]), size=size, file=log.path)
            except InputError as error:
                self.refused[name] = error
                continue
            self.parts[name] = of[choice.name]
            self.notes += choice.notes


def _step(times: Sequence[Times]) -> int:
    """The usual interval of the fastest that comes steadily [ns], 0 where none does."""
    return int(min((np.median(np.diff(t)) for t in times if len(t) >= FEWEST_STEADY), default=0.0))


def _behind(times: Sequence[Times], step: int) -> Times:
    """Half a step behind each sample of any."""
    return np.unique(np.concatenate([*times])) + step // 2


def _is_new(t: Times, rows: Times, step: int) -> NDArray[np.bool_]:
    """Rows with a sample at most a step before them, shape (n,)."""
    if not len(t):
        return np.zeros(len(rows), bool)
    is_new: NDArray[np.bool_] = rows - t[np.maximum(np.searchsorted(t, rows, side="right") - 1, 0)] <= step
    return is_new
