"""Box level `stereo` against the truth by day and at dusk, where it sees nothing, and its parts alone.

Stations, headings, fills, light and seeds here are others than those that the level was made with.
"""

import numpy as np
import pytest

from swath.control.box.picture_edges import noise_of
from swath.control.box.plane_sweep import correlation, grain_points, surface
from swath.control.box.rim_fit import Rim
from swath.control.box.view import OPTICAL, View
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.lens import Lens
from swath.sensing.camera.daylight import illuminance, sunlight
from tests.control.box_rig import cameras, errors, look


@pytest.mark.parametrize(
    ("air", "fill", "ahead", "left", "heading"),
    [("", 0.43, 0.9, 8.5, 4.0), (", sun_elevation_deg: -2.5", 1.05, -0.8, 8.7, -2.0)],
)
def test_rim_and_grain(air, fill, ahead, left, heading):
    """By day, and in twilight at 124 lx: rim within 0.10 m and 1 deg, grain within 0.10 m or not seen."""
    seen, truth = look(sees=cameras(air), fill=fill, ahead=ahead, left=left, heading=heading, seed=31)
    assert seen.is_seen
    along, across, high, turn, grain, share = errors(seen, truth)
    assert max(abs(along), abs(across), abs(high)) <= 0.10
    assert abs(turn) <= 1.0
    assert grain <= 0.10
    assert share >= 0.5
    assert np.nanmax(seen.freeboard - truth.freeboard) <= 0.15  # no room that is not there


@pytest.mark.parametrize("air", [", sun_elevation_deg: -7", ", weather: {extinction_per_m: 1.2}"])
def test_not_seen_where_noise_is_stronger_than_contrast(air):
    """At 1.1 lx, and in dense dust."""
    assert not look(sees=cameras(air), fill=0.43, ahead=0.9, left=8.5, seed=31)[0].is_seen


def test_two_cameras_are_needed():
    with pytest.raises(InputError, match="expected two cameras"):
        look(sees=(cameras()[0], "combine.box={level: stereo}"))


def test_light_of_twilight():
    """Published: 585-410 lx as the sun has set, 3.5-2 lx at the end of civil twilight (AMS Glossary)."""
    assert 410.0 < illuminance(np.radians(-0.83)) < 585.0
    assert 2.0 < illuminance(np.radians(-6.0)) < 3.5
    assert illuminance(np.radians(45.0)) == pytest.approx(78e3, rel=0.01)
    below = [sunlight(np.radians(e)) for e in (0.0, -3.0, -6.0, -12.0)]
    assert below == sorted(below, reverse=True)
    assert below[0] == pytest.approx(sunlight(np.radians(0.5)), rel=0.1)
    assert sunlight(np.radians(-3.0), 1.0) < 0.5 * sunlight(np.radians(-3.0))


def test_noise_of_a_picture():
    """Half of it is texture, ten times as strong as the noise."""
    rng = np.random.default_rng(2)
    picture = 100.0 + 2.0 * rng.standard_normal((256, 320))
    picture[:128] += 20.0 * rng.standard_normal((128, 320))
    assert noise_of(picture) == pytest.approx(2.0, rel=0.1)


def waves(points):
    """A texture in the plane, wavelengths of 9 to 60 cm."""
    x, y = points[..., 0], points[..., 1]
    return 100.0 + sum(
        4.0 * np.sin((2.0 * np.pi / size) * (np.cos(turn) * x + np.sin(turn) * y) + 7.0 * turn)
        for size, turn in ((0.09, 0.2), (0.13, 1.1), (0.21, 2.3), (0.34, 0.7), (0.6, 2.9))
    )


def seen_by_pinholes(top, slope):
    """Points of textured grain that falls from its middle line to both sides, in a box of 3 x 2 m."""
    views, pictures = [], []
    rng = np.random.default_rng(6)
    for x in (-0.3, 0.4):
        mounting = Pose.from_euler([x, -3.0, 6.5], 0.0, np.radians(50.0), np.radians(90.0))
        view = View(mounting @ OPTICAL, 400, 320, 260.0, 199.5, 159.5, Lens())
        rays, eye = view.rays(), view.pose.position
        ways = []
        for side in (-1.0, 1.0):  # below both planes the ray is in the grain
            falls = rays[..., 2] + side * slope * rays[..., 1]
            ways.append((top - eye[2] - side * slope * eye[1]) / np.minimum(falls, -1e-3))
        views.append(view)
        places = eye + np.maximum(*ways)[..., None] * rays
        pictures.append(waves(places) + 0.5 * rng.standard_normal((320, 400)))
    rim = Rim(0.0, 0.0, 0.0, 3.5, (0.01,) * 3, 0.02, 4, 1.0)
    return grain_points(tuple(pictures), tuple(views), rim, 3.0, 2.0)


def test_the_ridge_of_a_heap_between_two_pinholes():
    """A level square of 0.33 m alone tells it tan(20 deg) / 4 * 0.33 m = 3.0 cm too low."""
    points = seen_by_pinholes(3.6, np.tan(np.radians(20.0)))
    ridge = points[np.abs(points[:, 1]) < 0.02]
    assert len(ridge) > 50
    assert np.median(ridge[:, 2]) == pytest.approx(3.6, abs=0.025)
    off = points[:, 2] - 3.6 + np.tan(np.radians(20.0)) * np.abs(points[:, 1])
    assert np.percentile(np.abs(off), 90.0) < 0.03


def test_a_level_surface_between_two_pinholes():
    """Texture on a plane 0.62 m below the rim, pictures by the pinhole formula: its height within 1 cm."""
    points = seen_by_pinholes(2.88, 0.0)
    assert len(points) > 1500
    assert np.median(points[:, 2]) == pytest.approx(2.88, abs=0.01)
    assert np.percentile(np.abs(points[:, 2] - 2.88), 90.0) < 0.03
    hidden = -1.0 + 0.62 * 2.0 / (6.5 - 3.5)  # below the near wall's rim, seen from 2 m before it
    assert points[:, 1].min() > hidden - 0.03


def test_correlation_of_noise_and_of_the_same():
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((2, 60, 60))
    assert np.abs(correlation(a, b, 0.0)[10:-10, 10:-10]).max() < 0.5
    assert correlation(a, 3.0 * a + 1.0, 0.0)[10:-10, 10:-10].min() > 0.999
    assert (correlation(a, a, 4.0)[10:-10, 10:-10] == -1.0).all()


def test_a_patch_at_another_height_is_no_grain():
    heights = np.full((60, 40), 1.0)
    heights[40:55, 10:30] = 1.6
    found = surface(heights)
    assert found[:35].all()
    assert not found[42:53, 12:28].any()
