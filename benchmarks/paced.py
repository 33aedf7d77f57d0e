"""How late the ticks of a paced run begin, with and without recording, ROS 2 and SCHED_FIFO, and their cost.

Only an idle machine says by wall clock what swath itself costs: the load is printed, and what other work
takes from the run's core counts as lateness, unless the system grants a priority (`--priority 50`). The first
row is the same ticks without any work: what the machine itself is late by. CPU time of the ticks says who
used it on a busy machine too; `--ticks` lists those that used more than a period.
"""

import argparse
import json
import os
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from _harness import machine

from swath.core.graph import Observer
from swath.runtime.hooks import ActiveRun, RunHook

LATE_MS = 1.0
TICK_MS = 5.0  # period of the schedule
GRACE_S = 1.0
RUNS = {
    "demo, empirical": ["combine.lidar.level=empirical"],
    "demo, empirical, no files": ["combine.lidar.level=empirical", "run.record=none"],
    "demo, plants": [],
}


class TickCosts(RunHook):
    """CPU time of this thread in every tick, by slot and by who looks on. Give it as last hook.

    What is written or made in advance between two ticks is no part of them. Of rays it holds what this thread
    casts itself, not what others cast meanwhile.

    ticks: time [s] -> part -> CPU time [ms]
    """

    def __init__(self) -> None:
        self.ticks: dict[float, Counter[str]] = {}

    def begin(self, run: ActiveRun) -> None:
        """Look on before the first and after the last of the observers."""
        costs, since = Counter[str](), time.thread_time()

        def tick(t: int) -> None:
            nonlocal costs, since
            costs = self.ticks[t * 1e-9] = Counter()
            since = time.thread_time()

        def add(part: str) -> None:
            nonlocal since
            now = time.thread_time()
            costs[part] += 1e3 * (now - since)
            since = now

        def probe(part: str) -> Observer:
            return lambda slot, t, outputs: add(part or slot)

        run.world.graph.before_tick.append(tick)
        seen = [(type(observer).__name__.lower(), observer) for observer in run.observers]
        run.observers[:] = [probe(""), *(o for part, each in seen for o in (each, probe(part)))]

    def report(self) -> dict[str, Any]:
        """Sums of ticks after the grace [ms], and how many used more than a period, by who used most."""
        late = {t: costs for t, costs in self.ticks.items() if t > GRACE_S}
        sums = sorted(costs.total() for costs in late.values())
        long = {t: costs for t, costs in late.items() if costs.total() > TICK_MS}
        late_count = sum(costs.total() > TICK_MS + LATE_MS for costs in late.values())
        parts: Counter[str] = sum(late.values(), Counter())
        seconds = 1e-3 * TICK_MS * len(sums)
        return {
            "ms_per_s": {part: ms / seconds for part, ms in parts.most_common()},
            "p50": sums[len(sums) // 2],
            "p99": sums[int(0.99 * len(sums))],
            "max": sums[-1],
            "late_count": late_count,
            "long": {f"{t:.3f}": dict(costs.most_common(4)) for t, costs in long.items()},
            "long_by": dict(Counter(max(c, key=lambda part: c[part]) for c in long.values()).most_common()),
        }


def lateness(sets: list[str], seconds: float, priority: int, *, with_ros2: bool) -> dict[str, Any]:
    """Ticks, how many began later than LATE_MS behind the grace, and their CPU time."""
    from swath.runtime.job import run_job
    from swath.scenario.scenario import load_scenario

    more = ["realtime.pace=real_time", f"run.max_duration_s={seconds}", *sets]
    more += [f"realtime.priority={priority}"] if priority else []
    hooks: list[Any] = []
    if with_ros2:
        from swath.link.ros2.bridge import Bridge

        hooks.append(Bridge())
    costs = TickCosts()
    with tempfile.TemporaryDirectory() as folder:
        try:
            scenario = load_scenario("laser-pilot", sets=more)
            summary = run_job(scenario, Path(folder), hooks=[*hooks, costs]).summary
        finally:
            for hook in hooks:
                hook.close()
    return counted(summary["realtime"]) | {"cpu_ms": costs.report()}


def control(seconds: float, priority: int) -> dict[str, Any]:
    """The same ticks with nothing to do."""
    from swath.runtime.pacing import Pacer, scheduling
    from swath.scenario.sections import RealTime

    pacer = Pacer(RealTime(priority=priority or None))
    with scheduling(pacer.priority) as pacer.scheduling:
        for k in range(round(1e3 * seconds / TICK_MS)):
            pacer(round(1e6 * TICK_MS) * k)
    return counted(pacer.report())


def counted(told: dict[str, Any]) -> dict[str, Any]:
    """The pacer's report with the count and the share of late ticks."""
    late = sum(count for name, count in told["late"].items() if name not in ("up to 0.1 ms", "up to 1 ms"))
    return {**told, "late_count": late, "share": late / told["ticks"]}


def show(name: str, row: dict[str, Any], *, ticks: bool) -> None:
    """Print a case."""
    print(
        f"{name:<26} {row['scheduling']:<10} {row['late_count']:>4} of {row['ticks']} ticks late "
        f"({100 * row['share']:.2f} %), latest {row['max_late_ms']:.1f} ms"
    )
    cpu = row.get("cpu_ms")
    if cpu is None:
        return
    by = ", ".join(f"{part} {count}" for part, count in cpu["long_by"].items())
    print(
        f"{'':<26} CPU of a tick: half up to {cpu['p50']:.2f} ms, 99 % up to {cpu['p99']:.2f}, most "
        f"{cpu['max']:.1f}; over {TICK_MS + LATE_MS:g} ms: {cpu['late_count']}, "
        f"over {TICK_MS:g}: {len(cpu['long'])}" + (f" ({by})" if by else "")
    )
    for t, costs in cpu["long"].items() if ticks else ():
        print(f"{'':<26} {t} s: " + ", ".join(f"{part} {ms:.1f} ms" for part, ms in costs.items()))


def main() -> None:
    """Measure, print, write paced.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, nargs="?", default=Path("out/bench"))
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--priority", type=int, default=0, help="of SCHED_FIFO, where the system grants it")
    parser.add_argument("--case", default="", help="only those with this in their name, as `plants`")
    parser.add_argument("--ticks", action="store_true", help="list the ticks that used more than a period")
    args = parser.parse_args()
    found: dict[str, Any] = {"machine": machine(), "load": os.getloadavg()}
    cases = [(name, sets, False) for name, sets in RUNS.items()]
    try:
        import rclpy  # noqa: F401

        cases += [(f"{name}, ROS 2", RUNS[name], True) for name in ("demo, empirical", "demo, plants")]
    except ImportError:
        print("ROS 2: rclpy is not installed")
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    print(f"load {found['load'][0]:.1f}; late: by more than {LATE_MS:g} ms")
    found["no work"] = control(args.seconds, args.priority)
    show("no work", found["no work"], ticks=False)
    for name, sets, with_ros2 in (case for case in cases if args.case in case[0]):
        found[name] = lateness(sets, args.seconds, args.priority, with_ros2=with_ros2)
        show(name, found[name], ticks=args.ticks)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "paced.json").write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
