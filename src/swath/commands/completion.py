"""`swath completion`: what a shell needs to complete commands and options."""

import argparse
from typing import Any

from swath.terminal.options import option, verb

PLACE = "connect", 5  # among all commands
SHELLS = ("bash", "zsh", "tcsh")


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "completion", "print a script that completes swath in a shell", run, _DESCRIPTION)
    option(parser, "shell SHELL", f"one of {', '.join(SHELLS)}", choices=SHELLS)


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    from swath.core.errors import Extra

    with Extra("shell", "swath completion"):
        import shtab
    print(shtab.complete(args.make_parser()[0], args.shell))
    return 0


_DESCRIPTION = """Print a script for a shell, once: `swath completion bash >
~/.local/share/bash-completion/completions/swath`, or `swath completion zsh > DIR/_swath`, DIR in fpath."""
