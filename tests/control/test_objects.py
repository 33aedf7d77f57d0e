"""What level `cluster` makes of a scan, and how a speed law stops before objects."""

import numpy as np
import pytest

from swath.control.objects.cluster import Cluster, HeightMap, Params, closing
from swath.control.speed.obstacle_stop import ObstacleStop, Stop
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.signals import CropEdge, Odometry, Scan, beam_directions, objects_of
from swath.signals.setup import ControlSetup
from tests.field.test_solids import MACHINE

HIGH, STEP, SPEED = 3.6, NS // 10, 2.0
MOUNTING = Pose.from_euler([1.5, 0.0, HIGH], pitch=0.1)
CANOPY, STUBBLE, EDGE_Y = 0.8, 0.15, 3.0
GRID = np.meshgrid(np.radians(np.arange(-15, 16, 1.0)), np.radians(np.arange(-50, 50, 0.25)), indexing="ij")
ELEVATION, AZIMUTH = (a.ravel() for a in GRID)


def scan_of(things, t=0, seed=1, tilt=0.0, begins=-9.0):
    """A scan of crop right of EDGE_Y from x = begins on and stubble elsewhere, with upright cylinders
    (x, y, radius, top).
    """
    eye = MOUNTING.position
    way = MOUNTING.turn(beam_directions(AZIMUTH, ELEVATION))
    rng = np.random.default_rng(seed)
    far = np.full(len(way), np.nan)
    for surface, is_crop in ((STUBBLE, False), (CANOPY, True)):
        down = way[:, 2] - tilt * way[:, 0]
        s = (surface + rng.normal(0.0, 0.05, len(way)) + tilt * eye[0] - eye[2]) / down
        x, y = eye[0] + s * way[:, 0], eye[1] + s * way[:, 1]
        hit = (s > 0.0) & (((y < EDGE_Y) & (x > begins)) == is_crop) & (s < 60.0)
        far = np.where(hit & ~(far < s), s, far)
    s = (begins + rng.normal(0.0, 0.05, len(way)) - eye[0]) / way[:, 0]
    y, z = eye[1] + s * way[:, 1], eye[2] + s * way[:, 2]
    hit = (s > 0.0) & (y < EDGE_Y) & (z > STUBBLE) & (z < CANOPY) & (s < 60.0)
    far = np.where(hit & ~(far < s), s, far)
    for x, y, radius, top in things:
        a = way[:, 0] ** 2 + way[:, 1] ** 2
        b = way[:, 0] * (eye[0] - x) + way[:, 1] * (eye[1] - y)
        root = b * b - a * ((eye[0] - x) ** 2 + (eye[1] - y) ** 2 - radius**2)
        s = (-b - np.sqrt(np.maximum(root, 0.0))) / a
        hit = (root > 0.0) & (s > 0.0) & (eye[2] + s * way[:, 2] < top) & ~(far < s)
        far = np.where(hit, s, far)
    return Scan(t, np.zeros(len(far)), AZIMUTH, ELEVATION, far[:, None].astype(np.float32), far[:, None])


def cluster(**params):
    setup = ControlSetup(MACHINE, {"scan": MOUNTING}, "left", 0.1)
    part = Cluster(Params(**params), setup)
    part.reset(Stream(1, "combine.objects"))
    return part


EDGE = CropEdge(0, EDGE_Y, 0.0, 0.0, 5.0, 0.9, CANOPY, STUBBLE)


def drive(part, things, steps, *, tilt=0.0, edge=EDGE, velocity=(0.0, 0.0), begins=-9.0):
    """Samples while the machine drives on; where things and crop are at the start, and a velocity."""
    found = []
    for k in range(1, steps + 1):
        t, gone = k * STEP, k * 0.1
        now = [(x + gone * (velocity[0] - SPEED), y + gone * velocity[1], r, h) for x, y, r, h in things]
        inputs = {
            "scan": scan_of(now, t, k, tilt, begins - gone * SPEED),
            "odometry": Odometry(t, SPEED, 0.0, 0.0),
            "edge": edge,
        }
        found.append(part.step(t - STEP, STEP, inputs)["objects"])
    return found


@pytest.mark.parametrize(("x", "y"), [(15.0, 0.0), (18.0, 5.0), (12.0, -4.0)])
def test_a_person_is_placed_and_followed(x, y):
    found = drive(cluster(), [(x, y, 0.25, 1.75)], 10)
    last = found[-1]
    assert len(last.x) == 1
    assert (last.x[0], last.y[0]) == pytest.approx((x - 2.0, y), abs=0.3)
    assert last.confidence[0] > 0.9
    assert abs(last.velocity_x[0]) < 0.4
    assert len({float(s.number[0]) for s in found[3:]}) == 1


def test_a_walk_gives_its_velocity():
    last = drive(cluster(), [(20.0, 4.0, 0.25, 1.75)], 25, velocity=(-0.5, -1.2))[-1]
    assert (last.velocity_x[0], last.velocity_y[0]) == pytest.approx((-0.5, -1.2), abs=0.3)


@pytest.mark.parametrize("tilt", [-0.05, 0.0, 0.05])
def test_crop_edge_and_slope_are_no_objects(tilt):
    assert all(len(sample.x) == 0 for sample in drive(cluster(), [], 8, tilt=tilt))


def test_what_is_lower_than_the_crop_is_seen_on_the_cut_side_alone():
    deer = 1.0
    assert len(drive(cluster(), [(12.0, 6.0, 0.3, deer)], 5)[-1].x) == 1
    assert len(drive(cluster(), [(12.0, -2.0, 0.3, deer)], 5)[-1].x) == 0


def test_a_line_is_closed_over_what_is_narrow_and_keeps_its_edges():
    """A thing of 5 beams goes, one of 12 stays, a step stays where it is; the ends of a line tell nothing."""
    line = np.full((1, 100), 10.0)
    line[0, 60:] = 7.0
    line[0, 20:25], line[0, 35:47], line[0, :3] = 6.0, 8.0, 5.0
    closed = closing(line, 1, 8)[0]
    assert (closed[20:25] == 10.0).all()
    assert (closed[35:47] == 8.0).all()
    assert (closed[60:] == 7.0).all()
    assert (closed[47:60] == 10.0).all()
    assert (closed[:3] == 5.0).all()


def test_the_map_tells_slope_where_surfaces_have_edges():
    rng = np.random.default_rng(1)
    x, y = rng.uniform([5.0, -10.0], [25.0, 10.0], (4000, 2)).T
    z = 0.04 * x - 0.02 * y + np.where(y + 0.3 * x > 4.0, CANOPY, STUBBLE)
    heights = HeightMap(10.0)
    heights.take(1.0, x, y, z)
    assert heights.slope == pytest.approx((0.04, -0.02), abs=0.01)
    assert np.isnan(heights.tops(20.0, x, y)).all()  # seen too long ago


@pytest.mark.parametrize("seed", range(4))
def test_crop_across_the_way_is_none_and_who_stands_before_it_is_one(seed):
    rng = np.random.default_rng(seed)
    begins = float(rng.uniform(13.0, 18.0))
    free = drive(cluster(), [], 25, begins=begins, edge=None)
    assert all((sample.confidence < 0.5).all() for sample in free)
    x, y = begins - float(rng.uniform(0.3, 3.0)), float(rng.uniform(-5.0, 2.5))
    child = drive(cluster(), [(x, y, 0.18, CANOPY + 0.3)], 15, begins=begins, edge=None)
    assert max(float(sample.confidence.max(initial=0.0)) for sample in child) > 0.5
    assert all(
        abs(float(a) + (k + 1) * 0.1 * SPEED - x) < 0.5 and abs(float(b) - y) < 0.5
        for k, sample in enumerate(child)
        for a, b, sure in zip(sample.x, sample.y, sample.confidence, strict=True)
        if sure >= 0.5
    )


def test_a_wide_thing_counts_where_it_is_higher_than_crop_can_be():
    """A wall 8 m wide, made of posts that touch."""
    wall = [(14.0, y, 0.2, 3.0) for y in np.arange(4.2, 12.2, 0.3)]
    found = drive(cluster(), wall, 6)[-1]
    assert found.confidence.max() > 0.5
    assert found.width[np.argmax(found.confidence)] > 5.0


@pytest.mark.parametrize("seed", range(6))
def test_confidence_grows_with_what_is_seen(seed):
    """A post that stands out of the crop by more is told with no less confidence, wherever it stands."""
    rng = np.random.default_rng(seed)
    x, y = float(rng.uniform(11.0, 17.0)), float(rng.uniform(-6.0, 0.0))
    sure = []
    for top in (CANOPY, CANOPY + 0.5, CANOPY + 1.0):
        last = drive(cluster(), [(x, y, 0.25, top)], 4)[-1]
        sure.append(float(last.confidence.max(initial=0.0)))
    assert sure[0] < 0.5 < sure[2]
    assert sure[1] <= sure[2] + 0.05


def stop(x, y, speed, *, vy=0.0, confidence=1.0, **params):
    law = ObstacleStop(Stop(**params), MACHINE)
    seen = objects_of(0, [[1, 0, x, y, 0, 0.5, 0.5, 1.7, 0, vy, confidence, np.nan]])
    return law.limit(2.0, seen, Odometry(0, speed, 0.0, 0.0), STEP)


KNIFE, LEFT = MACHINE.knife_x, MACHINE.header_end("left")[1]


def test_it_stops_before_what_is_in_the_way_and_not_for_what_is_beside():
    near, far = KNIFE + 2.0, KNIFE + 40.0
    assert stop(near, 0.0, 2.0) == 0.0
    assert stop(far, 0.0, 2.0) == 2.0
    assert stop(near, LEFT + 5.0, 2.0) == 2.0
    assert stop(near, 0.0, 2.0, confidence=0.2) == 2.0
    assert stop(KNIFE - 3.0, 0.0, 2.0) == 2.0  # past


def test_who_walks_into_the_way_counts_before_he_is_there():
    assert stop(KNIFE + 7.0, LEFT + 3.0, 2.0) == 2.0
    assert stop(KNIFE + 7.0, LEFT + 3.0, 2.0, vy=-1.2) < 2.0


def test_the_machine_stands_at_the_gap_and_waits():
    """Closed loop with a drive that brakes as the law counts on and a delay as it counts on."""
    p = Stop()
    law = ObstacleStop(p, MACHINE)
    place, speed, commands = 0.0, 2.0, [2.0] * round(p.react_s / 0.1)
    for _ in range(400):
        seen = objects_of(0, [[1, 0, KNIFE + 15.0 - place, 0, 0, 0.5, 0.5, 1.7, 0, 0, 1, np.nan]])
        commands.append(law.limit(2.0, seen, Odometry(0, speed, 0.0, 0.0), STEP))
        speed = max(commands.pop(0), speed - p.brake_m_s2 * 0.1, 0.0)
        place += 0.1 * speed
    assert speed == 0.0
    assert p.gap_m - 0.6 < 15.0 - 0.25 - place < p.gap_m + 0.4
    free = objects_of(0, [])
    waits = [law.limit(2.0, free, Odometry(0, 0.0, 0.0, 0.0), STEP) for _ in range(30)]
    assert waits.index(2.0) == pytest.approx(10 * p.hold_s, abs=1)


def test_what_gets_under_the_lowest_beam_is_kept():
    """The machine closes in on a person until the lowest beam goes over his head, which is at 6.4 m."""
    found = drive(cluster(), [(12.0, 0.0, 0.25, 1.75)], 31)
    place = 12.0 - 31 * 0.1 * SPEED
    assert HIGH - (place - 0.25 - 1.5) * np.tan(np.radians(15.0) + 0.1) > 1.9
    assert len(found[-1].x) == 1
    assert found[-1].confidence[0] > 0.5
    assert found[-1].x[0] == pytest.approx(place, abs=0.5)


def test_saved_and_loaded_in_the_middle():
    """Map, height of the crop and what is followed go on as they were."""
    part, other = cluster(), cluster()
    drive(part, [(16.0, 5.0, 0.25, 1.75)], 6)
    other.load(part.save())
    t = 7 * STEP
    scan = scan_of([(14.6, 5.0, 0.25, 1.75)], t, 7)
    inputs = {"scan": scan, "odometry": Odometry(t, SPEED, 0.0, 0.0), "edge": EDGE}
    a, b = (p.step(t - STEP, STEP, inputs)["objects"] for p in (part, other))
    assert len(a.x) == 1
    assert all(getattr(a, k).tobytes() == getattr(b, k).tobytes() for k in ("x", "y", "top", "confidence"))
    assert other._map.slope == part._map.slope
    assert other._crop.most == part._crop.most


@pytest.mark.parametrize("near", [0.05, 0.4, 0.95, 1.3])
def test_echoes_close_to_a_scanner_before_the_knife_are_taken_as_any(near):
    """Dust or drops at its window are no object, and who stands behind is one."""
    x = MACHINE.knife_x + 1.0
    part = Cluster(Params(), ControlSetup(MACHINE, {"scan": Pose.from_euler([x, 0.0, HIGH])}, "left", 0.1))
    part.reset(Stream(1, "combine.objects"))
    scan = scan_of([(15.0, 0.0, 0.25, 1.75)])
    scan.ranges[np.random.default_rng(3).random(len(scan.ranges)) < 0.02] = near
    found = part.step(0, STEP, {"scan": scan, "odometry": Odometry(STEP, SPEED, 0.0, 0.0), "edge": EDGE})
    assert (found["objects"].x > MACHINE.knife_x + 5.0).all()
