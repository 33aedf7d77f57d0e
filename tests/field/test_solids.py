"""Obstacles and bodies: where they stand and how they move."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.field.memory_layout import Solids
from swath.field.site_setup import Bodies, SiteSetup
from swath.field.solid.obstacles import BoxObstacle, Obstacle, PostObstacle, StoneObstacle
from swath.field.solid.solids import box_on_ground, machine_body, merge, moved, post, stone
from swath.field.terrain import plane
from swath.signals.setup import MachineGeometry
from tests.field.made_field import made_field, rectangle
from tests.obstacle_solids import solids_of

MACHINE = MachineGeometry(
    wheelbase=3.6,
    front_track=3.0,
    rear_track=2.8,
    max_steer=0.6,
    header_width=9.0,
    knife_x=4.0,
    header_y=0.2,
    header_height=1.2,
    header_depth=1.5,
    body=(-5.0, 2.0, 1.6, 0.6, 3.9),
)


def test_obstacles_stand_on_the_ground():
    field = made_field(terrain=plane.Params(slope_percent=10.0))
    obstacles = [
        PostObstacle(x_m=20.0, y_m=5.0, height_m=2.0, diameter_m=0.2),
        BoxObstacle(x_m=-10.0, y_m=0.0, length_m=4.0, width_m=2.0, height_m=1.0, heading_deg=90.0),
        StoneObstacle(x_m=30.0, y_m=0.0),
    ]
    solids = solids_of(obstacles, field)
    assert solids.capsule_a[0] == pytest.approx([20.0, 5.0, 2.0], abs=1e-5)
    assert solids.capsule_b[0, 2] + solids.capsule_radius[0] == pytest.approx(4.0, abs=1e-5)
    assert solids.box_centre[0] == pytest.approx([-10.0, 0.0, -0.5], abs=1e-5)
    assert solids.box_axes[0] @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)
    assert solids.box_half[0] == pytest.approx([2.0, 1.0, 0.5])
    assert solids.ellipsoid_centre[0] == pytest.approx([30.0, 0.0, 3.0], abs=1e-5)


def test_obstacles_stand_inside_the_boundary_and_beside_it():
    field = made_field(boundary=rectangle(-20.0, -20.0, 20.0, 20.0))
    solids = solids_of([PostObstacle(x_m=0.0, y_m=0.0), PostObstacle(x_m=25.0, y_m=0.0)], field)
    assert solids.capsule_a[:, 0].tolist() == [0.0, 25.0]


@pytest.mark.parametrize(
    "data",
    [
        {"kind": "post", "x_m": 0.0, "y_m": 0.0, "height_m": -1.0},
        {"kind": "ghost", "x_m": 0.0, "y_m": 0.0},
        {"kind": "box", "y_m": 0.0},
        {"kind": "stone", "x_m": 0.0, "y_m": 0.0, "reflectance": 2.0},
    ],
)
def test_parameters_out_of_range_are_refused(data):
    with pytest.raises(ValidationError):
        TypeAdapter(Obstacle).validate_python(data)


def test_merged_and_moved_solids_keep_their_shape():
    every = merge(post([0, 0, 0], 2.0, 0.1), box_on_ground([5, 0, 0], [2, 1, 1]), stone([0, 5, 0], [1, 1, 1]))
    assert [len(every.capsule_a), len(every.box_centre), len(every.ellipsoid_centre)] == [1, 1, 1]
    pose = Pose.from_euler([10.0, 20.0, 1.0], roll=0.1, pitch=-0.2, yaw=1.0)
    there = moved(every, pose)
    corner = every.box_centre[0] + every.box_axes[0] @ every.box_half[0]
    assert there.box_centre[0] + there.box_axes[0] @ there.box_half[0] == pytest.approx(pose.apply(corner))
    assert np.linalg.norm(there.capsule_b - there.capsule_a) == pytest.approx(1.95)
    back = moved(there, pose.inverse())
    assert back.ellipsoid_centre == pytest.approx(every.ellipsoid_centre)
    assert len(merge().box_centre) == len(merge(Solids(), Solids()).box_centre) == 0


def test_a_machine_sees_the_others_and_the_obstacles_but_not_itself():
    field, bodies = made_field(), Bodies()
    bodies.add("combine", machine_body(MACHINE), Pose.identity())
    bodies.add("cart", machine_body(MACHINE), Pose.from_euler([0.0, 8.0, 0.0]))
    obstacles = solids_of([PostObstacle(x_m=20.0, y_m=0.0)], field)
    site = SiteSetup(field, MACHINE, Pose.identity(), "left", 0.04, "combine", obstacles, bodies)
    seen = site.solids()
    assert (len(seen.capsule_a), len(seen.box_centre)) == (1, 2)
    assert seen.box_centre[1] == pytest.approx([4.0 - 0.75, 8.2, 0.7])
    bodies.place("cart", Pose.from_euler([10.0, 8.0, 0.0], yaw=np.pi))
    assert site.solids().box_centre[1] == pytest.approx([10.0 - 3.25, 7.8, 0.7])
    state = bodies.save()
    bodies.place("cart", Pose.identity())
    bodies.load(state)
    assert site.solids().box_centre[1] == pytest.approx([10.0 - 3.25, 7.8, 0.7])
    with pytest.raises(InputError, match="one of cart, combine"):
        bodies.place("tractor", Pose.identity())
