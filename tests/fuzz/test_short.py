"""A short seed of the fuzz: a few damaged files of every kind that is quick to read."""

import pytest

from tests.fuzz.kinds import KINDS
from tests.fuzz.run import run

pytest.importorskip("rasterio")
pytest.importorskip("trimesh")
SLOW = {"log-import", "migrate", "height-grid", "scans-npz", "geotiff"}
KNOWN = [
    ("log-shapefile", 2),  # fewer records than the .dbf declares
    ("scans-npz", 10),  # a member that is no array
]


def test_damaged_files_are_valid_or_refused_in_short():
    quick = [k for k in KINDS if k not in SLOW and not k.startswith("scenario")]
    counts, failures = run(quick, first=0, cases=1, seconds=60.0)
    assert failures == []
    assert counts["refused"] > len(quick) // 3


@pytest.mark.parametrize(("kind", "number"), KNOWN)
def test_what_once_failed_is_refused(kind, number):
    _counts, failures = run([kind], first=number, cases=1, seconds=60.0)
    assert failures == []
