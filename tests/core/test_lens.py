"""Lens distortion: the formulas written out, and OpenCV where it is installed."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.lens import Lens
from swath.sensing.camera.pinhole import Pinhole

BROWN = (-0.28, 0.09, 0.0007, -0.0004, -0.012)
RATIONAL = (0.4, -0.1, 0.001, 0.002, 0.02, 0.75, -0.05, 0.03)
FISHEYE = (0.05, -0.012, 0.004, -0.001)
LENSES = {"brown": ("brown_conrady", BROWN), "rational": ("brown_conrady", RATIONAL)}
LENSES["fisheye"] = ("fisheye", FISHEYE)
FOCAL = {"brown": 500.0, "rational": 500.0, "fisheye": 250.0}


def camera(name):
    return Pinhole.centred(640, 480, FOCAL[name], Lens(*LENSES[name]))


@pytest.mark.parametrize("name", LENSES)
def test_rays_come_back_where_they_started(name):
    u, v = np.meshgrid(np.arange(640), np.arange(480))
    there = camera(name).project(camera(name).rays())
    np.testing.assert_allclose(there, np.stack([u, v], axis=-1), atol=1e-6)


def test_radial_and_tangential_terms_by_hand():
    """At x = 0.3, y = -0.2: r2 = 0.13."""
    k1, k2, p1, p2, k3 = BROWN
    x, y, r2 = 0.3, -0.2, 0.13
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    by_hand = (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )
    found = Lens("brown_conrady", BROWN).distorted([[2 * x, 2 * y, 2.0]])
    np.testing.assert_allclose(found[0], by_hand, rtol=1e-12)


def test_a_fisheye_counts_angles():
    theta = np.radians(60.0)
    k1, k2, k3, k4 = FISHEYE
    by_hand = theta * (1 + k1 * theta**2 + k2 * theta**4 + k3 * theta**6 + k4 * theta**8)
    found = Lens("fisheye", FISHEYE).distorted([[0.0, np.sin(theta), np.cos(theta)]])
    np.testing.assert_allclose(found[0], (0.0, by_hand), rtol=1e-12)
    even = Lens("fisheye", (0.0,) * 4)
    np.testing.assert_allclose(even.directions(np.array([[np.pi / 2, 0.0]])), [[1.0, 0.0, 0.0]], atol=1e-12)


@pytest.mark.parametrize("name", LENSES)
def test_opencv_projects_the_rays_onto_their_pixels(name):
    cv2 = pytest.importorskip("cv2")
    made = camera(name)
    rays = made.rays().reshape(-1, 1, 3) * 7.0
    matrix = np.array([[made.focal, 0, 319.5], [0, made.focal, 239.5], [0, 0, 1]])
    project = cv2.fisheye.projectPoints if name == "fisheye" else cv2.projectPoints
    found, _ = project(rays, np.zeros(3), np.zeros(3), matrix, np.array(LENSES[name][1]))
    u, v = np.meshgrid(np.arange(640), np.arange(480))
    assert np.abs(found.reshape(480, 640, 2) - np.stack([u, v], axis=-1)).max() < 0.05


@pytest.mark.parametrize(
    ("model", "numbers"), [("brown_conrady", (-0.9, 0, 0, 0, 0)), ("fisheye", (-0.5, 0, 0, 0))]
)
def test_a_picture_that_folds_is_refused(model, numbers):
    with pytest.raises(InputError, match="does not fold"):
        Pinhole.centred(160, 120, 62.5, Lens(model, numbers)).rays()


def test_coefficients_are_counted():
    with pytest.raises(InputError, match="expected 4 numbers: fisheye"):
        Lens("fisheye", (0.1,))
