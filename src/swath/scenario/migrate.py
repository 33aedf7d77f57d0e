"""A scenario of version 0.1 in the form of today: line by line, so that comments and layout stay."""

import re

from swath.scenario.versions import FORMAT, SECTIONS

_TOP = re.compile(r"^(['\"]?)([A-Za-z_][\w-]*)\1\s*:(?=\s|$)")


def migrate_scenario(text: str) -> str:
    """The text with its format line, and with its machines under `machines:`. A new one stays as it is."""
    blocks = _blocks(text)
    names = [name for name, _ in blocks]
    if "format" in names or "machines" in names:
        return text
    machines = [lines for name, lines in blocks if name and name not in SECTIONS]
    made: list[str] = []
    for name, lines in blocks:
        if name == "":  # comments at the start of the file
            made += lines
        elif name in SECTIONS:
            made += _with_format(made, lines)
        elif machines:
            made += _with_format(made, ["machines:\n"])
            made += [("  " + line if line.strip() else line) for lines in machines for line in lines]
            machines = []
    return "".join(made)


def _with_format(made: list[str], lines: list[str]) -> list[str]:
    has_format = any(line.startswith("format:") for line in made)
    return lines if has_format else [f"format: {FORMAT}\n", *lines]


def _blocks(text: str) -> list[tuple[str, list[str]]]:
    """(top-level key, its lines with the comments just above it); the first block has no key."""
    blocks: list[tuple[str, list[str]]] = [("", [])]
    for line in text.splitlines(keepends=True):
        if not line.endswith("\n"):
            line += "\n"
        if found := _TOP.match(line):
            above = blocks[-1][1]
            start = len(above)
            while len(blocks) > 1 and start > 0 and above[start - 1].startswith("#"):
                start -= 1
            blocks[-1] = (blocks[-1][0], above[:start])
            blocks.append((found.group(2), [*above[start:], line]))
        else:
            blocks[-1][1].append(line)
    return blocks
