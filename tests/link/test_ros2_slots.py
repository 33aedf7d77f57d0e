"""Slots other than steering, free nodes, and what is said when an answer cannot be used."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from swath.core.component import Port
from swath.core.errors import SwathError
from swath.core.random import Stream
from swath.runtime.assembly import assemble
from swath.runtime.job import run_job
from swath.scenario.scenario import parse_scenario
from swath.signals import CropEdge, Scan, SteerCommand
from swath.signals.setup import ControlSetup, LinkSetup
from tests.fake_run import GEOMETRY, MOUNTING
from tests.link.ros2_rig import HERE, domain, needs_ros2, node  # noqa: F401
from tests.waiting import PATIENCE_S, until

pytestmark = [*needs_ros2, pytest.mark.usefixtures("domain")]

TEXT = """
format: swath scenario 2
name: slots
run: {{distance_m: 100, max_duration_s: {seconds}}}
field: {{edge: {{shape: straight}}}}
machines:
  combine:
    motion: {{level: kinematic, start_speed_kmh: 7}}
    lidar: off
    edge: truth
    {part}
"""
PATIENT = f"{{level: ros2, timeout_s: {PATIENCE_S}, start_timeout_s: {PATIENCE_S}}}"
MASSES = ("tank_grain", "lost_grain", "dropped_straw", "held_grain", "held_straw", "grain_flow", "straw_flow")
LOAD = {f"load.{name}": 0.25 * i for i, name in enumerate(MASSES)}
STEER = {"command.curvature": 1 / 64, "command.is_engaged": 1}


def scenario(part, seconds=1.0):
    return parse_scenario(TEXT.format(part=part, seconds=seconds))


def fixed(slot, *numbers, name="fixed"):
    return node(HERE / "ros2_fixed_node.py", name, f"/combine/{slot}", json.dumps(numbers))


def test_a_node_plays_the_process(tmp_path):
    with fixed("process", LOAD):
        world = assemble(scenario(f"process: {PATIENT}"))
        try:
            world.graph.reset()
            world.graph.run(1_000_000_000)
        finally:
            world.close()
    load = world.graph.latest("combine.process", "load")
    assert (load.t, load.lost_grain, load.straw_flow) == (1_000_000_000, 0.25, 1.5)
    assert load.tank_level == 0.0


def test_a_node_plays_the_scanner(tmp_path):
    with node(HERE / "ros2_scan_node.py"):
        scanned = parse_scenario(
            TEXT.replace("lidar: off", f"lidar: {{{PATIENT}}}").format(part="steer: preview", seconds=1),
            sets=["run.record=full"],
        )
        found = run_job(scanned, tmp_path / "run").summary
    assert found["cost"]["combine.lidar"]["steps"] == 25
    with (tmp_path / "run" / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        clouds = [m for *_, m in reader.iter_decoded_messages(topics=["/combine/lidar/scan_points"])]
    assert [cloud.width for cloud in clouds] == [0] + [41] * 25
    x, y, z = np.frombuffer(bytes(clouds[-1].data), np.uint8).reshape(41, -1)[:, :12].copy().view("<f4").T
    ranges = np.sqrt(x**2 + y**2 + z**2)
    assert ranges == pytest.approx(3.0 + found["distance_m"], abs=1e-5)


def test_a_free_node_answers_when_it_can_and_the_run_says_so(tmp_path):
    with fixed("steer", STEER):
        found = run_job(
            scenario("steer: {level: ros2, mode: free, start_timeout_s: 300}\nrealtime: {on_overrun: slip}"),
            tmp_path / "run",
        ).summary
    assert found["simulated_s"] == 1.0
    (note,) = [n for n in found["notes"] if "free mode" in n]
    assert note.startswith("combine: steer: a node in free mode, the result depends on the wall clock")
    stale = re.search(r"; (\d+) of 50 steps ran without a new answer$", note)
    assert 0 <= int(stale[1]) < 50


@pytest.fixture
def steer():
    """The slot alone, without a world."""
    from swath.link.levels.ros2 import Params, Ros2Slot

    inputs = (Port("edge", CropEdge, optional=True),)
    control = ControlSetup(GEOMETRY, {"scan": MOUNTING}, "left", 0.02)
    outputs = (Port("command", SteerCommand),)
    patient = Params(timeout_s=PATIENCE_S, start_timeout_s=PATIENCE_S)
    made = Ros2Slot(patient, LinkSetup("combine", "steer", inputs, outputs, control, Path()))
    yield made
    made.close()


UNUSABLE = [  # numbers of an answer, what is said of them
    ({"command.curvature": 0.1}, "command: SteerCommand: expected a value for is_engaged"),
    ({**STEER, "command.angle": 1}, "command: variable = angle: expected one of curvature, is_engaged"),
    ({"curvature": 0.1}, "curvature: expected a name that starts with command."),
    ({}, "expected names that start with command."),
]


def test_an_answer_that_cannot_be_used_names_the_node_and_what_is_wrong(steer):
    with fixed("steer", *(numbers for numbers, _ in UNUSABLE), name="careless"):
        for _, words in UNUSABLE:
            with pytest.raises(SwathError) as caught:
                steer.reset(Stream(1, "combine.steer"))
            assert str(caught.value).startswith("combine.steer: the answer of /careless for 0 s: ")
            assert words in str(caught.value)


def test_a_scan_carries_the_frame_of_its_own_sensor():
    from rclpy.executors import SingleThreadedExecutor

    from swath.link.ros2.middleware import close_node, latched_qos, open_node, type_of
    from swath.link.ros2.slotnode import SlotNode

    control = ControlSetup(GEOMETRY, {"scan": MOUNTING}, "left", 0.02)
    inputs, outputs = (Port("scan", Scan, optional=True),), (Port("edge", CropEdge),)
    fed = {"scan": "combine.lidar_left"}
    slot = SlotNode(LinkSetup("combine", "edge", inputs, outputs, control, Path(), fed), inputs, outputs)
    listener, frames = open_node("listener", "a test"), []
    cloud = type_of("sensor_msgs/msg/PointCloud2")
    topic = f"{slot.step_topic}/scan"
    listener.create_subscription(cloud, topic, lambda m: frames.append(m.header.frame_id), latched_qos())
    executor = SingleThreadedExecutor(context=listener.context)
    executor.add_node(listener)
    beams, echoes = np.zeros(3), np.ones((3, 1), np.float32)
    slot.ask(0, 0, {"scan": Scan(0, beams, beams, beams, echoes, echoes)})
    until(lambda: executor.spin_once(timeout_sec=0.1) or frames, "the scan")
    executor.shutdown()
    close_node(listener)
    slot.close()
    assert frames == ["combine/lidar_left"]


def test_two_nodes_that_would_answer_are_refused(steer):
    with fixed("steer", STEER, name="one"), fixed("steer", STEER, name="other"):
        ours = steer._node
        until(lambda: ours._node.count_publishers(ours.answer_topic) == 2, "both are found")
        with pytest.raises(SwathError, match=r"expected one node .* there are /one, /other"):
            steer.reset(Stream(1, "combine.steer"))


def test_the_state_of_a_node_is_its_own(steer):
    with pytest.raises(SwathError, match=r"combine\.steer: .* cannot be saved"):
        steer.save()
    steer.close()
    with pytest.raises(SwathError, match=r"combine\.steer: the node is closed"):
        steer.step(0, 20_000_000, {})


def test_who_is_waited_for_is_said_before_the_wait_ends(domain, caplog, monkeypatch):  # noqa: F811
    from swath.link.levels.ros2 import Params, Ros2Slot
    from swath.link.ros2 import slotnode

    monkeypatch.setattr(slotnode, "PATIENCE_S", 0.1)
    control = ControlSetup(GEOMETRY, {"scan": MOUNTING}, "left", 0.02)
    outputs = (Port("command", SteerCommand),)
    made = Ros2Slot(Params(start_timeout_s=0.4), LinkSetup("combine", "steer", (), outputs, control, Path()))
    with pytest.raises(SwathError, match=r"combine\.steer: no node listens on /combine/steer/step"):
        made.reset(Stream(1, "combine.steer"))
    made.close()
    (told,) = [r.getMessage() for r in caplog.records if "yet" in r.getMessage()]
    assert told.startswith("swath: combine.steer: no node listens on /combine/steer/step yet, waiting")
