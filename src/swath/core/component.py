"""The smallest seam: a component has ports, and the verbs of an FMU.

    outputs = component.reset(stream)          # outputs valid at t = 0
    outputs = component.step(t, dt, inputs)    # from t to t + dt [ns]; outputs valid at t + dt
    state = component.save(); component.load(state)

A level of a slot, an FMU, a ROS 2 node, a recorded log and a user's Python file all look like this.
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

from swath.core.ability import ByMembers
from swath.core.errors import SwathError, WiringError
from swath.core.random import Stream
from swath.core.signal import Signal

Inputs = Mapping[str, Any]
Outputs = dict[str, Signal]
State = dict[str, Any]


@dataclass(frozen=True)
class Port:
    """One input or output.

    signal: the type of sample that flows; unit and shape: of its main field (`None` in a shape = any length)
    history: an input that receives every sample since the component's last step, a tuple, oldest first
    optional: an input that may stay open; it then is None
    """

    name: str
    signal: type[Signal]
    unit: str = ""
    shape: tuple[int | None, ...] = ()
    history: bool = False
    optional: bool = False


@runtime_checkable
class Component(Protocol):
    """Anything that can fill a slot."""

    @property
    def inputs(self) -> tuple[Port, ...]:
        """Ports whose samples the part reads."""

    @property
    def outputs(self) -> tuple[Port, ...]:
        """Ports whose samples the part sends."""

    def reset(self, stream: Stream) -> Outputs:
        """Begin a run; the outputs at t = 0, drawn with `stream` where chance has a part in them."""

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Outputs at t [ns], from the newest inputs; dt [ns] is the time since the last step."""

    def save(self) -> State:
        """The state, to be given to `load`."""

    def load(self, state: State) -> None:
        """Take on a state that `save` gave."""


class KeepsState:
    """`save` and `load` of an object whose state lies in the attributes that it names in `kept`.

    Of an attribute that has `save` and `load` itself, or a dictionary of such, these are asked; others are
    copied. Keys of the saved state are the names without leading underscores. Without `kept`: no state.
    """

    kept: ClassVar[tuple[str, ...]] = ()

    def save(self) -> State:
        """A copy of everything that is needed to go on exactly."""
        return {name.lstrip("_"): _saved(getattr(self, name)) for name in self.kept}

    def load(self, state: State) -> None:
        """Back to a saved moment. KeyError for the state of something else."""
        for name in self.kept:
            setattr(self, name, _restored(self.__dict__.get(name), state[name.lstrip("_")]))


class KeptElsewhere:
    """`save` and `load` of a part whose state is not here. whose: the part and who has its state."""

    whose: str

    def save(self) -> State:
        """Cannot be."""
        raise SwathError(f"{self.whose} cannot be saved")

    def load(self, state: State) -> None:
        """Cannot be."""
        raise SwathError(f"{self.whose} cannot be restored")


@runtime_checkable
class _HasState(Protocol, metaclass=ByMembers):
    def save(self) -> Any: ...
    def load(self, state: Any, /) -> None: ...


def _saved(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _saved(part) for key, part in value.items()}
    return value.save() if isinstance(value, _HasState) else deepcopy(value)


def _restored(held: Any, saved: Any) -> Any:
    if isinstance(held, dict):
        return {key: _restored(held.get(key), part) for key, part in saved.items()}
    if isinstance(held, _HasState):
        held.load(saved)
        return held
    return deepcopy(saved)


def check_fit(source: str, out: Port, target: str, into: Port) -> None:
    """Refuse a connection whose two ends do not carry the same thing; names both ends."""
    ends = f"{source}.{out.name} -> {target}.{into.name}"
    if not issubclass(out.signal, into.signal):
        raise WiringError(f"{ends}: sends {out.signal.__name__}, expected {into.signal.__name__}")
    if out.unit != into.unit:
        raise WiringError(f"{ends}: sends [{out.unit or '-'}], expected [{into.unit or '-'}]")
    fits = len(out.shape) == len(into.shape) and all(
        b is None or a == b for a, b in zip(out.shape, into.shape, strict=True)
    )
    if not fits:
        raise WiringError(f"{ends}: sends shape {out.shape}, expected {into.shape}")
