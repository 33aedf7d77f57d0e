"""Objects by radar, and by scanner and radar together."""

from math import cos, sin

import numpy as np
import pytest

from swath.control.objects import joined, radar
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.signals import Odometry
from swath.signals.radar import radar_targets_of
from swath.signals.setup import ControlSetup
from tests.control.test_objects import EDGE, MOUNTING, scan_of
from tests.field.test_solids import MACHINE

STEP, AT = NS // 20, Pose.from_euler([3.0, 0.5, 1.0])
NAN = float("nan")


def made(module, **params):
    mountings = {"targets": AT, "scan": MOUNTING}  # of all sensors that the machine has
    part = getattr(module, "Joined" if module is joined else "RadarObjects")
    made = part(module.Params(**params), ControlSetup(MACHINE, mountings, "left", 0.05))
    made.reset(Stream(1, "combine.objects"))
    return made


def look(things, pose, speed, turn, t, more=(), rcs=-3.0):
    """Detections of things (x, y, vx, vy) over the ground, from a machine at x, y, yaw."""
    px, py, yaw = pose
    eye = Pose.from_euler([px, py, 0.0], yaw=yaw) @ AT
    arm = eye.position[:2] - [px, py]
    velocity = np.array([cos(yaw), sin(yaw)]) * speed + turn * np.array([-arm[1], arm[0]])
    rows = []
    for x, y, vx, vy in things:
        way = np.array([x, y]) - eye.position[:2]
        far = np.hypot(*way)
        rate = (np.array([vx, vy]) - velocity) @ way / far
        rows.append([far, np.arctan2(way[1], way[0]) - yaw, NAN, rate, rcs, 20.0, 0.1, 0.01, 0.05])
    return radar_targets_of(t, [*rows, *more])


def drive(part, things, steps, *, speed=2.0, turn=0.0, late=2, scanned=None, alarms=None, first=1):
    """The last sample, and the machine's pose there. late: looks that a sample is behind."""
    poses, found = [], None
    for k in range(first, first + steps):
        t, yaw = k * STEP, turn * k * 0.05
        r = speed / turn if turn else 0.0
        pose = (r * sin(yaw), r * (1.0 - cos(yaw)), yaw) if turn else (speed * k * 0.05, 0.0, 0.0)
        poses.append((t, pose))
        then, place = poses[max(len(poses) - 1 - late, 0)]
        now = [(x + vx * then / NS, y + vy * then / NS, vx, vy) for x, y, vx, vy in things]
        targets = look(now, place, speed, turn, then, alarms(k) if alarms else ())
        inputs = {"targets": targets, "odometry": Odometry(t, speed, turn, 0.0)}
        if scanned is not None:
            shown = [(x - pose[0], y, 0.25, 1.75) for x, y in scanned]
            inputs |= {"scan": scan_of(shown, k // 2 * 2 * STEP, k), "edge": EDGE}
        found = part.step(t - STEP, STEP, inputs)["objects"]
    return found, pose


@pytest.mark.parametrize("turn", [0.0, 0.1])
def test_a_post_stays_where_it_is(turn):
    """Over the ground, whatever the machine does and however late the sample is."""
    found, (px, py, yaw) = drive(made(radar), [(22.0, 1.5, 0.0, 0.0)], 40, turn=turn)
    x, y = 22.0 - px, 1.5 - py
    assert (found.x[0], found.y[0]) == pytest.approx(
        (cos(yaw) * x + sin(yaw) * y, -sin(yaw) * x + cos(yaw) * y), abs=0.05
    )
    assert (found.velocity_x[0], found.velocity_y[0]) == pytest.approx((0.0, 0.0), abs=0.1)


def test_a_walk_gives_its_velocity():
    found, _ = drive(made(radar), [(25.0, 4.0, -0.5, -1.2)], 60)
    assert (found.velocity_x[0], found.velocity_y[0]) == pytest.approx((-0.5, -1.2), abs=0.15)


def test_what_leaves_the_field_of_view_is_kept():
    """A post beside the radar's view, before the knife, stays; ahead it would be gone after `keep_s`."""
    for angle, kept in ((0.78, 1), (0.3, 0)):
        x, y = AT.position[0] + 6.0 * cos(angle), AT.position[1] + 6.0 * sin(angle)
        part = made(radar)
        drive(part, [(x, y, 0.0, 0.0)], 10, speed=0.0)
        found, _ = drive(part, [], 40, speed=0.0, first=11)
        assert len(found.x) == kept


def test_false_alarms_give_no_thing():
    """As many as the sheet of the corner radar makes, 0.3 a look, over 200 s."""
    rng = np.random.default_rng(5)

    def alarms(k):
        rest = [0.0, 12.0, 0.1, 0.01, 0.1]
        places = rng.uniform([0.2, -0.78, -20.0], [70.0, 0.78, 20.0], (rng.poisson(0.3), 3)).tolist()
        return [[far, azimuth, NAN, rate, *rest] for far, azimuth, rate in places]

    part, counted = made(radar), 0
    for _ in range(10):
        part.reset(Stream(1, "combine.objects"))
        found, _ = drive(part, [], 400, alarms=alarms)
        counted += len(found.x)
    assert counted == 0
    once = made(radar, confirm=1, fastest_m_s=50.0)
    assert len(drive(once, [], 400, alarms=alarms)[0].x) > 0


def test_crop_that_throws_back_is_no_thing():
    """What shows less than a person or a deer, look after look at one place; a radar that tells no cross
    sections is taken at its word."""
    for rcs, count in ((-21.0, 0), (-8.0, 1), (NAN, 1)):
        part, found = made(radar), None
        for k in range(1, 11):
            targets = look([(12.0, 0.5, 0.0, 0.0)], (0.0, 0.0, 0.0), 0.0, 0.0, k * STEP, rcs=rcs)
            inputs = {"targets": targets, "odometry": Odometry(k * STEP, 0.0, 0.0, 0.0)}
            found = part.step((k - 1) * STEP, STEP, inputs)["objects"]
        assert len(found.x) == count


def test_scanner_and_radar_join():
    """A person that both see is one; one in the crop that the scanner cannot see is the radar's."""
    part = made(joined)
    things = [(16.0, 0.0, 0.0, 0.0), (20.0, -3.0, 0.0, 0.0)]
    found, (px, _, _) = drive(part, things, 24, scanned=[(16.0, 0.0)])
    order = np.argsort(found.x)
    assert found.x[order].tolist() == pytest.approx([16.0 - px, 20.0 - px], abs=0.3)
    assert found.y[order].tolist() == pytest.approx([0.0, -3.0], abs=0.3)
    assert found.top[order[0]] == pytest.approx(1.75, abs=0.2)
    assert found.number[order[0]] > 0 > found.number[order[1]]
    assert found.confidence[order[0]] > found.confidence[order[1]]


def test_saved_and_loaded_in_the_middle():
    part, other = made(joined), made(joined)
    things = [(16.0, 0.0, 0.0, 0.0)]
    drive(part, things, 12, scanned=[(16.0, 0.0)])
    other.load(part.save())
    inputs = {
        "targets": look(things, (1.3, 0.0, 0.0), 2.0, 0.0, 13 * STEP),
        "odometry": Odometry(13 * STEP, 2.0, 0.0, 0.0),
        "scan": scan_of([(14.7, 0.0, 0.25, 1.75)], 13 * STEP, 13),
        "edge": EDGE,
    }
    a, b = (p.step(12 * STEP, STEP, inputs)["objects"] for p in (part, other))
    assert (a.x.tobytes(), a.number.tobytes()) == (b.x.tobytes(), b.number.tobytes())
    assert len(a.x) == 1
