"""The light of sun and sky against the formulas that its table is made of, and against itself."""

import numpy as np
import pytest

from swath.core.units import DEG
from swath.field.light import FILE, light
from swath.field.weather import Sun
from swath.sensing.camera.shading import FULL, Daylight, sun_direction
from tests.sensing.sky_light import sky_light


def test_the_table_is_what_its_command_makes():
    make = pytest.importorskip("docs.make.light")
    pytest.importorskip("pvlib")
    rows = [line[5:-1].split(", ") for line in FILE.read_text().splitlines() if line.startswith("  - [")]
    for row in rows[::5]:
        made = np.concatenate(make.of_sun_and_sky(float(row[0])))
        np.testing.assert_allclose(made, np.array(row[1:], dtype=float), rtol=2e-3, atol=1e-9)


@pytest.mark.parametrize(
    ("elevation", "klx", "sky"), [(10, 13, 0.53), (37, 67, 0.23), (57.285, 98, 0.18), (12, 15, 0.50)]
)
def test_a_summers_day_is_as_bright_as_spectra_say(elevation, klx, sky):
    found = light(elevation * DEG)
    assert found.lux == pytest.approx(1000.0 * klx, rel=0.08)
    assert found.sky[-2] / found.lux == pytest.approx(sky, abs=0.03)


def test_twilight_is_that_of_janiczek_and_deyoung():
    assert light(-6 * DEG).lux == pytest.approx(3.4, rel=0.02)
    assert light(0.0).lux == pytest.approx(758.0, rel=0.01)
    lux = [light(e * DEG).lux for e in np.linspace(-12, 90, 400)]
    assert (np.diff(lux) > 0.0).all()


def test_clouds_leave_what_kasten_and_czeplak_say_and_no_sun():
    for elevation in np.random.default_rng(3).uniform(-10, 90, 20) * DEG:
        clear = light(elevation)
        for cloud in (0.3, 0.7, 1.0):
            dull = light(elevation, cloud)
            np.testing.assert_allclose(dull.level, (1.0 - 0.75 * cloud**3.4) * clear.level, rtol=1e-12)
            assert (dull.sky >= 0.0).all()
        assert not dull.sun.any()


def test_evening_is_red_and_its_shadow_blue():
    noon, evening = (Daylight(Sun(0.0, e * DEG), 0.0) for e in (45, 12))
    assert noon.sun == pytest.approx(np.full(3, 1.0 / FULL))
    assert evening.sun[0] > 1.5 * evening.sun[2]
    assert evening.sky[2] > 1.5 * evening.sky[0]


@pytest.mark.parametrize("cloud", [0.0, 0.4, 1.0])
def test_the_sky_sends_the_light_that_it_gives_level_ground(cloud):
    """Integral of radiance times cosine over the hemisphere, finely, over pi."""
    for elevation in (2, 30, 70):
        day = Daylight(Sun(1.0, elevation * DEG), cloud)
        up, around = np.meshgrid(
            (np.arange(60) + 0.5) / 60, np.arange(0, 2 * np.pi, np.pi / 90), indexing="ij"
        )
        flat = np.sqrt(1 - up * up)
        ways = np.stack([flat * np.cos(around), flat * np.sin(around), up], axis=-1)
        sent = 2.0 * (day.sky_at(ways) * up[..., None]).mean(axis=(0, 1))
        np.testing.assert_allclose(sent, day.sky, rtol=0.02)
        level = day.on(np.array([[0.0, 0.0, 1.0]], np.float32), np.zeros(1))
        np.testing.assert_allclose(level, day.sky[None], rtol=1e-3)
        towards = day.sky_at(sun_direction(1.0, elevation * DEG))
        assert cloud == 1.0 or (towards > day.sky_at(np.array([0.0, 0.0, 1.0]))).all()


@pytest.mark.parametrize("seed", range(3))
def test_any_side_gets_the_light_of_the_half_space_before_it(seed):
    """Of drawn normals, suns and clouds: sky, ground by its reflectance, and the sun by its angle."""
    draw = np.random.default_rng(seed)
    cloud = draw.choice([0.0, 1.0, draw.uniform()])
    day = Daylight(Sun(draw.uniform(-4.0, 4.0), draw.uniform(-12.0, 90.0) * DEG), cloud)
    normals = draw.normal(size=(12, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    cosine = draw.uniform(0.0, 1.0, 12)
    wanted = [sky_light(day, n) + c * day.sun for n, c in zip(normals, cosine, strict=True)]
    np.testing.assert_allclose(day.on(normals.astype(np.float32), cosine), wanted, rtol=0.02)
