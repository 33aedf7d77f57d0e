"""swath: a simulator for harvest machines that act on what they sense.

import swath

result = swath.run("straight", sets={"combine.speed.speed_kmh": 5})
result.summary["lateral_rms_m"]

`run`, `batch`, `worlds`, `branch`, `scan`, `detect`, `tune`, `load_scenario` and `read_field` are in
swath/api.py, imported when one of them is used; so are `Env` and `VectorEnv`, a scenario as an environment of
gymnasium, made by id, too: `gymnasium.make("swath/straight")`.
"""

from importlib import import_module
from typing import Any

from swath import gym_ids

__version__ = "0.3.0.dev0"
_OFFERED = {
    "batch": "swath.api",
    "branch": "swath.api",
    "detect": "swath.api",
    "load_scenario": "swath.api",
    "read_field": "swath.api",
    "run": "swath.api",
    "scan": "swath.api",
    "tune": "swath.api",
    "worlds": "swath.api",
    "Env": "swath.environment",
    "VectorEnv": "swath.vector_environment",
}


def __getattr__(name: str) -> Any:
    if name in _OFFERED:
        return getattr(import_module(_OFFERED[name]), name)
    raise AttributeError(f"module 'swath' has no attribute {name!r}; it offers {', '.join(_OFFERED)}")


def __dir__() -> list[str]:
    return [*globals(), *_OFFERED]


gym_ids.offer()
