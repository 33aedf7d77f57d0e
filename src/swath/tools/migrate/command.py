"""`swath migrate`: files of swath 0.1 in the form of today."""

import argparse
from pathlib import Path
from typing import Any


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser(
        "migrate",
        help="rewrite scenarios, data sheets and Python files of version 0.1",
        description="Rewrites files in place; the old form stays beside each as NAME.orig.",
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="scenario, sheet or .py file")
    parser.add_argument("--dry-run", action="store_true", help="say what would change, change nothing")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Rewrite the files, one line about each."""
    from swath.documents.text_file import read_text
    from swath.tools.migrate.migrate import migrate_file
    from swath.tools.migrate.python_names import migrate_python, missing_names

    for file in args.files:
        is_changed = migrate_file(file, is_dry=args.dry_run)
        what = ("would be rewritten" if args.dry_run else "rewritten") if is_changed else "is up to date"
        print(f"{file}: {what}")
        if file.suffix == ".py":
            for line, text in missing_names(migrate_python(read_text(file, "file", "Python"))):
                print(f"{file}:{line}: {text}")
    return 0
