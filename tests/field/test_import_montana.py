"""Real logs import as they are, and agree with figures measured from them independently."""

import numpy as np
import pytest

pytest.importorskip("rasterio")

from swath.field.maps.raster import Raster
from swath.field_io import folder
from swath.field_io.importer import Settings, import_log
from swath.field_io.passes import lateral_sd
from tests.shared_data import MONTANA

pytestmark = pytest.mark.skipif(not MONTANA.is_dir(), reason="needs the Montana yield logs: SWATH_DATA")


def imported(tmp_path_factory, log, **options):
    out = tmp_path_factory.mktemp("montana") / "field"
    return import_log(MONTANA / log, out, progress=False, **options), folder.read(out)


@pytest.fixture(scope="module")
def henrys(tmp_path_factory):
    return imported(tmp_path_factory, "si/farmerI_henrys_2018_wheat.csv.gz")


@pytest.fixture(scope="module")
def west(tmp_path_factory):
    return imported(tmp_path_factory, "si/farmerB_sec1west_2014_winterwheat.csv.gz")


def lateral_sds(field):
    """Lateral sd [m] of all whole windows of 100 records on straights."""
    return [
        lateral_sd(t.line[k : k + 100])
        for t in field.tracks
        for w in t.straights
        for k in range(w.first, w.last - 99, 100)
    ]


def test_every_row_of_2018_is_accounted_for(henrys):
    report, _ = henrys
    assert report.rows["read"] == 31276
    assert sum(report.rows["broken"].values()) + sum(report.removed.values()) + report.kept == 31276
    assert report.kept > 0.85 * 31276
    assert len(report.machines) == 3
    widths = [m["header_width_m"] for m in report.machines]
    assert widths == pytest.approx([10.668, 11.887, 11.887], abs=1e-3)


def test_2018_was_shifted_by_its_monitor(henrys, west):
    for report, _ in (henrys, west):
        for machine in report.machines:
            assert abs(machine["flow_delay_s"]) < 2.5 or machine["flow_delay_method"].startswith("not known")
    assert west[0].machines[0]["flow_delay_s"] == pytest.approx(-1.0, abs=0.2)


def test_2018_heights_agree_with_another_interpolation(henrys):
    report, field = henrys
    other = Raster.from_geotiff(
        MONTANA / "si" / "farmerI_henrys_terrain_4m_utm12n.tif", (field.origin.easting, field.origin.northing)
    )
    x, y = (a.ravel() for a in np.meshgrid(*other.centres()))
    crop = np.isfinite(field.stems.sample(x, y)) & np.isfinite(other.values.ravel())
    error = field.terrain.sample(x, y) + field.origin.height - other.values.ravel()
    assert crop.sum() > 40000
    assert np.sqrt(np.mean(error[crop] ** 2)) < 0.05
    assert np.percentile(np.abs(error[crop]), 99) < 0.10
    assert report.terrain["relief_m"] == pytest.approx(12.0, abs=0.3)
    assert report.terrain["pass_offset_sd_m"] == 0.0  # RTK heights: nothing to take off


def test_2018_flow_and_speed_are_those_of_the_log(henrys):
    _, field = henrys
    speeds = [t.mean_speed for t in field.tracks if t.length > 300]
    assert np.median(speeds) == pytest.approx(2.11, abs=0.1)
    assert np.median(lateral_sds(field)) == pytest.approx(0.032, abs=0.006)
    assert np.degrees(field.row_azimuth) == pytest.approx(180.0, abs=0.5)


def test_the_shapefile_gives_the_same_field_as_its_conversion(tmp_path_factory):
    """With a delay that is given: what is hardly known in one form may hardly not be in the other."""
    (report, field), (raw, raw_field) = (
        imported(tmp_path_factory, name, settings=Settings(flow_delay_s=0.0))
        for name in ("si/farmerI_henrys_2018_wheat.csv.gz", "raw/FarmerI_YL18_YLD_2018_henrys.zip")
    )
    assert raw.rows["read"] == 31276
    assert raw.kept == pytest.approx(report.kept, abs=20)
    assert raw.crop["yield_t_ha"] == pytest.approx(report.crop["yield_t_ha"], rel=2e-3)
    assert len(raw_field.tracks) == len(field.tracks)
    assert field.origin == raw_field.origin
    x, y = np.meshgrid(np.arange(250.0, 350.0, 5.0), np.arange(-600.0, 600.0, 5.0))
    np.testing.assert_allclose(raw_field.terrain.sample(x, y), field.terrain.sample(x, y), atol=0.02)
    difference = raw_field.stems.sample(x, y) / field.stems.sample(x, y) - 1.0
    assert np.abs(np.median(difference)) < 1e-3


def test_2014_passes_lie_as_far_apart_as_measured(west):
    report, field = west
    assert report.rows["read"] == 47872
    assert sum(report.rows["broken"].values()) + sum(report.removed.values()) + report.kept == 47872
    assert report.field["pass_spacing_m"] == pytest.approx(11.89, abs=0.02)
    assert report.field["pass_spacing_sd_m"] < 0.08
    assert np.median(lateral_sds(field)) == pytest.approx(0.029, abs=0.003)
    assert {t.header_width for t in field.tracks} == {12.192}


def test_2014_positions_that_jump_are_no_second_machine(west):
    """3,932 records lie far from the others, in blocks and one by one; they do not alternate with them."""
    report, _ = west
    assert len(report.machines) == 1
    assert not any("machines distinguished" in note for note in report.notes)


def test_2014_heights_drift_between_passes_and_are_levelled(west):
    report, _ = west
    terrain = report.terrain
    assert terrain["pass_offset_sd_m"] > 0.1
    assert terrain["pass_step_sd_m"] < 0.75 * terrain["pass_step_sd_before_m"]


def test_a_field_of_the_bounding_file_is_taken(tmp_path_factory):
    boundary = MONTANA / "boundaries" / "henrys_bbox.zip"
    report, field = imported(tmp_path_factory, "si/farmerI_henrys_2018_wheat.csv.gz", boundary=boundary)
    assert len(field.boundary) == 12
    assert report.removed["outside_boundary"] < 100
    assert report.field["area_ha"] > 85.0
