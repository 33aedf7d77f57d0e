"""Blur, shutter, exposure, air, depth error and instances of cameras against closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.field.light import light as clear_light
from swath.field.maps.projection import Origin
from swath.field.maps.raster import Raster
from swath.field.memory_layout import Organ, Solids
from swath.field.plume import Puffs
from swath.field.site_setup import Bodies, SiteSetup
from swath.field.solid.obstacles import SheetObstacle, things_of
from swath.field.solid.solids import mesh
from swath.field.stand import maps
from swath.field.weather import Sun
from swath.sensing.camera import depth, error, rays
from swath.sensing.camera.rays import USUAL_SUN
from swath.sensing.camera.shading import Daylight, linear
from swath.sensing.echo import Weather
from swath.sensing.mount import Mount
from swath.signals import OBSTACLE_KINDS, MachineState
from tests.field.made_field import made_field
from tests.field.test_plume import summed
from tests.field.test_solids import MACHINE
from tests.sensing.sky_light import sky_light

SPEED, EXPOSURE = 2.0, 10e-3
HERE = Path(__file__).parent
MOUNT = Mount(at="axle", z_m=1.5, pitch_deg=0.0, yaw_deg=90.0)


def wall(y, x0, x1, z0=0.0, z1=4.0, reflectance=0.3):
    """A wall along x, seen from y = 0."""
    a, b, c, d = (x0, y, z0), (x1, y, z0), (x1, y, z1), (x0, y, z1)
    return mesh(np.array([[a, b, c], [a, c, d]]), Pose.identity(), reflectance)


def site(**solids):
    field = made_field(stand=maps.Params(stems_per_m2=1))
    return SiteSetup(
        field, MACHINE, Pose.identity(), "left", 0.1, "combine", base=HERE, bodies=Bodies(solids)
    )


def driving(speed=SPEED, yaw_rate=0.0):
    """States of the last 0.1 s before t = 1 s, through x = 0 at 1 s."""
    return tuple(
        MachineState(t, Pose.from_euler((speed * (t * 1e-9 - 1.0), 0, 0)), speed, 0.0, yaw_rate, 0.0, 0.0)
        for t in range(900_000_000, 1_000_000_001, 5_000_000)
    )


def camera(setup, **keys):
    usual = {"sensor": "camera_60deg.yaml", "binning": 1, "mount": MOUNT, "texture": False, "noise": "none"}
    usual |= {"distortion": "none", "shadows": False, "channels": ("raw", "label", "instance", "depth")}
    made = error.ErrorCamera(error.Params(**usual | keys), setup)
    made.reset(Stream(3, "combine.camera"))
    return made


def unlit(colour):
    """sRGB under the overcast sky of a sun at 45 deg."""
    light = linear(colour) * Daylight(USUAL_SUN, 1.0).sky
    return 255.0 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def edge_profile(image):
    """Brightness across the end of a wall, from 0 to 1, mean of the middle rows."""
    rows = image.raw[40:60, :, 0].astype(float).mean(axis=0)
    return rows


def test_blur_is_as_wide_as_the_way_in_the_picture():
    """f v t / z: 138.6 px, 2 m/s, 20 ms, 0.9 m: 6.16 px in 16 steps; the second moment is that of a box."""
    z = 0.9
    setup = site(wall=wall(z, -9.0, 0.0))
    widths = []
    for speed in (0.0, SPEED):
        made = camera(
            setup,
            samples_per_pixel=16,
            exposure_ms=20.0,
            cloud_percent=100.0,
            sensor="camera_60deg_global.yaml",
        )
        image = made.picture(10**9, driving(speed))["image"]
        profile = edge_profile(image)
        slope = np.abs(np.diff(profile[60:100]))
        place = np.arange(len(slope)) + 0.5
        slope = np.where(slope > 0.02 * slope.max(), slope, 0.0)
        middle = (slope * place).sum() / slope.sum()
        widths.append((slope * (place - middle) ** 2).sum() / slope.sum())
    expected = np.hypot(made.pinhole.focal * SPEED * 0.02 / z, 1.0)  # and the pixel's own width
    assert np.sqrt(12.0 * (widths[1] - widths[0])) == pytest.approx(expected, rel=0.05)


def test_rolling_rows_see_a_driving_camera_later():
    """An upright edge leans: between two rows of a picture lie row time x speed x f / z pixels."""
    z = 3.0
    setup = site(wall=wall(z, -9.0, 0.0, z1=9.0))
    made = camera(setup, samples_per_pixel=1, exposure_ms=0.01, channels=("instance", "raw"))
    seen = made.picture(10**9, driving())["image"].instance > 0
    rows = np.array([5, 55])
    edges = [np.flatnonzero(np.diff(seen[r].astype(int)))[0] for r in rows]
    lean = 50 * (30e-3 / 119) * SPEED * made.pinhole.focal / z
    assert abs(edges[1] - edges[0]) == pytest.approx(lean, abs=1.0)
    still = made.picture(10**9, driving(speed=0.0))["image"].instance > 0
    assert len({np.flatnonzero(np.diff(still[r].astype(int)))[0] for r in rows}) == 1


@pytest.mark.parametrize(
    ("sensor", "exposure"), [("camera_60deg_global.yaml", 20.0), ("camera_60deg.yaml", 0.05)]
)
def test_a_thing_that_goes_is_smeared_as_by_a_camera_that_drives(sensor, exposure):
    """Blur and lean depend on the way between both alone: a wall that goes by a standing camera, and the same
    one that stands beside a driving camera, are the same picture."""
    z, keys = 0.9, {"samples_per_pixel": 8, "exposure_ms": exposure, "sensor": sensor}

    def wide():
        return wall(z, -9.0, 0.0, z1=9.0)

    drives = camera(site(wall=wide()), **keys).picture(10**9, driving())["image"]
    beside = site()
    beside.bodies.add("wall", wide(), Pose.identity(), is_machine=False)
    stays = camera(beside, **keys).picture(10**9, driving(speed=0.0))["image"]
    beside.bodies.place("wall", Pose.identity(), np.array([-SPEED, 0.0, 0.0]))
    goes = camera(beside, **keys).picture(10**9, driving(speed=0.0))["image"]
    rows = slice(10, 60)  # above the ground, which stands still before one camera only
    assert (goes.raw[rows] == drives.raw[rows]).mean() > 0.999
    np.testing.assert_array_equal(goes.instance[rows], drives.instance[rows])
    assert (goes.raw[rows] != stays.raw[rows]).sum() > 100  # 50 rows, some px each


def test_what_stands_before_a_thing_that_goes_hides_it_and_stays_sharp():
    setup = site(post=wall(0.5, -0.05, 0.05, z1=9.0))
    setup.bodies.add("wall", wall(0.9, -9.0, 0.2, z1=9.0), Pose.identity(), is_machine=False)
    keys = {"samples_per_pixel": 16, "exposure_ms": 20.0, "sensor": "camera_60deg_global.yaml"}
    stays, goes = (
        camera(setup, **keys).picture(10**9, driving(speed=0.0))["image"]
        for velocity in (0.0, SPEED)
        if setup.bodies.place("wall", Pose.identity(), np.array([velocity, 0.0, 0.0])) is None
    )
    assert set(goes.instance[30].tolist()) == {0, 1, 2}
    np.testing.assert_array_equal(goes.instance == 1, stays.instance == 1)
    assert (goes.raw[30] != stays.raw[30]).any()


@pytest.mark.parametrize(("elevation", "ms"), [(0.5, 1.0), (30.0, 0.05), (89.0, 0.1)])
def test_numbers_are_those_of_the_radiometry(elevation, ms):
    """A wall towards the sun: FULL cancels, E tau / (4 N^2) photons, eta, K, by hand."""
    setup = site(wall=wall(3.0, -9.0, 9.0, z1=9.0))
    made = camera(
        setup, samples_per_pixel=1, exposure_ms=ms, sun_azimuth_deg=180.0, sun_elevation_deg=elevation
    )
    image = made.image_from(10**9, made.optical)
    middle = float(image.raw[59:61, 79:81, 0].mean())
    share = linear((140, 146, 154))  # paint of a thing of no kind
    high = np.radians(elevation)
    light, waves = clear_light(high), (620e-9, 540e-9, 460e-9)
    day = Daylight(Sun(np.pi, high), 0.0)
    sky = sky_light(day, [0.0, -1.0, 0.0]) / day.sky  # of that on level ground
    lit = np.array(
        [light.at(w, light.sky * s + light.sun * np.cos(high)) for w, s in zip(waves, sky, strict=True)]
    )
    irradiance = 100.0 * lit * 0.9 / (4 * 4.0**2) * share
    photons = sum(irradiance * np.array([620e-9, 540e-9, 460e-9])) * 1e-10 * ms * 1e-3 / 1.98644586e-25
    assert middle == pytest.approx(30 + 0.2 * (0.5 * photons + 40 * ms * 1e-3), rel=2e-3, abs=1.0)
    corner = float(image.raw[0, 0, 0]) - 30.0
    cosine = made.pinhole.rays()[0, 0, 2]
    assert corner / (middle - 30.0) == pytest.approx(cosine**4, rel=0.02)


def test_exposure_follows_the_light():
    """The first picture is exposed as it would settle; after a step of the light the mean comes back."""
    setup = site(wall=wall(3.0, -9.0, 9.0, z1=9.0))
    made = camera(setup, samples_per_pixel=1, noise="data_sheet", target_percent=18.0)
    states = driving(speed=0.0)

    def share(image):
        return float((image.raw.astype(float) - 30.0).mean() / (4095 - 30))

    first = made.picture(10**9, states)["image"]
    assert share(first) == pytest.approx(0.18, rel=0.03)
    made._rate = made._rate / 8.0  # a cloud of three stops
    means = [share(made.picture((k + 2) * 10**9, states)["image"]) for k in range(8)]
    assert means[0] == pytest.approx(0.18 / 8, rel=0.05)
    stops = np.log2(0.18 / np.array(means[:4]))
    np.testing.assert_allclose(stops[1:], 0.5 * stops[:3], atol=0.1)
    assert means[-1] == pytest.approx(0.18, rel=0.05)
    saved = made.save()
    after = made.picture(20 * 10**9, states)["image"]
    made.load(saved)
    again = made.picture(20 * 10**9, states)["image"]
    assert (after.raw == again.raw).all()


@pytest.mark.parametrize("extinction", [0.05, 0.3])
def test_dust_takes_light_as_koschmieder_says(extinction):
    params = {"width_px": 40, "height_px": 30, "mount": MOUNT, "texture": False, "channels": ("colour",)}
    wide = 30.0
    for z in (4.0, 12.0):
        setup = site(wall=wall(z, -wide, wide, z1=30.0))
        clear, dusty = (
            rays.RaysCamera(rays.Params(**params, weather=Weather(extinction_per_m=b)), setup)
            for b in (0.0, extinction)
        )
        horizon = Daylight(USUAL_SUN, 0.0).sky_at(clear.optical.rotation[:, 2] * [1, 1, 0])
        before, after = (linear(c.image_from(10**9, c.optical).colour[15, 20]) for c in (clear, dusty))
        left = np.exp(-extinction * z)
        np.testing.assert_allclose(after, left * before + (1 - left) * horizon, rtol=0.02, atol=2e-3)
    with pytest.raises(InputError, match=r"near_returns = 1\.0: expected 0 for a camera"):
        rays.RaysCamera(rays.Params(weather=Weather(near_returns=1.0)), setup)


def test_dust_of_a_machine_dims_each_pixel_by_what_lies_before_it():
    """Puffs of 3 m before a wall 12 m away: along each ray the sum of their Gaussians, in steps of 1 cm."""
    setup = site(wall=wall(12.0, -30.0, 30.0, z1=30.0))
    puffs = Puffs("C", start=3.0)
    puffs.emit((1.0, 6.0, 1.5), 2.0)
    params = {"width_px": 40, "height_px": 30, "mount": MOUNT, "texture": False, "channels": ("colour",)}
    made = rays.RaysCamera(rays.Params(**params), setup)
    before = linear(made.image_from(10**9, made.optical).colour)
    setup.field.plumes["combine"] = puffs
    after = linear(made.image_from(10**9, made.optical).colour)
    setup.field.plumes.clear()
    ways = made.optical.turn(made.pinhole.rays())
    day = Daylight(USUAL_SUN, 0.0)
    for row, column in ((15, 20), (3, 37), (26, 11)):
        way = ways[row, column]
        length = min((12.0 - made.optical.position[1]) / way[1], 1.5 / max(-way[2], 1e-9))
        places = made.optical.position + np.arange(0.005, length, 0.01)[:, None] * way
        left = np.exp(-0.01 * summed(puffs.packed(), places).sum())
        assert left < 0.8
        wanted = left * before[row, column] + (1 - left) * day.sky_at(way * [1, 1, 0])
        np.testing.assert_allclose(after[row, column], np.minimum(wanted, 1.0), rtol=0.03, atol=4e-3)


@pytest.mark.parametrize("z", [2.0, 5.0, 9.0])
def test_depth_is_off_by_the_square_of_the_distance(z):
    setup = site(wall=wall(z, -30.0, 30.0, z1=30.0))
    params = depth.Params(width_px=200, height_px=150, mount=MOUNT, disparity_step_px=0.0, base_m=0.2)
    made = depth.DepthCamera(params, setup)
    made.reset(Stream(4, "combine.camera"))
    seen = made.image_from(10**9, made.optical).depth[:70]
    focal = 100.0 / np.tan(np.radians(35.0))
    assert np.nanmean(seen) == pytest.approx(z, rel=0.01)
    assert np.nanstd(seen) == pytest.approx(z * z * 0.25 / (focal * 0.2), rel=0.05)


def test_what_the_second_camera_does_not_see_has_no_depth():
    """Beside the left end of a near wall lies a strip f B (z2 - z1) / (z1 z2): the second camera is right."""
    near, far, base = 2.0, 6.0, 0.2
    setup = site(near=wall(near, 0.0, 9.0, z1=9.0), far=wall(far, -40.0, 40.0, z1=30.0))
    params = depth.Params(width_px=200, height_px=100, mount=MOUNT, disparity_sd_px=0.0, base_m=base)
    made = depth.DepthCamera(params, setup)
    made.reset(Stream(4, "combine.camera"))
    row = made.image_from(10**9, made.optical).depth[20]
    focal = 100.0 / np.tan(np.radians(35.0))
    strip = focal * base * (far - near) / (near * far)
    assert np.isnan(row).sum() == pytest.approx(strip, abs=2.0)
    whole = depth.DepthCamera(replace(params, holes=False), setup)
    whole.reset(Stream(4, "combine.camera"))
    assert not np.isnan(whole.image_from(10**9, whole.optical).depth[20]).any()


def test_boxes_are_around_what_is_seen_of_each_thing():
    setup = site()
    things = [
        SheetObstacle(kind="person", x_m=0.0, y_m=8.0),
        SheetObstacle(kind="vehicle", x_m=4.0, y_m=12.0),
    ]
    setup.bodies.set_things(things_of(things, setup.field))
    params = rays.Params(mount=MOUNT, channels=("instance",), samples_per_pixel=4, shares=True)
    made = rays.RaysCamera(params, setup)
    out = made.picture_from(10**9, made.optical)
    image, boxes, shares = out["image"], out["boxes"], out["shares"]
    assert [OBSTACLE_KINDS[k] for k in boxes.kind] == ["person", "vehicle"]
    np.testing.assert_array_equal(shares.instance, boxes.instance)
    for k, number in enumerate(boxes.instance.astype(int).tolist()):
        share = shares.share[..., k]
        rows, columns = np.nonzero(share)
        assert boxes.area[k] == share.sum()
        assert (image.instance[share > 0.5] == number).all()
        assert not (image.instance[share == 0] == number).any()
        assert (boxes.left[k], boxes.right[k]) == (columns.min() - 0.5, columns.max() + 0.5)
        assert (boxes.top[k], boxes.bottom[k]) == (rows.min() - 0.5, rows.max() + 0.5)
    focal = made.pinhole.focal  # 1.75 m at 8 m, less the stubble before its feet
    assert boxes.bottom[0] - boxes.top[0] == pytest.approx(focal * 1.75 / 8.0, abs=8.0)


def test_the_ground_has_the_colours_of_the_photo(tmp_path):
    """A photo of which every cell of a metre has its own colour; a file with one band is refused."""
    origin = Origin(32632, 500_000.0, 5_800_000.0)
    rasterio = pytest.importorskip("rasterio")
    ramp = np.tile(np.arange(30, 190, 2, dtype=np.uint8), (80, 1))  # to the east
    bands = np.stack([ramp, ramp.T, np.full_like(ramp, 90)])  # green: to the south
    transform = rasterio.Affine(1.0, 0.0, origin.easting - 40, 0.0, -1.0, origin.northing + 40)
    with rasterio.open(
        tmp_path / "p.tif", "w", driver="GTiff", height=80, width=80, count=3, dtype="uint8",
        crs="EPSG:32632", transform=transform,
    ) as file:  # fmt: skip
        file.write(bands)
    setup = replace(site(), origin=origin, base=tmp_path)
    mount = Mount(at="axle", z_m=6.0, pitch_deg=90.0)
    keys = {"mount": mount, "texture": False, "width_px": 31, "height_px": 31, "cloud_percent": 100.0}
    made = rays.RaysCamera(rays.Params(orthophoto="p.tif", channels=("colour", "label"), **keys), setup)
    image = made.image_from(10**9, made.optical)
    ground = image.label == Organ.GROUND
    points = 6.0 * made.pinhole.rays() / made.pinhole.rays()[..., 2:]
    x, y = -points[..., 1], -points[..., 0]  # straight down: the top of the picture is ahead
    wanted = np.stack([30 + 2 * (x + 39.5), 30 + 2 * (39.5 - y), np.full_like(x, 90)], axis=-1)
    assert ground.sum() > 600
    np.testing.assert_allclose(image.colour[ground], unlit(wanted[ground]), atol=1.0)
    one = Raster(np.zeros((5, 5), np.float32), 0.0, 0.0, 1.0, 32632)
    one.to_geotiff(tmp_path / "one.tif", 32632, (500_000.0, 5_800_000.0))
    with pytest.raises(InputError, match="expected 2 bands or more"):
        rays.RaysCamera(rays.Params(orthophoto="one.tif", **keys), setup)
    with pytest.raises(InputError, match="place on Earth is known"):
        rays.RaysCamera(rays.Params(orthophoto="p.tif", **keys), replace(setup, origin=None))


def test_texture_stays_on_the_ground_and_is_one_on_average():
    setup = site()
    keys = {
        "mount": MOUNT,
        "width_px": 160,
        "height_px": 120,
        "channels": ("colour", "label"),
        "shadows": False,
    }
    plain, made = (rays.RaysCamera(rays.Params(texture=on, **keys), setup) for on in (False, True))
    first, second = (
        c.image_from(10**9, Pose.from_euler((0, 0, 0), 0, 0.7, 0.0) @ c.optical) for c in (plain, made)
    )
    ground = first.label == Organ.GROUND
    means = [linear(i.colour)[ground].mean(axis=0) for i in (first, second)]
    assert ground.sum() > 2000
    np.testing.assert_allclose(means[1], means[0], rtol=0.1)
    assert np.std(second.colour[ground], axis=0).min() > 2.0 * np.std(first.colour[ground], axis=0).min()


def test_binned_colour_pixels_have_all_three_colours():
    setup = site(wall=wall(3.0, -9.0, 9.0, z1=9.0))
    small = {"width_px": 60, "height_px": 40, "mount": MOUNT, "texture": False, "channels": ("raw", "colour")}
    planes = []
    for binning in (1, 4):
        made = error.ErrorCamera(error.Params(binning=binning, exposure_ms=0.5, **small), setup)
        made.reset(Stream(1, "c"))
        image = made.image_from(10**9, made.optical)
        assert image.raw.shape == (40, 60, 1 if binning == 1 else 3)
        planes.append(linear(image.colour[18:22, 28:32]).mean(axis=(0, 1)))
    np.testing.assert_allclose(planes[0], planes[1], rtol=0.03)


def test_what_no_camera_can_do_is_refused():
    setup = site()
    with pytest.raises(InputError, match="width_px = 2000: expected at most 1224"):
        error.ErrorCamera(error.Params(width_px=2000), setup)
    with pytest.raises(InputError, match="another camera gives colour"):
        depth.DepthCamera(depth.Params(channels=("colour",)), setup)
    with pytest.raises(InputError, match="level error has it"):
        rays.RaysCamera(rays.Params(channels=("raw",)), setup)


def test_a_run_with_the_level_is_the_same_twice():
    solids = wall(5.0, -9.0, 9.0)
    images = []
    for _ in range(2):
        made = camera(site(wall=solids), samples_per_pixel=4, noise="data_sheet", channels=("raw", "colour"))
        images.append(made.picture(10**9, driving())["image"])
    assert (images[0].raw == images[1].raw).all()
    assert (images[0].colour == images[1].colour).all()
    assert isinstance(solids, Solids)
