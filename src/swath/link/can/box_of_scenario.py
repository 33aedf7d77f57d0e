"""The controller box of a scenario: law, machine and bus."""

from dataclasses import dataclass
from typing import Any

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.documents.validation import adapter_of
from swath.link.can import j1939
from swath.link.can.box import make_law
from swath.link.can.bus import Where
from swath.link.levels.can import Params
from swath.machine.machine_sheet import load_machine
from swath.scenario.scenario import Scenario
from swath.scenario.slot_instances import first_of_kind
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class BoxPlan:
    """law: the component; address: of the box; period: of a cycle [ns]; wheelbase [m]"""

    law: Any
    where: Where
    address: int
    period: int
    wheelbase: float


def plan_box(scenario: Scenario) -> BoxPlan:
    """The box of the first machine of a scenario that has a steering slot.

    The slot is either of level `can`, which says bus and law, or a law itself, which then runs every
    100 ms on the default bus. The box knows the machine's data sheet, not the mounting of the sensor.
    InputError where there is no such law.
    """
    found = ((m, first_of_kind("steer", m.slots)) for m in scenario.machines.values())
    section, slot = next(((m, name) for m, name in found if name is not None), (None, ""))
    if section is None or slot is None:
        raise InputError("steer", "off", "expected a steering law for the box to run")
    steer = section.slots[slot]
    card = load_machine(section.card.as_posix(), header_width_m=section.common.header_width_m)
    knife = Pose.from_euler((card.knife_x, 0.0, 2.0))
    params = steer.params if isinstance(steer.params, Params) else Params()
    setup = ControlSetup(card, knife, section.common.edge_side, params.period * 1e-9)
    if isinstance(steer.params, Params):
        base = scenario.file.parent if scenario.file is not None else None
        law = params.make_law(setup, base)
    else:
        keys = adapter_of(steer.params.__class__).dump_python((steer.params,), mode="json")[0]
        law = make_law(steer.level, keys, setup, period=params.period)
    address = params.box_address or j1939.NAVIGATION
    return BoxPlan(law, params.where, address, params.period, card.wheelbase)
