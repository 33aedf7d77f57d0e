"""What the benchmarks share: interleaved rounds, memory, files."""

import gc
import json
import os
import platform
import random
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any


def interleave(
    jobs: Mapping[str, Callable[[], Any]], *, rounds: int = 7, seed: int = 1
) -> dict[str, list[float]]:
    """CPU seconds (user + system, of the process) of each job in each round.

    Every job runs once unmeasured; then each round runs all jobs in a new order, so that what else the
    machine does meets all of them alike.
    """
    for job in jobs.values():
        job()
    order, times = list(jobs), {name: [] for name in jobs}
    shuffler = random.Random(seed)
    for _ in range(rounds):
        shuffler.shuffle(order)
        for name in order:
            started = time.process_time()
            jobs[name]()
            times[name].append(time.process_time() - started)
    return times


def environment(**more: str) -> dict[str, str]:
    """Of a process that is measured: Python may keep the bytecode of what it imports, as it usually does.

    Compiling swath takes half a second each time where PYTHONDONTWRITEBYTECODE is set.
    """
    kept = {name: text for name, text in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    cache = Path(tempfile.gettempdir()) / "swath-benchmark-bytecode"
    return {**kept, "SWATH_THREADS": "1", "PYTHONPYCACHEPREFIX": str(cache), **more}


def median(values: list[float]) -> float:
    return statistics.median(values)


def resident_bytes() -> int:
    """Resident memory of this process."""
    gc.collect()
    try:
        import ctypes

        ctypes.CDLL("libc.so.6").malloc_trim(0)
    except OSError:
        pass
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(text for text in status.splitlines() if text.startswith("VmRSS"))
    return int(line.split()[1]) * 1024


def machine() -> dict[str, Any]:
    """What it was measured on."""
    model = "unknown"
    info = Path("/proc/cpuinfo")
    if info.is_file():
        lines = [s for s in info.read_text(encoding="utf-8").splitlines() if s.startswith("model name")]
        model = lines[0].split(":", 1)[1].strip() if lines else model
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {"cpu": model, "cores": os.cpu_count(), "python": platform.python_version(), "load_1min": load}


def write_json(out_dir: Path, name: str, data: Mapping[str, Any]) -> Path:
    """Writes out_dir/name.json."""
    out_dir.mkdir(parents=True, exist_ok=True)
    path = out_dir / f"{name}.json"
    path.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")
    return path
