"""`swath levels`: every slot, its levels, what they cost and how far to trust them."""

import argparse
from typing import Any


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("levels", help="list the levels of every slot, or of one")
    parser.add_argument("slot", nargs="?", metavar="SLOT", help="only this slot, with its parameters")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the levels."""
    from swath.commands.output import table
    from swath.core.errors import InputError
    from swath.sim.hints import near_miss
    from swath.sim.kit import KIT

    slots = [slot.name for slot in KIT.slots]
    kinds = [*KIT.field_levels, *slots]
    if args.slot is not None and args.slot not in kinds:
        hint = near_miss(args.slot, kinds)
        raise InputError("slot", args.slot, f"expected one of {', '.join(kinds)}{hint}")
    rows = []
    for kind in [args.slot] if args.slot else kinds:
        for name in KIT.registry.names(kind):
            level = KIT.registry.get(kind, name)
            star = " *" if name == KIT.default_level(kind) else ""
            rows.append((kind, name + star, level.summary, level.cost, level.tolerance))
    for name in KIT.registry.links():
        level = KIT.registry.get(args.slot if args.slot in slots else slots[0], name)
        rows.append(("any", name, level.summary, level.cost, level.tolerance))
    table("", ("slot", "level", "what it is", "cost", "checked, tolerance"), rows)
    print("* the default. Your own: `level: file.py:Class`.")
    if args.slot:
        _parameters(args.slot)
    return 0


def _parameters(kind: str) -> None:
    from swath.commands.output import table
    from swath.sim.kit import KIT
    from swath.sim.reference import parameter_rows

    for name in KIT.registry.names(kind):
        rows = parameter_rows(KIT.registry.get(kind, name).params)
        if rows:
            table(f"{kind}: {name}", ("key", "value", "default", "meaning"), rows)
