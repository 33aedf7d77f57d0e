"""Sensors of a machine on a circle, of even crop in the machine, and of a box before a camera."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from swath.control.objects import joined, radar
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.field.maps.projection import Origin
from swath.field.maps.raster import Raster
from swath.field.memory_layout import Organ
from swath.field.site_setup import SiteSetup
from swath.field.solid.obstacles import BoxObstacle, PostObstacle, SheetObstacle, things_of
from swath.field.solid.solids import merge
from swath.field.stand import maps
from swath.sensing.field_map.places import true_grain
from swath.sensing.gnss.antenna import Place as Antenna
from swath.sensing.imu.strapdown import GRAVITY
from swath.sensing.imu.strapdown import Place as Unit
from swath.sensing.mount import Mount
from swath.signals import OBSTACLE_KINDS, Fix, MachineState, SteerState
from tests.control import test_objects, test_radar_objects
from tests.field.made_field import made_field
from tests.field.test_solids import MACHINE
from tests.levels.limits import each_level, keys_of, make
from tests.sensing import test_camera, test_crop_flow
from tests.sensing.driven_states import circle, feed, setup_of, straight

SPEED, RADIUS = 2.0, 20.0
RATE = SPEED / RADIUS
ZERO_GNSS = {"noise_cm": 0.0, "wander_cm": 0.0, "velocity_noise_m_s": 0.0, "latency_ms": 0.0}
ZERO_IMU = dict.fromkeys(
    ("noise_factor", "walk_factor", "gyro_bias_deg_s", "accel_bias_mg", "gyro_scale_percent"), 0.0
) | {"accel_scale_percent": 0.0}


def reset(sensor):
    sensor.reset(Stream(1, "combine.sensor"))
    return sensor


@each_level("crop_flow")
def test_flows_of_even_crop(level, limit):
    zeros = {k: 0.0 for k in keys_of("crop_flow", level) if not k.startswith("moisture_percent")}
    sensor = reset(make("crop_flow", level, test_crop_flow.SETUP, **zeros))
    out = test_crop_flow.run(sensor, 3)[-1]
    assert out["feed"].flow == pytest.approx(39.0, rel=limit)
    assert out["grain"].flow == pytest.approx(23.0, rel=limit)
    assert out["loss"].separation == pytest.approx(0.12, rel=limit)


@each_level("odometry")
def test_odometry_on_a_circle(level, limit):
    sensor = reset(make("odometry", level, setup_of(), **dict.fromkeys(keys_of("odometry", level), 0.0)))
    true = MachineState(0, circle(SPEED, RADIUS)(0.0), SPEED, 0.0, RATE, 0.1, 0.0)
    for k in range(5):
        inputs = {"state": true, "steering": SteerState(0, 0.1, 0.0)}
        found = sensor.step(k * 20_000_000, 20_000_000, inputs)["odometry"]
    assert (found.speed, found.yaw_rate, found.steer_angle) == pytest.approx((SPEED, RATE, 0.1), rel=limit)


@each_level("ground_speed")
def test_speed_over_level_ground(level, limit):
    setup = SimpleNamespace(base=None, machine=None, edge_side="left", period=0.1)
    sensor = reset(make("ground_speed", level, setup, **({"noise": "none"} if level == "radar" else {})))
    last = MachineState(0, straight(SPEED)(1.0), SPEED, 0.0, 0.0, 0.0, SPEED)
    if level == "ideal":
        found = sensor.step(900_000_000, 100_000_000, {"state": last})["speed"]
    else:
        found = feed(sensor, straight(SPEED), 10)[-1]
    assert found.speed == pytest.approx(SPEED, rel=limit)


def post_ahead(level, speed):
    """What a radar on the axle tells of a post 11 m ahead of where the machine began."""
    field = made_field(stand=maps.Params(stems_per_m2=1))
    setup = SiteSetup(field, MACHINE, Pose.identity(), "left", 0.1, "combine")
    setup.bodies.set_things(things_of([PostObstacle(x_m=11.0, y_m=0.0)], field))
    mount = Mount(at="axle", z_m=1.0, pitch_deg=0.0)
    quiet = {} if level == "ideal" else {"noise": "none"}
    sensor = reset(make("radar", level, setup, mount=mount, **quiet))
    return feed(sensor, straight(speed), 12)[-1]


@each_level("radar")
def test_radial_speed_of_a_post(level, limit):
    last = post_ahead(level, SPEED)
    assert last.radial_speed[0] == pytest.approx(-SPEED, abs=limit)
    assert last.range[0] == pytest.approx(11.0 - SPEED * last.t * 1e-9 - 0.075, abs=limit)


@each_level("field_map")
def test_a_map_of_even_crop(level, limit, tmp_path):
    """What was grown everywhere, whether it was stored or known."""
    origin = Origin(32632, 500_000.0, 5_800_000.0)
    setup = SiteSetup(made_field(), MACHINE, Pose.identity(), "left", 0.2, origin=origin)
    grown = float(true_grain(setup.field, np.array([50.0]), np.array([9.0]))[0])
    even = Raster(np.full((90, 90), grown), -90.0, -90.0, 2.0, 32632)
    even.to_geotiff(tmp_path / "map.tif", 32632, (origin.easting, origin.northing))
    own = {
        "error": {"correlation": 1.0, "kernel_m": 0.0, "cell_m": 0.0},
        "file": {"file": str(tmp_path / "map.tif")},
    }
    part = reset(make("field_map", level, setup, **own.get(level, {})))
    nan = float("nan")
    for k in range(1, 40):
        t = k * 200_000_000
        fix = Fix(t, 0.4 * k, 0.0, 4.0, 2.0, 0.0, 0.02, 0.03, 0.1, 4, nan, nan, nan)
        state = MachineState(t, Pose.from_euler([0.4 * k, 0.0, 0.0]), 2.0, 0.0, 0.0, 0.0, 0.0)
        inputs = {"state": state, "fix": fix, "odometry": None}
        seen = part.step(t - 200_000_000, 200_000_000, inputs)["map"]
    exact = 1e-6 if level == "file" else limit  # GeoTIFF holds 32 bits
    assert seen.grain[2] == pytest.approx(grown, rel=exact)


@each_level("objects")
def test_a_person_ahead(level, limit):
    x, y = 14.0, 1.0
    if level == "cluster":
        last = test_objects.drive(test_objects.cluster(), [(x + 2.0, y, 0.25, 1.75)], 10)[-1]
    elif level in ("radar", "joined"):
        part = test_radar_objects.made(joined if level == "joined" else radar)
        scanned = {"scanned": [(x + 2.0, y)]} if level == "joined" else {}
        last, _ = test_radar_objects.drive(part, [(x + 2.0, y, 0.0, 0.0)], 20, **scanned)
    else:
        setup = SiteSetup(made_field(), MACHINE, Pose.identity(), "left", 0.1, "combine")
        person = SheetObstacle(kind="person", x_m=x, y_m=y)
        setup.bodies.set_things(things_of([person], setup.field))
        zeros = ("miss_percent", "false_per_h", "position_sd_m", "position_sd_percent", "velocity_sd_m_s")
        no_errors = dict.fromkeys((*zeros, "delay_s"), 0.0) if level == "error" else {}
        part = reset(make("objects", level, setup, **no_errors))
        state = MachineState(0, Pose.identity(), 0.0, 0.0, 0.0, 0.0, 0.0)
        last = part.step(0, 100_000_000, {"state": state})["objects"]
        assert (last.kind[0], last.top[0]) == (OBSTACLE_KINDS.index("person"), pytest.approx(1.75, abs=0.01))
    assert (last.x[0], last.y[0]) == pytest.approx((x, y), abs=max(limit, 0.02))


@pytest.mark.parametrize(("wall", "share"), [(0.5, 0.0), (1.0, 0.5 / 1.75), (1.5, 1.5 / 1.75)])
def test_the_share_of_a_person_that_a_wall_hides(wall, share):
    """Eye at 1.5 m, wall at 5 m, person at 10 m on bare ground: similar triangles."""
    field = made_field(stand=maps.Params(stems_per_m2=1))
    setup = SiteSetup(field, MACHINE, Pose.identity(), "left", 0.1, "combine")
    things = [
        SheetObstacle(kind="person", x_m=10.0, y_m=0.0),
        BoxObstacle(x_m=5.0, y_m=0.0, length_m=0.02, width_m=4.0, height_m=wall),
    ]
    made = things_of(things, field)
    setup.bodies.set_things(made)
    solids = merge(*(thing.in_world for thing in made))
    eye = Mount(at="axle", x_m=0.0, z_m=1.5, pitch_deg=0.0)
    part = reset(make("objects", "truth", replace(setup, obstacles=solids), mount=eye))
    state = MachineState(0, Pose.identity(), 0.0, 0.0, 0.0, 0.0, 0.0)
    seen = part.step(0, 100_000_000, {"state": state})["objects"]
    person = seen.kind.tolist().index(OBSTACLE_KINDS.index("person"))
    assert seen.hidden[person] == pytest.approx(share, abs=0.05)


@each_level("gnss")
def test_position_and_speed_on_a_circle(level, limit):
    """An antenna 2 m ahead of the axle: farther from the centre, faster, and with a course to the left."""
    antenna = {"antenna": Antenna(x_m=2.0, y_m=0.0, z_m=4.0)}
    sensor = reset(make("gnss", level, setup_of(), **antenna, **({} if level == "ideal" else ZERO_GNSS)))
    for fix in feed(sensor, circle(SPEED, RADIUS), 20):
        turn = RATE * fix.t * 1e-9
        x = RADIUS * np.sin(turn) + 2.0 * np.cos(turn)
        y = RADIUS * (1.0 - np.cos(turn)) + 2.0 * np.sin(turn)
        assert (fix.x, fix.y, fix.z) == pytest.approx((x, y, 4.0), abs=limit)
        assert fix.speed == pytest.approx(np.hypot(SPEED, 2.0 * RATE), abs=limit)


@each_level("imu")
def test_rates_and_forces_on_a_circle(level, limit):
    mount = {"mount": Unit(x_m=0.0, y_m=0.0, z_m=0.0)}
    sensor = reset(
        make("imu", level, setup_of(period=0.01), **mount, **(ZERO_IMU if level == "error" else {}))
    )
    last = feed(sensor, circle(SPEED, RADIUS), 30, step=10_000_000)[-1]
    assert (last.rate_x, last.rate_y, last.rate_z) == pytest.approx((0.0, 0.0, RATE), abs=limit)
    forces = (last.force_x, last.force_y, last.force_z)
    assert forces == pytest.approx((0.0, SPEED * RATE, GRAVITY), abs=10 * limit)


@each_level("camera")
def test_where_a_box_appears(level, limit):
    """A convex body spans in the image what its corners span."""
    solid, u, v = test_camera.box_by_hand()
    image = test_camera.look(test_camera.camera_of(level, solid))
    rows, columns = np.nonzero(image.label == Organ.SOLID)
    assert len(rows) > 400
    for seen, corner in ((columns, u), (rows, v)):
        assert seen.min() - 0.5 == pytest.approx(corner.min(), abs=limit)
        assert seen.max() + 0.5 == pytest.approx(corner.max(), abs=limit)
