"""Levels `onnx`: what a network is given, what comes of its answer, and one line for what is wrong."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from swath.control.edge import onnx as edge_level
from swath.control.edge.profile import TOLERANCE
from swath.control.network import From, Into
from swath.control.objects import onnx as objects_level
from swath.core.errors import InputError, MissingExtra
from swath.core.foreign_code import Gate, through
from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario
from swath.signals import Image, Odometry, Scan
from swath.signals.setup import ControlSetup
from tests.field.test_solids import MACHINE
from tests.networks import linear, save

pytestmark = pytest.mark.usefixtures("code_allowed")
AT = Pose.from_euler([3.0, 2.0, 2.4], pitch=0.3)
STEP = NS // 25
CAMERA = "{level: depth, width_px: 16, height_px: 12, rate_hz: 25, mount: {at: axle, x_m: 3, z_m: 3}}"
EXAMPLE = Path(__file__).parents[2] / "examples" / "my_edge_detector.py"
EDGE = {"heading": 0.0, "reference_x": 9.0, "confidence": 0.8}


def scan(t, ranges):
    n = len(ranges)
    azimuth = np.linspace(-0.5, 0.5, n)
    ranges = np.asarray(ranges, np.float32)[:, None]
    return Scan(t, np.zeros(n), azimuth, np.zeros(n), ranges, np.ones_like(ranges))


def image(t, depth):
    h, w = depth.shape
    empty = {"colour": (0, 0, 3), "label": (0, 0), "instance": (0, 0), "raw": (0, 0, 1)}
    made = {name: np.zeros(shape, np.uint8) for name, shape in empty.items()}
    return Image(t, w, h, 50.0, 0.5 * w, 0.5 * h, depth.astype(np.float32), **made, distortion=np.zeros(0))


def made(level, file, inputs, outputs, **more):
    setup = ControlSetup(MACHINE, {"scan": AT, "image": AT}, "left", 0.04)
    part = level.LEVEL.component(level.Params(file=str(file), inputs=inputs, outputs=outputs, **more), setup)
    return part, part.reset(Stream(1, "combine.part"))


def edges(part, samples, port="scan"):
    """What it says at each step."""
    return [part.step((k - 1) * STEP, STEP, {port: s})["edge"] for k, s in enumerate(samples, start=1)]


@pytest.mark.parametrize("seed", range(5))
def test_a_network_is_given_what_the_file_says(seed, tmp_path):
    """The last scans, oldest first, normalised, none where there is no echo: as the same sum in numpy."""
    r = np.random.default_rng(seed)
    n, last = int(r.integers(3, 40)), int(r.integers(1, 5))
    w, b, mean, sd, none = r.normal(size=(3, last * n)), r.normal(size=3), r.normal(5), 2.5, r.normal()
    shape = ([None, last, n, 1], ["n", last * n], [last, n], [1, n * last])[seed % 4]
    file = linear(tmp_path / "net.onnx", shape if last > 1 else [1, n], w, b)
    into = {"x": Into("scan.ranges", mean=mean, sd=sd, none=none, last=last)}
    outputs = {**EDGE, "offset": From("y", 1, scale=0.1, add=0.5), "offset_sd": From("y", 2, law="exp")}
    part, first = made(edge_level, file, into, outputs)
    assert not first["edge"].is_found
    ranges = r.uniform(1, 20, (6, n))
    ranges[r.uniform(size=ranges.shape) < 0.2] = np.nan
    got = edges(part, [scan(k * STEP, row) for k, row in enumerate(ranges, start=1)])
    fed = np.where(np.isnan(ranges.astype(np.float32)), none, (ranges.astype(np.float32) - mean) / sd)
    fed = np.concatenate([np.full((last - 1, n), none), fed])
    for k, edge in enumerate(got):
        y = w @ fed[k : k + last].ravel() + b
        assert edge.offset == pytest.approx(0.5 + 0.1 * y[1], abs=1e-4)
        assert edge.offset_sd == pytest.approx(np.exp(y[2]), rel=1e-4)
        assert (edge.heading, edge.reference_x, edge.confidence, edge.is_held) == (0.0, 9.0, 0.8, False)


def test_points_are_in_the_frame_of_the_machine(tmp_path):
    n = 7
    file = linear(tmp_path / "net.onnx", [n, 3], np.eye(3 * n)[3:5], [0, 0])  # x and y of the second point
    part, _ = made(edge_level, file, {"x": Into("scan.points")}, {**EDGE, "offset": From("y", 1)})
    ranges = np.linspace(4, 9, n)
    one = scan(STEP, ranges)
    assert edges(part, [one])[0].offset == pytest.approx(AT.apply(one.points()[1])[0, 1], abs=1e-5)
    depth = np.full((4, 6), 8.0)
    file = linear(tmp_path / "depth.onnx", [4, 6, 3], np.eye(72)[3 * 6 + 1][None], [0])  # y, row 1, column 0
    part, _ = made(edge_level, file, {"x": Into("image.points")}, {**EDGE, "offset": From("y", 0)})
    ahead = np.array([8.0, 3.0 * 8.0 / 50.0, 1.0 * 8.0 / 50.0])  # 3 px left of the middle, 1 px above it
    got = edges(part, [image(STEP, depth)], "image")[0].offset
    assert got == pytest.approx(AT.apply(ahead)[1], abs=1e-5)


def test_colours_may_come_first(tmp_path):
    r = np.random.default_rng(3)
    colour, w = r.integers(0, 255, (5, 4, 3), dtype=np.uint8), r.normal(size=(1, 60))
    file = linear(tmp_path / "net.onnx", [1, 3, 5, 4], w, [0])
    into = Into("image.colour", mean=[1.0, 2.0, 3.0], sd=[10.0, 20.0, 30.0], channels="first")
    part, _ = made(edge_level, file, {"x": into}, {**EDGE, "offset": From("y")})
    picture = image(STEP, np.zeros((5, 4)))
    object.__setattr__(picture, "colour", colour)
    fed = (colour - np.array([1.0, 2.0, 3.0])) / np.array([10.0, 20.0, 30.0])
    expected = float(w[0] @ np.moveaxis(fed, -1, 0).ravel())
    assert edges(part, [picture], "image")[0].offset == pytest.approx(expected, rel=1e-4)


def test_an_answer_is_held_and_then_dropped(tmp_path):
    file = linear(tmp_path / "net.onnx", [1, 3], [[1, 0, 0]], [0])
    outputs = {"heading": 0.0, "reference_x": 9.0, "offset": From("y"), "offset_sd": TOLERANCE / 1.96}
    part, _ = made(edge_level, file, {"x": Into("scan.ranges")}, outputs, keep_s=0.1)
    one = scan(STEP, [2.0, 2.0, 2.0])
    new, *held, gone = edges(part, [one] * 4)
    assert (new.is_held, new.offset) == (False, 2.0)
    assert new.confidence == pytest.approx(0.95, abs=1e-3)
    assert [(e.is_held, e.offset) for e in held] == [(True, 2.0)] * 2
    assert not gone.is_found


def test_no_number_is_no_edge(tmp_path):
    file = linear(tmp_path / "net.onnx", [1, 3], [[np.nan, 0, 0]], [0])
    part, _ = made(edge_level, file, {"x": Into("scan.ranges")}, {**EDGE, "offset": From("y")})
    assert not edges(part, [scan(STEP, [1, 2, 3])])[0].is_found


@pytest.mark.parametrize("level", [edge_level, objects_level])
def test_the_same_bytes_again_and_after_a_saved_moment(level, tmp_path):
    r = np.random.default_rng(5)
    file = linear(tmp_path / "net.onnx", [3, 400], r.normal(0, 0.02, (3, 1200)), [8, 0, 4])
    into = {"x": Into("scan.ranges", last=3)}
    if level is edge_level:
        outputs = {**EDGE, "offset": From("y", 0)}
    else:
        outputs = {"x": From("y", 0), "y": From("y", 1), "confidence": From("y", 2, law="sigmoid")}
    scans = [scan(2 * k * STEP, r.uniform(1, 9, 400)) for k in range(1, 6)]  # every other step
    samples = [{"scan": scans[k // 2], "odometry": Odometry((k + 2) * STEP, 2.0, 0.0, 0.0)} for k in range(8)]

    def steps(part, begin):
        return [repr(part.step((k - 1) * STEP, STEP, samples[k - 1])) for k in range(begin, 9)]

    (one, _), (two, _), (third, _) = (made(level, file, into, outputs) for _ in range(3))
    whole = steps(one, 1)
    assert len(set(whole)) > 1
    for k in range(3):
        two.step(k * STEP, STEP, samples[k])
    third.load(two.save())
    assert steps(third, 4) == whole[3:]


def test_things_are_followed_over_the_ground(tmp_path):
    """A thing that stands, one of which it is not sure, one behind the knife, from a machine that drives."""
    w = np.zeros((9, 4))
    w[[0, 3, 6], 0] = 1.0  # x of the three is the first range
    bias = [0, 1.5, 3.0, 4, -2.0, -3.0, -20, 0.5, 3.0]
    nodes = [
        ("Flatten", ["x"], ["row"]),
        ("Gemm", ["row", "w", "b"], ["flat"]),
        ("Reshape", ["flat", "to"], ["boxes"]),
    ]
    held = {"w": w.T.astype(np.float32), "b": np.float32(bias), "to": np.array([3, 3])}
    file = save(tmp_path / "net.onnx", nodes, {"x": [1, 4]}, ["boxes"], held)
    outputs = {"x": From("boxes", 0), "y": From("boxes", 1), "confidence": From("boxes", 2, law="sigmoid")}
    part, _ = made(
        objects_level, file, {"x": Into("scan.ranges")}, {**outputs, "length": 1.0, "width": 0.6, "top": 1.7}
    )
    for k in range(1, 26):
        far = 20.0 - 2.0 * k * STEP / NS
        given = {"scan": scan(k * STEP, [far] * 4), "odometry": Odometry(k * STEP, 2.0, 0.0, 0.0)}
        found = part.step((k - 1) * STEP, STEP, given)["objects"]
    assert len(found.x) == 1
    assert (found.x[0], found.y[0]) == pytest.approx((far, 1.5), abs=0.02)
    assert (found.length[0], found.top[0]) == (1.0, pytest.approx(1.7))
    assert np.hypot(found.velocity_x[0], found.velocity_y[0]) < 0.05
    assert found.confidence[0] > 0.8


Y = {"tensor": "y"}
GOOD = {"file": "net.onnx", "inputs": {"x": {"field": "scan.ranges"}}, "outputs": {**EDGE, "offset": Y}}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"inputs": {}}, "inputs = none: expected all inputs of the network, also x"),
        ({"inputs": {"xx": {"field": "scan.ranges"}}}, "inputs of the network: x, did you mean 'x'"),
        ({"inputs": {"x": {"field": "scan.range"}}}, "did you mean 'ranges'"),
        ({"inputs": {"x": {"field": "truth.points"}}}, "truth.points: expected a field of scan"),
        ({"outputs": {**EDGE, "offset": {"tensor": "z"}}}, "z: expected an output of the network: y"),
        ({"outputs": {"offset": Y, "heading": 0, "reference_x": 9}}, "also confidence or offset_sd"),
        ({"outputs": EDGE}, "expected also offset"),
        ({"outputs": {**EDGE, "offset": Y, "speed": 3}}, "outputs.speed: expected some of offset"),
        ({"file": "no.onnx"}, "expected a network"),
        ({"inputs": {"x": {"field": "scan.ranges", "sd": 0}}}, "sd = 0: expected numbers that are not 0"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_one_line(change, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    linear("net.onnx", [1, 241], np.ones((1, 241)), [0])
    (tmp_path / "no.onnx").write_bytes(b"not a network")
    level = json.dumps({"level": "onnx", **GOOD, **change})
    with pytest.raises(InputError) as caught:
        assemble(load_scenario("straight", sets=[f"combine.edge={level}"])).close()
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_shape_that_does_not_fit_names_both(tmp_path):
    file = linear(tmp_path / "net.onnx", [1, 5], np.ones((1, 5)), [0])
    part, _ = made(edge_level, file, {"x": Into("scan.ranges")}, {**EDGE, "offset": From("y")})
    with pytest.raises(InputError, match=r"fits the network's \[1, 5\] of tensor\(float\), this is \[4, 1\]"):
        edges(part, [scan(STEP, [1, 2, 3, 4])])
    part, _ = made(edge_level, file, {"x": Into("scan.points", sd=[1.0, 2.0])}, {**EDGE, "offset": From("y")})
    with pytest.raises(InputError, match=r"inputs.x.sd = .*: expected one number, or 3 as on its last axis"):
        edges(part, [scan(STEP, [1, 2, 3, 4])])
    file = linear(tmp_path / "two.onnx", [1, 4], np.ones((2, 4)), [0, 0])
    part, _ = made(edge_level, file, {"x": Into("scan.ranges")}, {**EDGE, "offset": From("y")})
    with pytest.raises(InputError, match="expected one number, the network gives 2: index"):
        edges(part, [scan(STEP, [1, 2, 3, 4])])
    part, _ = made(edge_level, file, {"x": Into("scan.ranges")}, {**EDGE, "offset": From("y", 2)})
    with pytest.raises(InputError, match=r"expected a place on its last axis: y has shape \[1, 2\]"):
        edges(part, [scan(STEP, [1, 2, 3, 4])])


def test_a_network_is_code_that_has_to_be_allowed(tmp_path):
    file = linear(tmp_path / "net.onnx", [1, 4], np.ones((1, 4)), [0])
    with through(Gate()), pytest.raises(InputError, match="allow it with --allow-code"):
        made(edge_level, file, {"x": Into("scan.ranges")}, {**EDGE, "offset": From("y")})


def test_without_the_extra_one_line_says_what_to_install(tmp_path, monkeypatch):
    file = linear(tmp_path / "net.onnx", [1, 4], np.ones((1, 4)), [0])
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(
        MissingExtra, match=r"\(level onnx\) needs an optional part: pip install 'swath\[onnx\]'"
    ):
        made(edge_level, file, {"x": Into("scan.ranges")}, {**EDGE, "offset": From("y")})


@pytest.mark.parametrize("slot", ["edge", "objects"])
def test_a_camera_is_wired_by_itself(slot, tmp_path):
    file = linear(tmp_path / "net.onnx", [12, 16], np.zeros((1, 192)), [5])
    told = "offset: {tensor: y}, heading: 0, reference_x: 9, confidence: 1"
    if slot == "objects":
        told = "x: {tensor: y, add: 5}, y: 0, confidence: 1"
    level = f"{{level: onnx, file: {file}, inputs: {{x: {{field: image.depth}}}}, outputs: {{{told}}}}}"
    sets = [f"combine.camera={CAMERA}", f"combine.{slot}={level}", "run.max_duration_s=0.2"]
    world = assemble(load_scenario("straight", sets=sets))
    drive(world)
    got = world.graph.latest(f"combine.{slot}", slot)
    assert got.is_found if slot == "edge" else got.x[0] == pytest.approx(10.0, abs=0.2)
    world.close()


@pytest.mark.parametrize("level", ["likelihood_ratio", "otsu", f"{EXAMPLE}:MyEdgeDetector"])
def test_a_camera_beside_the_scanner_changes_nothing_for_others(level):
    """A part that does not declare `image` knows the mounting of its one scanner, as without a camera."""
    sets = [f"combine.camera={CAMERA}", f"combine.edge={level}"]
    assemble(load_scenario("straight", sets=sets)).close()


def test_links_get_pictures_where_they_ask_for_them():
    sets = [f"combine.camera={CAMERA}", "combine.edge=ros2"]
    wires = load_scenario("straight", sets=sets).machines["combine"].slots["edge"].wires
    asked = load_scenario("straight", sets=[*sets, "combine.edge.wires={image: camera.image}"])
    assert "image" not in wires
    assert asked.machines["combine"].slots["edge"].wires["image"] == ("combine.camera", "image")
