"""A progress bar on stderr for commands that take their time."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SOON = 2.0  # s after which a bar appears


@contextmanager
def progress_bar(name: str) -> Iterator[Callable[[float, float], None]]:
    """A bar that is given (done, total); it shows nothing where stderr is no terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done, total: None
        return
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task(name, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def steps(total: int, *, shown: bool = True) -> Iterator[Callable[[str], None]]:
    """A bar on stderr that moves with each step named to it, from 2 s on."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<28}"), BarColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    bar = Progress(*columns, console=console, transient=True, disable=not (shown and console.is_terminal))
    task = bar.add_task("starting", total=total)
    timer = threading.Timer(SOON, bar.start)
    timer.daemon = True

    def step(name: str) -> None:
        bar.update(task, description=name)
        bar.advance(task)

    timer.start()
    try:
        yield step
    finally:
        timer.cancel()
        timer.join()
        if bar.live.is_started:  # else it prints an empty line
            bar.stop()
