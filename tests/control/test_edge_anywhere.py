"""The edge is told alike wherever the field lies, and by other scanners, rates and mountings."""

import json
from functools import partial

import numpy as np
import pytest

from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario
from swath.signals import CropEdge, MachineState
from tests.control.edge_drive import SPEED, along
from tests.control.synthetic_edge import mounting
from tests.control.test_likelihood_ratio import detector

FAR = 99_000.0  # m; keys end at 100 km


def told(turn, place):
    """Every edge of 12 m past a turned field: offset [m], heading [rad], deviation [m], metres inside."""
    sets = {
        "run.distance_m": 12.0,
        "field.terrain.slope_azimuth_deg": 90.0 - turn,
        "field.stand.row_azimuth_deg": -turn,
        "field.edge.heading_deg": 90.0 + turn,
        "field.edge.x_m": place[0],
        "field.edge.y_m": place[1],
        "combine.lidar.level": "empirical",
    }
    world = assemble(load_scenario("straight", sets=[f"{k}={json.dumps(v)}" for k, v in sets.items()]))
    poses, edges = {}, []

    def watch(slot, t, outputs):
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                poses[t] = signal.pose
            elif isinstance(signal, CropEdge) and signal.is_found and signal.t in poses:
                x, y, _ = poses[signal.t].apply([signal.reference_x, signal.offset, 0.0])
                inside = float(world.leader.edge.signed_distance(np.array([x]), np.array([y]))[0])
                edges.append((signal.offset, signal.heading, signal.offset_sd, inside))

    drive(world, [watch])
    return np.array(edges)


def test_a_turned_and_a_far_field():
    """Turned with all in it, and far off: other stems and clods are met, and the edge is told as well."""
    offset, heading, sd, inside = told(-60.0, (-FAR, FAR)).T
    late = slice(-50, None)
    assert len(offset) > 140
    assert np.sqrt(np.mean(inside[late] ** 2)) < 0.035
    assert np.abs(heading[late]).max() < 0.03
    assert sd[late].max() < 0.15


drive_past = partial(along, detector, metres=14.0)


@pytest.mark.parametrize("hz", [12.5, 25.0, 50.0])
def test_rates(hz):
    edges, error = drive_past(hz=hz)
    late = round(8.0 / SPEED * hz)
    assert all(e.is_found and e.confidence > 0.9 for e in edges[late:])
    assert np.sqrt(np.mean(error[late:] ** 2)) < 0.04


@pytest.mark.parametrize("step", [0.25, 0.5, 1.0])
def test_steps_of_the_angle(step):
    edges, error = drive_past(scanner={"step_deg": step})
    assert all(e.is_found and e.confidence > 0.9 for e in edges[100:])
    assert np.sqrt(np.mean(error[100:] ** 2)) < 0.04


@pytest.mark.parametrize(("height", "ahead"), [(1.8, 6.0), (2.4, 8.0), (3.6, 8.0)])
def test_mountings(height, ahead):
    edges, error = drive_past(mounted=mounting(height=height, ahead=ahead))
    assert all(e.is_found and e.confidence > 0.9 for e in edges[100:])
    assert np.sqrt(np.mean(error[100:] ** 2)) < 0.04


def test_few_rays_from_afar_show_no_ramp_for_sure():
    """From 3.6 m, 11 m ahead, few rays cross the wall of the crop: what seems a ramp may be chance."""
    edges, error = drive_past(mounted=mounting(height=3.6, ahead=11.0), metres=20.0)
    sd = np.array([e.offset_sd for e in edges])
    assert np.mean(np.abs(error[100:]) < 1.96 * sd[100:]) > 0.85
