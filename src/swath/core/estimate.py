"""Numbers that are estimates, and the bands in which they are thought to lie."""

from dataclasses import dataclass
from typing import Any, get_type_hints


@dataclass(frozen=True)
class Estimate:
    """In `Annotated`, of a key that is an estimate: the band that it may lie in."""

    low: float
    high: float

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> dict[str, Any]:
        """The band stands in the schema, too."""
        return {**handler(core_schema), "estimate": [self.low, self.high]}


def estimates(params: Any) -> dict[str, Estimate]:
    """The estimates among the keys of a class of parameters that have a band."""
    hints = get_type_hints(params, include_extras=True) if params is not None else {}
    marks = ((name, mark) for name, hint in hints.items() for mark in getattr(hint, "__metadata__", ()))
    return {name: mark for name, mark in marks if isinstance(mark, Estimate)}
