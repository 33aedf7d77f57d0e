"""LiDAR `profile` against `empirical`: the same draws, so beam by beam, and the heights of drawn stands."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.runtime.assembly import assemble
from swath.runtime.job import run_unrecorded
from swath.scenario.scenario import load_scenario, parse_scenario
from swath.sensing.echo import Weather
from tests.levels.limits import make
from tests.sensing.replay_rig import drive, wasserstein

TEXT = """
format: swath scenario 2
name: profile-rig
seed: {seed}
run: {{distance_m: 12, max_duration_s: 20}}
field:
  terrain: {terrain}
  stand: {{level: uniform, crop: {crop}, stems_per_m2: {stems}, height_factor: {height}}}
  edge: {edge}
machines:
  combine:
    lidar: {{sector_deg: [-50, 50], noise: none}}
"""
PLANE = "{level: plane, slope_percent: 2.0}"
ROUGH = "{level: formula, slope_percent: 3.0}"
STRAIGHT = "{shape: straight, stubble_height_m: 0.2}"


def assembled(**given):
    """A world whose scanner is of level `plants`."""
    about = {"seed": 3, "terrain": PLANE, "crop": "wheat", "stems": 400, "height": 1.0, "edge": STRAIGHT}
    return assemble(parse_scenario(TEXT.format(**{**about, **given})))


def seen(level, **given):
    """Ranges of a drive along the edge, heights of the echoes, distances from the edge [m]."""
    world = assembled(**given)
    plants = world.leader.parts["lidar"]
    lidar = make("lidar", level, plants.setup, sector_deg=(-50, 50), noise="none")
    outs, _ = drive(lidar, world, speed=2.0, length=6.0)
    ranges = np.array([out["scan"].ranges[:, 0] for out in outs])
    points = np.concatenate([out["truth"].points[:, 0] for out in outs])
    points = points[np.isfinite(points).all(axis=1)]
    ground = world.field.terrain.height(points[:, 0], points[:, 1])
    inside = world.field.first_edge.signed_distance(points[:, 0], points[:, 1])
    return ranges, points[:, 2] - ground, inside


def test_beams_are_those_of_empirical_on_a_plane():
    (profile, *_), (empirical, *_) = (seen(level) for level in ("profile", "empirical"))
    assert (np.isnan(profile) == np.isnan(empirical)).mean() > 0.9999
    off = np.abs(profile - empirical)[np.isfinite(profile) & np.isfinite(empirical)]
    assert np.quantile(off, 0.95) < 2e-3
    assert np.quantile(off, 0.99) < 0.1


STANDS = [
    {"seed": 14, "crop": "rye", "stems": 250, "terrain": ROUGH},
    {"seed": 15, "stems": 450, "edge": "{shape: curve, run_in_m: 3, radius_m: 30, angle_deg: 40}"},
    {
        "seed": 16,
        "stems": 400,
        "edge": "{shape: straight, teeth: {amplitude_m: 0.4, wavelength_m: 5},"
        " gaps: [{start_m: 14, end_m: 17, depth_m: 2}]}",
    },
]


@pytest.mark.parametrize("stand", STANDS, ids=[str(s["seed"]) for s in STANDS])
def test_heights_of_drawn_stands(stand):
    (_, z, inside), (_, its_z, its_inside) = (seen(level, **stand) for level in ("profile", "empirical"))
    for low, high in ((1.0, 30.0), (-0.6, 0.6), (-30.0, -1.0)):  # crop, edge, stubble
        own, its = (h[(d > low) & (d < high)] for h, d in ((z, inside), (its_z, its_inside)))
        assert wasserstein(own, its) < 0.015


def judged_edge(seed, *levels):
    """Metrics of the edge of a run in barley, 10 m of it after settling."""
    sets = [f"seed={seed}", "run.distance_m=20", "field.stand.crop=barley", "combine.edge=otsu",
            "combine.lidar.sector_deg=[-30, 30]", "combine.motion.level=kinematic",
            "combine.motion.start_speed_kmh=7", *levels]  # fmt: skip
    return run_unrecorded(load_scenario("straight", sets=sets))


def test_the_edge_that_steers_a_machine_is_that_of_empirical():
    """Over seeds 1 to 8 the bias differs by up to 1 cm in a run, and by less than 0.1 cm in the mean."""
    own = judged_edge(8, "combine.lidar.level=profile", "combine.header.level=profile")
    its = judged_edge(8, "combine.lidar.level=empirical")
    for name in ("edge_rmse_m", "edge_bias_m"):
        assert own[name] == pytest.approx(its[name], abs=0.015)
    assert min(own["edge_judged_share"], its["edge_judged_share"]) > 0.9


def test_weather_is_refused_and_sent_to_empirical():
    world = assembled()
    with pytest.raises(InputError, match="no weather; the level empirical"):
        make("lidar", "profile", world.leader.parts["lidar"].setup, weather=Weather(rain_mm_h=5.0))


def test_other_rays_are_refused_beside_it():
    world = assembled()
    plants = world.leader.parts["lidar"]
    make("lidar", "profile", plants.setup)
    with pytest.raises(InputError, match="no sensor that casts rays beside it"):
        drive(plants, world, length=0.1)
