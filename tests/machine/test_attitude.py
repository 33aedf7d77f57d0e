"""How a machine stands, against the ground under the cells of its tyres, on drawn places of a rough field."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import rotation_rows
from swath.field.stand import uniform
from swath.field.terrain import formula
from swath.machine.attitude import TerrainFollower
from swath.machine.machine_sheet import load_machine
from tests.field.made_field import made_field


def rough(**more):
    stand = uniform.Params(row_azimuth_deg=67.0)
    return made_field(terrain=formula.Params(slope_percent=6.0, roughness_class="E"), stand=stand, **more)


def tyre(field, place, ahead, left, axle):
    """Mean height of the ground under a tyre: the middles of 4 x 2 equal cells of its patch."""
    x, y, yaw = place
    along, across = np.meshgrid(np.arange(-0.375, 0.4, 0.25), [-0.25, 0.25])
    u, v = ahead + along * axle.patch_length, left + across * axle.patch_width
    c, s = np.cos(yaw), np.sin(yaw)
    return float(np.mean(field.ground_height(x + c * u - s * v, y + s * u + c * v)))


@pytest.mark.parametrize("page_limit", [1024, 2])
@pytest.mark.parametrize("machine", ["lexion-700", "grain-truck"])
def test_stands_on_the_ground_under_its_tyres(machine, page_limit):
    sheet, draw, field = load_machine(machine), np.random.default_rng(page_limit), rough()
    follower, d, behind = (
        TerrainFollower(rough(page_limit=page_limit), sheet),
        sheet.dynamics,
        sheet.steered_x,
    )
    place, slopes = np.array([-15.0, 5.0, 0.3]), []
    for _ in range(200):
        place += draw.uniform(-1.0, 1.5), draw.uniform(-1.0, 1.0), draw.uniform(-0.5, 0.5)
        half, rear = 0.5 * sheet.front_track, 0.5 * sheet.rear_track
        left, right = (tyre(field, place, 0.0, side, d.front) for side in (half, -half))
        rear_left, rear_right = (tyre(field, place, behind, side, d.rear) for side in (rear, -rear))
        z, back = 0.5 * (left + right), 0.5 * (rear_left + rear_right)
        pitch = np.arctan((back - z) / -behind)
        slopes = (left - right) / (2.0 * half), (rear_left - rear_right) / (2.0 * rear)
        stance = follower.at(*place.tolist())
        expected = z, np.arctan(slopes[0] * np.cos(pitch)), pitch, *slopes
        np.testing.assert_allclose(stance, expected, atol=1e-12)
        pose = follower.pose()
        np.testing.assert_array_equal(pose.position, [*place[:2], stance.z])
        np.testing.assert_array_equal(
            pose.rotation, rotation_rows(stance.roll, stance.pitch, float(place[2]))
        )


@pytest.mark.parametrize(
    "place", [(np.nan, 0.0, 0.0), (0.0, np.inf, 0.0), (0.0, 0.0, np.nan), (2e6, 0.0, 0.0)]
)
def test_refuses_places_that_are_none(place):
    follower = TerrainFollower(rough(), load_machine("lexion-700"))
    follower.at(0.0, 0.0, 0.0)
    with pytest.raises(InputError):
        follower.at(*place)
