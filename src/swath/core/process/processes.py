"""How another Python is started, in one place: it looks for modules where they are installed, not in the
working folder, where somebody may have put a `numpy.py`.
"""

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from subprocess import Popen

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


def start_module(
    name: str, *words: str, environment: Mapping[str, str] | None = None, **options: Any
) -> "Popen[bytes]":
    """Start `python -m NAME WORDS`, which finds what this process finds.

    environment: variables besides those of this process; options: of Popen
    """
    from subprocess import Popen

    import swath

    root = os.path.dirname(os.path.dirname(swath.__file__))
    python, installed = interpreter(), list[str]()
    if python != sys.executable:  # it may not find by itself what the program around this one has
        installed = [path for path in sys.path if os.path.basename(path).endswith("-packages")]
    path = os.pathsep.join([root, *installed, *filter(None, [os.environ.get("PYTHONPATH")])])
    variables = {**os.environ, **(environment or {}), "PYTHONPATH": path}
    return Popen([python, "-P", "-m", name, *words], env=variables, **options)


def interpreter() -> str:
    """The Python of this process; in a program that has Python inside, the one that it takes modules from.

    FileNotFoundError where none is there.
    """
    version, suffix = f"{sys.version_info[0]}.{sys.version_info[1]}", ".exe" if os.name == "nt" else ""
    names = [f"python{version}{suffix}", f"python3{suffix}", f"python{suffix}"]
    if os.path.basename(sys.executable or "").lower().startswith("python"):
        return sys.executable
    for prefix in (sys.prefix, sys.exec_prefix, sys.base_prefix):
        for folder in (prefix, os.path.join(prefix, "Scripts" if os.name == "nt" else "bin")):
            for name in names:
                if os.access(path := os.path.join(folder, name), os.X_OK) and os.path.isfile(path):
                    return path
    raise FileNotFoundError(f"expected {names[0]} in {sys.prefix}")
