"""`swath migrate` on the scenarios, data sheets and Python files of version 0.1, which lie in `v01`."""

import importlib.util
import re
import shutil
from pathlib import Path

import pytest

import swath
from swath.commands.main import main
from swath.core.errors import InputError, SwathError
from swath.core.registry import Registry
from swath.core.renamed import GONE, MODULES, NAMES, present_name, why_gone
from swath.documents.data_sheets import read_sheet, sheet_names
from swath.documents.yaml_document import parse
from swath.field.crop_sheet import load_crop
from swath.machine.machine_sheet import load_machine
from swath.scenario.migrate import migrate_scenario
from swath.scenario.scenario import find_scenario, load_scenario
from swath.sensing.lidar_sheet import load_lidar
from swath.tools.migrate.migrate import migrate_text
from swath.tools.migrate.python_names import migrate_python, missing_names

pytestmark = pytest.mark.usefixtures("code_allowed")

V01 = Path(__file__).parent / "v01"
EXAMPLES = Path(__file__).parents[2] / "examples"
SCENARIOS = sorted(p.stem for p in (V01 / "scenarios").glob("*.yaml"))
LOAD = {"sensors": load_lidar, "crops": load_crop, "machines": load_machine}
SHEETS = [(kind, p.stem) for kind in LOAD for p in sorted((V01 / kind).glob("*.yaml"))]
SHORT = {"run.distance_m": 0.5, "run.record": "standard", "combine.motion.start_speed_kmh": 7}
STAND_IN = 5  # numbers of the header that a tractor had in 0.1
FEW_RAYS = {"combine.lidar.sub_rays": 1, "combine.lidar.step_deg": 2.0}


@pytest.fixture
def old(tmp_path):
    """A copy of a file of version 0.1, by its path in `v01`."""

    def copy(name: str) -> Path:
        return Path(shutil.copy(V01 / name, tmp_path))

    return copy


def comments(text):
    return [line.partition("#")[2] for line in text.splitlines() if "#" in line]


# scenarios


LIKELIHOOD = ["combine.edge.level=max_likelihood"]
SINCE = {  # what the bundled scenarios of 0.1 had where those of today have something else
    "bend": LIKELIHOOD,
    "laser-pilot": LIKELIHOOD,
    "straight": LIKELIHOOD,
    "record-run": ["combine.powertrain.rated_power_kw=null"],
}
FITTED = {  # numbers of sheets that were fitted to measurements, or measured on drawings, since
    "tractor-grain-cart": ("trailer.length",),
    "lexion-700-class": (
        "power.",
        "engine.",
        "hydrostat.",
        "tyres.rolling_resistance",
    ),
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_migrated_scenario_is_the_bundled_one(old, name):
    file = old(f"scenarios/{name}.yaml")
    before = file.read_text()
    assert main(["migrate", str(file)]) == 0
    assert load_scenario(file) == load_scenario(name, sets=SINCE.get(name, ()))
    assert comments(file.read_text()) == comments(before)
    assert file.with_name(f"{name}.yaml.orig").read_text() == before


def test_it_runs_to_the_digest_of_the_bundled_one(old, tmp_path):
    file = old("scenarios/record-run.yaml")
    main(["migrate", str(file)])
    sets = {**SHORT, "combine.powertrain.rated_power_kw": None}
    runs = [
        swath.run(s, tmp_path / s.stem, sets=sets, report=False) for s in (file, find_scenario("record-run"))
    ]
    assert runs[0].summary["digest"] == runs[1].summary["digest"] != ""


@pytest.mark.parametrize("name", ["can/mil", "can/sil", "can/hil", "meshes/field"])
def test_a_migrated_example_is_the_example_of_today(tmp_path, name):
    folder = Path(shutil.copytree(EXAMPLES, tmp_path / "examples")) / Path(name).parent
    shutil.copytree(V01 / "examples" / Path(name).parent, folder, dirs_exist_ok=True)
    assert main(["migrate", *map(str, folder.glob("*.yaml"))]) == 0
    files = [place / f"{Path(name).name}.yaml" for place in (folder, (EXAMPLES / name).parent)]
    scenarios = [load_scenario(file) for file in files]
    mine, ours = ("".join(s.resolved().split()).replace(str(s.file.parent), "") for s in scenarios)
    assert mine == ours


DAMP = """\
field: {edge: {shape: straight}}
combine:
  process: {level: threshing, "ease": 0.8}   # a damp evening
"""


def test_keys_have_their_present_names(tmp_path):
    new = migrate_scenario(DAMP)
    (tmp_path / "mine.yaml").write_text(new)
    scenario = load_scenario(tmp_path / "mine.yaml")
    assert scenario.machines["combine"].slots["process"].params.threshability == 0.8
    assert '"threshability": 0.8}   # a damp evening\n' in new


def test_an_own_level_keeps_its_keys():
    text = "combine:\n  process: {level: my.py:Process, ease: 1}\n"
    assert parse(migrate_scenario(text)).data["machines"]["combine"]["process"]["ease"] == 1


SEVERAL = """\
# Two machines.
# The second only drives.
field: {edge: {shape: straight}}
seed: 3

# cuts
west:
  speed: {speed_kmh: 7}
expect:
  # how straight
  lateral_p95_m:
    max: 0.2   # of the first machine
  mass_balance_error: {max: 1.0e-9}
# only drives
cart:
  machine: tractor-grain-cart
  start: {x_m: -20, y_m: 0}
"""


@pytest.mark.parametrize(
    "text",
    [SEVERAL, SEVERAL.replace(SEVERAL[SEVERAL.index("expect"):SEVERAL.index("# only")],
                              "expect: {lateral_p95_m: {max: 0.2}, mass_balance_error: {max: 1.0e-9}}\n")],
    ids=["lines", "flow"],
)  # fmt: skip
def test_limits_of_several_machines_are_those_of_the_first(tmp_path, text):
    new = migrate_scenario(text)
    (tmp_path / "two.yaml").write_text(new)
    scenario = load_scenario(tmp_path / "two.yaml")
    assert list(scenario.machines) == ["west", "cart"]
    assert {(e.subject, e.name): e.limit.max for e in scenario.expect} == {
        ("west", "lateral_p95_m"): 0.2,
        ("field", "mass_balance_error"): 1e-9,
    }
    assert comments(new)[:2] == comments(text)[:2]
    assert sorted(comments(new)) == sorted(comments(text))
    assert migrate_scenario(new) == new


def test_what_cannot_be_rewritten_line_by_line_is_refused():
    with pytest.raises(InputError, match="on a line of its own"):
        migrate_scenario("{name: a, seed: 1, combine: {}}\n")


# data sheets


@pytest.mark.parametrize(("kind", "name"), SHEETS)
def test_a_migrated_sheet_is_read_to_the_values_of_the_bundled_one(old, kind, name):
    file = old(f"{kind}/{name}.yaml")
    before = file.read_text()
    assert main(["migrate", str(file)]) == 0
    mine, ours = (
        {k: e["value"] for k, e in read_sheet(kind, s).numbers().items()} for s in (str(file), name)
    )
    same = [k for k in mine if not k.startswith(FITTED.get(name, ("-",)))]
    assert {k: ours[k] for k in same} == {k: mine[k] for k in same}  # a bundled sheet may say more by now
    assert len(mine) == len(re.findall(r"\bvalue:", before)) - (STAND_IN if "grain-cart" in name else 0)
    LOAD[kind](str(file))
    assert comments(file.read_text()) == comments(before)


def test_every_bundled_sheet_of_0_1_is_here():
    assert {n for k, n in SHEETS if k == "sensors"} <= set(sheet_names("sensors"))
    assert len(SHEETS) == 21


# Python files


def test_migrated_levels_run_as_the_examples_of_today(old, tmp_path):
    levels = {"edge": ("my_edge_detector", "MyEdgeDetector"), "steer": ("my_steering_law", "MySteeringLaw")}
    for name, _ in levels.values():
        file = old(f"examples/{name}.py")
        assert main(["migrate", str(file)]) == 0
        assert missing_names(file.read_text()) == []
    digests = []
    for folder in (tmp_path, EXAMPLES):
        own = {
            f"combine.{slot}.level": f"{folder / name}.py:{level}" for slot, (name, level) in levels.items()
        }
        run = swath.run("straight", tmp_path / folder.name, sets=SHORT | FEW_RAYS | own, report=False)
        digests.append(run.summary["digest"])
    assert digests[0] == digests[1]


def test_examples_of_today_are_up_to_date():
    files = [p for p in EXAMPLES.rglob("*") if p.suffix in (".py", ".yaml") and p.stem != "nav2_params"]
    assert len(files) > 10
    for file in files:
        text = file.read_text(encoding="utf-8")
        assert migrate_text(file, text) == text, file


# Every module of 0.1, and of those that a user's file would import from, the classes and functions.
OLD_NAMES = dict(line.split(":") for line in (V01 / "names.txt").read_text().splitlines())


def test_every_module_of_0_1_is_found_or_says_what_to_do_instead():
    for module, names in OLD_NAMES.items():
        missing = missing_names(f"import {present_name(module)}")
        gone = [text for old, text in GONE.items() if f"{module}.".startswith(f"swath.{old}.")]
        if gone:
            assert gone[0] in missing[0][1], module
            continue
        assert not missing or not names, module  # an inner module may have no successor
        for name in names.split():
            missing = missing_names(migrate_python(f"from {module} import {name}"))
            assert not missing or why_gone(f"{module}.{name}"), (module, name)
    assert [n for n in NAMES.values() if missing_names(f"import swath.{n}")] == []


def test_no_present_name_is_an_old_one():
    for name in (*MODULES.values(), *NAMES.values()):
        assert present_name(f"swath.{name}") == f"swath.{name}"


PYTHON = '''\
"""See swath.core.signals, and swath.job.run_job."""
import numpy as np; from swath.data.cards import (
    FORM,
    find_card,  # a sheet
)
import swath.core.setup as setup
from swath.core import errors, signals
if True:
    from swath.machine.card import MachineCard, load_machine  # both
from swath.core.signals import (  # kept
    Scan,  # this too
)
from swath.sim.mcap import McapFile, definition
print(swath.core.signals.Scan, my_swath.core.signals)
'''

MIGRATED = '''\
"""See swath.signals, and swath.runtime.job.run_job."""
import numpy as np; from swath.documents.data_sheets import FORM, find_sheet as find_card
import swath.signals.setup as setup
from swath.core import errors; from swath import signals
if True:
    from swath.machine.machine_sheet import MachineSheet as MachineCard, load_machine  # both
from swath.signals import (  # kept
    Scan,  # this too
)
from swath.record.mcap_file import McapFile; from swath.record.message_factory import definition
print(swath.signals.Scan, my_swath.core.signals)
'''


def test_imports_are_rewritten_in_place():
    new = migrate_python(PYTHON)
    assert new == MIGRATED.replace("errors; from", "errors\nfrom").replace("McapFile; from", "McapFile\nfrom")
    assert migrate_python(new) == new
    assert missing_names(new) == []


def test_what_is_no_more_is_said_with_its_line(tmp_path, capsys):
    file = tmp_path / "mine.py"
    file.write_text("import numpy\nfrom swath.study.converge import settle\nfrom swath.job import Judge\n")
    assert main(["migrate", str(file)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == f"{file}:2: swath.study.converge.settle is no more: " + GONE["study.converge"]
    assert lines[2] == f"{file}:3: swath.runtime.job.Judge is no more: no successor"


def test_no_python_is_refused():
    with pytest.raises(InputError, match="expected a Python file"):
        migrate_python("from swath import\n")


# the command


def test_twice_changes_nothing_and_dry_run_never_does(old, capsys):
    file = old("scenarios/bend.yaml")
    before = file.read_text()
    main(["migrate", "--dry-run", str(file)])
    assert file.read_text() == before
    main(["migrate", str(file)])
    new = file.read_text()
    main(["migrate", str(file)])
    assert file.read_text() == new
    said = [line.partition(": ")[2] for line in capsys.readouterr().out.splitlines()]
    assert said == ["would be rewritten", "rewritten", "is up to date"]


@pytest.mark.parametrize(
    "name", ["scenarios/straight.yaml", *(f"{kind}/{name}.yaml" for kind, name in SHEETS)]
)
def test_migrating_a_new_text_gives_the_same_text(name):
    new = migrate_text(V01 / name, (V01 / name).read_text())
    assert migrate_text(V01 / name, new) == new


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.yaml", "columns: {a: b}\n"),
        ("a.yaml", "- 1\n"),
        ("a.txt", ""),
        ("a.yaml", "a: [1\n"),
        ("a.py", "("),
    ],
)
def test_another_file_is_refused_and_stays(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    assert main(["migrate", str(tmp_path / name)]) == 2
    assert (tmp_path / name).read_text() == text


def test_an_old_form_is_refused_with_the_command(old):
    file = old("scenarios/straight.yaml")
    with pytest.raises(InputError, match=rf"format: .*swath migrate {file}"):
        load_scenario(file)
    with pytest.raises(InputError, match=r"format: .*swath migrate .*sick-lms111\.yaml"):
        load_lidar(str(old("sensors/sick-lms111.yaml")))
    python = old("examples/my_steering_law.py")
    registry = Registry({"steer": ["swath.control.steer"]})
    with pytest.raises(SwathError, match=r"swath\.core\.setup.*`swath migrate .* rewrites"):
        registry.get("steer", f"{python}:MySteeringLaw")


def test_another_missing_module_gives_no_such_hint(tmp_path):
    assert importlib.util.find_spec("no_such_module") is None
    (tmp_path / "mine.py").write_text("import no_such_module\n")
    with pytest.raises(SwathError) as raised:
        Registry({"steer": ["swath.control.steer"]}).get("steer", f"{tmp_path}/mine.py:A")
    assert "migrate" not in str(raised.value)
