"""docs/scenario.md: the reference of all scenario keys, made from the same classes that check them.

python -m docs.make.scenario     writes it anew
"""

from pathlib import Path
from typing import Any

from swath.scenario.catalogue import CATALOGUE, Catalogue
from swath.scenario.reference import Row, parameter_rows, rows_of
from swath.scenario.schema import adopt
from swath.scenario.sections import (
    FieldCommon,
    Head,
    Limit,
    MachineCommon,
    RealTime,
    Run,
    SlotCommon,
    StartAlongEdge,
    StartPose,
)

PAGE = Path(__file__).parents[1] / "scenario.md"
HEADER = """\
# Scenario files
Made by `python -m docs.make.scenario` from the classes that check a scenario; edit those.

A scenario is YAML (1.2: `1e3` is a number, `yes` is text). Keys carry their unit, values are plain numbers.
Unknown keys, wrong types, numbers out of range or not finite are errors that name key, value, what was
expected, file and line. Paths are relative to the scenario file, in `--set` to the working directory.

`swath schema --out scenario.schema.json` writes the same as JSON Schema. Named in the first line of a file,
it gives completion in editors with a YAML language server:
`# yaml-language-server: $schema=scenario.schema.json`.

```yaml
{example}```

Where a level is chosen, `steer: preview` stands for `steer: {{level: preview}}`. A level is a built-in name,
an installed one (entry point group `swath.levels`, name `slot.level`), or your own `path/to/file.py:Class`,
which runs, with your rights, only with `--allow-code` or where the command line names it
([SECURITY.md](../SECURITY.md)).
`--set combine.lidar.level=empirical` changes one key for one run; choosing another level drops the keys that
only the old one knew.
"""

REALTIME = """\
Only with this section, or `swath run --real-time`, a run waits for the clock: [realtime.md](realtime.md).
`degrade` is a list of `{slot: machine.slot, level: name, ...}`, taken one after the other when `on_overrun`
is `degrade`; keys of the present level that the cheaper one knows are kept.
"""

EVALUATORS = """\
## evaluators
A list of your own evaluators, `file.py:Class`, beside those that are built in: [metrics.md](metrics.md).
"""
EXPECT = """\
For each metric a limit or a list of limits, for columns of the tracks too: [metrics.md](metrics.md).
Metrics: {metrics}. With several machines the limits stand under a machine's name, or under `field`.
"""
EDGES = """\
### field.edges
Several edges by name, instead of `edge`: `edges: {west: {x_m: 0}, east: {x_m: 60, crop_side: left}}`. Each
takes the keys above. Crop stands where it stands on the crop side of every edge. Ground outside several edges
has the stubble of the nearest of them.
"""


def reference(catalogue: Catalogue = CATALOGUE) -> str:
    """The whole page."""
    from swath.documents.data_sheets import find_sheet

    example = find_sheet("scenarios", "straight").read_text(encoding="utf-8")
    parts = [HEADER.format(example=example)]
    parts.append(section("## Top level", Head))
    parts.append(
        "Every other key than `name`, `summary`, `seed`, `run`, `realtime`, `field`, `evaluators` and\n"
        "`expect` is a machine.\n"
    )
    parts.append(section("## run", Run))
    parts.append(section("## realtime", RealTime, REALTIME))
    parts.append(_field(catalogue))
    parts.append(_machine(catalogue))
    parts.append(EVALUATORS)
    metrics = ", ".join(f"`{name}`" for name in catalogue.judged().metrics)
    parts.append(section("## expect", Limit, EXPECT.format(metrics=metrics)))
    return "\n".join(parts).rstrip() + "\n"


def _field(catalogue: Catalogue) -> str:
    parts = [
        "## field",
        "`folder: path` takes terrain and stand from an imported field (docs/field-folder.md).\n",
        _part(FieldCommon),
    ]
    parts += [_levels(catalogue, kind, f"### field.{kind}") for kind in catalogue.field_levels]
    for name, title in (("edge", "edge"), ("obstacles", "obstacles[]"), ("boundary", "boundary")):
        parts.append(f"### field.{title}\n")
        parts.append(_part(catalogue.part(name)))
        if name == "edge":
            parts.append(EDGES)
    return "\n".join(parts)


def _part(kind: Any) -> str:
    """Tables of a class, or of every choice of a union."""
    defs: dict[str, Any] = {}
    node = adopt(kind, "x", defs)
    choices = node.get("oneOf") or node.get("anyOf") or [node]
    made = []
    for choice in choices:
        target = defs[choice["$ref"].rpartition("/")[2]] if "$ref" in choice else choice
        tag = next((p["const"] for p in target.get("properties", {}).values() if "const" in p), None)
        made.append((f"`{tag}`\n\n" if tag and len(choices) > 1 else "") + table(rows_of(target, defs, "")))
    return "\n".join(made)


def _machine(catalogue: Catalogue) -> str:
    parts = [section("## A machine", MachineCommon, "The key is its name; there may be several.\n")]
    parts.append(section("### start, on the edge", StartAlongEdge))
    parts.append(section("### start, anywhere", StartPose))
    slots = "".join(
        f"| `{s.name}`{', `' + s.name + '_NAME`' if s.is_plural else ''} | `{s.level}` "
        f"| {s.rate_hz:g} | {_wires(s.wires)} | {_types_with(s.name, catalogue)} |\n"
        for s in catalogue.slots
    )
    parts.append(
        "### Slots\nIn the order in which they run within a tick. A machine has those of its type and those"
        " that the scenario names; `off` leaves one out.\n\n"
        "| slot | default level | rate [Hz] | inputs come from | unasked in |\n"
        f"|---|---|---|---|---|\n{slots}"
    )
    parts.append(section("### Every slot", SlotCommon))
    parts += [_levels(catalogue, slot.name, f"### {slot.name}") for slot in catalogue.slots]
    if links := catalogue.registry.links():
        parts.append("### Somebody else's part\nLevels that any slot of a machine may have.\n")
        parts += [_level(catalogue, catalogue.slots[0].name, name, name) for name in links]
    return "\n".join(parts)


def _types_with(slot: str, catalogue: Catalogue) -> str:
    return ", ".join(name for name, slots in catalogue.machine_types.items() if slot in slots)


def _wires(wires: Any) -> str:
    return ", ".join(f"{port} ← {source}.{output}" for port, (source, output) in wires.items())


def _levels(catalogue: Catalogue, kind: str, title: str) -> str:
    names = catalogue.registry.names(kind)
    return "\n".join([title, *(_level(catalogue, kind, name, f"{kind}: {name}") for name in names)])


def _level(catalogue: Catalogue, kind: str, name: str, title: str) -> str:
    level = catalogue.registry.get(kind, name)
    rows = parameter_rows(level.params)
    return f"`{title}`: {level.summary}\n" + ("\n" + table(rows) if rows else "")


def section(title: str, kind: Any, text: str = "") -> str:
    """A heading with the table of the parameters of a dataclass."""
    return (
        f"{title}\n{text}\n{table(parameter_rows(kind))}"
        if text
        else f"{title}\n\n{table(parameter_rows(kind))}"
    )


def table(rows: list[Row]) -> str:
    """Rows of keys, ranges, defaults and meanings in Markdown."""
    lines = ["| key | value | default | meaning |", "|---|---|---|---|"]
    for key, value, default, meaning in rows:
        cells = (f"`{key}`", value, f"`{default}`" if default else "", meaning)
        lines.append("| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PAGE.write_text(reference(), encoding="utf-8")
