"""`examples/nav2`: a node in the place of Nav2's controller drives the machine along its plan."""

import runpy

import numpy as np
import pyarrow.parquet as pq
import pytest
from ruamel.yaml import YAML

from swath.commands.main import main
from tests.link.ros2_rig import EXAMPLES, domain, needs_ros2, node  # noqa: F401

pytestmark = needs_ros2
NAV2 = EXAMPLES.parent / "nav2"


@pytest.mark.usefixtures("domain")
def test_the_machine_drives_the_plan(tmp_path):
    out = tmp_path / "run"
    with node(NAV2 / "controller_node.py"):
        words = ["run", str(NAV2 / "field.yaml"), "--ros2", "--real-time", "--out", str(out), "--quiet"]
        for key in ("run.max_duration_s=12", "combine.lidar=off", "realtime.spin_ms=0"):
            words += ["--set", key]
        assert main([*words, "--no-replay", "--no-report"]) == 0
    way = runpy.run_path(str(NAV2 / "controller_node.py"))["way"]
    tracks = pq.read_table(out / "tracks.parquet").to_pydict()
    x, y = np.array(tracks["x_m"]), np.array(tracks["y_m"])
    off = x - [way(v)[0] for v in y]
    assert y.max() > 8.0
    assert np.abs(off).max() < 0.4
    assert np.ptp(x) > 0.3  # and there is something to follow


def test_the_names_of_the_parameters_are_topics_and_frames_of_the_run(tmp_path):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    out = tmp_path / "run"
    scenario = (NAV2 / "field.yaml").read_text(encoding="utf-8")
    plain = tmp_path / "field.yaml"
    plain.write_text(scenario.replace("level: twist, topic: /cmd_vel, hold_s: 1.0", "level: constant"))
    words = ["--set", "run.max_duration_s=0.5", "--out", str(out), "--quiet", "--no-replay", "--no-report"]
    assert main(["run", str(plain), *words]) == 0
    with (out / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        topics = {c.topic for c in reader.get_summary().channels.values()}
        sent = [m for *_, m in reader.iter_decoded_messages(topics=["/tf", "/tf_static"])]
    frames = {f for m in sent for t in m.transforms for f in (t.header.frame_id, t.child_frame_id)}
    read = YAML(typ="safe").load((NAV2 / "nav2_params.yaml").read_text(encoding="utf-8"))
    own = read["local_costmap"]["local_costmap"]["ros__parameters"]
    used = {
        read["controller_server"]["ros__parameters"]["odom_topic"],
        own["obstacle_layer"]["scan"]["topic"],
    }
    assert used <= topics
    scan = own["obstacle_layer"]["scan"]["sensor_frame"]
    assert {own["global_frame"], own["robot_base_frame"], scan, "map"} <= frames
