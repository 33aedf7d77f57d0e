"""A run as a Foxglove WebSocket, heard by a client of the published protocol (foxglove.sdk.v1)."""

import json
import re
import socket
import struct
import threading
import time
from contextlib import ExitStack, suppress
from types import SimpleNamespace

import pytest

from swath.core.errors import InputError, SwathError
from swath.runtime.job import run_job, run_unrecorded
from swath.scenario.scenario import load_scenario

client = pytest.importorskip("websockets.sync.client")
from websockets.exceptions import InvalidStatus  # noqa: E402

from swath.core.foreign_code import allow_code  # noqa: E402
from swath.link.foxglove import Foxglove  # noqa: E402
from swath.runtime.served import MOST  # noqa: E402
from tests.link.device_rig import free_port  # noqa: E402


class Viewer(threading.Thread):
    """Subscribes to every topic; messages by topic: (time [ns], bytes)."""

    def __init__(self, link):
        super().__init__(daemon=True)
        self.link = link
        self.channels, self.messages, self.times = {}, {}, []
        self.info = json.loads(self.link.recv(300))
        self.start()

    def run(self):
        for frame in self.link:
            if isinstance(frame, str):
                told = json.loads(frame)
                for channel in told.get("channels", []):
                    self.subscribe(channel)
                if told.get("op") == "status" and "nknown" in told["message"]:  # too new
                    time.sleep(0.02)
                    named = {int(number) for number in re.findall(r"\d+", told["message"])}
                    for channel in [c for c in self.channels.values() if c["id"] in named][-1:]:
                        self.subscribe(channel)
            elif frame[0] == 1:
                number, t = struct.unpack("<IQ", frame[1:13])
                topic = self.channels[number]["topic"]
                self.messages.setdefault(topic, []).append((t, frame[13:]))
            elif frame[0] == 2:
                self.times.append(struct.unpack("<Q", frame[1:9])[0])

    def subscribe(self, channel):
        number = len(self.channels) + 1
        if number < 2000:
            self.channels[number] = channel
            wanted = [{"id": number, "channelId": channel["id"]}]
            self.link.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


def test_a_viewer_gets_what_the_recording_gets(tmp_path):
    port = free_port()
    hook = Foxglove(f"127.0.0.1:{port}")
    recorded = {}

    def tap(topic, t, data, build, is_latched):
        recorded.setdefault(topic, []).append((t, data))

    def begin(run):
        Foxglove.begin(hook, run)
        run.recorder.file.taps.append(tap)

    with client.connect(hook.address, subprotocols=["foxglove.sdk.v1"], max_size=None) as link:
        viewer = Viewer(link)
        assert viewer.info["name"] == "swath"
        assert viewer.info["capabilities"] == ["time"]  # nothing that could change the run
        sets = ["run.distance_m=0.5", "combine.lidar.level=empirical", "realtime.pace=real_time"]
        watch = SimpleNamespace(begin=begin, summarize=hook.summarize, finish=hook.finish)
        result = run_job(load_scenario("straight", sets=sets), tmp_path / "run", hooks=[watch])
        viewer.join(0.5)
        hook.close()
        viewer.join(300.0)
    count = result.summary["foxglove"]["messages"]
    assert count == sum(map(len, recorded.values()))
    kinds = {
        c["topic"]: (c["encoding"], c["schemaName"], c["schemaEncoding"]) for c in viewer.channels.values()
    }
    assert kinds["/combine/lidar/scan"] == ("cdr", "sensor_msgs/msg/LaserScan", "ros2msg")
    late = {"/tf_static", "/robot_description", "/combine/field_markers"} & recorded.keys()
    assert late, "latched topics, which were sent before anybody could subscribe"
    for topic, sent in recorded.items():
        assert set(viewer.messages.get(topic, [])) <= set(sent)
        assert viewer.messages[topic][-1] == sent[-1], topic
    assert sum(map(len, viewer.messages.values())) >= 0.9 * count
    assert viewer.times == sorted(viewer.times)


def test_viewers_that_hang_or_talk_nonsense_hold_nothing_up_and_change_nothing(tmp_path):
    """One only connects, one subscribes and never reads, one sends what is no message; two that look."""
    hook = Foxglove(f"127.0.0.1:{free_port()}")
    sets = ["run.distance_m=0.5", "combine.lidar.level=empirical", "realtime.pace=real_time"]
    where = ("127.0.0.1", int(hook.address.rpartition(":")[2]))
    words = {"subprotocols": ["foxglove.sdk.v1"], "max_size": None, "close_timeout": 0.5}
    with ExitStack() as held:
        held.enter_context(socket.create_connection(where)).sendall(b"\x00\xff no HTTP \r\n\r\n")
        hung = held.enter_context(client.connect(hook.address, max_queue=1, **words))
        wanted = [{"id": n, "channelId": n} for n in range(1, 40)]
        hung.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        rude = held.enter_context(client.connect(hook.address, **words))
        viewers = [Viewer(held.enter_context(client.connect(hook.address, **words))) for _ in range(2)]
        nonsense = ["{", "[]", json.dumps({"op": "setParameters", "parameters": [{"name": "x", "value": 1}]})]
        nonsense += [
            json.dumps({"op": "advertise", "channels": [{"id": 1, "topic": "/x", "encoding": "cdr"}]})
        ]
        for message in [*nonsense, b"", b"\x01" + bytes(4), b"\xff" * 1000]:
            with suppress(Exception):  # it may be let go for that
                rude.send(message)
        result = run_job(load_scenario("straight", sets=sets), tmp_path / "run", hooks=[hook])
        time.sleep(0.5)
        hook.close()
        for viewer in viewers:
            viewer.join(300.0)
    alone = run_unrecorded(load_scenario("straight", sets=sets[:2]))
    assert result.summary["digest"] == alone["digest"]
    count = result.summary["foxglove"]["messages"]
    for viewer in viewers:
        assert sum(map(len, viewer.messages.values())) >= 0.9 * count


def test_a_port_in_use_and_an_address_that_is_none_are_one_error():
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(SwathError, match="could not listen"):
        Foxglove(f"127.0.0.1:{taken.getsockname()[1]}")
    with pytest.raises(InputError, match="expected host:port, such as 127"):
        Foxglove("8765")


@pytest.mark.parametrize("name", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
@pytest.mark.parametrize(("origin", "comes_in"), [
    (None, True), ("https://app.foxglove.dev", True), ("http://localhost:8080", True), ("file://", True),
    ("https://mine.example", True), ("null", False), ("https://app.foxglove.dev.example", False),
    ("http://127.0.0.1.example:8765", False), ("https://mineXexample", False),
])  # fmt: skip
def test_only_pages_of_the_viewers_and_of_this_machine_come_in(name, origin, comes_in):
    with allow_code((), addresses=["https://mine.example"]):
        hook = Foxglove("127.0.0.1:0")
    try:
        if comes_in:
            with client.connect(hook.address, subprotocols=[name], origin=origin) as link:
                assert json.loads(link.recv(5))["op"] == "serverInfo"
                assert link.subprotocol == name
        else:
            with (
                pytest.raises(InvalidStatus) as refused,
                client.connect(hook.address, subprotocols=[name], origin=origin),
            ):
                pass
            assert refused.value.response.status_code == 403
    finally:
        hook.close()


def test_a_flood_takes_no_more_than_its_places_and_the_run_ends():
    """Connections that say nothing, that stop amid a request, and viewers that never read or close."""
    hook, before = Foxglove("127.0.0.1:0"), threading.active_count()
    where = ("127.0.0.1", int(hook.address.rpartition(":")[2]))
    with ExitStack() as held:
        for n in range(MOST // 2):
            half = held.enter_context(socket.create_connection(where, 5.0))
            half.sendall(b"" if n % 2 else b"GET / HTTP/1.1\r\nHost: ")
        for _ in range(MOST // 2):
            link = client.connect(hook.address, subprotocols=["foxglove.sdk.v1"], close_timeout=0.1)
            held.callback(link.socket.close)
        late = [held.enter_context(socket.create_connection(where, 5.0)) for _ in range(300)]
        for connection in late:
            with suppress(ConnectionResetError):
                assert connection.recv(1) == b""
        assert threading.active_count() < before + 8 * MOST
        ends = threading.Thread(target=hook.close, daemon=True)
        ends.start()
        ends.join(60)
        assert not ends.is_alive()
