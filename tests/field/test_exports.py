"""Logs as programs of makers write them are taken as they are, and a run on their field works."""

import json

import numpy as np
import pytest

pytest.importorskip("rasterio")
pytest.importorskip("shapefile")

from swath.core.errors import InputError
from swath.field_io import folder, trade
from swath.field_io.importer import Settings, import_log
from swath.field_io.logs.log import read_log
from swath.field_io.pass_scenario import _longest_straight, write_pass_scenario
from swath.runtime.assembly import assemble
from swath.runtime.job import run_unrecorded
from swath.scenario.scenario import load_scenario
from tests.field import made_exports
from tests.field.made_log import HEADER, LENGTH, SPEED, MadeLog, grain_at

FORMS = {
    "john deere": lambda path: made_exports.john_deere(path / "doc"),
    "sms 12 h": lambda path: made_exports.sms(path / "sms.txt"),
    "sms 24 h": lambda path: made_exports.sms(path / "sms.txt", clock="%H:%M:%S"),
    "platform": lambda path: made_exports.farm_platform(path / "platform.csv"),
    "german": lambda path: made_exports.german(path / "ernte.csv"),
    "ag leader": lambda path: made_exports.ag_leader(path / "yield.txt"),
}


@pytest.mark.parametrize("form", FORMS)
def test_the_log_of_a_maker_is_read_as_it_is(tmp_path, form):
    log, made = read_log(FORMS[form](tmp_path)), MadeLog(passes=6)
    assert len(log) == len(made.rows)
    assert log.crop == "wheat"
    assert log.machine_names == ("1",) or len(log.machine_names) == 1
    np.testing.assert_allclose(log.time, [row["time"] for row in made.rows], atol=1e-6)
    np.testing.assert_allclose(log.width, HEADER, rtol=1e-4)
    np.testing.assert_allclose(log.flow, [row["flow"] for row in made.rows], rtol=2e-3, atol=1e-3)
    np.testing.assert_allclose(log.speed, SPEED, rtol=2e-3)
    np.testing.assert_allclose(log.moisture, [row["moisture"] / 100 for row in made.rows], atol=1e-6)
    np.testing.assert_allclose(np.diff(log.east), np.diff([r["easting"] for r in made.rows]), atol=0.01)
    if form != "platform":
        np.testing.assert_allclose(log.elevation, [row["elevation"] for row in made.rows], atol=1e-3)


def test_a_folder_of_a_shapefile_and_its_zip_are_the_shapefile(tmp_path):
    import shutil

    shape = made_exports.john_deere(tmp_path / "doc")
    plain = read_log(shape)
    packed = shutil.make_archive(str(tmp_path / "packed"), "zip", tmp_path / "doc")
    for place in (shape.parent, tmp_path / packed):
        np.testing.assert_array_equal(read_log(place).flow, plain.flow)


def test_units_and_crop_of_the_makers_metadata_win(tmp_path):
    about = {
        "CropName": "Soybeans",
        "DataAttributes": [{"Name": "WetMass", "Unit": "kg1ha-1"}],
    }
    plain = read_log(made_exports.john_deere(tmp_path / "a", crop="Soybeans"))
    log = read_log(made_exports.john_deere(tmp_path / "b", crop="", mass=1e4, metadata=json.dumps(about)))
    assert log.crop == "soy"
    assert log.width[0] == pytest.approx(HEADER)
    np.testing.assert_allclose(log.flow, plain.flow, rtol=1e-6)


def test_a_bad_clock_costs_the_clock_not_the_rows(tmp_path):
    path = made_exports.sms(tmp_path / "log.txt", clock="??")
    log = read_log(path)
    assert len(log) == len(MadeLog(passes=6).rows)
    assert any(note.startswith("clock: not used: 1 140 of 1 140") for note in log.notes), log.notes
    text = path.read_text().splitlines()
    good = made_exports.sms(tmp_path / "log.txt").read_text().splitlines()
    some = tmp_path / "some.txt"
    some.write_text(
        "\n".join(a if i % 7 == 3 else b for i, (a, b) in enumerate(zip(text, good, strict=True)))
    )
    log = read_log(some)
    assert len(log) == 1140
    np.testing.assert_allclose(log.time, [row["time"] for row in MadeLog(passes=6).rows], atol=1e-6)


def test_a_time_of_day_without_a_date_goes_on_after_midnight(tmp_path):
    from swath.field_io.logs.clock import seconds_of

    np.testing.assert_allclose(
        np.diff(seconds_of(["23:59:58", "23:59:59", "00:00:01", "0:00:02"])), [1, 2, 1]
    )
    np.testing.assert_allclose(
        np.diff(seconds_of(["11:59 PM", "12:00 AM"], ["31.12.2023", "01.01.2024"])), 60
    )
    np.testing.assert_allclose(
        np.diff(seconds_of(["9/8/2016 1:00:00 PM", "9/20/2016 1:00:00 PM"])), 12 * 86400
    )


def test_a_map_of_one_line_completes_what_is_recognised(tmp_path):
    path = made_exports.german(tmp_path / "ernte.csv")
    text = path.read_text(encoding="cp1252").replace("Ertrag [t/ha]", "Kärtrag")
    path.write_text(text, encoding="cp1252")
    (tmp_path / "map.yaml").write_text("yield: {column: Kärtrag, unit: t/ha}\ntime: null\n", encoding="utf-8")
    log = read_log(path, tmp_path / "map.yaml")
    assert len(log) == 1140
    assert "time" not in log.column_map.columns
    assert log.column_map.columns["lon"].column == "Länge"


def test_missing_columns_are_named_at_once_with_a_map_to_fill_in(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("a,b,c,d\n" + "".join(f"{47 + i * 1.8e-5:.7f},-110.5,8.5,12\n" for i in range(100)))
    (tmp_path / "fields").mkdir()
    with pytest.raises(InputError) as caught:
        import_log(path, tmp_path / "fields" / "out", progress=False)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["fields", "log.csv"]  # raw data stays as it is
    assert "lat and lon (or easting and northing), grain_flow or yield, header_width" in str(caught.value)
    template = tmp_path / "fields" / "log.columns.yaml"
    assert template.name in str(caught.value)
    filled = template.read_text()
    for column in "abcd":
        filled = filled.replace('"?"', column, 1)
    template.write_text(filled)
    log = read_log(path, template)
    assert len(log) == 100
    np.testing.assert_allclose(log.flow, 0.85 * 12 * log.speed)


@pytest.mark.parametrize(
    ("name", "sheet"), [("Soybeans", "soy"), ("Corn", "maize"), ("Gerste", "barley"), ("Soja", "soy")]
)
def test_the_crop_of_the_log_is_the_crop_of_the_field(tmp_path, name, sheet):
    assert read_log(made_exports.ag_leader(tmp_path / "log.txt", crop=name)).crop == sheet


def test_an_unknown_crop_is_refused_by_its_name_unless_a_sheet_is_given(tmp_path):
    path = made_exports.ag_leader(tmp_path / "log.txt", crop="Sunflower")
    with pytest.raises(InputError, match=r"crop = Sunflower: expected one of wheat.*--crop"):
        read_log(path)
    assert read_log(path, crop="rape").crop == "rape"


def test_a_log_that_names_no_crop_says_what_it_was_taken_for(tmp_path):
    log = made_exports.farm_platform(tmp_path / "log.csv")
    log.write_text(log.read_text().replace("crop_type", "who_knows"))
    assert any("the log names none, taken as wheat" in note for note in read_log(log).notes)


def test_one_receiver_that_jumps_is_one_machine(tmp_path):
    made = MadeLog(passes=6)
    rng = np.random.default_rng(3)
    for start in rng.integers(0, len(made.rows) - 40, 12):
        for row in made.rows[start : start + 35]:
            row["easting"] += 40.0
    lines = [f"{r['easting']},{r['northing']},{r['flow']},2,12,{r['time']}" for r in made.rows]
    (tmp_path / "log.csv").write_text("easting,northing,flow,speed,swath,time\n" + "\n".join(lines))
    (tmp_path / "map.yaml").write_text("crs: EPSG:32612\n" + "speed: {column: speed, unit: m/s}\n")
    assert read_log(tmp_path / "log.csv", tmp_path / "map.yaml").machine_names == ("1",)


def test_records_in_no_order_are_said_at_once_and_make_a_map(tmp_path):
    path = made_exports.ag_leader(tmp_path / "log.txt")
    lines = path.read_text().splitlines()
    np.random.default_rng(1).shuffle(lines)
    cells = [line.split(",") for line in lines]
    path.write_text("\n".join(",".join([*c[:3], "7", *c[4:]]) for c in cells))
    with pytest.raises(InputError, match="expected records in driving order; --as map"):
        import_log(path, tmp_path / "f", progress=False)
    report = import_log(path, tmp_path / "f", settings=Settings(as_map=True), progress=False)
    assert report.field["area_ha"] == pytest.approx(6 * HEADER * LENGTH / 1e4, rel=0.15)
    field = folder.read(tmp_path / "f")
    assert field.tracks == ()
    assert np.nanmean(field.grain.values) == pytest.approx(0.6, rel=0.06)
    assemble(load_scenario(write_pass_scenario(tmp_path / "f"))).close()


def test_a_map_of_yields_needs_no_width_and_a_small_one_is_told_from_a_track(tmp_path):
    """6 passes of a small field: neighbours are near, whatever the order."""
    path, rng = tmp_path / "map.csv", np.random.default_rng(2)
    lines = [f"{lon},{lat},{10 * made_exports.wet_yield(row)}" for lon, lat, row, _ in made_exports.rows()]
    rng.shuffle(lines)
    path.write_text("Longitude,Latitude,Yield (t/ha)\n" + "\n".join(lines))
    with pytest.raises(InputError, match=r"header_width.*--as map takes yields in any order"):
        read_log(path)
    with pytest.raises(InputError, match="expected records in driving order; --as map"):
        read_log(path, header_width=HEADER)
    report = import_log(path, tmp_path / "f", settings=Settings(as_map=True), progress=False)
    assert report.field["area_ha"] == pytest.approx(6 * HEADER * LENGTH / 1e4, rel=0.2)
    assert np.nanmean(folder.read(tmp_path / "f").grain.values) == pytest.approx(0.6, rel=0.06)


@pytest.mark.parametrize("name", ["Sunflower", "Spring Oats", "field peas", "Ackerbohnen"])
def test_a_product_that_is_a_crop_without_a_data_sheet_is_refused_and_a_variety_is_not(tmp_path, name):
    log = made_exports.farm_platform(tmp_path / "log.csv")
    text = log.read_text().replace("crop_type", "Product").replace(",wheat", f",{name}")
    assert name in text
    log.write_text(text)
    with pytest.raises(InputError, match=f"crop = {name}: expected one of wheat"):
        read_log(log)
    log.write_text(text.replace(name, "Ritmo"))
    assert any("product 'Ritmo' is not known, taken as wheat" in note for note in read_log(log).notes)
    bare = tmp_path / f"{name} 2024.csv"
    bare.write_text(text.replace("Product", "who_knows"))
    with pytest.raises(InputError, match=r"crop = .*: expected one of wheat"):
        read_log(bare)
    assert read_log(bare, crop="rye").crop == "rye"


@pytest.mark.parametrize(
    ("name", "sheet"),
    [
        ("Blé tendre d'hiver", "wheat"),
        ("Weichweizen", "wheat"),
        ("Trigo duro", "wheat"),
        ("Orge de printemps", "barley"),
        ("Colza d’hiver", "rape"),
        ("blé noir", None),
    ],
)
def test_crops_have_their_names_of_the_trade(name, sheet):
    assert trade.sheet_of(name) == sheet


SHORT = [
    "run.distance_m=2", "combine.lidar=off", "combine.edge=truth",
]  # fmt: skip


def test_a_run_on_the_field_of_a_log_cuts_its_crop(tmp_path):
    log = made_exports.ag_leader(tmp_path / "log.txt", crop="Corn", share=1.6)
    report = import_log(log, tmp_path / "f", progress=False)
    assert report.crop["name"] == "maize"
    assert report.crop["stems_clipped_cells"] == 0
    summary = run_unrecorded(load_scenario(write_pass_scenario(tmp_path / "f"), sets=SHORT))
    driven = summary["distance_m"] * HEADER
    assert summary["grain_cut_kg"] == pytest.approx(1.6 * made_yield(tmp_path / "f") * driven, rel=0.1)


def made_yield(field):
    """Yield [kg/m2] of the made field where the scenario of its import begins to cut."""
    track, start, _ = _longest_straight(folder.read(field))
    along = (track.line[-1] - track.line[0]) / np.hypot(*(track.line[-1] - track.line[0]))
    beside = np.linspace(-0.5, 0.5, 25)[:, None] * HEADER * [-along[1], along[0]]
    middle = 30.0, 0.5 * (LENGTH - SPEED)  # of the six passes, on which the frame of the field lies
    return grain_at(*(track.line[0] + (start + 3.0) * along + beside + middle).T).mean()
