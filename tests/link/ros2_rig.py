"""What the ROS 2 tests share: is rclpy there, a domain of their own, processes written only with rclpy."""

import hashlib
import importlib.util
import itertools
import os
import platform
import subprocess
import sys
import tempfile
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from mcap.reader import make_reader

from swath.runtime.hooks import RunHook
from tests.waiting import PATIENCE_S, until

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
DOMAINS = 100  # those above take ports that Linux gives to others


@pytest.fixture
def domain(monkeypatch):
    """A ROS domain that no other test has, not of another run of the tests either, on this machine only."""
    with ExitStack() as held:
        number = until(lambda: _claimed(held), "a ROS domain is free")
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        yield number


def _claimed(held):
    """The next number of a domain, locked until `held` closes; 0 where somebody has it."""
    import fcntl

    number = 1 + (os.getpid() + next(_count)) % DOMAINS
    lock = os.open(Path(tempfile.gettempdir(), f"ros-domain-{number}.lock"), os.O_CREAT | os.O_RDWR)
    held.callback(os.close, lock)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return 0
    return number


def start(*command, also=None, **options):
    """A process of this Python that starts as from a shell; also: environment variables to set for it."""
    environment = {k: v for k, v in os.environ.items() if k not in LEAKS} | (also or {})
    environment["PYTHONPATH"] = os.pathsep.join((str(HERE.parents[1]), environment.get("PYTHONPATH", "")))
    texts = [str(part) for part in command]
    return subprocess.Popen([sys.executable, *texts], env=environment, text=True, **options)


class Heard(RunHook):
    """Each tick of a run waits until topics of a bridge have a listener. Stands behind the bridge."""

    def __init__(self, bridge, topics):
        self.bridge, self.topics = bridge, {*topics, "/clock"}

    def begin(self, run):
        run.world.graph.before_tick.append(lambda t: until(self.is_heard, "all topics have a listener"))

    def is_heard(self):
        return are_heard(self.bridge._node, self.topics)


def are_heard(node, topics):
    """Whether all of some topics, which a node publishes, have a listener."""
    counts = {p.topic_name: p.get_subscription_count() for p in node.publishers}
    return all(counts.get(topic) for topic in topics)


def all_taken(node):
    """Wait until listeners have all that a node has published."""
    from rclpy.duration import Duration

    for publisher in node.publishers:
        assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE_S)), publisher.topic_name


def hashes_of(folder, topic):
    """SHA-256 of messages as they travel, a multiple of 4 bytes long: of those of time 0, of those after."""
    with (folder / "run.mcap").open("rb") as file:
        messages = [(m.log_time, m.data) for _, _, m in make_reader(file).iter_messages(topics=[topic])]
    found = [], []
    for t, data in messages:
        found[t > 0].append(hashlib.sha256(bytes(data) + bytes(-len(data) % 4)).hexdigest())
    return found


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
