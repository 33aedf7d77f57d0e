"""Options that commands share: which scenario, what is changed in it, where to write."""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, cast

from swath.core.files.output_folder import held
from swath.core.number_text import num

Made = TypeVar("Made")
Run = Callable[[argparse.Namespace], int]


def option(
    parser: argparse._ActionsContainer,
    name: str,
    text: str,
    default: Any = None,
    *,
    unit: str = "",
    **more: Any,
) -> None:
    """Add an option or an argument.

    name: with what stands for its value, `--budget N`; an option without that is a flag
    text: of the help
    default: its type is that of the value, and the help says it; a list: the option may be given several
        times; a tuple: what may stand there, the first is the default
    unit: of a number, a key of `swath.core.units.UNITS` (default: what the name ends in)
    more: what else argparse takes
    """
    name, _, metavar = name.partition(" ")
    if metavar:
        more["metavar"] = metavar
    if isinstance(default, list):
        more["action"] = "append"
    elif isinstance(default, tuple):
        more["choices"], default = default, default[0]
    elif default is not None:
        more.setdefault("type", Path if isinstance(default, Path) else type(default))
    elif name.startswith("-") and not more.keys() & {"metavar", "choices", "nargs"}:
        more["action"] = "store_true"
    if isinstance(default, int | float | str | Path) and default != "" and "default" not in text:
        text += f" (default {num(default)})" if isinstance(default, float) else f" (default {default})"
    added = parser.add_argument(name, help=text, **more if default is None else {**more, "default": default})
    vars(added)["unit"] = unit


def verb(parsers: Any, name: str, text: str, run: Run, description: str | None = None) -> Any:
    """The parser of a command, or of a verb of one, that does something. text: its line of help."""
    parser = parsers.add_parser(name, help=text, description=description)
    parser.set_defaults(run=run)
    return parser


def made_of(kind: type[Made], args: argparse.Namespace, names: Mapping[str, str] | None = None,
            **values: Any) -> Made:  # fmt: skip
    """A dataclass of the options that are called as its fields; one that is not given leaves the default.

    names: of options that are called otherwise, by field; values: of fields, instead of an option
    """
    said = {f.name: vars(args).get((names or {}).get(f.name, f.name)) for f in fields(cast(Any, kind))}
    given = {k: tuple(v) if isinstance(v, list) else v for k, v in said.items() if v is not None}
    return kind(**{**given, **values})


def add_scenario_options(parser: argparse.ArgumentParser) -> None:
    """`--out`, `--set` and `--seed`."""
    add_run_folder(parser)
    add_sets(parser, "change the scenario, e.g. combine.speed.speed_kmh=5; may be given several times")
    option(parser, "--seed N", "another seed", type=int)


def add_folder(
    parser: argparse.ArgumentParser,
    what: str,
    *own: str,
    text: str = "where to write",
    required: bool = True,
    alone: bool = True,
) -> None:
    """`--out DIR`, which the command has for itself while it runs. what, own, alone: as of `held`."""
    option(parser, "--out DIR", text, type=Path, required=required)
    parser.set_defaults(holds=partial(held, own=own, what=what, alone=alone))


def add_run_folder(parser: argparse.ArgumentParser) -> None:
    """`--out`, the folder of a run."""
    option(parser, "--out DIR", "where to write (default: a new folder in runs/)", type=Path)


def add_replace(parser: argparse.ArgumentParser) -> None:
    """`--replace`, for an `--out` in which another run or scan lies."""
    option(parser, "--replace", "write over another run or scan that lies in DIR")


def add_sets(parser: argparse.ArgumentParser, text: str = "change the scenario") -> None:
    """`--set KEY=VALUE`, any number of times, as `sets`. text: for the help."""
    option(parser, "--set KEY=VALUE", text, [], dest="sets", type=_change)


def _change(text: str) -> str:
    if "=" not in text:
        raise argparse.ArgumentTypeError(f"{text}: expected KEY=VALUE, without blanks about the =")
    return text


def add_allow(parser: argparse.ArgumentParser) -> None:
    """`--allow CODE`: what a change of a run may bring along."""
    option(
        parser,
        "--allow CODE",
        "file.py:Class, FMU or file that may be set while it runs; may be given several times",
        [],
    )


def former(parser: argparse.ArgumentParser, **names: str) -> None:
    """Names that options had in version 0.2, `new="--old"`: taken, not shown."""
    for action in parser._actions:
        if action.dest in names:
            parser._option_string_actions[names[action.dest]] = action


def add_ros2_network(parser: argparse.ArgumentParser) -> None:
    """`--ros2-network`, without which ROS 2 stays on this machine."""
    option(
        parser,
        "--ros2-network",
        "let ROS 2 nodes of other machines take part: everybody on the network (SECURITY.md)",
    )


def load(args: argparse.Namespace) -> Any:
    """The scenario that the arguments ask for."""
    from swath.scenario.scenario import load_scenario

    flags = {f"--seed {args.seed}": f"seed={args.seed}"} if args.seed is not None else {}
    if getattr(args, "real_time", False):
        flags["--real-time"] = "realtime.pace=real_time"
    if getattr(args, "field_state", None) is not None:
        flags[f"--field-state {args.field_state}"] = f"field.state_file={args.field_state}"
    if getattr(args, "devices", None):
        flags |= _devices(args.devices, load_scenario(args.scenario, sets=args.sets, flags=flags))
    return load_scenario(args.scenario, sets=args.sets, flags=flags)


def _devices(texts: list[str], scenario: Any) -> dict[str, str]:
    """`--device lidar=lms://` as changes of the scenario. InputError where the slot is not clear."""
    from swath.core.errors import InputError

    flags = {}
    for text in texts:
        slot, equals, address = text.partition("=")
        if not equals or not slot or not address:
            raise InputError("--device", text, "expected SLOT=ADDRESS, such as lidar=lms://127.0.0.1:2111")
        if "." not in slot:
            names = [n for n, machine in scenario.machines.items() if slot in machine.slots]
            names = names or list(scenario.machines)
            if len(names) != 1:
                several = " or ".join(f"{name}.{slot}" for name in names)
                raise InputError("--device", text, f"expected one of the machines: {several}")
            slot = f"{names[0]}.{slot}"
        flags[f"--device {text}"] = f"{slot}.device={address}"
    return flags
