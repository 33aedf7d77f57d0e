"""Instructions of a simulated second, counted by Valgrind: load of the machine does not move them.

python benchmarks/instructions.py [--scenario straight] [--seconds 3] [--record exact] [--set KEY=VALUE ...]

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
from collections.abc import Sequence
from pathlib import Path

SETTLE_S = 1.5
LEVEL = "combine.lidar.level=empirical"
TOOL = ("valgrind", "--tool=callgrind", "--instr-atstart=no")


def inside(options: argparse.Namespace) -> None:
    """The run; counts between two calls of callgrind_control."""
    from swath.api import load_scenario
    from swath.core.collector import collect_rarely
    from swath.judge.evaluator import SETTLING_M
    from swath.record.digest import Digest
    from swath.record.recorder import Recorder
    from swath.runtime.assembly import assemble
    from swath.runtime.evaluation import make_evaluation
    from swath.runtime.loop import drive

    collect_rarely()  # as every process that swath has for itself
    length = f"run.distance_m={SETTLING_M + 10.0 * options.seconds:g}"
    world = assemble(load_scenario(options.scenario, sets=[length, LEVEL, *options.set]))
    evaluation = make_evaluation(world)
    observers: list = [Digest(), evaluation]
    if options.record != "none":
        machines = world.recorded()
        more = {name: evaluation.columns(name) for name in machines}
        out = Path(tempfile.mkdtemp())
        observers.append(Recorder(out, list(machines.values()), extra=more, detail=options.record))
    drive(world, observers, until_s=SETTLE_S)
    count("on", options)
    drive(world, observers, until_s=SETTLE_S + options.seconds, resume=True)
    count("off", options)
    os._exit(0)


def count(state: str, options: argparse.Namespace) -> None:
    """Begin or end counting in this process."""
    if options.inside == "counted":
        command = ["callgrind_control", "-i", state, str(os.getpid())]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def main(arguments: Sequence[str] | None = None) -> float:
    """Run once to compile kernels, then counted. Prints and returns millions per simulated second."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="straight")
    parser.add_argument("--seconds", type=float, default=3.0, help="simulated time that is counted")
    parser.add_argument("--record", default="none", choices=("none", "standard", "exact", "full"))
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--inside", choices=("plain", "counted"), help=argparse.SUPPRESS)
    given = list(sys.argv[1:] if arguments is None else arguments)
    options = parser.parse_args(given)
    if options.inside:
        inside(options)
    source = Path(__file__).resolve().parent.parent / "src"
    paths = os.pathsep.join([str(source), *site.getsitepackages()])
    env = os.environ | {"SWATH_THREADS": "1", "SWATH_CPU": "haswell", "PYTHONPATH": paths}
    python = [sys.executable, "-S", __file__, *given, "--inside"]  # a .pth file may start Python anew
    subprocess.run([*python, "plain"], env=env, check=True)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "counts"
        command = [*TOOL, f"--callgrind-out-file={file}", *python, "counted"]
        subprocess.run(command, env=env, check=True, capture_output=True)
        text = "".join(part.read_text() for part in Path(folder).glob("counts*"))
    millions = sum(int(n) for n in re.findall(r"^totals: (\d+)", text, re.MULTILINE)) / 1e6 / options.seconds
    print(f"{millions:.1f} million instructions per simulated second")
    return millions


if __name__ == "__main__":
    main()
