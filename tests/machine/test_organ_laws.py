"""Laws of drum, rotors and shoe: by hand, and the trends that manuals and measurements show."""

from dataclasses import replace

import numpy as np
import pytest

from swath.control.settings.climb import Climb
from swath.control.settings.climb import Params as ClimbParams
from swath.core.schedule import NS
from swath.machine.cleaning import overload
from swath.machine.cleaning.model import Params as ShoeParams
from swath.machine.cleaning.model import shoe_loss
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.threshing.model import Drum, coupled, rate_factors
from swath.machine.threshing.model import Params as DrumParams
from swath.signals import CropStream, FeedReading, GrainImage, LossReading, OrganSettings
from swath.signals.settings import CROPS, own_settings
from tests.machine.machine_fakes import STREAM, site
from tests.machine.organ_trends import FLOW, STEP, judged, steady
from tests.machine.process_rig import Row, flow, state

DRY = 0.12


def test_settings_change_what_manuals_say():
    """What the shoe loses over other things than its air, and returns, at most points only: with little on it
    and much air it blows out, and more keeps it in (shares: benchmarks/organ_trends.py).
    """
    shoe = {(name, "shoe loss") for name in ("drum", "concave", "vane", "feed")}
    most = shoe | {("concave", "returns"), ("upper", "returns")}
    found = judged(np.random.default_rng(1))
    assert [key for key, follows in found.items() if not follows and key not in most] == []
    assert len(found) >= 42


def test_drum_and_rotors_by_hand():
    ear, free = coupled(1.0, 0.0, 4.0, 1.72)
    assert (ear, free, 1.0 - ear - free) == pytest.approx((0.0183, 0.2820, 0.6997), abs=5e-5)
    assert coupled(ear, free, 4.5, 4.3) == pytest.approx((2.03e-4, 4.84e-3), rel=3e-3)
    ear, free = coupled(1.0, 0.0, 3.0, 3.0)
    assert (ear, free, 1.0 - ear - free) == pytest.approx((0.0498, 0.1494, 0.8009), abs=1e-4)


def test_the_shoe_by_hand():
    """A width of 0.6 m/s around the best air of 6 m/s: the least there, 1.37 times it 0.5 m/s away."""
    p = ShoeParams()
    for air, lost in ((6.0, 0.200), (5.5, 0.274), (6.5, 0.274)):
        assert 100.0 * shoe_loss(p, 0.002, 1.0, (air - 6.0) / 0.6) == pytest.approx(lost, abs=5e-4)
    assert 100.0 * shoe_loss(p, 0.002, 1.0, 0.416 / 0.6, upper=0.5) == pytest.approx(0.400, abs=5e-4)
    loads = np.linspace(0.7, 1.2, 501)
    losses = [100.0 * shoe_loss(p, 0.002, load, 0.0) for load in loads]
    assert loads[int(np.argmin(losses))] == pytest.approx(0.874, abs=2e-3)
    assert min(losses) == pytest.approx(0.185, abs=5e-4)


def test_loss_over_load_by_hand():
    """0.5 % at the knee, doubling every 15 %: 1 % at 1.15, 3 % at 1.388 of it."""
    shoe = replace(drivetrain_of(site().machine).cleaning, loss=0.005, knee=1.0, doubling=0.15)
    lost = [100.0 * overload.shoe_loss(load, shoe) for load in (0.8, 1.0, 1.15, 1.388)]
    assert lost == pytest.approx([0.5, 0.5, 1.0, 3.0], rel=2e-3)


def test_the_fan_by_hand():
    """A tenth faster takes a third more power, where all of it is the fan's."""
    power = [steady(keys={"cleaning": {"fan_share_percent": s}}, fan=1.1)[6] for s in (0.0, 100.0)]
    shoe = drivetrain_of(site().machine).consumers.cleaning
    assert (power[1] - power[0]) / shoe == pytest.approx(0.331, rel=1e-6)


class Twentieth(overload.Shoe):
    """Sends 5 % of all back."""

    def _shares(self, flow, mog, h, inputs):
        return overload.Shares(0.0, 0.05)


def driven(row, seconds, h):
    """What a row of organs gave in each step of an even flow."""
    row.reset(STREAM)
    grain, straw = (m * h for m in FLOW)
    for k in range(round(seconds / h)):
        fed = {"flow": (flow(k, grain, straw, h),), "state": state(k, 2.0 * k * h, 2.0)}
        yield row.step(round(k * h * NS), round(h * NS), fed)["load"]


def test_returns_by_hand():
    """What comes back loads the shoe once more: 1 / (1 - 0.05) = 1.0526 of its grain."""
    carried = []
    for shoe in (overload.IdealShoe, Twentieth):
        ideal = dict.fromkeys(("threshing", "separation"), "ideal")
        row = Row(site(period=0.5), {**ideal, "cleaning": shoe(None, site(period=0.5))})
        list(driven(row, 60.0, 0.5))
        carried.append(row._given["process"]["cleaning"][0].grain)
    assert carried[1] / carried[0] == pytest.approx(1.0526, abs=1e-4)


def test_delays_by_hand():
    """Knife to the rotors' loss 5.75 s, to the shoe 2.75 s and 1.5 s on it, to the tank 8.25 s and a lag of
    2 s; a header's ends come 0.45 s later.
    """
    loads = list(driven(Row(site(period=0.05)), 30.0, 0.05))

    def half(name):
        flows = np.array([getattr(load, name) for load in loads])
        return 0.05 * float(np.argmax(flows > 0.5 * flows[-1]))

    spread, lag = (seconds * np.log(2.0) for seconds in (0.45, 2.0))
    assert half("straw_flow") == pytest.approx(5.75 + spread, abs=0.2)
    assert half("cleaning_loss") == pytest.approx(4.25 + spread, abs=0.5)
    assert half("grain_flow") == pytest.approx(8.25 + spread + lag, abs=0.7)


def test_rates_of_another_setting():
    p = DrumParams()
    assert rate_factors(p, 1.0, 1.0, DRY) == (1.0, 1.0)
    moist = rate_factors(p, 1.0, 1.0, 0.20)
    assert moist == pytest.approx((np.exp(-0.2), np.exp(-0.2)))
    assert 2.0 < steady(keys={"feeder": {"straw_moisture_percent": 20.0}})[1] / steady()[1] < 4.0


def test_breakage_over_speed_feed_and_moisture():
    drum = Drum(DrumParams(), site())
    assert drum.breakage(1.0, 1.0, 1.0, 0.14) == pytest.approx(CROPS["wheat"].broken)
    doubled = drum.breakage(1.0, 1.0, 2.0, 0.14) / drum.breakage(1.0, 1.0, 1.0, 0.14)
    assert doubled == pytest.approx(0.84, abs=0.005)
    wet = [drum.breakage(1.0, 1.0, 1.0, m) for m in (0.13, 0.19, 0.24, 0.30)]
    assert int(np.argmin(wet)) == 2
    own = own_settings(site().machine.works, "wheat")
    slower = 1.0 - 5.0 / (own["drum"] * site().machine.works.radius)
    assert drum.breakage(slower, 1.0, 1.0, 0.14) == pytest.approx(0.01 / np.e)


def test_crops_have_settings_of_their_own():
    works = site().machine.works
    maize, wheat = own_settings(works, "maize"), own_settings(works, "wheat")
    assert maize["drum"] / wheat["drum"] == pytest.approx(500 / 1150)
    assert maize["lower"] / wheat["lower"] == pytest.approx(3.0)
    assert own_settings(works, "buckwheat") == wheat
    given = own_settings(works, "maize", OrganSettings(0, fan=100.0))
    assert (given["fan"], given["drum"]) == (100.0, maize["drum"])
    assert 10.0 < maize["drum"] * works.radius < 16.0
    assert steady("maize")[3] > 3.0 * steady()[3]


def test_settings_take_their_time():
    """50 rpm at 20 rpm/s; the first that comes counts at once."""
    drum = Drum(DrumParams(), site())
    own = own_settings(site().machine.works, "wheat")["drum"]
    drum.start()
    at = [drum._set.over_own({"settings": None}, 0.5)["drum"]]
    faster = OrganSettings(0, drum=own + 50.0 * np.pi / 30.0)
    at += [drum._set.over_own({"settings": faster}, 0.5)["drum"] for _ in range(8)]
    rpm = (np.array(at) - 1.0) * own / (np.pi / 30.0)
    np.testing.assert_allclose(rpm, [0, 10, 20, 30, 40, 50, 50, 50, 50], atol=1e-9)


def test_a_slow_drum_blocks_and_says_that_no_law_holds():
    own = own_settings(site().machine.works, "wheat")["drum"]
    fed = CropStream(0, 0.05, 0.0, 0.0, 0.05, 0.0, 0.0)
    at = {}
    for share in (1.0, 0.5, 0.1):
        drum = Drum(DrumParams(), site())
        drum.start()
        asked = {"fed": (fed,), "back": (), "settings": OrganSettings(0, drum=share * own)}
        at[share] = drum.step(0, STEP, asked)["work"].blockage, drum.notes
    assert at[0.5][0] == pytest.approx(2.0 * at[1.0][0])
    assert at[0.1][0] == pytest.approx(10.0 * at[1.0][0])
    assert [len(notes) for _, notes in at.values()] == [0, 0, 1]


def climbed(seconds, feed=1.1, **start):
    """Losses in a row of organs at the start and at the end of a climb, and where it came to."""
    setup, h = site(period=0.5), 0.5
    climb = Climb(ClimbParams(**start), setup)
    row = Row(setup)
    row.reset(STREAM)
    row.settings = climb.reset(STREAM)["settings"]
    grain, straw = (m * feed * h for m in FLOW)
    losses = []
    for k in range(int(seconds / h)):
        fed = {"flow": (flow(k, grain, straw, h),), "state": state(k, 1.0 * k, 2.0)}
        load = row.step(k * STEP, STEP, fed)["load"]
        rotors = load.threshing_loss + load.separation_loss
        seen = {"loss": LossReading(0, rotors, load.cleaning_loss), "feed": FeedReading(0, load.feeder_flow)}
        row.settings = climb.step(k * STEP, STEP, seen)["settings"]
        losses.append((rotors + load.cleaning_loss) * h / grain)
    return np.mean(losses[60:80]), np.mean(losses[-200:]), row.settings


def test_the_climber_leaves_a_wrong_setting():
    """Concave too wide and too little air: half of the loss goes."""
    before, after, found = climbed(2000.0, concave_mm=20.0, fan_rpm=760.0, drum_step_rpm=0.0)
    assert before > 0.02
    assert after < 0.6 * before
    assert found.concave < 0.016
    assert 80.0 < found.fan < 100.0
    assert found.drum == own_settings(site().machine.works, "wheat")["drum"]


def test_the_climber_goes_by_what_it_reads():
    """Much lost: a faster drum and a closer concave. Nearly nothing lost, much broken: a slower drum."""
    own = own_settings(site().machine.works, "wheat")

    def found(rotors, broken):
        climb = Climb(ClimbParams(), site(period=1.0))
        climb.reset(STREAM)
        seen = {"loss": LossReading(0, rotors, 0.05), "feed": FeedReading(0, 35.0)}
        seen |= {"quality": GrainImage(0, broken, 0.005)}
        return [climb.step(k * NS, NS, seen)["settings"] for k in range(1200)][-1]

    careful, keen = found(0.002, 0.03), found(1.0, 0.005)
    assert careful.drum < own["drum"] < keen.drum
    assert keen.concave < own["concave"] <= careful.concave


def test_the_climber_goes_on_exactly_from_what_it_saved():
    one, two = (Climb(ClimbParams(), site(period=1.0)) for _ in range(2))
    rng = np.random.default_rng(3)
    seen = [{"loss": LossReading(0, *rng.uniform(0.05, 0.5, 2)), "feed": FeedReading(0, rng.uniform(25, 40))}
            for _ in range(300)]  # fmt: skip
    one.reset(STREAM), two.reset(STREAM)
    for k in range(150):
        one.step(k * NS, NS, seen[k])
    two.load(one.save())
    rest = [[each.step(k * NS, NS, seen[k])["settings"] for k in range(150, 300)] for each in (one, two)]
    assert rest[0] == rest[1]
    assert rest[0][0] != rest[0][-1]
