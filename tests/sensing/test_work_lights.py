"""Work lights against the closed form of a card, of a shadow, and of photons on a sensor."""

from dataclasses import replace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.units import DEG
from swath.field.light import light
from swath.field.memory_layout import Organ, Solids
from swath.field.site_setup import Bodies
from swath.sensing.camera import error
from swath.sensing.camera.lamps import WorkLight, irradiance_per_lux
from swath.sensing.camera.rays import Params, RaysCamera
from swath.sensing.camera.shading import COLOURS, WAVELENGTHS, bands, linear
from swath.sensing.mount import Mount
from swath.signals import MachineState
from tests.sensing.test_camera import site

UP = 20.0  # the machine of these tests flies [m], so that a card is alone
NIGHT = {"sun_elevation_deg": -12.0, "texture": False, "width_px": 24, "height_px": 18}
SOLID = linear(COLOURS[Organ.SOLID])


def card(distance, turn=0.0, half=(0.01, 6.0, 6.0), y=0.0):
    """A card whose middle lies so far ahead of a machine that flies level, turned about the upright [rad]."""
    axes = Pose.from_euler((0, 0, 0), yaw=turn).rotation
    centre = np.array([[distance, y, UP + 2.0]]) + 0.01 * axes[:, 0]
    return centre, axes[None], np.array([half])


def seen(cards, kind=RaysCamera, params=Params, **keys):
    """A camera at the origin of a machine, 2 m up, that looks forward, and what it sees, mean of samples."""
    centre, axes, half = (np.concatenate(part) for part in zip(*cards, strict=True))
    solids = Solids(
        box_centre=centre, box_axes=axes, box_half=half, box_reflectance=np.full(len(centre), 0.5)
    )
    setup = replace(site(), obstacles=solids, bodies=Bodies({"card": solids}))
    mount = Mount(at="axle", z_m=2.0, pitch_deg=0.0)
    made = kind(params(**NIGHT | {"mount": mount} | keys), setup)
    made.reset(Stream(1, "combine.camera"))
    sight = made.sight(0, Pose.from_euler((0.0, 0.0, UP)) @ made.optical)
    return made, sight, made.light(sight, 0)


@pytest.mark.parametrize("seed", range(8))
def test_a_card_is_lit_as_the_closed_form_says(seed):
    draw = np.random.default_rng(seed)
    distance, turn = draw.uniform(1.0, 20.0), draw.uniform(-60.0, 60.0) * DEG
    lamp = WorkLight(
        x_m=draw.uniform(-0.5, 0.5),
        y_m=draw.uniform(-1.0, 1.0),
        z_m=2.0 + draw.uniform(-1.0, 1.0),
        pitch_deg=draw.uniform(-20.0, 20.0),
        yaw_deg=draw.uniform(-20.0, 20.0),
        candela=draw.uniform(500.0, 50_000.0),
        beam_deg=draw.uniform(20.0, 120.0),
    )
    shadows = bool(seed % 2)
    made, sight, lit = seen([card(distance, turn)], work_lights=(lamp,), shadows=shadows)
    plain, _, dark = seen([card(distance, turn)])
    hit = sight.hits.organ == Organ.SOLID
    assert hit.mean() > 0.2
    day = made.daylight(0)
    without = dark[hit] * (plain.daylight(0).unit / day.unit)
    lux = (lit[hit] - without) / (SOLID * day.lux)
    points = sight.hits.distance[hit].astype(float)[:, None] * sight.directions[hit]  # of the camera
    away = points - (lamp.x_m, lamp.y_m, lamp.z_m - 2.0)
    d = np.linalg.norm(away, axis=1)
    pitch, yaw = lamp.pitch_deg * DEG, lamp.yaw_deg * DEG
    axis = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)])
    angle = np.degrees(np.arccos(away @ axis / d))
    incidence = np.abs(away @ (np.cos(turn), np.sin(turn), 0.0)) / d
    expected = lamp.candela * 0.5 ** ((2.0 * angle / lamp.beam_deg) ** 2) * incidence / d**2
    bright = expected > 1e-3 * expected.max()
    np.testing.assert_allclose(lux[bright], expected[bright, None].repeat(3, 1), rtol=1e-3)


def test_a_thing_between_lamp_and_card_throws_its_shadow():
    """Of a strip at half way, 0.4 m wide: twice as wide, on the other side of the lamp's foot."""
    lamp = WorkLight(y_m=1.0, z_m=2.0, pitch_deg=0.0)
    cards = [card(6.0), card(3.0, half=(0.01, 0.2, 6.0), y=-0.8)]
    _, sight, lit = seen(cards, work_lights=(lamp,), width_px=96)
    row = lit.shape[0] // 2
    at = sight.hits.distance[row] * sight.directions[row, :, 1]
    behind = sight.hits.distance[row] * sight.directions[row, :, 0] > 5.0
    expected = (at > -3.0) & (at < -2.2) & behind
    found = (lit[row, :, 1] < 0.05 * lit[row, :, 1].max()) & behind
    assert expected.sum() >= 4
    assert (found != expected)[np.minimum(abs(at + 3.0), abs(at + 2.2)) > 0.1].sum() == 0


def test_fog_takes_its_share_on_both_ways():
    lamp = (WorkLight(z_m=2.0, pitch_deg=0.0),)
    fog = replace(Params().weather, extinction_per_m=0.02)
    _, _, lit = seen([card(8.0)], work_lights=lamp)
    _, sight, less = seen([card(8.0)], work_lights=lamp, weather=fog)
    hit = sight.hits.organ == Organ.SOLID
    way = sight.hits.distance[hit].astype(float)
    assert hit.mean() > 0.2
    np.testing.assert_allclose(less[hit, 1] / lit[hit, 1], np.exp(-0.04 * way), rtol=0.02)


def test_an_exposed_picture_counts_the_photons_of_its_lux():
    """Twice the candela, twice the signal; the control exposes half as long; gain and time are the user's."""
    keys = {"noise": "none", "distortion": "none", "blur": "none", "width_px": 32, "height_px": 24}
    keys |= {"binning": 8, "channels": ("raw", "colour")}
    held, pose = [], Pose.from_euler((0.0, 0.0, UP))
    for candela in (20_000.0, 40_000.0):
        lamp = (WorkLight(z_m=2.0, pitch_deg=0.0, candela=candela),)
        for exposure in (2.0, None):
            made, _, _ = seen(
                [card(5.0)], error.ErrorCamera, error.Params, work_lights=lamp, exposure_ms=exposure, **keys
            )
            held.append((made, made.image_from(0, pose @ made.optical)))
    (sensor, one), (_, auto), (_, two), (_, auto_two) = held
    black = sensor.sheet.black_level
    ratio = (two.raw[..., 1].mean() - black) / (one.raw[..., 1].mean() - black)
    assert ratio == pytest.approx(2.0, rel=0.02)
    assert auto_two.exposure * auto_two.gain == pytest.approx(0.5 * auto.exposure * auto.gain, rel=0.02)
    assert 60 < auto.colour[..., 1].mean() < 220


def test_a_lux_of_a_lamp_is_like_one_of_the_sun():
    """Of the colours of a sun at 45 deg within 10 %, which has 5500 K, too."""
    sun = light(45.0 * DEG)
    np.testing.assert_allclose(irradiance_per_lux(WAVELENGTHS), bands(sun, sun.sun) / sun.sun[-2], rtol=0.1)


@pytest.mark.parametrize("high", [-12.0, -3.0, 40.0])
def test_the_light_that_a_level_was_checked_in_counts_them(high):
    lamps = WorkLight(candela=9000.0), WorkLight(candela=3600.0)
    for given, own in ((), 0.0), (lamps, 9000.0 / 36.0), (lamps[1:], 100.0):
        made, _, _ = seen([card(8.0)], work_lights=given, sun_elevation_deg=high)
        assert made.meets(MachineState(0, Pose.identity(), 0.0, 0.0, 0.0, 0.0, 0.0))[
            "light_lx"
        ] == pytest.approx(light(high * DEG).lux + own)
