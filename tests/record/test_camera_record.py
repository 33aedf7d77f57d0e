"""A camera in a run: what is recorded, read back by another package, and what belongs to the run's state."""

import pickle

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.frames import Pose
from swath.record.digest import Digest
from swath.record.recorder import Recorder
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from swath.signals import Image, MachineState
from swath.tools.scan.scan import scan_job

TEXT = """
format: swath scenario 2
name: filmed
seed: 3
run: {distance_m: 4, max_duration_s: 0.65}
field:
  terrain: {level: plane}
  stand: {level: uniform, stems_per_m2: 200}
  edge: {shape: straight}
machines:
  combine:
    motion: {level: single_track, start_speed_kmh: 7}
    lidar: {sub_rays: 1, sector_deg: [-40, 40], step_deg: 2.0}
    camera:
      {width_px: 60, height_px: 44, reach_m: 30, mount: {at: axle, x_m: 2, z_m: 3, yaw_deg: 30, roll_deg: 4}}
"""


def filmed(*sets):
    return assemble(parse_scenario(TEXT, sets=list(sets)))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    world, samples = filmed(), []
    with Recorder(folder, [world.leader.recorded()]) as recorder:
        drive(world, [lambda *s: samples.append(s), recorder])
    return world, read_mcap(folder / "run.mcap"), [s for _, _, o in samples for s in o.values()]


def read_mcap(path):
    """topic -> decoded messages, by the mcap project's own ROS 2 decoder."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    found = {}
    with path.open("rb") as stream:
        for _, channel, _, decoded in make_reader(
            stream, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            found.setdefault(channel.topic, []).append(decoded)
    return found


def test_images_come_back_bit_for_bit(recorded):
    _, topics, samples = recorded
    images = [s for s in samples if isinstance(s, Image)]
    assert [i.t for i in images] == [0, 200_000_000, 400_000_000, 600_000_000]
    assert not images[0].colour.any()  # before the first step it shows nothing
    assert len(np.unique(images[-1].label)) >= 4
    kinds = {
        "": ("colour", "rgb8", np.uint8),
        "_depth": ("depth", "32FC1", "<f4"),
        "_label": ("label", "mono8", np.uint8),
    }
    for suffix, (channel, encoding, kind) in kinds.items():
        messages = topics[f"/combine/camera/image{suffix}"]
        assert len(messages) == len(images)
        for message, image in zip(messages, images, strict=True):
            pixels = getattr(image, channel)
            assert (message.width, message.height, message.encoding) == (60, 44, encoding)
            assert message.step * 44 == len(message.data)
            assert message.header.frame_id == "combine/camera_optical"
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == image.t
            back = np.frombuffer(bytes(message.data), dtype=kind).reshape(pixels.shape)
            np.testing.assert_array_equal(back, pixels)
    assert not [t for t in topics if "camera/image" in t and t.endswith("_exact")]


def test_camera_info_is_the_formula_of_the_pinhole(recorded):
    world, topics, _ = recorded
    focal = 30.0 / np.tan(np.radians(35.0))
    k = [[focal, 0, 29.5], [0, focal, 21.5], [0, 0, 1]]
    for message in topics["/combine/camera/camera_info"]:
        np.testing.assert_allclose(np.reshape(message.k, (3, 3)), k, rtol=1e-12)
        np.testing.assert_allclose(np.reshape(message.p, (3, 4))[:, :3], k, rtol=1e-12)
        assert (message.width, message.height, message.distortion_model) == (60, 44, "plumb_bob")
        assert not any(message.d)
    assert world.leader.parts["camera"].pinhole.focal == pytest.approx(focal)


def test_the_optical_frame_looks_along_the_mounting(recorded):
    """x right, y down, z forward (REP 103), from the tf that viewers read."""
    world, topics, _ = recorded
    links = {f.child_frame_id: f for m in topics["/tf_static"] for f in m.transforms}
    assert {"combine/camera", "combine/camera_optical"} <= set(links)
    q = links["combine/camera_optical"].transform.rotation
    x, y, z, w = q.x, q.y, q.z, q.w
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    body = Pose.from_euler((2, 0, 3), np.radians(4), np.radians(16), np.radians(30)).rotation
    np.testing.assert_allclose(turn, np.column_stack([-body[:, 1], -body[:, 2], body[:, 0]]), atol=1e-12)
    p = links["combine/camera_optical"].transform.translation
    np.testing.assert_allclose([p.x, p.y, p.z], world.leader.mountings["camera"].position)


def test_the_picture_is_taken_where_the_machine_is_then():
    """At 7 km/h the machine drives 39 cm between two pictures: a state too old or too new shows."""
    world, matches = filmed(), []
    twin = filmed().leader.parts["camera"]
    twin.setup, twin.caster = (getattr(world.leader.parts["camera"], n) for n in ("setup", "caster"))

    def compare(slot, t, outputs):
        if slot == "combine.camera" and t > 0:
            state = world.graph.latest("combine.motion", "state")
            assert isinstance(state, MachineState)
            assert state.t == t == outputs["image"].t
            again = twin.image_from(t, state.pose @ twin.optical)
            matches.append((again.label == outputs["image"].label).mean())

    drive(world, [compare])
    assert len(matches) == 3
    assert min(matches) > 0.999  # the pose went through its angles: a ray in a thousand may graze


def digest_of(world, digest=None, **keys):
    digest = digest or Digest()
    drive(world, [digest], **keys)
    return digest.hex


def test_digest_threads_save_and_load(monkeypatch):
    whole = digest_of(filmed())
    assert digest_of(filmed("combine.camera.sun_elevation_deg=30")) != whole
    monkeypatch.setenv("SWATH_THREADS", "1")
    world, digest = filmed(), Digest()
    digest_of(world, digest, until_s=0.33)
    state = pickle.dumps({"world": world.save(), "digest": digest.save()})
    saved, second = pickle.loads(state), Digest()
    fresh = filmed()
    fresh.load(saved["world"])
    second.load(saved["digest"])
    assert digest_of(fresh, second, resume=True) == whole


def test_a_scan_with_the_camera_beside_it(tmp_path):
    from matplotlib.image import imread

    files = scan_job(parse_scenario(TEXT), tmp_path, formats=["npz"], camera=True)
    assert [f.name for f in files] == ["scan.npz", "scan.camera.png", "scan.camera.npz"]
    assert imread(tmp_path / "scan.camera.png").shape[:2] == (44, 3 * 60 + 2 * 4)
    with np.load(tmp_path / "scan.camera.npz") as kept:
        assert kept["colour"].shape == (44, 60, 3)
        assert kept["t_ns"] == 200_000_000
        assert kept["label_names"][kept["label"].max()] in ("ear", "stem", "leaf", "stubble", "straw")


def test_the_flag_gives_a_scenario_its_camera(tmp_path, monkeypatch):
    asked = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "swath.tools.scan.scan.scan_job", lambda *given, **keys: asked.append((given[0], keys)) or []
    )
    assert main(["scan", "straight", "--camera", "--seed", "4"]) == 0
    assert main(["scan", "straight", "--camera", "--set", "combine.camera.width_px=64"]) == 0
    assert main(["scan", "straight"]) == 0
    cameras = [scenario.machines["combine"].slots.get("camera") for scenario, _ in asked]
    assert [keys["camera"] for _, keys in asked] == [True, True, False]
    assert (cameras[0].level, cameras[0].params.width_px, asked[0][0].seed) == ("rays", 320, 4)
    assert cameras[1].params.width_px == 64
    assert cameras[2] is None
