"""Every line of README and how-to as it stands, page by page, with the time it takes.

python -m benchmarks.typed_lines [PAGE ...]; the tests cut runs to a moment, here nothing is cut. All pages
take an hour and more; lines over a minute are listed once more at the end.
"""

import os
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from docs.make.typed import PAGES, ROOT

TIMED = re.compile(r"^\$ (.*)\n(?:(?!\$ |# ).*\n)*# ([\d.]+) s, ([\d.]+) CPU-s$", re.MULTILINE)
LIMIT_S = 600.0  # of a page


def typed(page: Path) -> tuple[str, str]:
    """(what typing a page prints, why it ended early)."""
    paths = [str(ROOT), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "MPLBACKEND": "agg", "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    environment["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    command = [sys.executable, "-m", "docs.make.typed", str(page), "--whole"]
    with tempfile.TemporaryDirectory() as folder:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        running = subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True, **pipes)  # type: ignore[call-overload]
        try:
            out, errors = running.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            os.killpg(running.pid, signal.SIGTERM)
            out, errors = running.communicate()
            last = [line for line in out.splitlines() if line.startswith("$ ")][-1:]
            return out, f"stopped after {LIMIT_S:.0f} s in {last}"
    return out, errors[-2000:] if running.returncode else ""


def main(names: list[str]) -> int:
    failed, times = [], []
    for page in [page for page in PAGES if not names or page.stem in names]:
        print(f"## {page.name}", flush=True)
        out, why = typed(page)
        for line, seconds, busy in TIMED.findall(out):
            print(f"{float(seconds):8.1f} s {float(busy):8.1f} CPU-s  {line}", flush=True)
            times.append((float(seconds), line))
        if why:
            failed.append(page.name)
            print(why, flush=True)
    print(
        "over a minute:", *(f"{seconds:8.1f} s  {line}" for seconds, line in times if seconds > 60), sep="\n"
    )
    if failed:
        print("not to their end:", *failed)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
