"""No test asks a clock or a processor: what tests wait for are events, with a bound of minutes."""

import ast
import re
from pathlib import Path

import pytest

from tests.waiting import PATIENCE_S

TESTS = Path(__file__).parents[1]
CLOCKS = {"monotonic", "perf_counter", "process_time", "thread_time"}
CLOCKS |= {f"{name}_ns" for name in CLOCKS}
BOUNDS = {  # call: which of its arguments is a bound, where it has no name
    "join": 0, "wait": 0, "settimeout": 0, "receive": 0, "wait_for_service": 0, "wait_for": 1, "acquire": 1,
    "create_connection": 1,
}  # fmt: skip
NAMED = {"timeout", "timeout_s", "timeout_sec", "start_timeout_s", "wait_s", "answer_s", "open_timeout"}
LEAST_S = 60.0
SAYS = re.compile(
    r"time\b|timeout|_ns\b|monotonic|_counter|sleep|join\(\d|wait|receive|acquire|_connection|answer_s"
)
EXPIRES = "it is to expire: nothing is to come"
LOOKS = "how long one look takes of many"
EXCEPTIONS = {  # file, kind: why
    ("waiting.py", "clock"): "the wait itself",
    ("waiting.py", "sleep"): "between two looks",
    ("fuzz/attacks.py", "clock"): "a tool that measures how long an attack takes",
    ("fuzz/attacks.py", "sleep"): "between two looks at a process",
    ("fuzz/folders.py", "clock"): "a tool that ends what hangs",
    ("fuzz/folders.py", "sleep"): "between two looks at a process",
    ("fuzz/readers.py", "clock"): "a tool that measures",
    ("fuzz/run.py", "clock"): "a tool that measures",
    ("documents/bombs.py", "clock"): "tells what files cost that are made to cost much",
    ("whole/test_growth.py", "clock"): "cost against size is what is tested, the best of five",
    ("whole/links.py", "clock"): "prints how long a row took",
    ("proof/proof.py", "clock"): "prints how long a row took",
    ("tools/fake_work.py", "sleep"): "work that takes so long",
    ("tools/test_cluster.py", "bound"): "a stranger gets no answer",
    ("whole/test_sockets.py", "bound"): LOOKS,
    ("runtime/test_request_queue.py", "bound"): LOOKS,
    ("link/ros2_listener.py", "bound"): LOOKS,
    ("link/test_ros2_slots.py", "bound"): f"{LOOKS}; nobody answers",
    ("link/ros2_rig.py", "bound"): "a process that does not end by itself is killed",
    ("link/test_can.py", "bound"): f"{LOOKS}; a box that does not answer",
    ("link/test_can_udp.py", "bound"): EXPIRES,
    ("link/test_device_level.py", "bound"): "a device that is not there",
    ("link/test_fmi_runs.py", "bound"): "an FMU that does not answer",
}


def dotted(node):
    """`time.sleep` of such a call, `.join` of one of a thread."""
    if isinstance(node, ast.Attribute):
        return f"{node.value.id if isinstance(node.value, ast.Name) else ''}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def faults(text):
    """What a source asks or assumes of time: (line, kind)."""
    for node in ast.walk(ast.parse(text)) if SAYS.search(text) else ():
        name = dotted(node)
        if name.rpartition(".")[2] in CLOCKS or name in ("time.time", "time.time_ns"):
            yield node.lineno, "clock"
        if isinstance(node, ast.Call):
            called = dotted(node.func)
            if called in ("time.sleep", "sleep"):
                yield node.lineno, "sleep"
            place = BOUNDS.get(called.rpartition(".")[2])
            given = [word.value for word in node.keywords if word.arg in NAMED]
            given += [] if place is None else node.args[place : place + 1]
            values = [each.value for each in given if isinstance(each, ast.Constant)]
            if any(type(value) in (int, float) and 0 < value < LEAST_S for value in values):
                yield node.lineno, "bound"


def test_tests_wait_for_events_not_for_times():
    found = {}
    for path in sorted(TESTS.rglob("*.py")):
        name = path.relative_to(TESTS).as_posix()
        for line, kind in faults(path.read_text(encoding="utf-8")):
            found.setdefault((name, kind), []).append(line)
    assert {key: lines for key, lines in found.items() if key not in EXCEPTIONS} == {}
    assert EXCEPTIONS.keys() - found.keys() == set()
    assert PATIENCE_S >= LEAST_S


@pytest.mark.parametrize(
    ("text", "kinds"),
    [
        ("end = time.monotonic() + 20", ["clock"]),
        ("from time import perf_counter\nbegan = perf_counter()", ["clock"]),
        ("spent = time.process_time()\nnow = time.time()", ["clock", "clock"]),
        ("time.sleep(0.3)", ["sleep"]),
        ("thread.join(10)", ["bound"]),
        ("assert found.wait(0.5)", ["bound"]),
        ("box.settimeout(2.0)", ["bound"]),
        ("process.communicate(timeout=30)", ["bound"]),
        ("client.wait_for_service(timeout_sec=30.0)", ["bound"]),
        ("socket.create_connection(where, 5.0)", ["bound"]),
        ("process.wait(PATIENCE_S)\nthread.join()\nlink.recv(0.0)\nrun(timeout=600)", []),
        ("', '.join(names)\nclock.sleep(5)\nuntil(there, 'it is there')", []),
    ],
)
def test_what_breaks_the_rule_is_found(text, kinds):
    assert [kind for _, kind in faults(text)] == kinds
