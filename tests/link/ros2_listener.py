"""A process written only with rclpy and standard messages: listens to a run, and lets it go.

    python ros2_listener.py REPORT.json [--no-pause] TOPIC=package/Type ...

Takes every message as its raw bytes. Its standard input says as JSON what the last one of each topic is: the
SHA-256 of the bytes, and of /clock the time [ns]. Beside that a timer by ROS time, with
use_sim_time, notes when it fires.
"""

import hashlib
import importlib
import json
import sys
import threading

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from tests.waiting import PATIENCE_S, until

QUIET_S = 0.5


def call(node, executor, kind, name, request):
    client = node.create_client(kind, name)
    assert client.wait_for_service(timeout_sec=PATIENCE_S), name
    future = client.call_async(request)
    executor.spin_until_future_complete(future, timeout_sec=PATIENCE_S)
    return future.result()


def main(report, wanted, has_pause):
    rclpy.init()
    simulated = Parameter("use_sim_time", value=True)
    node = Node("listener", parameter_overrides=[simulated])
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    got, clocks, fired = {topic: [] for topic, _ in wanted}, [], []
    for topic, kind in wanted:
        package, name = kind.split("/")
        message = getattr(importlib.import_module(f"{package}.msg"), name)
        take = got[topic].append
        node.create_subscription(message, topic, take, QoSProfile(depth=500), raw=True)
    node.create_subscription(
        Clock, "/clock", lambda m: clocks.append(m.clock.sec * 10**9 + m.clock.nanosec), 500
    )

    def spin(holds, what):
        until(lambda: executor.spin_once(timeout_sec=0.05) or holds(), what, pause_s=0)

    spin(lambda: all(node.count_publishers(topic) for topic in got), "all topics are published")
    before = 0
    if has_pause:
        node.create_timer(0.1, lambda: fired.append(node.get_clock().now().nanoseconds))
        quiet = threading.Event()
        threading.Timer(QUIET_S, quiet.set).start()
        spin(quiet.is_set, "the pause has lasted a while")
        before = len(fired)
    reply = SetBool.Response()
    if has_pause:
        reply = call(node, executor, SetBool, "/swath/pause", SetBool.Request(data=False))
    last = []
    threading.Thread(target=lambda: last.append(json.load(sys.stdin)), daemon=True).start()
    spin(lambda: last, "the run is over")

    def have_come():
        newest = {topic: hashlib.sha256(m[-1]).hexdigest() for topic, m in got.items() if m}
        newest["/clock"] = clocks[-1] if clocks else None
        return all(newest.get(topic) == wanted for topic, wanted in last[0].items())

    spin(have_come, "the last message of each topic")
    found = {
        "reply": reply.message,
        "clock": clocks,
        "fired_in_pause": before,
        "fired": fired[before:],
        "got": {topic: [hashlib.sha256(m).hexdigest() for m in messages] for topic, messages in got.items()},
    }
    with open(report, "w", encoding="utf-8") as file:
        json.dump(found, file)


if __name__ == "__main__":
    pairs = [pair.split("=") for pair in sys.argv[2:] if "=" in pair]
    main(sys.argv[1], pairs, has_pause="--no-pause" not in sys.argv)
