"""What a simulated second takes, in counts that no clock and no other load moves.

python -m benchmarks.counts [--scenario straight] [--seconds 1] [--record none] [--worlds 1]
    [--set KEY=VALUE ...] [--modules] [--start WORDS]

Counted are, of the longer of two runs less the shorter: bytecodes that the interpreter executed; calls of
Python functions, those of comprehensions and generators among them; returns from compiled code to Python,
which are entries of the walker, steps of parts in Python and calls of `supply` by ops. The end of a run
counts, and so do threads; child processes do not. Other versions of Python have other counts. Then come two
measures of simplicity: the classes that a sample goes through, and the modules that ask for the types of
fields. --modules: how many of the bytecodes each module executes. --start: instead, what a command line such
as `--help` takes from the import on: bytecodes of swath and argparse, modules of swath.
`benchmarks/instructions.py` counts the instructions of all of it.
"""

import argparse
import ast
import io
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "swath"
BEGIN_S = 1.0  # of the shorter run: its start and its end are not counted
SETS = {"combine.lidar.level": "empirical", "combine.motion.start_speed_kmh": "7"}
BYTECODES, CALLS, WALKS, STEPS, SUPPLIES = "bytecodes", "calls", "entries of the walker", "steps", "supplies"
MODULES = "modules"
OTHERS, MOST = "not of swath", 25  # modules that are shown
# modules that keep, send and step samples; a module that replaces one of them takes its place here
MIDDLE = (
    "core/graph", "core/rows", "core/ops", "core/blocks", "core/together", "core/onlookers", "core/schedule",
    "core/component", "kernels", "compiled",
)  # fmt: skip


class Counting:
    """Counts in all threads, from now on.

    counts: by what is counted; bytecodes: by file
    """

    def __init__(self, named: Mapping[CodeType, str]) -> None:
        self.counts: Counter[str] = Counter()
        self.bytecodes: Counter[str] = Counter()
        self._named = named

    def __enter__(self) -> "Counting":
        threading.settrace(self._called)
        sys.settrace(self._called)
        return self

    def __exit__(self, *_: object) -> None:
        sys.settrace(None)
        threading.settrace(None)  # type: ignore[arg-type]

    def _called(self, frame: FrameType, _event: str, _given: Any) -> Callable[..., Any]:
        code = frame.f_code
        self.counts[CALLS] += 1
        if code in self._named:
            self.counts[self._named[code]] += 1
        elif code.co_name == "supply":
            self.counts[SUPPLIES] += 1
        frame.f_trace_lines, frame.f_trace_opcodes = False, True
        return self._executed

    def _executed(self, frame: FrameType, event: str, _given: Any) -> Callable[..., Any]:
        if event == "opcode":
            self.bytecodes[frame.f_code.co_filename] += 1
        return self._executed


def run(scenario: str, sets: Mapping[str, str], seconds: float, record: str, worlds: int = 1) -> None:
    """A run from its start to its end, or worlds of seeds of their own."""
    import swath
    from swath.api import load_scenario
    from swath.core.process.collector import collected_rarely
    from swath.runtime.job import run_job, run_unrecorded

    own = {**sets, "run.max_duration_s": seconds, "run.record": record}
    if worlds > 1:
        with collected_rarely():
            deque(swath.worlds(scenario, n=worlds, sets=own), 0)
        return
    made = load_scenario(scenario, sets=own)
    with tempfile.TemporaryDirectory() as folder, collected_rarely():
        if record == "none":
            run_unrecorded(made)
        else:
            run_job(made, Path(folder) / "run")


def counted(scenario: str, sets: Mapping[str, str], seconds: float, record: str, worlds: int) -> Counting:
    """What it takes."""
    from swath.core.graph import Lockstep
    from swath.core.ops import Program

    with Counting({Program.go_on.__code__: WALKS, Lockstep._step.__code__: STEPS}) as counting:
        run(scenario, sets, seconds, record, worlds)
    return counting


def of_a_second(
    scenario: str, sets: Mapping[str, str], seconds: float, record: str, worlds: int = 1
) -> tuple[dict[str, float], dict[str, float]]:
    """Counts per simulated second, once what is made only once is made; and bytecodes by module."""
    run(scenario, sets, BEGIN_S + seconds, record, worlds)
    longer = counted(scenario, sets, BEGIN_S + seconds, record, worlds)
    shorter = counted(scenario, sets, BEGIN_S, record, worlds)
    longer.counts.subtract(shorter.counts)
    longer.bytecodes.subtract(shorter.bytecodes)
    modules = Counter[str]()
    for file, count in longer.bytecodes.items():
        whole = Path(file)
        is_ours = whole.is_relative_to(SOURCE)
        modules[whole.relative_to(SOURCE).as_posix() if is_ours else OTHERS] += count
    found = {BYTECODES: modules.total()} | {n: longer.counts[n] for n in (CALLS, WALKS, STEPS, SUPPLIES)}
    return {name: n / seconds for name, n in found.items()}, {
        name: n / seconds for name, n in modules.items()
    }


def of_start(words: Sequence[str]) -> dict[str, float]:
    """What a command line takes from the import on.

    What depends on the machine does not count: installed packages, old folders, variables of the environment
    (from here on there are none), and the question whether a module is gymnasium's, which is asked for each
    that the interpreter has not imported before.
    """
    os.environ.clear()
    os.environ["COLUMNS"] = "80"
    with tempfile.TemporaryDirectory() as tempfile.tempdir, Counting({}) as counting:
        from swath.commands.main import main

        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()), suppress(SystemExit):
            main(words)
    ours = [
        n
        for file, n in counting.bytecodes.items()
        if "argparse" in file or (SOURCE in Path(file).parents and Path(file).name != "gym_ids.py")
    ]
    return {BYTECODES: sum(ours), MODULES: sum(name.partition(".")[0] == "swath" for name in sys.modules)}


def in_a_process(*arguments: str) -> tuple[dict[str, float], dict[str, float]]:
    """The same, by a process of its own, which knows nothing of runs before.

    arguments: as of this program
    """
    paths = os.pathsep.join([str(ROOT / "src"), str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    env = os.environ | {"SWATH_THREADS": "1", "PYTHONHASHSEED": "0", "PYTHONPATH": paths, "COLUMNS": "80"}
    command = [sys.executable, "-m", "benchmarks.counts", *arguments, "--inside"]
    done = subprocess.run(command, env=env, cwd=ROOT, check=True, capture_output=True, text=True)
    found, modules = json.loads(done.stdout)
    return found, modules


def classes() -> dict[str, int]:
    """How many classes each module has that keeps, sends or steps samples."""
    found = {}
    for name in MIDDLE:
        tree = ast.parse((SOURCE / f"{name}.py").read_text(encoding="utf-8"))
        found[name] = sum(isinstance(node, ast.ClassDef) for node in ast.walk(tree))
    return found


def asks_for_types() -> list[str]:
    """Modules that ask what types the fields of a class have."""
    files = sorted(SOURCE.rglob("*.py"))
    return [
        file.relative_to(SOURCE).as_posix() for file in files if "get_type_hints" in file.read_text("utf-8")
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print all of it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="straight")
    parser.add_argument("--seconds", type=float, default=1.0, help="simulated time that is counted")
    parser.add_argument("--record", default="none", choices=("none", "standard", "exact", "full"))
    parser.add_argument("--worlds", type=int, default=1, help="so many in step; unrecorded where more than 1")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--modules", action="store_true", help="how many bytecodes each module executes")
    parser.add_argument("--start", metavar="WORDS", help="what this command line takes from the import on")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    if options.start is not None:
        print(json.dumps([of_start(options.start.split()), {}]))
        return
    if options.inside:
        sets = SETS | dict(text.split("=", 1) for text in options.set)
        print(
            json.dumps(of_a_second(options.scenario, sets, options.seconds, options.record, options.worlds))
        )
        return
    show(given)
    show_middle()


def show(given: Sequence[str]) -> None:
    """Print what is counted; given: arguments of this program."""
    found, modules = in_a_process(*given)
    for name, count in found.items():
        print(f"{count:10,.0f} {name} per simulated second")
    if "--modules" in given:
        for name, count in sorted(modules.items(), key=lambda pair: -pair[1])[:MOST]:
            print(f"{count:14,.0f} {name}")


def show_middle() -> None:
    """Print how many classes a sample goes through, and which modules ask for types."""
    middle, asking = classes(), asks_for_types()
    print(f"{sum(middle.values()):10} classes: " + ", ".join(f"{name} {n}" for name, n in middle.items()))
    print(f"{len(asking):10} modules ask for the types of fields: {', '.join(asking)}")


if __name__ == "__main__":
    main()
