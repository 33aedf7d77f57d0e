"""The keys `evaluators` and `expect` of a scenario.

With several machines `expect` has a machine's name or `field`, and below it the limits; with one machine the
limits may stand at the top: what is a metric of the field, or of the run, is meant for `field`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from swath.core.errors import InputError, SwathError, near_miss
from swath.core.registry import installed
from swath.documents.validation import unknown_key
from swath.documents.yaml_document import KeyPath
from swath.scenario.resolved import Expectation, MachineSection
from swath.scenario.section_reader import SectionReader
from swath.scenario.sections import Limit

FIELD = "field"
LATER = "obstacles."  # before the name of an obstacle that comes while a run goes
FORMER = {"thing_contrast": "thing_contrast_true"}  # names of metrics that files may have


def read_evaluators(reader: SectionReader, data: Any) -> tuple[tuple[str, ...], Any]:
    """References with absolute paths, and the catalogue of all evaluators; notes what is wrong."""
    path: KeyPath = ("evaluators",)
    if not isinstance(data, list):
        reader.note(path, "(nothing)" if data is None else data, "expected a list of file.py:Class")
        data = []
    good: list[str] = []
    judged = reader.catalogue.judged()
    for index, entry in enumerate(data):
        where = (*path, index)
        of_package = isinstance(entry, str) and entry in installed("evaluator")
        if not of_package and (not isinstance(entry, str) or ".py:" not in entry or "\0" in entry):
            reader.note(where, entry, "expected file.py:Class, or the name that an installed package gives")
            continue
        reference = entry if of_package else reader.absolute_level(entry, reader.base(where))
        try:
            judged = reader.catalogue.judged([*good, reference])
            good.append(reference)
        except InputError as error:
            reader.note(where, entry, error.expected)
        except SwathError as error:
            reader.note(where, entry, str(error))
    return tuple(good), judged


def read_expect(
    reader: SectionReader,
    data: Any,
    judged: Any,
    machines: Sequence[str],
    sections: Mapping[str, MachineSection],
    obstacles: Sequence[Any],
) -> tuple[Expectation, ...]:
    """Every limit; notes what is wrong. machines: all names; sections: of those that could be read.

    obstacles: of the field, None for one that could not be read
    """
    data = reader.mapping(data, ("expect",))
    scopes = judged.by_scope()
    own, of_field = list(scopes["machine"]), [*scopes["field"], *scopes["run"]]
    columns = {name: _columns(judged, section) for name, section in sections.items()}

    def unknown_cause(name: str) -> str:
        if name.startswith(LATER) or any(obstacle is None for obstacle in obstacles):
            return ""
        known = reader.catalogue.part("bodies")(obstacles, machines)
        near = near_miss(name, known)
        return "" if name in known else f"expected a name or kind of obstacles or machines{near}"

    judge = partial(_limits, reader, judged=judged, columns_of=columns, unknown_cause=unknown_cause)
    found: list[Expectation] = []
    for key, entry in data.items():
        path: KeyPath = ("expect", key)
        if key in machines or key == FIELD:
            for name, limits in reader.mapping(entry, path).items():
                known = of_field if key == FIELD else own
                found += judge(key, name, limits, (*path, name), known)
        elif len(machines) == 1:
            subject = FIELD if key in of_field else machines[0]
            found += judge(subject, key, entry, path, [*own, *of_field])
        else:
            reader.note(path, None, unknown_key(key, [*machines, FIELD], "unknown machine"))
    return tuple(found)


def plain_expect(expect: Iterable[Expectation], machines: Mapping[str, Any]) -> dict[str, Any]:
    """Limits as a file would have them."""
    written: dict[str, dict[str, list[Any]]] = {}
    for entry in expect:
        subject = "" if len(machines) == 1 else entry.subject
        written.setdefault(subject, {}).setdefault(entry.name, []).append(entry.limit.plain())
    short = {s: {n: v[0] if len(v) == 1 else v for n, v in names.items()} for s, names in written.items()}
    return short.get("", {}) if len(machines) == 1 else short


def _columns(judged: Any, section: MachineSection) -> list[str]:
    """Columns that the tracks of a machine may have; those of a slot with a name of its own begin with it."""
    named = [slot for slot, choice in section.slots.items() if slot != choice.kind.name]
    sent = {
        f"{slot}.{port.name}": port.signal
        for slot, choice in section.slots.items()
        for port in (*choice.kind.outputs, *choice.kind.more)
    }
    return [
        *judged.columns,
        *judged.sent(sent),
        *(f"{slot}_{name}" for slot in named for name in judged.columns),
    ]


def _limits(
    reader: SectionReader,
    subject: str,
    name: str,
    data: Any,
    path: KeyPath,
    metrics: list[str],
    *,
    judged: Any,
    columns_of: Mapping[str, list[str]],
    unknown_cause: Callable[[str], str],
) -> list[Expectation]:
    written, name = name, name if name in metrics else FORMER.get(name, name)
    columns = [] if subject == FIELD else columns_of.get(subject, judged.columns)
    if name not in metrics and name not in columns and judged.is_partial:
        return []  # of an evaluator that was left unread
    if name not in metrics and name not in columns:
        what = "unknown metric"
        if name in judged.metrics:
            what = f"expected under {FIELD}" if subject != FIELD else "expected under a machine's name"
            reader.note(path, None, what)
        else:
            reader.note(
                path, None, unknown_key(name, dict.fromkeys([*metrics, *columns]), what, "swath metrics")
            )
        return []
    found = []
    for index, entry in enumerate(data if isinstance(data, list) else [data]):
        where = (*path, index) if isinstance(data, list) else path
        limit = reader.check(Limit, entry, where)
        if limit is not None and name not in metrics and limit.hold is None:
            limit = limit.model_copy(update={"hold": "always"})
        if limit is None:
            continue
        if limit.because is not None and (said := unknown_cause(limit.because)):
            reader.note((*where, "because"), limit.because, said)
        elif _fits(reader, limit, where, judged, name, columns):
            found.append(Expectation(subject, name, limit, written if written != name else ""))
    return found


def _fits(
    reader: SectionReader, limit: Limit, path: KeyPath, judged: Any, name: str, columns: Sequence[str]
) -> bool:
    """Whether the limit's events and columns exist and the metric can be judged in a window."""
    before = len(reader.errors)
    for key, kind in (("after", limit.after), ("before", limit.before)):
        if kind is not None and kind not in judged.events and not judged.is_partial:
            reader.note((*path, key), kind, unknown_key(kind, judged.events, "unknown event"))
    for column in limit.while_:
        if column not in columns and not judged.is_partial:
            reader.note((*path, "while", column), None, unknown_key(column, columns, "unknown column"))
    if limit.hold is not None and name not in columns:
        reader.note((*path, "hold"), limit.hold, f"expected no hold, {name} is a metric and no column")
    if limit.hold is None and limit.while_:
        reader.note((*path, "while"), None, "expected hold too: while chooses samples of a column")
    if limit.because is not None and name not in judged.caused:
        known = ", ".join(judged.caused)
        reader.note(
            (*path, "because"), limit.because, f"expected it of {known} alone: nothing else knows why"
        )
    if limit.because is not None and limit.window:
        reader.note((*path, "because"), limit.because, "expected no window beside it")
    if limit.hold is None and limit.window and not judged.metrics[name].is_windowed:
        reader.note(path, None, f"expected no window, {name} is of the whole run")
    return len(reader.errors) == before
