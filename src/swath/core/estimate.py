"""Numbers that are estimates, and the bands in which they are thought to lie."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, get_args, get_type_hints


@dataclass(frozen=True)
class Estimate:
    """In `Annotated`, of a key that is an estimate: the band that it may lie in.

    source: of the band, "" = nobody's but ours
    decides: what it changes something of: a quantity of `runtime/met.py`, where a run meets more of it than
        plain values, or a key beside it, where that is not 0; "" = all that its part does
    """

    low: float
    high: float
    source: str = ""
    decides: str = ""

    def told(self, key: str, value: float) -> str:
        """`overlap_m 1 (our estimate, 0.3 to 2)`."""
        of = f"estimate by {self.source}" if self.source else "our estimate"
        return f"{key} {value:g} ({of}, {self.low:g} to {self.high:g})"

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


def held(params: Any, above: str = "") -> Iterator[tuple[str, float, Estimate, Any]]:
    """Keys with a band among parameters, and in those within them: key, value, band, what the key is in."""
    if not is_dataclass(params):
        return
    bands = estimates(type(params))
    for entry in fields(params):
        value = getattr(params, entry.name)
        if entry.name in bands and value is not None:
            yield above + entry.name, value, bands[entry.name], params
        yield from held(value, f"{above}{entry.name}.")


def estimates(params: Any) -> dict[str, Estimate]:
    """The estimates among the keys of a class of parameters that have a band."""
    hints = get_type_hints(params, include_extras=True) if params is not None else {}
    marks = ((name, mark) for name, hint in hints.items() for mark in getattr(hint, "__metadata__", ()))
    return {name: mark for name, mark in marks if isinstance(mark, Estimate)}
