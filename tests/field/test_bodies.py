"""Bodies among named obstacles: who overlaps whom at the start, and who starts outside the field."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.field.site_setup import Bodies, why_outside
from swath.field.solid.obstacles import BoxObstacle, MeshObstacle, PostObstacle, StoneObstacle, things_of
from swath.field.solid.solids import box_on_ground, machine_body, merge, mesh, post, solid_count
from swath.field.stand import maps
from swath.signals import MachineState
from tests.field.made_field import made_field, rectangle
from tests.field.test_solids import MACHINE

BODY = machine_body(MACHINE)


def test_obstacles_are_called_by_their_name_or_by_kind_and_number():
    obstacles = [
        PostObstacle(x_m=1.0, y_m=0.0),
        StoneObstacle(x_m=2.0, y_m=0.0),
        PostObstacle(x_m=3.0, y_m=0.0, name="pylon"),
        PostObstacle(x_m=4.0, y_m=0.0),
    ]
    field = made_field()
    named = {thing.name: thing.in_world for thing in things_of(obstacles, field)}
    assert list(named) == ["post 1", "stone 1", "pylon", "post 3"]
    assert solid_count(merge(*named.values())) == 4
    twice = [PostObstacle(x_m=1.0, y_m=0.0, name="it"), BoxObstacle(x_m=9.0, y_m=0.0, name="it")]
    with pytest.raises(InputError, match=r"field\.obstacles\.1\.name = it: expected a name that no other"):
        things_of(twice, field)
    with pytest.raises(InputError, match="expected obstacles with other names"):
        Bodies(named).add("pylon", BODY, Pose.identity())


def test_machines_that_overlap_at_the_start_are_named_once_each_pair():
    bodies = Bodies({"post 1": post([30.0, 0.0, 0.0], 2.0, 0.2), "shed": box_on_ground([4, 0, 0], [6, 4, 3])})
    bodies.add("combine", BODY, Pose.identity())
    bodies.add("cart", BODY, Pose.from_euler((2.0, 4.0, 0.0), yaw=0.5))
    bodies.add("truck", BODY, Pose.from_euler((0.0, 40.0, 0.0)))
    pairs = [(c.first, c.second) for c in bodies.contacts()]
    assert pairs == [("cart", "combine"), ("cart", "shed"), ("combine", "shed")]
    own = [(c.first, c.second) for c in bodies.contacts("combine")]
    assert own == [("combine", "cart"), ("combine", "shed")]
    bodies.hitch("combine", "cart")
    assert ("cart", "combine") not in [(c.first, c.second) for c in bodies.contacts()]
    bodies.set_obstacles({})
    assert bodies.contacts() == []
    assert bodies.clearance("truck")[1] == "cart"


def test_a_machine_that_is_taken_away_leaves_no_hitch_behind():
    """Another one of its name later hangs on nothing."""
    bodies = Bodies()
    bodies.add("combine", BODY, Pose.identity())
    bodies.add("cart", BODY, Pose.identity())
    bodies.hitch("combine", "cart")
    assert bodies.contacts() == []
    bodies.remove("cart")
    bodies.add("cart", BODY, Pose.identity())
    assert [(c.first, c.second) for c in bodies.contacts()] == [("cart", "combine")]


def test_a_thing_that_is_put_there_on_the_way_touches_machines_alone():
    bodies = Bodies({"post 1": post([30.0, 0.0, 0.0], 2.0, 0.2)})
    bodies.add("combine", BODY, Pose.identity())
    bodies.add("obstacles.a", post([30.0, 0.0, 0.0], 2.0, 0.2), Pose.identity(), is_machine=False)
    assert bodies.contacts() == []
    bodies.add("obstacles.b", post([1.0, 0.0, 0.0], 2.0, 0.2), Pose.identity(), is_machine=False)
    assert [(c.first, c.second) for c in bodies.contacts()] == [("combine", "obstacles.b")]
    bodies.remove("obstacles.b")
    ahead = 30.0 - 0.1 - MACHINE.knife_x
    assert bodies.clearance("combine") == (pytest.approx(ahead, abs=0.01), "obstacles.a")


def test_clearance_follows_the_machine_in_three_dimensions():
    shape = mesh(np.array([[[0.0, -1, 0], [0, 1, 0], [0, 0, 1.8]]]), Pose.from_euler((12.0, 0.0, 0.0)))
    bodies = Bodies({"person": shape, "bridge": box_on_ground([50, 0, 4.5], [4, 30, 0.5])})
    bodies.add("combine", BODY, Pose.identity())
    assert bodies.clearance("combine") == (pytest.approx(8.0, abs=0.01), "person")
    bodies.place("combine", Pose.from_euler((6.5, 0.0, 0.0)))
    assert bodies.clearance("combine") == (pytest.approx(1.5, abs=0.01), "person")
    bodies.place("combine", Pose.from_euler((50.0, 0.0, 0.0)))
    assert bodies.clearance("combine") == (pytest.approx(0.6, abs=0.01), "bridge")
    bodies.place("combine", Pose.from_euler((54.0, 0.0, 0.0), pitch=0.3))
    assert bodies.clearance("combine")[0] == 0.0


def test_a_machine_that_follows_its_state_is_there_and_as_fast_also_after_a_save():
    bodies, pose = Bodies(), Pose.from_euler((6.5, 2.0, 0.3), 0.05, -0.1, 0.8)
    bodies.add("combine", BODY, Pose.identity())
    bodies.follow("combine", lambda: MachineState(5, pose, 2.0, 0.1, 0.3, 0.0, 1.0))
    saved, (body,) = bodies.save(), bodies.around()
    np.testing.assert_allclose(body.velocity, pose.turn([2.0, 0.1, 0.0]), atol=1e-15)
    assert body.pose is pose
    bodies.reset()
    assert not bodies.around()[0].velocity.any()
    bodies.load(saved)
    np.testing.assert_array_equal(bodies.around()[0].velocity, body.velocity)
    with pytest.raises(InputError, match="machine = cart: expected one of combine"):
        bodies.follow("cart", lambda: MachineState(5, pose, 2.0, 0.1, 0.3, 0.0, 1.0))


def test_a_machine_starts_outside_the_field_when_none_of_it_is_inside():
    field = made_field(boundary=rectangle(-50.0, -50.0, 50.0, 50.0))
    assert why_outside(field, MACHINE, Pose.from_euler((-53.0, 0.0, 0.0))) == ""  # the knife is inside
    assert why_outside(field, MACHINE, Pose.from_euler((-60.0, 0.0, 0.0))) == "beyond its boundary"
    assert why_outside(made_field(), MACHINE, Pose.from_euler((-6000.0, 0.0, 0.0))) == ""
    assert MeshObstacle(x_m=0, y_m=0, file="a.obj").name is None


def test_a_machine_starts_outside_where_the_stand_is_not_known():
    from swath.field.maps.raster import Raster
    from tests.field.made_field import SETUP

    density = Raster(np.full((40, 40), 400.0, np.float32), -10.0, -10.0, 1.0)
    stand = maps.Maps.from_rasters(maps.Params(), SETUP, density, None)
    field = made_field()
    field.stand = stand
    assert why_outside(field, MACHINE, Pose.from_euler((0.0, 0.0, 0.0))) == ""
    assert why_outside(field, MACHINE, Pose.from_euler((0.0, 300.0, 0.0))) == "beyond the map of its stand"
