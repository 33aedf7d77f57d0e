"""`swath fmu`: show, check and export FMUs."""

import argparse
from pathlib import Path
from typing import Any

from swath import __version__

PLACE = "connect", 1  # among all commands


def add(parsers: Any) -> None:
    """Add the command and its verbs."""
    from swath.terminal.options import add_scenario_options, former, option, verb

    parser = parsers.add_parser("fmu", help="show, check and export FMUs")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    shows = verb(verbs, "show", "variables, units and capabilities of an FMU", run_show)
    option(shows, "file X.fmu", "an FMU, or a system of several (.ssp, .ssd)", type=Path)
    option(shows, "--all", "local variables, too")
    checks = verb(verbs, "check", "run an FMU in a process of its own and say what was found", run_check)
    option(checks, "file X.fmu", "an FMU", type=Path)
    for flag, default, text in (
        ("--step-ms", 100.0, "communication step [ms]"),
        ("--duration-s", 1.0, "simulated time [s]"),
        ("--timeout-s", 10.0, "longest wait for an answer [s]"),
    ):
        checks.add_argument(flag, type=float, default=default, help=f"{text} (default {default:g})")

    exports = verb(verbs, "export", "slots of a scenario as an FMU for other tools", run_export)
    option(exports, "scenario NAME|FILE", "bundled scenario, YAML file or run folder")
    option(exports, "--fmi N", "version of FMI: 3 (default) or 2", 3)
    slot = "combine.process, or process where there is one machine; may be given several times"
    key = "a key of the scenario that becomes a parameter, e.g. field.stand.stems_per_m2"
    option(exports, "--slot SLOT", slot, [], dest="parts")
    option(exports, "--parameter KEY", key, [], dest="parameters")
    add_scenario_options(exports)
    former(exports, parts="--part")


def run_show(args: argparse.Namespace) -> int:
    """Print what the FMU says about itself."""
    from swath.link.fmi.composite import describe_file
    from swath.link.fmi.units import describe
    from swath.terminal.tables import table

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
    from swath.core.errors import InputError
    from swath.link.fmi.check import check_fmu
    from swath.terminal.tables import table

    for flag, value in (("--step-ms", args.step_ms), ("--duration-s", args.duration_s)):
        if not value > 0.0:
            raise InputError(flag, value, "expected > 0")
    rows = check_fmu(
        args.file, step_s=args.step_ms * 1e-3, duration_s=args.duration_s, timeout_s=args.timeout_s
    )
    table("", ("what", "result", "found"), rows)
    is_usable = all(result != "bad" for _, result, _ in rows)
    print("it can fill a slot" if is_usable else "it cannot fill a slot as it is")
    return 0 if is_usable else 1


def run_export(args: argparse.Namespace) -> int:
    """Write an FMU."""
    from swath.core.errors import InputError
    from swath.link.fmi.export import elsewhere_line, export_fmu, importer_line
    from swath.terminal.options import load
    from swath.terminal.tables import table

    scenario = load(args)
    if args.out is None or args.out.suffix != ".fmu":
        raise InputError("--out", args.out and str(args.out), "expected a file such as x.fmu")
    try:
        variables = export_fmu(scenario, args.parts, args.out, version=args.fmi, parameters=args.parameters)
    except InputError as error:
        raise scenario.locate(error) from error
    rows = [(v.name, v.causality, v.kind, v.unit, v.description) for v in variables]
    table("", ("variable", "causality", "type", "unit", "description"), rows)
    print(
        f"{args.out}  FMI {args.fmi}, for Linux and Windows on x86-64: the importer needs a Python with "
        f"swath {__version__}, see docs/how-to/simulink.md"
    )
    print(f"a program that is no Python needs {elsewhere_line()}")
    print(f"a program that is no Python starts here with: {importer_line()}")
    return 0


def _short(value: Any, limit: int = 24) -> str:
    parts = value if isinstance(value, list) else [value]
    text = " ".join(f"{x:g}" if isinstance(x, float) else str(x) for x in parts)
    return text if len(text) <= limit else text[: limit - 3] + "..."
