"""What replay.html costs a run of the demo, its size, how soon it shows, and how soon the live page does.

CPU time of whole processes on one thread with and without the page, in turns. From the opening of the file to
the first picture, in headless Chromium that draws with the processor, and from the world that is assembled to
the first frame of the live page: wall clock, on an idle machine.
"""

import statistics
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1]))

from _harness import machine, write_json
from versions import NOW, Version

ROUNDS, SCENARIO = 3, "laser-pilot"
SIZE = (1280, 800)  # of the window [px]


def cost(folder: Path) -> dict[str, Any]:
    """CPU seconds of runs, in turns; bytes of the page."""
    version = Version(NOW, Path(__file__).resolve().parents[1], sys.executable)
    found: dict[str, list[float]] = {"with": [], "without": []}
    for _ in range(ROUNDS):
        for name, more in (("with", ()), ("without", ("--no-replay",))):
            run = ["run", SCENARIO, "--quiet", "--out", str(folder / name), *more]
            found[name].append(version.cpu_s(run))
    shares = [a / b - 1.0 for a, b in zip(found["with"], found["without"], strict=True)]
    page = folder / "with" / "replay.html"
    return {"cpu_s": found, "share": statistics.median(shares), "bytes": page.stat().st_size}


def first_picture(page: Path) -> list[float]:
    """Seconds from opening a page to its first picture, of several openings."""
    from tests.replay.browser import Browser

    found = []
    for _ in range(ROUNDS):
        with Browser(SIZE) as browser:
            begun = time.monotonic()
            browser.open(page)
            found.append(time.monotonic() - begun)
    return found


def live_ready(folder: Path) -> float:
    """Seconds from the assembled world, paused at its first tick, to the first frame in the browser."""
    from tests.replay.browser import Browser

    from swath.replay.live.view import LiveView
    from swath.runtime.hooks import ActiveRun, RunHook
    from swath.runtime.job import run_job
    from swath.runtime.run_control import RunControl
    from swath.scenario.scenario import load_scenario

    control, assembled = RunControl(is_paused=True), threading.Event()

    class Assembled(RunHook):
        def begin(self, run: ActiveRun) -> None:
            assembled.set()

    view = LiveView(control)
    plan = load_scenario(SCENARIO, sets=["run.max_duration_s=3"])
    run = threading.Thread(
        target=run_job, args=(plan, folder / "live"), kwargs={"hooks": [Assembled(), view]}
    )
    with Browser(SIZE) as browser:
        run.start()
        assembled.wait()
        begun = time.monotonic()
        browser.open(
            view.address, ready="globalThis.swath && swath.live && swath.live.frames > 0 && swath.frames > 0"
        )
        seconds = time.monotonic() - begun
    control.pause(False)
    run.join()
    view.close()
    return seconds


def main(out_dir: str = "out/bench") -> None:
    """Measure, print, write watch.json."""
    with tempfile.TemporaryDirectory() as base:
        found = cost(Path(base))
        found["first_picture_s"] = first_picture(Path(base) / "with" / "replay.html")
        found["live_ready_s"] = live_ready(Path(base))
    size, share = found["bytes"] / 1e6, 100 * found["share"]
    print(f"replay.html of {SCENARIO}: {size:.2f} MB, {share:.1f} % of the run's CPU time")
    print("first picture after", ", ".join(f"{s:.2f}" for s in found["first_picture_s"]), "s")
    print(f"live page ready {found['live_ready_s']:.2f} s after the world")
    write_json(Path(out_dir), "watch", {"machine": machine(), **found})


if __name__ == "__main__":
    main(*sys.argv[1:2])
