"""Combines that stand full: who serves them first, who waits for them, and where their carts stand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from swath.job import pouring
from swath.job.engine import Job
from swath.job.footprint import clearance
from swath.job.give_way import GiveWay, room_for, stays
from swath.job.grain import leaves
from swath.job.hand_over import hand_over
from swath.job.kinematic import Kinematic
from swath.job.machines import fleet_of
from swath.job.path import Pose, ahead_of, polyline
from swath.job.plan import PlannedPass
from swath.job.settle import LONGEST
from swath.job.standoff import PATIENCE
from swath.job.states import CartState, CombineState
from swath.job.traffic import LOOKS, look, steer_aside
from swath.job.work import plan_of
from tests.job.jobs import finished, job_file, with_beside
from tests.job.test_give_way import CART, COMBINE, STEP, drive, driving
from tests.job.test_settle import drive as settled

EAST, NORTH = 0.0, 0.5 * math.pi
HERE = Pose(0.0, 0.0, EAST)


def job_of(combines, carts, motion=None, **keys):
    file = job_file(combines, carts, **keys)
    fleet = fleet_of(file)
    return Job(file, plan_of(file, fleet, None), fleet, motion or Kinematic())


def begun(combines, carts, time=40.0):
    """A job of driven machines after a while: all combines cut, all carts wait at the truck."""
    job = job_of(combines, carts)
    job.run(time)
    assert {c.phase for c in job.combines} == {"cut"}
    return job


def test_the_cart_of_one_that_is_stopped_goes_to_the_full_one_that_stops_it_first():
    job = begun(2, 1)
    first, full = job.combines
    cart, drivers, give_way = job.carts[0], job.motion._drivers, GiveWay()
    job.hand_over(cart, first)
    full.phase, full.tank = "stand", full.spec.tank
    drivers[first.spec.name].blocked = full.spec.name
    give_way._since[first.spec.name] = job.time - PATIENCE + 0.1
    hand_over(job, drivers, give_way)
    assert cart.combine is first  # not yet
    give_way._since[first.spec.name] = job.time - PATIENCE
    hand_over(job, drivers, give_way)
    assert (cart.combine, full.cart, first.cart, first.called) == (full, cart, None, False)
    hand_over(job, drivers, give_way)
    assert cart.combine is full


def test_a_cart_that_is_called_from_where_it_is_in_the_way_gets_onto_its_line_without_contact():
    """It stands right ahead of the header, as beside another combine before: in place only on its line."""
    job = begun(1, 1)
    combine, cart = job.combines[0], job.carts[0]
    drivers = job.motion._drivers
    axle = drivers[combine.spec.name].machine.pose
    ahead = ahead_of(axle, 22.0)
    drivers[cart.spec.name].put(Pose(ahead.x, ahead.y + 2.0, axle.heading))
    cart.place = drivers[cart.spec.name].machine.pose
    job.hand_over(cart, combine)
    job.run(job.time + 60.0)
    assert [p for p in job.motion.watch.pairs if p.touched > 0.0] == []
    assert cart.phase == "beside"
    assert combine.left < combine.task.length - 80.0


def test_while_a_cart_gets_in_line_it_makes_no_room():
    full = CombineState(None, 0, HERE, 900.0, phase="stand")
    assert stays(CartState(None, HERE, "beside", combine=full))
    full.tank = 0.0
    assert not stays(CartState(None, HERE, "beside", combine=full))


@pytest.mark.parametrize(
    ("wanted", "told"), [(2.0, 0), (0.0, 1)], ids=["a cart drives", "the cart is stopped"]
)
def test_behind_a_full_one_nobody_is_held_up_while_a_cart_is_on_its_way(wanted, told):
    full = driving(COMBINE, Pose(30.0, 0.0, EAST), 0.0, "full")
    behind = driving(COMBINE, HERE, 2.0, "behind")
    cart = driving(CART, Pose(0.0, 200.0, EAST), wanted, "cart", way=5000.0)
    stands, cuts = (CombineState(None, i, HERE, 9.0, phase=p) for i, p in enumerate(("stand", "cut")))
    states = [stands, cuts, CartState(None, HERE, "to_truck")]
    machines = [full, behind, cart]
    if not told:
        assert settled(machines, states, 1.5 * LONGEST)[0] == []
        return
    wall = driving(COMBINE, Pose(20.0, 200.0, EAST), 0.0, "wall")
    cart.wanted = 2.0
    found, *_ = settled(
        [*machines, wall], [*states, CombineState(None, 2, HERE, 9.0, phase="stand")], 1.5 * LONGEST
    )
    assert found


def test_a_cart_that_has_room_for_all_that_is_left_does_not_leave():
    job = job_of(2, 1)
    cart, (one, other) = job.carts[0], job.combines
    cart.grain = cart.spec.leave
    assert leaves(job, cart)
    job.passes._headland.clear()
    for queue in job.passes._lands.values():
        queue.clear()
    one.task, one.tank, other.task, other.tank = None, 0.0, None, 0.0
    other.task, other.phase = PlannedPass(np.array([[0.0, 0.0], [100.0, 0.0]]), area=1000.0), "cut"
    other.left = 100.0 * (cart.spec.load - cart.grain - 0.5) / (1000.0 * job.grain_per_m2)
    assert not leaves(job, cart)
    other.tank = 1.0
    assert leaves(job, cart)
    cart.grain = 0.0
    assert not leaves(job, cart)


@pytest.mark.parametrize(
    ("needs", "tank", "spare"), [(1, 100.0, True), (1, 11000.0, False), (2, 100.0, False)]
)
def test_behind_the_last_pass_a_cart_that_nobody_needs_leaves(needs, tank, spare):
    job = job_of(2, 2)
    job.passes._headland.clear()
    for queue in job.passes._lands.values():
        queue.clear()
    fuller, emptier = job.carts
    emptier.grain = emptier.spec.leave - 500.0  # room for 10.2 t
    fuller.grain = emptier.grain + 10.0
    for i, c in enumerate(job.combines):
        c.task, c.tank = None, tank if i < needs else 0.0
    assert (leaves(job, fuller), leaves(job, emptier)) == (spare, False)


@pytest.mark.parametrize(("room", "leaves_it"), [(0.6, False), (0.4, True)])
def test_a_cart_serves_one_that_stands_full_before_it_leaves(room, leaves_it):
    """It takes what it can: half a tank at least."""
    job = begun(2, 1)
    full, cart = job.combines[0], job.carts[0]
    cart.grain = cart.spec.load - room * full.spec.tank
    assert leaves(job, cart)
    full.phase, full.tank = "stand", full.spec.tank
    assert leaves(job, cart) is leaves_it
    full.cart = cart
    assert leaves(job, cart)


@pytest.mark.parametrize(("carts", "share", "waits"), [(1, 0.6, True), (1, 0.4, False), (2, 0.6, False)])
def test_where_carts_are_few_one_that_came_late_is_poured_into_at_the_end_of_the_pass(
    monkeypatch, carts, share, waits
):
    """Else it would wait beside the next pass, where no cart may drive, until the combine is full."""
    job = begun(2, carts)
    c, cart = job.combines[0], job.carts[0]
    monkeypatch.setattr(job, "goes_on_pouring", lambda _: False)
    c.task, c.left, c.tank = replace(c.task, cart_beside=True), 0.0, share * c.spec.tank
    job.hand_over(cart, c)
    cart.phase = "beside"
    job._ends_pass(c)
    assert (c.phase == "stand") is waits


def test_a_load_is_finished_standing_where_no_cart_may_drive_beside_the_next_pass(monkeypatch):
    """Else it would wait beside the combine until that is full."""
    file = job_file(plan={"headland_rounds": 0, "order": "adjacent"}, unload={"finish_s": 0.0})
    plan = with_beside(plan_of(file, fleet_of(file), None), True)
    passes = [p if i % 2 == 0 else replace(p, cart_beside=False) for i, p in enumerate(plan.passes)]
    left = cut_short(monkeypatch, file, plan, passes)
    assert left == []
    assert cut_short(monkeypatch, file, plan, plan.passes) != []


def cut_short(monkeypatch, file, plan, passes):
    """Grain left in the tank by loads that the end of a pass ended [kg]."""
    left, note = [], pouring.note_load

    def noted(c):
        if c.tank > 1.0 and c.cart is not None and c.cart.grain < c.cart.spec.load - 1.0:
            left.append(c.tank)
        note(c)

    with monkeypatch.context() as patch:
        patch.setattr(pouring, "note_load", noted)
        finished(file, plan=replace(plan, passes=tuple(passes)))
    return left


@pytest.mark.parametrize(
    ("other", "clear"),
    [(Pose(70.0, 0.0, math.pi), False), (Pose(70.0, 60.0, -NORTH), True), (Pose(70.0, 40.0, math.pi), True)],
    ids=["head-on", "across", "beside"],
)
def test_behind_a_manoeuvre_a_machine_waits_longer_for_one_that_comes_head_on(other, clear):
    cart = driving(CART, HERE, 0.0)
    comes = driving(COMBINE, other, 2.0)
    way = polyline(np.array([[0.0, 0.0], [200.0, 0.0]]), 0.5)
    assert room_for(cart.driver, way, comes.driver) is clear


@pytest.mark.parametrize(("speed", "goes"), [(4.0, True), (1.0, False)])
def test_who_has_nothing_to_do_makes_room_in_time(speed, goes):
    comes = driving(COMBINE, HERE, speed, "comes")
    idle = driving(CART, Pose(50.0, 0.0, EAST), 0.0, "idle")
    idle.wanted = 0.0
    for m in (comes, idle):
        m.now = m.driver.footprint.sweep([m.driver.place])
        m.driver.held = m.now
    states = {
        "comes": CombineState(None, 0, HERE, 0.0, phase="way", left=200.0),
        "idle": CartState(None, HERE),
    }
    GiveWay().look(0.0, [comes, idle], states, {}, lambda name, pose: None)
    assert (idle.driver.manoeuvre is not None) is goes


@pytest.mark.parametrize(("after", "goes"), [("comes", True), ("", False)])
def test_a_cart_beside_a_combine_makes_room_for_one_that_this_lets_go_first(after, goes):
    comes, stands = driving(COMBINE, HERE, 2.0, "comes"), driving(CART, Pose(35.0, 0.0, EAST), 0.0, "stands")
    stands.wanted, stands.after = 0.0, after
    for m in (comes, stands):
        m.now = m.driver.footprint.sweep([m.driver.place])
        m.driver.held = m.now
    waits = CombineState(None, 1, Pose(35.0, 40.0, EAST), 0.0, phase="way")
    states = {
        "comes": CombineState(None, 0, HERE, 0.0, phase="cut", left=200.0),
        "stands": CartState(None, HERE, phase="beside", combine=waits),
    }
    give_way = GiveWay()
    for time in (0.0, PATIENCE):
        give_way.look(time, [comes, stands], states, {}, lambda name, pose: None)
    assert (stands.driver.manoeuvre is not None) is goes


def test_a_combine_on_its_way_drives_around_one_that_stands():
    full = driving(COMBINE, Pose(150.0, 3.0, EAST), 0.0, "full")
    passes = driving(COMBINE, HERE, 3.0, "passes", way=400.0)
    passes.turns = True
    least = math.inf
    for _ in range(200):
        passes.turns = True
        least = min(least, drive([passes, full], LOOKS * 0.2))
    assert least > 0.1
    assert passes.driver.machine.x > 300.0
    assert passes.driver.machine.y == pytest.approx(0.0, abs=0.05)  # on its way again


def test_of_two_combines_on_their_ways_that_meet_the_second_drives_around():
    first = driving(COMBINE, HERE, 3.0, "first", way=500.0)
    second = driving(COMBINE, Pose(240.0, 3.0, math.pi), 3.0, "second", way=500.0)
    first.turns = second.turns = True
    assert drive([first, second], 130.0) > 0.1
    assert first.driver.machine.x > 300.0
    assert abs(first.driver.machine.y) < 0.05
    assert second.driver.machine.x < -60.0
    assert second.driver.machine.y == pytest.approx(3.0, abs=0.05)  # on its way again


def test_near_what_is_fixed_nobody_leaves_its_way():
    cart = driving(CART, Pose(130.0, -7.0, math.pi), 4.0, way=300.0)
    combine = driving(COMBINE, HERE, 2.0)
    fixed = {"truck": driving(COMBINE, Pose(100.0, -22.0, EAST), 0.0).driver.held}
    farthest = 0.0
    for _ in range(30):
        drive([combine, cart], LOOKS * 0.2, fixed)
        if cart.driver.machine.x > 65.0:
            farthest = max(farthest, abs(cart.driver.machine.y + 7.0))
    assert farthest < 0.05


@pytest.mark.parametrize("aside", np.linspace(0.5, 8.0, 6).tolist())
def test_a_trailer_comes_by_a_header_too(aside):
    """The tractor is aside in time, and back on its line only when the trailer is past."""
    full = driving(COMBINE, Pose(200.0, 0.0, EAST), 0.0, "full")
    cart = driving(CART, Pose(0.0, -aside, EAST), 4.0, way=500.0)
    least = math.inf
    for _ in range(170):
        cart.to = "another"
        least = min(least, drive([full, cart], LOOKS * 0.2))
    assert least > 0.1
    assert cart.driver.machine.x > 300.0


def test_of_two_combines_the_one_on_its_way_makes_room_for_the_one_that_cuts():
    way = driving(COMBINE, HERE, 2.0, "way")
    cuts = driving(COMBINE, Pose(160.0, 0.0, math.pi), 2.0, "cuts")
    drive([way, cuts], 60.0)
    states = {"way": CombineState(None, 0, HERE, 0.0, phase="way", left=200.0),
              "cuts": CombineState(None, 1, HERE, 0.0, phase="cut", left=200.0)}  # fmt: skip
    for name, state in states.items():
        state.spec = type("Spec", (), {"name": name, "limits": type("Limits", (), {"radius": 6.4})})
    give_way = GiveWay()
    for time in (0.0, PATIENCE):
        for m in (way, cuts):
            m.blocked, m.claim = "", None
        look([way, cuts], {})
        assert (way.blocked, cuts.blocked) == ("cuts", "way")
        give_way.look(time, [way, cuts], states, {}, lambda name, pose: None)
    assert way.driver.manoeuvre is not None
    assert cuts.driver.manoeuvre is None


def test_close_behind_a_full_one_on_the_next_pass_a_combine_backs_off_and_comes_past_it():
    """Headers overlap by 0.3 m: 3 m behind the other one it cannot get aside any more."""
    cuts = driving(COMBINE, HERE, 2.0, "cuts")
    for _ in range(200):
        cuts.driver.step(2.0)
    cuts.driver.machine.speed = 0.0
    full = driving(COMBINE, Pose(cuts.driver.machine.x + 3.0, 11.7, EAST), 0.0, "full")
    states = {"cuts": CombineState(None, 0, HERE, 0.0, phase="cut", left=200.0),
              "full": CombineState(None, 1, HERE, 100.0, phase="stand", left=200.0)}  # fmt: skip
    for name, state in states.items():
        state.spec = type("Spec", (), {"name": name, "limits": type("Limits", (), {"radius": 6.4})})
    give_way, movers, least = GiveWay(), [cuts, full], math.inf
    for i in range(300):
        if i % LOOKS == 0:
            for m in movers:
                m.blocked, m.claim, m.reserved = "", None, m.driver.room_ground
            steer_aside(movers, {})
            look(movers, {})
            give_way.look(i * STEP, movers, states, {}, lambda name, pose: None)
        if cuts.driver.manoeuvre is None:
            cuts.driver.step(cuts.wanted)
        else:
            cuts.driver.make_room(1.0 * STEP)
            if cuts.driver.manoeuvre.is_there:
                cuts.driver.manoeuvre = None
        least = min(least, clearance(*(m.driver.footprint.at(*m.driver.place) for m in movers)))
    assert least > 0.0
    assert [(s.first, s.solved_by) for s in give_way.standoffs] == [("cuts", "cuts")]
    assert cuts.driver.machine.x > full.driver.machine.x + 40.0


@pytest.mark.parametrize(("longer", "served"), [(5.0, 0), (600.0, 1)])
def test_of_two_that_stand_full_the_nearer_one_is_served_unless_the_other_one_stands_much_longer(
    longer, served
):
    job = begun(2, 1)
    cart, places = job.carts[0], (Pose(40.0, 20.0, EAST), Pose(500.0, 280.0, EAST))
    cart.place = Pose(20.0, 20.0, EAST)
    for c, place, since in zip(job.combines, places, (0.0, -longer), strict=True):
        c.phase, c.place, c.task, c.tank, c.since = "stand", place, None, c.spec.tank, job.time + since
    assert job._calls()
    assert cart.combine is job.combines[served]


@pytest.mark.parametrize(("tank", "goes"), [(9000.0, True), (1000.0, False)])
def test_one_that_pours_for_long_is_not_waited_for(tank, goes):
    """At 90 kg/s: 100 s, or 11 s."""
    way = driving(COMBINE, HERE, 2.0, "way")
    pours = driving(COMBINE, Pose(80.0, 0.0, EAST), 0.0, "pours")
    drive([way, pours], 60.0)
    spec = type("Spec", (), {"auger": 90.0, "limits": type("Limits", (), {"radius": 6.4})})
    cart = CartState(None, HERE, phase="beside")
    states = {"way": CombineState(spec, 0, HERE, 0.0, phase="way", left=200.0),
              "pours": CombineState(spec, 1, HERE, tank, phase="stand", cart=cart)}  # fmt: skip
    give_way = GiveWay()
    for time in (0.0, PATIENCE):
        for m in (way, pours):
            m.blocked, m.claim = "", None
        look([way, pours], {})
        assert way.blocked == "pours"
        give_way.look(time, [way, pours], states, {}, lambda name, pose: north_of(pose))
    assert (way.driver.manoeuvre is not None) is goes


def north_of(pose):
    return polyline(np.array([pose[:2], (pose.x, pose.y + 60.0)]), 0.5)
