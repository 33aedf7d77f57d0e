"""What is stated of a drawn input beforehand, and what a reader made of it: shared by all kinds of draws."""

import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.documents.reasons import doubts, key_of

GOOD = ("right", "told", "refused")
BAD = ("miscounted", "wrong claim", "false alarm", "misnamed", "SILENT", "crash")


@dataclass(frozen=True)
class Truth:
    """A true number and by how much what is read may differ from it."""

    value: float
    share: float = 0.02
    absolute: float = 0.0

    def holds(self, got: float | None) -> bool:
        """Whether a number that was read is the true one."""
        return got is not None and abs(got - self.value) <= max(self.share * abs(self.value), self.absolute)


@dataclass(frozen=True)
class Drawn:
    """An input whose outcome is known before it is read.

    usual, unusual: what was drawn, `axis=value` each; unusual ones may change the result.
    write: makes the input in an empty folder and returns what the reader is given.
    truth: quantity -> what the result must say; empty: nobody could know it, it must be told or refused.
    expected: keys of which one must be in a doubt or in the refusal, where the result is not right; empty:
        the input has no fault, and no doubt may be told but those of `allowed`.
    counts: what the account of the result must say, e.g. records in the file.
    claims: quantity -> what must hold where the result says it at all.
    """

    seed: int
    write: Callable[[Path], Any]
    truth: Mapping[str, Truth]
    expected: frozenset[str] = frozenset()
    counts: Mapping[str, int] = field(default_factory=dict)
    usual: tuple[str, ...] = ()
    unusual: tuple[str, ...] = ()
    claims: Mapping[str, Truth] = field(default_factory=dict)
    allowed: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Got:
    """What a reader made of an input: quantity -> number, its notes, what its account says, and what it
    claims of further quantities, nan where it does not know.
    """

    numbers: Mapping[str, float | None]
    notes: tuple[str, ...] = ()
    counts: Mapping[str, int | None] = field(default_factory=dict)
    claims: Mapping[str, Sequence[float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Verdict:
    """word: of GOOD or BAD; why: what differs, and what was said about it, a line each."""

    drawn: Drawn
    word: str
    why: tuple[str, ...] = ()

    @property
    def is_good(self) -> bool:
        """Right, told or refused with the true cause."""
        return self.word in GOOD

    def lines(self) -> list[str]:
        """The verdict with all that was drawn."""
        drawn = self.drawn
        true = ", ".join(f"{k} {v.value:.4g}" for k, v in drawn.truth.items()) or "nobody could know"
        return [
            f"seed {drawn.seed}: {self.word}; unusual: {', '.join(drawn.unusual) or 'nothing'}",
            f"    usual: {', '.join(drawn.usual)}",
            f"    true: {true}; expected: {', '.join(sorted(drawn.expected)) or 'right, no doubt'}",
            *(f"    {line}" for line in self.why),
        ]


def verdict(drawn: Drawn, read: Callable[[Any, Path], Got]) -> Verdict:
    """Write the input, read it, judge. read: of what `write` returned and an empty folder for its result."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "in").mkdir()
        given = drawn.write(Path(folder) / "in")
        try:
            got = read(given, Path(folder) / "out")
        except InputError as error:
            is_true = error.key in drawn.expected
            text = str(error).replace(folder, "")
            return Verdict(drawn, "refused" if is_true else "misnamed", (f"refused: {text}",))
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            text = f"{type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
            return Verdict(drawn, "crash", (text.replace(folder, ""),))
    return judged(drawn, got)


def judged(drawn: Drawn, got: Got) -> Verdict:
    """The verdict on a result."""
    wrong = [
        f"{name}: {_text(got.numbers.get(name))}, true {true.value:.4g}"
        for name, true in drawn.truth.items()
        if not true.holds(got.numbers.get(name))
    ]
    off = [
        f"account, {name}: {got.counts.get(name)}, true {count}"
        for name, count in drawn.counts.items()
        if got.counts.get(name) != count
    ]
    claimed = [
        f"claim, {name}: {claim:.4g}, true {true.value:.4g}"
        for name, true in drawn.claims.items()
        for claim in got.claims.get(name, ())
        if claim == claim and not true.holds(claim)
    ]
    said = set(doubts(got.notes))
    if drawn.truth and not wrong:
        word = "right"
        for is_off, worse in ((claimed, "wrong claim"), (off, "miscounted"),
                              (not drawn.expected and said - drawn.allowed, "false alarm")):  # fmt: skip
            word = worse if is_off else word
    else:
        word = "told" if said & (drawn.expected | drawn.allowed) else "misnamed" if said else "SILENT"
    if not drawn.truth:
        wrong = [f"{name}: {_text(number)}" for name, number in got.numbers.items()]
    return Verdict(drawn, word, (*wrong, *off, *claimed, *(f"note: {note}" for note in got.notes)))


def _text(number: float | None) -> str:
    return "none" if number is None else f"{number:.4g}"


def without_key(notes: Iterable[str]) -> list[str]:
    """Notes that carry no key of the list."""
    return [note for note in notes if not key_of(note)]


def table(verdicts: Iterable[Verdict]) -> list[str]:
    """Counts of the verdicts, of draws without fault and of the others, and by unusual trait."""
    verdicts = list(verdicts)
    rows = {"all": verdicts, "without fault": [v for v in verdicts if not v.drawn.expected],
            "with a fault": [v for v in verdicts if v.drawn.expected]}  # fmt: skip
    for trait in sorted({t for v in verdicts for t in v.drawn.unusual}):
        rows[trait] = [v for v in verdicts if trait in v.drawn.unusual]
    words = [*GOOD, *BAD]
    lines = [f"| {'':34} | good | " + " | ".join(words) + " |", "|" + "---|" * (len(words) + 2)]
    for name, of in rows.items():
        counts = Counter(v.word for v in of)
        good = f"{sum(v.is_good for v in of)}/{len(of)}"
        cells = [f"{counts[w] or '':>{len(w)}}" for w in words]
        lines.append(f"| {name:34} | {good:>5} | " + " | ".join(cells) + " |")
    return lines
