"""Faults said in a scenario: in the graph, in a saved run, of a sensor that sits where nobody meant."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.record.digest import Digest
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.signals import CropEdge
from tests.whole.small import small


def driven(*sets, until_s=None):
    """Digest, edges and the world of a short run."""
    world, digest, edges = assemble(scenario(*sets)), Digest(), []

    def note(slot, t, outputs):
        edges.extend((t, s) for s in outputs.values() if isinstance(s, CropEdge))

    drive(world, [digest, note], until_s=until_s)
    return digest.hex, edges, world


def scenario(*sets):
    return small("run.distance_m=3", "combine.lidar={level: empirical, sector_deg: [-40, 40], step_deg: 1.0}",
                 *sets)  # fmt: skip


@pytest.fixture(scope="module")
def plain():
    return driven()


def test_a_fault_that_does_nothing_changes_no_byte(plain):
    assert driven("combine.edge.fault={latency_ms: 0}")[0] == plain[0]
    assert driven("field.seed=3")[0] == plain[0]  # that of the run


def test_the_field_has_a_seed_of_its_own(plain):
    other = driven("field.seed=4")
    assert other[0] != plain[0]
    assert np.isclose(other[1][-1][1].offset, plain[1][-1][1].offset, atol=0.5)


def test_late_edges_leave_late(plain):
    late = [t - edge.t for t, edge in driven("combine.edge.fault={latency_ms: 80}")[1] if t]
    usual = [t - edge.t for t, edge in plain[1] if t]
    assert min(late) == min(usual) + 80_000_000


def test_control_is_told_where_a_sensor_should_sit():
    world = driven("combine.lidar.mount_error={roll_deg: 1.5, y_m: 0.03}", until_s=0.1)[2]
    combine = world.machines["combine"]
    told, real = combine.mountings["lidar"], combine.parts["lidar"].mounting
    assert np.degrees(real.euler()[0] - told.euler()[0]) == pytest.approx(1.5)
    assert real.position[1] - told.position[1] == pytest.approx(0.03)


@pytest.mark.parametrize(
    "text",
    ["combine.motion.fault={latency_ms: 40}", "combine.header.fault={loss_percent: 4}",
     "combine.steer.mount_error={roll_deg: 1}", "combine.lidar.mount_error={rol_deg: 1}",
     "combine.edge.fault={bias: {offset: 1}}", "combine.edge.fault={hold_s: [[2, 1]]}"],
)  # fmt: skip
def test_what_cannot_go_wrong_is_refused_by_its_key(text):
    with pytest.raises(InputError) as found:
        assemble(scenario(text))
    assert found.value.key.startswith(text.partition("=")[0])
