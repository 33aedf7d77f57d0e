"""The ODD in which the function is shown, written as OpenODD: the one that was tried, less some cells."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from swath.core.files.whole_file import write_whole
from swath.documents.yaml_document import dump
from swath.tools.function_test.odd.binding import Odd
from swath.tools.function_test.odd.causes import Cause
from swath.tools.function_test.odd.cells import OddCell, Span
from swath.tools.function_test.odd.openodd import MODULES, TAXONOMY

NAME = "shown"


def write_restricted(folder: Path, odd: Odd, out: Sequence[Cause | OddCell]) -> Path:
    """Write shown.openodd.yaml and its binding shown.odd.yaml, which is returned. out: what to leave out."""
    taxonomy: dict[str, Any] = {}
    modules: dict[str, Any] = {}
    rest: dict[str, Any] = {}
    for document in odd.domain.documents:
        for key, value in document.data.items():
            target = {TAXONOMY: taxonomy, MODULES: modules}.get(key)
            if target is None:
                rest[key] = value
            else:
                target |= value or {}
    names = [f"not_shown_{number + 1}" for number in range(len(out))]
    for name, cell in zip(names, out, strict=True):
        ends = cell.ends or [None] * len(cell.spans)
        conditions = (_condition(odd, span, own) for span, own in zip(cell.spans, ends, strict=True))
        modules[name] = {"INCLUDE_AND": dict(conditions)}
    module: dict[str, Any] = {"INCLUDE_AND": dict.fromkeys(odd.domain.roots, True)}
    if names:
        module["EXCLUDE_OR"] = dict.fromkeys(names, True)
    modules[NAME] = module
    write_whole(folder / f"{NAME}.openodd.yaml", dump({**rest, TAXONOMY: taxonomy, MODULES: modules}))
    binding = {**odd.document.data, "openodd": [f"{NAME}.openodd.yaml"]}
    return write_whole(folder / f"{NAME}.odd.yaml", dump(binding))


def _condition(odd: Odd, span: Span, ends: tuple[float, float] | None) -> tuple[str, Any]:
    """A concept, and the expression that holds in these buckets of it.

    ends: bounds of a number within them, if there are any; the upper edge belongs to the next bucket
    """
    axis, bucket = odd.bucket_axis[span[0]]
    if odd.domain.attributes[axis.name].values == ("true", "false"):
        return axis.name, axis.labels[bucket] == "true"
    if not axis.edges:
        return axis.name, [axis.labels[bucket]]
    unit = f" {axis.bound.unit}" if axis.bound.unit else ""
    low, high = ends or (axis.edges[bucket], axis.edges[span[1] - axis.first + 1])
    return axis.name, f"[{low:g} .. {high:g}]{unit}"
