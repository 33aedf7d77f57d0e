"""Numbers that are estimates, and the bands in which they are thought to lie."""

from collections.abc import Sequence
from dataclasses import dataclass, is_dataclass
from typing import Any, get_args, get_type_hints


@dataclass(frozen=True)
class Estimate:
    """In `Annotated`, of a key that is an estimate: the band that it may lie in.

    source: of the band, "" = nobody's but ours
    """

    low: float
    high: float
    source: str = ""

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> dict[str, Any]:
        """The band stands in the schema, too, and where it is from."""
        told = {"estimate": [self.low, self.high]} | ({"estimate_of": self.source} if self.source else {})
        return {**handler(core_schema), **told}


def band_of(params: Any, path: Sequence[str]) -> Estimate | None:
    """The band of a key of a class of parameters, or of one within them; None where it has none."""
    name, *rest = path or [""]
    if not rest:
        return estimates(params).get(name)
    hint = get_type_hints(params).get(name)
    inner = [kind for kind in (hint, *get_args(hint)) if is_dataclass(kind)]
    return next((band for kind in inner if (band := band_of(kind, rest)) is not None), None)


def estimates(params: Any) -> dict[str, Estimate]:
    """The estimates among the keys of a class of parameters that have a band."""
    hints = get_type_hints(params, include_extras=True) if params is not None else {}
    marks = ((name, mark) for name, hint in hints.items() for mark in getattr(hint, "__metadata__", ()))
    return {name: mark for name, mark in marks if isinstance(mark, Estimate)}
