"""What the fields of a sample type are, found once from its annotations, for all who ask.

Rows in memory, samples in a recording, messages, columns, FMI variables, checks and the reference of signals
follow from this.
"""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from swath.core.frames import Pose
from swath.core.signal import Quantity, Signal, per_signal

Kind = Literal["real", "int", "bool", "pose", "array", "object"]
OBJECT = np.dtype(object)
CONCRETE = frozenset(np.sctypeDict.values())  # types of numbers, without those that stand for several
POSE = 12  # numbers of a pose: its position, then the rows of its rotation
KINDS: dict[Any, tuple[Kind, Any]] = {
    float: ("real", np.float64),
    int: ("int", np.int64),
    bool: ("bool", np.bool_),
    Pose: ("pose", np.float64),
}


@dataclass(frozen=True)
class Field:
    """A field of a sample type.

    declared: as what, without notes; kind: `object` is what is no number, flag, pose or array
    number: of its numbers
    default: None = it must be given
    is_noted: whether it says what it holds
    """

    name: str
    kind: Kind
    quantity: Quantity
    declared: Any = float
    number: "np.dtype[Any]" = OBJECT
    default: Any = None
    is_noted: bool = True

    @property
    def unit(self) -> str:
        """SI unit, "" = a plain number."""
        return self.quantity.unit

    @property
    def is_array(self) -> bool:
        """Whether it is an array of numbers or flags."""
        return self.kind == "array" and self.number.kind in "fiub"


@per_signal
def layout(kind: type[Any]) -> Mapping[str, Field]:
    """The fields of a sample type but `t`, by name, in their order; also of another dataclass."""
    hints, found = get_type_hints(kind, include_extras=True), dict[str, Field]()
    for field in fields(kind):
        name, hint = field.name, hints[field.name]
        notes = getattr(hint, "__metadata__", ())
        declared = get_args(hint)[0] if notes else hint
        form, number = KINDS.get(declared, ("object", object))
        if get_origin(declared) is np.ndarray:
            form, (given,) = "array", get_args(get_args(declared)[1])
            number = given if given in CONCRETE else object
        own = [note for note in notes if isinstance(note, Quantity)]
        quantity = own[0] if own else Quantity("", name.replace("_", " "))
        default = None if field.default is MISSING else field.default
        found[name] = Field(name, form, quantity, declared, np.dtype(number), default, bool(own))
    if issubclass(kind, Signal):
        del found["t"]
    return found


@per_signal
def quantities(signal: type[Signal]) -> Mapping[str, Quantity]:
    """What each field of a sample type but `t` holds; one that declares nothing is a plain number."""
    return {name: field.quantity for name, field in layout(signal).items()}
