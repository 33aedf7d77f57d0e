"""Run hooks: what goes along with a run beside recorder and evaluators, as report and ROS 2 bridge do."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from swath.core.graph import Observer
from swath.judge.evaluation import Evaluation
from swath.record.digest import Digest
from swath.record.recorder import Recorder
from swath.runtime.branch import Start
from swath.runtime.changes import Interventions
from swath.runtime.world import World


@dataclass(frozen=True)
class ActiveRun:
    """A run as a hook sees it.

    world: the world that is driven
    out: folder of the run, None = it has none
    recorder: what writes the samples
    evaluation: what judges them
    observers: called after every step in this order; a hook may append its own
    changes: takes changes while the run goes on
    rest: is given the length of a pause [ns]
    digest: hash of all samples so far
    start: where it branched off from another run, None where it began anew
    """

    world: World
    out: Path | None
    recorder: Recorder
    evaluation: Evaluation
    observers: list[Observer]
    changes: Interventions
    rest: Callable[[int], None]
    digest: Digest
    start: Start | None = None


class RunHook:
    """Goes along with a run; a hook overrides what it needs.

    READS_TRACKS: whether it asks the recorder for tracks; a run without a folder has them only then
    """

    READS_TRACKS: ClassVar[bool] = True

    def begin(self, run: ActiveRun) -> None:
        """Before the first tick; again, with another world, where a run is restarted."""

    def summarize(self, t: int) -> dict[str, Any]:
        """Entries for summary.json of a run that ended at t [ns]."""
        return {}

    def finish(self, summary: Mapping[str, Any]) -> None:
        """The run is over and summary.json is written."""
