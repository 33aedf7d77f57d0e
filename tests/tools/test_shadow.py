"""Detectors in shadow, and on stored scans: what the one at the wheel said comes out again, bit for bit."""

import json
from pathlib import Path

import pytest

import swath
from swath.core.errors import InputError
from swath.record.digest import Digest
from swath.record.read.feed import exact_samples, exact_topic
from swath.record.read.files import open_log
from swath.record.tracks import read_tracks
from swath.runtime.job import run_job
from swath.runtime.kept import KeptFields
from swath.tools.function_test.judging.judged import in_shadow
from swath.tools.function_test.plan import Plan
from swath.tools.function_test.session import begin, open_session
from swath.tools.function_test.shadow import ShadowHook
from tests.tools.fake_work import do_run
from tests.whole.small import small

ROOT = Path(__file__).parents[2]
LIDAR = "combine.lidar={level: empirical, sector_deg: [-40, 40], step_deg: 1.0}"


def scenario(*sets):
    crop = ("field.stand.height_factor=0.7",)  # lower than is usual, which the driver's choice of crop tells
    return small("run.distance_m=13", "run.max_duration_s=12", LIDAR, "field.obstacles=[]", *crop, *sets)


@pytest.fixture(scope="module")
def shadowed(tmp_path_factory):
    """A run with three shadows: the detector at the wheel, the same with a fault, another one."""
    shadows = {
        "same": scenario(),
        "biased": scenario("combine.edge.fault={bias: {offset_cm: 10}}"),
        "otsu": scenario("combine.edge.level=otsu"),
    }
    return run_job(scenario(), tmp_path_factory.mktemp("run") / "run", hooks=[ShadowHook(shadows)])


def test_a_shadow_of_the_detector_at_the_wheel_says_the_same(shadowed):
    same = shadowed.summary["shadow"]["same"]
    edge = {k: v for k, v in shadowed.summary.items() if k in same["metrics"]}
    assert same["metrics"] == edge
    assert edge["edge_sample_count"] > 20


def test_another_detector_says_something_else(shadowed):
    told = shadowed.summary["shadow"]
    assert len({one["digest"] for one in told.values()}) == 3
    shift = told["biased"]["metrics"]["edge_bias_m"] - told["same"]["metrics"]["edge_bias_m"]
    assert shift == pytest.approx(-0.10, abs=1e-9)  # to the left, away from the crop
    assert told["otsu"]["metrics"]["edge_rmse_m"] != told["same"]["metrics"]["edge_rmse_m"]


def test_shadows_do_not_change_the_run(shadowed, tmp_path):
    assert run_job(scenario(), tmp_path / "run").summary["digest"] == shadowed.summary["digest"]


def test_only_the_detector_may_differ(tmp_path):
    hook = ShadowHook({"slow": scenario("combine.speed.speed_kmh=3")})
    with pytest.raises(InputError, match=r"candidate = slow: expected changes of combine\.edge alone"):
        run_job(scenario(), tmp_path / "run", hooks=[hook])


def test_a_detector_on_stored_scans_needs_no_world(shadowed, monkeypatch):
    """The same samples as in shadow: their digest."""

    def refuse(*args, **options):
        raise AssertionError("a world is built")

    monkeypatch.setattr("swath.runtime.assembly.build_field", refuse)
    for name, sets in (("same", {}), ("otsu", {"combine.edge": "otsu"})):
        edges, digest = swath.detect(shadowed.folder, sets=sets), Digest()
        period = 40_000_000
        for number, edge in enumerate(edges):
            digest("combine.edge", number * period, {"edge": edge})
        assert digest.hex == shadowed.summary["shadow"][name]["digest"]
    assert same(swath.detect(shadowed.folder), told(shadowed.folder))
    with pytest.raises(InputError, match="expected a part of control"):
        swath.detect(shadowed.folder, slot="lidar")


def told(folder):
    """What the detector at the wheel sent, after its reset."""
    topic = exact_topic("combine.edge", "edge")
    return [sample for _, sample in exact_samples(open_log(folder).messages((topic,)))]


def same(detected, recorded):
    return len(recorded) > 10 and [repr(e) for e in detected] == [repr(e) for e in recorded]


OWN = '''
from swath.core.component import Port
from swath.signals import CropEdge, Odometry, Scan, SteerCommand

class LooksAtLaterSlots:
    """Where a command of steering, which comes after it in a tick, is found, and what the terminal says."""
    inputs = (Port("command", SteerCommand), Port("odometry", Odometry))
    outputs = (Port("edge", CropEdge),)

    def __init__(self, params, setup):
        self.setup = setup

    def reset(self, stream):
        return {"edge": self.edge(0, -1.0)}

    def step(self, t, dt, inputs):
        return {"edge": self.edge(t + dt, (t + dt - inputs["command"].t) * 1e-9)}

    def edge(self, t, age):
        return CropEdge(t, age, 0.0, 0.0, 5.0, 0.5, self.setup.crop_height, self.setup.row_spacing)

    def save(self):
        return None

    def load(self, state):
        pass
'''


@pytest.mark.usefixtures("code_allowed")
def test_a_part_on_stored_samples_sees_of_a_tick_what_it_saw_in_the_run(tmp_path):
    """Of slots that come later in it nothing; and the terminal's crop, here in rows."""
    (tmp_path / "own.py").write_text(OWN, encoding="utf-8")
    edge = f"combine.edge={{level: '{tmp_path}/own.py:LooksAtLaterSlots', wires: {{command: steer.command}}}}"
    sets = (
        edge,
        "run.distance_m=2",
        "field.stand.crop=soy",
        "field.stand.stems_per_m2=40",
        "field.obstacles=[]",
    )
    done = run_job(small("combine.lidar=off", *sets), tmp_path / "run")
    recorded = told(done.folder)
    assert same(swath.detect(done.folder, code=True), recorded)
    assert recorded[-1].stubble_height > 0.3  # of rows
    assert len({e.offset for e in recorded[5:]}) == 1
    assert recorded[-1].offset > 0.0  # the command of the tick before


def test_tracks_hold_how_sure_an_edge_is_and_the_crop(shadowed):
    tracks = read_tracks(shadowed.folder / "tracks.parquet")
    last = told(shadowed.folder)[-1]
    assert tracks["edge_offset_sd_m"][-1] == pytest.approx(last.offset_sd, rel=1e-6)
    assert tracks["edge_crop_height_m"][-1] == pytest.approx(last.crop_height, rel=1e-6)


def test_the_five_lines_of_the_page_run(shadowed, capsys):
    text = (ROOT / "docs" / "how-to" / "function-tests.md").read_text(encoding="utf-8")
    lines = text.partition("```py\n")[2].partition("```")[0]
    own = f"{ROOT / 'examples' / 'my_edge_detector.py'}:MyEdgeDetector"
    lines = lines.replace("runs/tuesday", str(shadowed.folder)).replace("my_detector.py:MyEdgeDetector", own)
    exec(compile(lines, "function-tests.md", "exec"), {})
    assert capsys.readouterr().out.count(f" of {len(swath.detect(shadowed.folder))}\n") == 2


CASE = """
format: swath test case 1
objective: detects
source: estimated
scenario: straight
set:
  run: {distance_m: 12, record: none}
  combine.lidar: {level: empirical, step_deg: 2, sector_deg: [-40, 40]}
seeds: 1
expect: {edge_rmse_m: {max: 0.2}, lateral_rms_m: {max: 0.2}}
"""


def test_candidates_in_shadow_are_judged_by_limits_on_detection(tmp_path):
    (tmp_path / "detects.yaml").write_text(CASE, encoding="utf-8")
    candidates = {"wheel": (), "far": ("combine.edge.fault={bias: {offset_cm: 50}}",)}
    plan = Plan(str(tmp_path / "detects.yaml"), candidates=candidates, shadow=True)
    (run,) = plan.runs()
    assert run.candidate == "wheel"
    begin(tmp_path / "out", plan)
    assert [found.id for found in open_session(tmp_path / "out").plan.runs()] == [run.id]
    result = json.loads(json.dumps(do_run(run, KeptFields())))
    (shadow,) = in_shadow(result, run.shadows)
    assert (result["verdict"], shadow["verdict"]) == ("pass", "fail")
    assert [entry["name"] for entry in shadow["expect"]] == ["edge_rmse_m"]
    assert shadow["candidate"] == "far"
    assert shadow["id"] == f"{result['id']}-far"
