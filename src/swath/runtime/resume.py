"""A run brought to a saved moment of an earlier one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swath.core.errors import SwathError
from swath.core.packed_state import UnpackableState
from swath.core.schedule import NS
from swath.judge.evaluation import Evaluation
from swath.record.digest import Digest
from swath.record.recorder import Recorder
from swath.runtime.branch import Start
from swath.runtime.changes import Interventions
from swath.runtime.saves import read_save, saved_before
from swath.runtime.world import World


class UnusableSave(SwathError):
    """A save turned out not to fit after it was taken over: the run has to begin at the start."""


@dataclass(frozen=True)
class Resumed:
    """Brings a run to a saved moment. The run has been assembled, and nothing has seen it yet."""

    world: World
    digest: Digest
    evaluation: Evaluation
    recorder: Recorder
    changes: Interventions

    def load(self, start: Start, events: Sequence[Mapping[str, Any]]) -> int:
        """Load the newest save before the branch; 0 where there is none. Returns how many events it holds.

        UnusableSave.
        """
        for data in saved_before(start.folder, start.at) if start.saves else ():
            try:
                state = read_save(data, start.folder, self.evaluation.shared)
            except UnpackableState:
                continue
            done = len(state["events"])
            if list(events[:done]) == state["events"]:
                self._take(state, start.folder)
                return done
        return 0

    def _take(self, state: Mapping[str, Any], folder: Path) -> None:
        try:
            self.world.reset()
            for event in state["events"]:
                self.changes.set(round(event["t_s"] * NS), event["set"], event["value"])
            self.world.load(state["world"])
            self.digest.load(state["digest"])
            self.evaluation.load(state["evaluation"])
            self.recorder.load(state["recorder"], folder)
        except (SwathError, LookupError, TypeError, ValueError, AttributeError) as error:
            raise UnusableSave(f"a save of {folder} does not fit ({error})") from error
