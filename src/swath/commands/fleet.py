"""`swath fleet`: whole fields, at the levels of jobs and on granted ground."""

from typing import Any

from swath.fleet import command as granted
from swath.tools.fleet import command as jobs


def add(parsers: Any) -> None:
    """Add the command and its verbs."""
    jobs.add(parsers, dict.fromkeys(granted.LEVELS, granted.run_job))
