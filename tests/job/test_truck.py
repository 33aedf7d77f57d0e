"""The truck of a job: beside the cart that empties, part of the contact table, a data sheet of its own."""

import math

import pytest

from swath.core.errors import InputError
from swath.job.footprint import clearance, footprint_of
from swath.job.kinematic import Kinematic
from swath.job.machines import fleet_of
from swath.job.path import Pose
from swath.job.truck import truck_pose
from swath.machine.machine_sheet import load_machine
from tests.job.jobs import finished, job_file


@pytest.mark.parametrize("heading", [0.0, 0.5 * math.pi, 2.3, -1.1])
def test_it_stands_beside_a_cart_by_the_reach_of_its_auger(heading):
    """3.5 m between the middles, less half of 3.6 m of wheels and of 2.54 m of truck, and 0.3 m along: the
    wheels end 4.7 m behind the tractor's axle, the truck 4.4 m behind its middle.
    """
    sheet, cart = load_machine("grain-truck"), footprint_of(load_machine("tractor-grain-cart"))
    place = Pose(12.0, -7.0, heading)
    stands = truck_pose(place, sheet)
    bodies = footprint_of(sheet).at(stands, stands.heading)
    assert clearance(bodies, cart.at(place, heading)) == pytest.approx(
        math.hypot(3.5 - 1.8 - 1.27, 0.3), abs=1e-9
    )
    (corners,) = bodies
    middle = [sum(p[k] for p in corners) / 4.0 for k in (0, 1)]
    right = math.sin(heading), -math.cos(heading)
    assert middle == pytest.approx([12.0 + 3.5 * right[0], -7.0 + 3.5 * right[1]], abs=1e-9)


def test_a_truck_has_a_box():
    with pytest.raises(InputError, match=r"truck\.machine.*expected a machine with a box"):
        fleet_of(job_file(truck={"machine": "lexion-700"}))


def test_no_cart_touches_it_while_it_empties():
    """The truck south of the field, carts come straight from it."""
    motion = Kinematic()
    ring = [(0.0, 0.0), (220.0, 0.0), (220.0, 110.0), (0.0, 110.0)]
    job = finished(job_file(1, 1, boundary_m=ring, truck={"x_m": 110.0, "y_m": -40.0}), motion=motion)
    emptying = [(s.start, s.end) for k in job.carts for s in k.timeline.spans if s.state == "unload"]
    pairs = {(p.first, p.second): p for p in motion.watch.pairs}
    assert ("combine_0", "truck") in pairs
    times = pairs["cart_0", "truck"].times
    assert emptying
    assert not any(a < end and b > start for a, b in times for start, end in emptying)
