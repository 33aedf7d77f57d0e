"""A log that is several things: rows twice, sections side by side, harvests, fields, units."""

import numpy as np
import pytest

pytest.importorskip("scipy")

from swath.core.errors import InputError
from swath.field_io.logs.log import read_log
from swath.field_io.logs.parts import one_part
from tests.field.unit_logs import FT, Harvest, table


def columns(h, **more):
    made = {
        "lat": h.lat, "lon": h.lon, "time_s": h.t, "width_m": h.width * h.one, "yield_t_ha": 10 * h.wet,
        "moisture": 100 * h.moisture * h.one, "elevation": h.z,
    }  # fmt: skip
    return {k: np.asarray(v) for k, v in (made | more).items()}


def joined(*logs):
    return {k: np.concatenate([log[k] for log in logs]) for k in logs[0]}


@pytest.mark.parametrize("order", ["twice", "thrice", "shuffled"])
def test_rows_that_are_there_twice_count_once(tmp_path, order):
    h = Harvest()
    once = columns(h)
    many = joined(*[once] * (3 if order == "thrice" else 2))
    if order == "shuffled":
        mixed = np.random.default_rng(1).permutation(len(many["lat"]))
        many = {k: v[mixed] for k, v in many.items()}
    log, alone = (read_log(table(tmp_path / "log.csv", c)) for c in (many, once))
    assert len(log) == len(alone)
    np.testing.assert_allclose(np.sort(log.flow), np.sort(alone.flow))
    assert any("are there twice" in note for note in log.notes)
    assert not any("are there twice" in note for note in alone.notes)


@pytest.mark.parametrize(("count", "has_id"), [(3, True), (2, True)])
def test_sections_side_by_side_are_one_header(tmp_path, count, has_id):
    h = Harvest(width=9.0)
    shifts = (np.arange(count) - (count - 1) / 2) * 9.0 / count / (111320 * np.cos(np.radians(48)))
    parts = [
        columns(h, lon=h.lon + s, width_m=9.0 / count * h.one, section=k * h.one)
        for k, s in enumerate(shifts)
    ]
    log = read_log(table(tmp_path / "log.csv", joined(*parts)))
    assert len(log) == len(h)
    np.testing.assert_allclose(log.width, 9.0)
    alone = read_log(table(tmp_path / "one.csv", columns(h)))
    np.testing.assert_allclose(log.flow, alone.flow, rtol=1e-3)
    np.testing.assert_allclose(log.position, alone.position, atol=0.02)


@pytest.mark.parametrize(("days", "aside"), [(365.0, 0.0), (365.0, 4.5), (40.0, 3.0), (40.0, -4.5)])
def test_two_harvests_are_refused_or_chosen_between(tmp_path, days, aside):
    h = Harvest()
    later = columns(h, time_s=h.t + 86400 * days, yield_t_ha=15 * h.wet, lon=h.lon + aside / 74600.0)
    log = read_log(path := table(tmp_path / "log.csv", joined(columns(h), later)))
    with pytest.raises(InputError, match=r"2 harvests of one ground.*--part N"):
        one_part(log, None, path)
    for part, level in ((1, 5.4), (2, 8.1)):
        own = one_part(log, part, path)
        assert len(own) == len(h)
        assert 10 * np.median(own.flow / own.width / own.speed) == pytest.approx(level, rel=0.03)
    with pytest.raises(InputError, match="part = 3: expected 1 to 2"):
        one_part(log, 3, path)


@pytest.mark.parametrize("kind", ["two days", "every second pass later", "a pass again", "over the road"])
def test_one_harvest_stays_whole(tmp_path, kind):
    h = Harvest(passes=12, length=250.0)
    rows = columns(h)
    half = np.arange(len(h)) >= len(h) // 2
    if kind == "two days":
        rows["time_s"] = rows["time_s"] + 86400.0 * half
    elif kind == "every second pass later":
        rows["time_s"] = rows["time_s"] + 86400.0 * (np.rint(h.course / 180.0) % 2)
    elif kind == "a pass again":
        first = {k: v[:125] for k, v in rows.items()}
        rows = joined(
            rows, {**first, "time_s": first["time_s"] + 86400.0, "yield_t_ha": 0.1 * first["yield_t_ha"]}
        )
    else:
        rows["lon"] = rows["lon"] + 40.0 / 74600.0 * half
    log = read_log(path := table(tmp_path / "log.csv", rows))
    assert len(one_part(log, None, path)) == len(log)


@pytest.mark.parametrize("metres", [400.0, 3000.0])
def test_two_fields_are_refused_or_chosen_between(tmp_path, metres):
    h = Harvest()
    other = columns(h, time_s=h.t + 7000.0, lat=h.lat + metres / 111200.0 + 250.0 / 111200.0)
    log = read_log(path := table(tmp_path / "log.csv", joined(columns(h), other)))
    with pytest.raises(InputError, match=r"2 fields.*--part N"):
        one_part(log, None, path)
    assert len(one_part(log, 2, path)) == len(h)


@pytest.mark.parametrize(
    ("key", "factor"),
    [("yield_t_ha", 1000.0), ("moisture", 0.01), ("elevation", 1 / FT), ("width_m", 1 / FT)],
)
def test_two_units_in_a_column_are_refused(tmp_path, key, factor):
    h = Harvest()
    rows = columns(h)
    rows[key] = np.where(np.arange(len(h)) < len(h) // 2, 1.0, factor) * rows[key]
    named = {k.partition("_")[0] if k in ("yield_t_ha", "width_m") else k: v for k, v in rows.items()}
    with pytest.raises(InputError, match=r"in rows 2 to 361 and .* in rows 362 to 721.*one unit in a column"):
        read_log(table(tmp_path / "log.csv", named))
