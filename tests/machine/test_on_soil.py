"""Machines on soil that gives way: drag, ruts and being stuck by their laws, both levels alike."""

from dataclasses import replace
from math import exp

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose, rotation_rows
from swath.field.field_setup import FieldSetup
from swath.field.ground.soil import make_soil
from swath.field.memory_layout import Organ
from swath.judge.evaluator import EvaluatorSetup
from swath.judge.evaluators.stuck import Stuck
from swath.machine.machine_sheet import load_machine
from swath.machine.motion import multibody, single_track
from swath.machine.on_soil import OnSoil
from swath.machine.soil import STUCK, Brixius, Grip
from swath.rays.engine import RayCaster
from swath.record.message_factory import RecordedMachine
from swath.scenario.sections import SoilSection
from swath.signals import MachineState, SpeedCommand, SteerState
from tests.field.made_field import made_field
from tests.machine.machine_fakes import STREAM, Ground, drive, site, slope

SHEET = load_machine("lexion-700")
LOAD = 10_500 * 9.81  # on the tyre 800/65R32 of the checks [N]
TYRE = Brixius(Grip(1.0, 1.0, 1.0, 1.0, 1.0), 0.0, 1.853, 0.8, 0.52, 0.104, LOAD)


def soil(**keys):
    return make_soil(SoilSection(**keys), FieldSetup())


def soft_field(**keys):
    field = made_field()
    field.soil = soil(**keys)
    return field


@pytest.mark.parametrize(
    ("index", "drag", "rut_cm"), [(500, 0.200, 12), (1000, 0.120, 5), (1500, 0.093, 3), (2000, 0.080, 2)]
)
def test_drag_and_rut_of_a_tyre_by_hand(index, drag, rut_cm):
    """800/65R32 under 10.5 t: Brixius, and the rut 0.224 d / N^1.25."""
    tyre = replace(TYRE, cone_index=1e3 * index)
    assert tyre.at(LOAD, 0.0).drag == pytest.approx(drag, abs=0.001)
    assert 100.0 * tyre.rut(LOAD) == pytest.approx(rut_cm, abs=0.5)


def test_the_cone_index_below_which_it_is_stuck():
    assert 344e3 * STUCK / replace(TYRE, cone_index=344e3).number(LOAD) == pytest.approx(344e3, rel=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_soil_of_map_free_places_and_spots(seed):
    """Wherever spots overlap the softest holds, elsewhere the number."""
    draw = np.random.default_rng(seed)
    spots = [
        {"x_m": x, "y_m": y, "radius_m": r, "cone_index_kpa": c}
        for x, y, r, c in zip(
            *draw.uniform(-20, 20, (2, 5)), draw.uniform(2, 15, 5), draw.uniform(200, 900, 5), strict=True
        )
    ]
    found, at = soil(cone_index_kpa=1000, wet_spots=spots), draw.uniform(-30, 30, (2, 200))
    for x, y, index in zip(*at, found.at(*at), strict=True):
        inside = [s["cone_index_kpa"] for s in spots if np.hypot(x - s["x_m"], y - s["y_m"]) <= s["radius_m"]]
        assert index == pytest.approx(1e3 * min(inside, default=1000))


@pytest.mark.parametrize("exponent", [2.0, 4.5])
def test_ruts_deepen_with_the_root_of_the_passes(exponent):
    """The ground under a wheel after n passes is z1 n^(1/a) lower, beside it as it was; a reset heals it."""
    field = soft_field(cone_index_kpa=900, pass_exponent=exponent)
    on = OnSoil(field, SHEET)
    loads, y = on.loads_at_rest(), np.arange(-6.0, 9.0, 0.25)
    wheel, before = 0.5 * SHEET.front_track, field.ground_height(0.0 * y - 0.5 * SHEET.front_track, y)
    beside = field.ground_height(0.0 * y, y)
    for _ in range(2):
        on.load({"last": None})
        for way in np.arange(-12.0, 14.0, 0.1):
            on.roll(0.0, way, 0.5 * np.pi, loads)
    front, rear = (t.rut(0.5 * n) for t, n in zip(on.tyres, loads, strict=True))
    sunk = before - field.ground_height(0.0 * y - wheel, y)
    assert np.median(sunk) == pytest.approx(
        (2 * (front**exponent + rear**exponent)) ** (1 / exponent), rel=0.02
    )
    np.testing.assert_array_equal(field.ground_height(0.0 * y, y), beside)
    kept, ruts = field.save(), field.ground_height(0.0 * y - wheel, y)
    field.reset()
    np.testing.assert_array_equal(field.ground_height(0.0 * y - wheel, y), before)
    field.load(kept)
    np.testing.assert_array_equal(field.ground_height(0.0 * y - wheel, y), ruts)


def run(motion, seconds, *, speed=2.0):
    motion.reset(STREAM)
    inputs = {"steering": SteerState(0, 0.0, 0.0), "speed": SpeedCommand(0, speed)}
    return drive(motion, seconds, dt=0.01, **inputs)


@pytest.mark.parametrize(("index", "rise", "apart"), [(350, 0.0, 0.02), (1800, 0.08, 0.006)])
def test_both_levels_lose_the_same_speed(index, rise, apart):
    pytest.importorskip("mujoco", reason="needs the extra `multibody`")
    given = {"soil": "brixius", "cone_index_kpa": index}
    quick = run(single_track.SingleTrack(single_track.Params(**given), site(slope(rise), SHEET)), 8.0)[
        -1
    ].speed
    dear = multibody.Multibody(multibody.Params(**given), site(slope(rise), SHEET))
    assert quick == pytest.approx(run(dear, 8.0)[-1].speed, rel=apart)
    assert quick < 1.985


def test_the_slip_is_that_of_brixius():
    """Gross traction of the front wheels carries the resistance of all; 3 %: the load that it shifts."""
    motion = single_track.SingleTrack(
        single_track.Params(soil="brixius", cone_index_kpa=900), site(Ground(), SHEET)
    )
    state = run(motion, 10.0)[-1]
    slip, loads = 2.0 / state.speed - 1.0, motion.axle_loads
    front, rear = (t.at(0.5 * n, s) for t, n, s in zip(motion.soil.tyres, loads, (slip, 0.0), strict=True))
    pulled = loads[0] * front.along_top * (1.0 - exp(-7.5 * slip))
    assert pulled == pytest.approx(loads[0] * front.drag + loads[1] * rear.drag, rel=0.03)


def test_it_cannot_start_in_a_bog_and_drives_where_it_is_firm():
    bog = single_track.SingleTrack(
        single_track.Params(soil="brixius", cone_index_kpa=180), site(Ground(), SHEET)
    )
    assert run(bog, 5.0)[-1].distance < 0.5
    told, plain = (
        run(single_track.SingleTrack(single_track.Params(soil=soil), site(field, SHEET)), 5.0)[-1].speed
        for soil, field in (("firm", soft_field(cone_index_kpa=100)), (None, made_field()))
    )
    assert told == plain


def test_a_saved_state_goes_on_byte_for_byte():
    field = soft_field(wet_spots=[{"x_m": 6.0, "y_m": 0.0, "radius_m": 4.0, "cone_index_kpa": 450}])
    motion = single_track.SingleTrack(single_track.Params(), site(field, SHEET))
    run(motion, 2.0)
    kept, ground = motion.save(), field.save()
    inputs = {"steering": SteerState(0, 0.1, 0.0), "speed": SpeedCommand(0, 2.0)}
    once = drive(motion, 3.0, **inputs)[-1]
    marks = field.save()["ruts"]["depth"]
    field.load(ground)
    motion.load(kept)
    again = drive(motion, 3.0, **inputs)[-1]
    assert (once.pose.position == again.pose.position).all()
    assert once.speed == again.speed
    np.testing.assert_array_equal(field.save()["ruts"]["depth"], marks)


def test_a_sheet_without_tyres_is_refused():
    with pytest.raises(InputError, match="bodies"):
        single_track.SingleTrack(single_track.Params(), site(soft_field(), load_machine("combine-walkers")))


@pytest.mark.parametrize("spot", [300, 150])
def test_stuck_is_an_event_that_ends_the_run(spot):
    """In a spot whose mobility number is too low; before it, and standing in it, it is not."""
    field = soft_field(wet_spots=[{"x_m": 10.0, "y_m": 0.0, "radius_m": 3.0, "cone_index_kpa": spot}])
    is_bog = OnSoil(field, SHEET).number(10.0, 0.0, 0.0, 0.0) < STUCK
    judge = Stuck(EvaluatorSetup(field, {"combine": RecordedMachine("combine", SHEET, "left")}, "combine"))

    def look(t, x, speed):
        pose = Pose.of_numbers([x, 0.0, 0.0], rotation_rows(0.0, 0.0, 0.0))
        judge.see("combine.motion", t, {"state": MachineState(t, pose, speed, 0.0, 0.0, 0.0, x)})

    look(0, 0.0, 2.0)
    look(10**9, 10.0, 0.0)
    assert judge.end_reason(0) == ""
    look(2 * 10**9, 10.0, 2.0)
    assert [e.kind for e in judge.events()] == ["stuck"] * is_bog
    assert judge.metrics()["stuck_count"] == float(is_bog)
    assert ("1.85" in judge.end_reason(0)) == is_bog
    firm = Stuck(
        EvaluatorSetup(made_field(), {"combine": RecordedMachine("combine", SHEET, "left")}, "combine")
    )
    assert (firm.SIGNALS, firm.LIMITS, firm.metrics()) == ((), {}, {})


def test_rays_and_pages_that_come_back_meet_the_ruts():
    """A scanner looks at the rut of another machine; a page that was out of memory shows it again."""
    field = soft_field(cone_index_kpa=600)
    on = OnSoil(field, SHEET)
    for way in np.arange(-6.0, 8.0, 0.1):
        on.roll(0.0, way, 0.5 * np.pi, on.loads_at_rest())
    y, wheel = np.linspace(-1.0, 1.0, 9), 0.5 * SHEET.front_track
    eyes = np.column_stack([np.full(9, -wheel), y, np.full(9, 3.0)])
    down = np.broadcast_to([0.0, 0.0, -1.0], (9, 3))

    def grounds():
        field.ensure(0.0, 0.0, 20.0)
        hits = RayCaster(field).cast(eyes, down, range_max=5.0)
        return (3.0 - hits.distance)[hits.organ == Organ.GROUND]

    field.cut([(-6.0, -8.0), (6.0, -8.0), (6.0, 8.0), (-6.0, 8.0)], 0.0)
    seen = grounds()
    assert len(seen) > 4
    np.testing.assert_allclose(seen, field.ground_height(-wheel, 0.0), atol=0.01)
    assert seen.max() < -0.05
    for page in list(field.store.keys):
        field.store._drop(page)
    np.testing.assert_array_equal(grounds(), seen)
