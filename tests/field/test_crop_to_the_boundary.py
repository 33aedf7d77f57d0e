"""An imported field bears crop up to its boundary, wherever its cells lie."""

from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip("rasterio")

from swath.commands.main import main
from swath.field.edges.boundary import Region
from swath.field_io.folder import read


def test_crop_stands_up_to_the_boundary(tmp_path):
    assert main(["field", "import", "sample-log", "--out", str(tmp_path / "f")]) == 0
    folder = read(tmp_path / "f")
    ring = np.vstack([folder.boundary, folder.boundary[:1]])
    along = np.concatenate([np.linspace(a, b, 9)[1:-1] for a, b in pairwise(ring)])
    way = np.concatenate([np.repeat((b - a)[None], 7, axis=0) for a, b in pairwise(ring)])
    inward = np.stack([-way[:, 1], way[:, 0]], axis=1) / np.hypot(*way.T)[:, None]
    points = along + 0.3 * inward
    points = points[Region(folder.boundary, folder.holes).contains(*points.T)]
    assert len(points) > 20
    stems = folder.stems
    column, row = (np.round((v - first) / stems.cell).astype(int) for v, first in zip(
        points.T, (stems.x0, stems.y0), strict=True
    ))  # fmt: skip
    assert np.isfinite(stems.values[row, column]).mean() > 0.98  # the cells whose middle lies outside, too
