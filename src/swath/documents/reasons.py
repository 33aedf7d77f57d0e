"""The list of keys that notes and refusals of readers carry: `key: text`.

A note says how a file was read, or what is doubtful in it; a refusal is an InputError with that key. Who
reads many files looks for keys of doubts (`doubts`) and for errors.
"""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Reason:
    """What a key means. is_doubt: what was read may be wrong; else it says how it was read."""

    meaning: str
    is_doubt: bool = False


REASONS: dict[str, Reason] = {
    "form": Reason("what the file was read as, and by what it was decoded"),
    "unit": Reason("a unit that the file does not say: shown by the data, or the usual one"),
    "crop": Reason("the crop that was taken, and why"),
    "reference": Reason("the reference system or the datum that was taken"),
    "clock": Reason("how times were read"),
    "machines": Reason("how machines were told apart"),
    "derived": Reason("a quantity that was computed of others, or taken from elsewhere in the file"),
    "copies": Reason("what is there more than once, alike, and counts once"),
    "unused": Reason("what is in the file and has no part in the result"),
    "shape": Reason("how outlines, lines and areas were put together"),
    "sources": Reason("several sources say one quantity, and differ", is_doubt=True),
    "lost": Reason("records or values that the file states or holds, and the result does not", is_doubt=True),
    "damaged": Reason("a file that ends early, or holds what cannot be read", is_doubt=True),
    "timeline": Reason("stamps, intervals, ways and order that disagree", is_doubt=True),
    "plausible": Reason("numbers that their quantity cannot have, or that exclude each other", is_doubt=True),
    "mixed": Reason("a column or file that holds two different things", is_doubt=True),
    "place": Reason(
        "positions that disagree with the way, the field or their reference system", is_doubt=True
    ),
    "width": Reason("a header that is not as wide as its passes lie apart", is_doubt=True),
    "yield": Reason("a yield, or a mass, that the crop or the rest of the log contradicts", is_doubt=True),
    "moisture": Reason("a moisture that is unusual of the crop", is_doubt=True),
    "delay": Reason("a delay of the flow that is not known", is_doubt=True),
    "heights": Reason("heights that disagree, or are missing", is_doubt=True),
    "calibration": Reason("machines side by side that show different yields", is_doubt=True),
    "columns": Reason("a quantity that is needed and in no column", is_doubt=True),
}
"""Key -> what it means."""


def key_of(note: str) -> str:
    """The key of a note, '' where it carries none of the list."""
    key = note.partition(":")[0]
    return key if key in REASONS else ""


def doubts(notes: Iterable[str]) -> list[str]:
    """The keys of the notes that say a doubt, in their order."""
    return [key for key in map(key_of, notes) if key and REASONS[key].is_doubt]
