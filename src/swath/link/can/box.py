"""A controller box: a steering law of swath behind a CAN bus, in a process of its own or inside a run.

It answers every cycle of the machine with one guidance command, at once, so that a run can wait for it
(lock-step). A controller that sends by its own clock does as well where the run is paced.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from swath.core.component import KeepsState
from swath.core.errors import InputError, SwathError
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.documents import j1939
from swath.documents.validation import checked, known_keys, unknown_key
from swath.documents.yaml_document import Document
from swath.link.can import guidance
from swath.link.can.bus import CLAIM, Message, Node
from swath.link.can.codec import Values
from swath.scenario.slots import REGISTRY
from swath.signals import SteerCommand
from swath.signals.setup import ControlSetup


class ControllerBox(KeepsState):
    """A steering law that is connected to the machine by a bus.

    law: component of the slot `steer`
    period: of the machine's cycle [ns]; wheelbase [m]
    """

    kept = ("_t", "_speed", "_curvature", "_line", "_must_release", "answer_count", "_law")

    def __init__(self, law: Any, node: Node, *, period: int, wheelbase: float) -> None:
        self._law, self._node = law, node
        self._period, self._wheelbase = period, wheelbase
        self.restart()

    def restart(self) -> None:
        """Forget everything: a machine was switched on."""
        self._law.reset(Stream(0, "box"))
        self._t = 0
        self._speed: float = 0.0
        self._curvature: float | None = None
        self._line: Values = {}
        self._must_release = False
        self.answer_count = 0
        self.is_switched_off = False

    def serve(self, timeout: float = 0.0) -> None:
        """Take what is waiting; wait for the first message for up to `timeout` [s]."""
        message = self._node.receive(timeout)
        while message is not None:
            self.take(message)
            message = self._node.receive()

    def take(self, message: Message) -> None:
        """One message of the machine; the last one of a cycle is answered."""
        values = message.values
        if message.name == CLAIM and values["device_class"] == j1939.HARVESTER:
            self.restart()
        elif message.name == guidance.STATUS:
            bent = values["EstimatedCurvature"]
            self._curvature = None if bent is None else guidance.from_bus(bent)
            self._must_release = values["RequestResetCommand"] == 1
        elif message.name == guidance.WHEEL:
            speed = values["WheelBasedSpeed"] or 0.0
            self._speed = -speed if values["WheelBasedDirection"] == 0 else speed
            self.is_switched_off = values["KeySwitch"] == 0
        elif message.name == guidance.EDGE_LINE:
            self._line = values
        elif message.name == guidance.EDGE_QUALITY:
            self._answer(values)

    def _answer(self, quality: Values) -> None:
        start, self._t = self._t, self._t + self._period
        inputs = {
            "edge": guidance.edge_of(self._line, quality, self._t),
            "odometry": guidance.odometry_of(self._speed, self._curvature, self._wheelbase, self._t),
        }
        command = self._law.step(start, self._period, inputs)["command"]
        assert isinstance(command, SteerCommand)
        is_meant = command.is_engaged and not self._must_release
        self._node.send(
            guidance.COMMAND,
            {"CurvatureCommand": guidance.to_bus(command.curvature), "CurvatureCommandStatus": int(is_meant)},
        )
        self.answer_count += 1


def make_law(
    level: str,
    keys: Mapping[str, Any],
    setup: ControlSetup,
    *,
    period: int,
    base: Path | None = None,
    overlap: float | None = None,
) -> Any:
    """A steering law by the name of its level, or `file.py:Class`, which runs every `period` [ns].

    keys: its parameters, those that it does not know are errors; base: where a relative file name starts
    overlap [m]: its `overlap_m`, where it has such a key and `keys` does not say
    InputError where it cannot be had.
    """
    try:
        found = REGISTRY.get("steer", level, base=base)
    except InputError as error:
        raise InputError("law", level, error.expected) from error
    if found.is_link or found.sees_truth:
        raise InputError("law", level, "expected a steering law that needs only edge and odometry")
    known = known_keys(found.params)
    if unknown := [key for key in keys if key not in known]:
        raise InputError(f"law_keys.{unknown[0]}", keys[unknown[0]], unknown_key(unknown[0], known))
    given = {"overlap_m": overlap} if overlap is not None and "overlap_m" in known else {}
    params = None
    if found.params is not None:
        params = checked(found.params, Document(None), {**given, **keys}, ("law_keys",))
    law = _made(found, level, params, replace(setup, period=period / NS))
    if missing := [p.name for p in law.inputs if p.name not in ("edge", "odometry") and not p.optional]:
        raise InputError("law", level, f"expected edge and odometry to be enough, it needs {missing[0]}")
    return law


def _made(found: Level, level: str, params: Any, setup: ControlSetup) -> Any:
    """The component. InputError where a class of the user's is none."""
    try:
        law = found.component(params, setup)
    except SwathError:
        raise
    except Exception as error:
        what = f"could not be made by Class(params, setup): {type(error).__name__}: {error}"
        raise InputError("law", level, what) from error
    if absent := {"inputs", "outputs", "reset", "step"} - set(dir(law)):
        raise InputError("law", level, f"expected a component, it has no {', '.join(sorted(absent))}")
    return law


def run_box(box: ControllerBox, node: Node, *, once: bool, say: Callable[[str], None] = print) -> None:
    """Serve until Ctrl-C; with `once`, until a machine that was there has switched off."""
    node.claim()
    say(f"box at address {node.address} on {node.where}")
    was_on = False
    while True:
        box.serve(timeout=0.2)
        if box.answer_count and not was_on:
            was_on = True
            say("machine connected")
        if was_on and box.is_switched_off:
            say(f"the machine has switched off after {box.answer_count} commands")
            was_on = False
            if once:
                return
            box.restart()
