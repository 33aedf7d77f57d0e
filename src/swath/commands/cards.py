"""`swath cards`: the bundled data sheets of sensors, machines and crops, to look at and to copy."""

import argparse
from typing import Any

KINDS = ("sensors", "machines", "crops")


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser(
        "cards", help="data sheets of sensors, machines and crops; print one to make your own of it"
    )
    parser.add_argument("name", nargs="?", metavar="NAME", help="print this card, e.g. sick-lms111")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print a card as it is, or the names of all."""
    from swath.documents.data_sheets import Card, card_names, find_card

    if args.name is not None:
        print(find_card(_kind_of(args.name), args.name).read_text(encoding="utf-8"), end="")
        return 0
    from swath.terminal.tables import table

    cards = [(kind, name, Card(find_card(kind, name))) for kind in KINDS for name in card_names(kind)]
    rows = [(kind, name, str(card.data.get("name", ""))) for kind, name, card in cards]
    table("", ("kind", "card", "what it is"), rows)
    print("Your own: swath cards NAME > mine.yaml, change it, and give the file's name for the card's.")
    return 0


def _kind_of(name: str) -> str:
    from difflib import get_close_matches

    from swath.core.errors import InputError
    from swath.documents.data_sheets import card_names

    kinds = {card: kind for kind in KINDS for card in card_names(kind)}
    if name not in kinds:
        near = get_close_matches(name, kinds, n=1)
        hint = f"did you mean {near[0]!r}?" if near else "swath cards lists them"
        raise InputError("card", name, f"expected a bundled card, {hint}")
    return kinds[name]
