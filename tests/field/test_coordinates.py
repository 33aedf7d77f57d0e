"""Positions with exchanged axes, other units, other signs: refused with the entry that mends them, anywhere
on earth and in any direction; right ones are read.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("scipy")
pytest.importorskip("pyproj")
pytest.importorskip("shapefile")

from swath.core.errors import InputError
from swath.field.maps.projection import transform, utm_epsg
from swath.field_io.logs.columns import Column
from swath.field_io.logs.coordinates import in_degrees, numbers, place
from swath.field_io.logs.log import read_log
from swath.field_io.logs.table import read_table
from swath.field_io.logs.witnesses import PLACES, Drive, Logged, place_pairs
from tests.field.unit_logs import Harvest, shapes, table
from tests.shared_data import DATA

SEEDS = [0, 1, *(pytest.param(seed, marks=pytest.mark.draws) for seed in range(2, 6))]


def drawn(seed, *, is_slanted=False):
    """A harvest somewhere on earth, in some direction; is_slanted: 20 degrees and more off north and east."""
    rng = np.random.default_rng(seed)
    lat = float(rng.uniform(15, 68)) * rng.choice([-1, 1])
    turn = 90.0 * rng.integers(4) + rng.uniform(20, 70) if is_slanted else rng.uniform(0, 360)
    return Harvest(lat, float(rng.uniform(-179, 179)), azimuth_deg=float(turn),
                   width=float(rng.uniform(5, 13)), speed=float(rng.uniform(1.2, 2.6)), seed=seed, passes=8,
                   length=160.0)  # fmt: skip


def minutes(degrees):
    """Degrees as NMEA 0183 writes them."""
    whole = np.trunc(degrees)
    return 100.0 * whole + 60.0 * (degrees - whole)


WRONG = {
    "exchanged": lambda lat, lon: (lon, lat),
    "rad": lambda lat, lon: (np.radians(lat), np.radians(lon)),
    "ddmm": lambda lat, lon: (minutes(lat), minutes(lon)),
    "1e-7 deg": lambda lat, lon: (1e7 * lat, 1e7 * lon),
    "exchanged, ddmm": lambda lat, lon: (minutes(lon), minutes(lat)),
    "deg W": lambda lat, lon: (lat, -lon),
    "deg S": lambda lat, lon: (-lat, lon),
}  # fmt: skip


def witnesses(h):
    """All that a log may hold about its way."""
    return {
        "time_s": h.t, "speed_m_s": h.speed * h.one, "distance_m": h.speed * h.one,
        "width_m": h.width * h.one, "heading_deg": h.course, "flow_kg_s": h.flow,
    }  # fmt: skip


def written(path, lat, lon, columns):
    """Text; positions of ten decimals."""
    cells = {"lat": [f"{v:.10f}" for v in lat], "lon": [f"{v:.10f}" for v in lon]}
    return table(path / "log.csv", cells | columns)


def off(log, h):
    """Farthest from the true place [m]."""
    true = transform(np.column_stack([h.lon, h.lat]), "EPSG:4326", f"EPSG:{log.epsg}")
    return float(np.abs(log.position - true).max()) if len(log) == len(true) else np.inf


def mended(log, h, error, path, *more):
    """How far off the log is [m] by each reading that an error offers."""
    for other in error.others:
        entries = re.findall(r"\w+: \{.*?\}", str(other))
        (path / "map.yaml").write_text("\n".join([*more, *entries]))
        yield off(read_log(log, path / "map.yaml"), h)


@pytest.mark.parametrize("seed", range(6))
def test_right_positions_are_read_without_a_word_whatever_the_log_holds(tmp_path, seed):
    h = drawn(seed)
    held = np.random.default_rng(seed).random(3) < 0.5
    left = np.array(["speed_m_s", "distance_m", "heading_deg"])[held]
    columns = {name: values for name, values in witnesses(h).items() if name not in left}
    log = read_log(written(tmp_path, h.lat, h.lon, columns))
    assert off(log, h) < 0.01
    assert not [note for note in log.notes if note.startswith("place:")]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_positions_are_refused_with_entries_that_mend_them(tmp_path, wrong, seed):
    h = drawn(seed, is_slanted=wrong.startswith("deg"))  # a compass may lie 20 degrees beside the way
    log = written(tmp_path, *WRONG[wrong](h.lat, h.lon), witnesses(h))
    with pytest.raises(InputError) as refused:
        read_log(log)
    assert refused.value.key == "place"
    assert min(mended(log, h, refused.value, tmp_path)) < 0.01, refused.value.others


@pytest.mark.parametrize(
    ("held", "azimuth"),
    [("speed_m_s", 90.0), ("distance_m", 0.0), ("width_m", 0.0), ("width_m", 90.0), ("heading_deg", 90.0)],
)
def test_one_witness_is_enough_where_it_lies_across_the_stretched_axis(tmp_path, held, azimuth):
    h = Harvest(52.0, 9.0, azimuth_deg=azimuth, passes=8, length=160.0)
    columns = {"time_s": h.t, "width_m": h.width * h.one, "flow_kg_s": h.flow, held: witnesses(h)[held]}
    log = written(tmp_path, h.lon, h.lat, columns)
    is_seen = held == "heading_deg" or azimuth == 0.0 or held != "width_m"
    if not is_seen:  # passes along the stretched axis, their spacing is right
        assert read_log(log).epsg == utm_epsg(52.0, 9.0)
        return
    with pytest.raises(InputError, match=r"place = lat in deg, .*lat and lon exchanged") as refused:
        read_log(log)
    assert min(mended(log, h, refused.value, tmp_path)) < 0.01


def test_what_the_user_says_counts_and_the_doubt_is_told(tmp_path):
    h = Harvest(52.0, 9.0)
    log = written(tmp_path, h.lon, h.lat, witnesses(h))
    (tmp_path / "map.yaml").write_text("lat: {unit: deg}\nlon: {unit: deg}\n")
    read = read_log(log, tmp_path / "map.yaml")
    assert read.epsg == utm_epsg(52.0, 9.0)
    told = next(note for note in read.notes if note.startswith("place:"))
    assert re.match(r"place: lat in deg, lon in deg, though .*passes lie 14\.", told)


def round_the_field(rng, sides):
    """Way [m], (n, 2), and whether it is in a turn: U-turns behind passes, corners behind rounds."""
    step, radius, at, heading = 2.0, float(rng.uniform(4.0, 8.0)), np.zeros(2), float(rng.uniform(0, 360))
    points, turning = [], []
    for k in range(12):
        for is_turn in (False, True):
            count = round((np.pi if sides == 2 else np.pi / 2) * radius / step) if is_turn else 90
            side = 1 if sides == 4 or k % 2 else -1
            for _ in range(count):
                heading += is_turn * side * (180.0 if sides == 2 else 90.0) / count
                at = at + step * np.array([np.sin(np.radians(heading)), np.cos(np.radians(heading))])
                points.append(at)
                turning.append(is_turn)
    return np.array(points), np.array(turning)


@pytest.mark.parametrize("sides", [2, 4])
@pytest.mark.parametrize("seed", range(4))
def test_a_speed_that_is_off_in_turns_says_nothing_about_places(seed, sides):
    rng = np.random.default_rng(seed)
    position, is_turn = round_the_field(rng, sides)
    count = len(position)
    drive = Drive((11.0, 48.0), np.arange(count - 1), np.arange(1, count), np.full(count - 1, 2.0))
    columns = {"speed": Column("speed", "m/s"), "distance": Column("distance", "m")}

    def told(of_turns, stretch):
        """stretch: of the read positions, across their first pass"""
        ahead = position[40] - position[20]
        ahead = ahead / np.hypot(*ahead)
        across = np.array([-ahead[1], ahead[0]])
        read = position + np.outer(position @ across, across) * (stretch - 1.0)
        moved = replace(drive, step=np.hypot(*np.diff(read, axis=0).T))
        own = 2.0 * np.where(is_turn, of_turns, 1.0)
        raw = {"speed": own, "distance": own}
        log = Logged(columns, raw, np.arange(float(count)), ("s",), ~is_turn, None)
        return [p for p in place_pairs(log, read, moved) if p.key == PLACES and not p.agrees]

    for of_turns in (0.4, 1.0, 2.5):
        assert told(of_turns, 1.0) == []
        assert len(told(of_turns, 1.4)) == (2 if sides == 4 else 0)


GRID = {"cm": (100.0, False), "km": (1e-3, False), "exchanged": (1.0, True), "exchanged, cm": (100.0, True)}


@pytest.mark.parametrize("wrong", GRID)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.draws)])
def test_eastings_and_northings_in_other_units_or_order_are_refused(tmp_path, wrong, seed):
    h = drawn(seed)
    epsg = utm_epsg(float(np.median(h.lon)), float(np.median(h.lat)))
    grid = transform(np.column_stack([h.lon, h.lat]), "EPSG:4326", f"EPSG:{epsg}") * GRID[wrong][0]
    x, y = grid.T[::-1] if GRID[wrong][1] else grid.T
    places = {"easting": [f"{v:.9f}" for v in x], "northing": [f"{v:.9f}" for v in y]}
    log = table(tmp_path / "log.csv", places | witnesses(h))
    crs = f"crs: EPSG:{epsg}"
    (tmp_path / "crs.yaml").write_text(crs)
    with pytest.raises(InputError, match="place = ") as refused:
        read_log(log, tmp_path / "crs.yaml")
    assert min(mended(log, h, refused.value, tmp_path, crs)) < 0.1, refused.value.others


def test_a_zone_far_away_is_refused_and_the_next_one_is_read(tmp_path):
    h = Harvest(52.0, 9.0)
    grid = transform(np.column_stack([h.lon, h.lat]), "EPSG:4326", "EPSG:32632")
    places = {"easting": grid[:, 0], "northing": grid[:, 1]}
    log = table(tmp_path / "log.csv", places | witnesses(h))
    (tmp_path / "crs.yaml").write_text("crs: EPSG:2056")  # Switzerland
    with pytest.raises(InputError, match="position_out_of_range"):
        read_log(log, tmp_path / "crs.yaml")
    beside = transform(np.column_stack([h.lon, h.lat]), "EPSG:4326", "EPSG:32633")
    log = table(tmp_path / "log.csv", {"easting": beside[:, 0], "northing": beside[:, 1]} | witnesses(h))
    (tmp_path / "crs.yaml").write_text("crs: EPSG:32633")
    assert off(read_log(log, tmp_path / "crs.yaml"), h) < 0.01


def test_shapes_with_x_and_y_exchanged_are_refused_and_read_by_axes(tmp_path):
    h = Harvest(52.0, 9.0)
    h.lat, h.lon = h.lon, h.lat
    log = shapes(tmp_path / "s", h, witnesses(h))
    with pytest.raises(InputError, match="all agrees with x and y exchanged") as refused:
        read_log(log)
    (other,) = refused.value.others
    assert re.search(r"x and y exchanged, at 52\.\d+ N, 9\..*, write axes: yx", str(other))
    h.lat, h.lon = h.lon, h.lat
    (tmp_path / "map.yaml").write_text("axes: yx")
    assert off(read_log(log, tmp_path / "map.yaml"), h) < 0.01
    (tmp_path / "map.yaml").write_text("axes: zx")
    with pytest.raises(InputError, match="axes = zx: expected xy or yx"):
        read_log(log, tmp_path / "map.yaml")


TEXTS = {
    "degrees, minutes, seconds": lambda v, a, b: f"{int(v)}°{int(v % 1 * 60)}'{v * 60 % 1 * 60:.6f}\"{b}",
    "degrees and minutes": lambda v, a, b: f"{b}{int(v)} {v % 1 * 60:.8f}",
    "degrees and a letter": lambda v, a, b: f"{v:.9f} {b}",
}


@pytest.mark.parametrize("form", TEXTS)
@pytest.mark.parametrize("at", [(52.0, 9.0), (-32.0, -63.5)])
def test_degrees_as_text_with_letters_are_read(tmp_path, form, at):
    h = Harvest(*at, passes=4, length=120.0)
    north = [TEXTS[form](abs(v), v, "N" if v > 0 else "S") for v in h.lat]
    east = [TEXTS[form](abs(v), v, "E" if v > 0 else "W") for v in h.lon]
    assert off(read_log(table(tmp_path / "a.csv", {"lat": north, "lon": east} | witnesses(h))), h) < 0.01


def test_words_and_impossible_angles_are_no_position(tmp_path):
    texts = ["52°75'", "N52 S", "somewhere", "252.0 N", "52 15 61", ""]
    path = table(tmp_path / "a.csv", {"lat": texts, "lon": texts, "x": texts})
    assert np.isnan(numbers(read_table(path), Column("lat", "deg"))).all()


@pytest.mark.parametrize("degrees", [52.252057, -0.5, 179.99, -33.0])
def test_nmea_degrees_and_minutes(degrees):
    assert in_degrees(minutes(np.array([degrees])), "ddmm")[0] == pytest.approx(degrees, abs=1e-12)


def test_a_place_is_told_with_its_hemisphere_and_zone():
    assert place(np.array([[9.87654, 52.1]])) == "52.1000 N, 9.8765 E (UTM zone 32N, EPSG:32632)"
    south_west = np.array([[-63.5, -32.0], [np.nan, 1.0]])
    assert place(south_west) == "32.0000 S, 63.5000 W (UTM zone 20S, EPSG:32720)"
    assert place(np.array([[9.0, 5215.1]])).endswith("which is not on earth")


def test_a_measured_log_is_read_without_a_doubt_of_its_positions():
    """As those of Montana are, test_import_montana.py."""
    path = DATA / "agridat_cereal" / "gartner.corn.txt"
    if not path.is_file():
        pytest.skip("needs real yield logs: SWATH_DATA")
    notes = read_log(path, header_width=9.144, crop="maize").notes
    assert not [note for note in notes if note.startswith("place:")]
