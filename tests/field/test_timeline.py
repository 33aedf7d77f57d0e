"""Sources, parts and times of a log that say one thing twice: what counts, what is told, what is refused."""

import numpy as np
import pytest

pytest.importorskip("scipy")

from swath.core.errors import InputError
from swath.documents.reasons import doubts
from swath.field_io.delay import estimate_delays
from swath.field_io.importer import import_log
from swath.field_io.logs.clock import spread
from swath.field_io.logs.columns import ADDED, QUANTITIES, UNITS
from swath.field_io.logs.log import first_loss, read_log
from swath.field_io.logs.sources import choose
from swath.field_io.logs.witnesses import CANDIDATES
from tests.field.drawn_logs import draw
from tests.field.unit_logs import Harvest, table


def columns(h):
    places = h.places(("lat", "lon"))
    return {
        **places,
        "time_s": h.t,
        "width_m": 9.0 * h.one,
        "grain_flow_kg_s": h.flow,
        "moisture_pct": 14.0 * h.one,
    }


def grown(log):
    """Yield in the mean [kg/m2]."""
    return float(np.mean((log.flow / (log.width * log.speed))[log.speed > 0.5]))


def thinned(c):
    return {k: v[::5] for k, v in c.items()}


def restarted(c):
    half = len(c["time_s"]) // 2 + 40  # within a pass
    return {**c, "time_s": np.r_[c["time_s"][:half], c["time_s"][half:] - c["time_s"][half]]}


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (lambda c: {**c, "duration_s": 1.0 + 0.0 * c["time_s"]}, ""),
        (thinned, "timeline"),
        (restarted, "timeline"),
    ],
)
def test_two_witnesses_of_time_win_and_the_third_is_named(tmp_path, change, key):
    h = Harvest()
    whole = columns(h)
    made = change({**whole, "duration_s": h.one} if change is thinned else whole)
    log = read_log(table(tmp_path / "log.csv", made))
    plain = read_log(table(tmp_path / "plain.csv", whole))
    assert grown(log) == pytest.approx(grown(plain), rel=0.02)
    assert doubts(log.notes) == [key] * bool(key)


def test_equal_sources_count_once_and_others_are_refused_with_both(tmp_path):
    h = Harvest()
    for factor, key in ((1.0, "copies"), (1.5, "")):
        path = table(tmp_path / "log.csv", {**columns(h), "mass_flow_kg_s": factor * h.flow})
        if key:
            assert any(note.startswith(f"{key}: grain_flow") for note in read_log(path).notes)
        else:
            both = r"sources = (?s:.*)grain_flow: .column: (?s:.*)or grain_flow"
            with pytest.raises(InputError, match=both):
                read_log(path)


def parted(name, keys):
    """The column of a name in equal parts."""
    return lambda c: {
        **{k: v for k, v in c.items() if k != name},
        **{key: c[name] / len(keys) for key in keys},
    }


NAMED = {"header_width": ("width_m", "width"), "grain_flow": ("grain_flow_kg_s", "flow")}


def in_use(c):
    last = np.arange(len(c["lat"])) >= 7 * 90
    return {**c, "width_m": np.where(last, 4.5, 9.0), "header_width_m": 9.0 + 0.0 * last}


@pytest.mark.parametrize(
    ("change", "told", "width"),
    [
        (parted("grain_flow_kg_s", ("flow left [kg/s]", "flow right [kg/s]")), "derived: grain_flow", 9.0),
        (parted("width_m", ("width left [m]", "width right [m]")), "derived: header_width", 9.0),
        (parted("width_m", [f"width section {k} [m]" for k in (1, 2, 3)]), "derived: header_width", 9.0),
        (lambda c: {"swath_m": 13.5 + 0.0 * c["lat"], **c}, "sources: header_width: width_m", 9.0),
        (lambda c: {**c, "v_m_s": 3.0 + 0.0 * c["lat"], "speed_m_s": 2.0 + 0.0 * c["lat"]},
         "sources: speed: speed_m_s", 9.0),
        (lambda c: {**c, "ground_speed_m_s": 2.0 + 0.0 * c["lat"], "speed_m_s": 2.08 + 0.0 * c["lat"]},
         "sources: speed: ground_speed_m_s", 9.0),
        (in_use, "derived: header_width: width_m", 8.4375),
    ],
)  # fmt: skip
def test_parts_add_up_and_way_and_passes_decide_between_sources(tmp_path, change, told, width):
    made = columns(Harvest())
    log = read_log(table(tmp_path / "log.csv", change(made)))
    assert any(note.startswith(told) for note in log.notes)
    assert log.flow.sum() == pytest.approx(made["grain_flow_kg_s"].sum(), rel=1e-6)
    assert log.width.mean() == pytest.approx(width, rel=1e-6)
    assert log.speed.mean() == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("key", ADDED)
def test_parts_in_units_of_their_own_add_up(tmp_path, key, seed):
    rng = np.random.default_rng(seed)
    made, (name, word) = columns(Harvest(passes=2)), NAMED[key]
    units = rng.permutation(sum(CANDIDATES[key], ()))[: rng.integers(2, 4)].tolist()
    whole, shares = made.pop(name), rng.dirichlet(np.full(len(units), 5.0))
    for k, (unit, share) in enumerate(zip(units, shares, strict=True), 1):
        made[f"{word} section {k} [{unit}]"] = share * whole / UNITS[QUANTITIES[key]][unit]
    log = read_log(table(tmp_path / "log.csv", made))
    assert {"header_width": log.width, "grain_flow": log.flow}[key] == pytest.approx(whole, rel=1e-4)


@pytest.mark.parametrize("names", [("flow left [kg/s]",), ("yield left [t/ha]", "yield right [t/ha]")])
def test_one_part_is_no_flow_and_parts_of_an_area_do_not_add_up(tmp_path, names):
    made = columns(Harvest())
    flow = made.pop("grain_flow_kg_s")
    for k, name in enumerate(names):
        made[name] = flow * (1.0 + 0.5 * k)
    with pytest.raises(InputError, match=r"columns|sources"):
        read_log(table(tmp_path / "log.csv", made))


@pytest.mark.parametrize("per_second", [2, 5])
@pytest.mark.parametrize("has_own_places", [False, True])
def test_rows_of_one_stamp_behind_each_other_are_spread_within_it(tmp_path, per_second, has_own_places):
    h = Harvest(interval=1.0 / per_second if has_own_places else 1.0)
    made = columns(h)
    if has_own_places:
        made["time_s"] = np.floor(made["time_s"] + 1e-6)
    else:
        made = {k: np.repeat(v, per_second) for k, v in made.items()}
        made["grain_flow_kg_s"] *= 1.0 + 0.02 * np.sin(np.arange(len(made["lat"])))
    log = read_log(table(tmp_path / "log.csv", made))
    assert not doubts(log.notes)
    assert np.median(log.duration) == pytest.approx(1.0 / per_second)
    assert (log.flow * log.duration).sum() == pytest.approx((h.flow * (h.t[1] - h.t[0])).sum(), rel=0.01)
    assert grown(log) == pytest.approx(np.mean(h.wet), rel=0.01)


def test_a_clock_that_begins_again_elsewhere_may_be_another_machine(tmp_path):
    h = Harvest()
    one, other = columns(h), columns(Harvest(lon=11.0 + 8 * 9.0 / 74400.0, seed=2))
    log = read_log(table(tmp_path / "log.csv", {k: np.r_[one[k], other[k]] for k in one}))
    assert len(log.machine_names) == 2
    assert "timeline" not in doubts(log.notes)


def test_the_more_complete_source_counts():
    full, part = np.ones(200), np.where(np.arange(200) < 50, 2.0, np.nan)
    made = choose("width", {"a": part, "b": full}, str)
    assert (made.name, made.notes[0].partition(":")[0]) == ("b", "sources")


def test_a_loss_is_told_of_the_first_stage_that_takes_most():
    assert first_loss({"copied": 10, "no_width": 80, "no_pass": 10}, 100)[0] == "no_width"


@pytest.mark.parametrize("seed", [1008, 1013])
def test_a_work_state_does_not_take_the_flow_of_the_turns(seed, tmp_path):
    made = draw(seed, has_work_state=True)
    for delay in estimate_delays(read_log(made.write(tmp_path / "log.csv"))):
        assert abs(delay.seconds - made.delays[delay.machine]) < 0.6 or not np.isfinite(delay.seconds)


def test_a_clock_of_no_rows_stays():
    """Rows of a machine none of which has a place."""
    assert len(spread(np.zeros(0), np.zeros((0, 2)))[0]) == 0


def test_widths_of_which_none_is_that_of_the_passes_are_refused_with_both_lines(tmp_path):
    h = Harvest()
    made = {**columns(h), "swath_m": 16.0 + 0.0 * h.flow, "width_m": 21.0 + 0.0 * h.flow}
    path = table(tmp_path / "log.csv", made)
    with pytest.raises(InputError, match=r'{column: "\w+_m"} or header_width: .*log\.csv') as refused:
        read_log(path)
    assert refused.value.key == "sources"


def in_parts(h, shares, order=1):
    """A row for each part of the header, side by side, without a clock and without a word about parts."""
    count = len(shares)
    middle = (np.cumsum(shares) - np.array(shares) / 2 - 0.5)[::order] * h.width
    east = np.where(np.isin(h.course, (0.0, 360.0)), 1.0, -1.0)[:, None] * middle
    wide = np.tile(np.array(shares)[::order], len(h))
    return {
        "lat": np.repeat(h.lat, count),
        "lon": np.repeat(h.lon, count) + east.ravel() / (111_195 * np.cos(np.radians(48.0))),
        "duration_s": np.repeat(h.one, count), "width_m": h.width * wide,
        "grain_flow_kg_s": np.repeat(h.flow, count) * wide,
    }  # fmt: skip


@pytest.mark.parametrize(("shares", "order"), [((0.5, 0.5), 1), ((0.4, 0.6), -1), ((0.25,) * 4, 1)])
@pytest.mark.parametrize("is_torn", [False, True])
def test_parts_behind_each_other_without_a_clock_are_one_header(tmp_path, shares, order, is_torn):
    h = Harvest(level=0.7)
    made = in_parts(h, shares, order)
    made = {k: v[: -len(shares) * 40] if is_torn else v for k, v in made.items()}
    log = read_log(table(tmp_path / "log.csv", made))
    rows = len(h) - 40 * is_torn
    assert len(log) == rows
    assert log.width == pytest.approx(9.0)
    assert log.flow.sum() == pytest.approx(h.flow[:rows].sum(), rel=1e-6)


def test_rows_without_a_clock_are_no_parts_of_a_header(tmp_path):
    h = Harvest()
    made = {k: v for k, v in columns(h).items() if k != "time_s"}
    log = read_log(table(tmp_path / "log.csv", {**made, "duration_s": h.one}))
    assert len(log) == len(h)


@pytest.mark.parametrize("names", [("wet_yield_t_ha", "yield_t_ha"), ("yield_t_ha", "ertrag_t_ha")])
@pytest.mark.parametrize("factor", [1.0, 0.8])
def test_a_name_that_says_less_does_not_count_and_is_told_where_it_differs(tmp_path, names, factor):
    made = columns(Harvest())
    grain = 10.0 * made.pop("grain_flow_kg_s") / 18.0
    log = read_log(table(tmp_path / "log.csv", {names[1]: factor * grain, **made, names[0]: grain}))
    assert 10.0 * grown(log) == pytest.approx(grain.mean(), rel=0.01)
    assert doubts(log.notes) == ["sources"] * (factor != 1.0)


def test_a_yield_counts_where_nothing_says_how_long_a_flow_lasts(tmp_path):
    h = Harvest(interval=2.0)
    made = {k: v for k, v in columns(h).items() if k != "time_s"}
    assert doubts(read_log(table(tmp_path / "log.csv", made)).notes) == ["timeline"]
    log = read_log(table(tmp_path / "log.csv", {**made, "yield_t_ha": 10.0 * h.wet}))
    assert not doubts(log.notes)
    assert grown(log) == pytest.approx(np.mean(h.wet), rel=0.01)


def test_a_step_to_the_pass_beside_is_no_turn(tmp_path):
    """Without a clock nothing but the way says that records of the turn are missing."""
    h = Harvest(width=4.0)
    made = {k: v for k, v in columns(h).items() if k != "time_s"} | {"width_m": 4.0 * h.one}
    log = read_log(table(tmp_path / "log.csv", {**made, "duration_s": h.one}))
    assert np.flatnonzero(log.gap).tolist() == [90 * k for k in range(8)]


def test_a_speed_that_is_dead_does_not_count(tmp_path):
    made = columns(Harvest())
    log = read_log(table(tmp_path / "log.csv", {**made, "speed_km_h": 0.0 * made["lat"]}))
    assert doubts(log.notes) == ["plausible"]
    assert log.speed.mean() == pytest.approx(2.0, rel=0.01)


def test_a_refusal_of_the_result_has_the_key_of_the_first_doubt(tmp_path):
    """A speed of no unit makes every yield small: the tonnes on the map are not the cause."""
    made = columns(Harvest(level=0.9))
    log = table(tmp_path / "log.csv", {**made, "speed_mph": 3.6 * 2.0 / 0.44704 + 0.0 * made["lat"]})
    with pytest.raises(
        InputError, match=r"(?s)speed_mph.* by positions and times; and so yield = "
    ) as refused:
        import_log(log, tmp_path / "field", progress=False)
    assert refused.value.key == "plausible"
