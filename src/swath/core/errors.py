"""Errors a user can act on: what is wrong, where, and what was expected."""

from pathlib import Path
from typing import Any


class SwathError(Exception):
    """Base of every error that swath raises on purpose: printed as one line, exit code 2."""


class InputError(SwathError):
    """A value from outside that cannot be used.

    Reads `key = value: expected what (file:line)`, one line; parts that are unknown are left out.
    """

    def __init__(
        self,
        key: str,
        value: Any = None,
        expected: str = "",
        *,
        file: Path | str | None = None,
        line: int | None = None,
    ) -> None:
        self.key, self.value, self.expected, self.file, self.line = key, value, expected, file, line
        text = key if value is None else f"{key} = {_short(value)}"
        if expected:
            text += f": {expected}"
        if file is not None:
            text += f" ({file}:{line})" if line is not None else f" ({file})"
        super().__init__("".join(c if c.isprintable() else ascii(c)[1:-1] for c in text))


class WiringError(SwathError):
    """Two ports that do not fit, a port without a source, or a source that does not exist."""


class MissingExtra(SwathError):
    """An optional dependency that is not installed."""

    def __init__(self, extra: str, what: str = "this") -> None:
        super().__init__(f"{what} needs an optional part: pip install 'swath[{extra}]'")


def _short(value: Any) -> str:
    """At most a line of a value; a path keeps its end, which is what tells it from others."""
    text = str(value) if isinstance(value, str | Path) else repr(value)
    limit = 300 if "/" in text and " " not in text else 80
    if len(text) <= limit:
        return text
    return "..." + text[3 - limit :] if limit > 80 else text[: limit - 3] + "..."
