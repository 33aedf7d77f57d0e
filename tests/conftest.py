"""Shared by all tests; lets them import the modules beside this file."""

import gc
import json
import os
import re
import signal
import socket
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from matplotlib.figure import Figure

from swath.core.apart import call
from swath.core.foreign_code import allow_code
from tests.driven import Driven
from tests.pages import judged

call.is_apart = False  # in modules while they are collected; for tests see pytest_runtest_setup

# A shell starts what runs in the background with Ctrl-C ignored, and every process that it starts, too.
signal.signal(signal.SIGINT, signal.default_int_handler)

os.environ.pop("COLUMNS", None)  # lists are as wide as they take

# The same cases in every run; HYPOTHESIS_PROFILE=search looks for new ones.
SLOW = [HealthCheck.too_slow]  # asks the clock, as deadlines do, which a busy machine fails
settings.register_profile("same", derandomize=True, deadline=None, suppress_health_check=SLOW)
settings.register_profile("search", print_blob=True, deadline=None, suppress_health_check=SLOW)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

ROOT = Path(__file__).parents[1]
LONGEST = (  # what takes longest, in this order
    "tests/test_tutorials.py", "tests/fleet/", "tests/test_docs_typed.py",
    "tests/test_site.py", "tests/whole/", "tests/link/", "tests/tools/", "tests/fuzz/", "tests/machine/",
    "tests/field/",
)  # fmt: skip


SPENT = {"test": {}, "draws": {}}  # CPU time [s] by file and test, of all cases and what they start


def pytest_addoption(parser):
    """`--write-durations FILE`: the CPU time of each test, as JSON, for `python -m tests.durations keep`."""
    parser.addoption("--write-durations", type=Path, metavar="FILE")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    """Note what a test and its processes spend, with its fixtures where it is the first to use them."""
    before = os.times()
    item.user_properties.append(("cpu_before", sum(before[:4])))
    yield


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item, call):
    """The report of a test's end says what it spent, also to the process that gathers reports."""
    if call.when == "teardown":
        began = dict(item.user_properties)["cpu_before"]
        item.user_properties[:] = [("cpu_s", sum(os.times()[:4]) - began)]
    yield


def pytest_runtest_logreport(report):
    """Add up by test."""
    if report.when == "teardown":
        file, _, name = report.nodeid.partition("::")
        of = SPENT["draws" if "draws" in report.keywords else "test"].setdefault(file, Counter())
        of[name.partition("[")[0].rpartition("::")[2]] += dict(report.user_properties).get("cpu_s", 0.0)


def pytest_sessionfinish(session):
    """Write them, in the process that gathers reports."""
    file = session.config.getoption("--write-durations")
    if file is not None and not hasattr(session.config, "workerinput"):
        found = {
            part: {name: {test: round(seconds, 2) for test, seconds in sorted(tests.items())}
                   for name, tests in files.items()}
            for part, files in SPENT.items()
        }  # fmt: skip
        file.write_text(json.dumps(found) + "\n")


WAITS = re.compile(
    r"^\s*(from|import) (threading|multiprocessing|concurrent|socket|signal)\b"
    r"|\bPopen\b|\bos\.kill|\btests\.waiting\b",
    re.MULTILINE,
)
HELPERS = re.compile(r"^from ((?:tests|benchmarks)\.[\w.]+) import", re.MULTILINE)


@cache
def waits(file):
    """Whether a test file, or a module beside it that it imports, has to do with threads or processes."""
    text = file.read_text(encoding="utf-8")
    helpers = (ROOT / f"{name.replace('.', '/')}.py" for name in HELPERS.findall(text))
    texts = (text, *(helper.read_text(encoding="utf-8") for helper in helpers if helper.is_file()))
    return any(map(WAITS.search, texts))


def pytest_collection_modifyitems(items):
    """Mark tests that wait. Files that take longest come first: no worker is left with one at the end."""
    for item in items:
        if waits(item.path):
            item.add_marker("waits")
    ranks = {name: rank for rank, name in enumerate(LONGEST)}
    items.sort(key=lambda i: next((r for n, r in ranks.items() if i.nodeid.startswith(n)), len(ranks)))


DRAW = Figure.draw


def pytest_runtest_setup(item):
    """Figures are made but stay blank, which spares seconds a page: tests marked `drawn` draw them. Files of
    others are read here, which spares the start of a process a folder: tests marked `apart` read as users do.
    """
    Figure.draw = DRAW if item.get_closest_marker("drawn") else lambda self, renderer: None
    call.is_apart = item.get_closest_marker("apart") is None


def pytest_collection_finish():
    """Modules and tests stay to the end: full collections need not look through them, 3 % of the time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def driven(tmp_path_factory):
    """Folders of runs that are driven once for all workers: `driven("straight", "run.distance_m=20")`."""
    own = tmp_path_factory.getbasetemp()
    return Driven((own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "driven")


@pytest.fixture(autouse=True)
def _driven_stays(request):
    """Who writes into a shared folder fails."""
    yield
    if "driven" in request.fixturenames and isinstance(shared := request.getfixturevalue("driven"), Driven):
        shared.check()


@pytest.fixture(autouse=True, scope="session")
def _pages_hold_what_all_must():
    """A test that makes a page with something wrong with it fails."""
    with judged():
        yield


@pytest.fixture
def code_allowed():
    """Python files and FMUs that the test names may run, as with `--allow-code`."""
    with allow_code(None):
        yield


@pytest.fixture(scope="module")
def code_allowed_in_module():
    """As `code_allowed`, for all of a module, its own fixtures too."""
    with allow_code(None):
        yield


@pytest.fixture
def reached(monkeypatch):
    """(method, address) of what sockets of this process are bound to, connected to or sent to.

    An audit hook would stay for all tests to come, which take 3 % longer with it.
    """
    found = []

    def noting(name):
        asked = getattr(socket.socket, name)

        def note(own, *args):
            found.append((name, args[-1]))
            return asked(own, *args)

        return note

    for name in ("bind", "connect", "connect_ex", "sendto"):
        monkeypatch.setattr(socket.socket, name, noting(name))
    return found


@pytest.fixture(autouse=True)
def _handlers_of_signals_stay():
    """A test that leaves another handler, its own or one of a library, would change those after it."""
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    yield
    after = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    assert after == before
