"""What a log says twice: one of both is wrong, and the user is told which entry would mend it."""

import numpy as np
import pytest

pytest.importorskip("scipy")
pytest.importorskip("rasterio")

from swath.core.errors import InputError
from swath.documents.reasons import doubts
from swath.field_io.importer import import_log
from swath.field_io.logs.columns import Column
from swath.field_io.logs.log import read_log
from swath.field_io.logs.witnesses import level_pairs
from tests.field.unit_logs import ACRE, FT, LB, Harvest, table


def columns(h, **more):
    made = {**h.places(("lat", "lon")), "time_s": h.t, "width_m": h.width * h.one, "yield_t_ha": 10 * h.wet}
    return {**made, "moisture_pct": 100 * h.moisture * h.one, **more}


@pytest.mark.parametrize("flow", ["yield_t_ha", "grain_flow_kg_s"])
@pytest.mark.parametrize("late", [0, 6])
def test_grain_and_moisture_exchanged_are_refused_with_the_entry(tmp_path, flow, late):
    h = Harvest(late=late)
    grown = 10 * h.wet if flow == "yield_t_ha" else h.flow
    grown = grown * (1.0 + 0.3 * np.sin(h.t / 60.0))
    moist = 14.0 + 0.5 * np.sin(h.t / 200.0)
    right = columns(h) | {"moisture_pct": moist}
    right = {k: v for k, v in right.items() if k != "yield_t_ha"} | {flow: grown}
    read_log(table(tmp_path / "right.csv", right))
    path = table(tmp_path / "log.csv", right | {flow: moist, "moisture_pct": grown})
    with pytest.raises(InputError, match=f'exchanged.*moisture: .column: "{flow}"'):
        read_log(path)


@pytest.mark.parametrize(
    ("place", "is_told"), [((42.0, -93.5), True), ((48.0, 11.0), False), ((42.0, 93.5), True)]
)
def test_american_units_where_nobody_has_them_ask_for_west(tmp_path, place, is_told):
    h = Harvest(*place, width=30 * FT)
    bushels = {k: v for k, v in columns(h).items() if k != "yield_t_ha"} | {
        "yield_bu_ac": h.wet * ACRE / LB / 60
    }
    log = read_log(table(tmp_path / "log.csv", bushels | {"lon": np.abs(h.lon)}))
    assert any("lon: {unit: deg W}" in note for note in log.notes) == is_told
    metric = read_log(table(tmp_path / "si.csv", columns(h, lon=np.abs(h.lon))))
    assert not any("deg W" in note for note in metric.notes)


@pytest.mark.parametrize("place", [(42.0, -93.5), (-32.0, -63.5)])
def test_longitudes_from_0_to_360_are_those_of_the_west(tmp_path, place):
    h = Harvest(*place)
    log, plain = (
        read_log(table(tmp_path / "log.csv", columns(h, lon=lon))) for lon in (h.lon + 360.0, h.lon)
    )
    np.testing.assert_allclose(log.position, plain.position, atol=0.01)
    assert log.epsg == plain.epsg
    assert any("from 0 to 360 deg" in note for note in log.notes)
    assert not any("360" in note for note in plain.notes)


@pytest.mark.parametrize(
    ("changed", "cause"),
    [
        (lambda h: {"lat": np.round(h.lat, 4), "lon": np.round(h.lon, 4)}, "place = .*very spot.*digits"),
        (lambda h: {"speed_kmh": 0.1 * h.one}, "timeline = 0.1 km/h logged, 7.2 km/h by positions"),
        (lambda h: {"yield_t_ha": 5.4 * (h.t < 25.0)}, r"lost = flow of 0 in 9[\d.]* %"),
    ],
)
def test_a_refusal_names_the_cause_and_no_filter(tmp_path, changed, cause):
    h = Harvest()
    path = table(tmp_path / "log.csv", columns(h, **changed(h)))
    with pytest.raises(InputError, match=cause):
        import_log(path, tmp_path / "field", progress=False)


@pytest.mark.parametrize(("times", "is_told"), [(1.0, False), (1.0 / LB, True)])
def test_a_yield_beyond_those_of_the_crop_is_told(tmp_path, times, is_told):
    h = Harvest(passes=6, length=160.0)
    log = {k: v for k, v in columns(h).items() if k != "yield_t_ha"} | {"grain_flow_kg_s": times * h.flow}
    report = import_log(table(tmp_path / "log.csv", log), tmp_path / "field", progress=False)
    told = [note for note in report.notes if note.startswith("yield: ") and "usual of wheat" in note]
    assert bool(told) == is_told


ORDERS = {
    "passes": lambda h, rng: np.cumsum(np.diff(h.t, prepend=0.0) > 5.0) % 2 == 0,
    "rows": lambda h, rng: np.arange(len(h)) % 2 == 0,
    "shuffled": lambda h, rng: rng.random(len(h)) < 0.3,
}


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("units", [(10.0, 1e4), (1e4, 1e4 / LB * ACRE / 1e4), (10.0, ACRE / LB / 60)])
def test_a_column_with_two_units_by_turns_is_told(tmp_path, order, units):
    h = Harvest(seed=3)
    is_other = ORDERS[order](h, np.random.default_rng(1))
    grain = h.wet * np.where(is_other, *units[::-1])
    raw = {"yield": grain, "moisture": 100 * h.moisture * h.one}
    said = {key: Column(key, "1") for key in raw}
    pairs = [p for p in level_pairs(said, raw, np.arange(len(h)) + 2) if not p.agrees]
    apart = max(units) / min(units)
    assert [p.key for p in pairs] == ["mixed"] * (apart > 8.0)
    assert not any(p.contradicts for p in pairs)
    if apart > 500.0:
        bare = {k: v for k, v in columns(h).items() if k != "yield_t_ha"} | {"yield": grain}
        assert "mixed" in doubts(read_log(table(tmp_path / "log.csv", bare)).notes)


@pytest.mark.parametrize("seed", range(6))
def test_what_varies_in_one_unit_is_not_two_units(seed):
    rng = np.random.default_rng(seed)
    h = Harvest(seed=seed)
    is_part = rng.random(len(h)) < 0.3
    raw = {
        "yield": 10 * h.wet * np.where(is_part, float(rng.uniform(0.15, 0.9)), 1.0),  # lodged, or wet places
        "grain_flow": np.where(is_part, float(rng.uniform(0.001, 0.05)), h.flow),  # the sensor's own zero
        "header_width": h.width * np.where(is_part, float(rng.choice([0.3048, 0.5, 0.75])), 1.0),
        "speed": h.speed * np.where(is_part, 1 / 3.6, 1.0) * np.exp(rng.normal(0.0, 0.1, len(h))),
    }
    said = {key: Column(key, "1") for key in raw}
    assert not [p.shown for p in level_pairs(said, raw, np.arange(len(h))) if not p.agrees]
