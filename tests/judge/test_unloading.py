"""When the deviation of a cart from its station is judged."""

from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.schedule import NS
from swath.judge.evaluators.unloading import COMES_UP, LEVEL
from swath.signals import MachineState, Station, UnloadState

BOX = SimpleNamespace(x=-5.0)


def metrics_of(aheads, flows, across=0.0):
    """A stream at (0, 5) of a machine at rest, every second; the box so far ahead of its station [m]."""
    machines = {name: SimpleNamespace(geometry=SimpleNamespace(box=BOX)) for name in ("combine", "cart")}
    seen = LEVEL.component(SimpleNamespace(machines=machines))

    def state(t, x, y):
        return {"state": MachineState(t, Pose.from_euler((x, y, 0.0)), 0.0, 0.0, 0.0, 0.0, 0.0)}

    for i, (ahead, flow) in enumerate(zip(aheads, flows, strict=True)):
        t = i * NS
        seen.see("combine.motion", t, state(t, 0.0, 0.0))
        seen.see("cart.motion", t, state(t, 5.0 - 1.0 + ahead, 5.0 + across))
        seen.see("cart.cooperate", t, {"station": Station(t, True, 0, 0, 0, 0, 0, 0, 1.0, False)})
        unload = UnloadState(t, 1.57, flow, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0)
        seen.see("combine.unload", t, {"state": unload})
    return seen.metrics()


def test_while_a_cart_comes_up_its_station_is_not_judged():
    """Grain flows from 2.5 m on; a deviation behind that counts, also a large one."""
    told = metrics_of([-2.5, -1.5, -0.6, -0.2, 0.1, 0.9], [90.0] * 6)
    assert told["station_along_max_m"] == pytest.approx(0.9)
    assert told["station_along_mean_m"] == pytest.approx(0.4)
    assert told["station_late_s"] == pytest.approx(2.0)
    assert told["unloading_s"] == pytest.approx(5.0)


def test_one_that_never_comes_there_is_judged_after_a_while():
    """Too far behind, or aside."""
    count = int(COMES_UP) + 4
    assert metrics_of([-2.0] * count, [90.0] * count)["station_along_max_m"] == pytest.approx(2.0)
    aside = metrics_of([0.0] * count, [90.0] * count, across=0.5)
    assert aside["station_across_max_m"] == pytest.approx(0.5)
    assert aside["station_late_s"] == pytest.approx(COMES_UP)
    assert np.isnan(metrics_of([-2.0] * 5, [90.0] * 5)["station_along_max_m"])


@pytest.mark.parametrize(("pause", "judged"), [(2, 1.5), (6, 0.2)])
def test_the_next_load_has_to_come_up_anew_and_a_short_pause_is_none(pause, judged):
    aheads = [0.0, 0.1, *[0.1] * pause, 1.5, 0.2]
    flows = [90.0, 90.0, *[0.0] * pause, 90.0, 90.0]
    assert metrics_of(aheads, flows)["station_along_max_m"] == pytest.approx(judged)
