"""The listings of a page, used as its reader does: files saved, lines typed in their order, in one folder.

python -m docs.make.typed PAGE.md            in an empty folder; runs are cut to a moment, figures stay blank
python -m docs.make.typed PAGE.md --whole    as the page says, with the time of each line, also of all processors

A listing is saved where the paragraph above it says "save ... as `NAME`". Lines are those of listings in `sh` and of
plain ones. Only packages of swath itself and of the extras that the page tells to install can be imported.
"""

import os
import re
import shlex
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import redirect_stdout
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

from matplotlib.figure import Figure
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs" / "how-to").glob("*.md"))]
LISTING = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SAVED = re.compile(r"\b[Ss]ave\b[^`]*`([\w-]+\.(?:yaml|py))`[^`]*$")
INSTALLED = re.compile(r"pip install\s+'swath\[([\w,]+)\]'")
LONG = {  # over a minute: cut by the tests, typed whole by benchmarks/typed_lines.py
    "dataset straight --count 1000": "a second or two a picture",
    "dataset straight --scans --count 20": "half a minute a drive",
    "paper": "twelve runs",
    "test run catalogue": "every case",
    "test search": "64 runs",
    "test estimate": "2000 runs",
    "test plan-field": "128 runs",
    "tune bend": "some 600 runs",
    "twin fit runs/one": "700 runs",
}
ELSEWHERE = {  # needs more than this machine: the test that does it
    "python examples/can/my_controller.py": "tests/whole/test_can_runs.py",
    "ros2 param": "tests/link/test_ros2_bridge.py",
    "swath can box": "tests/whole/test_can_runs.py",
    "swath can listen": "tests/whole/test_can_runs.py",
    "swath run examples/can/hil.yaml": "tests/whole/test_can_runs.py",
    "swath run examples/devices/": "tests/link/test_device_loop.py",
    "python examples/devices/my_box.py": "tests/link/test_device_loop.py",
    "swath run feed-rate --isobus": "tests/link/test_isobus.py",
    "swath run straight --real-time --device": "tests/link/test_device_loop.py",
    "swath run straight --real-time --set field.origin": "tests/link/test_independent_sides.py",
    "swath run laser-pilot --ros2": "tests/link/test_ros2_bridge.py",
}
HIDING = """import sys

HIDDEN = {hidden!r}


class Hiding:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in HIDDEN:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)


sys.meta_path.insert(0, Hiding())
"""
MOMENT = {"run.max_duration_s": "0.4", "run.distance_m": "2"}


def steps(text: str) -> Iterator[tuple[str, str]]:
    """(name of a file, its content) or ("", a line to type), in the order of the page."""
    end = 0
    for found in LISTING.finditer(text):
        language, content = found.groups()
        above, end = text[end : found.start()].rstrip().rpartition("\n\n")[2], found.end()
        if language in ("yaml", "python", "py"):
            if name := SAVED.search(above):
                yield name[1], content
        elif language in ("", "sh"):
            for line in re.sub(r"\\\n\s*", "", content).splitlines():
                if line.strip() and not line.startswith(("#", "pip install")):
                    yield "", line.strip()


def shortened(words: list[str]) -> list[str]:
    """The same line of swath, quicker: a moment of a run, few runs of a test, two pictures."""
    said = {word.partition("=")[0] for word in words}
    short = [] if "run.max_duration_s" in said else [f"{k}={v}" for k, v in MOMENT.items() if k not in said]
    sets = [part for word in short for part in ("--set", word)]
    match words[:2]:
        case ["run", _]:
            is_used = {"--out", "--save-field", "--foxglove"} & set(words)
            unrecorded = [] if is_used else ["--set", "run.record=none"]
            pages = [word for word in ("--no-report", "--no-replay") if word not in words]
            return [*words, *sets, *unrecorded, *pages]
        case ["branch", _]:  # of a run that was shortened, too
            at = next(k for k, word in enumerate(words) if word in ("--at", "--at-s")) + 1
            return [*words[:at], "0.2", *words[at + 1 :]]
        case ["dataset", _] if "--scans" in words:
            return [*words, *sets, "--count", "2", "--workers", "1"]
        case ["dataset", _]:
            return [*words, "--count", "2", "--width", "64", "--height", "48", "--workers", "1"]
        case ["test", "run"] if "--odd" in words:
            return [*words, *sets, "--runs", "8", "--workers", "1"]
        case ["test", "run"] if words[2] == "catalogue":
            return [*words, "--plan-only"]
        case ["test", "run"]:
            draw = "2" if "--with" in words else "1"  # candidates are compared over what both met
            return [*words, *sets, "--draw", draw, "--seeds", "1", "--workers", "1"]
        case ["tune", *_]:
            words = ["margin" if w == "lateral_rms_m" else w for w in words]  # a moment has none of it
            return [*words, *sets, "--tries", "10", "--each", "1", "--proof", "10", "--workers", "1"]
        case ["test", "plan-field"]:
            return [*words, *sets, "--pairs", "8", "--runs", "2", "--workers", "1"]
        case ["twin", "fit"] if "--still" not in words:
            return [*words, "--runs", "40", "--workers", "1"]
        case ["test", "search"]:
            return [*words, *sets, "--budget", "8", "--workers", "1"]
        case ["test", "estimate"]:
            return [*words, *sets, "--budget", "20", "--workers", "1"]
    return words


def allowed(words: list[str]) -> tuple[int, ...]:
    """Exit codes of a line that works; so short a run may miss a limit, so few runs show nothing."""
    return {
        "run": (0, 1, 3),
        "rerun": (0, 1, 3),
        "branch": (0, 1, 3),
        "test": (0, 1, 3),
        "tune": (0, 1, 3, 4),
        "twin": (0, 1, 3),
    }.get(words[0], (0,))


def type_line(line: str, *, is_whole: bool) -> None:
    """One line; SystemExit where it fails."""
    words = shlex.split(line, comments=True)
    if words[0] != "swath" or is_whole:
        code = subprocess.run(["bash", "-c", line], check=False).returncode
        codes = allowed(words[1:]) if words[0] == "swath" else (0,)
    else:
        from swath.commands.main import main

        words, codes = shortened(words[1:]), allowed(words[1:])
        if ">" in words:
            cut = words.index(">")
            with Path(words[cut + 1]).open("w", encoding="utf-8") as file, redirect_stdout(file):
                code = main(words[:cut])
        else:
            code = main(words)
    if code not in codes:
        raise SystemExit(f"{line}: exit code {code}")
    if "--out" in words and not Path(words[words.index("--out") + 1]).exists():
        raise SystemExit(f"{line}: {words[words.index('--out') + 1]} is not there")


def work_through(text: str, *, is_whole: bool = False) -> None:
    """All listings of a page, in the folder where one stands."""
    for name, content in steps(text):
        if name:
            Path(name).write_text(content, encoding="utf-8")
        elif not content.startswith(tuple(ELSEWHERE)) and (is_whole or not content.startswith("swath paper")):
            print(f"$ {content}", flush=True)
            start, before = time.monotonic(), os.times()
            type_line(content, is_whole=is_whole)
            if is_whole:
                after = os.times()
                busy = sum(after[2:4]) - sum(before[2:4])  # of child processes that have ended
                print(f"# {time.monotonic() - start:.1f} s, {busy:.1f} CPU-s", flush=True)


def extras_of(text: str) -> list[str]:
    """The extras that a page tells to install."""
    return sorted({extra for found in INSTALLED.findall(text) for extra in found.split(",")})


def distributions(needs: list[str]) -> set[str]:
    """What these requirements install here, with what those require."""
    found: set[str] = set()
    todo = [(Requirement(need), "") for need in needs]
    while todo:
        need, extra = todo.pop()
        name = canonicalize_name(need.name)
        if (need.marker and not need.marker.evaluate({"extra": extra})) or name in found:
            continue
        try:
            further = requires(name) or []
        except PackageNotFoundError:
            continue
        found.add(name)
        todo += [(Requirement(line), extra) for line in further for extra in (need.extras or ("",))]
    return found


@cache
def hidden(*extras: str) -> list[str]:
    """Modules of the other extras, which somebody with these ones alone does not have."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    optional = project["optional-dependencies"]
    own = [*project["dependencies"], *(need for extra in extras for need in optional[extra])]
    others = (
        distributions([need for needs in optional.values() for need in needs])
        - distributions(own)
        - {"swath"}
    )
    return sorted(
        module
        for module, names in packages_distributions().items()
        if {canonicalize_name(name) for name in names} <= others and not module.startswith("_")
    )


def write_hiding(folder: Path, text: str) -> None:
    """A sitecustomize.py for PYTHONPATH with which a page has its own installation and no more."""
    code = HIDING.format(hidden=hidden(*extras_of(text)))
    (folder / "sitecustomize.py").write_text(code, encoding="utf-8")


if __name__ == "__main__":
    if "--whole" not in sys.argv:
        Figure.draw = lambda self, renderer: None  # type: ignore[method-assign]
    work_through(Path(sys.argv[1]).read_text(encoding="utf-8"), is_whole="--whole" in sys.argv)
