"""A bar over the runs of a function test."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def progress(count: int) -> Iterator[Callable[[dict[str, Any]], None]]:
    """A bar over the runs on a terminal; failures are counted in it."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    failed = 0
    with Progress(console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(f"{count} runs", total=count)

        def done(result: dict[str, Any]) -> None:
            nonlocal failed
            failed += result["verdict"] != "pass"
            bar.update(task, advance=1, description=f"{count} runs, {failed} did not pass")

        yield done
