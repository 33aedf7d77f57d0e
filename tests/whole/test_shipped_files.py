"""Everything that swath comes with runs: bundled scenarios and data sheets, and the files of `examples`."""

import importlib.util
import re
from pathlib import Path

import pytest

import swath
from swath.documents.data_sheets import KINDS, sheet_names
from swath.documents.yaml_document import read_document
from swath.field.crop_sheet import load_crop
from swath.field.solid.obstacles import load_obstacle
from swath.machine.machine_sheet import load_machine
from swath.scenario.overrides import layered
from swath.scenario.scenario import load_scenario, scenario_names
from swath.sensing.camera.camera_sheet import load_camera
from swath.sensing.ground_speed.radar import load_ground_radar
from swath.sensing.lidar_sheet import load_lidar
from swath.sensing.radar.radar_sheet import load_radar
from swath.sensing.tables import load_table, table_names

pytestmark = pytest.mark.usefixtures("code_allowed")

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
NEEDS = {"can/hil": "cantools", "can/sil": "cantools", "meshes/field": "trimesh"}  # beyond the plain install
OVERRIDES = {  # the controller box, of another process, inside the run; less field to build
    "can/hil": [
        "realtime.pace=free",
        "combine.steer.interface=virtual",
        "combine.steer.box=inside",
        "combine.steer.lock_step=true",
    ],
    "meshes/field": ["field.edge.length_m=30"],
    "nav2/field": ["combine.speed=constant", "combine.steer=constant"],  # with its node: test_nav2_example.py
}


def is_scenario(file):
    return read_document(file).data.get("format", "").startswith("swath scenario")


ELSEWHERE = ("devices/wire",)  # a box in another process: tests/link/test_device_loop.py
FILES = [
    str(p.relative_to(EXAMPLES).with_suffix("")) for p in sorted(EXAMPLES.rglob("*.yaml")) if is_scenario(p)
]
FILES = [name for name in FILES if name not in ELSEWHERE]


def few(scenario):
    """Overrides that make its run short: 0.6 m, a ray for every second degree."""
    sets = ["run.distance_m=0.6", "run.record=standard"]
    for name, machine in scenario.machines.items():
        sets.append(f"{name}.motion.start_speed_kmh=6")
        for slot, choice in machine.slots.items():
            if choice.kind.name == "lidar":
                sets.append(f"{name}.{slot}.step_deg=2")
                sets += [f"{name}.{slot}.sub_rays=1"] if choice.level == "plants" else []
    return sets


def run_short(source, folder, *sets):
    sets = layered(few(load_scenario(source)), sets)
    summary = swath.run(source, folder, sets=sets, report=False).summary
    assert not summary["incomplete"]
    assert summary["digest"]
    for metrics in summary.get("machines", {"": summary}).values():
        assert metrics["distance_m"] >= 0.5
    return summary


def test_all_are_found():
    assert len(scenario_names()) >= 8
    assert set(FILES) >= {"can/mil", "can/sil", "can/hil", "meshes/field"}


@pytest.mark.parametrize("name", scenario_names())
def test_a_bundled_scenario_runs(name, tmp_path):
    run_short(name, tmp_path / "run")


@pytest.mark.parametrize("name", FILES)
def test_a_scenario_of_the_examples_runs(name, tmp_path):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    run_short(EXAMPLES / f"{name}.yaml", tmp_path / "run", *OVERRIDES.get(name, []))


@pytest.mark.parametrize("kind", KINDS)
def test_every_bundled_sheet_is_read(kind):
    load = {
        "sensors": load_sensor,
        "machines": load_machine,
        "crops": load_crop,
        "obstacles": load_obstacle,
    }[kind]
    for name in sheet_names(kind):
        assert load(name).name


def load_sensor(name):
    if name.startswith("camera-"):
        return load_camera(name)
    radars = {"ground-radar": load_ground_radar, "radar": load_radar}
    return radars.get(name.partition("-24ghz")[0].partition("-77ghz")[0], load_lidar)(name)


def test_every_bundled_table_is_read():
    assert len(table_names()) >= 5
    for name in table_names():
        load_table(name)


def test_own_levels_and_evaluators_of_the_examples_run(tmp_path):
    summary = run_short(
        "straight",
        tmp_path / "run",
        f"combine.edge.level={EXAMPLES}/my_edge_detector.py:MyEdgeDetector",
        f"combine.steer.level={EXAMPLES}/my_steering_law.py:MySteeringLaw",
        f"evaluators=[{EXAMPLES}/my_evaluator.py:SteeringReversals]",
    )
    assert "steering_reversals_per_100_m" in summary


def test_the_example_that_joins_two_scanners_runs(tmp_path):
    cheap = [
        f"combine.lidar_{side}.{key}" for side in ("left", "right") for key in ("sub_rays=3", "step_deg=1")
    ]
    level = f"combine.edge.level={EXAMPLES}/two_scanners.py:TwoScanners"
    run_short("two-scanners", tmp_path / "run", level, *cheap)


@pytest.mark.parametrize(
    "file", sorted(EXAMPLES.rglob("*.py")), ids=lambda p: str(p.relative_to(EXAMPLES))
)  # fmt: skip
def test_python_files_are_imported_here_and_run_by_a_test(file):
    text = "\n".join(p.read_text() for p in (ROOT / "tests").rglob("test_*.py"))
    assert re.search(rf"\b{file.stem}\b", text)
    spec = importlib.util.spec_from_file_location(f"example_{file.stem}", file)
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except ModuleNotFoundError as error:
        if error.name.partition(".")[0] == "swath":
            raise
        pytest.skip(f"needs {error.name}")
