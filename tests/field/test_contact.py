"""Distances of solids: against closed forms, against an independent optimiser, and what they cost."""

import numpy as np
import pytest
from scipy.optimize import minimize

from swath.core.frames import Pose
from swath.field.solid.contact import lower_bounds, nearest, overlaps, parts_of
from swath.field.solid.solids import box_on_ground, merge, mesh, moved, post, stone

RNG = np.random.Generator(np.random.Philox(11))


def at(solids, position, roll=0.0, pitch=0.0, yaw=0.0):
    return parts_of(moved(solids, Pose.from_euler(position, roll, pitch, yaw)))


def gap(a, b):
    return nearest(a, b).distance


def box(x, y, z):
    """A box around the origin."""
    return box_on_ground([0.0, 0.0, -0.5 * z], [x, y, z])


def capsule(length, radius):
    """Upright around the origin; length of the line."""
    return post([0.0, 0.0, -0.5 * length], length + radius, 2.0 * radius)


def mesh_box(x, y, z):
    """The surface of `box` as twelve triangles."""
    half = 0.5 * np.array([x, y, z])
    made = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (-1.0, 1.0):
            quad = np.zeros((4, 3))
            quad[:, axis] = side
            quad[:, u], quad[:, v] = [-1, 1, 1, -1], [-1, -1, 1, 1]
            made += [quad[[0, 1, 2]] * half, quad[[0, 2, 3]] * half]
    return mesh(np.array(made), Pose.identity())


def random_pose(spread):
    return Pose.from_euler(RNG.uniform(-spread, spread, 3), *RNG.uniform(-np.pi, np.pi, 3))


def test_boxes_face_to_face_edge_to_edge_and_corner_to_corner():
    a = at(box(2, 2, 2), [0, 0, 0])
    assert gap(a, at(box(2, 4, 6), [2.5, 0.3, 1.0])) == pytest.approx(0.5, abs=1e-3)
    turned = at(box(2, 2, 2), [1.0 + np.sqrt(2.0) + 0.7, 0, 0], yaw=np.pi / 4)
    assert gap(a, turned) == pytest.approx(0.7, abs=1e-3)
    assert gap(a, at(box(2, 2, 2), [5.0, 6.0, 0.0])) == pytest.approx(5.0, abs=1e-3)
    assert gap(a, at(box(2, 2, 2), [3.0, 3.0, 3.0])) == pytest.approx(np.sqrt(3.0), abs=1e-3)
    assert gap(a, at(box(2, 2, 2), [1.999, 0.5, 0.2])) == 0.0
    assert gap(a, at(box(0.1, 0.1, 0.1), [0.2, 0.1, 0.0])) == 0.0  # one inside the other


def test_spheres_and_capsules_have_closed_forms():
    ball, a = stone([0, 0, 0], [1.0, 1.0, 1.0]), at(box(2, 2, 2), [0, 0, 0])
    for place, expected in (
        ([3.0, 0.2, -0.4], 1.5),
        ([2.0, 2.0, 0.5], np.sqrt(2.0) - 0.5),
        ([2.0, 2.0, 2.0], np.sqrt(3.0) - 0.5),
        ([1.3, 0.0, 0.0], 0.0),
    ):
        assert gap(a, at(ball, place, 0.3, 1.0, -2.0)) == pytest.approx(expected, abs=1e-3)
    pole = capsule(4.0, 0.25)
    assert gap(a, at(pole, [2.0, 0.0, 0.0])) == pytest.approx(0.75, abs=1e-3)
    assert gap(a, at(pole, [4.0, 0.0, 0.0], pitch=np.pi / 2)) == pytest.approx(0.75, abs=1e-3)
    assert gap(a, at(pole, [2.0, 2.0, 0.0])) == pytest.approx(np.sqrt(2.0) - 0.25, abs=1e-3)
    assert gap(at(pole, [0, 0, 0]), at(pole, [1.0, 0, 1.0], roll=0.0)) == pytest.approx(0.5, abs=1e-3)
    assert gap(at(pole, [0, 0, 0]), at(pole, [0.4, 0.3, 0], roll=np.pi / 2)) == 0.0
    a, b = RNG.uniform(-2, 2, (2, 3))
    balls = at(ball, a), at(stone([0, 0, 0], [0.6, 0.6, 0.6]), b)
    assert gap(*balls) == pytest.approx(max(np.linalg.norm(a - b) - 0.8, 0.0), abs=1e-3)


def smooth_distance(first, second):
    """Distance of two solids by a general optimiser over coordinates inside each of them."""
    (ca, aa, ha, ka), (cb, ab, hb, kb) = first, second

    def point(c, axes, half, kind, s):
        """The point and its derivative, (3, 3)."""
        inner, size = np.eye(3), np.linalg.norm(s)
        if kind == "ellipsoid" and size > 1.0:
            s = s / size
            inner = (inner - np.outer(s, s)) / size
        return c + axes @ (half * s), axes @ (half[:, None] * inner)

    def cost(v):
        (p, along_p), (q, along_q) = point(ca, aa, ha, ka, v[:3]), point(cb, ab, hb, kb, v[3:])
        d = p - q
        return d @ d, 2.0 * np.concatenate([d @ along_p, -d @ along_q])

    options = {"jac": True, "bounds": [(-1, 1)] * 6, "method": "L-BFGS-B"}
    options["options"] = {"ftol": 1e-15, "gtol": 1e-10}
    starts = (np.zeros(6), RNG.uniform(-1, 1, 6), RNG.uniform(-1, 1, 6))
    results = [minimize(cost, start, **options) for start in starts]
    return np.sqrt(min(r.fun for r in results))


@pytest.mark.draws
@pytest.mark.parametrize("kinds", [("box", "box"), ("box", "ellipsoid"), ("ellipsoid", "ellipsoid")])
def test_distances_are_those_that_an_optimiser_finds(kinds):
    made = {
        "box": lambda: box(*RNG.uniform(0.2, 3.0, 3)),
        "ellipsoid": lambda: stone([0, 0, 0], RNG.uniform(0.3, 3.0, 3)),
    }
    apart = 0
    for _ in range(60):
        a, b = (parts_of(moved(made[k](), random_pose(2.5))) for k in kinds)
        told = [(p.centre[0], p.axes[0], p.half[0], p.kind[0]) for p in (a, b)]
        expected = smooth_distance(*told)
        found = gap(a, b)
        assert found == pytest.approx(expected, abs=3e-3)
        assert lower_bounds(a, b)[0, 0] <= expected + 1e-3
        assert bool(overlaps(a, b)) == (found == 0.0)
        assert gap(b, a) == pytest.approx(found, abs=1e-3)
        apart += found > 0.0
    assert 10 < apart < 60


def test_a_mesh_is_as_far_as_the_solid_it_shows():
    for _ in range(60):
        size, pose = RNG.uniform(0.3, 2.0, 3), random_pose(2.5)
        solid, surface = (parts_of(moved(kind(*size), pose)) for kind in (box, mesh_box))
        for other in (box(1.0, 5.0, 0.5), capsule(2.0, 0.1), stone([0, 0, 0], [1.0, 0.5, 0.4])):
            there = parts_of(moved(other, random_pose(1.5)))
            if gap(solid, there) > 0.0:
                assert gap(surface, there) == pytest.approx(gap(solid, there), abs=1e-3)
                assert gap(there, surface) == pytest.approx(gap(solid, there), abs=1e-3)
        there = pose @ Pose.from_euler([2.0, 1.0, 3.0], 0.3, 0.2, 0.1)
        twin, its_surface = (parts_of(moved(kind(1.0, 2.0, 1.0), there)) for kind in (box, mesh_box))
        assert gap(surface, its_surface) == pytest.approx(gap(solid, twin), abs=1e-3)
        assert gap(surface, twin) == pytest.approx(
            gap(solid, parts_of(moved(box(1.0, 2.0, 1.0), pose @ Pose.from_euler([2, 1, 3], 0.3, 0.2, 0.1)))),
            abs=1e-3,
        )


def test_a_fine_mesh_gives_the_distance_of_its_nearest_triangle():
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 81), np.linspace(0, np.pi, 41))
    ball = np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], axis=-1)
    a, b, c, d = ball[:-1, :-1], ball[1:, :-1], ball[1:, 1:], ball[:-1, 1:]
    corners = np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])
    surface = mesh(corners, Pose.identity())
    for _ in range(30):
        pose = random_pose(4.0)
        there = at(box(1.0, 9.0, 1.0), [0, 0, 0])
        expected = gap(parts_of(moved(stone([0, 0, 0], [2, 2, 2]), pose)), there)
        if 0.01 < expected < 4.9:
            assert gap(parts_of(moved(surface, pose)), there) == pytest.approx(expected, abs=0.004)


def test_the_point_of_an_overlap_lies_in_both():
    a, b = at(box(4, 4, 1), [0, 0, 0]), at(capsule(3.0, 0.2), [1.0, -1.5, 0.5], 0.2, 0.1)
    (found,) = overlaps(a, b)
    assert np.abs(found.point).max() <= 2.0 + 1e-6
    assert abs(found.point[2]) <= 0.5 + 1e-6
    along = (np.array(found.point) - b.centre[0]) @ b.axes[0]
    assert np.hypot(along[0], along[1]) <= 0.2 + 1e-6
    assert overlaps(a, at(capsule(3.0, 0.2), [2.3, 0, 0])) == []


def test_far_bodies_have_a_lower_bound_and_nothing_has_no_distance():
    a = at(box(2, 2, 2), [0, 0, 0])
    far = nearest(a, at(box(2, 2, 2), [30.0, 40.0, 0.0], yaw=0.7)).distance
    assert 45.0 < far <= 50.0 - 2.0
    assert nearest(a, parts_of(merge())) is None


def test_the_nearest_of_three_machines_and_ten_obstacles():
    machine = merge(
        box_on_ground([-1.5, 0, 0.6], [7, 3.2, 3.3]), box_on_ground([3.2, 0.2, 0.1], [1.5, 9, 1.2])
    )
    me = at(machine, [0, 0, 0])
    around = [moved(machine, Pose.from_euler([-3.0, 12.0, 0.0], yaw=0.1))]
    around += [moved(machine, Pose.from_euler([40.0, -9.0, 0.0], yaw=0.1))]
    around += [post([6.0 + 5 * i, 2.0 * i, 0.0], 2.0, 0.15) for i in range(10)]
    found = nearest(me, parts_of(merge(*around)))
    assert 1.9 < found.distance < 2.1
