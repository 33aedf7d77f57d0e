"""swath: a simulator for harvest machines that act on what they sense.

import swath

result = swath.run("straight", sets={"combine.speed.speed_kmh": 5})
result.summary["lateral_rms_m"]

`run`, `scan`, `load_scenario` and `read_field` are in swath/api.py, which is imported when one is used.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"
_OFFERED = ("load_scenario", "read_field", "run", "scan")


def __getattr__(name: str) -> Any:
    if name in _OFFERED:
        return getattr(import_module("swath.api"), name)
    raise AttributeError(f"module 'swath' has no attribute {name!r}; it offers {', '.join(_OFFERED)}")


def __dir__() -> list[str]:
    return [*globals(), *_OFFERED]
