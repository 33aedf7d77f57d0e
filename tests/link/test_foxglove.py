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

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
client = pytest.importorskip("websockets.sync.client")

from swath.link.foxglove import Foxglove  # noqa: E402
from tests.link.device_rig import free_port  # noqa: E402


class Viewer(threading.Thread):
    """Subscribes to every topic; messages by topic: (time [ns], bytes)."""

    def __init__(self, link):
        super().__init__(daemon=True)
        self.link = link
        self.channels, self.messages, self.times = {}, {}, []
        self.info = json.loads(self.link.recv(5))
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
        sets = ["run.distance_m=2", "combine.lidar.level=empirical", "realtime.pace=real_time"]
        watch = SimpleNamespace(begin=begin, summarize=hook.summarize, finish=hook.finish)
        result = run_job(load_scenario("straight", sets=sets), tmp_path / "run", hooks=[watch])
        viewer.join(0.5)
        hook.close()
        viewer.join(5.0)
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
    sets = ["run.distance_m=2", "combine.lidar.level=empirical", "realtime.pace=real_time"]
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
        begun = time.monotonic()
        result = run_job(load_scenario("straight", sets=sets), tmp_path / "run", hooks=[hook])
        took = time.monotonic() - begun
        time.sleep(0.5)
        hook.close()
        for viewer in viewers:
            viewer.join(5.0)
    alone = run_unrecorded(load_scenario("straight", sets=sets[:2]))
    assert result.summary["digest"] == alone["digest"]
    assert took < 20.0 + 3.0 * result.summary["simulated_s"]
    count = result.summary["foxglove"]["messages"]
    for viewer in viewers:
        assert sum(map(len, viewer.messages.values())) >= 0.9 * count


def test_a_port_in_use_and_an_address_that_is_none_are_one_error():
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(SwathError, match="could not listen"):
        Foxglove(f"127.0.0.1:{taken.getsockname()[1]}")
    with pytest.raises(InputError, match="expected host:port, such as 127"):
        Foxglove("8765")
