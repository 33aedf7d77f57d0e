"""Runs that several tests read: each is driven once, by the worker of pytest that needs it first."""

import fcntl
import hashlib
import json
from pathlib import Path

from swath.commands.main import main


class Driven:
    """Folders of runs that all workers share, below `home`."""

    def __init__(self, home: Path) -> None:
        self.home = home
        self.contents: dict[Path, dict[str, tuple[int, int]]] = {}

    def __call__(self, scenario: str | Path, *sets: str, report: bool = False) -> Path:
        """The folder of `swath run SCENARIO --set SET...`, to be read only: who writes into it fails."""
        words = ["run", str(scenario), *(word for one in sets for word in ("--set", one))]
        words += () if report else ["--no-report"]
        folder = self.home / hashlib.sha256(json.dumps(words).encode()).hexdigest()[:16]
        if folder not in self.contents:
            self.home.mkdir(exist_ok=True)
            with open(f"{folder}.lock", "w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                if not (folder / "summary.json").exists():
                    code = main([*words, "--quiet", "--out", str(folder)])
                    assert code in (0, 1, 3), f"{words} ended with {code}"
            self.contents[folder] = contents(folder)
        return folder

    def check(self) -> None:
        """All folders hold what they held when they were handed out first."""
        for folder, before in self.contents.items():
            assert contents(folder) == before, f"{folder} is shared: copy it before writing into it"


def contents(folder: Path) -> dict[str, tuple[int, int]]:
    """Size [bytes] and time of the last change [ns] of all that is below a folder."""
    found = {p.relative_to(folder).as_posix(): p.stat() for p in sorted(folder.rglob("*"))}
    return {name: (status.st_size, status.st_mtime_ns) for name, status in found.items()}
