"""docs/reference/scenario.md: the reference of all scenario keys, made from the same classes that check them.

python -m docs.make.scenario     writes it anew
"""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

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
from swath.scenario.slots import CATALOGUE, Catalogue

Group = tuple[str, tuple[tuple[str, str, str], ...]]  # its name; keys without it, value, meaning
PAGE = Path(__file__).parents[1] / "reference" / "scenario.md"
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
an installed one (entry point group `swath.levels`, name `slot.level`; `log.ENDING` reads logs of an ending, `command.NAME` adds a
command), or your own `path/to/file.py:Class`,
which runs, with your rights, only with `--allow-code` or where the command line names it
([SECURITY.md](../../SECURITY.md)).
`--set combine.lidar.level=empirical` changes one key for one run; choosing another level drops the keys that
only the old one knew, of a recorded scenario its defaults, too. The order of changes does not matter; two that say different things about a key are an error.

Ranges are intervals: `[0, 5)` holds 0 and not 5. Where no default stands, the key is needed; `null` = not given.
"""

REALTIME = """\
Only with this section, or `swath run --real-time`, a run waits for the clock: [hil.md](../how-to/hil.md#real-time-pace).
`degrade` is a list of `{slot: machine.slot, level: name, ...}`, taken one after the other when `on_overrun`
is `degrade`; keys of the present level that the cheaper one knows are kept.
"""

EVALUATORS = """\
## evaluators
A list of your own evaluators, `file.py:Class`, or of names that installed packages give (entry points `evaluator.name`), beside
those that are built in: [metrics.md](metrics.md).
"""
EXPECT = """\
For each metric a limit or a list of limits, for columns of the tracks too: [metrics.md](metrics.md).
With several machines the limits stand under a machine's name, or under `field`.
"""
UNITS = [
    "m",
    "mm",
    "cm",
    "m2",
    "m3",
    "m_s",
    "m_s2",
    "kmh",
    "s",
    "ms",
    "min",
    "hz",
    "rad",
    "deg",
    "deg_s",
    "mrad",
    "percent",
    "kg",
    "t",
    "kg_s",
    "t_ha",
    "t_h",
    "l_s",
    "kw",
    "kn",
    "rpm",
    "c",
    "per_m",
    "per_m2",
    "m3_s",
]
EDGES = """\
### field.edges
Several edges by name, instead of `edge`: `edges: {west: {x_m: 0}, east: {x_m: 60, crop_side: left}}`. Each
takes the keys above. Crop stands where it stands on the crop side of every edge. Ground outside several edges
has the stubble of the nearest of them.
"""


def reference(catalogue: Catalogue = CATALOGUE) -> str:
    """The whole page."""
    from swath.documents.data_sheets import find_sheet

    shared = _shared(catalogue)
    example = find_sheet("scenarios", "straight").read_text(encoding="utf-8")
    parts = [HEADER.format(example=example)]
    parts.append(section("## Top level", Head))
    parts.append(
        "Every other key than `name`, `summary`, `seed`, `run`, `realtime`, `field`, `evaluators` and\n"
        "`expect` is a machine.\n"
    )
    parts.append(section("## run", Run))
    parts.append(section("## realtime", RealTime, REALTIME))
    parts.append(_field(catalogue, shared))
    parts.append(_machine(catalogue, shared))
    parts.append(_shared_groups(shared))
    parts.append(EVALUATORS)
    parts.append(section("## expect", Limit, EXPECT))
    return "\n".join(parts).rstrip() + "\n"


def _field(catalogue: Catalogue, shared: dict[Group, str]) -> str:
    parts = [
        "## field",
        "`folder: path` takes terrain and stand from an imported field (docs/how-to/field.md).\n",
        _part(FieldCommon, shared),
    ]
    parts += [_levels(catalogue, kind, f"### field.{kind}", shared) for kind in catalogue.field_levels]
    for name, title in (
        ("edge", "edge"),
        ("obstacles", "obstacles[]"),
        ("boundary", "boundary"),
        ("weather", "weather"),
    ):
        choice = {
            "edge": "`shape` is one of the names above the tables.\n",
            "obstacles": "`kind` is one of the names above the tables.\n",
        }
        parts.append(f"### field.{title}\n{choice.get(name, '')}")
        parts.append(_part(catalogue.part(name), shared))
        if name == "edge":
            parts.append(EDGES)
    return "\n".join(parts)


def _part(kind: Any, shared: dict[Group, str]) -> str:
    """The keys of a class, or of every choice of a union, each once."""
    defs: dict[str, Any] = {}
    node = adopt(kind, "x", defs)
    made: dict[str, list[Row]] = {}
    for choice in node.get("oneOf") or node.get("anyOf") or [node]:
        target = defs[choice["$ref"].rpartition("/")[2]] if "$ref" in choice else choice
        consts = {key: p["const"] for key, p in target.get("properties", {}).items() if "const" in p}
        tag = next(iter(consts.values()), "")
        made[tag] = [row for row in rows_of(target, defs, "") if len(consts) != 1 or row[0] not in consts]
    return _merged(made, shared)


def _merged(kinds: dict[str, list[Row]], shared: dict[Group, str]) -> str:
    """One table of the keys of several kinds, each key once, with the kinds that have it where not all do."""
    having: dict[Row, list[str]] = {}
    for name in kinds:
        for row in _shortened(_of_others(name, kinds), shared):
            having.setdefault(row, []).append(name)
    tables: dict[tuple[str, ...], list[Row]] = {}
    for row, has in having.items():
        tables.setdefault(tuple(has), []).append(row)
    parts = []
    for has in sorted(tables, key=lambda has: -len(has)):
        named = ", ".join(f"`{name}`" for name in has)
        parts.append((f"{named}:\n\n" if len(has) < len(kinds) else "") + table(tables[has]))
    return "\n".join(parts)


def _of_others(name: str, kinds: dict[str, list[Row]]) -> list[Row]:
    """The rows of a level, with one in place of each group that is all the keys of another level."""
    rows = kinds[name]
    for head, (_, keys) in _groups(rows).items():
        for other, its in kinds.items():
            if its and keys == tuple((key, value, meaning) for key, value, _, meaning in its):
                first = next(k for k, row in enumerate(rows) if row[0].startswith(f"{head}."))
                rows = [row for row in rows if not row[0].startswith(f"{head}.")]
                rows.insert(first, (head, f"keys of `{other}`", "", ""))
                break
    return rows


def _machine(catalogue: Catalogue, shared: dict[Group, str]) -> str:
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
    parts += [_levels(catalogue, slot.name, f"### {slot.name}", shared) for slot in catalogue.slots]
    if links := catalogue.registry.links():
        parts.append("### Somebody else's part\nLevels that any slot of a machine may have.\n")
        levels = {name: catalogue.registry.get(catalogue.slots[0].name, name) for name in links}
        parts += [f"- `{name}`: {level.summary}" for name, level in levels.items()]
        parts.append("\n" + _merged({n: parameter_rows(level.params) for n, level in levels.items()}, {}))
    return "\n".join(parts)


def _types_with(slot: str, catalogue: Catalogue) -> str:
    return ", ".join(name for name, slots in catalogue.machine_types.items() if slot in slots)


def _wires(wires: Any) -> str:
    return ", ".join(
        f"{source}.{output}" if port in (source, output) else f"{port}={source}.{output}"
        for port, (source, output) in wires.items()
    )


def _levels(catalogue: Catalogue, kind: str, title: str, shared: dict[Group, str]) -> str:
    """What the levels of a slot are, and each key that any of them has once, with the levels that have it."""
    names = catalogue.registry.names(kind)
    levels = {name: catalogue.registry.get(kind, name) for name in names}
    parts = [title, *(f"- `{name}`: {level.summary}" for name, level in levels.items())]
    keys = _merged({name: parameter_rows(level.params) for name, level in levels.items()}, shared)
    return "\n".join([*parts, *(["", keys] if keys else [""])])


def _groups(rows: list[Row]) -> dict[str, Group]:
    """Keys that lie under one key, by that."""
    found: dict[str, list[tuple[str, str, str]]] = {}
    for key, value, _, meaning in rows:
        head, dot, rest = key.partition(".")
        if dot:
            found.setdefault(head, []).append((rest, value, meaning))
    return {head: (head.removesuffix("[]"), tuple(keys)) for head, keys in found.items()}


def _shared(catalogue: Catalogue) -> dict[Group, str]:
    """Groups of keys that several levels have -> what they are called on this page."""
    count: Counter[Group] = Counter()
    for kind in (*catalogue.field_levels, *(slot.name for slot in catalogue.slots)):
        for name in catalogue.registry.names(kind):
            count.update(_groups(parameter_rows(catalogue.registry.get(kind, name).params)).values())
    names: dict[Group, str] = {}
    same_keys: dict[tuple[tuple[str, str, str], ...], str] = {}
    for group in (group for group, times in count.items() if times > 1):
        if group[1] in same_keys:
            names[group] = same_keys[group[1]]
            continue
        same = sum(other[0] == group[0] for other in names)
        names[group] = same_keys[group[1]] = group[0] + (f"-{same + 1}" if same else "")
    return names


def _shortened(rows: list[Row], shared: dict[Group, str]) -> list[Row]:
    """The rows, with one in place of each group that is shared; the defaults that it has there."""
    groups = {head: shared[group] for head, group in _groups(rows).items() if group in shared}
    made: dict[str, Row] = {}
    for row in rows:
        head, dot, rest = row[0].partition(".")
        if not dot or head not in groups:
            made[row[0] if row[0] not in groups else f"{row[0]} itself"] = row
            continue
        before = made.get(head, (head, f"keys of [{groups[head]}](#keys-of-{groups[head]})", "", ""))
        default = f"{before[2]}, {rest}: {row[2]}" if row[2] and row[2] != "null" else before[2]
        made[head] = (*before[:2], default.removeprefix(", "), "")
    return list(made.values())


def _shared_groups(shared: dict[Group, str]) -> str:
    parts, done = ["## Keys that several levels have\n"], set[str]()
    for (_, keys), name in shared.items():
        if name in done:
            continue
        done.add(name)
        rows = [(key, value, "", meaning) for key, value, meaning in keys]
        parts.append(f"### Keys of {name}\n\n{table(rows)}")
    return "\n".join(parts)


def section(title: str, kind: Any, text: str = "") -> str:
    """A heading with the table of the parameters of a dataclass."""
    return (
        f"{title}\n{text}\n{table(parameter_rows(kind))}"
        if text
        else f"{title}\n\n{table(parameter_rows(kind))}"
    )


def table(rows: Sequence[tuple[str, ...]]) -> str:
    """Rows of keys, ranges, defaults and meanings in Markdown; empty columns are left out."""
    head = ("key", "value", "default", "meaning")
    shown = [(f"`{key}`", _range(v), f"`{d}`" if d else "", _unitless(key, m)) for key, v, d, m in rows]
    used = [k for k in range(len(head)) if any(row[k] for row in shown)]
    lines = ["| " + " | ".join(head[k] for k in used) + " |", "|" + "---|" * len(used)]
    lines += ["| " + " | ".join(row[k].replace("|", "\\|") for k in used) + " |" for row in shown]
    return "\n".join(lines) + "\n"


def _range(value: str) -> str:
    """A range as an interval; that null may stand there says the default."""

    def interval(found: re.Match[str]) -> str:
        whole, above, low, below, high = found.groups()
        return f"{whole or ''}{'(' if above else '['}{low}, {high}{')' if below else ']'}"

    value = value.removesuffix(" or null")
    return re.sub(r"(whole, )?(> )?(-?[\d.e+]+) to (< )?(-?[\d.e+]+)", interval, value)


def _unitless(key: str, meaning: str) -> str:
    """Without the unit at its end, where the key carries it."""
    bare, _, unit = meaning.rpartition("[")
    carries = any(key.endswith(f"_{one}") for one in UNITS)
    return bare.rstrip() if carries and unit.endswith("]") else meaning


if __name__ == "__main__":
    PAGE.write_text(reference(), encoding="utf-8")
