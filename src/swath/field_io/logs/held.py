"""Channels at the moments of rows: how long a value holds, and which of several sources of a name counts."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

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

    values: Array
    at: Times
    count: int = 0
    last: int = -LATEST
    steps: list[tuple[float, float]] = field(
        default_factory=list
    )  # of blocks: usual, and longest but a tenth

    def take(self, rows: Times, t: Times, values: Array) -> None:
        """The next block of samples."""
        order = np.argsort(t, kind="stable")
        t, values = t[order], values[order]
        if not len(t):
            return
        steps = np.diff(t, prepend=self.last) if self.count else np.diff(t)
        if len(steps):
            self.steps.append((float(np.median(steps)), float(np.quantile(steps, 0.9))))
        begin = int(np.searchsorted(rows, t[0]))
        which = np.searchsorted(t, rows[begin:], side="right") - 1
        newer = t[which] >= self.at[begin:]
        self.values[begin:][newer], self.at[begin:][newer] = values[which][newer], t[which][newer]
        self.count, self.last = self.count + len(t), int(t[-1])

    def stopped(self, rows: Times) -> NDArray[np.bool_]:
        """Rows at which a channel that comes steadily has not come for too long, shape (n,)."""
        usual, long = np.median(self.steps, axis=0) if self.steps else (0.0, np.inf)
        if self.count < FEWEST_STEADY or long > STEADY * usual:
            return np.zeros(len(rows), bool)
        return (self.count > 0) & (rows - self.at > max(OLDEST, PERIODS * usual)) & (rows >= self.at)


def at_rows(
    log: Channels, wanted: Mapping[str, Parts], rows: Times
) -> tuple[dict[str, Array], dict[str, int]]:
    """Values of names at the rows, and notes on those that stop: with how many rows."""
    columns = {n: _Column(np.full(len(rows), np.nan), np.full(len(rows), -LATEST)) for n in wanted}
    into = {part: (columns[name], factor) for name, parts in wanted.items() for part, factor in parts.items()}
    for name, t, values in log.blocks(into):
        into[name][0].take(rows, t, values * into[name][1])
    notes = {}
    for name, column in columns.items():
        stopped = column.stopped(rows) & np.isfinite(column.values)
        is_lost = stopped & (rows >= column.last) if log.is_held else stopped
        column.values[is_lost] = np.nan
        if stopped.sum() > MANY * len(rows):
            then = "its last value holds" if stopped.sum() > is_lost.sum() else "not known there"
            notes[f"lost: rows without {name}, which else comes steadily: {then}"] = int(stopped.sum())
    return {name: column.values for name, column in columns.items()}, notes


def times_of(log: Channels, names: Collection[str]) -> Times:
    """Times of channels, the first in each interval of SHORTEST."""
    thinned = [t[np.unique(t // SHORTEST, return_index=True)[1]] for _, t, _ in log.blocks(names)]
    return np.unique(np.concatenate([*thinned, np.zeros(0, np.int64)]))


def shown_names(log: Channels) -> dict[str, str]:
    """Column as a table shows it, `Speed [km/h]` -> channel, or name of several."""
    units = {**{name: log.units[several[0]] for name, several in log.sources.items()}, **log.units}
    return {f"{name} [{unit}]" if unit else name: name for name, unit in units.items()}


def known_names(log: Channels) -> dict[str, str]:
    """Quantity -> channel, or name of several."""
    shown = shown_names(log)
    return {key: shown[c.column] for key, c in guess([*shown], log.path).columns.items()}


def chosen(log: Channels, name: str, key: str, entry: Callable[[str], str]) -> tuple[Parts, tuple[str, ...]]:
    """The channels that count for a name, and notes: of several sources one, or all where each begins when
    the one before has ended.

    key: the quantity; entry: the line that chooses one. InputError where nothing decides between them.
    """
    if not (sources := log.sources.get(name)):
        return {name: 1.0}, ()
    symbol, own = si_unit(log.units[sources[0]]) or (log.units[sources[0]], 1.0)
    units = {s: si_unit(log.units[s]) or (log.units[s], 1.0) for s in sources}
    parts = {source: {source: factor / own} for source, (kind, factor) in units.items() if kind == symbol}
    values = _beside(log, parts)
    order = sorted(values or parts, key=lambda s: log.spans[s])
    if all(log.spans[b][0] > log.spans[a][1] for a, b in pairwise(order)):
        return {part: factor for s in order for part, factor in parts[s].items()}, ()
    size = SIZE_M / abs(own) / (METRES if symbol == "rad" else 1.0) if key in PLACES else None
    choice = choose(key, values, entry, size=size, file=log.path)
    return parts[choice.name], choice.notes


def _beside(log: Channels, sources: Mapping[str, Parts]) -> dict[str, Array]:
    """Values of the sources that have one, as far as they are new, half a step behind each sample of any."""
    times = {source: times_of(log, parts) for source, parts in sources.items()}
    steps = [float(np.median(np.diff(t))) for t in times.values() if len(t) >= FEWEST_STEADY]
    step = int(min(steps, default=0.0))
    rows = np.unique(np.concatenate([*times.values()])) + step // 2
    values = at_rows(log, sources, rows)[0]
    for source, t in times.items():
        if step and len(t):
            last = t[np.maximum(np.searchsorted(t, rows, side="right") - 1, 0)]
            values[source][rows - last > step] = np.nan
    return {source: v for source, v in values.items() if np.isfinite(v).any()}
