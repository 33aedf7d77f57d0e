"""ISO 11783 over CAN: identifiers and data against other readers, rules of guidance, box and bus."""

import itertools
import logging
import struct
import sys
import threading
from contextlib import contextmanager
from dataclasses import replace

import j1939 as other_stack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swath.core.component import Port
from swath.core.errors import InputError, SwathError
from swath.core.random import Stream
from swath.documents import j1939
from swath.link.can import guidance
from swath.link.can.box import ControllerBox, make_law
from swath.link.can.bus import CLAIM, Message, Node, Where, open_bus
from swath.link.can.codec import Codec
from swath.link.can.steering import BoxError, CanSteering, Params
from swath.signals import CropEdge, GroundSpeed, Odometry
from tests.link.can_rig import MS, NS, own_bus, setup, way
from tests.waiting import PATIENCE_S, ended, until

pytestmark = pytest.mark.usefixtures("code_allowed")

CODEC = Codec()


@given(
    st.integers(0, 7), st.sampled_from([0xAC00, 0xAD00, 0xFE48, 0xFF5A, 0xEA00]), st.integers(0, 253),
    st.integers(0, 255),
)  # fmt: skip
def test_identifiers_read_the_same_in_another_stack(priority, pgn, source, destination):
    header = j1939.Header(pgn, priority, source, destination)
    theirs = other_stack.MessageId(can_id=header.identifier)
    number = other_stack.ParameterGroupNumber()
    number.from_message_id(theirs)
    assert (theirs.priority, theirs.source_address) == (priority, source)
    if number.is_pdu1_format:
        assert (number.value & 0x3FF00, number.pdu_specific) == (pgn, destination)
        assert j1939.parse(header.identifier) == header
    else:
        assert number.value == pgn
        assert j1939.parse(header.identifier) == replace(header, destination=j1939.GLOBAL)


def test_names_read_the_same_in_another_stack():
    theirs = other_stack.Name(bytes=j1939.name(device_class=j1939.HARVESTER, identity=240))
    assert (theirs.industry_group, theirs.vehicle_system, theirs.identity_number) == (2, 7, 240)
    assert (theirs.function, theirs.arbitrary_address_capable) == (255, 0)
    assert j1939.device_class(j1939.name(device_class=7, identity=5)) == 7


def test_a_stack_of_somebody_else_receives_what_we_send():
    logging.getLogger("j1939").setLevel(logging.CRITICAL)
    where, heard = own_bus(), []
    ecu = other_stack.ElectronicControlUnit()
    ecu.connect(interface="virtual", channel=where.channel)
    ecu.subscribe(lambda priority, pgn, source, at, data: heard.append((priority, pgn, source, bytes(data))))
    node = Node(where, 240, device_class=j1939.HARVESTER)
    try:
        node.claim()
        node.send(guidance.WHEEL, guidance.speed_values("Wheel", 1.944, 12.3456))
        node.send(guidance.STATUS, {"EstimatedCurvature": -12.25, "SteeringSystemReadiness": 1})
        until(lambda: len(heard) >= 2, "both are heard")
    finally:
        node.close()
        ecu.disconnect()
    (_, speed_pgn, source, speed), (_, status_pgn, _, status) = heard[-2:]
    assert (speed_pgn, status_pgn & 0x3FF00, source) == (65096, 44032, 240)
    assert struct.unpack("<HIBB", speed) == (1944, 12346, 0xFF, 0xFF & ~0b1111 | 0b0101)
    assert struct.unpack("<H", status[:2])[0] * 0.25 - 8032 == -12.25
    assert status[2] == 0b11110111
    assert status[5:] == b"\xff\xff\xff"


def test_data_by_the_numbers_of_the_standard():
    command = CODEC.encode(guidance.COMMAND, {"CurvatureCommand": 0.0, "CurvatureCommandStatus": 1})
    assert command == bytes([0x80, 0x7D, 0xFD, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF])
    assert CODEC.header(guidance.COMMAND) == (44288, 3)
    assert CODEC.header(guidance.STATUS) == (44032, 3)
    assert (CODEC.header(guidance.WHEEL)[0], CODEC.header(guidance.GROUND)[0]) == (65096, 65097)
    status = CODEC.encode(guidance.STATUS, {"LimitStatus": 3, "ExitReasonCode": 5, "RemoteEngageSwitch": 1})
    assert status[3:5] == bytes([0b01111111, 0b01000101])
    assert status[:2] == b"\xff\xff"
    ground = CODEC.encode(guidance.GROUND, guidance.speed_values("Ground", -2.0, 0.0))
    assert ground == bytes([0xD0, 7, 0, 0, 0, 0, 0xFF, 0xFC])


def test_curvature_on_the_bus_is_positive_to_the_right():
    assert guidance.to_bus(0.01) == -10.0
    assert guidance.from_bus(-10.0) == 0.01


@given(st.floats(-9000, 9000) | st.none() | st.just(float("nan")))
def test_numbers_come_back_within_half_a_step_and_within_the_range(curvature):
    values = {"CurvatureCommand": curvature, "CurvatureCommandStatus": 1}
    name, back = CODEC.decode(0xAD00, CODEC.encode(guidance.COMMAND, values))
    assert name == guidance.COMMAND
    if curvature is None or curvature != curvature:
        assert back["CurvatureCommand"] is None
    else:
        assert abs(back["CurvatureCommand"] - min(max(curvature, -8032), 8031.75)) <= 0.125


def test_what_is_no_number_or_not_ours():
    error = bytes([0x00, 0xFE, 0xFD, 255, 255, 255, 255, 255])
    assert CODEC.decode(0xAD00, error)[1]["CurvatureCommand"] is None
    assert CODEC.decode(0xAD00, error[:5]) is None
    assert CODEC.decode(0xFEF1, error) is None


edges = st.builds(
    CropEdge,
    st.integers(0, 5 * NS),
    st.floats(-30, 30),
    st.floats(-3, 3),
    st.floats(-0.3, 0.3),
    st.floats(0, 30),
    st.floats(0, 1),
    st.floats(0, 3),
    st.floats(0, 1),
)


@settings(max_examples=50)
@given(edges)
def test_the_crop_edge_comes_through(edge):
    line, quality = guidance.edge_values(edge, 6 * NS, 300)
    got_line = CODEC.decode(0xFF5A, CODEC.encode(guidance.EDGE_LINE, line))[1]
    got_quality = CODEC.decode(0xFF5B, CODEC.encode(guidance.EDGE_QUALITY, quality))[1]
    got = guidance.edge_of(got_line, got_quality, 6 * NS)
    assert abs(got.t - edge.t) <= 50_000
    for key, step in (
        ("offset", 1e-3),
        ("heading", 1e-4),
        ("curvature", 1e-5),
        ("reference_x", 1e-3),
        ("confidence", 4e-3),
        ("crop_height", 1e-3),
    ):
        assert abs(getattr(got, key) - getattr(edge, key)) <= 0.5001 * step
    assert got_quality["Cycle"] == 300 % 251


def test_no_edge_stays_no_edge():
    lost = CropEdge(0, float("nan"), float("nan"), 0.0, 8.0, 0.0, 0.9, 0.1)
    for edge in (None, lost):
        line, quality = guidance.edge_values(edge, NS, 0)
        got_line = CODEC.decode(0xFF5A, CODEC.encode(guidance.EDGE_LINE, line))[1]
        got_quality = CODEC.decode(0xFF5B, CODEC.encode(guidance.EDGE_QUALITY, quality))[1]
        assert not guidance.edge_of(got_line, got_quality, NS).is_found


def command(curvature, status=1):
    return Message(
        guidance.COMMAND, {"CurvatureCommand": curvature, "CurvatureCommandStatus": status}, 28, 255
    )


def test_a_command_that_stays_out_releases_until_the_controller_has_let_go():
    g = guidance.Guidance(timeout=300 * MS)
    assert not g.is_overdue(5 * NS)  # nobody has steered yet
    g.hear(command(-4.0), 100 * MS)
    assert (g.command.curvature, g.command.is_engaged) == (0.004, True)
    assert not g.is_overdue(400 * MS)
    assert g.is_overdue(401 * MS)
    assert not g.is_overdue(500 * MS)
    status = guidance.status_values(g, Odometry(0, 2.0, 0.02, 0.0), 3.9)
    assert (status["ExitReasonCode"], status["RequestResetCommand"]) == (5, 1)
    assert status["EstimatedCurvature"] == -10.0
    g.hear(command(-4.0), 600 * MS)
    assert not g.command.is_engaged
    g.hear(command(-4.0, status=0), 700 * MS)
    assert not g.command.is_engaged
    g.hear(command(-5.0), 800 * MS)
    assert (g.command.curvature, g.command.is_engaged, g.reason) == (0.005, True, 0)


def test_a_command_without_a_number_is_not_obeyed():
    g = guidance.Guidance(timeout=300 * MS)
    g.hear(command(-4.0), 0)
    g.hear(command(None), 100 * MS)
    assert (g.command.curvature, g.command.is_engaged, g.reason) == (0.004, False, 6)


def test_at_a_crawl_curvature_comes_from_the_steering_angle():
    assert guidance.measured_curvature(Odometry(0, 0.1, 0.5, 0.1), 3.9) == pytest.approx(0.0257, abs=1e-4)
    assert guidance.measured_curvature(Odometry(0, 2.0, float("nan"), float("nan")), 3.9) is None
    back = guidance.odometry_of(1.5, 0.02, 3.9, 7)
    assert guidance.measured_curvature(back, 3.9) == pytest.approx(0.02)


def test_a_node_leaves_out_its_own_frames_and_those_for_others_and_tells_who_it_is():
    where = own_bus()
    node = Node(where, 240, device_class=j1939.HARVESTER)
    other = Node(where, 28, device_class=j1939.NO_CLASS)
    twin, raw = Node(where, 28, device_class=j1939.NO_CLASS), open_bus(where)
    try:
        import can

        for header in (
            j1939.Header(0xAD00, 3, 28, destination=17),
            j1939.Header(0xFEF1, 3, 28),
            j1939.Header(0xAD00, 3, 240),
        ):
            raw.send(can.Message(arbitration_id=header.identifier, data=bytes(8), is_extended_id=True))
        raw.send(can.Message(arbitration_id=0x123, data=bytes(8), is_extended_id=False))
        other.send(guidance.COMMAND, {"CurvatureCommand": 1.0, "CurvatureCommandStatus": 1})
        heard = node.receive()
        assert (heard.name, heard.source, heard.values["CurvatureCommand"]) == (guidance.COMMAND, 28, 1.0)
        assert node.receive() is None
        assert twin.receive().source == 240
        assert twin.receive() is None  # the rest came from its own address
        assert other.receive().source == 240
        node.request_claims()
        assert other.receive() is None
        claim = node.receive(PATIENCE_S)
        assert (claim.name, claim.source, claim.values["device_class"]) == (CLAIM, 28, 0.0)
    finally:
        for each in (node, other, twin):
            each.close()
        raw.shutdown()
    node.close()
    with pytest.raises(SwathError, match="is closed"):
        node.receive()


def rounded(inputs, t):
    """Inputs of the law as they come over the bus, by arithmetic of its own."""
    edge, odometry = inputs["edge"], inputs["odometry"]

    def on(value, step):
        return round(value / step) * step

    bend = on(1000.0 * odometry.yaw_rate / odometry.speed, 0.25) / 1000.0
    speed = on(odometry.speed, 1e-3)
    if edge is not None:
        edge = CropEdge(
            t - on(t - edge.t, 100_000),
            on(edge.offset, 1e-3) if edge.is_found else float("nan"),
            on(edge.heading, 1e-4) if edge.is_found else float("nan"),
            on(edge.curvature, 1e-5),
            on(edge.reference_x, 1e-3),
            edge.confidence,
            edge.crop_height,
            edge.stubble_height,
        )
    return {"edge": edge, "odometry": Odometry(t, speed, bend * speed, float("nan"))}


def test_in_lock_step_the_box_steers_as_the_law_would_with_numbers_of_that_resolution():
    keys = Params(interface="virtual", box="inside", lock_step=True)
    part = CanSteering(keys, setup())
    law = make_law("preview", {"overlap_m": 0.10}, setup().control, period=100 * MS)
    law.reset(Stream(0, "law"))
    part.reset(Stream(0, "part"))
    held, engaged, seen = 0.0, False, 0
    try:
        for t, inputs in way(400):
            end = t + 20 * MS
            got = part.step(t, 20 * MS, inputs)["command"]
            if end % (100 * MS) == 0:
                wanted = law.step(end - 100 * MS, 100 * MS, rounded(inputs, end))["command"]
                held, engaged = round(wanted.curvature * 4000) / 4000, wanted.is_engaged
                assert got.t == end
                seen += abs(held) > 0.001
            assert got.curvature == pytest.approx(held, abs=1e-12)
            assert got.is_engaged == engaged
    finally:
        part.close()
    assert seen > 20


def test_a_run_can_go_back_to_a_saved_moment_with_a_box_inside():
    part = CanSteering(Params(interface="virtual", box="inside", lock_step=True), setup())
    part.reset(Stream(0, "part"))
    steps = list(way(300))

    def drive(piece):
        return [part.step(t, 20 * MS, inputs)["command"] for t, inputs in piece]

    try:
        drive(steps[:150])
        state = part.save()
        after = drive(steps[150:])
        part.load(state)
        assert drive(steps[150:]) == after
    finally:
        part.close()


@pytest.mark.parametrize("every", [1, 2, 3, 6])
def test_a_cycle_is_a_multiple_of_any_rate(every):
    """Of a law 15 times a second: messages go with every so many of its steps."""
    keys = Params(interface="virtual", box="inside", lock_step=True, cycle_ms=every * 1000 / 15)
    part, cycles = CanSteering(keys, setup(period=1 / 15)), []
    part.reset(Stream(0, "part"))
    try:
        times = [(2 * n * 10**9 + 15) // 30 for n in range(31)]
        for (a, b), (_, inputs) in zip(itertools.pairwise(times), way(30), strict=True):
            part.step(a, b - a, inputs)
            cycles.append(part._cycle)
    finally:
        part.close()
    assert cycles == [n // every for n in range(1, 31)]


@contextmanager
def answering(node):
    """The node answers who is there, and nothing else."""
    done = threading.Event()

    def serve():
        while not done.is_set():
            node.receive(0.01)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield
    finally:
        done.set()
        ended(thread)


def test_the_machine_tells_everything_and_the_key_switch_last():
    where = own_bus()
    raw = open_bus(where)
    box_node = Node(where, 28, device_class=j1939.NO_CLASS)
    keys = Params(interface="virtual", channel=where.channel, lock_step=True, answer_s=0.05)
    part = CanSteering(keys, setup())
    steps = list(way(5))
    try:
        with answering(box_node):
            part.reset(Stream(0, "part"))
        for t, inputs in steps[:4]:
            part.step(t, 20 * MS, inputs)
        with pytest.raises(BoxError, match=r"combine.steer: the box on virtual .* 0.05 s, at 0.1 s of sim"):
            part.step(steps[4][0], 20 * MS, steps[4][1])
        part.close()
        heard = []
        while (frame := raw.recv(0.0)) is not None:
            heard.append(frame)
    finally:
        box_node.close()
        raw.shutdown()
    assert all(f.is_extended_id and len(f.data) in (3, 8) for f in heard)
    pgns = [j1939.parse(f.arbitration_id).pgn for f in heard]
    assert pgns[-6:] == [65096, 65097, 44032, 65370, 65371, 65096]
    assert 60928 in pgns
    assert heard[-1].data[7] >> 2 & 3 == 0  # key switch off
    assert struct.unpack("<H", heard[-6].data[:2])[0] == pytest.approx(1900, abs=40)


def test_who_is_not_there_is_named():
    keys = Params(interface="virtual", channel=own_bus().channel, lock_step=True, wait_s=0.05, box_address=9)
    part = CanSteering(keys, setup())
    with pytest.raises(BoxError, match=r"combine.steer: the box 9 was not found on virtual .* within 0.05 s"):
        part.reset(Stream(0, "part"))
    part.close()


def test_a_box_lets_go_when_asked_and_starts_anew_with_a_new_machine():
    where = own_bus()
    node, machine = (Node(where, a, device_class=c) for a, c in ((28, 0), (240, j1939.HARVESTER)))
    law = make_law("preview", {}, setup().control, period=100 * MS)
    box = ControllerBox(law, node, period=100 * MS, wheelbase=3.9)
    g = guidance.Guidance(300 * MS)
    edge = CropEdge(0, 6.3, 0.0, 0.0, 8.0, 0.9, 0.9, 0.1)

    def cycle(k):
        line, quality = guidance.edge_values(edge, 100 * MS, k)
        machine.send(guidance.WHEEL, guidance.speed_values("Wheel", 2.0, 0.0))
        machine.send(guidance.STATUS, guidance.status_values(g, Odometry(0, 2.0, 0.0, 0.0), 3.9))
        machine.send(guidance.EDGE_LINE, line)
        machine.send(guidance.EDGE_QUALITY, quality)
        box.serve()
        return machine.receive().values

    try:
        first = [cycle(k) for k in range(20)]
        assert [v["CurvatureCommandStatus"] for v in first] == [1.0] * 20
        assert first[-1]["CurvatureCommand"] < -1.0  # the edge is to the left
        g.needs_reset = True
        assert cycle(20)["CurvatureCommandStatus"] == 0
        g.needs_reset = False
        machine.claim()
        assert [cycle(k) for k in range(20)] == first
    finally:
        node.close()
        machine.close()


@pytest.mark.parametrize(
    ("keys", "slot", "said"),
    [
        ({"interface": "sockcan"}, "steer", r"interface = sockcan: expected one of .*socketcan"),
        ({}, "speed", r"level = can: expected in a slot steer"),
        ({"cycle_ms": 9.0}, "steer", r"cycle_ms = 9.0: expected a multiple of the slot's 20 ms"),
        ({"cycle_ms": 50.0}, "steer", r"cycle_ms = 50.0: expected a multiple of the slot's 20 ms"),
        ({"box": "inside", "law": "preveiw"}, "steer", r"^law = preveiw: .*did you mean 'preview'"),
        ({"box": "inside", "law": "can"}, "steer", r"law = can: expected a steering law that needs only"),
        ({"box": "inside", "law": "gone.py:Law"}, "steer", r"law = gone.py:Law: .*there is no file"),
        ({"box": "inside", "law_keys": {"lookahed_m": 3}}, "steer", r"did you mean 'lookahead_m'"),
        ({"box": "inside", "law_keys": {"lookahead_m": -3}}, "steer", r"law_keys.lookahead_m = -3"),
    ],
)
def test_bad_keys_are_refused(keys, slot, said):
    with pytest.raises(InputError, match=said):
        CanSteering(Params(**keys), setup(slot))


def test_a_bus_that_cannot_be_opened_says_why():
    with pytest.raises(SwathError, match=r"CAN bus socketcan nowhere0: could not be opened: "):
        open_bus(Where("socketcan", "nowhere0"))


def test_without_the_extra_the_level_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "can", None)
    with pytest.raises(SwathError, match=r"pip install 'swath\[can\]'"):
        CanSteering(Params(), setup())


OWN_LAW = """
from swath.core.component import Port
from swath.signals import CropEdge, Odometry, SteerCommand


class Law:
    inputs = (Port("edge", CropEdge), Port("odometry", Odometry))
    outputs = (Port("command", SteerCommand),)

    def __init__(self, params, setup):
        self.gain = 0.01 / setup.period

    def reset(self, stream):
        return {"command": SteerCommand(0, 0.0, False)}

    def step(self, t, dt, inputs):
        edge = inputs["edge"]
        bend = self.gain * (edge.offset - 6.0) if edge.is_found else 0.0
        return {"command": SteerCommand(t + dt, bend, edge.is_found)}
"""


def test_a_law_from_a_file_of_the_user_can_be_the_box(tmp_path):
    (tmp_path / "law.py").write_text(OWN_LAW)
    keys = Params(interface="virtual", box="inside", lock_step=True, law="law.py:Law")
    part = CanSteering(keys, replace(setup(), base=tmp_path))
    part.reset(Stream(0, "part"))
    edge = CropEdge(0, 6.2, 0.0, 0.0, 8.0, 0.9, 0.9, 0.1)
    try:
        for k in range(5):
            inputs = {"edge": edge, "odometry": Odometry(0, 2.0, 0.0, 0.0)}
            got = part.step(k * 20 * MS, 20 * MS, inputs)["command"]
    finally:
        part.close()
    assert got.is_engaged
    assert got.curvature == pytest.approx(0.02, abs=1e-9)  # 0.1 /s over the cycle's 0.1 s, not the slot's


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("class Law:\n    pass\n", r"law = law.py:Law: could not be made by Class\(params, setup\)"),
        ("def Law(setup):\n    return 1\n", r"could not be made by Class\(params, setup\): TypeError"),
        (
            "def Law(params, setup):\n    return 1\n",
            r"expected a component, it has no inputs, outputs",
        ),
    ],
)
def test_a_law_that_is_none_is_refused_in_one_line(text, expected, tmp_path):
    (tmp_path / "law.py").write_text(text)
    keys = Params(interface="virtual", box="inside", lock_step=True, law="law.py:Law")
    with pytest.raises(InputError, match=expected):
        keys.make_law(setup().control, tmp_path)


def test_wheels_and_ground_differ_by_the_slip():
    """PGN 65096 says what the wheels turn, 65097 what a ground speed sensor measures."""
    where = own_bus()
    keys = Params(interface="virtual", channel=where.channel, lock_step=True, box="inside", law="preview")
    parts = setup()
    ports = (*parts.inputs, Port("ground", GroundSpeed, optional=True))
    part = CanSteering(keys, replace(parts, inputs=ports))
    raw = open_bus(Where("virtual", f"{where.channel} {id(part)}"))  # a box inside has a bus of its own
    slip = 0.04
    try:
        part.reset(Stream(0, "part"))
        frames = []
        for t, inputs in way(10):
            wheel = Odometry(t, 2.0 * (1.0 + slip), 0.0, 0.0)
            part.step(t, 20 * MS, {**inputs, "odometry": wheel, "ground": GroundSpeed(t, 2.0, 7.5)})
    finally:
        part.close()
    while (frame := raw.recv(0.0)) is not None:
        frames.append(frame)
    raw.shutdown()
    told = {}
    for frame in frames:
        told.setdefault(j1939.parse(frame.arbitration_id).pgn, []).append(frame.data)
    wheel, ground = (struct.unpack("<HI", told[pgn][0][:6]) for pgn in (65096, 65097))
    assert wheel[0] / ground[0] - 1.0 == pytest.approx(slip, abs=5e-4)
    assert ground == (2000, 7500)
