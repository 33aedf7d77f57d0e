"""An organ that swath exported as an FMU, taken back into its slot."""

import json

import pytest

from swath.core.foreign_code import allow_code
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from swath.signals import MachineLoad
from swath.signals.flat import flat_fields, read
from tests.link.fmu_scenario import TEXT

pytest.importorskip("fmpy", reason="needs the extra fmi")
pytest.importorskip("pythonfmu3", reason="needs the extra fmi")
from swath.link.fmi.export import export_fmu

LONG = TEXT.replace("distance_m: 3, max_duration_s: 6", "distance_m: 40, max_duration_s: 12.57")


def driven(cleaning):
    """The loads of a run with this shoe, and what its field misses of grain."""
    with allow_code(None):
        scenario = parse_scenario(LONG + f"    process: organs\n    cleaning: {json.dumps(cleaning)}\n")
        world, loads = assemble(scenario), []
    drive(
        world,
        [lambda slot, t, outputs: loads.extend(s for s in outputs.values() if isinstance(s, MachineLoad))],
    )
    world.close()
    return scenario, loads, world.field.recount()


@pytest.mark.parametrize("level", ["overload", "model"])
def test_a_sieve_as_an_fmu_equals_the_part(tmp_path, level):
    scenario, own, _ = driven({"level": level})
    export_fmu(scenario, ["combine.cleaning"], tmp_path / "sieve.fmu")
    _, loads, missing = driven({"level": "fmu", "file": str(tmp_path / "sieve.fmu")})
    assert len(own) == len(loads) > 120
    for a, b in zip(own[:-1], loads[:-1], strict=True):
        for name in flat_fields(MachineLoad):
            assert read(b, name) == pytest.approx(read(a, name), rel=1e-12, abs=1e-12), name
    last = loads[-1]  # a rest of a step, which the FMU does not take
    assert last.tank_grain > 20.0
    grain = last.tank_gain + last.lost_grain + last.held_grain
    assert grain == pytest.approx(missing.grain, rel=1e-12)
    assert last.dropped_straw + last.held_straw == pytest.approx(missing.straw, rel=1e-12)
