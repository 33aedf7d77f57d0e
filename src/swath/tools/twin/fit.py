"""`swath twin fit`: recordings of a pass become a scenario, with an interval of all that they say."""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.files.whole_file import write_whole
from swath.core.number_text import num
from swath.documents.json_file import read_object, write_json
from swath.documents.packed import readable
from swath.scenario.overrides import layered
from swath.scenario.scenario import Scenario, load_scenario
from swath.sensing.lidar_sheet import load_lidar
from swath.tools.compare_scans.compare import Path as Way
from swath.tools.function_test.case import Scalar
from swath.tools.function_test.session import read_asked
from swath.tools.height_map.source import Source
from swath.tools.tune.parameters import Parameter
from swath.tools.twin.bank import ASKED, Bank, BankAsked, make_bank, rounded_mount, words_of
from swath.tools.twin.learned import CENTRAL, Answer, answer_in
from swath.tools.twin.looks import Recorded, check_view, read_looks
from swath.tools.twin.unlike import Unlike

TWIN, SCENARIO = "twin.json", "twin.yaml"
LONGEST_M = 40.0  # of a run of a twin; chosen
HEAD = ("", "value", "95 % interval", "unit", "95 % of the range")


@dataclass(frozen=True)
class Estimate:
    """What is said of a key of the scenario. low, high: 95 %; prior: its ends, of which 95 % lie inside."""

    key: str
    value: float
    low: float
    high: float
    prior: tuple[float, float]
    is_known: bool

    @property
    def row(self) -> list[str]:
        """For a table, as under HEAD."""
        words, unit = words_of(self.key)
        prior = " to ".join(num(v) for v in self.prior)
        if not self.is_known:
            return [words, "not known", prior, unit, prior]
        return [
            words,
            num(self.value, beside=(self.low, self.high)),
            f"{num(self.low)} to {num(self.high)}",
            unit,
            prior,
        ]


@dataclass(frozen=True)
class Twin:
    """What recordings said.

    folder: of the twin; bank: folder of the bank; asked: what that is made of
    estimates: in the order of its parameters
    answer: the same as shares
    unlike: how unlike the bank the scans are
    recordings: names
    rate: scans a second [Hz]
    length: of the way [m]
    """

    folder: Path
    bank: Path
    asked: BankAsked
    estimates: Sequence[Estimate]
    answer: Answer
    unlike: Unlike
    recordings: Sequence[str]
    rate: float
    length: float

    @cached_property
    def values(self) -> dict[str, Scalar]:
        """Scenario keys and values of what is known; mounting as it was stated where it is not."""
        _, _, z, roll, pitch, yaw = self.asked.mount
        mount = f"{self.asked.slot}.mount"
        stated = {
            f"{mount}.z_m": z,
            f"{mount}.roll_deg": roll,
            f"{mount}.pitch_deg": pitch,
            f"{mount}.yaw_deg": yaw,
        }
        return {**stated, **{e.key: e.value for e in self.estimates if e.is_known}}

    @property
    def middle(self) -> dict[str, Scalar]:
        """The same where nothing is known: the middle of what is possible."""
        return {**self.values, **{p.key: p.value_at(0.5) for p in self.asked.parameters
                                  if any(e.key == p.key and e.is_known for e in self.estimates)}}  # fmt: skip

    def sets(self, values: Mapping[str, Scalar], length: float) -> list[str]:
        """Changes of the bank's scenario that make a run of it."""
        slot = self.asked.slot
        own = {key: value for key, value in self.asked.fixed.items() if key.startswith(slot)}
        run = {
            f"{slot}.rate_hz": round(self.rate, 2),
            "run.distance_m": round(min(length, LONGEST_M), 1),
            "expect": {},
        }
        every = {**own, **run, **values}
        return layered(self.asked.sets, [f"{key}={json.dumps(value)}" for key, value in every.items()])


def estimates_of(parameters: Sequence[Parameter], answer: Answer) -> list[Estimate]:
    """An answer in the units of the parameters."""
    found = []
    for n, p in enumerate(parameters):
        shares = answer.mean[n], answer.low[n], answer.high[n], *CENTRAL
        value, low, high, first, last = (float(p.value_at(float(share))) for share in shares)
        found.append(Estimate(p.key, value, low, high, (first, last), bool(answer.is_known[n])))
    return found


def ways_of(sources: Sequence[Source]) -> list[float]:
    """Lengths of the ways [m]. InputError where one is no single pass."""
    return [Way(source.track, source.name).length for source in sources]


def fit_twin(
    out: Path,
    sources: Sequence[Source],
    sheet: str,
    bank: Path,
    workers: int,
    progress: Callable[[int], Any],
    client: Any = None,
    **more: Any,
) -> Twin:
    """Ask a bank what recordings of one scanner say; it is made where it is not there.

    Parameters
    ----------
    out, bank : folders of the twin and of the bank.
    sources : recordings, with poses and mounting.
    sheet : of the scanner.
    workers, client : of the runs of the bank, as in `make_bank`.
    progress : a block that gives `done`, by the number of runs.
    more : of `BankAsked`.
    """
    ways = ways_of(sources)
    seen = read_looks(sources, load_lidar(sheet))
    asked = _asked(bank, sheet, sources, seen, more)
    with progress(asked.runs) as done:
        made = make_bank(bank, asked, workers, done, client)
    return write_twin(out, made, read_looks(sources, load_lidar(sheet), asked.view), sources, ways)


def _asked(bank: Path, sheet: str, sources: Sequence[Source], seen: Recorded, more: Any) -> BankAsked:
    """What the bank in a folder is made of, where one is there for such recordings, or a new one."""
    view = seen.view
    mount = rounded_mount(sources[0].mounting)
    new = BankAsked(sheet, mount, view.first, view.step, view.count, view.lines, **more)
    there = read_asked(bank / ASKED, BankAsked, "a bank")
    if there is None:
        new.check()
        return new
    check_view(view, there.view)
    ranges = {p.key: p for p in there.parameters}
    for name, value in zip(("z_m", "roll_deg", "pitch_deg"), mount[2:5], strict=True):
        p = ranges[f"{there.slot}.mount.{name}"]
        if not p.low <= value <= p.high:
            expected = f"expected {num(p.low)} to {num(p.high)}, as the bank was made for; another --bank"
            raise InputError(f"mount.{name}", value, expected, file=bank / ASKED)
    same = {
        "mount": there.mount,
        "first": there.first,
        "step": there.step,
        "beams": there.beams,
        "lines": there.lines,
    }
    return BankAsked(**{**asdict(new), **same})


def write_twin(
    out: Path, bank: Bank, seen: Recorded, sources: Sequence[Source], ways: Sequence[float]
) -> Twin:
    """The twin, and its files. Where scans are more unlike the bank than 95 % of its runs are, intervals are
    wider by as much.
    """
    unlike, length = bank.unlike(seen, ways), max(ways)
    answer = bank.ask(seen.numbers).widened(max(1.0, unlike.over))
    names = [source.name for source in sources]
    found = estimates_of(bank.asked.parameters, answer)
    twin = Twin(out, bank.folder.resolve(), bank.asked, found, answer, unlike, names, seen.rate, length)
    scenario = load_scenario(bank.asked.scenario, sets=[*twin.sets(twin.values, length), "name=twin"])
    write_scenario(out, scenario, names, found)
    about = {"rate_hz": seen.rate, "length_m": length, "recordings": names, "answer": asdict(answer)}
    about |= {"unlike": asdict(unlike)}
    asked = {"bank": str(twin.bank), "asked": asdict(bank.asked), "estimates": [asdict(e) for e in found]}
    plain = {"format": "swath twin 1", **asked, **about}
    write_json(out / TWIN, plain)
    return twin


def write_scenario(out: Path, scenario: Scenario, names: Sequence[str], found: Sequence[Estimate]) -> None:
    """Write twin.yaml, with what is said of each key above it."""
    head = [
        f"Made by swath twin fit of {', '.join(names)}",
        *(f"{e.key}: {e.row[1]} ({e.row[2]})" for e in found),
    ]
    write_whole(out / SCENARIO, "".join(f"# {line}\n" for line in head) + scenario.resolved())


def folder_of_twin(path: Path) -> Path:
    """The folder of a twin, by itself or the scenario in it. InputError where it is neither."""
    if not os.path.isdir(path) and (path.name != SCENARIO or not os.path.isfile(path)):
        raise InputError("twin", str(path), f"expected a folder of `swath twin fit`, or {SCENARIO} in it")
    return path if os.path.isdir(path) else path.parent


def read_twin(path: Path) -> Twin:
    """A twin by its folder or its scenario. InputError where it is none."""
    folder = folder_of_twin(path)
    data = read_object(folder / TWIN, "twin", "a twin, as swath twin fit writes it")
    with readable("twin", "a twin, as swath twin fit writes it", folder / TWIN):
        asked = data["asked"]
        lists = {k: tuple(asked[k]) for k in ("mount", "lines", "params", "sets")}
        found = [Estimate(**{**e, "prior": tuple(e["prior"])}) for e in data["estimates"]]
        return Twin(
            folder, Path(data["bank"]), BankAsked(**{**asked, **lists}), found, answer_in(data["answer"]),
            Unlike(**data["unlike"]),
            data["recordings"], data["rate_hz"], data["length_m"],
        )  # fmt: skip
