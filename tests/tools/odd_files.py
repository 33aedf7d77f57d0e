"""A small ODD with its binding, written into a folder, and results that a closed form makes."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from swath.core.random import Stream
from swath.tools.function_test.odd.binding import Odd, read_odd
from swath.tools.function_test.odd.campaign import Campaign, Conducted, conduct, revision_of
from swath.tools.function_test.odd.coverage import coverage_of
from swath.tools.function_test.one_run import no_result
from swath.tools.function_test.plan import PlannedRun
from tests.tools.fake_work import here

OPENODD = """
TAXONOMY:
  terrain:
    side_slope: float slope
    slope_along: float slope
  weather:
    rain: [no_rain, drizzle, showers, downpour]
    fog: boolean
  process:
    speed: float velocity
    density: float areal_density
ODD:
  harvest:
    METADATA: {version: "1.2.0"}
    INCLUDE_AND:
      terrain.side_slope: "[-16 .. 16] %"
      terrain.slope_along: "[-20 .. 20] %"
      weather.rain: [no_rain, drizzle, showers]
      weather.fog: false
      process.speed: "[0 .. 10] km/h"
      process.density: "[50 .. 700] 1/m2"
    EXCLUDE_OR:
      wet_slope: true
  wet_slope:
    INCLUDE_AND:
      weather.rain: [showers]
      terrain.side_slope: "> 8 %"
"""
BINDING = """
format: swath odd 1
openodd: [small.openodd.yaml]
objective: keeps its line
source: made for a test
requirement: R-7
scenario: straight
set:
  run.distance_m: 12
  combine.edge: truth
  combine.motion: kinematic
  combine.lidar: "off"
  field.terrain.slope_azimuth_deg: 90
expect: {distance_m: {min: 11.5}}
attributes:
  terrain.side_slope:
    {key: field.terrain.slope_percent, unit: "%", buckets: [-16, -8, 0, 8, 16], met: slope_across_percent}
  terrain.slope_along: {unit: "%", met: slope_along_percent}
  weather.rain:
    values:
      no_rain: {field.stand.lean_deg: 0}
      drizzle: {field.stand.lean_deg: 5}
      showers: {field.stand.lean_deg: 10}
      downpour: {field.stand.lean_deg: 15}
  weather.fog: {not_simulated: no drops}
  process.speed: {key: combine.speed.speed_kmh, unit: km/h, buckets: [2, 4, 6, 8, 10], exposure: [1, 2, 2, 1]}
  process.density:
    {key: field.stand.stems_per_m2, unit: 1/m2, buckets: [50, 150, 300, 500, 700], met: stems_per_m2}
"""
SLOPE, SPEED, DENSITY, RAIN = "terrain.side_slope", "process.speed", "process.density", "weather.rain"


def write_odd(folder: Path, binding: str = BINDING, openodd: str = OPENODD) -> Path:
    """The files; returns the binding's."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "small.openodd.yaml").write_text(openodd, encoding="utf-8")
    file = folder / "small.odd.yaml"
    file.write_text(binding, encoding="utf-8")
    return file


def small_odd(folder: Path, binding: str = BINDING, openodd: str = OPENODD) -> Odd:
    """The same, read."""
    return read_odd(write_odd(folder, binding, openodd))


def result_of(run: PlannedRun, fails: bool) -> dict[str, Any]:
    """A run of 12 m at 2 m/s that met what was set."""
    at = np.arange(12.0)
    alike = np.ones_like(at)
    met = {"t_s": at / 2.0, "distance_m": at, "slope_along_percent": 0.0 * at,
           "slope_across_percent": float(run.point[SLOPE]) * alike,
           "stems_per_m2": float(run.point[DENSITY]) * alike}  # fmt: skip
    made = {"digest": "0", "met": {k: v.tolist() for k, v in met.items()}}
    return {**no_result(run, ""), **told(fails), **made}


def told(fails: bool) -> dict[str, str]:
    """What a result says of it."""
    return {"verdict": "fail", "reason": "made"} if fails else {"verdict": "pass", "reason": ""}


def conducted(monkeypatch: Any, folder: Path, odd: Odd, runs: int, seed: int,
              fails: Callable[[PlannedRun, float], bool]) -> Conducted:  # fmt: skip
    """A campaign whose runs a closed form makes. fails: of a run and a number of [0, 1) that belongs to it"""

    def work(run: PlannedRun) -> dict[str, Any]:
        return result_of(run, fails(run, float(Stream(seed, f"closed form {run.seed}").at(0).random())))

    monkeypatch.setattr("swath.tools.function_test.session.run_all", here(work))
    campaign = Campaign(odd.name, revision_of(odd), (runs,), seed)
    return conduct(folder, campaign, odd, 1, lambda result: None)


def failing(made: Conducted, runs: int, seed: int, fails: Callable[[Any, float], bool]) -> Conducted:
    """The first runs of a campaign with other verdicts, in its folder; fails as of `conducted`."""
    draws = np.random.default_rng(seed).random(runs).tolist()
    results = [
        {**result, **told(fails(SimpleNamespace(point=result["point"]), draw))}
        for result, draw in zip(made.results[:runs], draws, strict=True)
    ]
    campaign = replace(made.campaign, budgets=(runs,))
    return replace(made, campaign=campaign, results=results, coverage=coverage_of(made.odd, results))
