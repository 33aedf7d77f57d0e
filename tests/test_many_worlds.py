"""The example of a detector for many worlds at once finds the edge, and each world is what it is alone."""

import importlib.util
from pathlib import Path

import swath

EXAMPLE = Path(__file__).parents[1] / "examples" / "many_worlds.py"


def example():
    spec = importlib.util.spec_from_file_location("many_worlds", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_it_steers_along_the_edge_in_every_world():
    sets = {
        "combine.lidar.level": "profile",
        "combine.header.level": "profile",
        "combine.motion": {"level": "kinematic", "start_speed_kmh": 7},
        "combine.edge": example().Split,
        "run.distance_m": 14,
    }
    runs = list(swath.worlds("straight", n=2, vary={"combine.speed.speed_kmh": (5.0, 8.0)}, sets=sets))
    assert max(run.summary["lateral_rms_m"] for run in runs) < 0.1
    assert max(run.summary["mass_balance_error"] for run in runs) < 1e-9
    (alone,) = swath.batch([runs[1].entry])
    assert alone.summary["digest"] == runs[1].summary["digest"]
