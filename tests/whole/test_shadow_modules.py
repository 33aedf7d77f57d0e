"""A folder of a stranger holds modules with names of others: what is run there loads none of them."""

import json
import os
import subprocess
import sys
from importlib.machinery import PathFinder
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

import swath

ROOT = Path(swath.__file__).parent
SWATH = Path(sys.executable).with_name("swath")
SHADOW = """
with open({mark!r}, "a") as file:
    file.write(__name__)
raise ImportError("shadow")
"""
OWN = """
from helper import FACTOR
from swath.control.speed import constant

class Part(constant.ConstantSpeed):
    Params = constant.Params

assert FACTOR == 2
"""
CASE = """
format: swath test case 1
objective: none
source: none
scenario: straight
set:
  {run.distance_m: 0.3, combine.edge: truth, combine.lidar: "off", combine.speed: "my.py:Part"}
seeds: 2
expect:
  distance_m: {min: 0.1}
"""
ALL_IN_ONE = """
import json, sys
from swath.commands.main import main
for line in json.loads(sys.argv[1]):
    try:
        code = main(line)
    except SystemExit as stop:
        code = stop.code
    print("CODE", code, *line, flush=True)
"""
LOOKS = [
    "run straight --set run.distance_m=0.3 --out run --quiet --no-report --no-replay", "scenarios",
    "levels edge", "metrics", "sheets", "docs index", "schema",
    "completion bash", "part process --scenario straight --out part --no-such", "can dbc", "test list",
    "can listen --interface virtual --channel a --duration-s 0.01", "fleet list", "odd check wheat-harvest",
    "yield-log run --out log.csv", "osi run --out run.osi", "ros2 package --out ros",
    "scan straight --out scan --no-such", "field show run", "rerun run --out again --no-such",
    "calibrate lidar x --out cal", "compare log x run", "paper --out case.yaml",
    "reda --crop no.yaml --out reda", "lab stand --crop no.yaml --out lab", "fmu show no.fmu",
    "height-map build run --out map.npz --no-such", "branch run --at 9 --out branch",
    "dataset no.yaml --out data", "run-log run --out log.asc",
]  # fmt: skip


@pytest.fixture
def stranger(tmp_path):
    """A folder with a module for every name that this Python can import; what was loaded of it."""
    mark = tmp_path / "mark.txt"
    folder = tmp_path / "folder"
    folder.mkdir()
    names = {n for n in {*sys.stdlib_module_names, *packages_distributions(), "yaml"} if n.isidentifier()}
    for name in names - {"swath"}:
        (folder / f"{name}.py").write_text(SHADOW.format(mark=str(mark)))
    (folder / "my.py").write_text(OWN)
    (folder / "helper.py").write_text("FACTOR = 2\n")
    (folder / "case.yaml").write_text(CASE)
    return folder, mark


def run_in(folder, *words, code=0):
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONSAFEPATH")}
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=600, env=environment)
    assert done.returncode == code, done.stderr[-2000:]
    return done.stdout + done.stderr


def test_commands_load_nothing_of_the_working_folder(stranger):
    folder, mark = stranger
    lines = [line.split() for line in LOOKS]
    words = [sys.executable, "-P", "-c", ALL_IN_ONE, json.dumps(lines)]
    said = run_in(folder, *words)
    assert not mark.exists(), mark.read_text()
    assert said.count("CODE 0") > 15, said
    assert said.count("CODE ") - said.count("CODE 2 ") - said.count("CODE 0 ") - said.count("CODE 3 ") == 0, (
        said
    )


def test_workers_load_the_users_part_and_nothing_else_of_the_folder(stranger):
    """What the case names, and what that imports beside it, is loaded.

    The folder of code that may run is at the end of the path: installed packages come first. Those that are
    no more than a folder, which Python takes last, and modules that are not here could come from it.
    """
    folder, mark = stranger
    for file in folder.glob("*.py"):
        if (
            file.stem not in ("my", "helper")
            and getattr(PathFinder.find_spec(file.stem), "origin", None) is None
        ):
            file.unlink()
    words = ["test", "run", "case.yaml", "--allow-code", "--workers", "2", "--out", "out"]
    said = run_in(folder, str(SWATH), *words, code=3)  # two runs show little
    assert not mark.exists(), mark.read_text()
    assert "2 of 2 passed" in said, said


def test_settings_in_the_folder_are_not_those_of_libraries(tmp_path):
    """matplotlib would read its own (a fifo: for ever), and MuJoCo and Fast DDS write files of their own."""
    os.mkfifo(tmp_path / "matplotlibrc")
    (tmp_path / "MUJOCO_LOG.TXT").symlink_to(tmp_path / "victim")
    evil = tmp_path / "evil.log"
    for name in ("DEFAULT_FASTRTPS_PROFILES.xml", "DEFAULT_FASTDDS_PROFILES.xml"):
        (tmp_path / name).write_text(PROFILE.format(file=evil))
    run_in(tmp_path, sys.executable, "-c", LIBRARIES)
    assert not (tmp_path / "victim").exists()
    assert not evil.exists()


LIBRARIES = """
import sys
from contextlib import suppress
from swath.commands.main import main
from swath.core.errors import MissingExtra
assert main(["completion", "bash"]) == 0
assert "matplotlib" in sys.modules
with suppress(MissingExtra):
    from swath.machine.motion.multibody import _engine
    engine = _engine()
    body = "<mujoco><worldbody><body><freejoint/><geom size='1' mass='1'/></body></worldbody></mujoco>"
    model = engine.MjModel.from_xml_string(body)
    data = engine.MjData(model)
    data.qfrc_applied[:] = 1e300
    for _ in range(3):
        engine.mj_step(model, data)
with suppress(MissingExtra):
    from swath.link.ros2.middleware import close_node, networked, open_node
    with networked():
        close_node(open_node("strange", "a test"))
    close_node(open_node("strange", "a test"))
"""
PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><log><use_default>FALSE</use_default>
<consumer><class>FileConsumer</class><property><name>filename</name><value>{file}</value></property></consumer>
</log></dds>
"""
PROBE = """
import json, multiprocessing, os, sys
from swath.core.process.processes import forget_safe_path, safe_path, start_module

def told(pipe):
    forget_safe_path()
    pipe.send([sys.flags.safe_path, os.environ.get("PYTHONSAFEPATH")])

if __name__ == "__main__":
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=told, args=(theirs,))
    with safe_path():
        process.start()
    print(json.dumps([ours.recv(), os.environ.get("PYTHONSAFEPATH")]), flush=True)
    process.join()
    sys.exit(start_module("this").wait())
"""


@pytest.mark.parametrize("given", [None, "1"])
@pytest.mark.parametrize("python", ["python3.11", "python3.12", "python3.13"])
def test_a_started_python_has_no_folder_on_its_path_and_the_users_environment(python, given, request):
    """In every Python that is here: a worker, a module that is started, and what the parent has then."""
    there = subprocess.run([python, "-c", "import sys"], capture_output=True, check=False).returncode == 0
    if not there:
        pytest.skip(f"{python} is not here")
    folder, mark = request.getfixturevalue("stranger")
    probe = folder.parent / "probe.py"
    probe.write_text(PROBE)
    environment = {**os.environ, "PYTHONPATH": str(ROOT.parent)} | (
        {} if given is None else {"PYTHONSAFEPATH": given}
    )
    if given is None:
        environment.pop("PYTHONSAFEPATH", None)
    done = subprocess.run(
        [python, str(probe)], cwd=folder, env=environment, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[0]) == [[True, given], given]
    assert "Beautiful is better than ugly" in done.stdout  # the module `this` of Python, not of the folder
    assert not mark.exists(), mark.read_text()
