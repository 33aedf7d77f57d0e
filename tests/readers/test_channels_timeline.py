"""Stamps that begin again, are relative or set back, and values that hold as the format says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.core.errors import InputError
from swath.field_io.logs.frames import BACK, Axis
from swath.field_io.logs.log import read_log
from swath.record.read.channel_log import POSITION_TYPE, ChannelLog
from swath.record.read.fields import Context
from swath.record.read.messages import maker_for
from swath.signals import Fix
from tests.readers.made_channels import (
    CHANNELS,
    COUNT,
    FLOW,
    HALF,
    T,
    asc,
    blf,
    block,
    frames,
    group,
    head,
    lines,
    mf4,
    opened,
    read,
)  # fmt: skip

for library in ("asammdf", "can", "cantools"):
    pytest.importorskip(library)

BEGUN = int(T[HALF])
FIRST, SECOND = frames()[: 3 * HALF], frames()[3 * HALF :]
AGAIN = [(t - BEGUN, *rest) for t, *rest in SECOND]
WITHOUT_HEADER = [name for name in CHANNELS if name != "HeaderWidth"]

TEXTS = {
    "relative": head(stamps="relative") + block() + lines(FIRST + SECOND, relative=True),
    "blocks that begin at 0": head() + block() + lines(FIRST) + block(BEGUN) + lines(AGAIN),
    "blocks that go on": head() + block() + lines(FIRST) + block(BEGUN) + lines(SECOND),
    "relative blocks": head(stamps="relative") + block() + lines(FIRST, relative=True) + block(BEGUN)
    + lines(AGAIN, relative=True),
    "a file behind the other": head() + block() + lines(FIRST) + head(BEGUN) + block(BEGUN) + lines(AGAIN),
    "the second one in decimal": head() + block() + lines(FIRST) + head(BEGUN, base="dec") + block(BEGUN)
    + lines(AGAIN, base="d"),
    "no head": "base hex timestamps absolute\n" + lines(FIRST + SECOND),
    "a block late in its measurement": head() + block(100) + lines(FIRST + SECOND),
    "comments and blank lines": head() + "// version 9.0.0\n\n" + block() + "\n" + lines(FIRST + SECOND),
}  # fmt: skip


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_blocks_and_stamps_of_a_text_are_one_drive(tmp_path, text):
    found = read(asc(tmp_path / "log.asc", text))
    assert not found.notes
    assert found.rows == COUNT
    assert found.span == pytest.approx(T[-1])
    assert np.nanmean(found.flow) == pytest.approx(FLOW.mean(), rel=0.01)


def test_what_begins_again_without_a_head_is_put_behind_and_told(tmp_path):
    mixed = [(t if t < BEGUN else t - BEGUN, *rest) for t, *rest in frames()]
    texts = [head() + block() + lines(mixed), head() + block() + lines(FIRST) + block() + lines(AGAIN)]
    paths = [asc(tmp_path / f"{k}.asc", text) for k, text in enumerate(texts)]
    paths.append(blf(tmp_path / "2.blf", mixed))
    t = np.where(T < BEGUN, T, T - BEGUN)
    paths.append(mf4(tmp_path / "3.mf4", group(t=t)))
    for path in paths:
        found = read(path)
        assert found.doubts == ["timeline"], path
        assert found.rows == COUNT
        assert np.nanmean(found.flow) == pytest.approx(FLOW.mean(), rel=0.01)


def test_all_groups_begin_again_together(tmp_path):
    t = np.where(T < BEGUN, T, T - BEGUN)
    path = mf4(
        tmp_path / "log.mf4", group(WITHOUT_HEADER, t=t), group(["HeaderWidth"], slice(None, None, 5), t=t)
    )
    found = read(path)
    assert found.doubts == ["timeline"]
    times = {}
    for name, at, _ in opened(path).blocks(["Speed", "HeaderWidth"]):
        times.setdefault(name, []).extend(at.tolist())
    assert set(times["HeaderWidth"]) <= set(times["Speed"])


def test_a_bus_that_stands_behind_the_other_is_beside_it(tmp_path):
    found = read(asc(tmp_path / "log.asc", frames() + frames(bus=2)))
    assert not found.doubts
    assert found.span == pytest.approx(T[-1])


@given(st.lists(st.lists(st.integers(0, 10**12), min_size=1, max_size=20), min_size=1, max_size=4))
@settings(max_examples=60)
def test_one_axis_of_blocks_never_goes_back_and_keeps_steps(parts):
    stamps = [t for part in parts for t in sorted(part)]
    axis = Axis()
    made = [axis.time(1, t) for t in stamps]
    steps, kept = np.diff(stamps), np.diff(made)
    falls = steps < -BACK
    assert (kept[~falls] == steps[~falls]).all()
    assert (kept[falls] > 0).all()
    blocks = [np.array(stamps[k : k + 7], np.int64) for k in range(0, len(stamps), 7)]
    for again in (Axis(), Axis(axis.shifts, is_one_by_one=True)):
        np.testing.assert_array_equal(np.concatenate([again.times(1, block) for block in blocks]), made)


def test_a_value_holds_to_the_next_one_of_its_channel(tmp_path):
    seldom = {"once": slice(1), "twice": slice(0, 200, 199), "each 20 s": slice(None, None, 20)}
    for name, rows in seldom.items():
        path = mf4(tmp_path / f"{name}.mf4", group(WITHOUT_HEADER), group(["HeaderWidth"], rows))
        widths = _numbers(path, "HeaderWidth [m]")
        assert (widths == 9.0).all(), name


@pytest.mark.parametrize("kind", ["asc", "blf"])
def test_a_message_sent_once_holds_and_one_that_stops_does_not(tmp_path, kind):
    writer = {"asc": asc, "blf": blf}[kind]
    made = [m for k, m in enumerate(frames()) if (m[1] != 257 or k < 3) and (m[1] != 258 or k < 3 * HALF)]
    path = writer(tmp_path / f"log.{kind}", made)
    assert np.nanmax(_numbers(path, "HeaderWidth [m]")[1:]) == 9.0
    assert np.isfinite(_numbers(path, "HeaderWidth [m]")[1:]).all()
    found = read(path)
    assert np.isfinite(found.flow).sum() == HALF - 1
    assert found.doubts == ["lost"]


def test_a_channel_of_mf4_that_ends_early_is_told_and_not_drawn_out(tmp_path):
    rest = [name for name in CHANNELS if name != "GrainFlow"]
    found = read(mf4(tmp_path / "log.mf4", group(rest), group(["GrainFlow"], slice(HALF))))
    assert found.doubts == ["lost"]
    assert np.isfinite(found.flow).sum() == HALF
    gap = np.r_[0:100, 200:COUNT]
    found = read(mf4(tmp_path / "gap.mf4", group(rest), group(["GrainFlow"], gap)))
    assert found.doubts == ["lost"]  # it holds to the next one, as the format says
    assert np.isfinite(found.flow).all()


def test_records_of_one_time_are_one_row(tmp_path):
    twice = np.repeat(np.arange(COUNT), 2)
    found = read(mf4(tmp_path / "log.mf4", group(rows=twice)))
    assert (found.rows, found.notes) == (COUNT, [])


def test_an_invalid_channel_ends_no_group(tmp_path):
    bad = np.random.default_rng(4).random(COUNT) < 0.5
    moist = (np.full(COUNT, 14.0), "%", T, {"invalidation_bits": bad})
    path = mf4(tmp_path / "log.mf4", group(Moisture=moist))
    assert (np.isnan(_numbers(path, "Moisture [%]")) == bad).all()
    played = [*ChannelLog(opened(path)).messages(["position"])]
    assert played[-1][1] == round(T[-1] * 1e9)


@pytest.mark.parametrize("table", [
    {"val_0": 65535, "text_0": "SNA", "default_addr": {"a": 0.001, "b": 0.0}},
    {"lower_0": 65000, "upper_0": 65535, "text_0": "invalid", "default_addr": {"a": 0.001, "b": 0.0}},
], ids=["value", "range"])  # fmt: skip
@pytest.mark.parametrize("count", [COUNT, 40])
def test_only_the_value_that_is_a_word_is_no_number(tmp_path, table, count):
    bad = np.random.default_rng(4).random(count) < 0.2
    raw = np.where(bad, 65535, np.round(FLOW[:count] * 1000)).astype("u2")
    flow = (raw, "kg/s", T[:count], {"conversion": table})
    path = mf4(tmp_path / "log.mf4", group(rows=slice(count), GrainFlow=flow))
    np.testing.assert_allclose(read(path).flow, np.where(bad, np.nan, FLOW[:count]))


def test_a_table_of_some_words_leaves_the_rest_as_it_is(tmp_path):
    raw = np.where(np.arange(COUNT) % 7 == 0, 255, 14).astype("u1")
    moist = (raw, "%", T, {"conversion": {"val_0": 255, "text_0": "not available"}})
    made = _numbers(mf4(tmp_path / "log.mf4", group(Moisture=moist)), "Moisture [%]")
    np.testing.assert_array_equal(made, np.where(raw == 255, np.nan, 14.0))


@pytest.mark.parametrize("form", ["u1", "u2", "f4"])
@pytest.mark.parametrize("table", [
    {"val_0": 77, "text_0": "not available"},
    {"lower_0": 70, "upper_0": 80, "text_0": "error"},
], ids=["value", "range"])  # fmt: skip
def test_raw_numbers_of_a_table_of_words_are_told_once_they_have_a_unit(tmp_path, form, table):
    raw = np.where(np.arange(COUNT) % 5 == 0, 77, 14).astype(form)
    for unit, words in (("%", table), ("", table), ("%", {**table, "default_addr": {"a": 1.0, "b": 0.0}})):
        moist = (raw, unit, T, {"conversion": words})
        path = mf4(tmp_path / "log.mf4", group(Moisture=moist))
        log = opened(path)
        values = np.concatenate([v for name, _, v in log.blocks(["Moisture"])])
        np.testing.assert_array_equal(values, np.where(raw == 77, np.nan, 14.0))
        note = "unit: Moisture: raw numbers without a conversion, taken as %"
        is_told = unit == "%" and "default_addr" not in words
        assert log.notes.get(note) == (COUNT - COUNT // 5 if is_told else None)


@pytest.mark.parametrize(("flow", "is_crop"), [(75.0, True), (110.0, True), (160.0, False), (5400.0, False)])
def test_a_flow_that_is_none_of_grain_is_forage_only_where_it_can_be(tmp_path, flow, is_crop):
    path = mf4(tmp_path / "log.mf4", group(GrainFlow=(FLOW * flow / 5.0, "kg/s", T, {})))
    with pytest.raises(InputError) as error:
        read_log(path)
    assert error.value.key == "plausible"
    assert ("forage" in str(error.value), "--columns" in str(error.value)) == (is_crop, not is_crop)


HEIGHT = 345.0 + 0.1 * np.arange(COUNT)


@given(order=st.permutations(("Latitude", "Longitude", "Elevation")), apart=st.sets(st.integers(0, 2)),
       unknown=st.integers(0, 40))  # fmt: skip
@settings(max_examples=12)
def test_a_position_has_the_height_of_its_own_time(tmp_path_factory, order, apart, unknown):
    heights = (HEIGHT, "m", T, {"invalidation_bits": np.arange(COUNT) < unknown})
    channels = {
        **{name: (*CHANNELS[name], T, {}) for name in order if name in CHANNELS},
        "Elevation": heights,
    }
    groups = [[name] for k, name in enumerate(order) if k in apart]
    groups.append([name for k, name in enumerate(order) if k not in apart])
    made = [group((), **{name: channels[name] for name in names}) for names in groups if names]
    path = mf4(tmp_path_factory.mktemp("log") / "log.mf4", *made)
    played = [*ChannelLog(opened(path)).messages(["position"])]
    assert [t for _, t, _ in played] == [round(t * 1e9) for t in T]
    told = np.array([message.altitude for *_, message in played])
    np.testing.assert_array_equal(told, np.where(np.arange(COUNT) < unknown, np.nan, HEIGHT))
    make = maker_for(Fix, POSITION_TYPE, Context(3.7))
    fixes = [make(message, t) for _, t, message in played]
    known = np.array([fix.z for fix in fixes])[unknown:]
    np.testing.assert_allclose(known, HEIGHT[unknown:] - HEIGHT[unknown], atol=0.05)  # the Earth is round
    assert np.isnan([fix.z for fix in fixes[:unknown]]).all()
    np.testing.assert_allclose([fix.y for fix in fixes], 2.2241 * np.arange(COUNT), rtol=2e-4, atol=1e-6)


def _numbers(path, name):
    from swath.core.apart.call import written_here
    from swath.field_io.logs.table import read_table

    written_here(path)
    return read_table(path).numbers(name)


def test_frames_of_another_age_are_left_out_and_counted(tmp_path):
    (t, *rest), *_ = frames()
    late = asc(
        tmp_path / "log.asc", head() + block() + lines([*frames(), (t + 5e9, *rest), (t + 6e9, *rest)])
    )
    found = read(late)
    assert found.rows == COUNT
    assert found.span == pytest.approx(T[-1])
    assert found.notes == ["timeline: samples more than 146 years from the first, left out (2)"]
