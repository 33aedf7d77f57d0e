"""The example scenario made of meshes alone: the scanner sees sunflowers and the person beside them."""

from pathlib import Path

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.scenario.scenario import load_scenario
from swath.tools.scan.scan import scan_job

pytest.importorskip("trimesh", reason="trimesh is not installed")

FIELD = Path(__file__).parents[2] / "examples" / "meshes" / "field.yaml"


def test_the_scanner_sees_sunflowers_and_a_person(tmp_path):
    person = np.array([-3.0, 6.5])
    scan_job(
        load_scenario(FIELD, sets=["field.obstacles.0.y_m=6.5", "field.terrain.slope_percent=0"]),
        tmp_path,
        formats=["npz"],
    )
    with np.load(tmp_path / "scan.npz") as scan:
        points = scan["points_true_m"].reshape(-1, 3)
    near = np.linalg.norm(points[:, :2] - person, axis=1) < 0.4
    height = points[:, 2]
    assert np.sum(near & (height > 0.3)) >= 4
    crop = points[:, 0] > 0.3
    assert np.nanmax(height[crop]) > 1.4
    assert np.nanmax(height[~crop & ~near & (points[:, 0] < -0.6)]) < 0.75


def test_a_missing_mesh_is_named_with_its_line():
    with pytest.raises(InputError, match=r"field\.obstacles\.0\.file.*gone\.obj"):
        load_scenario(FIELD, sets=["field.obstacles.0.file=gone.obj"])
