"""The picture of grain handed over shows what the evaluator saw."""

from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.judge.evaluators import unloading
from swath.machine.machine_sheet import load_machine
from swath.report.plots import unloading_figure
from swath.report.report import ReportData, figures_of
from swath.signals import HeapState, MachineState, Station, TrailerState, UnloadState

pytestmark = pytest.mark.drawn

BOX = load_machine("tractor-grain-cart").box
AHEAD, LEFT = 0.12, -0.05  # m, where the stream comes down beside the wanted point


def watched(seconds):
    """A box that rises evenly from empty to 2 m in its middle, 2 samples a second; 3 kg miss it."""
    machines = {"cart": SimpleNamespace(geometry=SimpleNamespace(box=BOX))}
    watch = unloading.Unloading(SimpleNamespace(machines=machines))
    for i in range(2 * seconds):
        t, share = i * NS // 2, i / (2 * seconds - 1)
        profile = 2.0 * share * (1.0 - np.abs(np.linspace(-1.0, 1.0, 12)))
        state = MachineState(t, Pose.identity(), 1.0, 0.0, 0.0, 0.0, 0.0)
        trailer = TrailerState(t, -BOX.x, 8.0, 0.0, 0.0, 0.0, 0.0, 0.0, 7e3, 0.0, 0.0, 0.0)
        station = Station(t, True, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, False)
        heap = HeapState(t, 0.0, 0.9 * share, 0.0, 2.0, profile, BOX.depth - profile)
        pipe = UnloadState(t, 1.5, 90.0, 100.0, 0.0, 97.0, 3.0 * share, AHEAD, 8.0 + LEFT)
        for slot, signal in (
            ("combine.motion", state), ("cart.motion", trailer), ("cart.cooperate", station),
            ("cart.heap", heap), ("combine.unload", pipe),
        ):  # fmt: skip
            watch.see(slot, t, {"out": signal})
    return watch


def test_what_is_kept_is_what_was_seen():
    series = watched(60).series()
    rows = series.heaps["cart"]
    assert np.diff(rows.t) == pytest.approx(1.0)
    assert rows.level[-1] == pytest.approx(0.9, abs=0.01)
    assert (rows.length, rows.depth) == (BOX.length, BOX.depth)
    assert rows.profile.shape == (60, 12)
    assert (rows.flow[1:] == 90.0).all()
    assert series.along == pytest.approx(AHEAD)
    assert series.across == pytest.approx(-LEFT)
    assert len(series.t) == len(series.along) == 120


def test_a_long_run_keeps_no_more_rows_than_are_shown():
    assert unloading.MOST / 2 - 1 <= len(watched(2000).series().heaps["cart"].t) <= unloading.MOST


def test_the_picture_shows_grain_station_and_spill():
    series = watched(60).series()
    fig = unloading_figure(series, "cart")
    grain, station, fill = fig.axes[:3]
    mesh = next(c for c in grain.collections if hasattr(c, "get_array") and c.get_array() is not None)
    assert np.asarray(mesh.get_array()).ravel() == pytest.approx(series.heaps["cart"].profile.T.ravel())
    assert {line.get_label() for line in station.lines} == {"along", "across"}
    assert station.lines[0].get_ydata() == pytest.approx(100.0 * AHEAD)
    assert fill.get_title(loc="right") == "missed the box in all: 3 kg"


def test_the_report_of_a_run_has_it():
    titles = [f.title for f in figures_of(ReportData({}, "", [], unloading=watched(20).series()))]
    assert titles == ["Unloading into cart"]
