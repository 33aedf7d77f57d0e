"""What a simulated second of `straight` takes, and the classes that samples go through, grow no more.

The bounds are what `python -m benchmarks.counts` counts now; other load on the machine does not move it. A
change that lowers a count writes the new number here in the same commit. A change that raises one gives
something for it, which its commit names; otherwise it is mended.
"""

import sys

import pytest
from benchmarks.counts import (
    BYTECODES,
    CALLS,
    MODULES,
    STEPS,
    SUPPLIES,
    WALKS,
    asks_for_types,
    classes,
    in_a_process,
)

LEVELS = {"lidar": "profile", "header": "profile", "motion": "kinematic", "edge": "otsu"}
PROFILE = [f"--set=combine.{slot}.level={level}" for slot, level in LEVELS.items()]
BOUNDS = [  # arguments of benchmarks.counts -> what a simulated second takes, of all worlds
    ([], {BYTECODES: 107_700, CALLS: 2_812, WALKS: 7, STEPS: 0, SUPPLIES: 4}),
    (["--worlds=4"], {BYTECODES: 85_100, CALLS: 2_142, WALKS: 6, STEPS: 0, SUPPLIES: 6}),
    (["--worlds=4", *PROFILE], {BYTECODES: 52_000, CALLS: 1_055, WALKS: 6, STEPS: 0, SUPPLIES: 4}),
]
SPARE = 1.002  # versions of numpy and Warp differ in their own Python; estimated
STARTS = {  # command line -> bytecodes, modules
    "--help": (90_600, 102), "run --help": (63_750, 30), "walk": (15_190, 27), "": (5_740, 27),
}  # fmt: skip
CLASSES, ASKING = 44, 7


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="other versions of Python have other bytecodes")
@pytest.mark.parametrize(("arguments", "bounds"), BOUNDS, ids=["one", "4 worlds", "4 worlds of profile"])
def test_a_simulated_second_takes_no_more(arguments, bounds):
    found, modules = in_a_process(*arguments)
    grown = {name: (found[name], most) for name, most in bounds.items() if found[name] > SPARE * most}
    assert not grown, "more than before: see above what to do (count, bound)"
    assert found[BYTECODES] == sum(modules.values()) > found[CALLS] > found[WALKS] > 0


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="other versions of Python have other bytecodes")
@pytest.mark.parametrize("words", STARTS)
def test_a_start_takes_no_more(words):
    found, _ = in_a_process(f"--start={words}")
    most_bytecodes, most_modules = STARTS[words]
    assert 0 < found[BYTECODES] <= SPARE * most_bytecodes
    assert 0 < found[MODULES] <= most_modules


def test_a_sample_goes_through_no_more_classes():
    assert sum(classes().values()) <= CLASSES
    assert len(asks_for_types()) <= ASKING
