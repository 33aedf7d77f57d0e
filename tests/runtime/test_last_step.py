"""The end of a run between two steps of the process: what the header cut last is in the machine."""

import pytest

from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import load_scenario
from swath.signals import CropFlow, MachineLoad


def driven(process, **chunks):
    """World, grain [kg] that the header took and that the process has; the last sample of the process."""
    off = ("combine.powertrain=off", "combine.crop_flow=off")
    sets = ["run.distance_m=5.36", f"combine.process={process}", *off]
    world = assemble(load_scenario("record-run", sets=sets))
    cut, loads = [], []

    def see(slot, t, outputs):
        for signal in outputs.values():
            if isinstance(signal, CropFlow):
                cut.append(signal.grain)
            if isinstance(signal, MachineLoad):
                loads.append(signal)

    if chunks:
        drive(world, [see], **chunks)
    drive(world, [see], resume=bool(chunks))
    last = loads[-1]
    grain = last.tank_gain + last.lost_grain + last.held_grain
    return world, sum(cut), grain, last


@pytest.mark.parametrize("process", ["constant", "delay_line", "threshing", "organs"])
def test_the_last_cut_is_in_the_process_when_the_run_ends(process):
    world, cut, grain, last = driven(process)
    period = next(n.slot.period for n in world.graph.nodes if n.slot.name == "combine.process")
    assert world.graph.t % period > 0
    assert last.t == world.graph.t
    assert grain == pytest.approx(cut, rel=1e-12)
    assert grain == pytest.approx(world.field.recount().grain, rel=1e-12)


def test_a_pause_between_two_steps_changes_nothing():
    _, cut, grain, last = driven("constant", until_s=1.23)
    assert (cut, grain, last) == driven("constant")[1:]
