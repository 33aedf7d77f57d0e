"""Every line of README and how-to as it stands, page by page, with the time it takes.

python -m benchmarks.docs [PAGE ...]; the tests cut runs to a moment, here nothing is cut. All pages take an
hour and more; lines over a minute are listed once more at the end.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from docs.make.typed import PAGES, ROOT

TIMED = re.compile(r"^\$ (.*)\n(?:(?!\$ |# ).*\n)*# ([\d.]+) s$", re.MULTILINE)


def main(names: list[str]) -> int:
    failed, times = [], []
    paths = [str(ROOT), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "MPLBACKEND": "agg", "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    environment["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    for page in [page for page in PAGES if not names or page.stem in names]:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "docs.make.typed", str(page), "--whole"]
            done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        print(f"## {page.name}")
        for line, seconds in TIMED.findall(done.stdout):
            print(f"{float(seconds):8.1f} s  {line}", flush=True)
            times.append((float(seconds), line))
        if done.returncode:
            failed.append(page.name)
            print(done.stderr[-2000:])
    print(
        "over a minute:", *(f"{seconds:8.1f} s  {line}" for seconds, line in times if seconds > 60), sep="\n"
    )
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
