"""`swath levels`: every slot and its levels; of one slot their cost and tolerance, ports and parameters."""

import argparse
from dataclasses import asdict
from typing import Any

from swath.core.errors import near_miss
from swath.terminal.options import option, verb
from swath.terminal.tables import add_json, as_json, say, table

PLACE = "start", 3  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "levels", "list every slot with its levels; explain one slot", run)
    option(parser, "slot SLOT", "explain its levels, ports and parameters", nargs="?")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Print the levels."""
    from swath.core.errors import InputError
    from swath.runtime.met import untold
    from swath.scenario.slots import CATALOGUE

    slots = [slot.name for slot in CATALOGUE.slots]
    kinds = [*CATALOGUE.field_levels, *slots]
    if args.slot is not None and args.slot not in kinds:
        hint = near_miss(args.slot, kinds)
        raise InputError("slot", args.slot, f"expected one of {', '.join(kinds)}{hint}")
    rows = [
        (kind, name, name == CATALOGUE.default_level(kind), level.summary, level.cost, level.tolerance)
        for kind in ([args.slot] if args.slot else kinds)
        for name in (*CATALOGUE.registry.names(kind), *_links(kind, slots))
        for level in [CATALOGUE.registry.get(kind, name)]
    ]
    checked = {(kind, name): CATALOGUE.registry.get(kind, name).checked for kind, name, *_ in rows}
    rows += [
        (kind, name, False, f"of the installed package {package}", "", "")
        for kind in ([args.slot] if args.slot else kinds)
        for name, package in CATALOGUE.registry.installed(kind).items()
    ]
    if args.json:
        keys = ("slot", "level", "is_default", "summary", "cost", "tolerance")
        ranges_of = [[asdict(own) for own in checked.get((kind, name), ())] for kind, name, *_ in rows]
        whole = [(*row, own, _keys(row[0], row[1])) for row, own in zip(rows, ranges_of, strict=True)]
        as_json((*keys, "checked", "parameters"), whole)
    elif args.slot:
        columns = ("level", "what it is", "cost", "checked, tolerance")
        table("", columns, [(row[1] + " *" * row[2], *row[3:]) for row in rows])
        say("* the default. Your own: `level: file.py:Class`.")
        ranges = [
            (name, c.quantity, c.span, c.witness, c.source) for (_, name), own in checked.items() for c in own
        ]
        if ranges:
            table(f"{args.slot}: ranges", ("level", "quantity", "checked", "against", "by"), ranges)
        for name in (n for _, n in checked if n not in CATALOGUE.registry.links()):
            if names := untold(args.slot, {q for n, q, *_ in ranges if n == name}):
                say(f"{name} has no range of {', '.join(names)}")
        _ports(args.slot)
        _parameters(args.slot)
    else:
        links = CATALOGUE.registry.links()
        named = [(kind, [r for r in rows if r[0] == kind and r[1] not in links]) for kind in kinds]
        table("", ("slot", "levels"), [(k, ", ".join(r[1] + "*" * r[2] for r in own)) for k, own in named])
        say(f"* the default. In any slot of a machine: {', '.join(links)}, or `file.py:Class`.")
        say("swath levels SLOT says what each is, costs and was checked for, with its parameters.")
    return 0


def _links(kind: str, slots: list[str]) -> list[str]:
    """Levels that every slot of a machine has: FMU, ROS 2 ..."""
    from swath.scenario.slots import CATALOGUE

    return list(CATALOGUE.registry.links()) if kind in slots else []


def _ports(name: str) -> None:
    """Inputs and outputs of the slot, with the fields of their samples."""
    from dataclasses import fields

    from swath.scenario.slots import CATALOGUE, PEER, kind_of

    kind = next((slot for slot in CATALOGUE.slots if slot.name == name), None)
    if kind is None:
        return

    def sent(slot: str, output: str) -> type:
        source = kind_of(slot.removeprefix(PEER), CATALOGUE.slots)
        assert source is not None
        return next(p.signal for p in (*source.outputs, *source.more) if p.name == output)

    def said(port: str, signal: type) -> str:
        return f"{port} ({signal.__name__}: {', '.join(f.name for f in fields(signal))})"

    sees = [said(port, sent(*source)) for port, source in kind.wires.items()]
    gives = [said(port.name, port.signal) for port in kind.outputs]
    gives += [f"{said(port.name, port.signal)}, optional" for port in kind.more]
    for title, ports in (("inputs", sees), ("outputs", gives)):
        for port in ports or ["none"]:
            say(f"{title:8} {port}")
            title = ""


def _keys(kind: str, name: str) -> list[dict[str, str]]:
    """The keys of a level; none of one of an installed package, which is not loaded to be listed."""
    from swath.scenario.reference import parameter_rows
    from swath.scenario.slots import CATALOGUE

    if name in CATALOGUE.registry.installed(kind):
        return []
    rows = parameter_rows(CATALOGUE.registry.get(kind, name).params)
    return [dict(zip(("key", "value", "default", "meaning"), row, strict=True)) for row in rows]


def _parameters(kind: str) -> None:
    from swath.scenario.reference import parameter_rows
    from swath.scenario.slots import CATALOGUE

    for name in CATALOGUE.registry.names(kind):
        rows = parameter_rows(CATALOGUE.registry.get(kind, name).params)
        if rows:
            table(f"{kind}: {name}", ("key", "value", "default", "meaning"), rows)
