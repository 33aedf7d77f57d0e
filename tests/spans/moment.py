"""A run of a moment: what it says where it is refused, AssertionError where a sample is none."""

import json
from pathlib import Path
from typing import Any

from swath.core.checked import CheckedOutput
from swath.core.errors import SwathError
from swath.runtime.job import run_unrecorded
from swath.scenario.scenario import load_scenario


class Looks:
    """A hook that looks at every sample, as at those of a part that is not swath's own."""

    READS_TRACKS = False

    def begin(self, run: Any) -> None:
        """Look on."""
        parts = {f"{m.name}.{s}": part for m in run.world.machines.values() for s, part in m.parts.items()}
        checks = {name: CheckedOutput(name, "swath", part.outputs) for name, part in parts.items()}

        def see(slot: str, t: int, outputs: dict[str, Any]) -> None:
            if slot in checks:
                try:
                    checks[slot].pass_on(t, outputs)
                except SwathError as error:
                    raise AssertionError(str(error)) from error

        run.observers.append(see)

    def summarize(self, t: int) -> dict[str, Any]:
        """Nothing."""
        return {}

    def finish(self, summary: dict[str, Any]) -> None:
        """Nothing."""


def moment(scenario: dict[str, Any], folder: Path) -> str:
    """Run it; what it was refused with, "" where it ran."""
    file = folder / "span.yaml"
    file.write_text(json.dumps(scenario))
    try:
        run_unrecorded(load_scenario(str(file)), hooks=[Looks()])
    except SwathError as error:
        return str(error)
    return ""
