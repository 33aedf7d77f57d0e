"""Real logs import as they are, and agree with figures measured from them independently."""

import numpy as np
import pytest

pytest.importorskip("rasterio")

from swath.field.maps.raster import Raster
from swath.field_io import folder
from swath.field_io.importer import import_log
from swath.field_io.logs.log import read_log
from swath.field_io.passes import lateral_sd
from tests.shared_data import MONTANA

pytestmark = pytest.mark.skipif(not MONTANA.is_dir(), reason="needs the Montana yield logs: SWATH_DATA")


def imported(tmp_path_factory, log, **options):
    out = tmp_path_factory.mktemp("montana") / "field"
    return import_log(MONTANA / log, out, progress=False, **options), folder.read(out)


@pytest.fixture(scope="module")
def henrys(tmp_path_factory):
    """Within the outline of its bounding file."""
    boundary = MONTANA / "boundaries" / "henrys_bbox.zip"
    return imported(tmp_path_factory, "si/farmerI_henrys_2018_wheat.csv.gz", boundary=boundary)


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


def test_2018_was_shifted_by_its_monitor(henrys):
    report, _ = henrys
    for machine in report.machines:
        assert abs(machine["flow_delay_s"]) < 2.5 or machine["flow_delay_method"].startswith("not known")
    assert not [note for note in report.notes if note.startswith("place:")]


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


def test_the_shapefile_gives_the_same_records_as_its_conversion():
    """All that a field is made of, but for what the conversion rounds."""
    log, raw = (
        read_log(MONTANA / name)
        for name in ("si/farmerI_henrys_2018_wheat.csv.gz", "raw/FarmerI_YL18_YLD_2018_henrys.zip")
    )
    assert raw.row_count == log.row_count == 31276
    assert raw.epsg == log.epsg
    assert raw.crop == log.crop
    assert {k: n for k, n in raw.broken.items() if n} == {k: n for k, n in log.broken.items() if n}
    for name in ("time", "moisture", "machine"):
        np.testing.assert_array_equal(getattr(raw, name), getattr(log, name))
    for name, off in {
        "position": 0.01,
        "width": 1e-3,
        "speed": 1e-3,
        "flow": 1e-3,
        "elevation": 1e-3,
    }.items():
        np.testing.assert_allclose(getattr(raw, name), getattr(log, name), rtol=0, atol=off)
    assert not [note for note in raw.notes if note.startswith("place:")]


@pytest.mark.draws
def test_2014_was_shifted_by_its_monitor(west):
    report, _ = west
    assert report.machines[0]["flow_delay_s"] == pytest.approx(-1.0, abs=0.2)
    assert not [note for note in report.notes if note.startswith("place:")]


@pytest.mark.draws
def test_2014_passes_lie_as_far_apart_as_measured(west):
    report, field = west
    assert report.rows["read"] == 47872
    assert sum(report.rows["broken"].values()) + sum(report.removed.values()) + report.kept == 47872
    assert report.field["pass_spacing_m"] == pytest.approx(11.89, abs=0.02)
    assert report.field["pass_spacing_sd_m"] < 0.08
    assert np.median(lateral_sds(field)) == pytest.approx(0.029, abs=0.003)
    assert {t.header_width for t in field.tracks} == {12.192}


@pytest.mark.draws
def test_2014_positions_that_jump_are_no_second_machine(west):
    """3,932 records lie far from the others, in blocks and one by one; they do not alternate with them."""
    report, _ = west
    assert len(report.machines) == 1
    assert not any("distinguished by their positions" in note for note in report.notes)


@pytest.mark.draws
def test_2014_heights_drift_between_passes_and_are_levelled(west):
    report, _ = west
    terrain = report.terrain
    assert terrain["pass_offset_sd_m"] > 0.1
    assert terrain["pass_step_sd_m"] < 0.75 * terrain["pass_step_sd_before_m"]


def test_a_field_of_the_bounding_file_is_taken(henrys):
    report, field = henrys
    assert len(field.boundary) == 12
    assert report.removed["outside_boundary"] < 100
    assert report.field["area_ha"] > 85.0
