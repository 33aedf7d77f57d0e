"""What the live page costs a run: bytes of a frame, and CPU time of the run's thread per frame.

One viewer on this machine, which answers at once; the run goes as fast as it can for a few seconds of it.
"""

import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from _harness import machine, write_json

SCENARIOS = ("laser-pilot", "two-combines", "two-scanners", "person-at-edge", "unload-on-the-go")
LENGTH_S = 12.0


def measure(name: str, folder: Path) -> dict[str, float]:
    """Frames of a scenario, their size and cost."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    from swath.replay.live.view import SEEN, LiveView
    from swath.runtime.job import run_job
    from swath.runtime.run_control import RunControl
    from swath.scenario.scenario import load_scenario

    control = RunControl(is_paused=True, speed=2.0)
    view = LiveView(control)

    def watch() -> None:
        address = view.address.replace("http", "ws").replace("/?", "/live?")
        with connect(address, max_size=None) as socket:
            is_going = False
            try:
                for message in socket:
                    if isinstance(message, bytes):
                        socket.send(SEEN)
                        if not is_going:
                            is_going = control.pause(False)[0]
            except ConnectionClosed:
                return

    viewer = threading.Thread(target=watch, daemon=True)
    viewer.start()
    plan = load_scenario(name, sets=[f"run.max_duration_s={LENGTH_S}"])
    run_job(plan, folder / "run", hooks=[view])
    view.close()
    viewer.join(10)
    count = view.frame_count
    return {"frames": count, "largest_bytes": view.largest, "cpu_ms": 1e3 * view.frame_s / max(count, 1)}


def main(out_dir: str = "out/bench") -> None:
    """Measure, print, write live.json."""
    found: dict[str, Any] = {}
    for name in SCENARIOS:
        with tempfile.TemporaryDirectory() as folder:
            m = found[name] = measure(name, Path(folder))
        print(f"| {name} | {m['frames']} | {m['largest_bytes']} | {m['cpu_ms']:.2f} ms |", flush=True)
    write_json(Path(out_dir), "live", {"machine": machine(), "scenarios": found})


if __name__ == "__main__":
    main(*sys.argv[1:2])
