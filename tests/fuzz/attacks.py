"""Files that want to run code, to fill memory or never to end: each is refused or read, and nothing acts.

    python -m tests.fuzz.attacks OUT                  # writes them into OUT, each into a folder of its own
    python -m tests.fuzz.attacks OUT --run            # starts the command of each, too; a row of each
    python -m tests.fuzz.attacks OUT --run --only mf4-time,dbc
    python -m tests.fuzz.attacks OUT --run --cases DIR   # also what generators make_faults_*.py of DIR print

Of each: its exit code, seconds, most memory of the command with its processes [MiB], what acted, and the
first line that it said. Exit code 1 where code of a file ran, a file appeared beside `out`, something
connected, or a command took more than 60 s or 2 GB or ended with another code than 0 or 2 (of a run 0 to 3).
"""

import argparse
import os
import re
import resource
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import swath
from tests.fuzz.attack import ACTED, PORT, RAN, Attack
from tests.fuzz.attack_documents import DOCUMENTS
from tests.fuzz.attack_logs import LOGS
from tests.fuzz.attack_recordings import RECORDINGS

ATTACKS: dict[str, Attack] = {**LOGS, **RECORDINGS, **DOCUMENTS}
MOST_S, MOST_MIB, ADDRESSES, LARGEST_FILE = 60.0, 2048, 16 << 30, 4 << 30
SOURCE = str(Path(swath.__file__).parents[1])
OWN = re.compile(
    r"(here/)?((out|g\.npz|h\.npz|y\.csv|x\.\w+)(/|$)|log\.columns\.yaml)|runs/|.*__pycache__"
)  # what the commands are to write


FIRST = "first"  # of commands of others: one that makes what the next ones need


@dataclass(frozen=True)
class Ended:
    """How a command ended. acted: what it should not have done, "" = nothing; wrong: no way to end."""

    code: int
    seconds: float
    mib: int
    acted: str
    said: str
    wrong: str


class Listener:
    """Counts who connects to PORT of this machine."""

    def __init__(self) -> None:
        self._socket = socket.create_server(("127.0.0.1", PORT))
        self.count = 0
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        while True:
            connected, _ = self._socket.accept()
            self.count += 1
            connected.close()


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_FILE, LARGEST_FILE))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _memory(session: int) -> int:
    """Memory of the processes of a session now [MiB]."""
    pages = 0
    for process in Path("/proc").iterdir():
        if process.name.isdecimal():
            try:
                if int((process / "stat").read_text().rpartition(")")[2].split()[3]) == session:
                    pages += int((process / "statm").read_text().split()[1])
            except (OSError, IndexError):
                continue
    return pages * os.sysconf("SC_PAGE_SIZE") >> 20


def _files(folder: Path) -> dict[str, tuple[int, int]]:
    """What lies below a folder, links not followed: size and time of change by path."""
    found = {}
    for above, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(above, name)
            about = path.lstat()
            is_folder = name in folders
            found[str(path.relative_to(folder))] = (0, 0) if is_folder else (about.st_size, about.st_mtime_ns)
    return found


def run(
    command: str,
    folder: Path,
    codes: tuple[int, ...],
    listener: Listener | None = None,
    most_s: float = MOST_S,
) -> Ended:
    """Start a command line in a folder, and look at what it does."""
    before, connected = _files(folder), 0 if listener is None else listener.count
    begin, most, code = time.monotonic(), 0, None
    with tempfile.TemporaryFile() as said:
        started = subprocess.Popen(
            ["bash", "-c", command], cwd=folder, stdout=said, stderr=said, stdin=subprocess.DEVNULL,
            start_new_session=True, preexec_fn=_limited, env={**os.environ, "PYTHONPATH": SOURCE},
        )  # fmt: skip
        while (code := started.poll()) is None:
            most = max(most, _memory(started.pid))
            if time.monotonic() - begin > most_s or most > 2 * MOST_MIB:
                break
            time.sleep(0.05)
        seconds = time.monotonic() - begin
        with suppress(ProcessLookupError):
            os.killpg(started.pid, signal.SIGKILL)  # what it left
        started.wait()
        said.seek(0)
        lines = said.read(1 << 20).decode(errors="replace").splitlines()
    first = next((line for line in lines if line.startswith("swath: ")), next(filter(None, lines), ""))
    new = sorted(
        name for name, about in _files(folder).items() if before.get(name) != about and not OWN.match(name)
    )
    acted = "code ran" if any(Path(name).name == ACTED for name in new) else ", ".join(new[:3])
    if any(name.startswith("elsewhere/") for name in new):
        acted = "led elsewhere"
    if listener is not None and listener.count > connected:
        acted = "connected"
    wrong = []
    if code is None:
        wrong.append("time" if seconds > most_s else "memory")
    elif code not in codes:
        wrong.append(f"ended with {code}")
    if most > MOST_MIB:
        wrong.append(f"{most} MiB")
    return Ended(-1 if code is None else code, seconds, most, acted, first, ", ".join(dict.fromkeys(wrong)))


def made(name: str, out: Path) -> Path:
    """Write an attack: into a folder within one of its own, so that what it writes above is seen."""
    folder = out / name / "here"
    shutil.rmtree(folder.parent, ignore_errors=True)
    folder.mkdir(parents=True)
    ATTACKS[name].make(folder)
    (folder / "COMMAND").write_text(f"swath {shlex.join(ATTACKS[name].command)}\n")
    return folder


def row(name: str, tries: str, ended: Ended) -> str:
    """A row of the table."""
    state = "ACTED " if ended.acted else "WRONG " if ended.wrong else "ok    "
    more = "; ".join(filter(None, (ended.acted, ended.wrong)))
    about = f"{ended.code:4} {ended.seconds:6.1f} s {ended.mib:6} MiB"
    return f"{state}{name:24}{about}  {more:30.60}  {tries:50.70}  {ended.said[:160]}"


def tried(name: str, out: Path, listener: Listener | None = None) -> Ended:
    """Write an attack and start its command; what appears in the folder above counts, too."""
    folder = made(name, out)
    command = shlex.join([sys.executable, "-P", "-m", "swath", *ATTACKS[name].command])
    return run(f"cd here && exec {command}", folder.parent, ATTACKS[name].codes, listener)


@contextmanager
def as_swath(out: Path) -> Iterator[None]:
    """`swath` is the one that is tested, in shells that are started inside."""
    folder = out / "bin"
    folder.mkdir(exist_ok=True)
    (folder / "swath").write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -P -m swath "$@"\n')
    (folder / "swath").chmod(0o755)
    before = os.environ["PATH"]
    os.environ["PATH"] = f"{folder}{os.pathsep}{before}"
    try:
        yield
    finally:
        os.environ["PATH"] = before


def printed(generator: Path, out: Path) -> Iterator[tuple[str, str]]:
    """The commands that a generator of others prints, in their order: (case, command line)."""
    words = [sys.executable, "-B", generator.name, str(out.resolve())]
    said = subprocess.run(words, cwd=generator.parent, check=False, capture_output=True, text=True).stdout
    for line in said.splitlines():
        case, _, rest = line.partition(": ")
        if line.startswith("swath "):
            yield FIRST, line.partition(" #")[0]
        elif rest and not line.startswith(" "):
            yield case, rest if "swath " in rest else f"swath {rest}"


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--run", action="store_true")
    parser.add_argument("--only", default=",".join(ATTACKS), help="names, or beginnings of them")
    parser.add_argument("--jobs", type=int, default=1, help="commands at a time")
    parser.add_argument("--cases", type=Path, help="folder of generators of others: make_faults_*.py")
    args = parser.parse_args()
    asked = args.only.split(",")
    names = [name for name in ATTACKS if any(name.startswith(part) for part in asked)]
    args.out.mkdir(parents=True, exist_ok=True)
    if not args.run:
        for name in names:
            print(
                f"{name:24}{ATTACKS[name].tries:60}{(made(name, args.out) / 'COMMAND').read_text().strip()}"
            )
        return 0
    listener, bad = Listener(), 0
    with ThreadPoolExecutor(args.jobs) as pool, as_swath(args.out):
        for name, ended in zip(
            names, pool.map(partial(tried, out=args.out, listener=listener), names), strict=True
        ):
            bad += bool(ended.acted or ended.wrong)
            print(row(name, ATTACKS[name].tries, ended), flush=True)
        for generator in sorted(args.cases.glob("make_faults_*.py")) if args.cases else ():
            folder = args.out / generator.stem
            folder.mkdir(exist_ok=True)
            for name, command in printed(generator, folder):
                ended = run(command, folder, RAN, listener, 10 * MOST_S if name == FIRST else MOST_S)
                bad += bool(ended.acted in ("code ran", "led elsewhere", "connected") or ended.wrong)
                print(row(name, command, ended), flush=True)
    print(f"{len(names)} attacks, {bad} of them succeed")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
