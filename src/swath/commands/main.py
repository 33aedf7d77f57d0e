"""The command line. Everything heavy is imported by the command that needs it."""

import argparse
import errno
import os
import re
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NoReturn

from swath import __version__
from swath.core.errors import MIGRATED_BY, InputError, SwathError, fitted, near_miss, reason_of, shortened
from swath.core.files.place import within
from swath.core.files.temporary import sweep
from swath.core.foreign_code import allow_code, code_in, of_exit, texts_in
from swath.core.process.collector import collect_rarely
from swath.core.process.processes import skip_folder_settings
from swath.core.process.stopping import Terminated, raise_if_lost, stoppable
from swath.core.registry import OWN, installed, installed_part, user_line
from swath.core.typed_numbers import number_in, unit_of
from swath.link.ros2.middleware import networked
from swath.terminal.options import option

GROUPS = {
    "start": "start",
    "look": "look at a run, continue it, use its recording",
    "measured": "use measured data",
    "many": "many runs, whole fields",
    "connect": "connect and set up",
}
ALLOW_CODE = "let code run that the files name, with your rights: Python files, FMUs (SECURITY.md)"
ALLOW_ADDRESS = "open an address, bus or terminal that the files name, in the same words; several times"
HELP = ("--help", "-h")
SETTINGS = ("SWATH_CPU", "SWATH_DATA", "SWATH_DEBUG", "SWATH_DEVICE", "SWATH_THREADS")
MOST_SAID = 20  # of the mistakes in one file
GONE = {"migrate": MIGRATED_BY}  # commands of version 0.2: what to do instead
NOT_WRITABLE = (errno.EACCES, errno.EPERM, errno.EROFS)
BAD_INPUT, INTERNAL, INTERRUPTED, BROKEN_PIPE, TERMINATED = 2, 70, 130, 141, 143

EXAMPLES = """\
swath: a simulator for harvest machines that act on what they sense

  swath run laser-pilot    a combine steers itself by LiDAR: half a minute
  swath scenarios          what else there is to run
  swath --help             all commands"""


class UsageError(SwathError):
    """A command line with an unknown command or option."""


class _Parser(argparse.ArgumentParser):
    """Reports a wrong command line as one UsageError."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._negative_number_matcher = re.compile(r"-\.?\d")  # `-33.9,18.4` and `-1e3` are no options

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """As argparse; numbers as `swath.core.typed_numbers` reads them, in the option's unit."""
        if action.type not in (float, int):
            return super()._get_value(action, arg_string)
        unit, is_whole = vars(action).get("unit") or unit_of(action.dest), action.type is int
        try:
            return number_in(arg_string, unit, is_whole=is_whole)
        except ValueError as error:
            text = f"expected {'a whole number' if is_whole else 'a number'}, not {arg_string!r}{error}"
            raise argparse.ArgumentError(action, text) from None

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """As argparse, in swath's words."""
        if action.choices is not None and value not in action.choices:
            text = f"expected one of {', '.join(map(str, action.choices))}, not {value!r}"
            raise argparse.ArgumentError(action, text)

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} (see {self.prog} --help)")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse, but a command itself refuses what it does not know, and says what is near."""
        found, extra = super().parse_known_args(args, namespace)
        if extra and self._subparsers is None:
            import difflib

            near = difflib.get_close_matches(extra[0].partition("=")[0], self._option_string_actions, 1, 0.75)
            hint = f", did you mean {near[0]}?" if near else ""
            self.error(f"unrecognized arguments: {' '.join(extra)}{hint}")
        return found, extra


class _Help(argparse.RawDescriptionHelpFormatter):
    """The description holds the commands, in groups."""

    def add_argument(self, action: argparse.Action) -> None:
        """As argparse, without its list of the commands."""
        if not isinstance(action, _Commands):
            super().add_argument(action)


class _Unasked:
    """In the place of a parser where only the lines of commands are asked for: takes all, keeps none."""

    def __getattr__(self, _name: str) -> Any:
        return self

    def __call__(self, *_: Any, **_options: Any) -> Any:
        return self

    def __iter__(self) -> Iterator[Any]:
        return iter(())


class _Commands(argparse._SubParsersAction):  # type: ignore[type-arg]
    """Commands, and a line of help for each; with only_lines, nothing but that."""

    only_lines = False

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.lines: list[str] = []

    def add_parser(self, name: str, **options: Any) -> Any:
        """A parser of a command."""
        self.lines.append(f"  {name:<11} {options['help']}")
        return _Unasked() if self.only_lines else super().add_parser(name, **options)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line; returns the exit code.

    0 done, 1 a limit of the scenario failed, 2 bad input, 3 a limit was not judged or a claim not shown,
    4 better in the tuned cases only,
    70 a mistake in swath, 130 stopped by Ctrl-C, 143 by SIGTERM.
    """
    debug = os.environ.get("SWATH_DEBUG") == "1"
    try:
        _open_closed()
        collect_rarely()
        _name_unknown_settings()
        skip_folder_settings()
        sweep()
        with stoppable():
            try:
                code = _dispatch(list(sys.argv[1:] if argv is None else argv))
            except SystemExit as error:
                if user_line(error) is None:
                    raise
                raise of_exit(error) from error
            except Exception:
                raise_if_lost()  # a library that is being imported makes its own error of Ctrl-C
                raise
            sys.stdout.flush()
            return code
    except Terminated as error:
        return _say(str(error) or "stopped", TERMINATED)
    except KeyboardInterrupt as error:
        return _say(str(error) or "stopped", INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except OSError as error:
        if debug:
            traceback.print_exc()
        return _say(of_system(error), BAD_INPUT)
    except SwathError as error:
        if debug:
            traceback.print_exc()
        others = error.others if isinstance(error, InputError) else ()
        for each in (error, *others[: MOST_SAID - 1]):
            _say(str(each), BAD_INPUT)
        if len(others) >= MOST_SAID:
            _say(f"and {len(others) - MOST_SAID + 1} more", BAD_INPUT)
        return BAD_INPUT
    except Exception as error:
        if debug:
            traceback.print_exc()
        if _NO_MEMORY.search(_chain(error)):
            said = shortened(str(error), 100)
            return _say(f"there is too little memory ({said}); a run takes about 1 GB", BAD_INPUT)
        place = user_line(error)
        if place is not None:
            file, line = place
            what = f"{file}:{line}: {type(error).__name__}: {error}"
            return _say(f"{what} (in your own level; SWATH_DEBUG=1 prints the traceback)", BAD_INPUT)
        said = shortened(" ".join(str(error).split()), 100)
        return _say(
            f"{type(error).__name__}: {said}. This is a mistake in swath, not in your input. Please run it "
            "again with SWATH_DEBUG=1 and report what it prints, with the scenario",
            INTERNAL,
        )


def _dispatch(argv: list[str]) -> int:
    if not argv:
        print(EXAMPLES)
        return 0
    if bad := next((text for text in argv if "\0" in text), None):
        raise UsageError(f"{bad!r}: expected an argument without the character NUL")
    if argv == ["help"]:
        argv = ["--help"]
    if argv[0] in GONE:
        raise UsageError(f"{argv[0]}: no such command any more, {GONE[argv[0]]}")
    names = list(installed("command"))
    if not argv[0].startswith("-") and argv[0] not in names:
        hint = (
            near_miss(argv[0], names) or f", expected one of {', '.join(names) or 'none: install swath anew'}"
        )
        raise UsageError(f"{argv[0]}: no such command{hint}")
    args = make_parser(argv[0])[0].parse_args(argv)
    with ExitStack() as held:
        named = [t for key, value in vars(args).items() if key != "cluster" for t in texts_named(value)]
        held.enter_context(allow_code(None if args.allow_code else code_in(named), named))
        if args.no_code:
            print("swath: --no-code is what holds without --allow-code, it can be left out", file=sys.stderr)
        if vars(args).get("ros2_network"):
            held.enter_context(networked())
        held.enter_context(within(*(path for path in vars(args).values() if isinstance(path, Path))))
        if (holds := vars(args).get("holds")) and args.out is not None:
            held.enter_context(holds(args.out))
        code: int = args.run(args)
    return code


def make_parser(named: str = "") -> tuple[argparse.ArgumentParser, list[str]]:
    """The parser of all command lines, and the names of the commands.

    named: the first argument: where it is a command, that one is loaded, else all of swath, for `--help`
    without their options; all of them are entry points, `command.NAME`
    """
    parser = _Parser(prog="swath", usage="swath COMMAND ...", formatter_class=_Help)
    parser.add_argument("-V", "--version", action="version", version=f"swath {__version__}")
    parsers: Any = parser.add_subparsers(prog="swath", metavar="COMMAND", required=True, action=_Commands)
    parsers.only_lines = named in HELP
    known, shown = installed("command"), ["A simulator for harvest machines that act on what they sense."]
    wanted = [named] if named in known else [name for name, package in known.items() if package == OWN]
    modules = [] if named in ("-V", "--version") else [installed_part("command", name) for name in wanted]
    for group, title in {**GROUPS, "": "installed beside swath"}.items():
        first = len(parsers.lines)
        for module in sorted((m for m in modules if _place(m)[0] == group), key=_place):
            module.add(parsers)
        for name, package in known.items():
            if not group and package != OWN and name != named:
                parsers.add_parser(name, help=f"of the installed package {package}")
        if parsers.lines[first:]:
            shown.append("\n".join([f"{title}:", *parsers.lines[first:]]))
    parser.description = "\n\n".join(
        [*shown, "swath COMMAND --help explains a command, swath docs lists the documentation."]
    )
    for each in subcommands(parser):
        option(each, "--allow-code", ALLOW_CODE)
        option(each, "--allow-address ADDRESS", ALLOW_ADDRESS, action="append")
        each.add_argument("--no-code", action="store_true", help=argparse.SUPPRESS)  # of version 0.2
    parser.set_defaults(make_parser=make_parser)
    return parser, list(known)


def _place(module: Any) -> tuple[str, int]:
    """Group of a command and its place there."""
    found: tuple[str, int] = getattr(module, "PLACE", ("", 0))
    return found


def subcommands(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """The parsers of all commands and verbs that do something."""
    below = [a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    for each in below[0].values() if below else ():
        yield from subcommands(each)
    if not below:
        yield parser


def texts_named(value: Any) -> Iterator[str]:
    """Texts that an argument of the command line itself says: it, and those in the value of a `--set`."""
    for text in texts_in(value):
        key, equals, said = text.partition("=")
        yield text
        if equals:
            from swath.documents.yaml_document import parse_value

            yield said
            with suppress(InputError):
                yield from texts_in(parse_value(said, key))


_NO_MEMORY = re.compile("(?i)MemoryError|cannot allocate|failed to map segment|bad_alloc|unable to allocate")


def _chain(error: BaseException | None) -> str:
    """Kinds and texts of an error and of what it came from."""
    if error is None:
        return ""
    return f"{type(error).__name__} {error} {_chain(error.__cause__ or error.__context__)}"


def _open_closed() -> None:
    """Nothing in the place of a closed input or output, which the next opened file would take."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
            setattr(sys, name, open(number, "r" if not number else "w", closefd=False))  # noqa: SIM115


def _name_unknown_settings() -> None:
    """A note on stderr for every variable of the environment that looks like a setting and is none."""
    for name in sorted(n for n in os.environ if n.startswith("SWATH_") and n not in SETTINGS):
        hint = near_miss(name, SETTINGS) or f"; there are {', '.join(SETTINGS)}"
        print(f"swath: {shortened(name, 80)} in the environment is no setting{hint}", file=sys.stderr)


def of_system(error: OSError) -> str:
    """What the system says of a file: its name, and why it could not be."""
    if error.filename is None or error.strerror is None:
        return str(error)
    if isinstance(error.filename, str | bytes):
        file = os.fsdecode(error.filename)
        if os.path.islink(file) and not os.path.exists(file):  # of a name that is too long, too, they say no
            return f"{file}: expected a file or folder, not a link to what is not there"
        if error.errno in NOT_WRITABLE and not os.path.exists(file):  # only who writes meets this
            folder = os.path.dirname(file) or "."
            expected = f"expected a folder that can be written: {reason_of(error)}"
            return f"{folder}: {expected}; use --out, or work in another folder"
    return f"{error.filename}: {reason_of(error)}"


def _say(text: str, code: int) -> int:
    print("swath: " + fitted(" ".join(text.split())), file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
