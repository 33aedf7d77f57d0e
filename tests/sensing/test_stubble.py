"""LiDAR level `empirical` over stubble: heights of `plants`, no ghosts; what it cannot see is said."""

import numpy as np
import pytest
from benchmarks.stubble import both_levels, heights, make_site, over_stubble

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.sensing.lidar import empirical
from swath.sensing.tables import load_table
from tests.sensing.test_empirical import scan, site

BOUND = 0.015  # [m]


@pytest.mark.parametrize(
    ("crop", "density", "sensor", "depression"),
    [
        (
            "wheat",
            100,
            "sick-lms111",
            16.0,
        ),  # thin: beams that are drawn to crop get to the ground between it
        ("wheat", 430, "sick-lms511-hr", 12.0),
        ("barley", 550, "sick-lms511-hr", 14.0),
        ("rye", 220, "sick-lms511-hr", 9.0),
        ("rape", 25, "sick-lms511-hr", 14.0),
    ],
)
def test_mean_height_over_stubble_is_that_of_plants(crop, density, sensor, depression):
    setup = make_site(crop, density, 3, row_m=0.125, cut_m=0.16)
    mean = {}
    for level, lidar in both_levels(setup, sensor, 15.0, 1.5).items():
        seen = heights(lidar, over_stubble(depression, 30, 3), 3)
        mean[level] = np.nanmean(seen)
        assert np.nanmax(seen) < 0.16 * 1.12 + 0.02  # nothing stands in the air
    assert mean["empirical"] == pytest.approx(mean["plants"], abs=BOUND)


def test_over_a_gap_in_thin_crop_the_ground_is_the_ground():
    """Beams that pass a little crop and then find bare soil: 0 to twice the table's lift, no more."""
    gap = "{start_m: 10, end_m: 90, depth_m: 6}"
    setup = site(80, f"field.edge.gaps=[{gap}]", "field.edge.stubble_height_m=0")
    lidar = both_levels(setup, "sick-lms111", 10.0, 1.0)["empirical"]
    poses = [Pose.from_euler((15.0, 20.0 + 2.0 * k, 3.0), 0.0, np.radians(15.0), np.pi) for k in range(20)]
    seen = heights(lidar, poses, 1)
    in_gap = 15.0 - (3.0 - seen) / np.tan(np.radians(15.0)) < 5.7  # crop ends at x = 6
    assert in_gap.mean() > 0.5
    assert seen[in_gap].max() < 2.0 * lidar.table.standing.ground_lift.max()


@pytest.mark.parametrize(
    ("sets", "said"),
    [
        (["field.stand.wind={speed_m_s: 8, azimuth_deg: 270}"], "wind"),
        (["field.stand.weeds={plants_per_m2: 5}"], "weeds"),
        (["field.stand.lean_deg=30"], "leans by more than 20 deg"),
    ],
)
def test_what_the_level_cannot_see_is_said_in_one_line(sets, said):
    setup = site(400, *sets)
    lidar = empirical.EmpiricalLidar(empirical.Params(sector_deg=(-5.0, 5.0), step_deg=1.0), setup)
    lidar.reset(Stream(1, "lidar"))
    for k in range(2):
        scan(lidar, Pose.from_euler((25.0, 50.0, 3.0), 0.0, 0.5, 0.0), 10**9 + k)
    [note] = lidar.notes
    assert said in note
    assert "\n" not in note


def test_stubble_outside_the_table_is_said():
    setup = site(400, "field.edge.stubble_height_m=0.6")
    lidar = empirical.EmpiricalLidar(empirical.Params(sector_deg=(-5.0, 5.0), step_deg=1.0), setup)
    lidar.reset(Stream(1, "lidar"))
    scan(lidar, Pose.from_euler((-25.0, 50.0, 3.0), 0.0, 0.5, np.pi))
    [note] = lidar.notes
    assert "stubble" in note
    assert "0.06 to 0.27 m" in note


def test_a_table_without_stubble_is_refused(tmp_path):
    with np.load(str(_bundled("wheat-median"))) as data:
        old = {name: data[name] for name in data.files if not name.startswith("stubble_")}
    np.savez(tmp_path / "old.npz", **old)
    with pytest.raises(InputError, match="stubble"):
        load_table("old.npz", tmp_path)


def _bundled(name):
    from importlib.resources import files

    return files("swath.data") / "lidar_tables" / f"{name}.npz"
