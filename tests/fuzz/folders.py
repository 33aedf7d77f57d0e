"""Edit a folder that a command goes on with or reads: it ends well or with exit code 2, in time and memory.

    nice python -m tests.fuzz.folders --edits 60           # of each folder
    python -m tests.fuzz.folders --only tune --edit 17     # one edit again: what it was, and what was said

An edit is drawn by the name of the folder and its number: bytes, lines, values of every kind of JSON,
links, pipes, devices and folders in the place of files, files and columns that are missing, many lines more.
Exit code 1 where a command ended with another code, took more than 60 s of the processor or 2 GB, or waited.
"""

import argparse
import importlib
import json
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from swath.documents.data_sheets import find_sheet
from tests.fuzz.mutate import mutated

LOG = find_sheet("jobs", "small-field").parents[1] / "logs" / "sample-log.csv.gz"
HEAVY = ("matplotlib.pyplot", "pyarrow.parquet", "scipy.stats", "swath.runtime.job", "swath.report.report",
         "swath.replay.writer", "swath.tools.tune.tune", "swath.tools.function_test.command",
         "swath.fleet.report")  # fmt: skip
CPU_S, WAITS_S, MOST_MB = 60, 300, 2048
CODES = (0, 1, 2, 3, 4)
SCENARIO = """
format: swath scenario 2
name: edited
run: {distance_m: 0.5, record: none}
field: {terrain: {level: plane}, stand: {level: uniform}, edge: {shape: straight}}
machines: {combine: {lidar: off, edge: truth, process: constant}}
"""
CASE = """
format: swath test case 1
objective: edited
source: made
scenario: drive.yaml
vary: {v: {key: field.stand.stems_per_m2, at: [400, 500], range: [300, 600]}}
seeds: 2
expect: {mass_balance_error: {max: 1.0e-9}, distance_m: {min: 0.1}}
"""
TUNE = (
    "tune case.yaml --param combine.speed.speed_kmh=3..6 --tries 10 --each 1 --proof 10 --workers 1 --out D"
)
TEST = "test run case.yaml --workers 1 --out D"
FOLDERS = {  # how a folder is made, and what reads it or goes on with it
    "tune": (TUNE, (TUNE, TUNE, "test report D/fresh", "test compare D/fresh:shipped D/fresh:tuned")),
    "campaign": (TEST, (TEST, "test report D", "test compare D D", "test work D --shard 1/2")),
    "search": ("test search case.yaml --budget 8 --workers 1 --out D",
               ("test search case.yaml --budget 8 --workers 1 --out D", "test report D")),
    "estimate": ("test estimate case.yaml --budget 20 --workers 1 --out D",
                 ("test estimate case.yaml --budget 20 --workers 1 --out D", "test report D")),
    "field": (f"field import {LOG} --out D",
              ("field show D", "field agopengps D --out A", f"field import {LOG} --replace --out D")),
    "fleet": ("fleet run small-field --out D", ("fleet run small-field --out D",)),
    "run": ("run drive.yaml --set run.record=exact --set run.distance_m=1 --save-every-s 0.1 --out D",
            ("report D", "view D", "branch D --at 0.2 --out A", "rerun D --out A", "diff D D",
             "run drive.yaml --set run.record=exact --set run.distance_m=1 --save-every-s 0.1 --out D")),
}  # fmt: skip
VALUES = (None, True, -1, 0.5, "", "x" * 1000, [], {}, [[]], {"id": []}, 1e300, "../../x", "\0")
TEXTS = ("1" + "0" * 400, "1e999", "NaN", "[" * 5000 + "]" * 5000)  # that JSON takes and nobody can use
LINES = (
    "[]",
    "null",
    "7",
    '"x"',
    "{}",
    '{"id": "zz", "metrics": {}}',
    '{"id": 7}',
    '{"id": "00ff"}',
    "\0",
    "{",
)


class Folders:
    """Whole folders, each made once."""

    def __init__(self, folder: Path) -> None:
        for heavy in HEAVY:  # once for all commands, which are forks
            importlib.import_module(heavy)
        self.folder = folder
        (folder / "drive.yaml").write_text(SCENARIO)
        (folder / "case.yaml").write_text(CASE)

    def edited(self, name: str, number: int) -> tuple[Path, str, str]:
        """A place with an edited copy, the command line that is to go there, and what was edited.

        number: < 0 for a copy as it is
        """
        whole = self.folder / name
        if not whole.exists():
            code, said, *_ = command(self.folder, self._line(FOLDERS[name][0], name))
            assert code in (0, 1, 3, 4), said
        rng = random.Random(f"{name} {number}")
        place = self.folder / "edited"
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        shutil.copytree(whole, place / name)
        lines = FOLDERS[name][1]
        line = self._line(lines[number % len(lines)], name)
        return place, line, edit(place / name, rng) if number >= 0 else "no edit"

    def _line(self, line: str, name: str) -> str:
        """A command line for a folder, in any place: its case and scenario lie where they lay."""
        known = {file: str(self.folder / file) for file in ("case.yaml", "drive.yaml")}
        words = (re.sub(r"^D(?=$|[/:])", name, known.get(word, word)) for word in line.split())
        return " ".join(words)


def edit(folder: Path, rng: random.Random) -> str:
    """One edit of a file or folder of it; says which."""
    files = sorted(f for f in folder.rglob("*") if f.is_file())
    file = rng.choice(files)
    known: dict[str, Callable[[Path, random.Random], None]] = {
        "bytes": _bytes,
        "cut off": _cut,
        "empty": lambda f, _: os.truncate(f, 0),
        "gone": lambda f, _: f.unlink(),
        "link": _link,
        "pipe": _pipe,
        "zeros": lambda f, _: _in_place(f, "/dev/zero"),
        "folder": _folder,
        "outer link": _outer,
    }
    if file.suffix in (".json", ".jsonl"):
        known |= {"value": _value, "value again": _value, "text": _text}
    if file.suffix == ".jsonl":
        known |= {"line": _new_line, "line again": _new_line, "many lines": _many_lines}
    if file.suffix == ".parquet":
        known |= {"column": _column, "column again": _column}
    kind = rng.choice(sorted(known))
    known[kind](file, rng)
    return f"{kind} of {file.relative_to(folder)}"


def _bytes(file: Path, rng: random.Random) -> None:
    text = file.suffix in (".json", ".jsonl", ".yaml", ".geojson", ".html")
    file.write_bytes(mutated(file.read_bytes(), rng=rng, text=text))


def _cut(file: Path, rng: random.Random) -> None:
    data = file.read_bytes()
    file.write_bytes(data[: rng.randrange(len(data) + 1)])


def _in_place(file: Path, there: str | Path) -> None:
    file.unlink()
    file.symlink_to(there)


def _link(file: Path, rng: random.Random) -> None:
    others = sorted(f for f in file.parent.rglob("*") if f.is_file() and f != file)
    _in_place(file, rng.choice([Path("/nothing"), file.parent.resolve(), *others]))


def _pipe(file: Path, rng: random.Random) -> None:
    if rng.random() < 0.5:
        file = file.with_name(f"more{file.suffix}")  # beside the others, as another worker's
    else:
        file.unlink()
    os.mkfifo(file)


def _folder(file: Path, rng: random.Random) -> None:
    file.unlink()
    file.mkdir()


def _outer(file: Path, rng: random.Random) -> None:
    """A link in the place of the folder that it lies in."""
    there = file.parent.with_name("moved")
    file.parent.rename(there)
    file.parent.symlink_to(there)


def _places(data: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield at
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in inner:
        yield from _places(value, (*at, key))


def _value(file: Path, rng: random.Random) -> None:
    """Another value in the place of one, or a key that is gone."""
    lines = file.read_text().splitlines() if file.suffix == ".jsonl" else [file.read_text()]
    number = rng.randrange(len(lines)) if lines else 0
    data = json.loads(lines[number]) if lines else {}
    *around, last = rng.choice([at for at in _places(data) if at] or [("id",)])
    inner = data
    for key in around:
        inner = inner[key]
    if rng.random() < 0.2 and last in (inner if isinstance(inner, dict) else ()):
        del inner[last]
    else:
        inner[last] = rng.choice(VALUES)
    lines[number : number + 1] = [json.dumps(data)]
    file.write_text("\n".join(lines) + "\n")


def _text(file: Path, rng: random.Random) -> None:
    """A number that is none in the place of one."""
    text = file.read_text()
    found = list(re.finditer(r"(?<=: )-?[0-9.e+-]+", text))
    if found:
        place = rng.choice(found)
        text = text[: place.start()] + rng.choice(TEXTS) + text[place.end() :]
    file.write_text(text)


def _new_line(file: Path, rng: random.Random) -> None:
    lines = file.read_text().splitlines()
    lines.insert(rng.randrange(len(lines) + 1), rng.choice(LINES))
    file.write_text("\n".join(lines) + "\n")


def _many_lines(file: Path, rng: random.Random) -> None:
    """100,000 more, of runs that no plan has or of nothing."""
    lines = file.read_text().splitlines() or ["{}"]
    line = rng.choice([lines[0], "[]"])
    with file.open("a") as out:
        out.writelines(line.replace(line[8:24], f"{n:016x}") + "\n" for n in range(100_000))


def _column(file: Path, rng: random.Random) -> None:
    """A column of nothing, of texts, of numbers, or none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(file)
    number = rng.randrange(table.num_columns)
    name, rows = table.column_names[number], table.num_rows
    others = [pa.nulls(rows), *(pa.array([v] * rows) for v in ("x", "[]", float("nan"), 1 << 62, [1]))]
    other = rng.choice([*others, None])
    table = table.drop_columns([name]) if other is None else table.set_column(number, name, other)
    pq.write_table(table, file)


def command(folder: Path, line: str) -> tuple[int, str, float, float]:
    """Run a command line in a folder: its exit code, what it said, seconds of the processor, MB."""
    import shlex

    said = folder / "said.txt"
    pid = os.fork()
    if pid == 0:
        code = 70
        try:
            os.setsid()
            file = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(file, 1)
            os.dup2(file, 2)
            os.chdir(folder)
            resource.setrlimit(resource.RLIMIT_CPU, (2 * CPU_S, 2 * CPU_S))
            from swath.commands.main import main

            code = main(shlex.split(line))
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    until = time.monotonic() + WAITS_S
    while (ended := os.wait4(pid, os.WNOHANG))[0] == 0:
        if time.monotonic() > until:
            os.killpg(pid, signal.SIGKILL)
            ended = os.wait4(pid, 0)
            break
        time.sleep(0.02)
    _, status, used = ended
    cpu_s = used.ru_utime + used.ru_stime
    return os.waitstatus_to_exitcode(status), said.read_text(errors="replace"), cpu_s, used.ru_maxrss / 1024.0


def verdict(code: int, said: str, cpu_s: float, mb: float) -> str:
    """`taken`, `refused`, or what went wrong."""
    if code not in CODES or "Traceback" in said:
        return f"exit code {code}"
    if cpu_s > CPU_S or mb > MOST_MB:
        return f"{cpu_s:.0f} s, {mb:.0f} MB"
    return "refused" if code == 2 else "taken"


def run() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--edits", type=int, default=60, help="of each folder (default 60)")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--only", default=",".join(FOLDERS))
    parser.add_argument("--edit", type=int, help="this one alone")
    args = parser.parse_args()
    numbers = range(args.first, args.first + args.edits) if args.edit is None else [args.edit]
    failed = 0
    print("| folder | taken | refused | wrong | most s | most MB |\n|---|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as made:
        folders = Folders(Path(made).resolve())
        for name in args.only.split(","):
            counts, most = Counter[str](), [0.0, 0.0]
            for number in range(-len(FOLDERS[name][1]), 0):
                place, line, _ = folders.edited(name, number)
                ended = command(place, line)
                assert verdict(*ended) == "taken", (line, ended)
            for number in numbers:
                place, line, what = folders.edited(name, number)
                code, said, cpu_s, mb = command(place, line)
                most = [max(most[0], cpu_s), max(most[1], mb)]
                found = verdict(code, said, cpu_s, mb)
                counts[found if found in ("taken", "refused") else "wrong"] += 1
                if found not in ("taken", "refused") or args.edit is not None:
                    print(f"{name} {number}, {what}, {line}: {found}: {said[-600:]}", flush=True)
            failed += counts["wrong"]
            row = f"{counts['taken']} | {counts['refused']} | {counts['wrong']}"
            print(f"| {name} | {row} | {most[0]:.0f} | {most[1]:.0f} |", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(run())
