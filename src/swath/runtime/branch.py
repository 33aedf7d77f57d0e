"""Going on from an earlier moment of a run, into a folder of its own.

The new run is the one that a fresh start with its events would give: sample by sample, with the same digest,
tracks and recording. A save of the earlier run only spares the way to that moment.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swath.core.errors import InputError, SwathError
from swath.core.number_text import num
from swath.core.schedule import NS
from swath.runtime.changes import Interventions, Restart


@dataclass(frozen=True)
class Start:
    """Where a run branches off. folder: of the earlier run; at: time of the first change [ns].

    saves: whether those of the earlier run are used
    """

    folder: Path
    at: int
    saves: bool = True

    def entry(self, saved_s: float) -> dict[str, Any]:
        """The entry of summary.json. saved_s: time of the save that was used, 0 = none [s]."""
        return {"branch": {"of": self.folder.name, "at_s": self.at / NS, "saved_s": saved_s}}


class Branch(Restart):
    """Raised by a `before_tick`: the run ends, and another goes on from an earlier moment of it.

    out: folder of the other
    events: all its changes
    """

    def __init__(self, start: Start, out: Path, events: Sequence[Mapping[str, Any]]) -> None:
        super().__init__(f"goes on from {num(start.at / NS)} s in {out}")
        self.start, self.out, self.events = start, out, events


def branched_events(
    events: Sequence[Mapping[str, Any]], at_s: float, sets: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Changes of an earlier run before a time [s], then new ones at that time."""
    before = [dict(e) for e in events if float(e["t_s"]) < at_s]
    return [*before, *({"t_s": at_s, "set": key, "value": value} for key, value in sets.items())]


def branch_folder(out: Path) -> Path:
    """A new folder beside that of a run: `NAME-branch`, `NAME-branch-2`."""
    name = out.name.rpartition("-branch")[0] or out.name
    count, found = 1, out.with_name(f"{name}-branch")
    while os.path.exists(found):
        count += 1
        found = out.with_name(f"{name}-branch-{count}")
    return found


def ask_branch(
    changes: Interventions,
    out: Path | None,
    now: int,
    at_s: float,
    sets: Mapping[str, Any],
) -> Branch:
    """What to raise in a run that is at `now` [ns]. InputError where it cannot be."""
    if out is None:
        raise SwathError("expected a run with a folder")
    if not 0.0 < at_s <= now / NS:
        raise InputError("at_s", at_s, f"expected a time of the run, above 0 and up to {num(now / NS)} s")
    for key, value in sets.items():
        changes.check(key, value)
    events = branched_events(changes.events, at_s, sets)
    return Branch(Start(out, round(at_s * NS)), branch_folder(out), events)
