"""`swath new`: templates to begin with, and the examples."""

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Template:
    """A file of `examples`. what: for the help; try_it: a command that runs it, with {file} for its name."""

    source: str
    what: str
    try_it: str


TEMPLATES = {
    "scenario": Template("my_scenario.yaml", "a scenario", "swath run {file}"),
    "detector": Template(
        "my_edge_detector.py",
        "an edge detector",
        "swath run straight --set combine.edge.level={file}:MyEdgeDetector",
    ),
    "steering": Template(
        "my_steering_law.py",
        "a steering law",
        "swath run straight --set combine.steer.level={file}:MySteeringLaw",
    ),
    "sensor": Template(
        "my_scanner.yaml",
        "the data sheet of a scanner",
        "swath scan straight --set combine.lidar.sensor={file}",
    ),
    "evaluator": Template(
        "my_evaluator.py", "a metric", "swath run straight --set evaluators=[{file}:SteeringReversals]"
    ),
}


def add(parsers: Any) -> None:
    """Add the command."""
    parser = parsers.add_parser(
        "new", help="write a template: scenario, detector, ...; or all examples", description=_DESCRIPTION
    )
    kinds = "; ".join(f"{kind}: {template.what}" for kind, template in TEMPLATES.items())
    help_ = f"{kinds}; examples: a folder with all examples"
    parser.add_argument("kind", metavar="KIND", choices=[*TEMPLATES, "examples"], help=help_)
    parser.add_argument(
        "file", metavar="FILE", nargs="?", type=Path, help="where to write (default: its name)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the template, say how to run it."""
    import shlex
    import shutil

    from swath.core.errors import InputError
    from swath.core.whole_file import write_whole

    template = TEMPLATES.get(args.kind)
    out = args.file or Path(template.source if template else "examples")
    if out.exists() or out.is_symlink():
        raise InputError("FILE", str(out), "expected a name that is free; nothing is overwritten")
    out.parent.mkdir(parents=True, exist_ok=True)
    if template is None:
        shutil.copytree(examples(), out, ignore=shutil.ignore_patterns("__pycache__"))
        print(out)
        return 0
    text = (examples() / template.source).read_text(encoding="utf-8")
    write_whole(out, text.replace(f"examples/{template.source}", str(out)))
    if args.kind == "scenario":
        from swath.commands.schema import write_schema

        write_schema(out.parent / "scenario.schema.json")
    words = (word.format(file=out) for word in template.try_it.split())
    print(f"{out}: try it with\n  {shlex.join(words)}")
    return 0


def examples() -> Path:
    """The folder with the examples: in the package, or beside `src` where it is run from its sources."""
    package = Path(__file__).parents[1]
    installed = package / "examples"
    return installed if installed.is_dir() else package.parents[1] / "examples"


_DESCRIPTION = """Write a commented template that runs as it is. An existing file is never overwritten.
The examples that the documentation names as examples/... come with `swath new examples`."""
