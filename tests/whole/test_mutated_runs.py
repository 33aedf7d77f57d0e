"""Mutated scenarios: either a valid short run or one clear error, never another exception."""

import copy

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swath.core.errors import SwathError
from swath.documents.yaml_document import dump, parse
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from swath.signals import MachineState
from tests.whole.small import TEXT

BASE = parse(TEXT).data
SHORT = ["run.max_duration_s=0.09", "combine.lidar.sub_rays=1", "combine.lidar.step_deg=4"]


def paths(node, here=()):
    yield here
    if isinstance(node, dict):
        for key, child in node.items():
            yield from paths(child, (*here, key))


PATHS = [p for p in paths(BASE) if p]
VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 10**9),
    st.floats(),
    st.sampled_from(["", "plane", "single_track", "kinematic", "truth", "otsu", "7 km/h", "off", "ideal"]),
    st.lists(st.floats(-200, 200), max_size=3),
    st.dictionaries(st.sampled_from(["level", "x_m", "rate_hz"]), st.integers(-1, 100), max_size=2),
)
EXTRA = st.sampled_from(
    [
        ("field", "terrain", {"level": "formula", "slope_percent": 40.0}),
        ("field", "stand", {"level": "uniform", "lean_deg": 70.0, "row_azimuth_deg": 33.0}),
        ("field", "edge", {"shape": "curve", "radius_m": 3.0, "angle_deg": 120.0}),
        ("field", "edge", {"shape": "polyline", "points_m": [[0, 0], [0, 1e-9], [5, 60]]}),
        ("combine", "header", {"cutting_height_m": 1.9}),
        ("combine", "motion", {"level": "kinematic", "start_speed_kmh": 30}),
        ("combine", "start", {"x_m": 3.0, "y_m": -4.0, "heading_deg": 200.0}),
        ("combine", "lidar", {"sensor": "velodyne-vlp16", "mount": {"at": "axle", "z_m": 0.2}}),
        ("combine", "edge", "truth"),
    ]
)


@pytest.mark.draws
@settings(max_examples=40, suppress_health_check=list(HealthCheck), derandomize=True)
@given(st.lists(st.tuples(st.sampled_from(PATHS), VALUES), max_size=2), st.lists(EXTRA, max_size=2))
def test_a_valid_run_or_one_error(changes, extras):
    data = copy.deepcopy(BASE)
    for section, key, value in extras:
        home = data if section in data else data["machines"]
        home[section][key] = value
    for path, value in changes:
        node = data
        for key in path[:-1]:
            node = node.get(key) if isinstance(node, dict) else None
        if isinstance(node, dict):
            node[path[-1]] = value
    try:
        world = assemble(parse_scenario(dump(data), sets=SHORT))
        drive(world)
    except SwathError as error:
        refusal = str(error)
    else:
        refusal = None
    if refusal is not None:
        assert refusal
        assert "\n" not in refusal
        return
    name = world.leader.name
    state = world.graph.latest(f"{name}.motion", "state")
    assert state is None or isinstance(state, MachineState)
    if state is not None:
        assert np.all(np.isfinite(state.pose.position))
