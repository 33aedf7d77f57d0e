"""A slot played by a node in another process, which is written only with rclpy and standard messages."""

import json
import os
import signal
import threading

import pytest
from mcap.reader import make_reader
from pyarrow.parquet import read_table

from swath.core.errors import InputError, SwathError
from swath.link.ros2.slotnode import SlotNode
from swath.runtime.assembly import assemble
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job
from swath.scenario.scenario import parse_scenario
from tests.link.ros2_rig import CHEAP, EXAMPLES, HERE, domain, needs_ros2, node  # noqa: F401
from tests.waiting import PATIENCE_S, ended, until

pytestmark = [*needs_ros2, pytest.mark.usefixtures("code_allowed")]
PATIENT = f"level: ros2, timeout_s: {PATIENCE_S}, start_timeout_s: {PATIENCE_S}"
IN_PROCESS = f"level: {HERE / 'law_level.py'}:LawInProcess"


def scenario(steer="level: ros2", seconds=60.0, sets=()):
    return parse_scenario(CHEAP.format(steer=steer, seconds=seconds), sets=sets, base=HERE)


@pytest.mark.usefixtures("domain")
def test_a_node_in_lock_step_gives_the_bytes_of_the_law_in_process(tmp_path):
    """10 m straight and 9 m of the bend."""
    steers, sets = {"node": PATIENT, "alone": IN_PROCESS}, ["field.edge.run_in_m=10"]
    with node(EXAMPLES / "steering_node.py"):
        played, alone = (
            run_job(scenario(steer, 10.0, sets), tmp_path / name).summary for name, steer in steers.items()
        )
    assert played["simulated_s"] == 10.0
    assert played["cost"]["combine.steer"]["steps"] == 500
    assert played["lateral_p95_m"] < 0.3
    assert played["digest"] == alone["digest"]


SCANNED = """
format: swath scenario 2
name: scanned
run: {{distance_m: 100, max_duration_s: 6.5}}
field: {{stand: {{level: uniform, stems_per_m2: 300}}, edge: {{shape: straight}}}}
machines:
  combine:
    motion: {{level: single_track, start_speed_kmh: 7}}
    lidar: {{sub_rays: 1, sector_deg: [-60, 60], step_deg: 2.0}}
    edge: {{{edge}}}
"""


@pytest.mark.usefixtures("domain")
def test_a_detector_as_a_node_sees_the_scan_to_the_last_bit(tmp_path):
    levels = {
        "node": f"{PATIENT}, history: [odometry]",
        "alone": f"level: {HERE / 'law_level.py'}:DetectorInProcess",
    }
    with node(EXAMPLES / "edge_detector_node.py"):
        found = {
            name: run_job(parse_scenario(SCANNED.format(edge=level)), tmp_path / name).summary
            for name, level in levels.items()
        }
    assert found["node"]["digest"] == found["alone"]["digest"]
    assert found["node"]["detection_availability"] > 0.9
    assert found["node"]["edge_rmse_m"] < 0.3


@pytest.mark.usefixtures("domain")
def test_a_killed_node_ends_the_run_with_its_name_and_a_whole_folder(tmp_path):
    with node(EXAMPLES / "steering_node.py") as process:

        def kill():
            file = tmp_path / "run" / "run.mcap"
            until(lambda: file.exists() and file.stat().st_size > 50_000, "the run goes on")
            os.kill(process.pid, signal.SIGKILL)

        killer = threading.Thread(target=kill, daemon=True)
        killer.start()
        with pytest.raises(SwathError, match="/combine/steer/answer") as caught:
            run_job(scenario("level: ros2, timeout_s: 5.0", 3600.0), tmp_path / "run")
        ended(killer)
    assert "combine.steer: no answer for" in str(caught.value)
    assert "within 5 s: the node /my_steering" in str(caught.value)
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["incomplete"] is True
    end = summary["simulated_s"]
    assert read_table(tmp_path / "run" / "tracks.parquet")["t_s"][-1].as_py() == pytest.approx(end, abs=0.03)
    with (tmp_path / "run" / "run.mcap").open("rb") as file:
        last = max(m.log_time for _, _, m in make_reader(file).iter_messages())
    assert last * 1e-9 == pytest.approx(end, abs=0.03)


@pytest.mark.usefixtures("domain")
def test_without_a_node_the_run_says_which_topic_waits():
    world = assemble(scenario("level: ros2, start_timeout_s: 0.3"))
    try:
        with pytest.raises(SwathError, match=r"combine\.steer: no node listens on /combine/steer/step"):
            world.graph.reset()
    finally:
        world.close()
        world.close()


@pytest.mark.usefixtures("domain")
def test_a_history_of_an_input_that_is_not_there_is_refused():
    with pytest.raises(
        InputError, match=r"combine\.steer\.history\.0 = scan: expected one of edge, odometry"
    ):
        assemble(scenario("level: ros2, history: [scan]"))


@pytest.mark.usefixtures("domain")
def test_a_node_is_asked_after_all_messages_up_to_then_were_sent_in_a_paced_run_too(tmp_path, monkeypatch):
    heard, asked = {}, []

    class Listener(RunHook):
        def begin(self, run):
            run.recorder.file.taps.append(lambda topic, t, *_: heard.__setitem__(topic, t))

    def ask(self, t, dt, inputs, **options):
        asked.append((t, heard.get("/combine/motion/state")))
        return whole_ask(self, t, dt, inputs, **options)

    whole_ask = SlotNode.ask
    monkeypatch.setattr(SlotNode, "ask", ask)
    paced = parse_scenario(
        CHEAP.format(steer=PATIENT, seconds=1.0) + "realtime: {factor: 2, grace_s: 0}\n", base=HERE
    )
    with node(EXAMPLES / "steering_node.py"):
        run_job(paced, tmp_path / "run", hooks=[Listener()])
    assert [t for t, _ in asked if t] == [20_000_000 * k for k in range(1, 51)]
    assert all(t == last for t, last in asked if t)
