"""Replays of the bundled scenarios for the gallery of the site: `make replays`, then `make docs`.

python -m docs.make.replays [NAME ...]    out/site-extra/replays/NAME.html, of the first 30 m

They are not part of the repository: 1 to 2 MB each.
"""

import shutil
import sys
import tempfile
from pathlib import Path

import swath
from swath.scenario.scenario import scenario_names

FOLDER = Path(__file__).parents[2] / "out" / "site-extra" / "replays"
METRES = 30


def main(names: list[str]) -> None:
    """Drive them, print the size of each replay."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in names or scenario_names():
        with tempfile.TemporaryDirectory() as folder:
            sets = {"run.distance_m": METRES, "expect": {}}
            run = swath.run(name, Path(folder) / "run", sets=sets, progress=True)
            target = FOLDER / f"{name}.html"
            shutil.copyfile(run.folder / "replay.html", target)
        print(f"{target}  {target.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main(sys.argv[1:])
