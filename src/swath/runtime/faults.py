"""The faults of a scenario: what goes wrong with what slots send, and sensors that sit where nobody meant."""

from dataclasses import replace
from typing import Any

from swath.core.asked import replaced
from swath.core.errors import InputError
from swath.core.fault import Fault, FaultyOutput
from swath.core.layout import quantities
from swath.core.units import MS, PERCENT
from swath.scenario.resolved import SlotChoice
from swath.signals import MachineState


def make_fault(choice: SlotChoice, component: Any) -> FaultyOutput | None:
    """The fault of a slot, None where it has none. InputError for a slot that cannot have one."""
    said = choice.common.fault
    if said is None:
        return None
    for signal in (port.signal for port in component.outputs):
        if issubclass(signal, MachineState) or any(q.is_amount for q in quantities(signal).values()):
            expected = "expected a part that measures, decides or commands: this one is the machine itself"
            raise InputError("fault", choice.kind.name, expected)
    fault = Fault(
        scale=said.scale,
        bias=said.bias,
        noise=said.noise,
        stuck=said.stuck,
        beam_loss=said.beam_loss_percent * PERCENT,
        dead_beams=said.dead_beams_percent * PERCENT,
        hold=said.hold_s,
        silent=said.silent_s,
        loss=said.loss_percent * PERCENT,
        burst=said.burst_ms * MS if said.loss_percent else 0.0,
        latency=said.latency_ms * MS,
    )
    return FaultyOutput(fault, component.outputs)


def displaced(choice: SlotChoice) -> SlotChoice:
    """The choice with its sensor where it really sits: its `mount` with the mounting error added."""
    error, mount = choice.common.mount_error or {}, getattr(choice.params, "mount", None)
    if mount is None:
        raise InputError("mount_error", None, "expected a sensor with a `mount`")
    for key in error:
        if not isinstance(getattr(mount, key, None), float | int):
            raise InputError(f"mount_error.{key}", None, f"expected one of {', '.join(vars(mount))}")
    moved = replaced(mount, **{key: getattr(mount, key) + error[key] for key in error})
    return replace(choice, params=replaced(choice.params, mount=moved))
