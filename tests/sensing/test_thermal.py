"""The thermal camera: Planck's law, the balance of surfaces, noise, and living things in the picture."""

from math import radians

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.field.solid.obstacles import POSTURES, SheetObstacle, load_obstacle, things_of
from swath.field.weather import KELVIN, Air, SiteWeather, Weather
from swath.sensing.camera import thermal
from swath.sensing.camera.pinhole import OPTICAL
from swath.sensing.mount import Mount
from swath.tools.scan.scan import write_picture
from tests.field.made_field import made_field
from tests.machine.machine_fakes import site

NIGHT = Weather(temperature_c=11, humidity_percent=90, wind_m_s=1, sun_azimuth_deg=60, sun_elevation_deg=-10)
NOON = Weather(temperature_c=25, wind_m_s=2, sun_azimuth_deg=180, sun_elevation_deg=57)
HEIGHT = 3.5


def air(draw):
    return Air(
        wind=(float(draw.uniform(0.0, 6.0)), 0.0),
        temperature=KELVIN + float(draw.uniform(5.0, 32.0)),
        humidity=float(draw.uniform(0.3, 1.0)),
        cloud=float(draw.uniform(0.0, 1.0)),
    )


def test_exitance_is_the_integral_of_plancks_law():
    """172.8 W/m2 at 300 K, 2.47 W/m2K at 20 deg C."""
    assert thermal.exitance(300.0) == pytest.approx(172.8, rel=0.002)
    assert thermal.exitance(293.65) - thermal.exitance(292.65) == pytest.approx(2.47, rel=0.002)
    kelvin = np.linspace(220.0, 400.0, 37)
    np.testing.assert_allclose(thermal.apparent(thermal.exitance(kelvin)), kelvin, atol=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_a_surface_gives_off_what_it_takes_in(seed):
    """The balance written down term by term, linear in Ts - Ta as far as long waves go."""
    draw, s = np.random.default_rng(seed), thermal.BOLTZMANN
    for _ in range(20):
        a, up = air(draw), float(draw.uniform(-0.3, 1.5))
        now, cosine = thermal.balance(a, up, 0.8), float(draw.uniform(0.0, 1.0))
        absorbed, e, lost = thermal.SOIL
        ts = float(now.surface(absorbed, e, lost, np.array(cosine)))
        net = absorbed * (now.sky + now.sun * cosine) + e * (now.down - s * a.temperature**4)
        given = (now.canopy + 4 * e * s * a.temperature**3) * (ts - a.temperature)
        assert given == pytest.approx((1 - lost) * net, abs=1e-6)
        skin, r = KELVIN + 35.0, 0.2
        ts = float(now.living(skin, r, 0.97, np.array(cosine)))
        net = thermal.SUN_ON_BODY * (now.sky + now.sun * cosine) + 0.97 * (now.down - s * a.temperature**4)
        given = (now.body + 4 * 0.97 * s * a.temperature**3) * (ts - a.temperature)
        assert given == pytest.approx(net + (skin - ts) / r, abs=1e-6)


@pytest.mark.parametrize(
    ("wind", "linear", "whole"), [(0.0, 38.3, 35.1), (1.0, 25.3, 24.3), (2.0, 15.1, 14.9)]
)
def test_how_much_warmer_straw_is_than_with_the_fourth_power(wind, linear, whole):
    """At noon, as docs/explanation/sensors.md and reference/levels.md say: 3.2 K in calm air, 1 K, 0.2 K."""
    air, up, s = Air(wind=(wind, 0.0), temperature=KELVIN + 25.0), radians(57.0), thermal.BOLTZMANN
    now = thermal.balance(air, up, 0.85)
    absorbed, e, lost = thermal.DRY
    light = absorbed * (now.sky + now.sun * np.sin(up)) + e * (now.down - s * now.air**4)
    assert float(now.surface(*thermal.DRY, np.array(np.sin(up)))) - now.air == pytest.approx(linear, abs=0.1)
    kelvin = now.air + np.linspace(0.0, 60.0, 60_001)
    given = now.canopy * (kelvin - now.air) + e * s * (kelvin**4 - now.air**4) - (1.0 - lost) * light
    assert kelvin[np.abs(given).argmin()] - now.air == pytest.approx(whole, abs=0.1)


def test_straw_is_warmer_by_day_and_colder_by_night_and_the_fawn_as_measured():
    """7 to 20 K at noon, 2 to 5 K below the air at night; the outside of a fawn 17 to 25 deg C at dawn."""
    noon = thermal.balance(Air(wind=(2.0, 0.0), temperature=KELVIN + 25.0), radians(57.0), 0.8)
    night = thermal.balance(Air(wind=(1.0, 0.0), temperature=KELVIN + 15.0, humidity=0.85), -0.2, 0.8)
    assert 7.0 < float(noon.surface(*thermal.DRY, np.array(0.8))) - noon.air < 20.0
    assert -5.0 < float(night.surface(*thermal.DRY, np.array(0.0))) - night.air < -2.0
    warm = load_obstacle("animal-fawn").warm
    assert (
        16.0
        < float(night.living(KELVIN + warm.skin, warm.insulation, warm.emissivity, np.array(0.0))) - KELVIN
        < 25.0
    )


def seen(weather, *things, **keys):
    return outputs_of(weather, *things, **keys)["image"]


def outputs_of(weather, *things, netd_mk=50.0, at=(7.0, 0.0), pitch=0.5, **keys):
    field = made_field()
    field.weather = SiteWeather(weather)
    setup = site(field)
    setup.bodies.set_things(things_of(things, field))
    params = thermal.Params(
        mount=Mount(at="axle", z_m=HEIGHT),
        width_px=80,
        height_px=60,
        focal_px=60.0,
        channels=("colour", "label", "instance", "raw"),
        netd_mk=netd_mk,
        **keys,
    )
    camera = thermal.ThermalCamera(params, setup)
    camera.reset(Stream(1, "camera"))
    return camera.picture_from(10**8, Pose.from_euler((at[0] - 5.0, at[1], HEIGHT), pitch=pitch) @ OPTICAL)


@pytest.mark.parametrize(("kind", "posture"), [("person", None), ("person", "lying"), ("animal", "fawn")])
def test_what_lives_is_warm_at_night_where_it_is_in_sight(kind, posture):
    thing = SheetObstacle(kind=kind, posture=posture, x_m=7.0, y_m=0.0)
    image = seen(NIGHT, thing)
    kelvin, own = image.raw[..., 0] / thermal.CENTIKELVIN, image.instance == 1
    if own.any():
        least = 4.0 if np.count_nonzero(own) > 20 else 2.0  # of a small one each pixel is part background
        assert kelvin[own].mean() > kelvin[~own & (image.label > 0)].mean() + least
    else:
        assert posture is not None  # it lies hidden in the crop


def test_the_warmest_pixel_has_a_share_of_what_lies_in_the_crop():
    """Of four persons that lie hidden: no other pixel is as warm, and the picture tells its scale."""
    found = 0
    for x in (0.6, 0.9, 1.2, 1.5):
        thing = SheetObstacle(kind="person", posture="lying", x_m=x, y_m=0.0)
        out = outputs_of(NIGHT, thing, netd_mk=0.0, at=(x, 0.0), samples_per_pixel=16, shares=True)
        image, share = out["image"], out["shares"].share.sum(axis=2)
        assert share.sum() == pytest.approx(out["boxes"].area.sum(), rel=1e-4)
        kelvin = image.raw[..., 0] / thermal.CENTIKELVIN
        if share.max() > 0.2:
            found += 1
            assert share.ravel()[kelvin.argmax()] > 0.5 * share.max()
        grey = image.black + (image.white - image.black) / 255.0 * image.colour[..., 0]
        inside = (image.colour[..., 0] > 0) & (image.colour[..., 0] < 255)
        assert np.abs(grey - kelvin)[inside].max() <= (image.white - image.black) / 255.0 + 0.01
        assert inside.any()
    assert found >= 2


def test_a_cold_sky_leaves_its_grey_to_the_ground():
    thing = SheetObstacle(kind="person", x_m=7.0, y_m=0.0)
    image = seen(NIGHT, thing, pitch=-0.1)
    grey, own, ground = image.colour[..., 0], image.instance == 1, image.label > 0
    assert own.any()
    assert (grey[~ground & ~own] < 20).mean() > 0.5, "sky"
    assert 10 < np.median(grey[ground & ~own]) < 160
    assert np.median(grey[own]) > np.median(grey[ground & ~own]) + 60


def test_a_scan_keeps_the_temperatures(tmp_path):
    image = seen(NIGHT, SheetObstacle(kind="person", x_m=7.0, y_m=0.0))
    with np.load(write_picture(tmp_path, image)[-1]) as kept:
        assert np.array_equal(kept["raw"], image.raw)
        assert np.array_equal(kept["instance"], image.instance)


@pytest.mark.parametrize("netd_mk", [20.0, 80.0])
def test_the_noise_is_the_netd(netd_mk):
    """Of two pictures of one scene, whose streams differ by time alone: near 300 K to a few percent."""
    warm = Weather(
        temperature_c=30, humidity_percent=100, cloud_percent=100, sun_azimuth_deg=0, sun_elevation_deg=-20
    )
    quiet, loud = (seen(warm, netd_mk=n).raw[..., 0].astype(float) for n in (0.0, netd_mk))
    spread = (loud - quiet).std() / thermal.CENTIKELVIN
    assert spread == pytest.approx(np.hypot(1e-3 * netd_mk, 0.01 / np.sqrt(6)), rel=0.08)


def test_the_sheets_of_postures_are_as_large_as_they_say():
    for kind, posture in POSTURES:
        sheet = load_obstacle(f"{kind}-{posture}")
        thing = SheetObstacle(kind=kind, posture=posture, x_m=0.0, y_m=0.0)
        (made,) = things_of([thing], made_field())
        s, low, high = made.solids, np.full(3, np.inf), np.full(3, -np.inf)
        rods = [
            (a, r) for ends in (s.capsule_a, s.capsule_b) for a, r in zip(ends, s.capsule_radius, strict=True)
        ]
        for middle, half in [*zip(s.ellipsoid_centre, s.ellipsoid_half, strict=True), *rods]:
            low, high = np.minimum(low, middle - half), np.maximum(high, middle + half)
        np.testing.assert_allclose(high - low, (sheet.length, sheet.width, sheet.height), rtol=0.12)
        assert (made.kind, made.warm) == (kind, sheet.warm)
    with pytest.raises(InputError, match="posture"):
        things_of([SheetObstacle(kind="person", posture="hare", x_m=0.0, y_m=0.0)], made_field())
