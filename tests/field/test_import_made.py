"""An import of a made log gives back the field it was made from."""

import json

import numpy as np
import pytest

from tests.field.made_log import COLUMNS, EAST, EPSG, HEADER, LENGTH, NORTH, MadeLog, grain_at, ground_at

pytest.importorskip("rasterio")

from swath.core.errors import InputError
from swath.field_io import folder
from swath.field_io.clean import clean
from swath.field_io.importer import Settings, import_log, show
from swath.field_io.logs.log import read_log
from swath.field_io.logs.machines import separate_machines


def columns(path):
    path.write_text(COLUMNS)
    return path


def run(tmp_path, made, **settings):
    log = made.write(tmp_path / "log.csv")
    return import_log(
        log,
        tmp_path / "field",
        columns=columns(tmp_path / "map.yaml"),
        settings=Settings(**settings),
        progress=False,
    )


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    path = tmp_path_factory.mktemp("made")
    report = run(path, MadeLog(drift_m=0.12))
    return report, folder.read(path / "field")


def on_grid(field, x, y):
    """Points of the made field in the local frame of the folder."""
    return x + EAST - field.origin.easting, y + NORTH - field.origin.northing


def inner():
    x, y = np.meshgrid(np.arange(12.0, 216.0, 5.0), np.arange(20.0, 340.0, 5.0))
    return x.ravel(), y.ravel()


def test_the_yield_map_is_the_made_one(imported):
    _, field = imported
    x, y = inner()
    made = field.grain.sample(*on_grid(field, x, y))
    error = made - grain_at(x, y)
    assert abs(error.mean()) < 0.01
    assert error.std() < 0.045  # of 0.12 sd: a kernel of half a header smooths waves of 80 m by a fifth
    assert np.corrcoef(made, grain_at(x, y))[0, 1] > 0.97


def test_stems_are_yield_over_grain_per_stem(imported):
    report, field = imported
    np.testing.assert_allclose(field.stems.values, field.grain.values / 0.0018, rtol=1e-6)
    assert report.crop["stems_clipped_cells"] == 0


def test_what_was_cut_is_on_the_map(imported):
    report, _ = imported
    made = 20 * HEADER * LENGTH * 0.6  # the waves nearly cancel
    assert report.crop["grain_on_map_kg"] == pytest.approx(made, rel=0.04)
    assert report.crop["grain_logged_kg"] == pytest.approx(made, rel=0.04)


def test_terrain_comes_without_the_drift_between_passes(imported):
    report, field = imported
    x, y = inner()
    error = field.terrain.sample(*on_grid(field, x, y)) + field.origin.height - ground_at(x, y)
    error -= error.mean()
    assert report.terrain["pass_offset_sd_m"] > 0.05
    across = error.reshape(64, 41)
    assert np.diff(across, axis=1).std() < 0.04  # drift alone: 0.12 sqrt(2) over 12 m
    assert error.std() < 0.1


def test_passes_come_in_driven_order(imported):
    report, field = imported
    assert len(field.tracks) == 20
    assert [t.index for t in field.tracks] == list(range(20))
    easts = [t.line[:, 0].mean() for t in field.tracks]
    np.testing.assert_allclose(np.diff(easts), 12.0, atol=0.1)
    assert report.field["pass_spacing_m"] == pytest.approx(12.0, abs=0.05)
    up, down = field.tracks[0], field.tracks[1]
    assert np.degrees(up.azimuth) % 360 == pytest.approx(0.0, abs=1.0) or np.degrees(up.azimuth) > 359
    assert np.degrees(down.azimuth) == pytest.approx(180.0, abs=1.0)
    assert down.heading == pytest.approx(-np.pi / 2, abs=0.02)
    assert up.mean_speed == pytest.approx(2.0, rel=0.01)
    assert up.length == pytest.approx(LENGTH, rel=0.1)
    assert (
        np.degrees(field.row_azimuth) % 180 == pytest.approx(0.0, abs=0.2)
        or np.degrees(field.row_azimuth) > 179.8
    )
    assert all(len(t.straights) == 1 for t in field.tracks)
    assert np.median([t.straights[0].lateral_sd for t in field.tracks]) == pytest.approx(0.03, rel=0.2)


def test_the_outline_is_the_ground_driven_over(imported):
    report, field = imported
    assert report.field["area_ha"] == pytest.approx(20 * HEADER * LENGTH / 1e4, rel=0.05)
    x, y = field.boundary.T
    assert 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) == pytest.approx(
        report.field["area_ha"] * 1e4, rel=0.01
    )
    assert field.holes == ()


def test_moisture_is_mapped_and_height_is_the_default(imported):
    _, field = imported
    x, y = inner()
    np.testing.assert_allclose(field.moisture.sample(*on_grid(field, x, y)), 0.13 + 5e-5 * x, atol=1e-3)
    crop = np.isfinite(field.stems.values)
    np.testing.assert_array_equal(np.isfinite(field.height.values), crop)
    assert np.unique(field.height.values[crop]).tolist() == [np.float32(0.85)]


@pytest.mark.parametrize("delay", [0.0, 6.0, 17.0])
def test_the_flow_delay_is_found(tmp_path, delay):
    report = run(tmp_path, MadeLog(passes=10, delay_s=delay))
    machine = report.machines[0]
    assert machine["flow_delay_s"] == pytest.approx(delay, abs=0.6)
    assert machine["flow_delay_method"].startswith("agreement of its turns")


def test_without_neighbours_the_delay_is_not_known_and_nothing_is_shifted(tmp_path):
    log = read_log(MadeLog(passes=1).write(tmp_path / "a.csv"), columns(tmp_path / "m.yaml"))
    cleaned = clean(log)
    assert np.isnan(cleaned.delays[0].seconds)
    assert cleaned.delays[0].method.startswith("not known, flow not shifted")
    np.testing.assert_array_equal(cleaned.flow, log.flow)


def test_machines_that_a_log_does_not_name_are_told_apart(tmp_path):
    made = MadeLog(machines=2)
    made.rows.sort(key=lambda row: row["time"])
    text = COLUMNS.replace("machine: {column: machine, unit: text}\n", "machine: null\n")
    (tmp_path / "m.yaml").write_text(text)
    log = read_log(made.write(tmp_path / "a.csv"), tmp_path / "m.yaml")
    assert len(log.machine_names) == 2
    for machine in range(2):
        names = {made.rows[row - 2]["machine"] for row in log.row_number[log.machine == machine]}
        assert len(names) == 1


def test_one_machine_stays_one():
    t = np.arange(2000.0)
    assert separate_machines(t, 2.0 * t % 700, 12.0 * (2.0 * t // 700)).max() == 0


def test_a_given_boundary_is_the_field(tmp_path):
    from swath.field.maps.projection import Origin

    corners = np.array([[20, 30], [140, 30], [140, 300], [20, 300], [20, 30]], float)
    ring = Origin(EPSG, EAST, NORTH).to_lon_lat(corners).tolist()
    (tmp_path / "b.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    log = MadeLog().write(tmp_path / "log.csv")
    report = import_log(
        log,
        tmp_path / "f",
        boundary=tmp_path / "b.geojson",
        columns=columns(tmp_path / "m.yaml"),
        progress=False,
    )
    field = folder.read(tmp_path / "f")
    local = corners[:-1] + np.array([EAST - field.origin.easting, NORTH - field.origin.northing])
    assert sorted(map(tuple, np.round(field.boundary, 3))) == sorted(map(tuple, np.round(local, 3)))
    assert report.removed["outside_boundary"] > 1000
    assert np.isnan(field.stems.sample(local[0, 0] - 10.0, local[0, 1]))


def test_a_dem_is_taken_as_it_is(tmp_path):
    from swath.field.maps.raster import Raster

    y, x = np.mgrid[-60:440:2.0, -60:320:2.0]
    Raster(ground_at(x, y).astype(np.float32), EAST - 60.0, NORTH - 60.0, 2.0).to_geotiff(
        tmp_path / "dem.tif", EPSG
    )
    log = MadeLog().write(tmp_path / "log.csv")
    report = import_log(
        log, tmp_path / "f", dem=tmp_path / "dem.tif", columns=columns(tmp_path / "m.yaml"), progress=False
    )
    field = folder.read(tmp_path / "f")
    x, y = inner()
    error = field.terrain.sample(*on_grid(field, x, y)) + field.origin.height - ground_at(x, y)
    assert np.abs(error).max() < 0.02
    assert report.terrain["source"] == "DEM dem.tif"
    far = Raster(np.ones((50, 50), np.float32), EAST + 9000.0, NORTH, 2.0)
    far.to_geotiff(tmp_path / "far.tif", EPSG)
    with pytest.raises(InputError, match=r"place = 0 %.*far\.tif"):
        import_log(log, tmp_path / "g", dem=tmp_path / "far.tif", columns=tmp_path / "m.yaml", progress=False)
    assert not (tmp_path / "g").exists()


def test_other_units_give_the_same_field(tmp_path, imported):
    report, _ = imported
    made = MadeLog(drift_m=0.12)
    text = (
        COLUMNS.replace("column: flow, unit: kg/s", 'column: "flow, wet", unit: lb/s')
        .replace("column: speed, unit: m/s", "column: speed, unit: km/h")
        .replace("column: swath, unit: m", "column: swath, unit: ft")
    )
    (tmp_path / "m.yaml").write_text(text)
    scale = {"flow": 1 / 0.45359237, "speed": 3.6, "swath": 1 / 0.3048}
    log = made.write(tmp_path / "a.csv", names={"flow": "flow, wet"}, scale=scale)
    other = import_log(log, tmp_path / "f", columns=tmp_path / "m.yaml", progress=False)
    assert other.crop["yield_t_ha"] == pytest.approx(report.crop["yield_t_ha"], rel=1e-4)
    assert other.kept == pytest.approx(report.kept, abs=5)


@pytest.mark.drawn
def test_a_folder_is_written_twice_the_same_and_drawn_again(tmp_path):
    made = MadeLog(passes=3)
    run(tmp_path, made)
    first = {p.name: p.read_bytes() for p in (tmp_path / "field").iterdir()}
    assert set(first) == {
        "field.yaml", "terrain.tif", "density.tif", "height.tif", "moisture.tif", "yield.tif",
        "boundary.geojson", "tracks.geojson", "overview.png",
    }  # fmt: skip
    run(tmp_path, made)
    assert {p.name: p.read_bytes() for p in (tmp_path / "field").iterdir()} == first
    (tmp_path / "field" / "overview.png").unlink()
    picture = show(tmp_path / "field")
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]


def test_obstacles_come_back_in_local_metres(tmp_path):
    run(tmp_path, MadeLog(passes=4))
    field = folder.read(tmp_path / "field")
    lon_lat = field.origin.to_lon_lat([[10.0, -20.0]])[0].tolist()
    post = {"geometry": {"type": "Point", "coordinates": lon_lat}, "properties": {"kind": "post"}}
    text = json.dumps({"type": "FeatureCollection", "features": [{"type": "Feature", **post}]})
    (tmp_path / "field" / "obstacles.geojson").write_text(text)
    ((geometry, properties),) = folder.read(tmp_path / "field").obstacles
    np.testing.assert_allclose(geometry["coordinates"], [10.0, -20.0], atol=1e-3)
    assert properties == {"kind": "post"}


def test_local_and_lon_lat_undo_each_other(imported):
    _, field = imported
    points = np.array([[0.0, 0.0], [120.0, -300.0]])
    np.testing.assert_allclose(field.origin.to_local(field.origin.to_lon_lat(points)), points, atol=1e-6)
