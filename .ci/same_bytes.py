"""Digests of scenarios as this machine is, as if it had AVX2 only, and of the wheel under other Pythons.

python .ci/same_bytes.py SCENARIO[:METRES] ...    exit code 1 when two differ. The environments of the other
Pythons are those that `.ci/packages` made.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
RUN = """
import sys, swath
for number, scenario in enumerate(sys.argv[2:]):
    name, _, metres = scenario.partition(":")
    sets = [f"run.distance_m={metres}"] if metres else []
    swath.run(name, f"{sys.argv[1]}/{number}", sets=sets, report=False)
"""
# numpy (2.4) without its code for AVX-512, kernels for AVX2, the code of OpenBLAS for AVX2.
AVX2_ONLY = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "SWATH_CPU": "haswell",
    "OPENBLAS_CORETYPE": "Haswell",
}


def others() -> dict[str, str]:
    """Executables of the environments of `.ci/packages` by the version of their Python; without our own."""
    own = f"{sys.version_info.major}.{sys.version_info.minor}"
    made = {folder.name.removeprefix("python-"): folder for folder in sorted(ROOT.glob("out/python-3.*"))}
    return {version: str(made[version] / "bin" / "python") for version in made if version != own}


def digests(python: str, scenarios: list[str], settings: dict[str, str]) -> list[str]:
    """The digests of scenarios, driven for some metres one after another."""
    with tempfile.TemporaryDirectory() as folder:
        command = [python, "-c", RUN, folder, *scenarios]
        done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **settings})
        if done.returncode:
            return [f"failed: {done.stderr[-2000:]}"] * len(scenarios)
        summaries = [Path(folder, str(number), "summary.json") for number in range(len(scenarios))]
        return [str(json.loads(path.read_text(encoding="utf-8"))["digest"]) for path in summaries]


def main(scenarios: list[str]) -> int:
    """Print all digests; 1 when two of a scenario differ."""
    cases = {"as it is": (sys.executable, {}), "AVX2 only": (sys.executable, AVX2_ONLY)}
    cases |= {f"Python {version}": (python, {}) for version, python in others().items()}
    found = {case: digests(python, scenarios, settings) for case, (python, settings) in cases.items()}
    for number, scenario in enumerate(scenarios):
        for case, values in found.items():
            print(f"{Path(scenario).name:16} {case:12} {values[number]}", flush=True)
    is_same = all(len(set(of_one)) == 1 for of_one in zip(*found.values(), strict=True))
    is_same &= not any(value.startswith("failed") for values in found.values() for value in values)
    print("same bytes" if is_same else "the digests differ")
    return 0 if is_same else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or ["straight:4", str(ROOT / ".ci" / "same-bytes.yaml")]))
