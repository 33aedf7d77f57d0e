"""Digests of scenarios as this machine is, as if it had AVX2 only, and under every further Python it has.

python .ci/same_bytes.py SCENARIO[:METRES] ...    exit code 1 when two differ. A Python gets an environment of
its own with the pinned packages; one for which they cannot be installed is named and left out.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from shutil import which

ROOT = Path(__file__).parents[1]
RUN = "import sys, swath; swath.run(sys.argv[1], sys.argv[2], sets=sys.argv[3:], report=False)"
# numpy (2.4) without its code for AVX-512, kernels for AVX2, the code of OpenBLAS for AVX2.
AVX2_ONLY = {
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "SWATH_CPU": "haswell",
    "OPENBLAS_CORETYPE": "Haswell",
}


def pythons() -> dict[str, str]:
    """Executables of the Pythons from 3.11 on, by version; not the one that runs this."""
    named = [which(f"python3.{minor}") for minor in range(11, 20)]
    kept = sorted(Path.home().glob(".pyenv/versions/3.*/bin/python3"))
    found: dict[str, str] = {}
    for python in [*filter(None, named), *map(str, kept)]:
        ask = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
        asked = subprocess.run([python, "-c", ask], capture_output=True, text=True)
        version = asked.stdout.strip()
        if asked.returncode == 0 and tuple(map(int, version.split("."))) >= (3, 11):
            found.setdefault(version, python)
    found.pop(f"{sys.version_info.major}.{sys.version_info.minor}", None)
    return found


def environment(version: str, python: str) -> str | None:
    """An environment with swath for another Python: its executable, None when that cannot be made."""
    folder = ROOT / "out" / f"python-{version}"
    own = folder / "bin" / "python"
    install = [
        "-m",
        "pip",
        "install",
        "-q",
        "--disable-pip-version-check",
        "-c",
        "constraints.txt",
        "-e",
        ".",
    ]
    for command in ([python, "-m", "venv", str(folder)], [str(own), *install]):
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        if done.returncode:
            print(f"Python {version} is left out: {done.stderr.strip().splitlines()[-1:]}", flush=True)
            return None
    return str(own)


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
    for version, python in pythons().items():
        if own := environment(version, python):
            cases[f"Python {version}"] = (own, {})
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
