"""`header_fill`: the share of the width that cuts, smooth from step to step although cells are cut whole."""

import numpy as np
import pytest

from swath.field.cutting.cut_result import Cut
from swath.machine.header.fixed_height import FixedHeightHeader, Params
from swath.machine.header.height_control import HeightControlHeader
from swath.machine.header.height_control import Params as HeightParams
from tests.machine.machine_fakes import STREAM, Ground, signed_area, site
from tests.machine.test_header import state

CELL = 1.0 / 64.0  # of the field [m]


class Cells(Ground):
    """Cuts rows of cells across the way by their middles, beside an edge at y = `edge`."""

    def __init__(self, edge):
        super().__init__()
        self.edge = edge

    def cut(self, polygon, height_m):
        x, y = np.array(polygon).T
        rows = np.floor(x.max() / CELL - 0.5) - np.ceil(x.min() / CELL - 0.5) + 1
        width = max(min(y.max(), self.edge) - y.min(), 0.0)
        return Cut(area=max(rows, 0.0) * CELL * width) if signed_area(polygon) > 0.0 else Cut()


@pytest.mark.parametrize("header", [FixedHeightHeader, HeightControlHeader])
@pytest.mark.parametrize(("edge", "share"), [(7.0, 1.0), (5.4, 0.95), (0.0, 0.5)])
def test_the_share_of_the_width_is_smooth_and_at_most_1(header, edge, share):
    part = header(Params() if header is FixedHeightHeader else HeightParams(), site(Cells(edge)))
    part.reset(STREAM)
    fills = [
        part.step(20_000_000 * i, 20_000_000, {"state": (state(0.0413 * i, 0.0, 0.0),)})["flow"].header_fill
        for i in range(400)
    ]
    settled = np.array(fills[100:])
    assert max(fills) <= 1.0
    assert settled.mean() == pytest.approx(share, abs=0.005)
    assert np.ptp(settled) < 0.02
    assert np.abs(np.diff(settled)).max() < 0.02


def test_it_follows_the_crop_within_some_metres_and_is_0_at_rest():
    ground = Cells(6.0)
    header = FixedHeightHeader(Params(), site(ground))
    header.reset(STREAM)
    read = [header.step(i, 1, {"state": (state(0.05 * i, 0.0, 0.0),)})["flow"] for i in range(100)]
    assert read[-1].header_fill > 0.98
    ground.edge = -6.0  # the field ends
    read = [header.step(i, 1, {"state": (state(0.05 * i, 0.0, 0.0),)})["flow"] for i in range(100, 180)]
    assert read[-1].header_fill == pytest.approx(np.exp(-4.0), rel=0.05)
    assert header.step(180, 1, {"state": (state(0.05 * 179, 0.0, 0.0),)})["flow"].header_fill == 0.0
