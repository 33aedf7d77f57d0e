"""Every place of swath that reads a file, and which of them the kinds come to with whole files.

    python -m tests.fuzz.readers      # what each kind is the first to come to, and its seconds

Exit code 1 where a kind is missing. A parser of `parsers.py` that is asked in this process is an error.
"""

import ast
import os
import re
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import swath
from swath.core.apart import call
from swath.core.process.processes import in_environment
from tests.fuzz.kinds import KINDS, REFUSED
from tests.fuzz.parsers import refused

ROOT = Path(swath.__file__).parent
WATCH = Path(__file__).parent / "watch"
Place = tuple[str, str]  # file below the package, function with its class; "" is the module itself
OWN = (  # of swath's own reading functions, and of methods and functions that read by themselves
    "open_to_read|check_readable|open_archive|open_parquet|read_arrays|read_document|read_mapping|read_json|"
    "read_object|text_lines|number_blocks|read_numbers|read_xml|read_text|read_bytes|open_log|open_channels|"
    r"read_tracks|open_geotiff|(?!os\.|device\.|memory\.)[\w.\[\]]+\.open|open"
)
FOREIGN = (
    r"MDF|\w+\.(BLFReader|ASCReader|MF4Reader|LogReader)|\w+\.database\.load(_file|_string)?|AnyReader|"
    r"make_reader|shapefile\.Reader|(ElementTree|ET|etree)\.(parse|iterparse|fromstring|XML)|"
    r"trimesh\.load\w*|np\.(load|loadtxt|genfromtxt|fromfile|memmap)|pq\.(ParquetFile|read_\w+)|"
    r"zipfile\.ZipFile|tarfile\.open|sqlite3\.connect|(pickle|json|marshal|yaml|tomllib)\.load|"
    r"read_model_description"
)
READS = re.compile(rf"(?:[\w.()\[\]/'\"{{}} ]+\.)?(?:{OWN})|{FOREIGN}")
MAY_READ = re.compile(
    r"(?:open|read|load|parse|Reader|MDF|File|connect|fromstring|XML|text_lines|blocks)\w*\("
)
PARTS_OF_SWATH = {  # sources of compiled code and pages, data sheets, examples: installed with it
    "commands/docs.py", "commands/new.py", "commands/scenarios.py", "field/cutting/height_kernel.py",
    "field/cutting/recount_kernel.py", "field/light.py", "fleet/ground_kernel.py", "kernels.py",
    "link/can/codec.py", "rays/packets/kernel.py", "rays/sight_kernel.py", "rays/single/kernel.py",
    "replay/writer.py", "report/html.py", "sensing/native/dust_kernel.py", "sensing/native/kernel.py",
    "sensing/native/normals_kernel.py", "sensing/native/receive_kernel.py",
}  # fmt: skip
NO_STRANGERS = {
    ("api.py", "ScanResult._repr_html_"): "pictures that the same call wrote",
    ("api.py", "scan"): "a table that the same call wrote",
    ("commands/main.py", "_open_closed"): "os.devnull",
    ("judge/summary.py", "processor"): "/proc/cpuinfo",
    ("link/device/wires.py", "Reader._read_terminal"): "a terminal that the user named",
    ("link/fmi/export_slave.py", "Session.__init__"): "what lies beside the code of an FMU that runs already",
    ("tools/field_export/glb.py", "glb_bytes"): "a picture in memory that the same call drew",
}
FIRST = (  # kinds that come to all of it in the least time; the others are read where these do not do
    "command-test-plan",
    "fmu-doubtful",
    "drawn-jobs",
    "scans-csv",
    "mf4-played",
    "mesh-glb",
    "field-plan",
    "field-folder",
    "log-shapefile",
    "ssp",
    "field-state",
    "heights-csv",
    "frames-blf-plain",
    "run-shown",
    "task-plan",
    "job-results",
    "odd",
    "lines-geojson",
    "events",
    "body-sdf",
    "outline-kml",
    "candidates",
    "agopengps",
    "spread-table",
    "seen-people",
    "own-code",
    "columns",
    "beams-csv",
    "test-told",
    "geotiff",
    "command-part",
    "height-grid",
    "command-sheets",
    "weather",
    "cloud-laz",
    "mcap-sent",
    "command-jobs",
    "exported",
    "scans-npz",
    "command-yield-log",
    "export-platform",
    "saves",
    "test-campaign",
    "bag-ros1",
    "command-diff",
    "test-compared",
    "bag-sqlite",
    "bag-packed",
    "pictures",
    "test-estimate",
    "command-osi",
    "run-log",
    "run-again",
    "run-folder",
    "scan-kept",
    "network",
)


@cache
def places() -> frozenset[Place]:
    """Functions that read."""
    found: set[Place] = set()
    for file in sorted(ROOT.rglob("*.py")):
        name = file.relative_to(ROOT).as_posix()
        text = file.read_text(encoding="utf-8")
        for function, each in _calls(ast.parse(text), "") if MAY_READ.search(text) else ():
            last = getattr(each.func, "attr", getattr(each.func, "id", ""))
            if MAY_READ.search(f"{last}(") and READS.fullmatch(ast.unparse(each.func)) and not _writes(each):
                found.add((name, function))
    return frozenset(found)


def _writes(call: ast.Call) -> bool:
    """Whether a call says that it makes a file: by its mode, or the version of a new one."""
    modes = [a.value for a in (*call.args, *(k.value for k in call.keywords)) if isinstance(a, ast.Constant)]
    return "w" in modes or any(k.arg == "version" for k in call.keywords)


def _calls(node: ast.AST, inside: str) -> Iterator[tuple[str, ast.Call]]:
    """Calls below a node, each with the function that makes it. Decorators belong to what is around it."""
    around = [(node, inside)]
    while around:
        node, inside = around.pop()
        if isinstance(node, ast.Call):
            yield inside, node
        within = inside
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            within = f"{inside}.{node.name}".lstrip(".")
        outside = getattr(node, "decorator_list", ())
        around += [(part, inside if part in outside else within) for part in ast.iter_child_nodes(node)]


class Watch:
    """Notes which of the wanted places are come to, here and in processes that are started meanwhile."""

    def __init__(self, wanted: Iterable[Place], folder: Path) -> None:
        self.wanted, self.reached = frozenset(wanted), set[Place]()
        self._names = {name.rpartition(".")[2] for _, name in self.wanted}
        self._folder, begins = folder, f"{ROOT}/"
        self._cut = len(begins)
        (folder / "wanted").write_text("".join(f"{file}\t{name}\n" for file, name in self.wanted))
        os.mkfifo(folder / "said")
        self._said = os.open(folder / "said", os.O_RDWR | os.O_NONBLOCK)

    @contextmanager
    def __call__(self) -> Iterator[None]:
        """Inside the block places are noted."""
        before = sys.gettrace()
        threading.settrace(self._called)
        sys.settrace(self._called)
        try:
            yield
        finally:
            sys.settrace(before)
            threading.settrace(before)  # type: ignore[arg-type]
            self._hear()

    @contextmanager
    def in_processes(self) -> Iterator[None]:
        """Inside the block other Pythons that are started note them, too; some serve kind after kind."""
        path = os.pathsep.join([str(WATCH), os.environ.get("PYTHONPATH", "")])
        with in_environment(PYTHONPATH=path, WATCHED_BY_TESTS=str(self._folder)):
            yield

    def _called(self, frame: Any, _event: str, _about: Any) -> None:
        code = frame.f_code
        if code.co_name in self._names:
            place = code.co_filename[self._cut :], code.co_qualname.replace(".<locals>", "")
            if place in self.wanted:
                self.reached.add(place)

    def _hear(self) -> None:
        try:
            while data := os.read(self._said, 1 << 16):
                self.reached |= {
                    (f, n) for f, _, n in (line.partition("\t") for line in data.decode().splitlines())
                }
        except BlockingIOError:
            pass

    def close(self) -> None:
        """Close what other processes speak into."""
        os.close(self._said)


def _shared(folder: Path, usual: Any) -> Any:
    """Readers' processes for all files below a folder, one for each set of libraries: to start one for each
    kind takes half of the time. Elsewhere as usual.
    """
    root, held = os.path.realpath(folder), dict[tuple[str, ...], Any]()

    def process_for(path: Path, size: int, libraries: tuple[str, ...]) -> Any:
        if not os.path.realpath(path).startswith(f"{root}/"):
            return usual(path, size, libraries)
        made = held.get(libraries)
        if made is None or not made.is_alive or made.size < size:
            size = max(size, call.USUAL_BYTES)
            made = held[libraries] = call._Process(frozenset({root}), frozenset(libraries), size)
        return made

    return process_for


def come_to(
    kinds: Iterable[str], wanted: Iterable[Place], folder: Path
) -> Iterator[tuple[str, set[Place], float]]:
    """Each kind with the wanted places that it is the first to come to, and the seconds of making and reading
    its files; until none is left.
    """
    (folder / "watch").mkdir()
    watch = Watch(wanted, folder / "watch")
    try:
        shared = _shared(folder, call._process_for)
        with watch.in_processes(), patch.object(call, "_process_for", shared):
            for kind in kinds:
                if watch.wanted <= watch.reached:
                    return
                before, begin = set(watch.reached), time.process_time()
                (folder / kind).mkdir()
                KINDS[kind].make(folder / kind)
                call._written.clear()  # what it made is a stranger's, and what it makes
                with watch(), refused() as parsers, patch.object(call, "MOST_WRITTEN", 0):
                    KINDS[kind].read(folder / kind)
                assert not parsers, f"{kind}: {parsers}"
                yield kind, watch.reached - before, time.process_time() - begin
    finally:
        watch.close()


def of_strangers() -> set[Place]:
    """Places to which a file of a stranger may come."""
    return {place for place in places() if place[0] not in PARTS_OF_SWATH} - NO_STRANGERS.keys()


def main() -> int:
    """The command line."""
    left = of_strangers()
    rest = [kind for kind in KINDS if kind not in (*FIRST, *REFUSED)]
    with tempfile.TemporaryDirectory() as folder:
        for kind, new, seconds in come_to([*FIRST, *rest], set(left), Path(folder)):
            left -= new
            print(f"{seconds:6.2f} {kind:24}", *(f"{file}:{name}" for file, name in sorted(new)), flush=True)
    print(*(f"no kind comes to {name} of {file}" for file, name in sorted(left)), sep="\n")
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main())
