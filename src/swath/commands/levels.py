"""`swath levels`: every slot, its levels, their cost and tolerance."""

import argparse
from typing import Any


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("levels", help="list the levels of every slot, or of one")
    parser.add_argument("slot", nargs="?", metavar="SLOT", help="only this slot, with its parameters")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the levels."""
    from swath.core.errors import InputError
    from swath.documents.hints import near_miss
    from swath.scenario.catalogue import CATALOGUE
    from swath.terminal.tables import table

    slots = [slot.name for slot in CATALOGUE.slots]
    kinds = [*CATALOGUE.field_levels, *slots]
    if args.slot is not None and args.slot not in kinds:
        hint = near_miss(args.slot, kinds)
        raise InputError("slot", args.slot, f"expected one of {', '.join(kinds)}{hint}")
    rows = []
    for kind in [args.slot] if args.slot else kinds:
        for name in CATALOGUE.registry.names(kind):
            level = CATALOGUE.registry.get(kind, name)
            star = " *" if name == CATALOGUE.default_level(kind) else ""
            rows.append((kind, name + star, level.summary, level.cost, level.tolerance))
        for name, package in CATALOGUE.registry.installed(kind).items():
            rows.append((kind, name, f"of the installed package {package}", "", ""))
    for name in CATALOGUE.registry.links():
        level = CATALOGUE.registry.get(args.slot if args.slot in slots else slots[0], name)
        rows.append(("any", name, level.summary, level.cost, level.tolerance))
    table("", ("slot", "level", "what it is", "cost", "checked, tolerance"), rows)
    print("* the default. Your own: `level: file.py:Class`.")
    if args.slot:
        _ports(args.slot)
        _parameters(args.slot)
    return 0


def _ports(name: str) -> None:
    """Inputs and outputs of the slot, with the fields of their samples."""
    from dataclasses import fields

    from swath.scenario.catalogue import CATALOGUE
    from swath.scenario.slots import PEER, kind_of

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
            print(f"{title:8} {port}")
            title = ""


def _parameters(kind: str) -> None:
    from swath.scenario.catalogue import CATALOGUE
    from swath.scenario.reference import parameter_rows
    from swath.terminal.tables import table

    for name in CATALOGUE.registry.names(kind):
        rows = parameter_rows(CATALOGUE.registry.get(kind, name).params)
        if rows:
            table(f"{kind}: {name}", ("key", "value", "default", "meaning"), rows)
