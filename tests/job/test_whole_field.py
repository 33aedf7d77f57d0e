"""The plan of a field driven by kinematic machines that know the edge, until it is empty."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swath.control.job import harvest
from swath.control.job.calls import Calls
from swath.control.job.ground import Ground
from swath.control.job.passes import Pass, axle_line
from swath.control.job.ways import Search
from swath.control.steer.guidance_line import along_bends
from swath.control.steer.path import Segment
from swath.control.turns.clothoid import bends_of
from swath.control.turns.dubins import Place
from swath.core.errors import InputError
from swath.job.machines import fleet_of
from swath.job.path import Pose, path_of
from swath.job.turns import TurnLimits
from swath.job.work import plan_of, work_off
from swath.machine.machine_sheet import load_machine
from swath.record.digest import Digest
from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from swath.signals import (
    HeapState,
    JobState,
    MachineLoad,
    MachineState,
    Odometry,
    PeerState,
    Phase,
    PoseEstimate,
    TrailerState,
    UnloadState,
)
from swath.signals.setup import ControlSetup
from swath.tools.fleet.combine_turns import STRAIGHT, loop
from swath.tools.fleet.whole import scenario_text, share_uncut
from swath.tools.fleet.work_plan import work_plan
from tests.job.jobs import job_file

FIELD = [(0.0, 0.0), (42.0, 0.0), (42.0, 14.5), (0.0, 14.5)]
JOB = job_file(
    boundary_m=FIELD,
    plan={"headland_rounds": 0},
    combine={"machine": "combine-5m", "call_percent": 5.0, "tank_start_percent": 8.0},
    truck={"x_m": -25.0, "y_m": 20.0, "dock_s": 4.0},
)
CHEAP = (
    "combine_0.lidar=off", "combine_0.scan_filter=off", "combine_0.edge={level: truth, wires: {}}",
    "combine_0.motion=kinematic", "combine_0.imu=off",
    "cart_0.motion=kinematic",
    *(f"{m}.{s}.rate_hz=50" for m in ("combine_0", "cart_0") for s in ("motion", "steering")),
    *(f"{m}.{s}.rate_hz=20" for m in ("combine_0", "cart_0") for s in ("pose", "odometry", "steer")),
    "combine_0.edge.rate_hz=10", "combine_0.header.rate_hz=20", "combine_0.process.rate_hz=5",
)  # fmt: skip
SAVED_AT, AGAIN_TO = 140.0, 190.0  # s, grain flows; the cart drives to the truck
COLUMNS = "t", "phase", "task", "cart", "flow", "angle", "bend", "ahead", "left"


class Harvest:
    """The job, run until it ends. rows: at every step of the combine's job"""

    def __init__(self, state=None, until_s=None, sets=()):
        fleet = fleet_of(JOB)
        self.plan = plan_of(JOB, fleet, None)
        text = scenario_text(JOB, work_plan(JOB, self.plan, fleet), fleet, None)
        self.world = assemble(parse_scenario(text, base=Path.cwd(), sets=[*CHEAP, *sets]))
        self.digest, self.evaluation = Digest(), make_evaluation(self.world)
        self.latest, self.rows = {}, []
        observers = [self.digest, self.evaluation, self._see]
        if state is not None:
            self.world.load(state["world"])
            self.digest.load(state["digest"])
        drive(self.world, observers, until_s=until_s, resume=state is not None)

    def saved(self):
        return pickle.loads(pickle.dumps({"world": self.world.save(), "digest": self.digest.save()}))

    def go_on(self, until_s=None):
        drive(self.world, [self.digest, self.evaluation, self._see], until_s=until_s, resume=True)
        return self

    def of(self, machine, kind):
        return self.latest[machine, kind]

    def _see(self, slot, t, outputs):
        machine = slot.partition(".")[0]
        for signal in outputs.values():
            self.latest[machine, type(signal)] = signal
        if slot == "combine_0.job" and ("cart_0", HeapState) in self.latest:
            combine, cart = self.of("combine_0", JobState), self.of("cart_0", JobState)
            states = self.of("combine_0", MachineState), self.of("cart_0", MachineState)
            pipe = self.of("combine_0", UnloadState)
            trailer = self.of("cart_0", TrailerState)
            bend = np.angle(np.exp(1j * (trailer.yaw - states[1].pose.euler()[2])))
            ahead, left, _ = states[0].pose.inverse().apply(states[1].pose.position)
            self.rows.append(
                (t * 1e-9, combine.phase, combine.task, cart.phase, pipe.flow, pipe.angle, bend, ahead, left)
            )


@pytest.fixture(scope="module")
def run():
    first = Harvest(until_s=SAVED_AT)
    state = first.saved()
    first.then = first.go_on(AGAIN_TO).digest.hex
    done = first.go_on()
    done.table = np.array(done.rows)
    return done, state


def column(done, name):
    return done.table[:, COLUMNS.index(name)]


def test_it_ends_with_an_empty_field_and_the_grain_at_the_truck(run):
    done, _ = run
    assert "the field is empty" in done.world.graph.ended
    assert share_uncut(done.world.field, done.plan) < 1e-3
    load, heap = done.of("combine_0", MachineLoad), done.of("cart_0", HeapState)
    assert heap.grain == pytest.approx(0.0, abs=1e-6)
    assert heap.emptied == pytest.approx(load.unloaded_grain, rel=1e-9)
    assert heap.emptied > 0.95 * done.plan.area * 0.8
    assert load.tank_level < 0.005


def test_nothing_is_lost_on_the_way(run):
    metrics = run[0].evaluation.metrics("field")
    assert metrics["mass_balance_error"] < 1e-9
    assert metrics["spill_share"] <= 1e-3
    assert metrics["unloaded_kg"] > 500.0


def test_machines_never_touch(run):
    for name in ("combine_0", "cart_0"):
        assert run[0].evaluation.metrics(name)["contact_count"] == 0.0


def test_it_takes_as_long_as_the_cheaper_levels_say(run):
    """Three passes of 42 m, two turns and a start from rest: 6.5 % longer."""
    done, _ = run
    cutting = column(done, "t")[column(done, "phase") == Phase.CUTS].max()
    for level in ("events", "kinematic"):
        assert cutting == pytest.approx(work_off(JOB, None, level).harvest_time, rel=0.08)


def test_the_cart_keeps_out_of_the_headland_turn(run):
    """While the combine turns, the cart is behind it or farther away than it needs."""
    done, _ = run
    turns = (column(done, "phase") == Phase.TURNS) & (column(done, "task") < len(done.plan.passes) - 1)
    ahead, left = column(done, "ahead")[turns], column(done, "left")[turns]
    assert turns.sum() > 100
    assert (np.hypot(ahead, left) > 10.0).all()


def test_behind_the_last_pass_the_combine_drives_on_past_the_cart(run):
    """So that the trailer need not come by the header: the cart stands until the combine is gone by."""
    done, _ = run
    leaves = (column(done, "phase") == Phase.TURNS) & (column(done, "task") == len(done.plan.passes) - 1)
    ahead, left = column(done, "ahead")[leaves], column(done, "left")[leaves]
    assert np.hypot(ahead[-1], left[-1]) > 12.0
    assert ahead[-1] < ahead[0] - 10.0
    assert np.ptp(left) < 0.5
    assert done.evaluation.metrics("combine_0")["least_clearance_m"] > 0.5


def test_grain_flows_only_while_the_cart_keeps_its_station(run):
    """No "in position" too early: nothing is poured on the way to it."""
    done, _ = run
    flows = column(done, "flow") > 0.0
    assert flows.sum() > 100
    assert (column(done, "cart")[flows] == Phase.BESIDE).all()


def test_the_trailer_is_straight_when_the_cart_arrives(run):
    done, _ = run
    beside = column(done, "cart") == Phase.BESIDE
    arrives = beside & ~np.roll(beside, 1)
    assert arrives.any()
    assert np.degrees(np.abs(column(done, "bend")[arrives])).max() < 6.0


def test_the_pipe_stays_folded_where_crop_stands_on_the_left(run):
    done, _ = run
    kept = np.array([not p.cart_beside for p in done.plan.passes])[column(done, "task").astype(int)]
    assert kept.any()
    assert column(done, "angle")[kept].max() < 1e-6
    assert column(done, "angle").max() > 1.0


def test_the_same_digest_for_another_number_of_threads_and_after_save_and_load(run, monkeypatch):
    done, state = run
    monkeypatch.setenv("SWATH_THREADS", "1")
    again = Harvest(state, until_s=AGAIN_TO)
    assert again.of("cart_0", HeapState).grain > 100.0
    assert again.digest.hex == done.then


def silent(from_s, for_s):
    told = f"silent_from_s={from_s}", f"silent_for_s={for_s}"
    return [f"{m}.peer_link.{key}" for m in ("combine_0", "cart_0") for key in told]


def test_silence_of_some_seconds_breaks_a_load_off_and_no_more(run):
    """The auger stops within 1.2 s of the last message and its run-out; then the load goes on."""
    done = Harvest(run[1], sets=silent(142.0, 5.0)).go_on()
    done.table = np.array(done.rows)
    t, flow = column(done, "t"), column(done, "flow")
    assert flow[t < 142.0].min() > 0.0
    assert flow[(t > 145.0) & (t < 147.0)].max() == 0.0
    assert flow[t > 147.0].max() > 0.0
    assert "the field is empty" in done.world.graph.ended
    assert share_uncut(done.world.field, done.plan) < 1e-3
    assert done.evaluation.metrics("field")["spill_share"] <= 1e-3
    assert done.evaluation.metrics("combine_0")["contact_count"] == 0.0


def test_silence_for_good_leaves_the_cart_aside_and_the_combine_at_the_end_of_its_pass(run):
    done = Harvest(run[1], sets=[*silent(142.0, 1e9), "combine_0.job.give_up_s=15"]).go_on()
    done.table = np.array(done.rows)
    assert "hears nothing of the cart" in done.world.graph.ended
    assert share_uncut(done.world.field, done.plan) < 1e-3
    t, before = column(done, "t"), column(done, "left")[0]
    assert column(done, "flow")[t > 145.0].max() == 0.0
    assert column(done, "left")[-1] > before + 1.0
    assert done.of("cart_0", MachineState).speed < 0.05
    assert done.of("combine_0", JobState).phase == Phase.STANDS
    assert done.evaluation.metrics("combine_0")["contact_count"] == 0.0


def test_a_header_off_the_middle_is_led_along_the_pass():
    """The middle of the header, 0.8 m left of the machine's, goes along the line."""
    line = axle_line(Pass(((0.0, 0.0), (0.0, 50.0))), 4.0, 0.8)
    assert line == [pytest.approx((0.8, -4.0)), pytest.approx((0.8, 46.0))]


def test_a_corner_of_an_opening_round_is_a_loop_to_the_outside():
    limits = TurnLimits(6.4, 0.1)
    here, there = Pose(0.0, 0.0, 0.0), Pose(3.0, -2.0, -0.5 * np.pi)
    pieces = loop(here, there, -0.5 * np.pi, limits)
    path = path_of(pieces, here)
    assert path.end[:2] == pytest.approx((3.0, -2.0 - STRAIGHT), abs=1e-6)
    assert path.heading[-1] == pytest.approx(1.5 * np.pi)
    assert (path.points[path.points[:, 1] < -1e-6, 0] > 3.0 - 1e-6).all()  # never over the crop on the right


class Bench:
    """The level alone, along one pass north: tank and pipe as told."""

    def __init__(self, passes, **params):
        setup = ControlSetup(load_machine("lexion-700"), {}, "left", 0.1)
        self.part, self.t = harvest.Harvest(harvest.Params(passes, **params), setup), 0
        self.part.reset(None)

    def step(self, north, tank, flow=0.0, peer=(-30.0, 8.0), age=0.1, told=None, others=(), speed=1.5):
        pose = PoseEstimate(self.t, 0.0, north - 4.0, 0.5 * np.pi, 1.5, 0.0, np.eye(4) * 1e-4, 0.0)
        load = MachineLoad(self.t, tank * 9240.0, 0, 0, 0, 0, 0, 0, tank_level=tank)
        unload = UnloadState(self.t, 1.57, flow, 0.0, 0.0, 0.0, 0.0, 0.0, 8.0)
        heard = replace(PeerState(self.t, True, age, *peer, 0.0, 0.0, 0.0), **(told or {}))
        inputs = {
            "pose": pose, "odometry": Odometry(self.t, speed, 0.0, 0.0), "load": load, "unload": unload,
            "peer": heard, **{f"other_{i + 1}": other for i, other in enumerate(others)},
        }  # fmt: skip
        self.t += 100_000_000
        made = self.part.step(self.t, 100_000_000, inputs)
        self.path = made["path"]
        return made["job"]


NORTH = (
    Pass(((0.0, 0.0), (0.0, 100.0)), turn=(Segment(20.0, -np.pi / 20.0),)),
    Pass(((12.7, 100.0), (12.7, 0.0))),
)


def test_unloading_is_not_broken_off_at_the_end_of_a_row():
    """A load that is soon over is finished standing there; a long one is broken off in time."""
    bench = Bench(NORTH)
    for north in np.arange(1.0, 100.2, 0.5):
        job = bench.step(north, 0.15, flow=92.0)
    job = bench.step(100.35, 0.1, flow=92.0)
    assert (job.phase, job.speed, job.may_unload) == (Phase.STANDS, 0.0, True)
    phases = [bench.step(100.35, 0.003).phase for _ in range(20)]
    assert set(phases[:14]) == {Phase.STANDS}
    assert set(phases[16:]) == {Phase.TURNS}  # once the pipe is dry for 1.5 s
    bench = Bench(NORTH)
    may = [bench.step(north, 0.9, flow=92.0).may_unload for north in np.arange(1.0, 100.0, 0.5)]
    assert may[100]
    assert not may[-1]
    assert bench.step(100.35, 0.9).phase == Phase.TURNS


@pytest.mark.parametrize(("flow", "is_straight"), [(92.0, True), (0.0, False)])
def test_it_does_not_steer_into_its_turn_before_it_stands_for_a_cart(flow, is_straight):
    """Its header would come nearer to the cart that is beside it."""
    bench = Bench(NORTH)
    for north in np.arange(1.0, 100.4, 0.5):
        bench.step(north, 0.15, flow=flow)
    assert bool(np.abs(bench.path.x).max() < 0.01) is is_straight
    job = [bench.step(100.35, 0.003) for _ in range(20)][-1]
    assert job.phase == Phase.TURNS
    assert np.abs(bench.path.x).max() > 12.0


BULB = Segment(8.0, np.pi / 16.0), Segment(24.0, -1.5 * np.pi / 24.0)


@pytest.mark.parametrize(("others", "turn", "phase"), [
    (0, NORTH[0].turn, Phase.TURNS), (1, NORTH[0].turn, Phase.STANDS), (1, BULB, Phase.TURNS),
])  # fmt: skip
def test_with_fewer_carts_than_combines_a_tank_is_emptied_at_the_end_of_a_pass(others, turn, phase):
    """Where the next pass would fill it: the cart goes elsewhere then. Not beside a turn that sweeps it."""
    bench = Bench((Pass(NORTH[0].line_m, turn=turn), NORTH[1]))
    told = {"others": [PeerState(0, True, 0.1, 90.0, 90.0, 0.0, 0.0, 0.0, header_width=12.2)] * others}
    for north in range(1, 100):  # half the tank from a pass
        job = bench.step(north, 0.4 + 0.005 * north, flow=92.0 * (north > 85), peer=(3.2, 8.2), **told)
    assert job.may_unload is (phase == Phase.STANDS)
    job = bench.step(100.35, 0.9, flow=92.0, **told)  # the cart has left
    assert job.phase == phase


@pytest.mark.parametrize(("level", "phase"), [(0.55, Phase.STANDS), (0.4, Phase.TURNS)])
def test_with_fewer_carts_than_combines_half_a_tank_is_emptied_though_the_next_pass_does_not_fill_it(
    level, phase
):
    bench = Bench(NORTH)
    told = {"others": [PeerState(0, True, 0.1, 90.0, 90.0, 0.0, 0.0, 0.0, header_width=12.2)]}
    for north in range(1, 100):
        bench.step(north, level + 0.0005 * north, flow=92.0 * (north > 85), peer=(3.2, 8.2), **told)
    assert bench.step(100.35, level, flow=92.0, **told).phase == phase


def test_a_load_is_not_finished_beside_a_turn_that_would_sweep_the_cart():
    """A turn that swings out to the left first: the load is broken off before the end, and goes on later."""
    for turn, stands in ((NORTH[0].turn, True), (BULB, False)):
        bench = Bench((Pass(NORTH[0].line_m, turn=turn), NORTH[1]))
        for north in np.arange(1.0, 100.2, 0.5):
            job = bench.step(north, 0.15, flow=92.0, peer=(3.2, 8.2))
        assert job.may_unload is stands


@pytest.mark.parametrize(("grain", "stands"), [(0.8, True), (0.4, False)])
def test_before_a_pass_without_a_cart_it_tells_that_it_will_stand(grain, stands):
    """A tank that the next pass would fill is emptied at the end of this one; a cart on its way comes on."""
    blind = Pass(NORTH[1].line_m, cart_beside=False)
    bench = Bench((NORTH[0], blind, Pass(((25.4, 0.0), (25.4, 100.0)))))
    for north in range(1, 99):
        job = bench.step(north, grain - 0.3 + 0.003 * north)
        if 5.0 < north < 70.0:
            assert job.may_unload  # driving, on the go
    assert bool(job.may_unload) is stands
    calls = Calls((NORTH[0], blind, NORTH[0]), 25.0)
    said = PeerState(
        0, True, 0.1, 60.0, 0.0, 0.0, 2.0, 0.0, phase=job.phase, task=0, remaining=job.remaining,
        calls=job.calls, may_unload=job.may_unload,
    )  # fmt: skip
    assert calls.will_stand(said) is stands
    assert (calls.next_task(said) == 0) is stands


def test_the_turn_waits_for_a_cart_in_its_way():
    bench = Bench(NORTH)
    for north in np.arange(1.0, 100.2, 0.5):
        bench.step(north, 0.2)
    assert bench.step(100.35, 0.2, peer=(9.0, -3.0)).phase == Phase.STANDS
    assert bench.step(100.35, 0.2, peer=(5.0, 8.5)).phase == Phase.TURNS  # beside it, on the other side


@pytest.mark.parametrize(("ahead", "stops"), [(-2.0, True), (-10.0, False)])
def test_it_comes_to_the_end_of_a_pass_at_rest_where_a_cart_is_in_the_way_of_its_turn(ahead, stops):
    """Else it has begun its turn before it stands, and its header sticks out to a cart beside it."""
    bench = Bench((Pass(NORTH[0].line_m, turn=BULB), NORTH[1]))
    for north in np.arange(1.0, 99.9, 0.25):
        job = bench.step(north, 0.2, peer=(100.35 + ahead - north, 8.3))
    assert job.phase == Phase.CUTS
    assert (job.speed < 1.0) is stops
    assert (bench.step(100.35, 0.2, peer=(ahead, 8.3)).phase == Phase.STANDS) is stops


def test_a_machine_that_follows_late_comes_to_rest_at_the_end_of_a_pass():
    """1.2 s behind the wanted speed; where a cart blocks its turn."""
    bench, north, speed = Bench((Pass(NORTH[0].line_m, turn=BULB), NORTH[1])), 60.0, 1.5
    for _ in range(600):
        job = bench.step(north, 0.2, peer=(100.0 - north, 8.3), speed=speed)
        speed += (job.speed - speed) / 12.0
        north += 0.1 * speed
    assert job.phase == Phase.STANDS
    assert speed < 1e-3
    assert 100.3 <= north < 101.2  # braking as between passes 101.4


def test_a_combine_that_stands_for_an_hour_gives_the_job_up(monkeypatch):
    """By its way: the measured speed of one that stands has noise."""
    monkeypatch.setattr(harvest, "TOO_LONG", 5.0)
    bench, noise = Bench(NORTH), np.random.default_rng(1)

    def stands(north, steps):
        for speed in noise.normal(0.0, 0.05, steps):
            bench.step(north + speed, 0.99, speed=speed)

    stands(50.0, 49)
    assert not bench.part.end_reason(0)
    bench.step(52.0, 0.5, speed=1.0)  # it drives on
    stands(52.0, 49)
    assert not bench.part.end_reason(0)
    stands(52.0, 3)
    assert "for an hour" in bench.part.end_reason(0)


def test_the_turn_waits_for_a_machine_that_is_silent_and_may_be_near():
    """Within 40 m of where it was heard last; it ends the run when that lasts."""
    bench = Bench(NORTH, give_up_s=5.0)
    for north in np.arange(1.0, 100.2, 0.5):
        bench.step(north, 0.2)
    assert bench.step(100.35, 0.2, peer=(-20.0, 8.0), age=4.0).phase == Phase.STANDS
    for _ in range(60):
        bench.step(100.35, 0.2, peer=(-20.0, 8.0), age=4.0)
    assert "hears nothing" in bench.part.end_reason(0)
    assert bench.step(100.35, 0.2, peer=(-60.0, 8.0), age=4.0).phase == Phase.TURNS


@pytest.mark.parametrize(("clear", "phase"), [(0.45, Phase.TURNS), (0.35, Phase.DONE)])
def test_behind_the_last_pass_it_drives_on_past_a_cart_that_it_leaves_room(clear, phase):
    """Nearer than a turn would come to it: else the cart's trailer has to come by the header."""
    bench = Bench(NORTH[:1])
    aside = load_machine("lexion-700").header_width / 2.0 + 1.0 + clear  # a machine 2 m wide
    for north in np.arange(1.0, 100.2, 0.5):
        bench.step(north, 0.0, peer=(9.0, aside))
    assert bench.step(100.5, 0.0, peer=(9.0, aside)).phase == phase


def test_a_full_tank_stands_calls_and_goes_on_once_grain_flows():
    bench = Bench(NORTH)
    assert bench.step(40.0, 0.5).phase == Phase.CUTS
    assert not bench.step(40.0, 0.5).calls
    job = bench.step(41.0, 0.98)
    assert (job.phase, job.calls, job.speed) == (Phase.STANDS, True, 0.0)
    assert bench.step(41.0, 0.97, flow=92.0).phase == Phase.STANDS
    assert bench.step(41.0, 0.94, flow=92.0).phase == Phase.CUTS


def test_in_the_last_pass_a_cart_is_called_at_once():
    assert not Bench(NORTH).step(40.0, 0.3).calls
    assert Bench(NORTH[:1]).step(40.0, 0.3).calls
    assert not Bench(NORTH[:1]).step(40.0, 0.0).calls


def test_a_full_tank_where_no_cart_can_drive_ends_the_run():
    bench = Bench((Pass(((0.0, 0.0), (0.0, 100.0)), cart_beside=False),))
    bench.step(50.0, 0.99)
    assert "beside which no cart can drive" in bench.part.end_reason(0)


def test_a_way_around_standing_crop():
    """From one side of a block to the other: free of crop by half its width, no tighter than the radius."""
    ground = Ground([(0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0)])
    ground.cut([(3.0, 0.0), (3.0, 40.0)], 6.0)
    search = Search(ground, ground.clear_of(2.0), ground.clear_of(1.2), 9.0)
    start, goal = Place(3.0, 5.0, 0.5 * np.pi), Place(70.0, 20.0, -0.5 * np.pi)
    way = search.way(start, [goal])
    points = np.array(along_bends(*start, bends_of(way, 9.0)))
    assert points[-1] == pytest.approx(goal[:2], abs=1e-6)
    inside = (points[:, 0] > 6.0) & (points[:, 0] < 60.0) & (points[:, 1] > 0.0) & (points[:, 1] < 40.0)
    assert not inside.any()
    away = np.maximum(np.maximum(6.0 - points[:, 0], points[:, 0] - 60.0), points[:, 1] - 40.0)
    near = (np.hypot(*(points - start[:2]).T) > 12.0) & (points[:, 0] > 6.0)
    assert away[near].min() > 1.4
    closed = Search(ground, np.ones_like(ground.crop), np.ones_like(ground.crop), 9.0)
    assert closed.way(start, [goal]) is None


@pytest.mark.parametrize(("change", "said"), [
    ({"combines": 4}, "combines"), ({"carts": 4}, "carts"), ({"unload": {"mode": "standing"}}, "mode"),
])  # fmt: skip
def test_what_the_level_cannot_do_is_refused(change, said):
    file = job_file(**change)
    fleet = fleet_of(file)
    with pytest.raises(InputError, match=said):
        scenario_text(file, work_plan(file, plan_of(file, fleet, None), fleet), fleet, None)
