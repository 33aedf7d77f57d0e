"""A process written only with rclpy and standard services: acts on a run.

python ros2_caller.py REPORT.json '[["step"], ["set", "combine.speed.speed_kmh", 5], ...]'
"""

import json
import sys

import rclpy
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from tests.waiting import PATIENCE_S


def main(report, calls):
    rclpy.init()
    node = Node("caller")

    def call(kind, name, request):
        client = node.create_client(kind, f"/swath/{name}")
        assert client.wait_for_service(timeout_sec=PATIENCE_S), name
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=PATIENCE_S)
        node.destroy_client(client)
        return future.result()

    replies = []
    for what, *rest in calls:
        if what == "pause":
            reply = call(SetBool, "pause", SetBool.Request(data=rest[0]))
            replies.append([reply.success, reply.message])
        elif what in ("step", "reset", "save", "branch"):
            reply = call(Trigger, what, Trigger.Request())
            replies.append([reply.success, reply.message])
        elif what == "set":
            wanted = Parameter(rest[0], value=rest[1]).to_parameter_msg()
            reply = call(SetParameters, "set_parameters", SetParameters.Request(parameters=[wanted])).results[
                0
            ]
            replies.append([reply.successful, reply.reason])
        elif what == "get":
            value = call(GetParameters, "get_parameters", GetParameters.Request(names=[rest[0]])).values[0]
            replies.append([value.type, value.string_value, value.double_value])
    with open(report, "w", encoding="utf-8") as file:
        json.dump(replies, file)


if __name__ == "__main__":
    main(sys.argv[1], json.loads(sys.argv[2]))
