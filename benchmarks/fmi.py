"""What coupling an FMU costs per step: a process model in C, in this process and in one of its own."""

import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "link"))

import numpy as np
from _harness import machine, write_json

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.signals import CropFlow, MachineState

STEPS, PERIOD = 3000, 100_000_000
GOAL_US = 30.0
KEYS = {"inputs": {"grain_in": "flow.grain/s", "straw_in": "flow.straw/s"}}


def part_of(file: Path, **more: Any) -> Any:
    """The process slot of a machine, filled with the FMU."""
    from fmu_scenario import scenario

    from swath.runtime.assembly import assemble

    made = scenario(process={"level": "fmu", "file": str(file), **KEYS, **more})
    return assemble(made).leader.parts["process"].part


def samples(t: int) -> dict[str, Any]:
    """What the slot receives at t: five steps of the header and the state."""
    flows = tuple(CropFlow(t - k * PERIOD // 5, 0.1, 0.1, 0.2, 40, 1.0, 0.02) for k in range(5))
    return {"flow": flows[::-1], "state": MachineState(t, Pose.identity(), 2.0, 0.0, 0.0, 0.0, 1.0)}


def cost_us(part: Any) -> np.ndarray:
    """Time of every step [us]."""
    part.reset(Stream(1, "bench"))
    times = []
    for k in range(STEPS):
        inputs = samples((k + 1) * PERIOD)
        started = perf_counter()
        part.step(k * PERIOD, PERIOD, inputs)
        times.append(perf_counter() - started)
    part.close()
    return np.array(times) * 1e6


def main(out: Path) -> None:
    """Print medians and 95th percentiles; write fmi.json."""
    import made_fmus

    if made_fmus.CC is None:
        print("fmi: no C compiler, nothing measured")
        return
    with tempfile.TemporaryDirectory(prefix="swath-bench-") as folder:
        rows = measure(made_fmus.store_fmu(folder))
    print(f"  goal in process: {GOAL_US:g} us")
    write_json(out, "fmi", {"machine": machine(), "goal_us": GOAL_US, "cases": rows})


def measure(file: Path) -> dict[str, dict[str, float]]:
    """Median and 95th percentile of every case [us], printed as they come."""
    cases = {
        "in process": part_of(file),
        "in process, 10 sub-steps": part_of(file, step_ms=10),
        "own process": part_of(file, process="own"),
        "own process, 10 sub-steps": part_of(file, process="own", step_ms=10),
    }
    rows = {}
    print("FMU of 2 inputs and 7 outputs in the process slot, us per step of the slot")
    for name, part in cases.items():
        times = cost_us(part)
        rows[name] = {"median_us": float(np.median(times)), "p95_us": float(np.percentile(times, 95.0))}
        print(f"  {name:28s} median {rows[name]['median_us']:7.1f}   p95 {rows[name]['p95_us']:7.1f}")
    return rows


if __name__ == "__main__":
    main(Path("out/bench"))
