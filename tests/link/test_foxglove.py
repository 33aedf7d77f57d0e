"""A run as a Foxglove WebSocket, heard by a client of the published protocol (foxglove.sdk.v1)."""

import json
import socket
import struct
import threading
from contextlib import ExitStack, suppress
from functools import partial
from types import SimpleNamespace

import pytest

from swath.core.errors import InputError, SwathError
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job, run_unrecorded
from swath.scenario.scenario import load_scenario
from tests.waiting import PATIENCE_S, ended, until

connect = partial(pytest.importorskip("websockets.sync.client").connect, open_timeout=PATIENCE_S)
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
        self.info = json.loads(self.link.recv(PATIENCE_S))
        self.start()

    def run(self):
        for frame in self.link:
            if isinstance(frame, str):
                told = json.loads(frame)
                for channel in told.get("channels", []):
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


class Follow(RunHook):
    """Each tick waits until so many viewers have subscribed to all topics; they may lag behind."""

    def __init__(self, foxglove, count, monkeypatch):
        monkeypatch.setattr("swath.link.foxglove.BACKLOG", None)
        self.foxglove, self.count = foxglove, count

    def begin(self, run):
        run.world.graph.before_tick.append(lambda t: until(self.have_subscribed, "they have subscribed"))

    def have_subscribed(self):
        numbers = {channel.number for channel in self.foxglove._channels.values()}
        return sum(numbers <= set(client.wanted) for client in list(self.foxglove._clients)) >= self.count


def test_a_viewer_gets_what_the_recording_gets(tmp_path, monkeypatch):
    port = free_port()
    hook = Foxglove(f"127.0.0.1:{port}")
    follow, recorded = Follow(hook, 1, monkeypatch), {}

    def tap(topic, t, data, build, is_latched):
        recorded.setdefault(topic, []).append((t, data))

    def begin(run):
        Foxglove.begin(hook, run)
        run.recorder.file.taps.append(tap)

    with connect(hook.address, subprotocols=["foxglove.sdk.v1"], max_size=None) as link:
        viewer = Viewer(link)
        assert viewer.info["name"] == "swath"
        assert viewer.info["capabilities"] == ["time"]  # nothing that could change the run
        sets = ["run.distance_m=0.5", "combine.lidar.level=empirical", "realtime.pace=real_time"]
        watch = SimpleNamespace(begin=begin, summarize=hook.summarize, finish=hook.finish)
        result = run_job(load_scenario("straight", sets=sets), tmp_path / "run", hooks=[watch, follow])
        newest = {topic: sent[-1] for topic, sent in recorded.items()}
        until(lambda: newest == {t: heard[-1] for t, heard in dict(viewer.messages).items()}, "the newest")
        hook.close()
        ended(viewer)
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
    assert sum(map(len, viewer.messages.values())) >= 0.9 * count
    assert viewer.times == sorted(viewer.times)


def test_viewers_that_hang_or_talk_nonsense_hold_nothing_up_and_change_nothing(tmp_path, monkeypatch):
    """One only connects, one subscribes and never reads, one sends what is no message; two that look."""
    hook = Foxglove(f"127.0.0.1:{free_port()}")
    follow = Follow(hook, 2, monkeypatch)
    sets = ["run.distance_m=0.5", "combine.lidar.level=empirical", "realtime.pace=real_time"]
    where = ("127.0.0.1", int(hook.address.rpartition(":")[2]))
    words = {"subprotocols": ["foxglove.sdk.v1"], "max_size": None, "close_timeout": 0.5}
    with ExitStack() as held:
        held.enter_context(socket.create_connection(where)).sendall(b"\x00\xff no HTTP \r\n\r\n")
        hung = held.enter_context(connect(hook.address, max_queue=1, **words))
        wanted = [{"id": n, "channelId": n} for n in range(1, 40)]
        hung.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        rude = held.enter_context(connect(hook.address, **words))
        viewers = [Viewer(held.enter_context(connect(hook.address, **words))) for _ in range(2)]
        nonsense = ["{", "[]", json.dumps({"op": "setParameters", "parameters": [{"name": "x", "value": 1}]})]
        nonsense += [
            json.dumps({"op": "advertise", "channels": [{"id": 1, "topic": "/x", "encoding": "cdr"}]})
        ]
        for message in [*nonsense, b"", b"\x01" + bytes(4), b"\xff" * 1000]:
            with suppress(Exception):  # it may be let go for that
                rude.send(message)
        result = run_job(load_scenario("straight", sets=sets), tmp_path / "run", hooks=[hook, follow])
        most = result.summary["foxglove"]["messages"]
        for viewer in viewers:
            until(
                lambda viewer=viewer: sum(map(len, viewer.messages.values())) >= 0.9 * most, "most messages"
            )
        hook.close()
        for viewer in viewers:
            ended(viewer)
    alone = run_unrecorded(load_scenario("straight", sets=sets[:2]))
    assert result.summary["digest"] == alone["digest"]


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
            with connect(hook.address, subprotocols=[name], origin=origin) as link:
                assert json.loads(link.recv(PATIENCE_S))["op"] == "serverInfo"
                assert link.subprotocol == name
        else:
            with (
                pytest.raises(InvalidStatus) as refused,
                connect(hook.address, subprotocols=[name], origin=origin),
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
            half = held.enter_context(socket.create_connection(where, PATIENCE_S))
            half.sendall(b"" if n % 2 else b"GET / HTTP/1.1\r\nHost: ")
        for _ in range(MOST // 2):
            link = connect(hook.address, subprotocols=["foxglove.sdk.v1"], close_timeout=0.1)
            held.callback(link.socket.close)
        late = [held.enter_context(socket.create_connection(where, PATIENCE_S)) for _ in range(300)]
        for connection in late:
            with suppress(ConnectionResetError):
                assert connection.recv(1) == b""
        assert threading.active_count() < before + 8 * MOST
        ends = threading.Thread(target=hook.close, daemon=True)
        ends.start()
        ended(ends)
