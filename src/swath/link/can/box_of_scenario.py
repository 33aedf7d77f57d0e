"""The controller box of a scenario: law, machine and bus."""

from dataclasses import dataclass
from typing import Any

from swath.core.errors import InputError
from swath.documents.validation import adapter_of
from swath.link.can import j1939
from swath.link.can.box import make_law
from swath.link.can.bus import Where
from swath.link.levels.can import Params
from swath.machine.machine_sheet import load_machine
from swath.scenario.scenario import Scenario
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
    """The box of the first machine of a scenario that has the slot `steer`.

    The slot is either of level `can`, which says bus and law, or a law itself, which then runs every
    100 ms on the default bus. The box knows the machine's data sheet, not the mounting of the sensor.
    InputError where there is no such law.
    """
    section = next((m for m in scenario.machines.values() if "steer" in m.slots), None)
    if section is None:
        raise InputError("steer", "off", "expected a steering law for the box to run")
    steer = section.slots["steer"]
    card = load_machine(section.card.as_posix(), header_width_m=section.common.header_width_m)
    params = steer.params if isinstance(steer.params, Params) else Params()
    setup = ControlSetup(card, {}, section.common.edge_side, params.period * 1e-9)
    if isinstance(steer.params, Params):
        base = scenario.file.parent if scenario.file is not None else None
        law = params.make_law(setup, base)
    else:
        keys = adapter_of(steer.params.__class__).dump_python((steer.params,), mode="json")[0]
        law = make_law(steer.level, keys, setup, period=params.period)
    address = params.box_address or j1939.NAVIGATION
    return BoxPlan(law, params.where, address, params.period, card.wheelbase)
