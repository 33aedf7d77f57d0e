"""The picture of the ways of the crop shows what went through the machine."""

import numpy as np
import pytest

from swath.core.number_text import num
from swath.machine.process.constant import LEVEL as CONSTANT
from swath.report.flow import THIN, FlowSampler, flow_figure
from tests.fake_run import machine
from tests.machine.machine_fakes import site
from tests.machine.process_rig import Rig, Row


def driven(process, seconds, crop=None):
    rig = Rig(engine=False, process=process, crop=crop)
    found, rows = FlowSampler(machine()), {"t_s": [], **{f"{n}_loss_kg_s": [] for n in WAYS}}
    found("combine.process", 0, {"load": rig.load})
    for _ in range(round(10 * seconds)):
        load = rig.step(2.0)
        made = {"load": load} if rig.organs is None else {"load": load, "organs": rig.organs}
        found("combine.process", rig.t, made)
        found("cart.process", rig.t, {"load": load})  # another machine's
        rows["t_s"].append(rig.t * 1e-9)
        for name in WAYS:
            rows[f"{name}_loss_kg_s"].append(getattr(load, f"{name}_loss"))
    return rig, found, {name: np.array(values) for name, values in rows.items()}


WAYS = ("threshing", "separation", "cleaning")


@pytest.mark.parametrize("share", [0.5, 1.0, 1.4])
def test_bands_are_as_wide_as_the_masses(share):
    rig, found, tracks = driven(Row(site(period=0.1)), 60, lambda x: (0.97 * share, 0.6 * share))
    load = rig.load
    assert found.shows
    lost = sum(found.kg[f"{name}_loss"] for name in WAYS)
    assert lost == pytest.approx(load.lost_grain, rel=1e-9)
    left = load.tank_gain + load.lost_grain + load.dropped_straw + load.held_grain + load.held_straw
    assert found.kg["header_flow"] == pytest.approx(left, rel=1e-9)
    fig = flow_figure(found, tracks)
    cut, *ends, back = (patch.get_linewidth() for patch in fig.axes[0].patches)
    straw, _, _, shoe, chaff, _, tank = ends
    kg = found.kg
    point = cut / kg["header_flow"]
    assert shoe / point == pytest.approx(kg["shoe_flow"], rel=1e-6)
    assert back == pytest.approx(max(kg["return_flow"] * point, THIN), rel=1e-6)
    assert (straw + chaff) / point == pytest.approx(load.dropped_straw, rel=1e-6)
    assert tank / point == pytest.approx(load.tank_gain + found.tank_mog, rel=1e-6)
    said = [text.get_text() for text in fig.axes[0].texts]
    assert f"tank {num(load.tank_gain + found.tank_mog)} kg" in said
    assert len([text for text in said if text.endswith("of the grain")]) == 3


def test_a_process_without_organs_has_none():
    setup = site(period=0.1)
    _, found, _ = driven(
        CONSTANT.component(CONSTANT.params(feed_delay_s=1.0, grain_delay_s=2.0, straw_delay_s=2.0), setup), 20
    )
    assert not found.shows
