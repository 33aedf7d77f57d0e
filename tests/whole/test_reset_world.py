"""A world that was driven and is driven again gives the same samples, bit for bit."""

import pickle

from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from tests.whole.small import TEXT

SETS = ["run.distance_m=1.5", "combine.process.level=threshing", "combine.process.tank_start_percent=50"]


def test_driving_again_gives_the_same_samples_and_the_same_field():
    world = assemble(parse_scenario(TEXT, sets=[*SETS, "combine.process.unload_at_percent=20"]))
    runs = []
    for _ in range(2):
        samples = []
        drive(world, [lambda slot, t, outputs, kept=samples: kept.append((slot, t, pickle.dumps(outputs)))])
        field = world.field
        runs.append((samples, field.recount(), field.straw_kg, field.ground_grain_kg, field.save()["codes"]))
    assert runs[0][1:] == runs[1][1:]
    assert runs[0][0] == runs[1][0]
    assert runs[0][1].stem_count > 0
    assert runs[0][3] > 1.0
