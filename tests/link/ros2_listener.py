"""A process written only with rclpy and standard messages: listens to a run, and lets it go.

    python ros2_listener.py REPORT.json [--no-pause] TOPIC=package/Type ...

Takes every message as its raw bytes until its standard input ends. Beside that a timer by ROS time, with
use_sim_time, notes when it fires.
"""

import hashlib
import importlib
import json
import sys
import threading
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

QUIET_S = 0.5


def call(node, executor, kind, name, request):
    client = node.create_client(kind, name)
    assert client.wait_for_service(timeout_sec=60.0), name
    future = client.call_async(request)
    executor.spin_until_future_complete(future, timeout_sec=60.0)
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
    end = time.monotonic() + 60.0
    while any(node.count_publishers(topic) == 0 for topic in got) and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    before = 0
    if has_pause:
        time.sleep(QUIET_S)
        node.create_timer(0.1, lambda: fired.append(node.get_clock().now().nanoseconds))
        pause_end = time.monotonic() + QUIET_S
        while time.monotonic() < pause_end:
            executor.spin_once(timeout_sec=0.05)
        before = len(fired)
        for messages in got.values():
            messages.clear()
    reply = SetBool.Response()
    if has_pause:
        reply = call(node, executor, SetBool, "/swath/pause", SetBool.Request(data=False))
    over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
    while not over.is_set():
        executor.spin_once(timeout_sec=0.05)
    late = time.monotonic() + 0.5
    while time.monotonic() < late:
        executor.spin_once(timeout_sec=0.05)
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
