"""Buses and groups that say one quantity: alike, one counts; else the fuller one, or none in silence."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.field_io.logs.log import read_log
from swath.record.read.channel_log import ChannelLog
from tests.readers.made_channels import (
    COUNT,
    FLOW,
    HALF,
    T,
    asc,
    blf,
    frames,
    group,
    mf4,
    opened,
    read,
)  # fmt: skip

for library in ("asammdf", "can", "cantools"):
    pytest.importorskip(library)

KINDS = {"asc": asc, "blf": blf}
OTHER = np.full(COUNT, 3.0)


def late(made, lag):
    return sorted(
        [(t + lag, *rest) if rest[-1] == 2 else (t, *rest) for t, *rest in made], key=lambda m: m[0]
    )


def only(made, identifier):
    return [m for m in made if m[1] == identifier]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lag", [0.0, 0.001, 0.3])
def test_a_gateway_that_repeats_counts_once(tmp_path, kind, lag):
    found = read(KINDS[kind](tmp_path / f"log.{kind}", late(frames() + frames(bus=2), lag)))
    assert {note.partition(":")[0] for note in found.notes} == {"copies"}
    assert found.rows == COUNT
    assert np.nanmean(found.flow) == pytest.approx(FLOW.mean(), rel=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_another_machine_on_a_second_bus_is_refused_with_both_lines(tmp_path, kind):
    path = KINDS[kind](tmp_path / f"log.{kind}", late(frames() + only(frames(OTHER, bus=2), 258), 0.05))
    with pytest.raises(InputError, match=r"GrainFlow@CAN1 \[kg/s\].*or.*GrainFlow@CAN2 \[kg/s\]") as caught:
        read(path)
    assert caught.value.key == "sources"
    chosen = tmp_path / "map.yaml"
    chosen.write_text('grain_flow: {column: "GrainFlow@CAN1 [kg/s]", unit: kg/s}\n')
    log = read_log(path, chosen, as_map=True)
    assert np.median(log.flow) == pytest.approx(np.median(FLOW), rel=0.02)


def test_the_fuller_of_two_counts_and_is_named(tmp_path):
    made = frames() + only(frames(OTHER, bus=2), 258)[:40]
    found = read(asc(tmp_path / "log.asc", late(made, 0.05)))
    assert found.doubts == ["sources"]
    assert np.nanmean(found.flow) == pytest.approx(FLOW.mean(), rel=0.01)


def test_a_bus_that_says_nothing_but_errors_is_no_source(tmp_path):
    path = mf4(tmp_path / "log.mf4", group(), group(["GrainFlow"], GrainFlow=(OTHER * np.nan, "kg/s", T, {})))
    found = read(path)
    assert not found.notes
    assert np.nanmean(found.flow) == pytest.approx(FLOW.mean())


@pytest.mark.parametrize("kind", [*KINDS, "mf4"])
def test_sources_that_follow_each_other_are_one(tmp_path, kind):
    if kind == "mf4":
        path = mf4(tmp_path / "log.mf4", group(rows=slice(HALF)), group(rows=slice(HALF, None)))
    else:
        made = [(*m[:3], 1 if m[0] < T[HALF] else 2) for m in frames()]
        path = KINDS[kind](tmp_path / f"log.{kind}", made)
    found = read(path)
    assert not found.notes
    assert (found.rows, found.span) == (COUNT, T[-1])
    assert np.isfinite(found.flow).sum() >= COUNT - 2


@pytest.mark.parametrize("north", [0.9e-5, 1.0e-3])
def test_two_receivers_are_one_track(tmp_path, north):
    made = late(frames() + only(frames(bus=2, north=north), 256), 0.4)
    found = read(asc(tmp_path / "log.asc", made))
    assert found.rows == COUNT
    assert found.doubts == (["sources"] if north > 1e-4 else [])


def test_groups_of_mf4_in_other_units_are_compared_in_one(tmp_path):
    own = (np.full(COUNT, 2.0), "m/s", T, {})
    found = read(mf4(tmp_path / "log.mf4", group(), group(["Speed"], Speed=own)))
    assert found.notes == ["copies: speed: 1.Speed says the same as 0.Speed, which counts"]


def test_a_width_that_holds_is_not_followed_by_another(tmp_path):
    first = ["Latitude", "Longitude", "Speed", "GrainFlow"]
    once = group(["HeaderWidth"], slice(1))
    often = group(["HeaderWidth"], HeaderWidth=(np.full(COUNT, 6.0), "m", T + 0.01, {}))
    assert read(mf4(tmp_path / "log.mf4", group(first), once, often)).doubts == ["sources"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_replay_plays_the_one_that_counts_and_names_both(tmp_path, kind):
    path = KINDS[kind](tmp_path / f"log.{kind}", late(frames() + frames(bus=2), 0.001))
    log = ChannelLog(opened(path))
    assert {"Speed", "Speed@CAN1", "Speed@CAN2", "position"} <= log.topics().keys()
    places = [m for topic, _, m in log.messages(["position"]) if topic == "position"]
    assert len(places) == COUNT
    assert places[-1].latitude == pytest.approx(48.0 + 2e-5 * (COUNT - 1))
    assert [note for note in log.notes if note.startswith("copies: lat")]


def test_many_groups_of_one_name_have_names_of_their_own(tmp_path):
    path = mf4(tmp_path / "log.mf4", group(), *[group(["Speed"]) for _ in range(3)])
    log = opened(path)
    assert log.sources["Speed"] == ["0.Speed", "1.Speed", "2.Speed", "3.Speed"]


def test_senders_of_one_group_are_sources_and_one_without_a_number_is_none(tmp_path):
    """On ISO 11783: a receiver and its display say the position, one of two controllers the speed."""
    from swath.field_io.logs.table import read_table
    from tests.record.test_channels import frames as isobus

    def sent():
        for k in range(60):
            at, place = float(k), {"Latitude": 52.0 + 2e-5 * k, "Longitude": -9.0}
            yield at, "VehiclePosition", 0x1C, place
            yield at + 0.01, "VehiclePosition", 0x80, place
            yield at + 0.02, "WheelBasedSpeedAndDistance", 0xF0, {"WheelBasedSpeed": 2.0}
            yield at + 0.03, "WheelBasedSpeedAndDistance", 0x1C, {}

    path = isobus(tmp_path / "bus.blf", sent())
    log = opened(path)
    assert log.sources["Latitude"] == ["Latitude@1C", "Latitude@80"]
    table = read_table(path)
    speed = next(name for name in table.columns if name.startswith("WheelBasedSpeed ["))
    assert set(table.numbers(speed)[1:]) == {2.0}
    assert {note.partition(":")[0] for note in table.notes} == {"form", "copies"}
