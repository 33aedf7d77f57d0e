"""What tests may take: a test that is not known, one that is no more, a folder over its budget."""

from tests.durations import faults

KEPT = {
    "budgets": {"tests/core": 2.0},
    "test": {"tests/core/test_a.py": {"test_x": 1.5}},
    "draws": {"tests/core/test_a.py": {"test_y": 99.0}},
}
NOW = {"tests/core/test_a.py": {"test_x", "test_y"}}


def test_tests_and_folders_are_held():
    assert list(faults(KEPT, NOW)) == []
    new = {"tests/core/test_a.py": {"test_x", "test_z"}, "tests/test_b.py": {"test_b"}}
    assert list(faults(KEPT, new)) == [
        "tests/core/test_a.py::test_z: how long it takes is not known",
        "tests/core/test_a.py::test_y: is no more",
        "tests/test_b.py::test_b: how long it takes is not known",
    ]
    (over,) = faults({**KEPT, "budgets": {"tests/core": 1.0}}, NOW)
    assert over == "tests/core: 2 CPU-s in `make test`, 1 are its budget"
