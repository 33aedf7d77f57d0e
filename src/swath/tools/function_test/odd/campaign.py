"""`swath test run --odd`: runs in rounds, each aimed at what was not driven yet, in one folder.

Which runs a round has depends on the seed and on what the runs before it drove, and on nothing else: neither
on how many workers do them nor on when it was stopped. The folder holds copies of the ODD and the case made
of it, so that it can be read, judged again and gone on with wherever it lies.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.files.output_folder import check_folder
from swath.core.files.whole_file import copy_whole, write_whole
from swath.runtime.workers import workers_kept
from swath.tools.function_test.case import Claim, Point
from swath.tools.function_test.judging.first_batch import name_first, telling_nothing
from swath.tools.function_test.odd.binding import Odd, read_odd
from swath.tools.function_test.odd.causes import Cause, Explained, causes_of, excluded, explained, without
from swath.tools.function_test.odd.cells import OddCell, judged, needed_each
from swath.tools.function_test.odd.coverage import Coverage, coverage_of, driven_of
from swath.tools.function_test.odd.design import Design
from swath.tools.function_test.plan import AS_SET, Plan, code_hash, commit
from swath.tools.function_test.pool import Done
from swath.tools.function_test.session import Session, check_same, check_version, own_code, read_asked
from swath.tools.function_test.stored_line import Result

CAMPAIGN, ODD_FILE, CASE_FILE = "campaign.json", "campaign.odd.yaml", "campaign.yaml"
ROUND = 50  # runs between two looks at what was driven
RUNS, LEAST = 400, 8  # of a campaign, by default and at least


@dataclass(frozen=True)
class Campaign:
    """What a campaign asks.

    revision: of the ODD and its binding
    budgets: numbers of runs, each longer one after a look at what the shorter one showed
    sets, level: as in a plan
    seed: of the draws
    commit: of the checkout that the code came from, "" = unknown
    """

    odd: str
    revision: str
    budgets: tuple[int, ...]
    seed: int = 1
    sets: tuple[str, ...] = ()
    level: str = ""
    code: str = field(default_factory=code_hash)
    commit: str = field(default="", compare=False)


@dataclass(frozen=True)
class Conducted:
    """A campaign in its folder, with what its runs drove so far."""

    session: Session
    campaign: Campaign
    odd: Odd
    coverage: Coverage
    results: Sequence[Result]

    @property
    def folder(self) -> Path:
        """Its folder."""
        return self.session.folder

    @property
    def claim(self) -> Claim:
        """What is asked of each cell."""
        return self.odd.file.claim

    @property
    def is_complete(self) -> bool:
        """All runs are done, and their number stood fast before the first was judged."""
        return len(self.campaign.budgets) == 1 and len(self.results) >= self.campaign.budgets[0]

    @property
    def telling_nothing(self) -> dict[str, str]:
        """What tells nothing in the first round, each with a line that says so."""
        return telling_nothing(self.results[:ROUND])

    @cached_property
    def cells(self) -> list[OddCell]:
        """All cells with their verdicts."""
        return judged(self.coverage, self.claim, is_complete=self.is_complete)

    @cached_property
    def causes(self) -> list[Cause]:
        """Where runs fail more than elsewhere, the strongest contrast first."""
        return causes_of(self.coverage, self.claim, is_complete=self.is_complete)

    @cached_property
    def outside(self) -> Coverage:
        """What the runs drove that belong to no cause."""
        return without(self.coverage, self.causes)

    @cached_property
    def rest(self) -> list[OddCell]:
        """The cells judged by these runs alone."""
        if not self.causes:
            return self.cells
        return judged(self.outside, self.claim, is_complete=self.is_complete)

    @cached_property
    def why(self) -> dict[str, Explained]:
        """What the causes say of each broken cell, by its text."""
        return explained(self.coverage, self.cells, self.causes, self.claim)

    @cached_property
    def out(self) -> list[Cause | OddCell]:
        """What to leave out of the ODD, so that the function is shown in what remains."""
        return excluded(self.cells, self.causes, self.rest)


@workers_kept()
def conduct(
    folder: Path, campaign: Campaign, odd: Odd, workers: int, done: Done, client: Any = None
) -> Conducted:
    """Do the runs of a campaign that are not in its folder; `done` gets each new result.

    client: of dask, None = on `workers` processes here. InputError for another campaign in the folder.
    """
    campaign = _claim_folder(folder, campaign, odd)
    odd = replace(read_odd(folder / ODD_FILE), name=odd.name)
    design = Design(odd, needed_each(pair_count(odd), odd.file.claim), campaign.seed)
    points, results, coverage = list[Point](), list[Result](), Coverage(odd)
    while len(points) < campaign.budgets[-1]:
        count = min(ROUND, campaign.budgets[-1] - len(points))
        new = design.next(coverage.counted, len(points), count)
        part = _session(folder, campaign, new, len(points))
        if not points:
            with own_code(folder):
                part.plan.check()
        points += new
        for result in part.made(workers, done, client):
            results.append(result)
            coverage.add(driven_of(odd, result))
        if len(points) == count:
            name_first({}, telling_nothing(results))
    return Conducted(_session(folder, campaign, points), campaign, odd, coverage, results)


def open_campaign(session: Session) -> Conducted | None:
    """The campaign that a folder holds, None where it is another function test."""
    campaign = read_asked(session.folder / CAMPAIGN, Campaign, "a campaign")
    if campaign is None:
        return None
    odd, results = replace(read_odd(session.folder / ODD_FILE), name=campaign.odd), session.results()
    return Conducted(session, campaign, odd, coverage_of(odd, results), results)


def revision_of(odd: Odd) -> str:
    """What an ODD and its binding are: SHA-256 of the one, and all that the other says, with whole paths."""
    return f"{odd.domain.revision} {json.dumps([odd.document.data, odd.case_data()], sort_keys=True)}"


def pair_count(odd: Odd) -> int:
    """Pairs of buckets of two attributes that the ODD has."""
    return int(np.triu(odd.possible, 1).sum())


def _session(folder: Path, campaign: Campaign, points: Sequence[Point], first: int = 0) -> Session:
    """The runs at some points, of which the first has this number in the campaign; its seed is one more."""
    chosen = tuple((number, point) for number, point in enumerate(points, first + 1))
    case = str((folder / CASE_FILE).resolve())
    level = campaign.level or AS_SET  # what the binding sets is driven; what it cannot carry is not judged
    return Session(folder, Plan(case, sets=campaign.sets, level=level, points=chosen), first)


def _claim_folder(folder: Path, campaign: Campaign, odd: Odd) -> Campaign:
    """Make the folder one of this campaign; returns it with the budgets that it had.

    InputError for another one.
    """
    if campaign.budgets[0] < LEAST:
        raise InputError("--runs", campaign.budgets[0], f"expected {LEAST} runs or more")
    file = folder / CAMPAIGN
    before = read_asked(file, Campaign, "a campaign")
    if before is not None:
        was, now = (asdict(replace(each, budgets=(), commit="")) for each in (before, campaign))
        check_same(folder, "campaign", was, now)
        check_version(folder)
        is_longer = campaign.budgets[-1] > before.budgets[-1]
        campaign = replace(before, budgets=(*before.budgets, *campaign.budgets)) if is_longer else before
    else:
        own = ("*.openodd.yaml", ODD_FILE, CASE_FILE, CAMPAIGN)
        check_folder(folder, own, "campaign")
        campaign = replace(campaign, commit=commit())
        names = [f"{number}.openodd.yaml" for number in range(len(odd.domain.documents))]
        for name, document in zip(names, odd.domain.documents, strict=True):
            assert document.file is not None
            copy_whole(document.file, folder / name, "odd", "a domain")
        write_whole(folder / ODD_FILE, _copy(odd, names))
        write_whole(folder / CASE_FILE, odd.case_text())
    write_whole(file, json.dumps(asdict(campaign), indent=1, sort_keys=True) + "\n")
    return campaign


def _copy(odd: Odd, names: Sequence[str]) -> str:
    """The binding with the names of the copied documents and absolute paths of files."""
    from swath.documents.yaml_document import dump

    case = odd.case_data()
    return dump(
        {**odd.document.data, "openodd": list(names), "scenario": case["scenario"], "set": case["set"]}
    )
