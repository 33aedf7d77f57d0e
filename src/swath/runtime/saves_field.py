"""The run hook of `swath run --save-field`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swath.field.state_file import write_state
from swath.runtime.field_state import about
from swath.runtime.hooks import ActiveRun, RunHook
from swath.runtime.world import World


class SavesField(RunHook):
    """Writes the field's state after a run."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self._world: World | None = None

    def begin(self, run: ActiveRun) -> None:
        """Remember whose field it is."""
        self._world = run.world

    def finish(self, summary: Mapping[str, Any]) -> None:
        """Write it, also of a run that was stopped."""
        if self._world is not None:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            write_state(self.file, self._world.field.save(), about(self._world.scenario))
