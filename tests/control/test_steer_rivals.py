"""Pure pursuit and Stanley beside the preview law, and what all three know of crab and understeer."""

import numpy as np
import pytest

from swath.control.inclination import CRAB
from swath.control.steer.plant_model import ActuatorModel
from swath.control.steer.preview import Params, Preview
from swath.control.steer.pure_pursuit import PurePursuit
from swath.control.steer.stanley import Stanley
from swath.core.random import Stream
from swath.runtime.job import run_unrecorded
from swath.scenario.scenario import load_scenario
from swath.signals import CropEdge, Inertial, Odometry
from tests.control.closed_loop import Course, Loop, setup_of

PERIOD, SPEED = 20_000_000, 2.0


@pytest.mark.parametrize("law", [PurePursuit, Stanley])
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_step_of_half_a_metre_dies_out(law, side):
    rows = Loop(law=law, side=side, start_error=0.5, noise=0.0, heading_noise=0.0).run(30)
    assert np.abs(rows[rows[:, 0] > 18.0, 1]).max() < 0.05
    assert rows[:, 1].min() > -0.15


@pytest.mark.parametrize("law", [PurePursuit, Stanley])
def test_the_line_on_the_bench_is_as_docs_reference_levels_has_it(law):
    """0.4 cm RMS with an edge known to 3 cm, at most 1 cm."""
    runs = [Loop(law=law, seed=seed).run(100) for seed in range(1, 9)]
    found = [np.sqrt(np.mean(rows[rows[:, 0] > 10.0, 1] ** 2)) for rows in runs]
    assert np.mean(found) == pytest.approx(0.004, abs=0.001)
    assert max(found) < 0.01


@pytest.mark.parametrize(("law", "most"), [("pure_pursuit", 0.015), ("stanley", 0.013)])
def test_the_line_of_straight_on_the_true_edge(law, most):
    sets = ["run.distance_m=60", "combine.motion.level=kinematic", f"combine.steer.level={law}"]
    found = run_unrecorded(load_scenario("straight", sets=[*sets, "combine.edge=truth", "combine.lidar=off"]))
    assert 0.005 < found["lateral_rms_m"] < most


def test_pure_pursuit_cuts_bends_and_stanley_does_not():
    late = {}
    for law in (PurePursuit, Stanley):
        rows = Loop(law=law, course=Course(40.0, 20.0), noise=0.0, heading_noise=0.0).run(70)
        late[law] = np.abs(rows[rows[:, 0] > 40.0, 1].mean())
    assert late[Stanley] < 0.05
    assert late[PurePursuit] == pytest.approx(0.27, abs=0.05)  # inward


def test_understeer_is_learnt_and_0_is_never():
    for distance, learnt in ((6.0, 0.005), (0.0, 0.0)):
        model = ActuatorModel(0.15, 0.2, 0.02, distance)
        for _ in range(2000):
            model.push(0.05, 0.045, SPEED * 0.02)
        assert model.deficit == pytest.approx(learnt, abs=1e-6)


@pytest.mark.parametrize("rise", [0.1, -0.1])
def test_crab_is_expected_as_soon_as_the_slope_is_felt(rise):
    """On ground that rises to the left the machine slips to the right, so the law heads to the left."""
    setup = setup_of(period=0.02)
    force = 9.81 / np.hypot(1.0, rise)
    felt = Inertial(PERIOD, 0.0, 0.0, 0.0, 0.0, rise * force, force)
    edge = CropEdge(PERIOD, setup.machine.header_end("left")[1] - 0.1, 0.0, 0.0, 4.0, 1.0, 0.8, 0.1)
    wanted = {}
    for samples in ((felt,), None):
        law = Preview(Params(engage_s=0.0, rate_deg_s=90.0), setup)
        law.reset(Stream(1, "steer"))
        inputs = {"edge": edge, "odometry": Odometry(0, SPEED, 0.0, 0.0), "inertial": samples}
        wanted[samples] = law.step(0, PERIOD, inputs)["command"].curvature
    more = wanted[(felt,)] - wanted[None]
    a = setup.machine.header_end("left")[0]
    assert np.sign(more) == np.sign(rise)
    assert 0.8 < more * a / (CRAB * rise) < 2.5  # by the angle, and by what it drifts until it takes hold
