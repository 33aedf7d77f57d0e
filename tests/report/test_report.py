"""The report: one page that holds everything and loads nothing; pictures that show what they should."""

import re
from copy import copy, deepcopy
from html.parser import HTMLParser

import numpy as np
import pytest

from swath.core.number_text import num
from swath.judge.catalogue import load_evaluators
from swath.judge.evaluators.edge_detection import EdgeDetection
from swath.judge.evaluators.lateral_error import LateralError
from swath.judge.summary import make_summary, write_summary
from swath.record.digest import Digest
from swath.record.recorder import Recorder
from swath.report.html import Figure
from swath.report.page import render
from swath.report.plots import POINTS, evenly, figure
from swath.report.report import MachineReport, ReportData, near_obstacles, write_report
from swath.report.scan_sampler import ScanSampler, circles_of, make_map
from swath.scenario.resolved import Expectation
from swath.scenario.sections import Limit
from swath.signals import MachineState
from tests.evaluated import evaluation_of
from tests.fake_run import GEOMETRY, ArcEdge, GridField, drive, machine

pytestmark = pytest.mark.drawn

LIMITS = [
    Expectation("combine", "edge_rmse_m", Limit(max=0.5)),
    Expectation("combine", "lateral_rms_m", Limit(max=0.001)),
    Expectation("combine", "lateral_error_m", Limit(max=1.0, hold="always", from_m=10.0)),
]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    edge = ArcEdge(40.0)
    ground, combine, digest = GridField(edge, gap=(14.0, 17.0)), machine(edge=edge), Digest()
    evaluation = evaluation_of(ground, combine, expect=LIMITS)
    states = [None]

    def note(slot, t, outputs):
        states.extend(s for s in outputs.values() if isinstance(s, MachineState))

    keeper = ScanSampler(
        combine, lambda: evaluation.find("combine", EdgeDetection).true_offset, lambda: states[-1]
    )
    with Recorder(folder, [combine], extra={"combine": evaluation.columns("combine")}) as recorder:
        drive([digest, evaluation, note, keeper, recorder], ground)
    summary = make_summary(
        {"name": "bend <1>", "summary": "A & B", "seed": 3},
        evaluation,
        {"combine": recorder.tracks["combine"].arrays()},
        sensors={},
        simulated_s=12.0,
        wall_s=6.0,
        ray_count=1000,
        digest=digest.hex,
        incomplete=False,
        cost={"combine.lidar": (4.0, 300), "combine.edge": (0.0, 0)},
    )
    write_summary(folder, summary)
    tracks = recorder.tracks["combine"].arrays()
    path = np.stack([tracks["header_end_x_m"], tracks["header_end_y_m"]], axis=1)
    shown = MachineReport(
        combine,
        tracks,
        evaluation.find("combine", LateralError).series(),
        evaluation.find("combine", EdgeDetection).series(),
        {"lidar": keeper.pick("lidar")},
        np.array([edge.point_at(s) for s in range(40)]),
    )
    data = ReportData(
        summary,
        "name: bend\ntext: <b>\n",
        [shown],
        map=make_map(ground, path),
        obstacles=[(5.0, 5.0, 0.1)],
        driven=path + 0.3,
    )
    return write_report(folder, data), data, keeper, ground


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.images, self.links = [], [], []

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        if tag == "img":
            self.images.append(found["src"])
        self.links += [found[k] for k in ("href", "src") if k in found and tag != "img"]
        assert tag != "script"
        if tag not in ("img", "meta", "br", "wbr"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_page_is_whole_and_loads_nothing(run):
    text = run[0].read_text(encoding="utf-8")
    tags = Tags()
    tags.feed(text)
    assert tags.open == []
    assert tags.links == []
    assert len(tags.images) == 4
    assert all(i.startswith("data:image/") for i in tags.images)
    assert not re.search(r"(href|src|url)\s*[=(]\s*[\"']?https?:", text)
    assert sorted(p.name for p in run[0].parent.iterdir()) == [
        "metadata.yaml",
        "report.html",
        "run.mcap",
        "summary.json",
        "tracks.parquet",
    ]


def test_the_page_says_what_the_summary_says(run):
    text = run[0].read_text(encoding="utf-8")
    summary = run[1].summary
    assert "1 of 5 limits fail" in text
    assert "bend &lt;1&gt;" in text
    assert "A &amp; B" in text
    assert "text: &lt;b&gt;" in text
    assert summary["digest"] in text
    assert num(summary["lateral_rms_m"], "m") in text


def test_a_summary_without_anything_makes_a_page():
    text = render({"incomplete": True, "edge_rmse_m": None}, "", [])
    assert "Incomplete" in text
    assert "No limits set" in text
    assert '<span class="v">-</span>' in text


def test_a_limit_on_samples_and_an_incident_have_their_rows(run):
    text = run[0].read_text(encoding="utf-8")
    assert "max 1 always" in text
    assert "from_m 10" in text
    event = {"t_s": 3.2, "kind": "gap", "machine": "combine", "x_m": 1.0, "y_m": 2.0, "distance_m": 6.4}
    event |= {"end_t_s": 5.2, "end_distance_m": 10.4, "text": "passes a gap"}
    assert "passes a gap, lasts 2 s" in render({"incidents": [event]}, "", [])


def test_several_machines_have_their_own_results():
    entry = {"subject": "cart", "name": "distance_m", "limit": {"min": 9.0}, "value": 7.0, "result": "fail"}
    machines = {"combine": {"lateral_rms_m": 0.04}, "cart": {"distance_m": 7.0}}
    text = render({"machines": machines, "expect": [entry], "ray_count": 5}, "", [])
    for heading in ("Results: combine", "Results: cart", "Results: field and run"):
        assert heading in text
    assert "0.04 m" in text
    assert text.count("✗ fail") == 1
    assert "1 of 1 limits fail" in text


def test_defaults_are_pale():
    text = render({}, "written: 1\nnot: <2>\n", [], default_lines={2})
    assert "<pre>written: 1\n<i>not: &lt;2&gt;</i></pre>" in text


def test_an_empty_run_makes_a_report(tmp_path):
    combine = machine()
    with Recorder(tmp_path, [combine], detail="none") as recorder:
        pass
    data = ReportData({}, "", [MachineReport(combine, recorder.tracks["combine"].arrays())])
    assert write_report(tmp_path, data).stat().st_size > 1000


def test_the_map_shows_crop_where_it_stands(run):
    _, data, _, ground = run
    field_map = data.map
    ny, nx = field_map.standing.shape
    left, right, bottom, top = field_map.extent
    u = left + (np.arange(nx) + 0.5) * (right - left) / nx
    v = bottom + (np.arange(ny) + 0.5) * (top - bottom) / ny
    c, s = np.cos(field_map.turn), np.sin(field_map.turn)
    for i, j in ((3, 5), (ny // 2, nx // 2), (ny - 9, nx - 7), (20, 300)):
        x, y = field_map.origin + np.array([c * u[j] - s * v[i], s * u[j] + c * v[i]])
        assert field_map.standing[i, j] == ground.standing(x, y)
        np.testing.assert_allclose(field_map.place([x, y]), [u[j], v[i]], atol=1e-9)
    assert 0.1 < field_map.standing.mean() < 0.5


def test_kept_scans_are_spread_and_end_with_the_newest(run):
    scans = run[2].pick("lidar", 4)
    distances = [s.distance for s in scans]
    assert distances == sorted(distances)
    assert distances[-1] == pytest.approx(24.0)
    assert distances[0] < 6.0
    assert len(run[2].pick("lidar", 100)) > 10


def test_kept_points_are_where_the_crop_is(run):
    """In the machine frame: crop 0.8 m high to the right of the true edge, bare ground to its left."""
    scan = run[2].pick("lidar", 4)[-1]
    assert [one.t for one in run[2].pick("lidar", 1)] == [scan.t]  # the newest
    far_right = scan.points[scan.points[:, 1] < scan.edge_true - 0.5]
    far_left = scan.points[scan.points[:, 1] > scan.edge_true + 0.5]
    assert np.median(far_right[:, 2]) == pytest.approx(0.8, abs=0.05)
    assert np.median(far_left[:, 2]) == pytest.approx(0.0, abs=0.01)
    np.testing.assert_allclose(scan.hits, scan.pose.apply(scan.points), atol=1e-5)


def test_figures_need_no_display_and_leave_no_state():
    import matplotlib.pyplot as plt

    before = plt.get_fignums()
    assert figure(2, 1).canvas.get_supported_filetypes()["svg"]
    assert plt.get_fignums() == before


def test_circles_of_solids():
    from swath.field.memory_layout import Solids

    axes = np.eye(3)[None]
    solids = Solids(
        box_centre=np.array([[1.0, 2.0, 0.0]]),
        box_axes=axes,
        box_half=np.array([[0.5, 2.0, 9.0]]),
        capsule_a=np.array([[3.0, 4.0, 0.0]]),
        capsule_b=np.array([[3.0, 4.0, 2.0]]),
        capsule_radius=np.array([0.1]),
    )
    assert circles_of(solids) == [(1.0, 2.0, 2.0), (3.0, 4.0, pytest.approx(0.1))]
    assert circles_of(Solids()) == []
    way = np.stack([np.linspace(0.0, 30.0, 31), np.zeros(31)], axis=1)
    for end_m, shown in ((30.0, [[1.0, 2.0], [3.0, 4.0]]), (-16.7, [[1.0, 2.0]]), (-40.0, [])):
        assert near_obstacles(solids, way + np.array([end_m - 30.0, 0.0])).tolist() == shown
    assert near_obstacles(Solids(), way).shape == (0, 2)
    assert GEOMETRY.header_end("left")[1] == 3.5


def test_a_limit_has_its_unit():
    from swath.report.page import limit_row

    metrics = load_evaluators().metrics
    entry = {"subject": "combine", "name": "lateral_p95_m", "limit": {"max": 0.2}, "value": 0.1496}
    row = limit_row({**entry, "result": "pass"}, metrics)
    assert (row["limit"], row["value"]) == ("max 0.2 m", "0.1496 m")
    column = limit_row({**entry, "name": "lateral_error_m", "result": "pass"}, metrics)
    assert (column["limit"], column["value"]) == ("max 0.2", "0.1496")


def test_what_one_came_for_stands_first_and_credibility_opens():
    pictures = [Figure(name, "data:image/svg", "") for name in ("Field map", "Scans")]
    row = {
        "quantity": "rain_mm_h",
        "state": "outside",
        "met": [0.0, 9.0],
        "checked": [0.0, 5.0],
        "source": "",
    }
    inside = {**row, "quantity": "fog", "state": "inside"}
    told = {"slots": {"combine.lidar": {"level": "plants", "quantities": [row, inside]}}}
    expect = [
        {
            "subject": "combine",
            "name": "lateral_rms_m",
            "limit": {"max": 1.0},
            "value": 0.5,
            "window": {},
            "result": "pass",
        }
    ]
    summary = {
        "name": "bend",
        "summary": "bend with seed=3",
        "credibility": told,
        "expect": expect,
        "notes": ["x"],
    }
    text = render(summary, "", pictures)
    heads = re.findall(r"<h2>(.*?)</h2>", text)
    assert heads[:3] == ["Field map", "Limits", "Scans"]
    assert heads.index("Credibility") > heads.index("Results")
    assert "<title>bend with seed=3" in text
    assert "<title>bend ·" in render({**summary, "summary": "a bend"}, "", pictures)
    line = re.search(r"<details><summary>(1 of 2 quantities.*?)</summary>(.*?)</details>", text, re.DOTALL)
    assert line is not None
    assert "rain_mm_h of combine.lidar outside" in line[1]
    assert "0 to 9" in line[2]


@pytest.mark.parametrize("count", [0, 1, POINTS, 2 * POINTS - 1, 2 * POINTS, 10 * POINTS - 1, 10**6])
def test_a_curve_has_all_its_points_up_to_a_number_and_never_twice_as_many(count):
    shown = np.arange(count)[evenly(range(count))]
    assert len(shown) == count or POINTS <= len(shown) < 2 * POINTS
    assert len(set(np.diff(shown).tolist())) <= 1


@pytest.mark.parametrize("limit", [1.7e308, -1.7e308, 0.0, 5e-324])
def test_limits_of_any_size_are_drawn(run, limit, tmp_path):
    data = copy(run[1])
    data.summary = deepcopy(data.summary)
    changed = [entry["limit"] for entry in data.summary["expect"] if "max" in entry["limit"]]
    for entry in changed:
        entry["max"] = limit
    assert len(changed) >= len(LIMITS)
    assert write_report(tmp_path, data).stat().st_size > 1000
