"""Sensors of a machine on a circle, of even crop in the machine, and of a box before a camera."""

import numpy as np
import pytest

from swath.core.random import Stream
from swath.field.memory_layout import Organ
from swath.sensing.gnss.antenna import Place as Antenna
from swath.sensing.imu.strapdown import GRAVITY
from swath.sensing.imu.strapdown import Place as Unit
from swath.signals import MachineState, SteerState
from tests.levels.limits import each_level, keys_of, make
from tests.sensing import test_camera, test_crop_flow
from tests.sensing.driven_states import circle, feed, setup_of

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


@each_level("gnss")
def test_position_and_speed_on_a_circle(level, limit):
    """An antenna 2 m ahead of the axle: farther from the centre, faster, and with a course to the left."""
    antenna = {"antenna": Antenna(x_m=2.0, y_m=0.0, z_m=4.0)}
    sensor = reset(make("gnss", level, setup_of(), **antenna, **(ZERO_GNSS if level == "error" else {})))
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
    image = test_camera.look(test_camera.camera(solid, horizontal_fov_deg=60.0))
    rows, columns = np.nonzero(image.label == Organ.SOLID)
    assert len(rows) > 400
    for seen, corner in ((columns, u), (rows, v)):
        assert seen.min() - 0.5 == pytest.approx(corner.min(), abs=limit)
        assert seen.max() + 0.5 == pytest.approx(corner.max(), abs=limit)
