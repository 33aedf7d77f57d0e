"""summary.json: what a run came to."""

import json
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from swath.judge.metrics import evaluate, json_safe
from swath.rays.device import ray_device

PARTS = ("swath", "numpy", "warp-lang")


def make_summary(
    about: Mapping[str, Any],
    metrics: Mapping[str, Any],
    limits: Mapping[str, Mapping[str, float]],
    *,
    simulated_s: float,
    wall_s: float,
    ray_count: int,
    digest: str,
    incomplete: bool,
    cost: Mapping[str, tuple[float, int]],
) -> dict[str, Any]:
    """The content of summary.json, JSON-safe.

    about: `name`, `summary`, `seed`, `machine`, `device` ... of the run, first in the file
    metrics: a referee's; limits: metric -> {min, max}; cost: slot -> (wall time [s], steps)
    """
    found = {
        **metrics,
        "real_time_factor": simulated_s / wall_s if wall_s > 0 else float("nan"),
        "ray_count": ray_count,
        "digest": digest,
        "incomplete": incomplete,
    }
    return json_safe(  # type: ignore[no-any-return]
        {
            **about,
            **found,
            "expect": evaluate(limits, found),
            "simulated_s": simulated_s,
            "wall_s": wall_s,
            "device": ray_device(),
            "versions": versions(),
            "cost": {slot: {"seconds": s, "steps": n} for slot, (s, n) in cost.items()},
        }
    )


def versions() -> dict[str, str]:
    """Versions of what results depend on."""
    found = {}
    for part in PARTS:
        try:
            found[part.removesuffix("-lang")] = version(part)
        except PackageNotFoundError:
            continue
    return {
        **found,
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
    }


def write_summary(folder: Path, summary: Mapping[str, Any]) -> Path:
    """Write `summary.json` into the run folder in one go and return its path."""
    path = folder / "summary.json"
    part = path.with_suffix(".json.part")
    part.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    part.replace(path)
    return path
