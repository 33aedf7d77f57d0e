"""`swath odd`: operational design domains and how they are bound to swath."""

import argparse
from typing import Any

from swath.terminal.options import option, verb
from swath.terminal.tables import add_json, as_json, table

PLACE = "many", 2  # among all commands


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser("odd", help="check an operational design domain", description=_DESCRIPTION)
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    check = verb(verbs, "check", "what is unbound, out of range, contradictory, not simulated", _check)
    option(check, "odd ODD", "a binding, an OpenODD document, or wheat-harvest")
    add_json(check)


def _check(args: argparse.Namespace) -> int:
    from swath.tools.function_test.odd.binding import find_odd
    from swath.tools.function_test.odd.check import NOT_SIMULATED, UNBOUND, WRONG, check_file, table_of

    domain, findings = check_file(find_odd(args.odd, "ODD"))
    rows = table_of(findings)
    wrong = sum(finding.kind in WRONG for finding in findings)
    if args.json:
        as_json(("kind", "attribute", "what"), rows)
        return 1 if wrong else 0
    if rows:
        table("", ("kind", "attribute", "what"), rows)
    bound = len(domain.attributes) - len({f.name for f in findings if f.kind in (UNBOUND, NOT_SIMULATED)})
    print(f"{bound} of {len(domain.attributes)} attributes are bound; {wrong} to mend")
    return 1 if wrong else 0


_DESCRIPTION = """An operational design domain (ODD) says where a function is meant to work.
`swath test run --odd` drives it; see docs/how-to/odd.md. Exit code of check:
0 nothing to mend, 1 something, 2 bad input."""
