"""Which evaluators there are, and the metrics, columns and events that they make known.

`scenario/slots.py` reads this at run time, so that `expect:` knows every metric.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Literal

from swath.core.errors import InputError
from swath.core.foreign_code import is_left
from swath.core.registry import Registry
from swath.judge.evaluator import HasColumns, HasEvents, KnowsWhy, Metric
from swath.record.tracks import column_names, sent_columns
from swath.signals import Signal

KIND = "evaluator"
# In lists and reports; groups of a user's own come last.
GROUPS = (
    "Safety",
    "Driving",
    "Edge detection",
    "Steering",
    "Positioning",
    "Harvest",
    "Passes",
    "Header height",
    "Crop and engine",
    "Unloading",
    "Pictures",
    "Run",
)
REGISTRY = Registry({KIND: ("swath.judge.evaluators",)})
Scope = Literal["machine", "field", "run"]

# What the run itself counts.
RUN_METRICS = (
    Metric("real_time_factor", "", "simulated time / wall time", "Run", "higher", "",
           is_windowed=False, is_identity=True),
    Metric("ray_count", "", "rays cast by all sensors", "Run", "", "rays cast",
           is_windowed=False, is_identity=True),
)  # fmt: skip
SENSOR_METRICS = (
    Metric("unmeasured_beam_share", "1", "share of the beams of replayed scans that ended where nothing was "
           "measured", "Run", "lower", "beams where nothing was measured", is_windowed=False),
)  # fmt: skip


@dataclass(frozen=True)
class EvaluatorCatalogue:
    """The evaluators of a scenario: the built-in ones, then its own. classes: evaluator classes.

    is_partial: some were left unread, so that metrics may be meant that are not known
    """

    classes: tuple[Any, ...]
    is_partial: bool = False

    def by_scope(self) -> dict[Scope, dict[str, Metric]]:
        """Metrics by name: of a machine, of the field, of the run."""
        machine = [m for c in self.classes if not c.OF_FIELD for m in c.METRICS]
        field = [m for c in self.classes if c.OF_FIELD for m in c.METRICS]
        groups: dict[Scope, Iterable[Metric]] = {
            "machine": (*machine, *SENSOR_METRICS), "field": field, "run": RUN_METRICS
        }  # fmt: skip
        return {s: {m.name: m for m in sorted(group, key=_rank)} for s, group in groups.items()}

    @cached_property
    def metrics(self) -> dict[str, Metric]:
        """All metrics by name."""
        found = {name: metric for group in self.by_scope().values() for name, metric in group.items()}
        return dict(sorted(found.items(), key=lambda item: _rank(item[1])))

    @cached_property
    def columns(self) -> list[str]:
        """Columns of tracks that a limit may be set on; some only where the machine has the sensor."""
        own = [name for c in self.classes if isinstance(c, HasColumns) for name in c.COLUMNS]
        return [*column_names(), *own]

    @staticmethod
    def sent(outputs: Mapping[str, type[Signal]]) -> list[str]:
        """Columns that tracks have of what outputs send, by `slot.output`."""
        return [column.name for column in sent_columns(outputs)]

    @cached_property
    def events(self) -> list[str]:
        """Kinds of events."""
        return [kind for c in self.classes if isinstance(c, HasEvents) for kind in c.EVENTS]

    @cached_property
    def caused(self) -> dict[str, str]:
        """Metrics that count events of which it is known why they happened, with the kind of these."""
        return {
            name: kind for c in self.classes if isinstance(c, KnowsWhy) for name, kind in c.COUNTED.items()
        }

    def maker_of(self, metric: str) -> Any:
        """The class that gives a metric; None where the run itself does."""
        return next((c for c in self.classes for m in c.METRICS if m.name == metric), None)


def _rank(metric: Metric) -> int:
    return GROUPS.index(metric.group) if metric.group in GROUPS else len(GROUPS)


def load_evaluators(own: Sequence[str] = (), base: Path | None = None) -> EvaluatorCatalogue:
    """All built-in evaluators and those named `file.py:Class` (relative to `base`).

    InputError where one cannot be had or declares what another one has.
    """
    if not own:
        return _built_in()
    classes = list(_built_in().classes)
    known = {m.name for c in classes for m in c.METRICS}
    unread = [reference for reference in own if is_left(reference, base)]
    for reference in own:
        if reference in unread:
            continue
        found = REGISTRY.get(KIND, reference, base=base).component
        _check(found, reference, known)
        known |= {m.name for m in found.METRICS}
        classes.append(found)
    return EvaluatorCatalogue(tuple(classes), is_partial=bool(unread))


@cache
def _built_in() -> EvaluatorCatalogue:
    classes = [REGISTRY.get(KIND, name).component for name in REGISTRY.names(KIND)]
    classes.sort(key=lambda c: min((_rank(m) for m in c.METRICS), default=len(GROUPS)))
    return EvaluatorCatalogue(tuple(classes))


def _check(found: Any, reference: str, known: set[str]) -> None:
    absent = [name for name in ("METRICS", "OF_FIELD", "see", "metrics") if name not in dir(found)]
    if absent or not callable(found):
        what = f"has no {', '.join(absent)}; expected a class as in examples/my_evaluator.py"
        raise InputError("evaluators", reference, what)
    twice = [m.name for m in found.METRICS if m.name in known]
    if twice:
        raise InputError("evaluators", reference, f"expected metrics of its own, {', '.join(twice)} exists")
