"""`swath sheets`: the bundled data sheets of sensors, machines and crops, to look at and to copy."""

import argparse
from typing import Any

KINDS = ("sensors", "machines", "crops", "obstacles")


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser(
        "sheets", help="data sheets of sensors, machines and crops; print one to make your own of it"
    )
    parser.add_argument("name", nargs="?", metavar="NAME", help="print this data sheet, e.g. sick-lms111")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print a data sheet as it is and what its tags mean, or the names of all."""
    from swath.documents.data_sheets import TAGS, find_sheet, read_sheet, sheet_names

    if args.name is not None:
        print(find_sheet(_kind_of(args.name), args.name).read_text(encoding="utf-8"), end="")
        print("# tags: " + "; ".join(f"{tag} {meaning}" for tag, meaning in TAGS.items()))
        return 0
    from swath.terminal.tables import table

    rows = []
    for kind, name in [(folder, name) for folder in KINDS for name in sheet_names(folder)]:
        sheet = read_sheet(kind, name)
        tags = [str(entry["tag"]) for entry in sheet.numbers().values()]
        counts = ", ".join(f"{sum(tag.startswith(t) for tag in tags)} {t}" for t in TAGS)
        rows.append((kind, name, str(sheet.value("name")), counts))
    table("", ("kind", "data sheet", "what it is", "numbers by tag"), rows)
    print("; ".join(f"{tag} {meaning}" for tag, meaning in TAGS.items()))
    print("Your own: swath sheets NAME > mine.yaml, change it, and give the file's name for the sheet's.")
    return 0


def _kind_of(name: str) -> str:
    from swath.core.errors import InputError
    from swath.documents.data_sheets import sheet_names
    from swath.documents.hints import near_miss

    kinds = {sheet: kind for kind in KINDS for sheet in sheet_names(kind)}
    if name not in kinds:
        hint = near_miss(name, kinds) or "; swath sheets lists them"
        raise InputError("data sheet", name, f"expected a bundled data sheet{hint}")
    return kinds[name]
