"""`swath fmu`: look at an FMU, and try it out."""

import argparse
from pathlib import Path
from typing import Any


def add(parsers: Any) -> None:
    """Add the command and its verbs."""
    parser = parsers.add_parser("fmu", help="look at an FMU, try it out")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    shows = verbs.add_parser("show", help="variables, units and capabilities of an FMU")
    shows.add_argument("file", type=Path, metavar="X.fmu", help="an FMU, or a system of several (.ssp, .ssd)")
    shows.add_argument("--all", action="store_true", help="local variables too")
    shows.set_defaults(run=run_show)
    checks = verbs.add_parser("check", help="run an FMU in a process of its own and say what was found")
    checks.add_argument("file", type=Path, metavar="X.fmu", help="an FMU")
    checks.add_argument("--step-ms", type=float, default=100.0, metavar="MS", help="step (default 100)")
    checks.add_argument("--duration-s", type=float, default=1.0, metavar="S", help="how long (default 1)")
    checks.add_argument(
        "--timeout-s", type=float, default=10.0, metavar="S", help="for an answer (default 10)"
    )
    checks.set_defaults(run=run_check)


def run_show(args: argparse.Namespace) -> int:
    """Print what the FMU says about itself."""
    from swath.commands.output import table
    from swath.link.fmi.composite import describe_file
    from swath.link.fmi.units import describe

    fmu = describe_file(args.file)
    can = {
        "state saved": fmu.saves_state,
        "state as bytes": fmu.serializes,
        "steps of any length": fmu.variable_step,
        "events": fmu.has_events,
        "returns early": fmu.returns_early,
        "one per process": fmu.one_per_process,
        "needs its tool": fmu.needs_tool,
    }
    rows = [
        ("name", fmu.name),
        ("FMI", f"{fmu.version}, co-simulation"),
        ("made by", fmu.tool or "-"),
        ("binaries for", ", ".join(fmu.platforms) or "none"),
        ("fixed step", f"{fmu.fixed_step:g} s" if fmu.fixed_step else "-"),
        ("suggested step", f"{fmu.default_step:g} s" if fmu.default_step else "-"),
        *((what, "yes" if yes else "no") for what, yes in can.items()),
        *(("fault", fault) for fault in fmu.faults),
    ]
    table("", ("", ""), rows)
    causalities = ["structuralParameter", "parameter", "input", "output"]
    causalities += ["calculatedParameter", "local", "independent"] if args.all else []
    made = [
        (
            v.name + (f"[{v.size}]" if v.is_array else ""),
            v.causality,
            v.type,
            v.unit_name or "",
            "" if v.unit is None else describe(v.unit).partition(" = ")[2],
            "" if v.start is None else _short(v.start),
            v.description,
        )
        for v in sorted(fmu.of(*causalities), key=lambda v: causalities.index(v.causality))
    ]
    table("", ("variable", "causality", "type", "unit", "in SI", "start", "description"), made)
    return 0


def run_check(args: argparse.Namespace) -> int:
    """Run it; 1 when it cannot fill a slot."""
    from swath.commands.output import table
    from swath.core.errors import InputError
    from swath.link.fmi.check import check_fmu

    for flag, value in (("--step-ms", args.step_ms), ("--duration-s", args.duration_s)):
        if not value > 0.0:
            raise InputError(flag, value, "expected > 0")
    finding = check_fmu(
        args.file, step_s=args.step_ms * 1e-3, duration_s=args.duration_s, timeout_s=args.timeout_s
    )
    table("", ("what", "verdict", "found"), finding.rows)
    print("it can fill a slot" if finding.is_usable else "it cannot fill a slot as it is")
    return 0 if finding.is_usable else 1


def _short(value: Any, limit: int = 24) -> str:
    parts = value if isinstance(value, list) else [value]
    text = " ".join(f"{x:g}" if isinstance(x, float) else str(x) for x in parts)
    return text if len(text) <= limit else text[: limit - 3] + "..."
