"""A machine as a terminal sees it: frames read by cantools, a task controller on the stack of can-j1939."""

import json
import logging
import struct
from types import SimpleNamespace

import cantools
import j1939 as other_stack
import numpy as np
import pytest

from swath.commands.main import main
from swath.core.schedule import NS
from swath.documents.j1939 import dbc_file
from swath.link.can.bus import Node, open_bus
from swath.link.can.isobus import ADDRESS, DATA, IsobusMachine
from swath.link.can.task_client import Datum, TaskClient, object_pool
from swath.runtime.assembly import assemble
from swath.runtime.changes import Interventions
from swath.runtime.job import run_unrecorded
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario
from tests.link.can_rig import own_bus
from tests.waiting import until

QUICK = ["combine.lidar=off", "combine.edge=truth", "run.max_duration_s=60"]
CONTROLLER = 247


class Controller:
    """A task controller: takes descriptions, asks for values. refuse: error that it answers to ...; script:
    commands that it sends when a client is active
    """

    def __init__(self, where, script=(), refuse=()):
        logging.getLogger("j1939").setLevel(logging.CRITICAL)
        self.ecu = other_stack.ElectronicControlUnit()
        self.ecu._listeners.append(self._count)  # the last to be told of a frame
        self.ecu.connect(interface="virtual", channel=where.channel)
        name = other_stack.Name(function=130, industry_group=2, identity_number=9)
        self.app = other_stack.ControllerApplication(name, CONTROLLER, bypass_address_claim=True)
        self.ecu.add_ca(controller_application=self.app)
        self.app.subscribe(self._hear)
        self.script, self.refuse = script, dict(refuse)
        self.heard, self.pool, self.values, self.masters = [], None, [], []
        self.frame_count = self.status_count = 0
        self.ecu.subscribe(self._all)
        self.ecu.add_timer(0.02, self._status)

    def _status(self, cookie):
        self.app.send_pgn(0, 0xCB, 0xFF, 3, [0xFE, 0xFF, 0xFF, 0xFF, 1, 0, 0, 0])
        self.status_count += 1
        return True

    def _count(self, frame):
        self.frame_count += 1

    def follow(self, hook, graph):
        """Each tick waits until all frames before it are dealt with, each second for a status."""

        def wait(t):
            until(lambda: self.frame_count >= hook.count, "the controller has dealt with all frames")
            before = self.status_count
            if t % NS == 0:
                until(lambda: self.status_count > before, "the controller's status")

        graph.before_tick.append(wait)

    def _all(self, priority, pgn, source, at, data):
        if pgn == 0xFE0D:
            self.masters.append((source, bytes(data)))

    def _hear(self, priority, pgn, source, at, data):
        if pgn & 0x3FF00 != 0xCB00:
            return
        first, data = data[0], bytes(data)
        self.heard.append(first)
        refused = self.refuse.get(first, 0)
        answer = {
            0x00: [0x10, 4, 0, 0, 0, 1, 1, 16],
            0x01: [0x11],
            0x41: [0x51, refused],
            0x61: [0x71, refused],
            0x81: [0x91, refused],
        }.get(first)
        if first == 0x61:
            self.pool = data[1:]
        if first & 0xF in (3, 0xD):
            self.values.append((first & 0xF, first >> 4 | data[1] << 4, data[2] | data[3] << 8,
                                struct.unpack("<i", data[4:8])[0]))  # fmt: skip
        if answer is not None:
            self._tell(source, answer)
        if first == 0x81 and answer[1] == 0:
            for how, element, ddi, number in self.script:
                head = [how | (element & 0xF) << 4, element >> 4, ddi & 0xFF, ddi >> 8]
                self._tell(source, head + list(struct.pack("<i", number)))

    def _tell(self, destination, data):
        self.app.send_pgn(0, 0xCB, destination, 3, data + [0xFF] * (8 - len(data)))

    def close(self):
        self.ecu.disconnect()
        self.ecu.stop()


def read_pool(data):
    """Objects of a pool by their number, read by the layouts of ISO 11783-10 annex A."""
    found, at = {}, 0

    def take(form):
        nonlocal at
        values = struct.unpack_from("<" + form, data, at)
        at += struct.calcsize("<" + form)
        return values if len(values) > 1 else values[0]

    def text():
        return take(f"{take('B')}s").decode()

    while at < len(data):
        kind, number = take("3s").decode(), take("H")
        if kind == "DVC":
            own = {"designator": text(), "version": text(), "name": take("8s"), "serial": text(),
                   "structure": take("7s"), "localization": take("7s")}  # fmt: skip
        elif kind == "DET":
            own = {"type": take("B"), "designator": text(), "element": take("H"), "parent": take("H")}
            count = take("H")
            own["refs"] = [take("H") for _ in range(count)]
        elif kind == "DPD":
            own = {
                "ddi": take("H"),
                "properties": take("B"),
                "triggers": take("B"),
                "designator": text(),
                "shown": take("H"),
            }
        elif kind == "DPT":
            own = {"ddi": take("H"), "value": take("i"), "designator": text(), "shown": take("H")}
        elif kind == "DVP":
            own = {"offset": take("i"), "scale": take("f"), "decimals": take("B"), "unit": text()}
        else:
            raise AssertionError(f"{kind!r} at {at}")
        assert number not in found
        found[number] = {"kind": kind, **own}
    return found


def test_the_description_is_whole_and_every_reference_leads_somewhere():
    name = bytes(range(8))
    found = read_pool(object_pool(DATA, name, "combine", 12000, 5900))
    device = found[0]
    assert (device["kind"], device["name"], device["designator"]) == ("DVC", name, "combine")
    elements = {n: o for n, o in found.items() if o["kind"] == "DET"}
    assert sorted(o["element"] for o in elements.values()) == [0, 1]
    assert all(o["parent"] in found for o in elements.values())
    listed = [n for o in elements.values() for n in o["refs"]]
    assert sorted(listed) == sorted(n for n, o in found.items() if o["kind"] in ("DPD", "DPT"))
    for number in listed:
        assert found[found[number]["shown"]]["kind"] == "DVP"
    shown = {o["ddi"]: found[o["shown"]] for o in found.values() if "ddi" in o}
    assert {d.ddi for d in DATA} < set(shown)
    assert shown[87]["scale"] == pytest.approx(1e-6)
    assert shown[87]["unit"] == "kg/s"
    properties = {o["ddi"]: o["value"] for o in found.values() if o["kind"] == "DPT"}
    assert properties == {70: 12000, 134: 5900}
    assert object_pool(DATA, name, "combine", 12000, 5900) == object_pool(DATA, name, "combine", 12000, 5900)


def driven(hook, seconds, controller=None):
    """The bundled scenario feed-rate with the hook, which a controller follows. (samples, summary)"""
    world = assemble(load_scenario("feed-rate", sets=QUICK))
    seen = {}

    def note(slot, t, outputs):
        for output, signal in outputs.items():
            seen.setdefault(f"{slot}.{output}", []).append((t, signal))

    observers = []
    hook.begin(SimpleNamespace(world=world, observers=observers))
    if controller is not None:
        controller.follow(hook, world.graph)
    drive(world, [*observers, note], until_s=seconds)
    summary = hook.summarize(world.graph.t)
    hook.close()
    world.close()
    return seen, summary


def test_a_terminal_reads_engine_speeds_and_header_with_cantools():
    where = own_bus()
    frames = []
    listener = open_bus(where)
    hook = IsobusMachine(where)
    seen, summary = driven(hook, 6.0)
    while (frame := listener.recv(0.0)) is not None:
        frames.append(frame)
    listener.shutdown()
    database = cantools.database.load_file(str(dbc_file()))
    read = {}
    for frame in frames:
        pgn = frame.arbitration_id >> 8 & 0x3FFFF
        assert frame.arbitration_id & 0xFF == ADDRESS
        for message in database.messages:
            if message.frame_id >> 8 & 0x3FFFF == pgn:
                read.setdefault(message.name, []).append(
                    message.decode(bytes(frame.data), decode_choices=False)
                )
    assert len(frames) == summary["isobus"]["frames"] + 1 + 1  # and the claim, and the key switch at the end
    assert len(read["ElectronicEngineController1"]) == 301 - 1
    assert 115 <= len(read["ElectronicEngineController2"]) <= 121
    assert len(read["FrontHitchStatus"]) == 60
    engine = [s for _, s in seen["combine.powertrain.engine"]]
    rpm = [m["EngineSpeed"] for m in read["ElectronicEngineController1"]]
    assert (
        min(s.speed for s in engine) * 60 / (2 * np.pi) - 0.1
        < min(rpm[5:])
        <= max(rpm[5:])
        < max(s.speed for s in engine) * 60 / (2 * np.pi) + 0.1
    )
    load = read["ElectronicEngineController2"][-1]["EnginePercentLoadAtCurrentSpeed"]
    assert abs(load - 100 * engine[-1].load) < 2.0
    odometry = [s for _, s in seen["combine.odometry.odometry"]]
    speeds = [m["WheelBasedSpeed"] for m in read["WheelBasedSpeedAndDistance"][:-1]]
    assert abs(speeds[-1] - odometry[-1].speed) < 0.05
    way = read["WheelBasedSpeedAndDistance"][-2]["WheelBasedDistance"]
    assert way == pytest.approx(np.mean([s.speed for s in odometry]) * 5.9, rel=0.02)
    assert read["WheelBasedSpeedAndDistance"][-1]["KeySwitch"] == 0
    hitch = read["FrontHitchStatus"][-1]
    assert (hitch["FrontHitchInWork"], hitch["FrontHitchPosition"] > 100) == (1, True)  # no position is known


def test_a_task_controller_gets_the_description_and_the_values_it_asks_for():
    where = own_bus()
    script = [
        (4, 1, 87, 500),
        (8, 0, 141, 1),
        (5, 0, 397, 1000),
        (2, 1, 67, 0),
        (2, 0, 9999, 0),
        (3, 1, 87, 5),
    ]
    controller = Controller(where, script)
    try:
        hook = IsobusMachine(where)
        seen, summary = driven(hook, 16.0, controller)
        until(lambda: controller.frame_count >= summary["isobus"]["frames"] + 2, "the last is dealt with")
    finally:
        controller.close()
    assert summary["isobus"]["task_controller"] == [
        f"the task controller {CONTROLLER} has taken the description"
    ]
    assert controller.masters[0] == (ADDRESS, bytes([1, *[0xFF] * 7]))
    pool = read_pool(controller.pool)
    assert {o["ddi"] for o in pool.values() if o["kind"] == "DPD"} == {
        *(141, 397, 149, 67, 116, 87, 90, 99),
        *(93, 96, 98),
    }
    flows = [v for how, element, ddi, v in controller.values if (how, element, ddi) == (3, 1, 87)]
    grain = [s.flow for _, s in seen["combine.crop_flow.grain"]]
    assert 15 <= len(flows) <= 33  # every 0.5 s of the run, as long as it is active
    assert abs(flows[-1] * 1e-6 - grain[-1]) < 0.05 * max(grain)
    speeds = [v for how, element, ddi, v in controller.values if (how, element, ddi) == (3, 0, 397)]
    way = (
        sum(s.speed for _, s in seen["combine.odometry.odometry"])
        * 16.0
        / len(seen["combine.odometry.odometry"])
    )
    assert 0.4 * way < len(speeds) <= way + 1
    widths = [v for how, element, ddi, v in controller.values if (how, element, ddi) == (3, 1, 67)]
    assert len(widths) == 1
    refused = [(ddi, v & 0xFF) for how, _, ddi, v in controller.values if how == 0xD]
    assert refused == [(9999, 2), (87, 16)]  # no such data; what is measured is not set
    assert controller.heard.count(0xFF) >= 4  # the client's status every 2 s
    assert controller.heard[-1] == 0x81  # switched off


def test_a_task_controller_that_refuses_is_told_and_the_run_goes_on():
    where = own_bus()
    controller = Controller(where, refuse=[(0x61, 3)])
    try:
        _, summary = driven(IsobusMachine(where), 4.0, controller)
    finally:
        controller.close()
    (told,) = summary["isobus"]["task_controller"]
    assert "the transfer" in told
    assert "error 3" in told


class Bus:
    def __init__(self):
        self.sent = []

    def __call__(self, pgn, data, destination):
        assert len(data) == 8
        self.sent.append((pgn, data, destination))


def client():
    bus = Bus()
    data = (Datum(87, 1, "flow", 1e-6, "kg/s"),)
    return TaskClient(bus, data, bytes(8), "combine", 6000, 5000), bus


STATUS = bytes([0xFE, 0xFF, 0xFF, 0xFF, 0, 0, 0, 0])


def activated():
    made, bus = client()
    made.hear(0xCB00, STATUS, CONTROLLER, 0, {})
    for first in (0x10, 0x11, 0x51, 0x71, 0x91):
        made.hear(0xCB00, bytes([first, 0, 0, 0, 0, 0, 0, 0]), CONTROLLER, 0, {})
    assert made.is_active
    return made, bus


@pytest.mark.parametrize(
    ("refused", "said"),
    [(0x51, "to take a description, error 3"), (0x71, "the transfer"), (0x91, "the desc")],
)
def test_each_step_of_a_description_may_be_refused(refused, said):
    made, _ = client()
    made.hear(0xCB00, STATUS, CONTROLLER, 0, {})
    for first in (0x10, 0x11, 0x51, 0x71, 0x91):
        made.hear(0xCB00, bytes([first, 3 * (first == refused), 0, 0, 0, 0, 0, 0]), CONTROLLER, 0, {})
        if first == refused:
            break
    assert said in made.events[-1]
    assert "error 3" in made.events[-1]
    assert not made.is_active


def test_only_the_packets_that_are_asked_for_are_sent_again_where_some_were_lost():
    made, bus = client()
    made.hear(0xCB00, STATUS, CONTROLLER, 0, {})
    for first in (0x10, 0x11, 0x51):
        made.hear(0xCB00, bytes([first, 0, 0, 0, 0, 0, 0, 0]), CONTROLLER, 0, {})
    (rts,) = [d for pgn, d, _ in bus.sent if pgn == 0xEC00]
    size, count = int.from_bytes(rts[1:3], "little"), rts[3]
    assert (rts[0], size, count) == (16, len(made.pool) + 1, -(-(len(made.pool) + 1) // 7))
    parts = {}
    for number, first in ((3, 1), (2, 2), (255, 4)):
        bus.sent.clear()
        made.hear(0xEC00, bytes([17, number, first, 0xFF, 0xFF, 0x00, 0xCB, 0x00]), CONTROLLER, 0, {})
        got = {d[0]: d[1:] for pgn, d, _ in bus.sent if pgn == 0xEB00}
        assert min(got) == first
        assert len(got) == min(number, count - first + 1)
        parts |= got
    assert b"".join(parts[n] for n in sorted(parts))[:size] == bytes([0x61]) + made.pool


def test_a_controller_that_falls_silent_is_forgotten_and_found_again():
    made, bus = activated()
    made.hear(0xCB00, bytes([0x14, 0, 87, 0, 0xF4, 1, 0, 0]), CONTROLLER, 0, {87: 2.0})
    made.tick(NS, 0.0, {87: 2.0})
    assert (0xCB00, bytes([0x13, 0, 87, 0]) + (2_000_000).to_bytes(4, "little"), CONTROLLER) in bus.sent
    made.tick(7 * NS, 0.0, {87: 2.0})
    assert not made.is_active
    assert "is silent since 0 s" in made.events[-1]
    bus.sent.clear()
    made.tick(8 * NS, 0.0, {87: 2.0})
    assert bus.sent == []
    made.hear(0xCB00, STATUS, 99, 9 * NS, {})
    assert made.controller == 99
    assert [d[0] for pgn, d, _ in bus.sent] == [1, 0x00]


@pytest.mark.parametrize("seed", range(20))
def test_garbage_breaks_nothing_and_a_stranger_is_not_obeyed(seed):
    rng = np.random.default_rng(seed)
    made, bus = activated()
    for _ in range(300):
        pgn = int(rng.choice([0xCB00, 0xEC00, 0xEB00]))
        made.hear(pgn, rng.bytes(8), int(rng.choice([CONTROLLER, 3])), NS, {87: 1.0})
    bus.sent.clear()
    made, bus = activated()
    made.hear(0xCB00, bytes([0x12, 0, 87, 0, 0, 0, 0, 0]), 3, NS, {87: 1.0})
    assert [d for _, d, to in bus.sent if to == 3] == []


def test_a_run_on_the_command_line_has_the_machine_on_the_bus(tmp_path):
    where, out = own_bus(), tmp_path / "run"
    listener = open_bus(where)
    sets = ["combine.lidar=off", "combine.edge=truth", "run.max_duration_s=1"]
    words = [word for key in sets for word in ("--set", key)]
    bus = f"{where.interface}:{where.channel}"
    assert main(
        [
            "run",
            "feed-rate",
            "--isobus",
            bus,
            "--out",
            str(out),
            "--quiet",
            "--no-replay",
            "--no-report",
            *words,
        ]
    ) in (0, 1)
    frames = 0
    while listener.recv(0.0) is not None:
        frames += 1
    listener.shutdown()
    summary = json.loads((out / "summary.json").read_text())
    assert frames == summary["isobus"]["frames"] + 2 > 80
    assert run_unrecorded(load_scenario("feed-rate", sets=sets))["digest"] == summary["digest"]


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("can0", "--isobus = can0: expected INTERFACE:CHANNEL"),
        ("nope:can0", "interface = nope: expected one of"),
    ],
)
def test_a_bus_that_is_none_is_refused(word, said, tmp_path, capsys):
    assert main(["run", "feed-rate", "--isobus", word, "--out", str(tmp_path / "run")]) == 2
    assert said in capsys.readouterr().err


ORGANS = ["combine.process.level=organs", "combine.settings=fixed", "combine.crop_flow=counted"]


def with_organs(script, seconds=9.0, say=()):
    """The bundled scenario feed-rate with organs, changes and a task controller: (controller, run, world).

    say: proprietary messages that a box sends after 2 s: name, values
    """
    where = own_bus()
    controller, box = Controller(where, script), Node(where, 200, device_class=0)
    world = assemble(load_scenario("feed-rate", sets=[*QUICK, *ORGANS]))
    observers, changes, hook = [], Interventions(world), IsobusMachine(where)
    try:
        hook.begin(SimpleNamespace(world=world, observers=observers, changes=changes))
        controller.follow(hook, world.graph)
        drive(world, observers, until_s=2.0)
        for name, values in say:
            box.send(name, values)
        drive(world, observers, until_s=seconds)
        sent = []
        while (message := box.receive()) is not None:
            sent.append(message)
        hook.close()
        world.close()
    finally:
        controller.close()
        box.close()
    return controller, changes, sent


def test_a_task_controller_sets_the_organs_and_reads_what_they_come_to():
    script = [(4, 0, ddi, 500) for ddi in (243, 251, 255, 250)]
    script += [(3, 0, 250, 9), (3, 0, 254, 12_500), (3, 0, 242, 5), (3, 0, 246, 4_000), (3, 0, 251, 9)]
    script += [(2, 0, ddi, 0) for ddi in (252, 253, 256, 257)] + [(3, 0, 253, 9), (2, 1, 100, 0)]
    controller, changes, _ = with_organs(script)
    keys = {event["set"].rpartition(".")[2]: event["value"] for event in changes.events}
    assert keys == {"concave_mm": 9.0, "fan_rpm": 750.0, "lower_sieve_mm": 5.0}
    values = {
        ddi: [v for how, _, d, v in controller.values if (how, d) == (3, ddi)] for ddi in range(100, 258)
    }
    assert values[250][-1] == values[251][-1] == 9  # mm, set and come to
    assert values[251][0] > 9
    assert values[255][-1] == pytest.approx(12_500, abs=1)
    assert values[243][-1] == 5
    assert values[252] + values[253] == [1, 100]  # the least and the greatest that the setting takes [mm]
    assert values[256] + values[257] == [1, 5000 * 1000 // 60]
    assert values[100] == [2000]  # ppm: the least that the grain camera tells, nothing flows yet
    refused = [(ddi, v & 0xFF) for how, _, ddi, v in controller.values if how == 0xD]
    assert refused == [(246, 16), (251, 16), (253, 16)]  # further than a sieve opens; not to be set
    pool = {o["ddi"]: o["properties"] for o in read_pool(controller.pool).values() if o["kind"] == "DPD"}
    assert {ddi for ddi, flags in pool.items() if flags & 0b10} == {242, 246, 250, 254}
    assert {*range(242, 258), 93, 96, 98, 100} <= set(pool)


def test_drum_and_vanes_are_set_and_told_by_messages_of_their_own():
    """They have no DDI. The drum turns by 20 rpm more in a second, the vanes by 1 degree."""
    say = [("OrganCommand", {"DrumSpeedCommand": 640.0}), ("OrganCommand", {"VaneAngleCommand": 28.0})]
    _, changes, sent = with_organs([], seconds=9.0, say=say)
    assert {e["set"]: e["value"] for e in changes.events} == {
        "combine.settings.drum_rpm": 640.0,
        "combine.settings.vane_deg": 28.0,
    }
    told = [m.values for m in sent if m.name == "OrganStatus"]
    assert len(told) == 9
    assert told[0]["DrumSpeed"] != 640.0
    assert (told[-1]["DrumSpeed"], told[-1]["VaneAngle"]) == (640.0, 28.0)
    assert told[-1]["Returns"] > 0.0
    assert told[-1]["BrokenGrain"] >= 0.2
