"""What a program that is no Python needs around it, so that an exported FMU finds a Python with swath."""

import os
import shlex
import sys
import sysconfig
from pathlib import Path

import swath

NAMES = ("libpython3.so", "libpython3.dylib")


def importer_environment() -> dict[str, str]:
    """Environment of an importer on this machine, by name, for this Python; empty where it has no library.

    The binaries in the FMU are bound to Python's stable interface and start none themselves.
    """
    base = Path(sys.base_prefix)
    packages = [
        str(Path(swath.__file__).parents[1]),
        *(sysconfig.get_path(k) for k in ("purelib", "platlib")),
    ]
    found = {"PYTHONHOME": str(base), "PYTHONPATH": os.pathsep.join(dict.fromkeys(packages))}
    if sys.platform == "win32":
        return {"PATH": str(base), **found}
    folders = dict.fromkeys((sysconfig.get_config_var("LIBDIR"), base / "lib"))
    libraries = (Path(folder) / name for folder in folders if folder for name in NAMES)
    library = next((path for path in libraries if path.is_file()), None)
    return {} if library is None else {"LD_PRELOAD": str(library), **found}


def importer_line() -> str:
    """What to type before a program on this machine, one line."""
    found = importer_environment()
    if not found:
        return "this Python has no shared library (libpython3.so): only Python programs here can run the FMU"
    if sys.platform == "win32":
        return " & ".join(f"set {k}={v}" + (";%PATH%" if k == "PATH" else "") for k, v in found.items())
    return " ".join(f"{key}={shlex.quote(value)}" for key, value in found.items()) + " PROGRAM"


def elsewhere_line() -> str:
    """What such a program needs on a machine of the other system that the FMU has binaries for, one line."""
    if sys.platform == "win32":
        return (
            "on Linux: libpython3.so as LD_PRELOAD, its folder as PYTHONHOME, swath's packages in PYTHONPATH"
        )
    where = "the folder of python3.dll in PATH and as PYTHONHOME"
    return f"on Windows (not tried): {where}, swath's packages in PYTHONPATH"
