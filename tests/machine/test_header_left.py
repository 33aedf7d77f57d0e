"""Ears that the knife leaves: what stood is taken, shed or left, and a metric says how much is left."""

import pytest

from swath.core.errors import InputError
from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from tests.evaluated import metrics_of

TEXT = """
format: swath scenario 2
name: knife
seed: 4
run: {distance_m: 3, max_duration_s: 20}
field:
  terrain: {level: plane}
  stand: {level: uniform, stems_per_m2: 100}
  edge: {shape: straight}
machines:
  combine:
    motion: {level: kinematic, start_speed_kmh: 7}
    lidar: 'off'
    odometry: ideal
    edge: truth
    speed: {speed_kmh: 7}
"""
HEIGHTS = (0.05, 0.6, 0.85, 1.2)  # of the knife [m], in a crop of 0.85 m: no ear reaches the last one


def cut_at(height, *sets):
    world = assemble(parse_scenario(TEXT, sets=[f"combine.header.cutting_height_m={height}", *sets]))
    evaluation = make_evaluation(world)
    drive(world, [evaluation])
    return {**metrics_of(evaluation), "straw_taken_kg": world.field.recount().straw}


@pytest.mark.parametrize(
    ("header", "stand"),
    [
        ("combine.header=fixed_height", "field.stand.lean_deg=50"),
        ("combine.header=profile", "field.stand.lean_deg=20"),
    ],
)
def test_from_the_ground_to_the_tip_what_is_not_taken_is_left_and_told(header, stand):
    told = [cut_at(height, header, stand) for height in HEIGHTS]
    taken, left = [m["grain_cut_kg"] for m in told], [m["header_left_kg"] for m in told]
    straw = [m["straw_taken_kg"] + m["stubble_straw_kg"] for m in told]
    assert straw == [pytest.approx(straw[0], rel=1e-9)] * len(told)
    stubble = [m["stubble_straw_kg"] for m in told]
    assert stubble == sorted(stubble)
    assert stubble[0] < 0.3 * straw[0]
    assert stubble[-1] == pytest.approx(straw[-1], rel=0.05)
    whole = taken[0]
    assert whole > 5.0
    assert left[0] == 0.0
    assert [a + b for a, b in zip(taken, left, strict=True)] == [pytest.approx(whole, rel=1e-9)] * len(told)
    assert left == sorted(left)
    assert taken[-1] == 0.0
    for m, kept in zip(told, left, strict=True):
        assert m["header_loss_percent"] == pytest.approx(100.0 * kept / whole, abs=1e-9)
        assert m["mass_balance_error"] <= 1e-9


def test_the_level_that_knows_no_lodged_crop_refuses_it():
    with pytest.raises(InputError, match="expected no lodged crop"):
        cut_at(0.5, "combine.header=profile", "field.stand.lean_deg=50")


def test_a_lodged_crop_leaves_more_under_the_same_knife():
    upright, lodged = (cut_at(0.5, f"field.stand.lean_deg={lean}") for lean in (5, 50))
    assert upright["header_loss_percent"] < 2.0 < 25.0 < lodged["header_loss_percent"]
