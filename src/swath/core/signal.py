"""The base of everything that flows between components, and how a sample type declares what it carries.

    @frozen
    class Moisture(Signal, about=About(frame="sensor")):
        "Water in the grain as a sensor reads it."

        share: Annotated[float, Quantity("", "water, share of the wet mass", column="moisture_share")]

From this follow its flat numbers, columns of tracks.parquet, ROS 2 message, exact samples, FMI variables and
its entry in docs/reference/signals.md.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import inf
from typing import Any, ClassVar, Literal, TypeVar, cast

from swath.core.frozen import frozen

T = TypeVar("T")
Frame = Literal["base", "sensor", "optical", "world"]


@dataclass(frozen=True)
class TrackColumn:
    """A column of tracks.parquet made from a field.

    name: with its unit, e.g. `x_m`
    unit: as in the name
    value: the number from what the field holds
    part: in its place, of a pose, one of `frames.PARTS`
    """

    name: str
    unit: str
    meaning: str
    value: Callable[[Any], float] = float
    part: str = ""


@dataclass(frozen=True)
class Quantity:
    """What a field of a signal holds; stands in its `Annotated`.

    unit: of the SI, "" = a plain number
    meaning: one line, with the sign
    shape: names or lengths of an array's dimensions
    nan: what nan means; "" = the field is never nan
    span: least and greatest value that it can have, of a pose of its place; a user's own signal needs none
    is_amount: belongs to the step of the sample (kg in that step), adds up over steps; otherwise a state
    column: name under which it is a column of tracks.parquet as it is
    columns: those that are made from it
    """

    unit: str
    meaning: str
    shape: tuple[str | int, ...] = ()
    nan: str = ""
    is_amount: bool = False
    column: str = ""
    span: tuple[float, float] = (-inf, inf)
    columns: tuple[TrackColumn, ...] = ()

    @property
    def tracks(self) -> tuple[TrackColumn, ...]:
        """All columns of tracks.parquet that come from the field."""
        own = (TrackColumn(self.column, self.unit or "-", self.meaning),) if self.column else ()
        return own + self.columns


@dataclass(frozen=True)
class Message:
    """A ROS 2 message that a sample becomes. type: e.g. `nav_msgs/Odometry`; meaning: of what, and when.

    topic: as the name of an output of a slot
    frame: "" = that of the signal
    """

    type: str
    meaning: str = ""
    topic: str = "/machine/slot/output"
    frame: str = ""


@dataclass(frozen=True)
class About:
    """What holds of a signal as a whole.

    frame: `base` (machine), `sensor`, `optical` (of a camera) or `world`
    messages: () = one `swath_msgs/<Class>` with all its fields in that frame
    is_thinned: who listens gets messages at the rate of tracks.parquet at most, not sample by sample
    is_bulky: in a thinned recording messages come five times a second
    samples: recorded bit for bit with `record: exact`, only with `full` (large truth, for metrics and
    pictures; also no variable of an exported FMU), or never, since its `messages` keep every bit
    track_order: place of its columns in every tracks.parquet; None = at the end, of machines that publish it
    time_column: column of tracks.parquet for the time that the newest sample is valid for [s]
    seen_as: where its arrays are seen, or why they are not: single numbers are columns of tracks.parquet
    """

    frame: Frame = "base"
    messages: tuple[Message, ...] = ()
    is_thinned: bool = False
    is_bulky: bool = False
    samples: Literal["exact", "full", "messages"] = "exact"
    track_order: int | None = None
    time_column: str = ""
    seen_as: str = "its message in run.mcap"


@frozen
class Signal:
    """Base of all samples. t: simulated time [ns]."""

    t: int
    about: ClassVar[About] = About()

    def __init_subclass__(cls, about: About | None = None, **rest: Any) -> None:
        super().__init_subclass__(**rest)
        if about is not None:
            cls.about = about


def per_signal(function: Callable[[type[Signal]], T]) -> Callable[[type[Signal]], T]:
    """Remember what a function says of each sample type."""
    kept: Any = cache(function)
    return cast("Callable[[type[Signal]], T]", kept)


def span_of(field: str, quantity: Quantity) -> tuple[float, float]:
    """Least and greatest value of a field; a standard deviation is never less than 0."""
    low, high = quantity.span
    return (max(low, 0.0), high) if field.endswith("_sd") else (low, high)


def signal_types() -> list[type[Signal]]:
    """All sample types by order of definition; a user's own are there once their file has been loaded."""
    found: list[type[Signal]] = []

    def add(kind: type[Signal]) -> None:
        for sub in kind.__subclasses__():
            found.append(sub)
            add(sub)

    add(Signal)
    return found
