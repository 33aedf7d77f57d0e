"""What the commands that do runs have in common: a bar over the runs, and where they are done."""

import os
import sys
from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from swath.terminal.options import option

LINES = 10  # of progress where there is no terminal


def add_engine(parser: ArgumentParser) -> None:
    """`--workers N` and `--cluster WHERE`: where runs are done, see `engine`."""
    option(parser, "--workers N", "processes (default: cores)", os.cpu_count() or 1)
    option(parser, "--cluster WHERE", "run on dask workers: local, slurm, or the address of a scheduler", "")


@contextmanager
def progress(count: int, bound: str = "") -> Iterator[Callable[[dict[str, Any]], None]]:
    """A bar over the runs on stderr, lines where that is no terminal; failures are counted in it.

    bound: what to say before the count, `at most `
    """
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    failed = ended = 0
    with Progress(console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(f"{bound}{count} runs", total=count)

        def done(result: dict[str, Any]) -> None:
            nonlocal failed, ended
            ended += 1
            failed += result["verdict"] in ("fail", "error")
            bar.update(task, advance=1, description=f"{bound}{count} runs, {failed} did not pass")
            if not console.is_terminal and ended * LINES // count > (ended - 1) * LINES // count:
                print(f"{ended} of {bound}{count} runs, {failed} did not pass", file=sys.stderr, flush=True)

        yield done


@contextmanager
def engine(cluster: str, workers: int) -> Iterator[Any]:
    """A client of dask, None for processes of this machine; a stop says what is kept."""
    try:
        if not cluster:
            yield None
            return
        from swath.tools.function_test.cluster import cluster_client

        with cluster_client(cluster, max(1, workers)) as client:
            yield client
    except KeyboardInterrupt as error:
        raise type(error)("stopped; what is done is kept, the same command goes on") from None
