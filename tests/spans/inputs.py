"""What flows into levels: every field with a declared span, at both ends and as nan, beside ordinary ones.

A level is stepped alone, in the scenario that `keys` has for its slot, as `swath part` does it.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np

from swath.core.checked import CheckedOutput, misfit
from swath.core.errors import SwathError
from swath.core.foreign_code import allow_code
from swath.core.layout import Field, quantities
from swath.core.signal import span_of
from swath.scenario.scenario import load_scenario
from swath.scenario.slots import CATALOGUE, FIELD_LEVELS
from swath.signals import OrganSettings, Signal, ranges
from swath.signals.flat import build, flat_fields
from swath.tools.part.isolate import Arrival, IsolatedPart
from tests.spans.keys import ECHOES, FILES, ON_CART, placed, usual_part

ORDINARY = (0.0, 0.02, 0.5, 1.0, 3.0)
ESTIMATES = {v for k, v in vars(ranges).items() if k.isupper()} - {ranges.SHARE}
STEP, STEPS = 50_000_000, 12  # between samples [ns]; how many
SETTLING = 100_000_000, 120  # the same of what has settings, which are moved to


class Span(NamedTuple):
    """A field of what flows into a level, and one of the values that it may have."""

    slot: str
    level: str
    output: tuple[str, str]
    field: str
    value: float

    def __str__(self) -> str:
        return f"{self.slot}.{self.level}: {self.output[1]}.{self.field} = {self.value:g}"


def ends(signal: type[Signal], field: Field) -> list[float]:
    """Both ends of its span, and nan where it may be."""
    quantity = field.quantity
    return [v for v in span_of(field.name, quantity) if np.isfinite(v)] + [np.nan] * bool(quantity.nan)


def levels() -> Iterator[tuple[str, str]]:
    """Slot and level of all that swath has."""
    for slot in CATALOGUE.registry.packages:
        if slot not in FIELD_LEVELS:
            yield from ((slot, name) for name in CATALOGUE.registry.names(slot))


def alone(slot: str, level: str, folder: Path) -> IsolatedPart:
    """A level without the others."""
    scenario = placed(("machines", "combine", slot), level, usual_part(slot, level))
    file = folder / "part.yaml"
    file.write_text(json.dumps(scenario).replace("x.file", FILES.get(f"{slot}.{level}", "box.obj")))
    machine = "cart" if f"{slot}.{level}" in ON_CART or slot in ON_CART else "combine"
    with allow_code(None):
        return IsolatedPart(load_scenario(str(file)), f"{machine}.{slot}")


def spans(slot: str, level: str, part: IsolatedPart) -> list[Span]:
    """All of a level."""
    return [
        Span(slot, level, output, name, value)
        for output, port in part.ports.items()
        for name, field in flat_fields(port.signal).items()
        for value in ends(port.signal, field)
    ]


def sample(signal: type[Signal], t: int, rng: Random, given: dict[str, float]) -> Signal:
    """One whose fields hold ordinary numbers, but for those that are given."""
    values: dict[str, Any] = {}
    for name, field in flat_fields(signal).items():
        low, high = field.quantity.span
        small = name.endswith((".z", ".roll", ".pitch"))
        number = min(max(rng.choice(ORDINARY[:2] if small else ORDINARY), low), high)
        value = given.get(name, field.default if field.default is not None and rng.random() < 0.7 else number)
        if field.kind == "array":
            sizes = [
                d if isinstance(d, int) else 1 if d == "echo_count" else ECHOES for d in field.quantity.shape
            ]
            value = np.full(int(np.prod(sizes)), value if name in given else number)
            if name in ("azimuth", "ahead", "beam_t"):
                value = np.where(np.isnan(value), value, np.linspace(0.0, 1.0, value.size))
        elif field.kind == "bool":
            value = bool(value)
        values[name] = value
    return build(signal, t, values)


def drive(part: IsolatedPart, given: dict[tuple[str, str], dict[str, float]], seed: int) -> None:
    """Step it with ordinary samples, then with the given fields, then with ordinary ones.

    AssertionError for a sample that is none; SwathError where it refuses.
    """
    rng, arrivals = Random(seed), []
    is_set = any(port.signal is OrganSettings for port in part.ports.values())
    step, steps = SETTLING if is_set else (STEP, STEPS)
    for k in range(steps):
        for output, port in part.ports.items():
            now = given.get(output, {}) if k else {}
            arrivals.append(Arrival(k * step, output, sample(port.signal, k * step, rng, now)))
    check = CheckedOutput(part.slot, "swath", part.node.component.outputs)
    for found in part.run(arrivals, end=(steps - 1) * step):
        try:
            check.pass_on(found.t, {found.output[1]: found.sample})
        except SwathError as error:
            if not _is_beyond_estimate(found.sample):
                raise AssertionError(str(error)) from error


def _is_beyond_estimate(sample: Signal) -> bool:
    """Whether what does not fit is finite and has the right sign: sums of ends lie beyond estimates."""
    field, _ = misfit(sample)
    quantity, value = quantities(type(sample))[field], getattr(sample, field)
    numbers = np.asarray(getattr(value, "position", value), dtype=float)
    numbers = numbers[~np.isnan(numbers)] if quantity.nan else numbers
    low, _ = ends = span_of(field, quantity)
    return ends in ESTIMATES and np.isfinite(numbers).all() and not (low == 0.0 and (numbers < 0.0).any())


def drive_some(part: IsolatedPart, spans: list[Span], rng: Random, count: int) -> None:
    """Step it with one span at an end, so many times, and so many times with several at once."""
    for k in range(2 * count if spans else 1):
        given: dict[tuple[str, str], dict[str, float]] = {}
        for span in rng.sample(spans, min(1 if k < count else rng.randint(2, 6), len(spans))):
            given.setdefault(span.output, {})[span.field] = span.value
        try:
            drive(part, given, rng.randrange(1 << 30))
        except SwathError:  # refused in one line
            continue
        except Exception as error:
            raise AssertionError(f"{part.slot}: {given}") from error
