"""ROS 2: round trip of a slot in lock-step, what the bridge costs, whether a reader gets every message.

The node and the reader are processes written only with rclpy. CPU seconds are those of swath's process.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from _harness import machine

from swath.core.errors import SwathError
from swath.runtime.assembly import assemble
from swath.runtime.job import run_job
from swath.scenario.scenario import load_scenario, parse_scenario
from swath.signals import CropEdge, Odometry

ROOT = Path(__file__).parents[1]
LISTENED = {"/combine/lidar/scan": "sensor_msgs/LaserScan", "/combine/odometry/odometry": "nav_msgs/Odometry"}
LEAKS = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
STEPS = 3000
DEMO = ["combine.lidar.rate_hz=50"]


def main(out: Path, loss_s: float = 300.0, cost_s: float = 20.0) -> None:
    try:
        import rclpy  # noqa: F401
    except ImportError:
        print("ros2: rclpy is not installed")
        return
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(os.getpid() % 100 + 1)
    found = {"machine": machine(), "lock_step": lock_step(), "cost": cost(cost_s), "loss": loss(loss_s)}
    out.mkdir(parents=True, exist_ok=True)
    (out / "ros2.json").write_text(json.dumps(found, indent=2))


def lock_step() -> dict[str, float]:
    """Wall time of a step of `steer` that a node plays [ms]."""
    scenario = parse_scenario(
        "name: b\nfield: {edge: {shape: straight}}\ncombine: {lidar: off, edge: truth, steer: ros2}"
    )
    world = assemble(scenario)
    steer = world.machines["combine"].parts["steer"]
    node = _start(ROOT / "examples" / "ros2" / "steering_node.py")
    try:
        steer.reset(None)
        edge, odometry = CropEdge(0, 6.0, 0.0, 0.0, 8.0, 1.0, 0.7, 0.1), Odometry(0, 2.0, 0.0, 0.0)
        times = []
        for k in range(STEPS):
            t = 20_000_000 * (k + 1)
            inputs = {"edge": replace(edge, t=t), "odometry": replace(odometry, t=t)}
            started = time.perf_counter()
            steer.step(t - 20_000_000, 20_000_000, inputs)
            times.append(1e3 * (time.perf_counter() - started))
    finally:
        world.close()
        node.terminate()
    times.sort()
    result = {
        "median_ms": statistics.median(times),
        "p95_ms": times[int(0.95 * STEPS)],
        "p99_ms": times[int(0.99 * STEPS)],
        "max_ms": times[-1],
    }
    print("lock-step round trip: " + ", ".join(f"{k} {v:.2f}" for k, v in result.items()))
    return result


def cost(simulated_s: float) -> dict[str, float]:
    """The demo at 50 scans a second, with and without the bridge: CPU and wall time per simulated second."""
    from swath.link.ros2.bridge import Bridge

    sets = [*DEMO, f"run.max_duration_s={simulated_s}"]
    taken: dict[str, list[tuple[float, float]]] = {"alone": [], "bridge": []}
    with tempfile.TemporaryDirectory() as folder:
        run_job(load_scenario("laser-pilot", sets=[*DEMO, "run.max_duration_s=1"]), Path(folder))
        for _ in range(3):
            for name, times in taken.items():
                bridge = Bridge() if name == "bridge" else None
                cpu, wall = time.process_time(), time.perf_counter()
                run_job(load_scenario("laser-pilot", sets=sets), Path(folder), hooks=[bridge])
                times.append((time.process_time() - cpu, time.perf_counter() - wall))
                if bridge is not None:
                    bridge.close()
    best = {name: [min(column) for column in zip(*times, strict=True)] for name, times in taken.items()}
    result = {
        "cpu_s_per_s_alone": best["alone"][0] / simulated_s,
        "cpu_s_per_s_bridge": best["bridge"][0] / simulated_s,
        "cpu_cost_percent": 100.0 * (best["bridge"][0] / best["alone"][0] - 1.0),
        "wall_cost_percent": 100.0 * (best["bridge"][1] / best["alone"][1] - 1.0),
    }
    print("bridge beside the demo: " + ", ".join(f"{k} {v:.2f}" for k, v in result.items()))
    return result


def loss(simulated_s: float) -> dict[str, float]:
    """Messages of the slow demo that a reader in another process missed or got twice."""
    from mcap.reader import make_reader

    from swath.link.ros2.bridge import Bridge

    sets = [*DEMO, f"run.max_duration_s={simulated_s}", "combine.speed.speed_kmh=1.5"]
    with tempfile.TemporaryDirectory() as folder:
        report, run = Path(folder) / "report.json", Path(folder) / "run"
        pairs = [f"{topic}={kind}" for topic, kind in LISTENED.items()]
        reader = _start(
            ROOT / "tests" / "link" / "ros2_listener.py", report, *pairs, stdin=subprocess.PIPE, text=True
        )
        bridge = Bridge(is_paused=True)
        started = time.perf_counter()
        try:
            summary = run_job(load_scenario("laser-pilot", sets=sets), run, hooks=[bridge]).summary
            reader.communicate("", timeout=120)
        except (SwathError, subprocess.TimeoutExpired):
            reader.kill()
            raise
        finally:
            bridge.close()
        wall = time.perf_counter() - started
        got = json.loads(report.read_text())["got"]
        with (run / "run.mcap").open("rb") as file:
            counts = make_reader(file).get_summary().statistics.channel_message_counts
            file.seek(0)
            channels = {c.topic: i for i, c in make_reader(file).get_summary().channels.items()}
        sent = {topic: counts[channels[topic]] - 1 for topic in LISTENED}  # without that at t = 0
    result = {
        "simulated_s": summary["simulated_s"],
        "wall_s": wall,
        "sent": sum(sent.values()),
        "got": sum(len(g) for g in got.values()),
        "distinct": sum(len(set(g)) for g in got.values()),
    }
    print("reader of scans and odometry: " + ", ".join(f"{k} {v:.0f}" for k, v in result.items()))
    return result


def _start(*command: object, **options: object) -> subprocess.Popen:
    environment = {k: v for k, v in os.environ.items() if k not in LEAKS}
    return subprocess.Popen([sys.executable, *map(str, command)], env=environment, **options)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/bench"))
