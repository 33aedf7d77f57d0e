"""What needs no ROS: the desk between two threads, pauses of a paced run, a missing rclpy."""

import importlib.util
import threading

import pytest

from swath.commands.main import main
from swath.core.errors import SwathError
from swath.runtime.pacing import Pacer
from swath.runtime.run_control import RequestQueue
from swath.scenario.sections import RealTime
from tests.waiting import PATIENCE_S, ended


def asked(desk, *actions):
    """Ask from another thread; the replies once it is over."""
    replies = []
    thread = threading.Thread(target=lambda: replies.extend(desk.ask(a) for a in actions), daemon=True)
    thread.start()
    return thread, replies


def test_requests_are_done_by_the_thread_that_serves_in_their_order():
    desk, done = RequestQueue(), []

    def act(name):
        def action(t):
            done.append((name, t, threading.current_thread()))
            return name

        return action

    def refuse(t):
        raise SwathError("not now")

    thread, replies = asked(desk, act("a"), refuse, act("b"))
    while thread.is_alive():
        desk.serve(7, wait_s=0.1)
    assert replies == [(True, "a"), (False, "not now"), (True, "b")]
    assert done == [("a", 7, threading.main_thread()), ("b", 7, threading.main_thread())]


def test_what_is_no_refusal_ends_the_run_and_a_closed_desk_turns_away():
    desk = RequestQueue()

    def fail(t):
        raise ZeroDivisionError("oops")

    thread, replies = asked(desk, fail)
    with pytest.raises(ZeroDivisionError):
        desk.serve(0, wait_s=PATIENCE_S)
    ended(thread)
    assert replies == [(True, "oops")]
    late, refusals = asked(desk, fail)
    desk.close()
    ended(late)
    assert refusals == [(False, "the run is over")]


def test_a_pause_is_no_lateness():
    class Clock:
        time = 0

        def now(self):
            return self.time

        def sleep(self, duration):
            self.time += duration

    clock = Clock()
    pacer = Pacer(RealTime(grace_s=0.0), clock=clock)
    for tick in range(1, 4):
        pacer(tick * 10_000_000)
    clock.time += 5_000_000_000
    pacer.rest(5_000_000_000)
    for tick in range(4, 8):
        pacer(tick * 10_000_000)
    assert pacer.report()["overruns"] == 0
    assert pacer.report()["max_late_ms"] == 0.0


def test_without_rclpy_one_line_says_what_to_install(monkeypatch, capsys, tmp_path):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n, *a: None if n == "rclpy" else find(n, *a))
    monkeypatch.chdir(tmp_path)
    assert main(["run", "straight", "--ros2"]) == 2
    assert capsys.readouterr().err == (
        "swath: the ROS 2 bridge needs an optional part: pip install 'swath[ros2]'\n"
    )
    assert main(["run", "straight", "--paused"]) == 2
    assert not list(tmp_path.iterdir())
