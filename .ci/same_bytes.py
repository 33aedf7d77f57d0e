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
RUN = "import sys, swath; swath.run(sys.argv[1], sys.argv[2], sets=sys.argv[3:], report=False)"
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


def digest(python: str, scenario: str, settings: dict[str, str]) -> str:
    """The digest of a scenario, driven for some metres."""
    name, _, metres = scenario.partition(":")
    sets = [f"run.distance_m={metres}"] if metres else []
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        command = [python, "-c", RUN, name, str(out), *sets]
        done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **settings})
        if done.returncode:
            return f"failed: {done.stderr[-2000:]}"
        return str(json.loads((out / "summary.json").read_text(encoding="utf-8"))["digest"])


def main(scenarios: list[str]) -> int:
    """Print all digests; 1 when two of a scenario differ."""
    cases = {"as it is": (sys.executable, {}), "AVX2 only": (sys.executable, AVX2_ONLY)}
    cases |= {f"Python {version}": (python, {}) for version, python in others().items()}
    is_same = True
    for scenario in scenarios:
        found = {case: digest(python, scenario, settings) for case, (python, settings) in cases.items()}
        is_same &= len(set(found.values())) == 1
        for case, value in found.items():
            print(f"{Path(scenario).name:16} {case:12} {value}", flush=True)
    print("same bytes" if is_same else "the digests differ")
    return 0 if is_same else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or ["straight:4", str(ROOT / ".ci" / "same-bytes.yaml")]))
