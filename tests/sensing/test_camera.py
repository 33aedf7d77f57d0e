"""The camera against the pinhole formula, closed forms of light and shadow, and single rays."""

from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.field.memory_layout import Organ, Solids
from swath.field.site_setup import Bodies
from swath.field.weather import Sun
from swath.rays.engine import RayCaster
from swath.record.digest import sample_bytes
from swath.runtime.assembly import assemble
from swath.scenario.scenario import parse_scenario
from swath.sensing.camera import depth, error, thermal
from swath.sensing.camera.pinhole import OPTICAL, Pinhole
from swath.sensing.camera.rays import Params, RaysCamera, diffraction_mtf, through_lens
from swath.sensing.camera.shading import COLOURS, Daylight, encode, linear
from swath.sensing.mount import Mount
from tests.sensing.sky_light import sky_light

TEXT = """
format: swath scenario 2
name: seen
seed: 5
run: {distance_m: 4, max_duration_s: 6}
field:
  terrain: {level: plane, slope_percent: 4, slope_azimuth_deg: 60}
  stand: {level: uniform, stems_per_m2: 150}
  edge: {shape: straight}
machines:
  combine:
    motion: single_track
    lidar: {sub_rays: 1, step_deg: 10}
    camera: {width_px: 64, height_px: 48}
"""
YAW, PITCH, ROLL = np.radians(100.0), np.radians(24.0), np.radians(-7.0)
EYE = np.array([-3.0, 12.0, 3.4])  # over the cut ground, x < 0
BESIDE = np.array([-1.0, 7.0, -1.8])


@cache
def site():
    """What a camera is told in a field whose crop stands at x > 0."""
    return assemble(parse_scenario(TEXT)).leader.parts["camera"].setup


def box(centre, half, yaw=0.3):
    axes = Pose.from_euler((0, 0, 0), yaw=yaw).rotation
    return Solids(
        box_centre=np.array([centre], dtype=float),
        box_axes=axes[None],
        box_half=np.array([half], dtype=float),
        box_reflectance=np.array([0.5]),
    )


def standing(solids):
    """The site with one more thing in it."""
    bodies = Bodies({"box": solids} if solids else {})
    return replace(site(), obstacles=solids or Solids(), bodies=bodies)


def camera(solids=None, threads=1, **keys):
    setup = standing(solids)
    made = RaysCamera(Params(**{"width_px": 160, "height_px": 120, "texture": False} | keys), setup)
    made.caster = RayCaster(setup.field, threads=threads)
    return made


def camera_of(level, solids, **keys):
    """A camera of any level with 160 x 120 pixels that span 60 deg, without distortion, noise and blur."""
    if level == "rays":
        return camera(solids, horizontal_fov_deg=60.0, **keys)
    setup = replace(standing(solids), base=Path(__file__).parent)
    if level == "depth":
        params = depth.Params(
            width_px=160,
            height_px=120,
            horizontal_fov_deg=60.0,
            channels=("depth", "label"),
            disparity_sd_px=0.0,
            disparity_step_px=0.0,
            disparity_min_px=0.01,
            holes=False,
        )
        made = depth.DepthCamera(params, setup)
    elif level == "thermal":
        size = {"width_px": 160, "height_px": 120, "horizontal_fov_deg": 60.0}
        made = thermal.ThermalCamera(thermal.Params(**size | keys), setup)
    else:
        made = error.ErrorCamera(
            error.Params(
                sensor="camera_60deg.yaml",
                binning=1,
                samples_per_pixel=1,
                distortion="none",
                noise="none",
                blur="none",
            ),
            setup,
        )
    made.reset(Stream(1, "combine.camera"))
    return made


def axes():
    """Right, down and forward of the camera in the world, by hand."""
    forward = np.array([np.cos(PITCH) * np.cos(YAW), np.cos(PITCH) * np.sin(YAW), -np.sin(PITCH)])
    right = np.array([np.sin(YAW), -np.cos(YAW), 0.0])
    down = np.cross(forward, right)
    return (  # roll > 0 lifts the left side: the right one goes down
        np.cos(ROLL) * right + np.sin(ROLL) * down,
        np.cos(ROLL) * down - np.sin(ROLL) * right,
        forward,
    )


def look(made, t=10**9):
    return made.image_from(t, Pose.from_euler(EYE, ROLL, PITCH, YAW) @ OPTICAL)


def rays_by_hand(width, height, focal):
    """Directions of all pixels in the world, with z = 1 along the axis, (height, width, 3)."""
    right, down, forward = axes()
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    x, y = (u - 0.5 * (width - 1)) / focal, (v - 0.5 * (height - 1)) / focal
    return x[..., None] * right + y[..., None] * down + forward


def box_by_hand():
    """A box, and where its corners appear in an image of 160 x 120 that spans 60 deg: u, v [px]."""
    centre, half, yaw = EYE + BESIDE, (0.5, 0.9, 0.4), 0.3
    signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3) * half
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    corners = centre + np.column_stack([signs[:, :2] @ turn.T, signs[:, 2]]) - EYE
    right, down, forward = axes()
    focal = 80.0 / np.tan(np.radians(30.0))
    u = focal * (corners @ right) / (corners @ forward) + 79.5
    v = focal * (corners @ down) / (corners @ forward) + 59.5
    return box(centre, half, yaw), u, v


def test_points_are_projected_by_the_formula():
    pinhole = camera(horizontal_fov_deg=60.0).pinhole
    focal = 80.0 / np.tan(np.radians(30.0))
    points = np.random.default_rng(1).uniform((-2, -2, 1), (2, 2, 5), (20, 3))
    by_hand = focal * points[:, :2] / points[:, 2:] + (79.5, 59.5)
    np.testing.assert_allclose(pinhole.project(points), by_hand, atol=1e-9)
    assert np.isnan(pinhole.project([0.0, 0.0, -1.0])).all()


def test_depth_of_the_ground_is_that_of_the_plane():
    made = camera()
    image = look(made)
    azimuth = np.radians(90.0 - 60.0)
    slope = 0.04 * np.array([np.cos(azimuth), np.sin(azimuth)])
    d = rays_by_hand(160, 120, made.pinhole.focal)
    expected = (EYE[2] - slope @ EYE[:2]) / (d[..., :2] @ slope - d[..., 2])
    ground = image.label == Organ.GROUND
    assert ground.sum() > 3000
    np.testing.assert_allclose(image.depth[ground], expected[ground], rtol=2e-5)
    assert np.isnan(image.depth[image.label == Organ.NONE]).all()
    assert (image.label == Organ.NONE).any()


def test_labels_and_depths_are_those_of_single_rays():
    solids = box(EYE + BESIDE, (0.5, 0.9, 0.4))
    one, four = camera(solids), camera(solids, samples_per_pixel=4)
    caster = RayCaster(site().field, threads=1)
    image = look(one)
    d = one.pinhole.rays().reshape(-1, 3) @ (Pose.from_euler(EYE, ROLL, PITCH, YAW) @ OPTICAL).rotation.T
    by_hand = rays_by_hand(160, 120, one.pinhole.focal).reshape(-1, 3)
    length = np.linalg.norm(by_hand, axis=1)
    np.testing.assert_allclose(d, by_hand / length[:, None], atol=1e-12)
    hits = caster.cast(np.tile(EYE, (len(d), 1)), d, range_max=60.0, solids=solids)
    assert len(np.unique(hits.organ)) >= 6
    # Two kernels: they agree on 99.9 % of rays that may graze, here on all on most machines.
    same = image.label.ravel() == hits.organ
    assert same.mean() >= 0.999
    np.testing.assert_allclose(image.depth.ravel()[same], (hits.distance / length)[same], rtol=1e-4)
    for i in range(0, len(d), 97):  # by the camera's own kernel a ray alone gives the very same
        alone = caster.cast_image(EYE, d[i][None, None], range_max=60.0, solids=solids)
        assert alone.organ[0, 0] == image.label.ravel()[i]
    # Four samples: what most of them show, of equals the nearest.
    own = four.pinhole.rays(2)
    d = own @ (Pose.from_euler(EYE, ROLL, PITCH, YAW) @ OPTICAL).rotation.T
    hits = caster.cast_image(EYE, d, range_max=60.0, solids=solids)
    depths = np.where(hits.is_hit, hits.distance * own[..., 2], np.inf)
    seen, mixed = look(four), 0
    for v, u in np.random.default_rng(1).integers(0, (120, 160), (3000, 2)).tolist():
        pixel = slice(2 * v, 2 * v + 2), slice(2 * u, 2 * u + 2)
        votes = Counter(hits.organ[pixel].ravel().tolist())
        best = [organ for organ, count in votes.items() if count == max(votes.values())]
        near, organ = min((depths[pixel][hits.organ[pixel] == o].min(), o) for o in best)
        mixed += len(best) > 1
        assert seen.label[v, u] == organ
        assert np.isnan(seen.depth[v, u]) if np.isinf(near) else seen.depth[v, u] == pytest.approx(near)
    assert mixed > 100


DAY = Daylight(Sun(np.radians(230.0), np.radians(50.0)), 0.0)


def bytes_of(organ, cosine, normal=(0.0, 0.0, 1.0)):
    """The colour of a surface in light and shadow, written out: linear, lit, and back to sRGB."""
    c = np.array(COLOURS[organ]) / 255.0
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    x = np.minimum(linear * (sky_light(DAY, normal) + DAY.sun * cosine), 1.0)
    return 255.0 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("shadows", [True, False])
def test_light_and_shadow_on_the_ground(shadows):
    """A lit plane has one colour; where the way to the sun leads through a box it has another."""
    centre, half = EYE + np.array([0.3, 9.0, -2.2]), np.array([1.0, 0.6, 0.2])
    made = camera(box(centre, half, 0.0), sun_azimuth_deg=230.0, sun_elevation_deg=50.0, shadows=shadows)
    image = look(made)
    azimuth, elevation = np.radians(90.0 - 230.0), np.radians(50.0)
    level = np.cos(elevation)
    sun = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    rise = np.radians(30.0)
    normal = np.array([-0.04 * np.cos(rise), -0.04 * np.sin(rise), 1.0])
    normal /= np.linalg.norm(normal)
    lit, dark = (bytes_of(Organ.GROUND, cosine, normal) for cosine in (sun @ normal, 0.0))
    ground = image.label == Organ.GROUND
    d = rays_by_hand(160, 120, made.pinhole.focal)[ground]
    points = EYE + image.depth[ground].astype(float)[:, None] * d
    near, far = np.sort([(centre - half - points) / sun, (centre + half - points) / sun], axis=0)
    gap = far.min(axis=1) - near.max(axis=1)
    colour = image.colour[ground].astype(float)
    is_lit, is_dark = (np.abs(colour - c).max(axis=1) <= 0.6 for c in (lit, dark))
    assert (is_lit | is_dark).all()
    shaded = gap > 0.01
    assert shaded.sum() > 60
    if shadows:
        assert is_dark[shaded].all()
    else:
        assert is_lit[shaded].mean() > 0.95
    assert is_lit[gap < -0.01].mean() > 0.5  # the rest of it lies in the shadow of stubble and crop
    is_top = np.abs(image.colour - bytes_of(Organ.SOLID, sun[2])).max(axis=2) <= 0.6
    assert (is_top & (image.label == Organ.SOLID)).sum() > 20


def test_one_and_two_threads_give_the_same_bytes():
    pose, solids = Pose.from_euler(EYE, ROLL, PITCH, YAW) @ OPTICAL, box(EYE + BESIDE, (0.5, 0.9, 0.4))
    made = [camera(solids, n, samples_per_pixel=4, shares=True).picture_from(10**9, pose) for n in (1, 2)]
    for name in made[0]:
        first, second = (sample_bytes("combine.camera", name, 10**9, outputs[name]) for outputs in made)
        assert first == second
    assert len(np.unique(made[0]["image"].colour)) > 50
    assert made[0]["shares"].share.any()


@pytest.mark.parametrize("per_side", [1, 2, 3, 4])
def test_samples_of_a_pixel_share_no_column_and_no_row(per_side):
    pinhole = Pinhole(5, 4, 7.0, 1.3, 2.1)
    rays = pinhole.rays(per_side)
    at = pinhole.focal * rays[..., :2] / rays[..., 2:] + (1.3, 2.1) + 0.5
    i, j = np.indices(at.shape[:2])
    np.testing.assert_array_equal(np.floor(at * per_side + 1e-9), np.stack([j, i], axis=-1))
    places = np.floor(at[:per_side, :per_side] * per_side**2 + 1e-9).reshape(-1, 2)
    np.testing.assert_array_equal(np.sort(places, axis=0), np.arange(per_side**2)[:, None].repeat(2, 1))


@pytest.mark.parametrize("seed", range(3))
def test_a_lens_keeps_the_contrast_that_its_mtf_says(seed):
    """A wave across pixels keeps the share 1 - (1 - mtf) sin^2(pi f); a flat picture is kept."""
    draw = np.random.default_rng(seed)
    mtf, wave, phase = draw.uniform(0, 1), draw.uniform(0, 0.5, 2), draw.uniform(0, 6)
    y, x = np.indices((40, 50))
    pattern = np.cos(2.0 * np.pi * (wave[0] * y + wave[1] * x) + phase)
    kept = np.prod(1.0 - (1.0 - mtf) * np.sin(np.pi * wave) ** 2)
    seen = through_lens(np.stack([1.0 + pattern, pattern], axis=-1), mtf)
    np.testing.assert_allclose(seen[1:-1, 1:-1, 0], (1.0 + kept * pattern)[1:-1, 1:-1], atol=1e-12)
    np.testing.assert_allclose(through_lens(np.full((3, 4), 2.5), mtf), 2.5)
    spot = np.zeros((9, 9))
    spot[4, 4] = 1.0
    assert through_lens(spot, mtf).sum() == pytest.approx(1.0)


@pytest.mark.parametrize(("wavelength", "f_number", "pixel"), [(10e-6, 1.0, 12e-6), (0.54e-6, 4.0, 3.45e-6)])
def test_diffraction_is_the_overlap_of_two_pupils(wavelength, f_number, pixel):
    """The OTF of a lens is the autocorrelation of its pupil, here by counting points of a disc."""
    shift = wavelength * f_number / pixel  # of one pupil, of radius 1, at the Nyquist frequency
    y, x = np.mgrid[-1:1:2001j, -1:1:2001j]
    disc = np.hypot(x, y) <= 1.0
    both = disc & (np.hypot(x - shift, y) <= 1.0)
    assert diffraction_mtf(wavelength, f_number, pixel) == pytest.approx(both.sum() / disc.sum(), abs=2e-3)
    assert diffraction_mtf(wavelength, f_number, 0.01 * pixel) == 0.0


@pytest.mark.parametrize("level", ["rays", "thermal"])
def test_shares_of_a_thing_add_up_to_its_area(level):
    made = camera_of(level, box(EYE + BESIDE, (0.5, 0.3, 0.4)), shares=True, samples_per_pixel=4)
    out = made.picture_from(10**9, Pose.from_euler(EYE, ROLL, PITCH, YAW) @ OPTICAL)
    boxes, share = out["boxes"], out["shares"].share
    assert share.shape == (120, 160, 1)
    assert share[[0, -1]].max() == share[:, [0, -1]].max() == 0.0
    assert boxes.area[0] > 50
    assert share.sum() == pytest.approx(boxes.area[0], rel=1e-5)
    assert (share >= 0).all()
    assert (share <= 1.0 + 1e-6).all()
    hard = out["image"].label == Organ.SOLID
    assert hard.sum() == pytest.approx(boxes.area[0], rel=0.1)
    assert share[..., 0][hard].min() > 0.2
    plain = camera_of(level, box(EYE + BESIDE, (0.5, 0.3, 0.4)))
    assert "shares" not in plain.picture_from(10**9, Pose.identity() @ made.optical)


def test_channels_by_choice():
    image = look(camera(channels=("label",)))
    assert image.label.shape == (120, 160)
    assert image.colour.size == image.depth.size == 0
    made = camera(channels=("colour",))
    assert look(made).colour.shape == (120, 160, 3)
    assert made.ray_count > 160 * 120
    with pytest.raises(ValueError, match="read-only"):
        image.label[0, 0] = 1


@pytest.mark.parametrize(
    ("sets", "expected"),
    [
        ("horizontal_fov_deg=200", "camera.horizontal_fov_deg = 200: expected <= 160"),
        ("width_px=0", "camera.width_px = 0: expected >= 1"),
        ("height_px=-3", "camera.height_px = -3: expected >= 1"),
        ("channels=[]", "camera.channels = .*: expected at least 1 item"),
        ("channels=[heat]", "camera.channels.*heat"),
        ("samples_per_pixel=3", "camera.samples_per_pixel = 3"),
        ("sun_elevation_deg=-13", "camera.sun_elevation_deg = -13: expected >= -12"),
        ("mount.z_m=-1", "camera.mount.z_m = -1.0: expected a sensor above the ground"),
    ],
)
def test_what_no_camera_can_be_is_refused_by_name(sets, expected):
    with pytest.raises(InputError, match=expected):
        assemble(parse_scenario(TEXT, sets=[f"combine.camera.{sets}"]))


def test_two_focal_lengths_and_too_many_pixels_are_refused():
    with pytest.raises(InputError, match=r"focal_px = 300\.0: expected no horizontal_fov_deg beside it"):
        camera(focal_px=300.0, horizontal_fov_deg=60.0)
    with pytest.raises(InputError, match="width_px = 4096: expected at most 10000000 samples"):
        camera(width_px=4096, height_px=4096)
    assert camera(focal_px=300.0).pinhole.focal == 300.0


def test_it_is_only_there_where_a_scenario_names_it():
    without = "\n".join(line for line in TEXT.splitlines() if "camera" not in line)
    assert "camera" not in assemble(parse_scenario(without)).leader.parts
    assert assemble(parse_scenario(TEXT)).leader.parts["camera"].params.mount == Mount()


def entry(eye, ways, low, high):
    """Distance along ways (n, 3) at which they enter a box of these corners, inf = they do not."""
    one, other = (low - eye) / ways, (high - eye) / ways
    first, last = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
    return np.where((first <= last) & (first > 0.0), first, np.inf)


@pytest.mark.parametrize("seed", range(4))
def test_the_machine_that_carries_it_is_seen_where_its_boxes_are(seed):
    draw, setup = np.random.default_rng(seed), site()
    place = {"x_m": draw.uniform(1.0, 3.0), "z_m": draw.uniform(4.2, 5.0), "y_m": draw.uniform(-1.0, 1.0)}
    mount = Mount(at="axle", pitch_deg=draw.uniform(20.0, 50.0), yaw_deg=draw.uniform(-180, 180), **place)
    size = {"width_px": 80, "height_px": 60, "mount": mount, "channels": ("depth", "instance")}
    made, plain = (RaysCamera(Params(**size, own_machine=own), setup) for own in (True, False))
    machine, pose = setup.machine, setup.bodies.pose_of("combine")
    image, before = (c.image_from(0, pose @ c.optical) for c in (made, plain))
    rear, front, half, bottom, top = machine.body
    depth, width = machine.header_depth, 0.5 * machine.header_width
    boxes = [[(rear, -half, bottom), (front, half, top)]]
    low = machine.knife_x - depth, machine.header_y - width, 0.1
    boxes += [[low, (machine.knife_x, machine.header_y + width, 0.1 + machine.header_height)]]
    ways = made.optical.turn(made.pinhole.rays(1)).reshape(-1, 3)
    eye = made.optical.position
    found = np.min([entry(eye, ways, *map(np.array, box)) for box in boxes], axis=0).reshape(60, 80)
    along = made.pinhole.rays(1)[..., 2]
    beyond = np.where(np.isnan(before.depth), np.inf, before.depth)
    is_own = found * along < beyond
    assert 0.02 < is_own.mean() < 1.0
    assert not before.instance.any()
    np.testing.assert_array_equal(image.instance > 0, is_own)
    np.testing.assert_allclose(image.depth[is_own], (found * along)[is_own], rtol=1e-4)


def test_bytes_of_light_go_up_where_srgb_says():
    steps = linear(np.arange(255) + 0.5)
    drawn = np.random.default_rng(3).uniform(-0.1, 1.1, 20_000)
    light = np.concatenate([steps, np.nextafter(steps, 0.0), linear(np.arange(256)), drawn])
    np.testing.assert_array_equal(encode(light), np.searchsorted(steps, np.clip(light, 0.0, 1.0), "right"))
