"""How late the ticks of a paced run begin, with and without recording, ROS 2 and SCHED_FIFO.

Only an idle machine says what swath itself costs: the load is printed, and what other work takes from the
run's core counts as lateness, unless the system grants a priority (`--priority 50`).
"""

import argparse
import json
import os
import tempfile
from pathlib import Path
from typing import Any

from _harness import machine

LATE_MS = 1.0
RUNS = {
    "demo, empirical": ["combine.lidar.level=empirical"],
    "demo, empirical, no files": ["combine.lidar.level=empirical", "run.record=none"],
    "demo, plants": [],
}


def lateness(sets: list[str], seconds: float, priority: int, *, with_ros2: bool) -> dict[str, Any]:
    """Ticks, and how many began later than LATE_MS behind the grace."""
    from swath.runtime.job import run_job
    from swath.scenario.scenario import load_scenario

    more = ["realtime.pace=real_time", f"run.max_duration_s={seconds}", *sets]
    more += [f"realtime.priority={priority}"] if priority else []
    hooks: list[Any] = []
    if with_ros2:
        from swath.link.ros2.bridge import Bridge

        hooks.append(Bridge())
    with tempfile.TemporaryDirectory() as folder:
        try:
            summary = run_job(load_scenario("laser-pilot", sets=more), Path(folder), hooks=hooks).summary
        finally:
            for hook in hooks:
                hook.close()
    told = summary["realtime"]
    late = sum(count for name, count in told["late"].items() if name not in ("up to 0.1 ms", "up to 1 ms"))
    return {**told, "late_count": late, "share": late / told["ticks"]}


def main() -> None:
    """Measure, print, write paced.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, nargs="?", default=Path("out/bench"))
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--priority", type=int, default=0, help="of SCHED_FIFO, where the system grants it")
    args = parser.parse_args()
    found: dict[str, Any] = {"machine": machine(), "load": os.getloadavg()}
    cases = [(name, sets, False) for name, sets in RUNS.items()]
    try:
        import rclpy  # noqa: F401

        cases.append(("demo, empirical, ROS 2", RUNS["demo, empirical"], True))
    except ImportError:
        print("ROS 2: rclpy is not installed")
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    print(f"load {found['load'][0]:.1f}; late: by more than {LATE_MS:g} ms")
    for name, sets, with_ros2 in cases:
        row = lateness(sets, args.seconds, args.priority, with_ros2=with_ros2)
        found[name] = row
        print(
            f"{name:<26} {row['scheduling']:<10} {row['late_count']:>4} of {row['ticks']} ticks late "
            f"({100 * row['share']:.2f} %), latest {row['max_late_ms']:.1f} ms"
        )
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "paced.json").write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
