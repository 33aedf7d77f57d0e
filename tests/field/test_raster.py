import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swath.core.errors import InputError
from swath.field.maps.raster import Raster


def plane(ny: int = 5, nx: int = 7, cell: float = 2.0) -> Raster:
    y, x = np.mgrid[0:ny, 0:nx] * cell
    return Raster((3.0 + 0.25 * x - 0.5 * y).astype(np.float32), 0.0, 0.0, cell)


@given(st.floats(0.0, 12.0), st.floats(0.0, 8.0))
def test_a_plane_is_sampled_exactly(x, y):
    assert plane().sample(x, y) == pytest.approx(3.0 + 0.25 * x - 0.5 * y, abs=1e-6)


def test_edges_and_unknown_cells_follow_the_stated_rule():
    raster = plane()
    assert raster.bounds == (-1.0, -1.0, 13.0, 9.0)
    assert raster.sample(-0.9, 0.0) == 3.0  # outer half cell: constant
    assert np.isnan(raster.sample([-1.1, np.nan, 13.1], 0.0)).all()
    holed = raster.values.copy()
    holed[2, 3] = np.nan
    raster = Raster(holed, 0.0, 0.0, 2.0)
    assert np.isnan(raster.sample(6.0, 4.0))
    assert np.isnan(raster.sample(6.9, 4.0))  # still inside the unknown cell
    assert raster.sample(7.1, 4.0) == pytest.approx(float(raster.values[2, 4]))  # known cell: its own value


def test_samples_take_any_shape():
    assert plane().sample(np.zeros((3, 1)), np.zeros(4)).shape == (3, 4)
    assert plane().sample(1.0, 1.0).shape == ()


def test_a_single_cell_is_a_constant():
    raster = Raster(np.full((1, 1), 4.0, np.float32), 0.0, 0.0, 10.0)
    assert raster.sample([-4.0, 0.0, 4.0], [4.0, 0.0, -4.0]).tolist() == [4.0, 4.0, 4.0]


@pytest.mark.parametrize("cell", [0.0, -1.0, float("nan")])
def test_a_cell_must_be_positive(cell):
    with pytest.raises(InputError, match="cell"):
        Raster(np.zeros((2, 2), np.float32), 0.0, 0.0, cell)


def test_a_geotiff_comes_back_as_it_was(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    values = plane().values.copy()
    values[1, 2] = np.nan
    raster = Raster(values, -10.0, 20.0, 2.0)
    raster.to_geotiff(tmp_path / "a.tif", 32612, (533000.0, 5304000.0), name="stems", unit="1/m2")
    back = Raster.from_geotiff(tmp_path / "a.tif", (533000.0, 5304000.0))
    assert (back.x0, back.y0, back.cell, back.epsg) == (-10.0, 20.0, 2.0, 32612)
    np.testing.assert_array_equal(back.values, values)
    assert Raster.from_geotiff(tmp_path / "a.tif").x0 == 532990.0
    with rasterio.open(tmp_path / "a.tif") as dataset:
        assert (dataset.descriptions, dataset.units) == (("stems",), ("1/m2",))


def write(path, **changes):
    rasterio = pytest.importorskip("rasterio")
    profile = {
        "driver": "GTiff", "height": 3, "width": 4, "count": 1, "dtype": "float32", "nodata": -9999.0,
        "crs": "EPSG:32612", "transform": rasterio.Affine(2, 0, 500000, 0, -2, 5000000),
    } | changes  # fmt: skip
    values = profile.pop("values", np.ones((3, 4), np.float32))
    with rasterio.open(path, "w", **profile) as dataset:
        dataset.write(values, 1)


def test_the_nodata_value_becomes_nan(tmp_path):
    values = np.array([[1, 2, 3, 4], [5, -9999, 7, 8], [9, 10, 11, 12]], np.float32)
    write(tmp_path / "a.tif", values=values)
    back = Raster.from_geotiff(tmp_path / "a.tif")
    assert back.values[0].tolist() == [9, 10, 11, 12]  # south first
    assert np.isnan(back.values[1, 1])


def test_a_geotiff_that_cannot_serve_is_refused(tmp_path):
    affine = pytest.importorskip("affine").Affine
    cases = {
        "no such file": None,
        "rotated": {"transform": affine(1.8, 0.7, 5e5, 0.7, -1.8, 5e6)},
        "square": {"transform": affine(2, 0, 5e5, 0, -3, 5e6)},
        "metres": {"crs": "EPSG:4326", "transform": affine(1e-5, 0, -110, 0, -1e-5, 47)},
        "names none": {"crs": None},
        "empty": {"values": np.full((3, 4), -9999, np.float32)},
    }
    for reason, changes in cases.items():
        path = tmp_path / f"{reason.replace(' ', '_')}.tif"
        if changes is not None:
            write(path, **changes)
        with pytest.raises(InputError, match=reason) as caught:
            Raster.from_geotiff(path)
        assert path.name in str(caught.value)


@pytest.mark.draws
@given(st.binary(max_size=400), st.booleans())
def test_no_bytes_make_a_traceback(tmp_path_factory, data, tiff_head):
    pytest.importorskip("rasterio")
    path = tmp_path_factory.mktemp("r") / "x.tif"
    path.write_bytes(b"II*\x00\x08\x00\x00\x00" + data if tiff_head else data)
    with pytest.raises(InputError):
        Raster.from_geotiff(path)


VRT = """<VRTDataset rasterXSize="7" rasterYSize="5"><SRS>EPSG:32632</SRS>
<GeoTransform>0, 2, 0, 10, 0, -2</GeoTransform><VRTRasterBand dataType="Float32" band="1"><SimpleSource>
<SourceFilename>{secret}</SourceFilename><SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"""
WMS = """<GDAL_WMS><Service name="TMS"><ServerUrl>http://127.0.0.1:9/${z}/${x}/${y}.png</ServerUrl></Service>
<DataWindow><UpperLeftX>0</UpperLeftX><UpperLeftY>10</UpperLeftY><LowerRightX>14</LowerRightX>
<LowerRightY>0</LowerRightY><SizeX>7</SizeX><SizeY>5</SizeY></DataWindow><Projection>EPSG:32632</Projection>
</GDAL_WMS>"""


@pytest.mark.parametrize("text", [VRT, WMS, "P5 7 5 255 "], ids=["VRT", "WMS", "PNM"])
def test_a_tif_that_is_none_opens_no_other_file(text, tmp_path):
    pytest.importorskip("rasterio")
    secret = tmp_path / "secret.tif"
    plane().to_geotiff(secret, 32632)
    file = tmp_path / "terrain.tif"
    file.write_text(text.replace("{secret}", str(secret)))
    with pytest.raises(InputError, match=r"expected a readable GeoTIFF.*terrain\.tif"):
        Raster.from_geotiff(file)


def test_what_lies_beside_a_geotiff_is_not_read(tmp_path):
    pytest.importorskip("rasterio")
    file = tmp_path / "terrain.tif"
    plane().to_geotiff(file, 32632)
    (tmp_path / "terrain.tif.aux.xml").write_text("<PAMDataset><SRS>EPSG:32633</SRS></PAMDataset>")
    for mask in ("terrain.tif.msk", "terrain.tif.ovr"):
        (tmp_path / mask).write_text(VRT.replace("{secret}", str(file)))
    raster = Raster.from_geotiff(file)
    assert raster.epsg == 32632
    assert np.array_equal(raster.values, plane().values)
