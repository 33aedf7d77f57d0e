"""A short seed of the fuzz: damaged files and command lines of the kinds that are quick to read."""

import pytest

from tests.fuzz.kinds import KINDS
from tests.fuzz.run import Worker

pytest.importorskip("rasterio")
pytest.importorskip("trimesh")
SLOW = {
    "log-import", "height-grid", "scans-npz", "geotiff", "bag-ros1", "bag-mcap", "run-folder", "cloud-las",
    "cloud-laz", "tuning", "test-search", "test-results", "test-estimate", "test-campaign", "saves",
    "run-again", "run-log", "run-shown", "pictures", "exported", "mf4-played", "bag-packed",
}  # fmt: skip
LINES = ("import-dem", "import-zip", "import-task", "sheets", "fmu", "words", "jobs", "compare")
QUICK = [
    kind for kind in KINDS if kind not in SLOW and not kind.startswith(("scenario", "fmu", "ssp", "command"))
]
QUICK += [f"command-{name}" for name in LINES]
ONCE_FAILED = [
    ("log-shapefile", 2),  # fewer records than the .dbf declares
    ("scans-npz", 10),  # a member that is no array
    ("scans-npz", 500060),  # a time of 1e252 s
    ("run-folder", 500013),  # a stored scenario that is not UTF-8
    ("command-diff", 500009),  # a summary without one of its keys
    ("command-yield-log", 500111),  # tracks without rows
    ("command-show", 1700055),  # a name in a raster that is not UTF-8
    ("command-calibrate", 1300005),  # a name too long for the system
    ("mesh-gltf", 0),  # a corner that is not there
    ("spread-table", 12),  # a damaged stream
    ("spread-table", 2),  # a message that quotes the file
    ("isoxml", 75),  # an unknown encoding
    ("lines-geojson", 204),  # a whole number too large for a float
    ("field-folder", 36),  # nested coordinates
    ("saves", 9),  # a page of a save whose check sum is wrong
]


@pytest.fixture(scope="module")
def worker(tmp_path_factory):
    made = Worker(tmp_path_factory.mktemp("fuzz"))
    yield made
    made.close()


@pytest.mark.draws
@pytest.mark.parametrize(("kind", "number"), [*ONCE_FAILED, *((kind, 1) for kind in QUICK)])
def test_a_damaged_file_is_read_or_refused_in_short(worker, kind, number):
    said, more, file, *_ = worker.ask(kind, number)
    assert said in ("valid", "refused"), f"{file}: {more}"
