"""`swath reda`: visible shares, scores by hand, what each sensor answers in plain cases, what is written."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.rays.engine import RayCaster
from swath.tools.reda import reda
from swath.tools.reda.page import _settings
from swath.tools.reda.reda import Cell, lower_end, scores_of
from swath.tools.reda.scene import (
    EDGE_M,
    CameraSensor,
    Condition,
    RadarSensor,
    Scene,
    Settings,
    make_sensor,
    places,
    visible,
)

ONE = Settings(repeats=1, looks=10)


@pytest.fixture(scope="module")
def scene():
    return Scene(ONE, Condition(0.85, 500.0, "clear"))


def cell(detected, false=0.0, looks=10):
    return Cell(0.0, 0.0, detected, false, looks, "")


def test_scores_by_hand():
    """Four places: one always, one with as many reports of nobody, one half, one never."""
    scores = scores_of([cell(1.0), cell(0.5, 0.5), cell(0.5), cell(0.0)], 0.9)
    assert (scores.usability, scores.availability) == pytest.approx((0.25, 0.375))
    right = (1.0 + 0.5 + 0.75 + 0.5) / 4
    assert scores.reliability == pytest.approx(lower_end(right, 80))
    assert lower_end(0.5, 100) == pytest.approx(0.4038, abs=1e-4)  # Wilson, 50 of 100
    assert cell(0.75, 0.5).net == pytest.approx(0.5)


def test_what_crop_leaves_in_sight(scene):
    """On stubble all; in the crop what rises above it, seen from 3.8 m: top 1.75 m, crop about 0.85 m."""
    caster, eye = RayCaster(scene.field), np.array([0.0, 0.0, 3.8])
    share, points = visible(scene, caster, scene.put(-3.0, 0.0), eye)
    assert share > 0.9
    assert points[:, 2].min() < 0.3
    share, points = visible(scene, caster, scene.put(11.0, 0.0), eye)
    assert 0.3 < share < 0.7
    assert 0.6 < points[:, 2].min() < 1.0


def test_camera_counts_pixels(scene):
    """Focal length times height over distance; nothing outside the field of view."""
    camera = CameraSensor(scene)
    assert camera._focal == pytest.approx(914.0, abs=0.5)
    answer = camera.look(-1.0, 0.0)
    assert answer.detected == 1.0
    pixels = float(answer.why.split()[0])
    assert pixels == pytest.approx(1.75 * 914.0 / (EDGE_M - 1.0), rel=0.02)
    assert camera.look(-3.0, 8.0).detected == 0.0


def test_dust_blinds_camera_and_not_radar():
    thick = Scene(ONE, Condition(0.85, 500.0, "dust"))
    clear = Scene(ONE, Condition(0.85, 500.0, "clear"))
    radars = [RadarSensor(s, "radar-24ghz").look(3.0, 0.0) for s in (thick, clear)]
    assert radars[0] == radars[1]
    contrast = [float(CameraSensor(s).look(3.0, 0.0).why.rsplit(" ", 1)[1]) for s in (thick, clear)]
    assert contrast[0] == pytest.approx(np.exp(-0.1 * 9.0), abs=0.01)
    assert contrast[1] == 1.0


def test_a_crouching_person_in_the_crop_is_out_of_sight(scene):
    scene.height = 0.7
    try:
        assert make_sensor("lidar", scene).look(3.0, 0.0).detected == 0.0
        assert make_sensor("camera", scene).look(11.0, 0.0).detected == 0.0
        radar = make_sensor("radar-77ghz-corner", scene)
        assert radar.false_share(-3.0, 0.0) < 0.2
        answer = radar.look(5.0, 0.0)
        assert answer.detected < 0.3
        assert "lost in the crop" in answer.why
    finally:
        scene.height = None
    assert radar.look(-1.0, 0.0).detected > 0.8  # standing, on the stubble
    assert make_sensor("lidar", scene).look(-1.0, 0.0).detected > 0.6


def test_a_radar_says_that_the_crop_behind_a_lying_person_on_the_stubble_hides_it():
    lying = Settings(target="person-lying", repeats=1, looks=10)
    radar = make_sensor("radar-77ghz-corner", Scene(lying, Condition(0.85, 400.0, "clear")))
    answer = radar.look(-1.0, 0.0)
    echo, around = (float(answer.why.split(before)[-1].split(" dB")[0]) for before in ("echo ", ", "))
    assert answer.detected < 0.2
    assert echo > 13.0 > echo - around
    assert answer.why.endswith("crop and ground are as strong")


@pytest.mark.drawn
def test_command(tmp_path, capsys, monkeypatch):
    """What it writes: a row per place, scores, a figure per condition, a page."""
    monkeypatch.setattr(reda, "places", lambda: [p for p in places() if p[0] in (-1.0, 3.0)])
    monkeypatch.setattr("swath.tools.reda.page.INSIDE", (-1.0, 3.0))
    line = ["reda", "--crop-height-m", "0.85", "--stems-per-m2", "300", "--weather", "rain"]
    line += ["--sensor", "camera", "--repeats", "1", "--workers", "1", "--out", str(tmp_path / "made")]
    assert main(line) == 0
    rows = list(csv.DictReader((tmp_path / "made" / "reda.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == 10
    assert {row["sensor"] for row in rows} == {"camera"}
    names = {f.name for f in (tmp_path / "made").iterdir()}
    assert names == {"reda.csv", "scores.csv", "report.html", "reda-85cm-300-rain.png"}
    assert "3 m inside the crop" in capsys.readouterr().out
    assert main(line) == 0  # over an earlier one
    (tmp_path / "made" / "mine.txt").write_text("", encoding="utf-8")
    assert main(line) == 2


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"heights": (9.0,)}, "--crop-height-m"),
        ({"weathers": ("fog",)}, "--weather"),
        ({"sensors": ("eye",)}, "--sensor"),
    ],
)
def test_bad_settings(settings, key):
    with pytest.raises(InputError, match=key):
        Settings(**settings)


def test_a_run_that_is_stopped_goes_on(tmp_path, monkeypatch):
    """The second time only what is missing is done, to the same numbers; with other settings all of it."""
    settings = Settings(densities=(300.0, 500.0), heights=(0.6,), weathers=("clear", "dust"))
    looked = []

    def measured(settings, condition):
        looked.append(condition)
        if len(looked) == 3:
            raise KeyboardInterrupt
        share = 1.0 / (3.0 + condition.density)
        cell = Cell(3.0, 0.0, share, 0.0, 10, f"{condition.name}, seen")
        return reda.Found(condition, {"lidar": [cell] * 3}, {("lidar", 1.75): cell, ("lidar", 0.8): cell})

    monkeypatch.setattr(reda, "measure", measured)
    kept = tmp_path / "out" / reda.KEPT
    with pytest.raises(KeyboardInterrupt):
        reda.run_reda(settings, kept=kept)
    found = reda.run_reda(settings, kept=kept)
    assert len(looked) == 3 + 2
    assert found == reda.run_reda(settings)
    del looked[:]
    looked += [None] * 3
    reda.run_reda(Settings(densities=(300.0,), heights=(0.6,), weathers=("clear",)), kept=kept)
    assert len(looked) == 3 + 1
    kept.write_text("nothing of ours")
    assert reda.run_reda(settings, kept=kept) == found


def test_the_command_says_what_is_kept(tmp_path, monkeypatch, capsys):
    def stopped(settings, *, kept, **more):
        reda._keep(kept, settings, [])
        raise KeyboardInterrupt

    monkeypatch.setattr(reda, "run_reda", stopped)
    assert main(["reda", "--out", str(tmp_path / "out")]) == 130
    assert "the same command resumes from there" in capsys.readouterr().err
    assert main(["reda", "--out", str(tmp_path / "out")]) == 130  # the folder is one of its own


def test_before_dawn_warmth_is_seen_and_light_is_not():
    """On stubble, 5 m ahead; at noon it stands out of what is around it far less."""
    pytest.importorskip("pvlib", reason="needs the extra `light`")
    found, over = {}, {}
    for hour in (4.0, 13.5):
        settings = Settings(
            target="animal-fawn", hours=(hour,), sensors=("thermal",), repeats=1, camera_least_px=20.0
        )
        scene = Scene(settings, Condition(0.85, 300.0, "clear", hour))
        thermal, camera = (make_sensor(name, scene).look(-1.0, 0.0) for name in ("thermal", "camera"))
        found[hour] = thermal.detected, camera.detected
        over[hour] = float(thermal.why.split()[4])
    assert found[4.0] == (1.0, 0.0)
    assert found[13.5][1] == 1.0
    assert over[13.5] < 0.3 * over[4.0]


def test_thermal_asks_for_an_hour():
    with pytest.raises(InputError, match="--hour"):
        Settings(sensors=("thermal",))


def test_the_head_names_what_was_asked_alone():
    told = " ".join(_settings(replace(ONE, sensors=("lidar",))).values())
    assert "of the LiDAR" in told
    assert "radar" not in told
    assert "px" not in told
