"""Heights of a DEM as people have them: scale, offset, unit, vertical system, nodata."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.documents.reasons import doubts
from swath.field.field_setup import FieldSetup
from swath.field.ground.soil import CONE_INDEX
from swath.field.maps.band import GRAIN, MOISTURE, PLAIN, STEMS
from swath.field.maps.raster import Raster
from swath.field.terrain.dem import Dem, Params
from swath.field_io.dem import against_log, read_dem

rasterio = pytest.importorskip("rasterio")
EAST, NORTH, FT, US_FT = 500_000.0, 5_300_000.0, 0.3048, 1200 / 3937
GRID = Raster(np.full((60, 60), np.nan, np.float32), EAST + 150.0, NORTH + 150.0, 4.0, 32632)


def true_height(x, y):
    """Height [m] at places from the corner of the file; the field of GRID has 302.9 to 310.1 m."""
    return 299.0 + 0.01 * x + 0.02 * y + 0.3 * np.sin(x / 25.0)


def heights(cell=2.0, size=300):
    column, row = np.meshgrid(np.arange(size) + 0.5, np.arange(size) + 0.5)
    return true_height(cell * column, cell * (size - row))


def write(path, values, *, crs="EPSG:32632", cell=2.0, nodata=None, unit=None, scale=None, offset=None):
    values = np.asarray(values)
    place = rasterio.Affine(cell, 0, EAST, 0, -cell, NORTH + cell * len(values))
    shape = {"height": len(values), "width": values.shape[1], "count": 1, "dtype": values.dtype}
    with rasterio.open(path, "w", driver="GTiff", crs=crs, transform=place, nodata=nodata, **shape) as file:
        file.write(values, 1)
        if scale is not None:
            file.scales = (scale,)
        if offset is not None:
            file.offsets = (offset,)
        if unit is not None:
            file.units = (unit,)
    return path


def off(path):
    """Largest error of a DEM on the cells of the field [m], and its notes."""
    found, share = read_dem(path, GRID)
    assert share > 0.8
    x, y = np.meshgrid(*found.centres())
    return float(np.abs(found.values - true_height(x - EAST, y - NORTH)).max()), " ".join(found.notes)


CODED = {
    "int16 hundredths from 290": (
        lambda z: np.round((z - 290) * 100).astype("i2"), {"scale": 0.01, "offset": 290.0}
    ),
    "uint16 decimetres by scale": (lambda z: np.round(z * 10).astype("u2"), {"scale": 0.1}),
    "negative scale": (lambda z: np.round(-z * 50).astype("i2"), {"scale": -0.02}),
    "offset alone": (lambda z: (z - 300).astype("f4"), {"offset": 300.0}),
    "scale in feet": (lambda z: np.round(z / FT * 20).astype("u2"), {"scale": 0.05, "unit": "ft"}),
    "feet": (lambda z: (z / FT).astype("f4"), {"unit": "ft"}),
    "Foot": (lambda z: (z / FT).astype("f4"), {"unit": "Foot"}),
    "US survey feet": (lambda z: (z / US_FT).astype("f8"), {"unit": "US survey foot"}),
    "centimetres": (lambda z: np.round(z * 100).astype("i4"), {"unit": "cm"}),
    "millimetres": (lambda z: np.round(z * 1000).astype("i4"), {"unit": "mm"}),
    "metre": (lambda z: z.astype("f4"), {"unit": "metre"}),
    "vertical system in metres": (lambda z: z.astype("f4"), {"crs": "EPSG:32632+5773"}),
    "vertical system in US survey feet": (lambda z: (z / US_FT).astype("f4"), {"crs": "EPSG:32632+6360"}),
    "vertical system in feet": (lambda z: (z / FT).astype("f4"), {"crs": "EPSG:32632+8228"}),
    "unit of the band over that of the system": (
        lambda z: z.astype("f4"), {"crs": "EPSG:32632+6360", "unit": "m"}
    ),
    "declared nodata, then scaled": (
        lambda z: np.where(z < 301, -9999, (z - 290) * 100).astype("i2"),
        {"scale": 0.01, "offset": 290.0, "nodata": -9999},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CODED)
def test_heights_are_true_whatever_the_file_writes_them_in(tmp_path, name):
    code, about = CODED[name]
    error, notes = off(write(tmp_path / "a.tif", code(heights()), **about))
    assert error < 0.25, notes
    is_metric = name.startswith(("metre", "unit of the band")) or ("unit" not in about and "feet" not in name)
    assert ("is in " in notes) != is_metric


BANDS = {  # names of the bands, of which the heights are the second -> what is said
    ("point count", "elevation"): "band 2 of 1 'point count', 2 'elevation' is taken",
    ("slope", "DTM 2 m"): "band 2 of",
    ("red", "Höhe"): "band 2 of",
    (None, None): None,
    ("ground height", "canopy height"): None,
}


@pytest.mark.parametrize("names", BANDS)
def test_of_several_bands_the_one_that_is_called_so_counts(tmp_path, names):
    path = tmp_path / "a.tif"
    write(path, heights().astype("f4"))
    with rasterio.open(path) as file:
        profile, z = file.profile | {"count": 2}, file.read(1)
    with rasterio.open(path, "w", **profile) as file:
        file.write(np.stack([np.full_like(z, 3.0), z]))
        for n, name in enumerate(names, 1):
            if name:
                file.set_band_description(n, name)
    if BANDS[names] is None:
        with pytest.raises(
            InputError, match=r"expected one of heights of the ground; there are 1.*gdal_translate"
        ):
            off(path)
        return
    error, notes = off(path)
    assert error < 0.25
    assert BANDS[names] in notes


def test_two_units_of_height_are_told(tmp_path):
    path = write(tmp_path / "a.tif", heights().astype("f4"), crs="EPSG:32632+6360", unit="m")
    assert "two units of height: m of the band is taken, not us-ft" in off(path)[1]


def test_feet_of_the_places_are_taken_for_heights_without_a_unit_and_told(tmp_path):
    from swath.field.maps.projection import transform

    grid = Raster(GRID.values, 300_000.0, 4_500_000.0, 4.0, 32618)
    east, north = transform([[300_100.0, 4_500_100.0]], "EPSG:32618", "EPSG:2271")[0]
    values = np.full((300, 300), 1000.0, "f4")
    place = rasterio.Affine(5, 0, east - 700, 0, -5, north + 800)
    about = {"driver": "GTiff", "crs": "EPSG:2271", "transform": place, "dtype": "float32", "count": 1}
    with rasterio.open(tmp_path / "a.tif", "w", width=300, height=300, **about) as file:
        file.write(values, 1)
    found, _ = read_dem(tmp_path / "a.tif", grid)
    assert found.values == pytest.approx(1000 * US_FT, abs=0.01)
    assert "no unit of height: taken as us-ft" in " ".join(found.notes)


def test_heights_over_the_ellipsoid_are_told(tmp_path):
    values = np.full((400, 400), 347.0, "f4")
    place = rasterio.Affine(2e-5, 0, 8.998, 0, -2e-5, 47.862)
    about = {"driver": "GTiff", "crs": "EPSG:4979", "transform": place, "dtype": "float32", "count": 1}
    with rasterio.open(tmp_path / "a.tif", "w", width=400, height=400, **about) as file:
        file.write(values, 1)
    found, _ = read_dem(tmp_path / "a.tif", GRID)
    assert "over the ellipsoid" in " ".join(found.notes)


def holed(z, value, kind="f4"):
    z = z.copy()
    z[150:200, 100:140] = value
    z[10:14, 200:260] = value
    return z.astype(kind)


@pytest.mark.parametrize("value", [-9999.0, 0.0, 9999.0, -32768.0, -3.4e38, 1e20, 32767.0, -99999.0, 255.0])
def test_a_nodata_value_that_nothing_declares_is_no_height(tmp_path, value):
    error, notes = off(write(tmp_path / "a.tif", holed(heights(), value)))
    assert error < 0.8  # inside the gap of 80 x 100 m the ground is carried on
    assert "taken as unknown" in notes


def test_two_nodata_values_in_whole_centimetres(tmp_path):
    z = np.round(heights() * 100)
    z[150:200, 100:140], z[100:120, 100:140] = 0, -32768
    error, notes = off(write(tmp_path / "a.tif", z.astype("i4"), unit="cm"))
    assert error < 0.8
    assert notes.count("taken as unknown") == 2


def test_ground_that_is_only_uneven_is_left_as_it_is(tmp_path):
    z = heights()
    z[150:152] -= 1.5  # a ditch
    z[100:110, 100:110] += 6.0 + np.arange(10) * 0.1  # a heap
    z[200:230, 30:90] = 303.0  # a pond, level
    for k in range(40):  # trees and roofs
        z[100 + 5 * (k % 9) : 102 + 5 * (k % 9), 140 + k : 142 + k] += 12.0
    found, _ = read_dem(write(tmp_path / "a.tif", z.astype("f4"), unit="m"), GRID)
    assert len(found.notes) == 1
    assert "is it a surface model, with trees and roofs?" in found.notes[0]
    assert np.nanmax(found.values) > 313.0


@pytest.mark.parametrize("turn", [0.0, 0.02, 0.6])
@pytest.mark.parametrize("step", [4.0, -30.0])
def test_two_tiles_of_other_heights_are_told_as_such(tmp_path, turn, step):
    z = heights()
    rows, columns = np.indices(z.shape)
    z[columns > z.shape[1] * 0.55 + turn * (rows - z.shape[0] / 2)] += step
    found, _ = read_dem(write(tmp_path / "a.tif", z.astype("f4"), unit="m"), GRID)
    assert doubts(found.notes) == ["heights"]
    told = float(re.search(r"heights: a step of (-?[\d.]+) m along a line", "".join(found.notes))[1])
    assert abs(told) == pytest.approx(abs(step), abs=1.5)
    with pytest.raises(InputError, match=r"heights = a step of .*do its tiles differ in height"):
        read_dem(write(tmp_path / "a.tif", (z + np.sign(z - heights()) * 150.0).astype("f4"), unit="m"), GRID)


def test_a_hedge_and_a_ditch_through_the_field_are_no_tiles(tmp_path):
    for high in (6.0, -3.0):
        z = heights()
        z[:, 140:143] += high
        found, _ = read_dem(write(tmp_path / "a.tif", z.astype("f4"), unit="m"), GRID)
        assert not [note for note in found.notes if "along a line" in note]


def test_what_nothing_says_is_told(tmp_path):
    assert "a.tif states no unit of height: taken as m" in off(write(tmp_path / "a.tif", heights()))[1]
    tenfold = 300.0 + 10.0 * (heights() - 300.0)
    found, _ = read_dem(write(tmp_path / "a.tif", tenfold, unit="m"), GRID)
    assert "is steeper than" in " ".join(found.notes)


def test_cliffs_and_heights_of_another_unit_are_refused(tmp_path):
    z = heights()
    rough = np.random.default_rng(1).uniform(0.0, 8000.0, z[:, 100:140].shape)
    cliffs = z.copy()
    cliffs[:, 100:140] = rough
    cases = {
        "nodata value declared": cliffs,
        "unit or scale": (z - 299.0) * 100.0,  # centimetres, nothing says so
        "heights of the ground of -500 to 9000": z * 100.0,
    }
    for said, values in cases.items():
        path = write(tmp_path / "a.tif", values.astype("f4"))
        with pytest.raises(InputError, match=said) as caught:
            read_dem(path, GRID)
        assert "a.tif" in str(caught.value)


def test_a_unit_that_is_none_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"furlong.*expected heights of the ground in one of m, "):
        read_dem(write(tmp_path / "a.tif", heights().astype("f4"), unit="furlong"), GRID)


def test_what_a_file_beside_states_is_used_and_told(tmp_path):
    z = np.round((heights() - 290.0) / FT * 100.0)
    z[150:200, 100:140] = -1
    path = write(tmp_path / "a.tif", z.astype("i2"))
    beside = f"<Scale>0.01</Scale><Offset>{290.0 / FT}</Offset>"
    beside += "<UnitType>ft</UnitType><NoDataValue>-1</NoDataValue>"
    (tmp_path / "a.tif.aux.xml").write_text(
        f'<PAMDataset><PAMRasterBand band="1">{beside}</PAMRasterBand></PAMDataset>'
    )
    error, notes = off(path)
    assert error < 0.8
    assert "a.tif.aux.xml beside it says Scale 0.01" in notes
    (tmp_path / "a.tif.aux.xml").write_text("<!DOCTYPE a><PAMDataset/>")
    with pytest.raises(InputError, match="a DOCTYPE is not allowed"):
        read_dem(path, GRID)


def test_a_dem_far_finer_than_the_field_is_read_by_means(tmp_path, monkeypatch):
    monkeypatch.setattr("swath.field_io.dem.MOST_READ", 4000)
    error, _ = off(write(tmp_path / "a.tif", heights().astype("f4")))
    assert error < 0.25


@pytest.mark.parametrize("name", CODED)
def test_the_terrain_level_reads_the_same_heights(tmp_path, name):
    code, about = CODED[name]
    path = write(tmp_path / "a.tif", code(heights()), **about)
    dem = Dem(Params(path.name, datum_m=300.0), FieldSetup(folder=tmp_path, origin=(EAST, NORTH)))
    x, y = np.meshgrid(np.arange(155.0, 400.0, 7.0), np.arange(155.0, 400.0, 7.0))
    assert dem.height(x, y) + 300.0 == pytest.approx(true_height(x, y), abs=0.25)


def test_other_maps_are_read_in_their_unit(tmp_path):
    even = np.full((5, 5), 8.0, "f4")
    cases = [(GRAIN, "t/ha", 0.8), (GRAIN, "kg/m2", 8.0), (MOISTURE, "%", 0.08), (STEMS, "plants/m2", 8.0),
             (STEMS, "1/m2", 8.0), (PLAIN, "furlong", 8.0), (GRAIN, None, 8.0)]  # fmt: skip
    for quantity, unit, expected in cases:
        path = write(tmp_path / "a.tif", even, unit=unit)
        assert Raster.from_geotiff(path, quantity=quantity).values == pytest.approx(expected)
    with pytest.raises(InputError, match="expected moisture of 0 to 1"):
        Raster.from_geotiff(write(tmp_path / "a.tif", even), quantity=MOISTURE)


@pytest.mark.parametrize(
    ("heard", "said"),
    [
        (lambda z: z, ""),
        (lambda z: z + 46.6, "the log's heights lie 46.6 m above the DEM's"),
        (lambda z: z * FT, "below the DEM's"),
        (lambda z: 306.5 + (z - 306.5) * 3.28, "rise 3.28 times as far"),
    ],
)
def test_a_log_is_a_witness_of_the_heights(heard, said, tmp_path):
    found, _ = read_dem(write(tmp_path / "a.tif", heights().astype("f4"), unit="m"), GRID)
    x, y = np.meshgrid(np.arange(155.0, 380.0, 5.0), np.arange(155.0, 380.0, 5.0))
    position = np.stack([EAST + x.ravel(), NORTH + y.ravel()], axis=1)
    log = SimpleNamespace(
        position=position, elevation=heard(true_height(x, y).ravel()), time=x.ravel() * 10.0
    )
    notes = " ".join(against_log(found, log, tmp_path / "a.tif").notes)
    assert said in notes if said else not notes


@pytest.mark.parametrize("turned", [lambda z: z[::-1], lambda z: z[::-1, ::-1], lambda z: 600.0 - z])
@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_a_turned_map_of_heights_is_refused(turned, noise, tmp_path):
    x, y = np.meshgrid(np.arange(155.0, 380.0, 5.0), np.arange(155.0, 380.0, 5.0))
    position = np.stack([EAST + x.ravel(), NORTH + y.ravel()], axis=1)
    heard = true_height(x, y) + np.random.default_rng(1).normal(0.0, noise, x.shape)
    log = SimpleNamespace(position=position, elevation=heard.ravel(), time=x.ravel() * 100.0)
    held, _ = read_dem(write(tmp_path / "a.tif", heights().astype("f4"), unit="m"), GRID)
    assert not [note for note in against_log(held, log, tmp_path).notes if "hills" in note]
    other, _ = read_dem(write(tmp_path / "b.tif", turned(heights()).astype("f4"), unit="m"), GRID)
    with pytest.raises(InputError, match="heights = of the log's hills it shows"):
        against_log(other, log, tmp_path / "b.tif")


@pytest.mark.parametrize(("unit", "factor"), [(None, 1.0), ("kPa", 1.0), ("MPa", 1e3), ("Pa", 1e-3)])
def test_a_map_of_the_cone_index_is_read_by_its_unit(tmp_path, unit, factor):
    soil = np.random.default_rng(4).uniform(600.0, 1400.0, (20, 20))
    file = write(tmp_path / "soil.tif", (soil / factor).astype("f8"), unit=unit)
    found = Raster.from_geotiff(file, quantity=CONE_INDEX)
    np.testing.assert_allclose(found.values, soil[::-1], rtol=1e-6)


def test_a_map_of_the_cone_index_in_another_unit_is_refused(tmp_path):
    file = write(tmp_path / "soil.tif", np.full((20, 20), 900.0), unit="m")
    with pytest.raises(InputError, match="expected cone index in kPa in one of kpa, mpa, pa"):
        Raster.from_geotiff(file, quantity=CONE_INDEX)
