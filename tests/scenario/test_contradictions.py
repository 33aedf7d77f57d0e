"""Changes that contradict each other are refused, in whatever order and however they are written."""

import itertools
import json

import pytest

import swath
from swath.commands.main import main
from swath.core.errors import InputError
from swath.scenario.overrides import layered
from swath.scenario.scenario import load_scenario
from swath.tools.function_test.case import read_case
from swath.tools.function_test.plan import Plan

REPLAY = "combine.lidar={level: replay, folder: somewhere}"
PAIRS = [
    ("combine.lidar.level=empirical", REPLAY),
    ("combine.lidar.level=empirical", "combine.lidar=plants"),
    ("combine.lidar=off", "combine.lidar.rate_hz=10"),
    ("combine.lidar.rate_hz=10", "combine.lidar.rate_hz=20"),
    ("combine.lidar={level: empirical, rate_hz: 10}", "combine.lidar.rate_hz=20"),
    ("combine.lidar.mount={z_m: 2}", "combine.lidar.mount.z_m=3"),
    ("combine.lidar={mount: {z_m: 2, x_m: 1}}", "combine.lidar.mount.z_m=3"),
    ("combine.lidar={rate_hz: 10}", "combine.lidar={level: plants}"),
    ("run.distance_m=5", "run={distance_m: 6}"),
    ("seed=2", "seed=3"),
    ("field.edge.teeth=[]", "field.edge={shape: straight, teeth: [{x_m: 1}]}"),
    ("machines.combine.lidar.rate_hz=10", "combine.lidar.rate_hz=11"),
]
AGREED = [
    ("combine.lidar.level=empirical", "combine.lidar={level: empirical, rate_hz: 10}"),
    ("combine.lidar=empirical", "combine.lidar.rate_hz=10"),
    ("combine.lidar=empirical", "combine.lidar.level=empirical"),
    ("combine.lidar.rate_hz=10", "combine.lidar.rate_hz=10.0"),
    ("combine.lidar.mount={z_m: 2}", "combine.lidar.mount.x_m=0.5"),
    ("run.distance_m=5", "run.max_duration_s=6"),
]


@pytest.mark.parametrize("pair", PAIRS, ids=lambda p: p[0])
def test_in_either_order(pair):
    for first, second in itertools.permutations(pair):
        with pytest.raises(InputError) as caught:
            load_scenario("straight", sets=[first, "run.record=none", second])
        assert "contradicts --set " in caught.value.expected
        assert first in caught.value.expected
        assert second in caught.value.key


@pytest.mark.parametrize("pair", AGREED, ids=lambda p: p[0])
def test_what_agrees_gives_the_same_in_either_order(pair):
    one, other = (load_scenario("straight", sets=list(p)) for p in itertools.permutations(pair))
    assert one == other


def test_on_the_command_line_and_from_python(tmp_path, capsys):
    words = ["--set", "combine.lidar.level=empirical", "--set", REPLAY, "--out", str(tmp_path / "r")]
    assert main(["run", "straight", *words]) == 2
    assert "contradicts" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()
    assert main(["run", "straight", "--seed", "3", "--set", "seed=4", "--out", str(tmp_path / "r")]) == 2
    assert "--seed 3: expected one of the two, it contradicts --set seed=4" in capsys.readouterr().err
    with pytest.raises(InputError, match="contradicts"):
        swath.load_scenario("straight", sets={"combine.lidar": {"rate_hz": 5}, "combine.lidar.rate_hz": 6})


def test_a_later_layer_counts_where_they_contradict():
    case = ["combine.lidar={level: empirical, rate_hz: 10}", "run.distance_m=5", "combine.edge.level=joined"]
    user = ["combine.lidar.rate_hz=20", "run={max_duration_s: 9}", "combine.edge=otsu"]
    assert layered(case, user) == [
        f"combine.lidar={json.dumps({'level': 'empirical', 'rate_hz': 20})}",
        "run.distance_m=5",
        *user,
    ]
    scenario = load_scenario("straight", sets=layered(case, user))
    lidar = scenario.machines["combine"].slots["lidar"]
    assert (lidar.level, lidar.common.rate_hz, scenario.run.distance_m) == ("empirical", 20, 5)


CASE = """
format: swath test case 1
objective: the mounting's height
scenario: straight
{set}
vary: {{height: {{key: combine.lidar.mount.z_m, at: [2, 3]}}}}
expect: {{lateral_rms_m: {{max: 1}}}}
tags: [clean]
source: made up
"""


def case_file(folder, text=""):
    (folder / "case.yaml").write_text(CASE.format(set=text))
    return folder / "case.yaml"


@pytest.mark.parametrize(
    "text", ["{combine.lidar.mount.z_m: 4}", "{combine.lidar: {mount: {z_m: 4, x_m: 1}}}"]
)
def test_a_case_varies_what_it_sets(tmp_path, text):
    case = read_case(case_file(tmp_path, f"set: {text}"))
    for height in (2, 3):
        scenario = load_scenario("straight", sets=case.sets({"height": height}))
        mount = scenario.machines["combine"].slots["lidar"].params.mount
        assert (mount.z_m, mount.x_m) == (height, 1 if "x_m" in text else 0)


def test_in_a_list():
    sets = layered(["field.edge.gaps=[{start_m: 3, end_m: 4, depth_m: 1}]"], ["field.edge.gaps.0.end_m=5"])
    (gap,) = load_scenario("straight", sets=sets).plain()["field"]["edge"]["gaps"]
    assert (gap["start_m"], gap["end_m"]) == (3, 5)


@pytest.mark.parametrize("where", ["sets", "candidates"])
@pytest.mark.parametrize(
    "change", ["combine.lidar.mount.z_m=4", "combine.lidar={mount: {z_m: 4}}", "combine.lidar=off"]
)
def test_a_change_of_what_a_case_varies_is_refused(tmp_path, where, change):
    keys = {"sets": (change,)} if where == "sets" else {"candidates": {"mine": (change,)}}
    plan = Plan(str(case_file(tmp_path)), **keys)
    with pytest.raises(InputError, match=r"expected another key, case varies combine.lidar.mount.z_m"):
        plan.check()
    Plan(str(case_file(tmp_path)), sets=("combine.lidar={level: empirical, rate_hz: 10}",)).check()
