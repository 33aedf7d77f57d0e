"""Columns of the charts that tracks do not have."""

import numpy as np
import pytest

from swath.replay.machines import derived


@pytest.mark.parametrize(("side", "sign"), [("left", -1.0), ("right", 1.0)])
def test_the_detected_edge_is_off_towards_the_crop_as_in_the_metrics(side, sign):
    """Seen 10 cm to the left of the true edge: that is out of the crop where the edge is on the left."""
    columns = {"edge_offset_m": np.array([3.1]), "edge_true_m": np.array([3.0])}
    assert derived(columns, side)["edge_error_m"] == pytest.approx([0.1 * sign])
