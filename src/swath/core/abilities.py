"""What a component may be able to do beyond its six verbs: one small protocol for each ability.

Whoever uses an ability asks `isinstance(part, EndsRun)`; a component has it by having the member.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, Self, runtime_checkable

from swath.core.ability import ByMembers
from swath.core.frames import Pose
from swath.core.registry import Checked


@runtime_checkable
class HasMounting(Protocol, metaclass=ByMembers):
    """A sensor with a fixed place on its machine. mounting: pose_machine_sensor."""

    @property
    def mounting(self) -> Pose:
        """Pose of the sensor on its machine."""


@runtime_checkable
class HasRange(Protocol, metaclass=ByMembers):
    """A scanner. range_limits: least and greatest range that it reports, of its data sheet [m]."""

    @property
    def range_limits(self) -> tuple[float, float]:
        """Least and greatest range [m]."""


@runtime_checkable
class HasIdentity(Protocol, metaclass=ByMembers):
    """A sensor of a make. identity: what the device calls itself on its wire, empty = not known."""

    @property
    def identity(self) -> str:
        """Name on the wire."""


@runtime_checkable
class KnowsErrors(Protocol, metaclass=ByMembers):
    """A sensor that knows how far off it may be. errors: of a sample, by its fields in SI.

    Each has two standard deviations: of what is new with every sample, and of what stays during a run. 0 is
    exact; a sensor without this ability does not know.
    """

    def errors(self, sample: Any) -> Mapping[str, tuple[float, float]]:
        """Bias and standard deviation by field of the sample, in SI."""


@runtime_checkable
class HasOpticalFrame(Protocol, metaclass=ByMembers):
    """A camera. optical: pose of its optical frame (x right, y down, z forward) on the machine."""

    @property
    def optical(self) -> Pose:
        """Pose of the optical frame on the machine."""


@runtime_checkable
class OffersRates(Protocol, metaclass=ByMembers):
    """A sensor whose maker offers certain rates. offered: its name and these rates [Hz]."""

    @property
    def offered(self) -> tuple[str, Sequence[float]]:
        """Name and rates [Hz]."""


@runtime_checkable
class CountsRays(Protocol, metaclass=ByMembers):
    """A sensor that casts rays. ray_count: so far."""

    @property
    def ray_count(self) -> int:
        """Rays cast so far."""


@runtime_checkable
class CountsBeams(Protocol, metaclass=ByMembers):
    """A sensor that plays measurements. beam_count: so far; unmeasured_count: those without an answer."""

    @property
    def beam_count(self) -> int:
        """Beams so far."""

    @property
    def unmeasured_count(self) -> int:
        """Beams without a measurement so far."""


@runtime_checkable
class HasRanges(Protocol, metaclass=ByMembers):
    """A part that was checked over ranges of its own, such as those of its table, beside its level's."""

    @property
    def checked(self) -> Sequence[Checked]:
        """Ranges over which the part was checked."""


@runtime_checkable
class Meets(Protocol, metaclass=ByMembers):
    """A part that says itself what it meets: its own weather where it has one, what its beams see.

    meets: of a machine in a state, by quantity: a number, nan = it meets none; or values (n,) of its newest
    sample
    """

    def meets(self, state: Any) -> Mapping[str, Any]:
        """What the part meets, by quantity."""


@runtime_checkable
class MeetsLater(Protocol, metaclass=ByMembers):
    """A part that `Meets`, notes what it meets, and finds out what that is of many notes at once.

    note_met: what it takes, at the time; met: of notes, what the part met at each, as `Meets` has it
    """

    def note_met(self, state: Any) -> Any:
        """What there is to know of now."""

    def met(self, notes: Sequence[Any]) -> Sequence[Mapping[str, Any]]:
        """What the part met at each note."""


@runtime_checkable
class HasNotes(Protocol, metaclass=ByMembers):
    """A part with notes for the user. notes: whole sentences, for summary.json and the report."""

    @property
    def notes(self) -> Sequence[str]:
        """Whole sentences for the user."""


@runtime_checkable
class Closes(Protocol, metaclass=ByMembers):
    """A part that holds something outside: a process, a node, a bus. close: twice does nothing."""

    def close(self) -> None:
        """Let go of what is held."""


# why a run ended: its distance was driven, `max_duration_s`, Ctrl-C; what parts and evaluators say
ENDINGS = (
    "distance", "time", "stopped", "edge_lost", "log_over", "contact", "rollover", "stuck", "spill", "other",
)  # fmt: skip
DISTANCE, TIME, STOPPED, EDGE_LOST, LOG_OVER, *_, OTHER = ENDINGS


class Ending(str):
    """Why a run ended, in words. kind: one of ENDINGS."""

    kind: str

    def __new__(cls, text: str, kind: str = OTHER) -> Self:
        """Words of a kind."""
        made = super().__new__(cls, text)
        made.kind = kind if kind in ENDINGS else OTHER
        return made

    @classmethod
    def by(cls, who: str, why: str) -> Self:
        """The same with who said it before it."""
        return cls(f"{who}: {why}", why.kind if isinstance(why, Ending) else OTHER)


@runtime_checkable
class EndsRun(Protocol, metaclass=ByMembers):
    """A part, or an evaluator, that may end the run.

    end_reason: asked before every tick, with its time [ns], and of an evaluator where it was shown anything
    since; a text ends the run before that tick and says why in the summary (an `Ending`: with its name), an
    empty one lets it go on
    """

    def end_reason(self, t: int) -> str:
        """Why the run ends at a time [ns], "" where it goes on."""


@runtime_checkable
class StepsAnyLength(Protocol, metaclass=ByMembers):
    """A part whose step may be of any length, not only its period.

    steps_any_length: True for a part that, when a run ends between two of its steps, takes in what was sent
    to it since the last one; a process does so with the crop that the header still cut
    """

    @property
    def steps_any_length(self) -> bool:
        """Whether steps of any length are taken."""


@runtime_checkable
class NeedsRealTime(Protocol, metaclass=ByMembers):
    """A part that answers by the clock on the wall. needs_real_time: why; empty when it does not."""

    @property
    def needs_real_time(self) -> str:
        """Why the wall clock is needed, "" where it is not."""


@runtime_checkable
class ReadsFiles(Protocol, metaclass=ByMembers):
    """A part that reads files while the run goes on. reads: which; no run may be written over them."""

    @property
    def reads(self) -> Sequence[Path]:
        """Files that are being read."""


@runtime_checkable
class HasOverlap(Protocol, metaclass=ByMembers):
    """A steering law with a wanted overlap. overlap: of the header end over the cut ground [m]."""

    @property
    def overlap(self) -> float:
        """Wanted overlap of the header [m]."""
