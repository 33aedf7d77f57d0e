"""Names that a user's Python file imports from swath 0.1, as they are now."""

import re

MODULES = {
    "swath.again": "swath.tools.rerun.rerun",
    "swath.cli": "swath.commands.main",
    "swath.control.edge._detector": "swath.control.edge.detector",
    "swath.control.edge._line": "swath.control.edge.line_fit",
    "swath.control.edge._overhang": "swath.control.edge.canopy_offset",
    "swath.control.edge._profile": "swath.control.edge.profile",
    "swath.control.edge._step": "swath.control.edge.height_step",
    "swath.control.edge._track": "swath.control.edge.tracking",
    "swath.control.speed._target": "swath.control.speed.throughput_target",
    "swath.control.steer._plant": "swath.control.steer.plant_model",
    "swath.core.compiled": "swath.kernels",
    "swath.core.flat": "swath.signals.flat",
    "swath.core.setup": "swath.signals.setup",
    "swath.core.signals": "swath.signals",
    "swath.data.cards": "swath.documents.data_sheets",
    "swath.field.library": "swath.field.prototypes",
    "swath.field.site": "swath.field.site_setup",
    "swath.field.setup": "swath.field.field_setup",
    "swath.field.io": "swath.field_io",
    "swath.job": "swath.runtime.job",
    "swath.machine.card": "swath.machine.machine_sheet",
    "swath.sensing.card": "swath.sensing.lidar_sheet",
    "swath.sim.loop": "swath.runtime.loop",
    "swath.sim.scenario": "swath.scenario.scenario",
    "swath.sim.slots": "swath.scenario.slots",
    "swath.sim.world": "swath.runtime.assembly",
    "swath.sim.recorded": "swath.record.read",
}
_NAME = re.compile(
    r"(?<![\w.])(" + "|".join(sorted(map(re.escape, MODULES), key=len, reverse=True)) + r")(?!\w)"
)


def migrate_python(text: str) -> str:
    """The text with the modules it imports from swath under their present names."""
    return _NAME.sub(lambda found: MODULES[found.group(1)], text)
