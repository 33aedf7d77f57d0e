"""A machine whose shape is a URDF: its own sensors see it, its header moves, others touch it."""

from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from swath.core.errors import InputError
from swath.machine.machine_sheet import load_machine
from swath.replay.writer import ReplayWriter
from swath.report.field_plot import silhouette
from swath.runtime.assembly import assemble
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario, parse_scenario
from swath.signals import HeaderState
from tests.replay.page_data import data_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "machine" / "scenario.yaml"
URDF = """<robot name='m'>
  <link name='base'><visual><origin xyz='0 0 2'/><geometry><box size='2 2 1'/></geometry></visual></link>
  <link name='header'>
    <visual><origin xyz='4 0 0.3'/><geometry><box size='2 6 0.2'/></geometry></visual></link>
  <joint name='j'><parent link='base'/><child link='header'/></joint></robot>"""
TEXT = """
format: swath scenario 2
name: own-body
run: {{distance_m: 5, max_duration_s: 2}}
field: {{edge: {{shape: straight}}, stand: {{level: uniform, crop: wheat, stems_per_m2: 100}}}}
machines:
  combine:
    {body}
    motion: {{level: kinematic, start_speed_kmh: 0}}
    steer: constant
    edge: off
    speed: {{speed_kmh: 0}}
    lidar:
      {{level: plants, sensor: velodyne-vlp16, rate_hz: 10, sub_rays: 1, sector_deg: [-10, 10],
       mount: {{at: axle, x_m: 2, y_m: 0, z_m: 4, pitch_deg: 50}}}}
{more}
"""
OTHER = "  other: {{machine: tractor-grain-cart, start: {{x_m: {x}, y_m: {y}, heading_deg: 90}}}}"


@pytest.fixture
def body(tmp_path):
    file = tmp_path / "m.urdf"
    file.write_text(URDF)
    return f"body: {{file: {file}}}"


def world_of(body, more=""):
    return assemble(parse_scenario(TEXT.format(body=body, more=more)))


def seen(world):
    """Echoes of the scanner in the machine frame, (n, 3) [m], after 0.2 s."""
    world.reset()
    world.graph.run(200_000_000)
    points = world.graph.latest("combine.lidar", "truth").points.reshape(-1, 3)
    return world.bodies.pose_of("combine").inverse().apply(points[np.isfinite(points[:, 0])])


def test_its_own_scanner_sees_the_header_where_it_is(body):
    points = seen(world_of(body))
    on_header = np.abs(points[:, 0] - 4.0) < 0.9
    assert on_header.sum() > 50
    heights = points[on_header, 2]  # crop that stands over the header is above it
    assert heights.min() > 0.4 - 1e-4
    assert np.mean(np.abs(heights - 0.4) < 1e-4) > 0.7


def test_without_a_file_it_looks_through_itself():
    points = seen(world_of("header_width_m: 6"))
    assert np.abs(points[np.abs(points[:, 0] - 4.0) < 0.9, 2] - 0.4).max() > 0.1


def test_the_header_is_lifted_about_the_feeder(body):
    world = world_of(body)
    world.reset()
    masses = load_machine("lexion-700-class").masses
    lift, zero = 0.12, np.zeros(3)
    state = HeaderState(0, zero, zero, 0.15, 0.05, lift, 0.0, 0.0)
    world.place_bodies("combine.header", 0, {"height": state})
    start = world.bodies.pose_of("combine").inverse()
    centre = start.apply(world.bodies.others("combine").mesh_centre)
    x, z = 4.0 - masses.feeder_x, 0.3 - masses.feeder_z
    expected = [
        masses.feeder_x + x * cos(lift) - z * sin(lift),
        0.0,
        masses.feeder_z + x * sin(lift) + z * cos(lift),
    ]
    np.testing.assert_allclose(centre, [[0, 0, 2], expected], atol=1e-9)
    world.reset()
    centre = start.apply(world.bodies.others("combine").mesh_centre)
    np.testing.assert_allclose(centre[1], [4.0, 0.0, 0.3], atol=1e-9)


def test_another_machine_touches_the_shape_not_the_boxes_of_the_data_sheet(body):
    where = world_of("header_width_m: 6").machines["combine"].start.apply([-4.5, 0.0, 0.0])
    behind = OTHER.format(x=where[0], y=where[1])
    world_of(body, behind)  # the data sheet's chassis reaches there, the file's does not
    with pytest.raises(InputError, match="it overlaps"):
        world_of("header_width_m: 6", behind)


def test_a_saved_world_shows_the_header_as_it_was():
    scenario = load_scenario(EXAMPLE, sets=["combine.lidar_edge=off", "combine.edge=truth"])
    world = assemble(scenario)
    world.reset()
    world.graph.observers = [world.place_bodies]
    world.graph.run(1_000_000_000)
    state, before = world.save(), world.bodies.others("combine").mesh_centre
    again = assemble(scenario)
    again.reset()
    again.load(state)
    np.testing.assert_array_equal(again.bodies.others("combine").mesh_centre, before)
    level = again.machines["combine"].body.level.mesh_centre
    assert np.abs(again.machines["combine"].start.apply(level)[:, 2] - before[:, 2]).max() > 1e-4


def test_the_example_records_its_body_for_viewers(tmp_path):
    sets = ["run.max_duration_s=0.4", "combine.lidar_edge.sub_rays=1", "run.distance_m=1"]
    run_job(load_scenario(EXAMPLE, sets=sets), tmp_path / "run")
    with (tmp_path / "run" / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        topics = reader.iter_decoded_messages(topics=["/combine/body_markers"])
        (marker,) = next(m for *_, m in topics).markers
    assert marker.header.frame_id == "combine/base_link"
    assert len(marker.points) == 3 * (12 * 6 + 5 * 4 * 24)
    assert max(p.x for p in marker.points) == pytest.approx(4.0)


def test_replay_and_report_draw_its_own_shape(body, tmp_path):
    scenario = parse_scenario(TEXT.format(body=body, more=OTHER.format(x=30, y=30)))
    run_job(scenario, tmp_path / "run", hooks=[ReplayWriter()])
    about, arrays = data_of(tmp_path / "run" / "replay.html")
    corners = {name: arrays[f"own_{name}_0"].reshape(-1, 3) for name in ("body", "header")}
    assert corners["body"].min(axis=0) == pytest.approx([-1, -1, 1.5])
    assert corners["body"].max(axis=0) == pytest.approx([1, 1, 2.5])
    assert corners["header"].max(axis=0) == pytest.approx([5, 3, 0.4])
    kinematics = world_of(body).leader.header_kinematics
    assert about["machines"][0]["header_axes"] == list(kinematics.axes)
    assert "header_axes" not in about["machines"][1]
    assert "own_body_1" not in arrays


def test_the_outline_of_a_shape_is_that_from_above(body):
    outline = silhouette(world_of(body).leader.body.triangles)
    x, y = outline.T
    area = 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))
    bridge = 2.0 * (2.0 + 6.0) / 2.0  # between body and header
    assert area == pytest.approx(2 * 2 + 2 * 6 + bridge, rel=0.03)
    assert (x.min(), x.max(), y.min(), y.max()) == pytest.approx((-1, 5, -3, 3))
