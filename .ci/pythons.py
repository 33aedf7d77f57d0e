"""Every Python from 3.11 on that this machine has: a line with version and executable each, our own first."""

import subprocess
import sys
from pathlib import Path
from shutil import which

ASK = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"


def main() -> None:
    """Print them."""
    named = [which(f"python3.{minor}") for minor in range(11, 20)]
    kept = sorted(Path.home().glob(".pyenv/versions/3.*/bin/python3"))
    found: dict[str, str] = {}
    for python in [sys.executable, *filter(None, named), *map(str, kept)]:
        asked = subprocess.run([python, "-c", ASK], capture_output=True, text=True)
        version = asked.stdout.strip()
        if asked.returncode == 0 and tuple(map(int, version.split("."))) >= (3, 11):
            found.setdefault(version, python)
    for version, python in found.items():
        print(version, python)


main()
