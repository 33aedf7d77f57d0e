"""Instructions of a simulated second, counted by Valgrind: load of the machine does not move them.

python benchmarks/instructions.py [--scenario straight] [--seconds 3] [--record none] [--set KEY=VALUE ...]
    [--parts]

--record: by default not at all, then exactly. --parts: how many of them each component, evaluator and part of
the recorder takes. What Python does in a second of the same run is counted, too (`benchmarks/counts.py`).

Needs `valgrind`. One thread, kernels compiled for AVX2, which Valgrind knows; SHA-256 has no instruction of
its own there and takes 17 million per simulated second. The start of the run is not counted.
"""

import argparse
import os
import re
import site
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import counts
from counted_parts import WITHIN, Parts, read_counts

SETTLE_S = 1.5
LEVEL = "combine.lidar.level=empirical"
TOOL = ("valgrind", "--tool=callgrind", "--instr-atstart=no", "--dump-instr=yes", "--compress-pos=no")
RUN, PLACES, REST = "counted", "places", "graph, loop"


def inside(options: argparse.Namespace) -> None:
    """The run; counts between two calls of callgrind_control."""
    from swath.api import load_scenario
    from swath.core.process.collector import collect_rarely
    from swath.judge.evaluator import SETTLING_M
    from swath.record.digest import Digest
    from swath.record.recorder import Recorder
    from swath.runtime.assembly import assemble
    from swath.runtime.evaluation import make_evaluation
    from swath.runtime.loop import drive

    collect_rarely()  # as every process that swath has for itself
    length = f"run.distance_m={SETTLING_M + 10.0 * options.seconds:g}"
    level = [] if any(text.startswith(LEVEL.partition("=")[0]) for text in options.set) else [LEVEL]
    world = assemble(load_scenario(options.scenario, sets=[length, *level, *options.set]))
    evaluation = make_evaluation(world)
    observers: list = [Digest(), evaluation]
    if options.record != "none":
        machines = world.recorded()
        more = {name: evaluation.columns(name) for name in machines}
        out = Path(tempfile.mkdtemp())
        observers.append(Recorder(out, list(machines.values()), extra=more, detail=options.record))
    drive(world, observers, until_s=SETTLE_S)
    parts = None if options.places is None else count_parts(world, evaluation, observers)
    count("on", options)
    drive(world, observers, until_s=SETTLE_S + options.seconds, resume=True)
    if parts is not None:
        parts.count_counting()
    count("off", options)
    if parts is not None:
        parts.write(options.places)
    os._exit(0)


def count_parts(world: Any, evaluation: Any, observers: Sequence[Any]) -> Parts:
    """From now on compiled steps, what Python does for slots, and observers are counted one by one."""
    from swath.core.ops import Op, Program
    from swath.record.mcap_file import Container
    from swath.record.messenger import Messenger
    from swath.record.samples import Blocks
    from swath.record.tracks import Tracks

    parts = Parts()
    lockstep = world.graph.lockstep
    parts.count(Program, "go_on", "compiled steps")
    for rank in vars(lockstep)["_ranks"]:
        stepped = rank.batch or rank.parts[0]
        parts.count(stepped, "supply" if isinstance(stepped, Op) else "step", rank.name)
    for evaluator in chain.from_iterable(vars(evaluation)["_of"].values()):
        name = type(evaluator).__name__
        if hasattr(evaluator, "take"):
            parts.count(evaluator, "take", f"Evaluation{WITHIN}{name}")
        for method in ("see_live", "look_at"):
            if hasattr(evaluator, method):
                parts.count(evaluator, method, f"{name} at its time")
    lockstep.connect()  # those that were asked before are asked anew
    for observer in observers:
        parts.count(type(observer), "take", type(observer).__name__)
    for owner, method, what in (
        (Messenger, "write", "messages"),
        (Messenger, "rows", "messages of many samples"),
        (Blocks, "take", "exact samples"),
        (Blocks, "flush", "blocks of them"),
        (Tracks, "take", "tracks"),
        (Container, "flush", "chunks, counted above, too"),
    ):
        parts.count(owner, method, f"Recorder{WITHIN}{what}")
    return parts


def count(state: str, options: argparse.Namespace) -> None:
    """Begin or end counting in this process."""
    if options.inside == RUN:
        command = ["callgrind_control", "-i", state, str(os.getpid())]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print what each way to record takes."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="straight")
    parser.add_argument("--seconds", type=float, default=3.0, help="simulated time that is counted")
    parser.add_argument("--record", choices=("none", "standard", "exact", "full"))
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--parts", action="store_true", help="what each part of it takes")
    parser.add_argument("--inside", choices=("plain", RUN), help=argparse.SUPPRESS)
    parser.add_argument("--places", type=Path, help=argparse.SUPPRESS)
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    if options.inside:
        inside(options)
    for record in (options.record,) if options.record else ("none", "exact"):
        print(f"--record {record}")
        show([*given, "--record", record], options)
        sets = [part for text in options.set for part in ("--set", text)]
        counts.show(["--scenario", options.scenario, "--record", record, *sets])
    counts.show_middle()


def show(given: Sequence[str], options: argparse.Namespace) -> None:
    """Run once to compile kernels, then counted; prints millions per simulated second."""
    started(given, "plain")
    millions = million(counted(given)) / options.seconds
    print(f"{millions:10.1f} million instructions per simulated second")
    if options.parts:
        with tempfile.TemporaryDirectory() as folder:
            places = Path(folder) / PLACES
            text = counted([*given, "--places", str(places)])
            show_parts(read_counts(places, text), millions, options.seconds)


def started(given: Sequence[str], how: str, tool: Sequence[str] = ()) -> None:
    """A process of this program."""
    source = Path(__file__).resolve().parent.parent / "src"
    paths = os.pathsep.join([str(source), *site.getsitepackages()])
    env = os.environ | {"SWATH_THREADS": "1", "SWATH_CPU": "haswell", "PYTHONPATH": paths}
    python = [sys.executable, "-S", __file__, *given, "--inside", how]  # a .pth file may start Python anew
    subprocess.run([*tool, *python], env=env, check=True, capture_output=bool(tool))


def counted(given: Sequence[str]) -> str:
    """What Callgrind writes of a run."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "counts"
        started(given, RUN, [*TOOL, f"--callgrind-out-file={file}"])
        return "".join(part.read_text() for part in Path(folder).glob("counts*"))


def million(text: str) -> float:
    """Instructions that Callgrind counted, in millions."""
    return sum(int(n) for n in re.findall(r"^totals: (\d+)", text, re.MULTILINE)) / 1e6


def show_parts(found: Mapping[str, tuple[int, float]], millions: float, seconds: float) -> None:
    """The table, largest first, parts of a part below it."""
    from swath.terminal.tables import table

    each = {name: (calls / seconds, spent / seconds / 1e6) for name, (calls, spent) in found.items() if calls}
    whole = {name: row for name, row in each.items() if WITHIN not in name}
    whole[REST] = 0.0, millions - sum(spent for _, spent in whole.values())
    rows = []
    for name in sorted(whole, key=lambda n: -whole[n][1]):
        inner = sorted((n for n in each if n.startswith(name + WITHIN)), key=lambda n: -each[n][1])
        for part in (name, *inner):
            calls, spent = each.get(part, whole.get(part, (0.0, 0.0)))
            shown = part if part == name else "  " + part.removeprefix(name + WITHIN)
            rows.append([shown, f"{calls:.0f}", f"{spent:.1f}", f"{100.0 * spent / millions:.1f}"])
    table("Instructions per simulated second", ["part", "calls", "million", "%"], rows)


if __name__ == "__main__":
    main()
