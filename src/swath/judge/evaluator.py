"""What an evaluator is: it sees the samples of a run and the truth, and says what they come to in metrics.

An evaluator is a class made by `Class(setup)`, in a file of its own in `judge/evaluators/` that ends with
`LEVEL = Level(Class, None, summary="...")`, or in a user's file, named `my.py:Class` under the scenario's key
`evaluators`. Beside the members of `Evaluator` it may have those of `HasColumns`, `HasEvents`, `HasLimits`,
`HasSignals`, `Rests`, `TakesSeen` and `core.abilities.EndsRun` and `HasNotes`.

What they keep: rows of numbers of a whole run in memory that does not grow with its length; their means and
percentiles are nan where there is nothing.
"""

import dataclasses
import zlib
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import InitVar, dataclass
from functools import lru_cache, reduce
from operator import add
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np

from swath.core.ability import ByMembers
from swath.core.blocks import Block, Seen
from swath.core.errors import SwathError
from swath.core.files.unnamed_file import UnnamedFile
from swath.core.packed_state import saved_type
from swath.field.edges.edge_defects import Gap
from swath.field.memory_layout import Solids
from swath.field.site_setup import Bodies
from swath.record import packed_columns
from swath.record.message_factory import RecordedMachine
from swath.record.tracks import Column, EvenRows
from swath.signals import F64, Signal

STEP_M = 0.1  # spacing of the interpolated path


def rms(values: F64) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def mean(values: Any) -> float:
    """Mean."""
    return float(np.mean(values)) if len(values) else float("nan")


def ratio(part: float, whole: float) -> float:
    """Ratio of a part to the whole; nan where the whole is not positive."""
    return part / whole if whole > 0.0 else float("nan")


def even_path(distance: F64, value: F64, *, start: float = 0.0, step: float = STEP_M) -> tuple[F64, F64]:
    """Distances [m] every `step` from `start` on and the values interpolated there; empty when too short."""
    if len(distance) < 2 or distance[-1] < start:
        return np.zeros(0), np.zeros(0)
    at = np.arange(start, distance[-1], step)
    at = at[at >= distance[0]]
    return at, np.interp(at, distance, value)


BLOCK = 2048  # rows that are compressed together


@saved_type("_width", "_newest", "older")
class KeptRows:
    """Rows of `width` real numbers, in the order they come; older ones lie compressed, to the last bit, in a
    file that has no name.
    """

    def __init__(self, width: int) -> None:
        self._width = width
        self._older: list[tuple[str, int, int, int]] = []  # how packed, rows; place, bytes in the file
        self._newest = array("d")
        self._file = UnnamedFile()

    def __bool__(self) -> bool:
        return bool(self._older or self._newest)

    @property
    def older(self) -> list[tuple[str, int, bytes]]:
        """How packed, rows, bytes of the blocks in the file; setting them begins a new file."""
        return [*self._blocks()]

    @older.setter
    def older(self, blocks: Iterable[tuple[str, int, bytes]]) -> None:
        self._older, self._file = [], UnnamedFile()
        for block in blocks:
            self._put(*block)

    def add(self, rows: Any) -> None:
        """Add a row, or rows (n, width)."""
        self._newest.frombytes(np.asarray(rows, dtype=float).tobytes())
        if len(self._newest) >= BLOCK * self._width:
            block = np.array(self._newest).reshape(-1, self._width)
            how, data = packed_columns.pack(block)
            self._put(how, len(block), zlib.compress(data))
            del self._newest[:]

    def table(self, most: int | None = None) -> F64:
        """All rows, (n, width). most: spread evenly, where there are more."""
        rows = EvenRows(most)
        for how, count, data in self._blocks():
            shape = count, self._width
            rows.add({"": packed_columns.unpack(zlib.decompress(data), how, np.dtype("<f8"), shape)})
        rows.add({"": np.array(self._newest, dtype=float).reshape(-1, self._width)})
        return rows.columns().get("", np.zeros((0, self._width)))

    def _put(self, how: str, count: int, data: bytes) -> None:
        self._older.append((how, count, self._file.append(data), len(data)))

    def _blocks(self) -> Iterator[tuple[str, int, bytes]]:
        """How packed, rows, bytes."""
        for how, count, at, size in self._older:
            yield how, count, self._file.read(at, size)


SETTLING_M = 10.0  # driven before a run is judged: the machine starts beside its path
NEVER = 1 << 62  # ns, until when an evaluator rests that has nothing to judge


@dataclass(frozen=True)
class Metric:
    """A number that an evaluator computes of a run.

    name: name in `summary.json`, with its unit at the end
    unit: "1" for a share of one, "" for a count or ratio
    meaning: one line
    group: heading in lists and reports
    better: the better direction, "" where neither is
    label: name in reports, by default the name in words
    shown, decimals: of version 0.2, for reports: numbers are written by `swath.core.number_text` now
    is_windowed: whether it can also be computed of a part of the run
    is_identity: whether it is about the program alone, as a balance is: it rests on no level
    margin: of a count of events the metric that is 0 where one happens, left out where none can; "" = none
    """

    name: str
    unit: str
    meaning: str
    group: str
    better: Literal["lower", "higher", ""] = ""
    label: str = ""
    shown: InitVar[str] = ""
    decimals: InitVar[int] = 2
    is_windowed: bool = True
    is_identity: bool = False
    margin: str = ""


@dataclass(frozen=True)
class Event:
    """Something that happened during a run.

    t, end_t [ns]: when it began and ended; both are the same for what takes no time; end_t is None while it
    lasts. kind: one word, as in `after: gap`
    machine: to which it happened
    x, y: place in the world [m]
    distance: driven by the machine when it began [m]
    text: one sentence
    other: the second machine or the obstacle that takes part, if any
    end_distance: driven when it ended [m], nan while it lasts and for what takes no time
    because: why it happened: names and kinds of obstacles and machines, where the evaluator knows
    """

    t: int
    kind: str
    machine: str
    x: float
    y: float
    distance: float
    text: str
    end_t: int | None
    other: str = ""
    end_distance: float = float("nan")
    because: tuple[str, ...] = ()


class Edge(Protocol):
    """The initial edge of the crop as a curve; distances > 0 on the side of the crop. length [m]."""

    @property
    def length(self) -> float:
        """Length of the edge [m]."""

    def signed_distance(self, x: Any, y: Any) -> Any:
        """Distance from the edge [m], > 0 on the side of the crop."""

    def project(self, x: Any, y: Any) -> Any:
        """Distance along the edge of the nearest point on it [m]."""

    def point_at(self, s: Any) -> Any:
        """Place at a distance along the edge [m]."""


class Truth(Protocol):
    """What evaluators ask of the field. boundary: None where it has none."""

    @property
    def boundary(self) -> Any:
        """Boundary of the field, None without."""

    @property
    def soil(self) -> Any:
        """Soil that gives way, None on firm ground."""

    @property
    def rows(self) -> Any:
        """Rows of the crop, None without."""

    @property
    def ground_grain_kg(self) -> float:
        """Grain that lies on the ground [kg]."""

    def ground_height(self, x: Any, y: Any) -> Any:
        """Height of the ground [m]."""

    def standing(self, x: Any, y: Any, /) -> Any:
        """Whether crop stands at places."""

    def standing_along(self, starts: Any, step: Any, count: int, /) -> Any:
        """Whether crop stands along lines, (n, count)."""

    def why_outside(self, x: Any, y: Any) -> str:
        """Why none of these places is in the field, "" where one is."""

    def each_outside(self, x: Any, y: Any) -> list[str]:
        """The same of each row of places, (n, m)."""

    def standing_area(self, polygon: Any) -> float:
        """Area of standing crop in a polygon [m2]."""

    def standing_areas(self, triangles: Any, /) -> Any:
        """Area of standing crop in each triangle [m2]."""

    def recount(self) -> Any:
        """Count anew what stands."""


@dataclass(frozen=True)
class EvaluatorSetup:
    """What an evaluator knows of the run.

    field: the truth
    machines: all machines of the run, by name
    name: name of the machine to judge, "" for the whole field
    settling_m: distance driven before it judges [m]; 0 in a window
    contact_ends_run: whether a machine that touches something ends the run
    overlap: how far the machine's header end is meant to be out over the cut ground [m]
    gaps: gaps of the machine's edge
    obstacles: solids in the world
    bodies: bodies of all machines, where they stand now
    """

    field: Truth
    machines: Mapping[str, RecordedMachine]
    name: str = ""
    settling_m: float = SETTLING_M
    contact_ends_run: bool = True
    overlap: float = 0.0
    gaps: Sequence[Gap] = ()
    obstacles: Solids = dataclasses.field(default_factory=Solids)
    bodies: Bodies = dataclasses.field(default_factory=Bodies)

    @property
    def machine(self) -> RecordedMachine:
        """The machine to judge: its data sheet, sides, mountings and slots."""
        return self.machines[self.name]

    @property
    def edge(self) -> Edge:
        """The initial edge that the machine works along."""
        edge = self.machine.edge
        if edge is None:
            raise SwathError(f"{self.name} follows no edge")
        return edge


class Evaluator(Protocol):
    """Judges one machine, or the whole field.

    METRICS: every metric it may give
    OF_FIELD: whether it is made once, sees the samples of all machines and gives metrics of the field;
    otherwise it is made for each machine and sees that machine's samples only
    """

    METRICS: ClassVar[tuple[Metric, ...]]
    OF_FIELD: ClassVar[bool]

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Take the samples of a slot, such as `combine.motion`, at t [ns]; they must not be changed."""

    def metrics(self) -> dict[str, float]:
        """Metrics of what was seen: nan where nothing could be judged; left out where a part is missing."""
        ...


@runtime_checkable
class HasColumns(Protocol, metaclass=ByMembers):
    """An evaluator of a machine that adds columns to the tracks. COLUMNS: their names."""

    COLUMNS: ClassVar[tuple[str, ...]]

    def columns(self) -> tuple[Column, ...]:
        """The columns, as far as the run got."""


@runtime_checkable
class HasEvents(Protocol, metaclass=ByMembers):
    """An evaluator that notes events. EVENTS: their kinds; events: so far, in order of their beginning.

    An event that lasts stands in the list from its beginning on, and is replaced when it ends.
    """

    EVENTS: ClassVar[tuple[str, ...]]

    def events(self) -> Sequence[Event]:
        """Events so far, in order of their times."""


@runtime_checkable
class KnowsWhy(Protocol, metaclass=ByMembers):
    """An evaluator whose events say why they happened. COUNTED: metric -> kind of the events it counts."""

    COUNTED: ClassVar[Mapping[str, str]]


@runtime_checkable
class HasSignals(Protocol, metaclass=ByMembers):
    """An evaluator that is shown outputs only when a sample of one of these types is among them.

    SIGNALS: the types; an evaluator without it is shown everything
    """

    SIGNALS: ClassVar[tuple[type[Signal], ...]]


@runtime_checkable
class Rests(Protocol, metaclass=ByMembers):
    """An evaluator that need not be shown samples of before a time of its own. rests_until [ns]."""

    rests_until: int


@runtime_checkable
class TakesSeen(Protocol, metaclass=ByMembers):
    """An evaluator that takes many samples at once, some time after they were sent: what it says of them is
    the same whenever it looks. It is given them before it is asked for anything.
    """

    def take(self, seen: Seen) -> None:
        """Take samples."""


@runtime_checkable
class SeesLive(Protocol, metaclass=ByMembers):
    """One of these that has to look something up at the time of a sample.

    live: types of those; with `rests_until` (`Rests`) it is shown all that it wants from then on
    """

    @property
    def live(self) -> tuple[type[Signal], ...]:
        """Types of signals that are seen at their time."""

    def see_live(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Look at the outputs of a slot at a time [ns]."""


class Later:
    """An evaluator of a machine that takes samples (`TakesSeen`), shown one: it takes that one."""

    OF_FIELD: ClassVar[bool] = False

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Take in what a slot published at t [ns]."""
        kinds = tuple(map(type, outputs.values()))
        if isinstance(self, HasSignals) and not is_among(kinds, self.SIGNALS):
            return
        self.take(Seen.of_one(slot, t, outputs))
        if isinstance(self, SeesLive):
            is_awake = isinstance(self, Rests) and t >= self.rests_until
            if is_awake or is_among(kinds, self.live):
                self.see_live(slot, t, outputs)

    def take(self, seen: Seen) -> None:
        """Take in what slots published."""
        raise NotImplementedError


@lru_cache(maxsize=4096)
def is_among(kinds: tuple[type[Signal], ...], wanted: tuple[type[Signal], ...]) -> bool:
    """Whether samples of one of these types are wanted."""
    return any(issubclass(kind, wanted) for kind in kinds)


def added_up(begin: float, values: F64) -> float:
    """Sum of `begin` and the values, added one after the other in their order."""
    return float(reduce(add, values.tolist(), begin))


def held(block: Block | None, name: str, orders: Any, before: float) -> F64:
    """A field of the newest sample when others were sent; before: of those from before."""
    if block is None:
        return np.full(len(orders), before)
    at = block.before(orders)
    found: F64 = np.asarray(block[name], dtype=float)[at]
    found[at < 0] = before
    return found


@runtime_checkable
class HasLimits(Protocol, metaclass=ByMembers):
    """An evaluator with limits of its own, which hold unless the scenario sets a limit on the metric itself.

    LIMITS: metric -> min, max
    """

    LIMITS: ClassVar[Mapping[str, Mapping[str, float]]]
