"""replay.html of a short run: what is in it, that it lies where the run was, that it loads nothing."""

import re
import shutil
import tracemalloc
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from matplotlib.image import imread
from rosbags.highlevel import AnyReader

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.judge.summary import read_summary
from swath.record.mcap_file import McapFile
from swath.record.scan_messages import cloud_message
from swath.record.tracks import PIECE, read_tracks
from swath.replay.layers import area_about
from swath.replay.moments import events_of, worst_moments
from swath.replay.things import things_of
from swath.replay.writer import ReplayWriter, collect, packed, render, unpacked, view
from swath.report.report import ReportWriter
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job
from swath.scenario.scenario import parse_scenario
from tests.replay.browser import Browser, NoBrowser
from tests.replay.page_data import data_of

SCENARIO = """
format: swath scenario 2
name: short
seed: 4
run: {distance_m: 7, max_duration_s: 6}
field:
  terrain: {level: formula, slope_percent: 2}
  stand: {level: uniform, stems_per_m2: 120}
  edge: {shape: straight, heading_deg: 60}
  obstacles: [{kind: post, x_m: -6, y_m: 12, name: pole}]
machines:
  combine:
    motion: {start_speed_kmh: 7}
    lidar: {sub_rays: 3, sector_deg: [-40, 40], step_deg: 1.0}
"""


class KeepWorld(RunHook):
    """Keeps the world of a run."""

    def begin(self, run):
        self.world = run.world


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out, kept = tmp_path_factory.mktemp("runs") / "short", KeepWorld()
    run_job(parse_scenario(SCENARIO), out, hooks=[kept, ReportWriter(), ReplayWriter()])
    return out, kept.world


def cells(values, arrays):
    """World places of the cells' middles, and the time at which each is cut [s], inf = never."""
    area = values["area"]
    rows, columns = arrays["cut_when"].shape
    size = area["tile"] / area["cells"]
    u = area["first"][0] * area["tile"] + (np.arange(columns) + 0.5) * size
    v = area["first"][1] * area["tile"] + ((np.arange(rows) + 0.5) * size)[:, None]
    c, s = np.cos(area["yaw"]), np.sin(area["yaw"])
    when = np.where(arrays["cut_when"] == 65535, np.inf, arrays["cut_when"] * area["unit_s"])
    return c * u - s * v, s * u + c * v, when


def test_the_cells_that_the_page_cuts_are_those_that_the_run_cut(finished):
    out, world = finished
    values, arrays = data_of(out / "replay.html")
    x, y, when = cells(values, arrays)
    shown = np.repeat(np.repeat(arrays["shown"] > 0, values["area"]["cells"], 0), values["area"]["cells"], 1)
    stands = world.field.standing(x, y)
    assert np.mean(stands[shown] == np.isinf(when)[shown]) > 0.999
    assert 0.3 < np.mean(stands[shown]) < 0.9


def test_a_cell_is_cut_when_the_knife_is_there(finished):
    out, world = finished
    x, y, when = cells(*data_of(out / "replay.html"))
    tracks, sheet = read_tracks(out / "tracks.parquet"), world.leader.sheet
    taken = (when > 0.5) & np.isfinite(when)
    pose = [np.interp(when[taken], tracks["t_s"], tracks[name]) for name in ("x_m", "y_m", "yaw_rad")]
    ahead = np.cos(pose[2]) * (x[taken] - pose[0]) + np.sin(pose[2]) * (y[taken] - pose[1])
    assert np.abs(ahead - sheet.knife_x).max() < 0.08


def test_places_are_those_of_the_tracks_to_a_millimetre(finished):
    out, world = finished
    values, arrays = data_of(out / "replay.html")
    tracks, about = read_tracks(out / "tracks.parquet"), values["machines"][0]
    own = dict(zip(about["columns"], arrays["track_0"], strict=True))
    at = np.searchsorted(tracks["t_s"], own["t_s"] - 1e-4)
    for name, shift in (("x_m", values["origin"][0]), ("y_m", values["origin"][1]), ("z_m", 0.0)):
        assert np.abs(own[name] + shift - tracks[name][at]).max() < 1e-3
    assert about["header"][1] == world.leader.sheet.knife_x
    ground = world.field.ground_height(*world.field.maker.to_world(0.0, 0.0))
    corner = -np.array(values["area"]["first"])
    height = values["area"]["low"] + values["area"]["unit_m"] * arrays["heights"][corner[1], corner[0]]
    assert height == pytest.approx(float(ground), abs=1e-3)


def test_the_page_knows_scans_straw_obstacles_and_charts(finished):
    values, arrays = data_of(finished[0] / "replay.html")
    assert [s["slot"] for s in values["scanners"]] == ["lidar"]
    assert len(arrays["scan_times_0"]) > 10
    assert arrays["scan_starts_0"][-1] == len(arrays["scan_points_0"]) > 500
    assert [t["name"] for t in values["things"]] == ["pole"]
    assert {c["title"] for c in values["machines"][0]["charts"]} >= {"Edge", "Speed", "Crop"}
    assert values["limits"][1] == 0


def test_the_report_of_the_run_has_all_its_pictures(finished):
    page = (finished[0] / "report.html").read_text("utf-8")
    titles = re.findall(r'<img src="data:[^"]*" alt="([^"]*)"', page)
    assert titles == ["Field map", "Steering and detection", "Scans", "Driving"]


MIB = 1 << 20
GROWS_MIB = 6.0  # what the page of a run four times as long may take more


def much_longer(run, out, rows):
    """A run folder as if the machine had done the same again and again: so many rows of tracks, large scans.

    Its header end is 0.75 m off its line at one row.
    """
    shutil.copytree(run, out, ignore=shutil.ignore_patterns("*.mcap", "*.parquet", "*.html"))
    table = pq.read_table(run / "tracks.parquet")
    times = -(-rows // len(table))
    table = pa.concat_tables([table] * times).slice(0, rows).combine_chunks()
    error = table["lateral_error_m"].to_numpy().copy()
    error[rows - 4321] = 0.75
    for name, values in (("t_s", 0.02 * np.arange(rows)), ("lateral_error_m", error)):
        index = table.schema.get_field_index(name)
        table = table.set_column(index, table.schema.field(name), pa.array(values))
    at = table.schema.get_field_index("distance_m")
    table = table.set_column(at, table.schema.field("distance_m"), pa.array(0.04 * np.arange(rows)))
    pq.write_table(table, out / "tracks.parquet", row_group_size=PIECE, compression="zstd")
    file, beam = McapFile(out / "run.mcap"), np.arange(5000)
    points = np.stack([0.001 * beam, 0.0 * beam, 1.0 + 0.0 * beam], axis=1)
    more = {"beam": beam, "echo": 0 * beam}
    for k in range(rows // 100):
        message = cloud_message(SimpleNamespace(make=file.make), k * NS // 10, "map", points, more)
        file.write("/combine/lidar/truth", k * NS // 10, message)
    file.close()
    return out


@pytest.mark.draws
def test_the_page_of_a_run_four_times_as_long_takes_no_more_memory_and_tells_the_same(finished, tmp_path):
    run, world = finished
    peaks = []
    for rows in (2 * PIECE, 8 * PIECE):
        folder = much_longer(run, tmp_path / str(rows), rows)
        tracemalloc.start()
        values, arrays = collect(world, folder, read_summary(folder / "summary.json"))
        render("long", packed(values, arrays))
        peaks.append(tracemalloc.get_traced_memory()[1] / MIB)
        tracemalloc.stop()
        assert values["duration"] == pytest.approx(0.02 * (rows - 1))
        t_s, text = round(0.02 * (rows - 4321), 3), "header end 75.0 cm off"
        assert {"t_s": t_s, "machine": "combine", "text": text} in values["moments"]
        assert arrays["track_0"].shape[1] <= 3001
        assert arrays["track_0"][values["machines"][0]["columns"].index("t_s"), -1] == pytest.approx(
            values["duration"]
        )
        assert any(f" of {rows // 100} scans of combine.lidar are shown" in note for note in values["notes"])
        assert 80_000 <= len(arrays["scan_points_0"]) <= 160_000
    assert peaks[1] - peaks[0] < GROWS_MIB


def test_echoes_are_those_of_the_recording_to_a_millimetre(finished):
    out, _ = finished
    values, arrays = data_of(out / "replay.html")
    found = recorded_scans(out)
    starts = arrays["scan_starts_0"]
    for k, t in enumerate(arrays["scan_times_0"]):
        own = arrays["scan_points_0"][starts[k] : starts[k + 1]] * values["scanners"][0]["unit_m"]
        truth = found[min(found, key=lambda at: abs(at / NS - t))]
        assert len(own) == len(truth)
        gaps = own + arrays["scan_middle_0"][k] + values["origin"] - truth
        assert np.abs(gaps).max(initial=0.0) < 1e-3
    assert starts[-1] > 500


def test_obstacles_that_came_and_went_have_their_times(finished):
    world = finished[1]
    put = {"t_s": 1.5, "set": "obstacles.hare", "value": "{kind: stone, x_m: 3, y_m: 4}"}
    events = [
        put,
        {"t_s": 2.0, "set": "obstacles.0", "value": None},
        {"t_s": 2.5, "set": "obstacles.hare", "value": None},
    ]
    things, _, left_out = things_of(world, events, np.zeros(3))
    assert [(t["name"], t["kind"], t["from"], t["to"]) for t in things] == [
        ("pole", "post", 0.0, 2.0),
        ("obstacles.hare", "ellipsoid", 1.5, 2.5),
    ]
    assert things[1]["centre"][:2] == [3.0, 4.0]
    assert left_out == ""


def test_marks_and_worst_moments():
    n = 101
    columns = {
        "t_s": np.linspace(0, 10, n),
        "distance_m": np.linspace(0, 30, n),
        "engine_load": np.full(n, 0.4),
    }
    columns["lateral_error_m"] = np.where(columns["t_s"] == 7.0, -0.2, 0.05)
    assert worst_moments("a", columns, cuts=True) == [
        {"t_s": 7.0, "machine": "a", "text": "header end \u221220.0 cm off"}
    ]
    assert worst_moments("a", columns, cuts=False) == []
    entry = {
        "subject": "a",
        "name": "lateral_error_m",
        "result": "fail",
        "limit": {"min": -0.1},
        "reason": "why",
    }
    gap = {"t_s": 3.0, "end_t_s": None, "kind": "gap", "machine": "a", "text": "wide"}
    change = {"t_s": 1.0, "set": "a.speed.speed_kmh", "value": 5}
    found = events_of({"incidents": [gap], "expect": [entry], "events": [change]}, {"a": columns})
    assert [(e["t_s"], e["end_s"], e["kind"]) for e in found] == [
        (1.0, 1.0, "change"),
        (3.0, None, "gap"),
        (7.0, 7.0, "limit"),
    ]
    assert found[2]["text"] == "limit lateral_error_m fails: why"


def test_the_page_loads_nothing_and_runs_no_text(finished):
    text = (finished[0] / "replay.html").read_text(encoding="utf-8")
    plain = re.sub(r'(<script id="data"[^>]*>)[^<]*', r"\1", text)
    assert "http:" not in plain
    assert "https:" not in plain
    assert not re.search(r"\bsrc\s*=|@import|url\(|\beval\b|new Function|import\(|\bfetch\(|XMLHttp", plain)
    assert re.findall(r'href="([^"]*)"', plain) == ["data:,"]
    assert len(text) < 8e6


def test_the_same_bytes_again_from_the_folder(finished, tmp_path):
    out = finished[0]
    again = view(out, out=tmp_path / "again.html")
    assert again.read_bytes() == (out / "replay.html").read_bytes()


def test_without_a_recording_the_page_says_what_is_missing(finished, tmp_path, capsys):
    folder = tmp_path / "run"
    folder.mkdir()
    for name in ("scenario.yaml", "summary.json", "tracks.parquet"):
        (folder / name).write_bytes((finished[0] / name).read_bytes())
    assert main(["view", str(folder)]) == 0
    assert capsys.readouterr().out.strip() == str(folder / "replay.html")
    values, _ = data_of(folder / "replay.html")
    assert "nothing was recorded: scans and straw are missing" in values["notes"]
    assert values["machines"][0]["charts"]
    assert values["scanners"] == []


@pytest.mark.parametrize("column", ["t_s", "x_m", "machine", "yaw_rad", "distance_m"])
def test_tracks_without_a_column_are_refused_by_name(finished, tmp_path, column, capsys):
    import pyarrow.parquet as pq

    for name in ("scenario.yaml", "summary.json"):
        (tmp_path / name).write_bytes((finished[0] / name).read_bytes())
    table = pq.read_table(finished[0] / "tracks.parquet")
    pq.write_table(table.drop_columns([column]), tmp_path / "tracks.parquet")
    for command in (["view"], ["diff", str(finished[0])], ["yield-log", "--out", str(tmp_path / "y.csv")]):
        code = main([*command, str(tmp_path)])
        said = capsys.readouterr().err
        assert code in (0, 2)
        assert code == 0 or f"tracks = {column}: expected this column" in said
    assert main(["view", str(tmp_path)]) == 2


def test_what_is_no_run_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"expected a run folder, it has no scenario\.yaml"):
        view(tmp_path)


def test_arrays_come_back_as_they_were():
    arrays = {
        "a": np.arange(7, dtype=np.uint16),
        "b": np.random.default_rng(1).normal(size=(3, 2)).astype("f4"),
    }
    values, back = unpacked(packed({"x": [1, "ä"]}, arrays))
    assert values == {"x": [1, "ä"]}
    assert all((back[k] == arrays[k]).all() and back[k].dtype == arrays[k].dtype for k in arrays)
    with pytest.raises(TypeError, match="float64"):
        packed({}, {"c": np.zeros(2)})


def test_a_run_through_a_large_field_is_shown_as_far_as_fits():
    way = np.stack([np.linspace(0.0, 40_000.0, 4001), np.linspace(0.0, 9000.0, 4001)], axis=1)
    area = area_about(1.0, np.arange(4001.0), way)
    assert area.until_s < 4000.0
    assert np.prod(area.shape) <= 250_000
    assert max(area.shape) * area.cells <= 4096


SOON = """new Promise((done) => {
  const before = swath.frames, look = () => (swath.frames > before ? done(true) : setTimeout(look, 10));
  swath.app.touch();
  look();
})"""
STEMS = """(() => {
  const [left, right] = swath.header(0, %g), d = [left[1] - right[1], right[0] - left[0]];
  const n = Math.hypot(...d);
  const place = (s) => [0, 1].map((k) => (left[k] + right[k]) / 2 + s * d[k] / n);
  const [ahead, behind] = [1.5, -1.5].map((s) => swath.stems(...place(s), 1, %g));
  return { left, right, ahead, behind };
})()"""


@pytest.fixture(scope="module")
def browser(finished):
    try:
        with Browser() as opened:
            opened.open(finished[0] / "replay.html", "detail=0.1")
            yield opened
    except NoBrowser as error:
        pytest.skip(str(error))


def test_in_a_browser_stems_are_cut_behind_the_header_and_stand_ahead(finished, browser):
    out, world = finished
    told = browser.ask(STEMS % (3, 3))
    assert told["ahead"]["cut"] == 0
    assert told["ahead"]["standing"] > 150
    assert told["behind"]["standing"] == 0
    assert told["behind"]["cut"] > 150
    for side, place in header_ends(out, world, 3.0).items():
        assert told[side] == pytest.approx(place, abs=1e-3)


def header_ends(out, world, t):
    """Both ends of the header at a time [s], from the tracks, in the scene."""
    values, tracks = data_of(out / "replay.html")[0], read_tracks(out / "tracks.parquet")
    names = ("x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad")
    x, y, z, *angles = (np.interp(t, tracks["t_s"], tracks[name]) for name in names)
    pose = Pose.from_euler([x, y, z], *angles)
    ends = {side: [*world.leader.sheet.header_end(side), 0.0] for side in ("left", "right")}
    return {side: pose.apply(end) - values["origin"] for side, end in ends.items()}


def recorded_scans(out):
    """World places of the echoes (n, 3) of every recorded scan, by time [ns]."""
    found = {}
    with AnyReader([out]) as bag:
        for connection, t, data in bag.messages(
            [c for c in bag.connections if c.topic == "/combine/lidar/truth"]
        ):
            cloud = bag.deserialize(data, connection.msgtype)
            offsets = [next(f.offset for f in cloud.fields if f.name == axis) for axis in "xyz"]
            rows = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_step)
            axes = [rows[:, o : o + 4].copy().view("<f4")[:, 0] for o in offsets]
            found[t] = np.stack(axes, axis=1).astype(float)
    return found


def projected(places, view, width, height):
    """Pixels of places (n, 3) in a picture of 0.8 rad from bottom to top, x to the right, y down."""
    eye, target = np.array(view["eye"]), np.array(view["target"])
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    away = places - eye
    focal = 0.5 * height / np.tan(0.4)
    u = away @ right / (away @ ahead)
    v = away @ np.cross(right, ahead) / (away @ ahead)
    return np.stack([0.5 * width + focal * u, 0.5 * height - focal * v], axis=1)


def test_in_a_browser_header_and_scan_are_drawn_where_they_were_recorded(finished, browser):
    out, world = finished
    origin = np.array(data_of(out / "replay.html")[0]["origin"])
    scans = recorded_scans(out)
    first = min(t for t, places in scans.items() if len(places) > 20)  # the only one that is shown
    echoes = scans[first] - origin
    browser.ask(f"(swath.seek({first / NS}), swath.camera(1))")
    browser.ask("['edges', 'beams'].forEach((n) => { document.getElementById(n).checked = false; })")
    pictures = []
    for shown in ("true", "false"):
        browser.ask(f"(document.getElementById('scans').checked = {shown})")
        browser.ask(SOON)
        pictures.append(imread(BytesIO(browser.picture()))[..., :3])
    box = browser.ask("(({ left, top, width, height }) => [left, top, width, height])"
                      "(document.getElementById('view').getBoundingClientRect())")  # fmt: skip
    view = browser.ask("swath.view")
    changed = np.abs(pictures[0] - pictures[1]).max(axis=2) > 0.02
    rows, columns = np.nonzero(changed)
    assert len(rows) > 50

    def apart(shift):
        places = projected(echoes + shift, view, box[2], box[3]) + box[:2]
        return np.percentile([np.hypot(columns - x, rows - y).min() for x, y in places], 65)

    assert apart(0.0) < 1.2  # some are hidden
    assert min(apart([0.2, 0.0, 0.0]), apart([-0.2, 0.0, 0.0]), apart([0.0, 0.2, 0.0])) > 1.5
    canvas = browser.ask("[swath.app.canvas.width, swath.app.canvas.height]")
    for end in header_ends(out, world, first / NS).values():
        drawn = browser.ask("swath.project({}, {}, {})".format(*end))
        own = projected(end[None], browser.ask("swath.view"), *canvas)[0] / canvas
        assert drawn == pytest.approx(own.tolist(), abs=1e-6)
    browser.ask("['edges', 'beams', 'scans'].forEach((n) => { document.getElementById(n).checked = true; })")


def test_in_a_browser_the_slider_and_the_keys_move_the_time(browser):
    slider = "document.getElementById('time')"
    browser.ask(f"({slider}.value = 2, {slider}.dispatchEvent(new Event('input')))")
    assert browser.ask("swath.time") == 2.0
    browser.ask("dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowRight' }))")
    assert browser.ask("swath.time") == pytest.approx(2.2)
    browser.ask("dispatchEvent(new KeyboardEvent('keydown', { key: '4' }))")
    assert browser.ask("swath.app.cameras.name") == "above"
    browser.ask(SOON)
    assert browser.ask("document.getElementById('clock').textContent").startswith("2.2 s")
    assert browser.ask("document.querySelectorAll('figure canvas').length") >= 3


def test_in_a_browser_crop_becomes_stubble_and_back_to_the_pixel(browser):
    browser.ask("(swath.seek(1.6), swath.camera(3))")
    browser.ask(SOON)
    browser.ask("swath.camera(4)")  # free, from where one is
    seen = []
    for time in (1.6, 3.4, 1.6):
        browser.ask(f"swath.seek({time})")
        browser.ask(SOON)
        seen.append(imread(BytesIO(browser.picture())))
    assert (seen[0] == seen[2]).all()
    left, right = browser.ask("swath.header(0, 1.6)")
    d = np.array([left[1] - right[1], right[0] - left[0]]) / np.hypot(left[0] - right[0], left[1] - right[1])
    x, y = 0.5 * (np.array(left) + right)[:2] + 1.2 * d
    u, v = browser.ask(f"swath.project({x}, {y}, {left[2]})")
    box = browser.ask("(({ left, top, width, height }) => [left, top, width, height])"
                      "(document.getElementById('view').getBoundingClientRect())")  # fmt: skip
    row, column = round(box[1] + v * box[3]), round(box[0] + u * box[2])
    patch = [image[row - 4 : row + 5, column - 4 : column + 5, :3].mean(axis=(0, 1)) for image in seen[:2]]
    vivid = [(p.max() - p.min()) / p.max() for p in patch]
    assert vivid[0] - vivid[1] > 0.15  # gold, then straw-coloured stubble


def test_in_a_browser_nothing_is_asked_for_and_nothing_complains(finished, browser):
    assert browser.told == []
    assert [r for r in browser.requests if not r.startswith(("file:", "data:", "about:"))] == []
