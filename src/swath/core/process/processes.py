"""How another Python is started, in one place: it looks for modules where they are installed, not in the
working folder, where somebody may have put a `numpy.py`.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

SAFE_PATH = "PYTHONSAFEPATH"
OURS = "swath"  # its value, of processes that are started inside `safe_path`


@contextmanager
def in_environment(**values: str) -> Iterator[None]:
    """Variables of the environment have these values inside the block."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


def safe_path() -> Any:
    """A block for libraries that start a Python themselves: no working folder on its path."""
    return in_environment(**{SAFE_PATH: os.environ.get(SAFE_PATH) or OURS})


def forget_safe_path() -> None:
    """In a process that was started so: what somebody else's code starts has the user's own environment."""
    if os.environ.get(SAFE_PATH) == OURS:
        del os.environ[SAFE_PATH]


def skip_folder_settings() -> None:
    """Import matplotlib in a folder of our own: it reads the `matplotlibrc` of the working folder."""
    if os.path.lexists("matplotlibrc"):
        here = os.getcwd()
        os.chdir(os.path.dirname(__file__))
        try:
            import matplotlib  # noqa: F401
        finally:
            os.chdir(here)


def start_module(name: str, *words: str, **options: Any) -> "subprocess.Popen[bytes]":
    """Start `python -m NAME WORDS`, which finds what this process finds. options: of Popen."""
    import swath

    root = os.path.dirname(os.path.dirname(swath.__file__))
    path = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.Popen([sys.executable, "-P", "-m", name, *words], env=environment, **options)
