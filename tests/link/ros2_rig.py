"""What the ROS 2 tests share: is rclpy there, a domain of their own, processes written only with rclpy."""

import importlib.util
import itertools
import os
import platform
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples" / "ros2"
LEAKS = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")  # what the start of the wheels leaves behind

needs_ros2 = [
    pytest.mark.skipif(
        importlib.util.find_spec("rclpy") is None,
        reason=f"rclpy is not installed (extra ros2) on {platform.system()} {platform.machine()}",
    ),
    pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning"),  # of lark, which rclpy imports
]

CHEAP = """
format: swath scenario 2
name: cheap
run: {{distance_m: 500, max_duration_s: {seconds}}}
field:
  terrain: {{level: formula, slope_percent: 2.0}}
  edge: {{shape: curve, run_in_m: 45, radius_m: 60, angle_deg: 40, run_out_m: 600}}
machines:
  combine:
    motion: {{level: single_track, start_speed_kmh: 7}}
    lidar: off
    edge: truth
    speed: {{speed_kmh: 7}}
    steer: {{{steer}}}
"""

_count = itertools.count()


@pytest.fixture
def domain(monkeypatch):
    """A ROS domain that no other test has, on this machine only."""
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % 4
    number = 1 + 25 * worker + (os.getpid() + next(_count)) % 25
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    return number


def start(*command, also=None, **options):
    """A process of this Python that starts as from a shell; also: environment variables to set for it."""
    environment = {k: v for k, v in os.environ.items() if k not in LEAKS} | (also or {})
    texts = [str(part) for part in command]
    return subprocess.Popen([sys.executable, *texts], env=environment, text=True, **options)


@contextmanager
def node(*command, **options):
    """The process of a node; it is ended, so that it can give its shared memory back, or killed."""
    process = start(*command, **options)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
        process.communicate()
