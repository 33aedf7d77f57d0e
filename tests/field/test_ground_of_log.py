"""The ground that a log covers where nothing says whether the header works."""

import numpy as np
import pytest

pytest.importorskip("scipy")
pytest.importorskip("shapely")

from swath.documents.reasons import doubts
from swath.field_io.clean import clean
from swath.field_io.importer import Settings, import_log
from swath.field_io.logs.log import read_log
from swath.field_io.outline import covered_ground
from tests.field.unit_logs import table

PASSES, LENGTH, WIDTH, SPEED, LATE = 8, 100.0, 6.0, 2.0, 12


def driven(*, has_turns):
    """(t, x, y, whether in a pass), a row a second: passes to and fro, turns as half circles."""
    rows = []
    for k in range(PASSES):
        up, x = k % 2 == 0, k * WIDTH
        along = np.arange(0.0, LENGTH + 0.1, SPEED)
        rows += [(x, y if up else LENGTH - y, True) for y in along]
        angle = np.linspace(0.0, np.pi, 14)[1:-1] if has_turns else np.full(12, np.nan)
        turn = (
            x + WIDTH / 2 - 3 * np.cos(angle),
            (LENGTH if up else 0.0) + (9 if up else -9) * np.sin(angle),
        )
        rows += [(a, b, False) for a, b in zip(*turn, strict=True)]
    x, y, is_pass = map(np.array, zip(*rows[:-12], strict=True))
    t = np.arange(len(x), dtype=float)
    there = np.isfinite(x)
    return t[there], x[there], y[there], is_pass[there]


def area(path, t, x, y, flow):
    lat, lon = 48.0 + y / 111_195, 11.0 + x / (111_195 * np.cos(np.radians(48.0)))
    rows = {"Longitude": lon, "Latitude": lat, "Time (s)": t, "Width (m)": np.full(len(t), WIDTH),
            "Flow (kg/s)": flow, "Speed (m/s)": np.full(len(t), SPEED)}  # fmt: skip
    cleaned = clean(read_log(table(path / "log.csv", rows)), 0.0)
    return covered_ground(cleaned)[0].area


def test_flow_that_comes_late_leaves_no_ground_out_of_a_log_that_pauses(tmp_path):
    t, x, y, _ = driven(has_turns=False)
    since = np.zeros(len(t))
    for k in range(1, len(t)):
        since[k] = 0 if t[k] - t[k - 1] > 2 else since[k - 1] + 1
    flow = np.where(since < LATE, 0.0, 7.0)
    assert area(tmp_path, t, x, y, flow) == pytest.approx(PASSES * LENGTH * WIDTH, rel=0.02)


def test_flow_that_is_held_over_turns_takes_no_ground(tmp_path):
    t, x, y, is_pass = driven(has_turns=True)
    flow = np.full(len(t), 7.0)
    found = area(tmp_path, t, x, y, flow)
    assert found == pytest.approx(PASSES * LENGTH * WIDTH, rel=0.05)
    assert (~is_pass).sum() * SPEED * WIDTH > 0.1 * found  # what the turns would add


def test_grain_that_comes_while_the_header_is_out_is_no_doubt(tmp_path):
    """A flow 12 s late that is cut off with the header shows four fifths of the grain."""
    t, x, y, is_pass = driven(has_turns=True)
    grown = np.where(is_pass, 7.0, 0.0)
    flow = np.where(is_pass, np.interp(t - LATE, t, grown, left=0.0), 0.0)
    lat, lon = 48.0 + y / 111_195, 11.0 + x / (111_195 * np.cos(np.radians(48.0)))
    rows = {"Longitude": lon, "Latitude": lat, "Time (s)": t, "Width (m)": np.full(len(t), WIDTH),
            "Flow (kg/s)": flow, "Speed (m/s)": np.full(len(t), SPEED),
            "Work State": np.where(is_pass, "In", "Out")}  # fmt: skip
    log = table(tmp_path / "log.csv", rows)
    assert flow.sum() < 0.87 * grown.sum()
    report = import_log(log, tmp_path / "field", settings=Settings(flow_delay_s=LATE), progress=False)
    assert not {"yield", "lost"} & set(doubts(report.notes))
    assert report.crop["yield_t_ha"] == pytest.approx(10 * 7.0 / (WIDTH * SPEED), rel=0.02)
