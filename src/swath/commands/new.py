"""`swath new`: templates to begin with, and the examples."""

import argparse
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swath.commands.docs import folder
from swath.terminal.options import option, verb

PLACE = "start", 6  # among all commands


@dataclass(frozen=True)
class Template:
    """A file to begin with.

    source: file of `examples`, or with a folder of the bundled data
    what: one line for the help
    try_it: words of a command, with {file} for its name
    beside: another file of that folder, which it names
    """

    source: str
    what: str
    try_it: tuple[str, ...]
    beside: str = ""

    @property
    def path(self) -> Path:
        """The file that is copied."""
        return (
            Path(__file__).parents[1] / "data" if "/" in self.source else folder("examples")
        ) / self.source


TEMPLATES = {
    "scenario": Template("my_scenario.yaml", "a scenario", ("run", "{file}")),
    "detector": Template(
        "my_edge_detector.py",
        "an edge detector",
        ("run", "straight", "--set", "combine.edge.level={file}:MyEdgeDetector"),
    ),
    "steering": Template(
        "my_steering_law.py",
        "a steering law",
        ("run", "straight", "--set", "combine.steer.level={file}:MySteeringLaw"),
    ),
    "sensor": Template(
        "my_scanner.yaml",
        "the data sheet of a scanner",
        ("scan", "straight", "--set", "combine.lidar.sensor={file}"),
    ),
    "evaluator": Template(
        "my_evaluator.py", "a metric", ("run", "straight", "--set", "evaluators=[{file}:SteeringReversals]")
    ),
    "machine": Template(
        "machines/lexion-700-class.yaml",
        "the data sheet of a combine",
        ("run", "straight", "--set", "combine.machine={file}"),
    ),
    "crop": Template(
        "crops/wheat.yaml",
        "the data sheet of a crop",
        ("run", "straight", "--set", "field.stand.crop={file}"),
    ),
    "case": Template(
        "tests/gap.yaml", "a function test", ("test", "run", "{file}", "--draw", "1", "--seeds", "1")
    ),
    "odd": Template(
        "odds/wheat-harvest.odd.yaml",
        "an operational design domain and what it means in swath",
        ("odd", "check", "{file}"),
        beside="wheat-harvest.openodd.yaml",
    ),
    "job": Template("jobs/small-field.yaml", "a whole field", ("fleet", "run", "{file}")),
}


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(
        parsers, "new", "write a template: scenario, detector, ...; or all examples", run, _DESCRIPTION
    )
    kinds = "; ".join(f"{kind}: {template.what}" for kind, template in TEMPLATES.items())
    help_ = f"{kinds}; examples: a folder with all examples"
    option(parser, "kind KIND", help_, choices=[*TEMPLATES, "examples"])
    option(parser, "file FILE", "where to write (default: its name)", nargs="?", type=Path)


def _ends(name: str) -> tuple[str, ...]:
    """How a file of the same kind may be called, by its last letters."""
    return (".yaml", ".yml") if name.endswith(".yaml") else (Path(name).suffix,)


def run(args: argparse.Namespace) -> int:
    """Write the template, say how to run it."""
    import shutil

    from swath.core.errors import InputError
    from swath.core.files.whole_file import write_whole
    from swath.core.process.shell import command

    template = TEMPLATES.get(args.kind)
    usual = "examples" if template is None else template.source
    usual = f"my_{args.kind}.yaml" if "/" in usual else usual
    out = args.file or Path(usual)
    if template and out.suffix not in (ends := _ends(usual)):
        raise InputError("FILE", str(out), f"expected a name that ends in {' or '.join(ends)}, as {usual}")
    beside = [out.parent / template.beside] if template and template.beside else []
    for path in (out, *beside):
        if os.path.exists(path) or os.path.islink(path):
            raise InputError("FILE", str(path), "expected a name that is free; nothing is overwritten")
    if template is None:
        shutil.copytree(folder("examples"), out, ignore=shutil.ignore_patterns("__pycache__"))
        print(out)
        return 0
    write_whole(
        out, template.path.read_text(encoding="utf-8").replace(f"examples/{template.source}", str(out))
    )
    for path in beside:
        write_whole(path, (template.path.parent / path.name).read_text(encoding="utf-8"))
    if args.kind == "scenario":
        from swath.commands.schema import write_schema

        write_schema(out.parent / "scenario.schema.json")
    print(f"{out}: try it with\n  {command(*(word.format(file=out) for word in template.try_it))}")
    return 0


_DESCRIPTION = """Write a commented template that runs as it is. An existing file is never overwritten.
The examples that the documentation names as examples/... come with `swath new examples`."""
