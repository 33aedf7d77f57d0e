"""What levels of the slot `steer` share through which a box steers the machine over a wire, in real time."""

from typing import Any, ClassVar

from swath.core.component import KeepsState, Outputs, Port
from swath.core.errors import InputError, SwathError
from swath.core.schedule import NS
from swath.link.device.wires import Events, Reader
from swath.scenario.slots import kind_of
from swath.signals import SteerCommand
from swath.signals.setup import LinkSetup


def check_steer(setup: LinkSetup, level: str, others: str) -> None:
    """InputError in another slot. others: what that would have to say."""
    kind = kind_of(setup.slot)
    if kind is None or kind.name != "steer":
        raise InputError("level", level, f"expected in a slot steer, it has no other {others}")


class Steered(KeepsState):
    """The machine's end of a wire. where: it listens; on_loss: `fail`, or the steering is released."""

    kept: ClassVar[tuple[str, ...]] = ("_command", "_heard_at")

    def __init__(self, setup: LinkSetup, where: Any, overlap: float, on_loss: str) -> None:
        self._name, self._machine, self._where = setup.name, setup.control.machine, where
        self.overlap, self._on_loss = overlap, on_loss
        self.inputs: tuple[Port, ...] = ()
        self.outputs = (Port("command", SteerCommand),)
        self._reader: Reader | None = None
        self._events = Events()
        self._wrong = 0

    def _told(self) -> list[str]:
        """What happened, for the notes."""
        return [f"steer: at {t:.2f} s: {text}" for t, text in list(self._events.list)]

    def _listen(self) -> Outputs:
        """Listen; nobody steers yet. SwathError where the port cannot be had."""
        self.close()
        self._events = Events()
        self._reader = Reader(self._where, self._events)
        self._wrong = 0
        self._command = SteerCommand(0, 0.0, False)
        return {"command": self._command}

    def _heard(self, end: int) -> list[tuple[int, bytes, Any]]:
        """What came until a time [ns]: when, bytes, sender."""
        if self._reader is None:
            raise SwathError(f"{self._name}: the line is closed")
        self._events.t = end
        return self._reader.take()

    def _release(self, text: str, end: int) -> None:
        """Let go of the steering at a time [ns], or fail; nothing where nobody steers."""
        if not self._command.is_engaged:
            return
        if self._on_loss == "fail":
            raise SwathError(f"{self._name}: {text}, at {end / NS:g} s of simulated time")
        self._events(f"{text}; the steering was released")
        self._command = SteerCommand(end, self._command.curvature, False)

    def close(self) -> None:
        """Leave the line. Calling it again does nothing."""
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()
