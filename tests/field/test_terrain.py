"""Terrain levels: values, spectra, exact borders, maps."""

import sys
import threading

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.field.field_setup import FieldSetup
from swath.field.ground.waves import N0, ROUGHNESS_CLASSES, make_random_field, make_roughness
from swath.field.maps.raster import Raster
from swath.field.terrain import dem, formula, plane
from swath.kernels import start_warp
from tests.field.made_field import SETUP, made_field
from tests.shared_data import DATA

start_warp()
from swath.field.ground.waves_kernel import sum_products  # noqa: E402


def profile_psd(height, direction, length=8_000.0, spacing=0.125):
    """One-sided PSD [m3] of a long profile: wave numbers [cycles/m] and density."""
    s = np.arange(round(length / spacing)) * spacing
    z = height(s * np.cos(direction), s * np.sin(direction))
    window = np.hanning(len(z))
    spectrum = np.abs(np.fft.rfft((z - z.mean()) * window)) ** 2
    return np.fft.rfftfreq(len(z), spacing), 2.0 * spectrum * spacing / np.sum(window**2)


def test_profiles_in_any_direction_follow_iso_8608():
    gd, waviness = ROUGHNESS_CLASSES["D"], 1.24  # a waviness of 2: the next test
    waves = make_roughness(gd, waviness, Stream(3, "field.roughness"))
    edges = 0.0625 * 2.0 ** np.arange(6)  # octaves from 0.0625 to 2 cycles/m
    ratio = np.empty((6, 5))
    for a, direction in enumerate(np.radians([0.0, 23.0, 51.0, 90.0, 117.0, 163.0])):
        n, density = profile_psd(waves.height, direction)
        for b, low in enumerate(edges[:-1]):
            band = (n >= low) & (n < 2.0 * low)
            ratio[a, b] = density[band].mean() / (gd * (n[band] / N0) ** -waviness).mean()
    assert np.all(np.abs(ratio - 1.0) < 0.25), ratio.round(2)
    assert np.all(np.abs(ratio.mean(axis=0) - 1.0) < 0.1), ratio.mean(axis=0).round(2)


def test_variance_in_a_band_is_the_integral_of_the_spectrum():
    gd = ROUGHNESS_CLASSES["C"]
    n = np.linspace(0.05, 2.0, 4001)
    expected = np.trapezoid(gd * (n / N0) ** -2, n)
    found = []
    for seed in range(4):
        f, density = profile_psd(make_roughness(gd, 2.0, Stream(seed, "r")).height, 0.4 * seed)
        band = (f >= 0.05) & (f <= 2.0)
        found.append(np.sum(density[band]) * (f[1] - f[0]))
    assert np.mean(found) == pytest.approx(expected, rel=0.1)


def test_random_field_has_the_deviation_and_correlation_it_was_asked_for():
    waves = make_random_field(0.06, 20.0, Stream(1, "x"), count=200)
    x, y = np.meshgrid(np.arange(0.0, 2000.0, 5.0), np.arange(0.0, 2000.0, 5.0))
    z = waves.height(x, y)
    assert z.std() == pytest.approx(0.06, rel=0.05)
    lagged = np.mean(z[:, :-4] * z[:, 4:]) / np.mean(z**2)  # 20 m apart
    assert lagged == pytest.approx(np.exp(-1.0), abs=0.08)


def test_slope_rises_towards_its_azimuth():
    terrain = plane.Plane(plane.Params(slope_percent=5.0, slope_azimuth_deg=0.0), SETUP)
    assert terrain.height([0.0, 0.0, 10.0], [0.0, 10.0, 0.0]) == pytest.approx([0.0, 0.5, 0.0], abs=1e-12)


def test_a_wave_has_its_height_and_length():
    wave = formula.Wave(amplitude_m=0.3, wavelength_m=40.0, azimuth_deg=90.0)
    terrain = formula.Formula(formula.Params(waves=(wave,), roughness_class="none"), SETUP)
    assert terrain.height([10.0, 30.0, 40.0], 5.0) == pytest.approx([0.3, -0.3, 0.0], abs=1e-12)


def test_lattice_agrees_with_height_and_pages_share_their_border_exactly():
    field = made_field(terrain=formula.Params(slope_percent=3.0, roughness_class="E"))
    maker = field.maker
    u, v = np.arange(65) * maker.node + 3000.0, np.arange(65) * maker.node - 500.0
    x, y = maker.to_world(*np.meshgrid(u, v))
    assert np.abs(maker.terrain.lattice(u, v, maker.yaw) - maker.terrain.height(x, y)).max() < 1e-9
    for i, j in ((0, 0), (37, -12), (-400, 250), *((n, 3 * n + 1) for n in range(40))):
        here, right, above = maker.ground(i, j), maker.ground(i + 1, j), maker.ground(i, j + 1)
        assert np.array_equal(here[:, -1], right[:, 0])
        assert np.array_equal(here[-1], above[0])


@pytest.mark.parametrize(
    ("rows", "columns", "waves"), [(65, 65, 514), (70, 9, 40), (4, 8, 700), (3, 1, 9000)]
)
def test_compiled_sums_have_the_bits_of_einsum(rows, columns, waves):
    draw = np.random.default_rng(rows).standard_normal
    along, across = draw((rows, waves)), draw((waves, columns))
    wanted = np.zeros((rows, columns))
    for k in range(waves):
        wanted += along[:, k, None] * across[k]
    assert np.array_equal(sum_products(along, across), wanted)


def test_threads_that_sum_at_once_have_their_own_sums():
    """What each thread adds up is its own, however they take turns."""
    draws, wrong = [np.random.default_rng(seed) for seed in range(4)], []

    def add_up(draw):
        for _ in range(1000):
            m, k, n = (int(v) for v in draw.integers(4, 20, 3))
            along, across = draw.normal(size=(m, k)), draw.normal(size=(k, n))
            if not np.array_equal(sum_products(along, across), np.einsum("vk,ku->vu", along, across)):
                wrong.append((m, k, n))

    threads = [threading.Thread(target=add_up, args=(draw,)) for draw in draws]
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(before)
    assert not wrong


def test_ground_height_is_the_lattice():
    field = made_field(terrain=formula.Params(slope_percent=4.0, roughness_class="C"))
    rng = np.random.Generator(np.random.Philox(5))
    x, y = rng.uniform(-30.0, 30.0, (2, 400))
    z, exact = field.ground_height(x, y), field.terrain.height(x, y)
    assert np.abs(z - exact).max() < 0.02
    assert np.abs(z - exact).mean() < 0.002


def test_tile_planes_fit_the_ground():
    field = made_field(terrain=plane.Params(slope_percent=7.0, slope_azimuth_deg=30.0, height_m=2.0))
    field.ensure(100.0, 50.0, 1.0)
    slot = field.pages.table[field.pages.table >= 0][0]
    (i, j), tile = next(iter(field.store.keys)), field.library.tile_size
    centre = (np.arange(8) + 0.5) * tile
    u, v = np.meshgrid(i * 8 * tile + centre, j * 8 * tile + centre)
    found = field.pages.tile_plane[slot]
    assert found[..., 0] == pytest.approx(field.terrain.height(*field.maker.to_world(u, v)), abs=1e-5)
    assert np.hypot(found[..., 1], found[..., 2]) == pytest.approx(0.07, abs=1e-5)
    assert np.abs(field.pages.tile_bump[slot]).max() < 1e-5


def test_heights_do_not_depend_on_the_order_of_visits():
    rough = formula.Params(roughness_class="D")
    one, two = made_field(terrain=rough), made_field(terrain=rough)
    x = np.linspace(-100.0, 100.0, 41)
    there = one.ground_height(x, 0.3 * x)
    back = two.ground_height(x[::-1], 0.3 * x[::-1])[::-1]
    assert np.array_equal(there, back)
    other = made_field(terrain=rough, seed=8).ground_height(x, 0.3 * x)
    assert np.abs(other - there).max() > 0.01


def test_dem_interpolates_fills_gaps_and_goes_on_outside():
    values = np.add.outer(np.arange(5.0), 10.0 * np.arange(4.0)).astype(np.float32) + 100.0
    values[2, 2] = np.nan
    terrain = dem.Dem.from_raster(Raster(values, 0.0, 0.0, 10.0), datum=100.0)
    assert terrain.height(5.0, 10.0) == pytest.approx(6.0)
    assert terrain.height(20.0, 20.0) == pytest.approx(22.0, abs=0.5)
    assert terrain.height(-500.0, 0.0) == terrain.height(0.0, 0.0) == 0.0
    u = np.arange(9) * 0.5
    crossing = terrain.lattice(u, u, 0.3)
    x, y = np.cos(0.3) * u - np.sin(0.3) * u[:, None], np.sin(0.3) * u + np.cos(0.3) * u[:, None]
    assert crossing == pytest.approx(terrain.height(x, y), abs=1e-9)


def test_dem_file_that_is_missing_or_no_geotiff_is_refused(tmp_path):
    setup = FieldSetup(folder=tmp_path)
    with pytest.raises(InputError, match="no such file"):
        dem.Dem(dem.Params(file="none.tif"), setup)
    (tmp_path / "bad.tif").write_bytes(b"not a tiff")
    with pytest.raises(InputError, match="readable GeoTIFF"):
        dem.Dem(dem.Params(file="bad.tif"), setup)


@pytest.mark.parametrize(
    ("kind", "data"),
    [
        (plane.Params, {"slope_percent": 200.0}),
        (formula.Params, {"roughness_class": "G"}),
        (formula.Params, {"waves": [{"amplitude_m": -1.0, "wavelength_m": 10.0}]}),
        (formula.Params, {"gd_n0_m3": -1e-6}),
        (dem.Params, {}),
    ],
)
def test_parameters_out_of_range_are_refused(kind, data):
    with pytest.raises(ValidationError):
        TypeAdapter(kind).validate_python(data)


DEM = DATA / "wheat_combine_logs_msu/si/farmerI_henrys_terrain_4m_utm12n.tif"


@pytest.mark.skipif(not DEM.is_file(), reason="needs the Montana terrain map: SWATH_DATA")
def test_a_measured_terrain_is_met_at_its_cell_centres():
    raster = Raster.from_geotiff(DEM)
    ny, nx = raster.values.shape
    x0, y0 = raster.x0 + 0.5 * nx * raster.cell, raster.y0 + 0.5 * ny * raster.cell
    terrain = dem.Dem(dem.Params(file=str(DEM)), FieldSetup(origin=(x0, y0)))
    assert terrain.datum == pytest.approx(np.nanmean(raster.values), abs=0.01)
    column, row = np.meshgrid(*raster.centres())
    known = np.isfinite(raster.values)
    found = terrain.height(column[known] - x0, row[known] - y0) + terrain.datum
    assert np.abs(found - raster.values[known]).max() < 1e-3
    assert np.isfinite(terrain.height(column - x0, row - y0)).all()
    assert terrain.covers(0.0, 0.0)
    assert not terrain.covers(1e5, 0.0)
