"""Two combines in echelon that hear each other, and their carts: until the field is empty."""

from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
import shapely

from swath.control.job import crossings
from swath.control.job.abreast import Abreast, begins_ahead, leader_of
from swath.control.job.calls import Calls
from swath.control.job.crossings import Crossing, Crossings, GivesWay
from swath.control.job.passes import Pass
from swath.core.errors import InputError
from swath.job import engine
from swath.job.machines import fleet_of
from swath.job.work import plan_of
from swath.signals import HeapState, JobState, MachineLoad, PeerState, Phase, UnloadState
from swath.tools.fleet import order, uncut
from swath.tools.fleet import work_plan as planning
from swath.tools.fleet.uncut import uncut_before
from swath.tools.fleet.whole import share_uncut
from swath.tools.fleet.work_plan import told_passes, work_plan
from tests.job.cheap import CheapRun
from tests.job.jobs import job_file
from tests.job.layouts import layout_file

LAG = 25.0
COMBINES = "combine_0", "combine_1"
STEP = 0.3  # s
SHORT, LONG = (0.006, 150), (0.0008, 800)  # stops: how often in a step, of how many steps at most
SAVED_AT, AGAIN_TO = 75.0, 110.0  # s, grain flows; the cart leaves, and both combines turn


def file_of(carts, north, lag=LAG, east=60.0, **changes):
    """combine-5m in echelon: six passes are 28.5 m."""
    made = {
        "plan": {"headland_rounds": 0}, "team": {"together": "echelon", "lag_m": lag},
        "truck": {"x_m": -25.0, "y_m": 45.0, "dock_s": 4.0},
        "combine": {"machine": "combine-5m", "call_percent": 5.0, "tank_start_percent": 8.0},
        "cart": {"leave_percent": 1.0} if carts > 1 else {}, **changes,
    }  # fmt: skip
    ring = [(0.0, 0.0), (east, 0.0), (east, north), (0.0, north)]
    return job_file(combines=2, carts=carts, boundary_m=ring, **made)


class Run(CheapRun):
    """rows: at every step of the second combine's job, both combines' passes and ways along them [m];
    served: combines (by number) that a cart took grain of; by: who cut which pass
    """

    def __init__(self, file, **given):
        self.rows, self.served, self.by = [], defaultdict(set), defaultdict(set)
        super().__init__(file, **given)

    def see(self, slot, t):
        machine, _, name = slot.partition(".")
        if name == "job" and machine in COMBINES and self.of(machine, JobState).phase == Phase.CUTS:
            self.by[self.of(machine, JobState).task].add(machine)
        if slot == "combine_1.job" and (COMBINES[0], UnloadState) in self.latest:
            jobs = [self.of(c, JobState) for c in COMBINES]
            self.rows.append([v for job in jobs for v in (job.task, job.come, job.phase)])
            for number, combine in enumerate(COMBINES):
                if self.of(combine, UnloadState).flow > 0.0:
                    for cart in self.plan_carts:
                        job = self.of(cart, JobState)
                        if job.phase == Phase.BESIDE and job.task == jobs[number].task:
                            self.served[cart].add(number)

    @property
    def plan_carts(self):
        return [name for name in self.world.machines if name.startswith("cart")]


@pytest.fixture(scope="module")
def run():
    first = Run(file_of(1, 28.5), until_s=SAVED_AT)
    state = first.saved()
    digest = first.go_on(AGAIN_TO).digest.hex
    return first.go_on(), state, digest


def check_done(done, carts, least=0.45):
    """All cut, all grain at the truck, nothing lost, nothing nearer than least [m]."""
    assert "the field is empty" in done.world.graph.ended
    assert share_uncut(done.world.field, done.plan) < 1e-3
    heaps = [done.of(cart, HeapState) for cart in carts]
    assert all(done.of(combine, MachineLoad).tank_level < 0.005 for combine in COMBINES)
    assert sum(heap.grain for heap in heaps) == pytest.approx(0.0, abs=1e-6)
    assert sum(heap.emptied for heap in heaps) > 0.95 * done.plan.area * 0.8
    metrics = done.evaluation.metrics("field")
    assert metrics["mass_balance_error"] < 1e-9
    assert metrics["spill_share"] <= 1e-3
    for name in (*COMBINES, *carts):
        metrics = done.evaluation.metrics(name)
        assert metrics["contact_count"] == 0.0
        assert metrics["least_clearance_m"] > least


def test_two_combines_and_one_cart_until_the_field_is_empty(run):
    check_done(run[0], ("cart_0",))
    assert run[0].served["cart_0"] == {0, 1}


def test_every_pass_is_cut_by_the_combine_that_it_was_given_to(run):
    assert dict(run[0].by) == {task: {COMBINES[task % 2]} for task in range(6)}


def test_the_one_behind_keeps_its_distance(run):
    """Along the pass beside, from its begin to the end of the pass of the one ahead."""
    rows = np.array(run[0].rows)
    pair = (
        (rows[:, 3] == rows[:, 0] + 1) & (rows[:, 4] > 0.0) & (rows[:, 1] < 60.0) & (rows[:, 2] == Phase.CUTS)
    )
    assert pair.sum() > 100
    gap = (rows[:, 1] - rows[:, 4])[pair]
    assert gap.min() > LAG - 0.5
    assert np.median(gap) < LAG + 8.0


def test_the_same_digest_with_one_thread_and_after_save_and_load(run, monkeypatch):
    _, state, digest = run
    monkeypatch.setenv("SWATH_THREADS", "1")
    again = Run(file_of(1, 28.5), state=state, until_s=AGAIN_TO)
    assert again.of("cart_0", HeapState).grain > 100.0
    assert again.digest.hex == digest


def test_two_combines_and_two_carts_until_the_field_is_empty():
    done = Run(file_of(2, 28.5))
    check_done(done, ("cart_0", "cart_1"))
    assert all(done.of(cart, HeapState).emptied > 100.0 for cart in ("cart_0", "cart_1"))
    # each pipe is judged against the box below it, not against that of the other cart
    assert done.evaluation.metrics("field")["station_along_max_m"] < 1.0


def test_two_combines_with_lands_of_their_own_until_the_field_is_empty():
    """Each cuts the passes that it cuts at `events`."""
    file = file_of(1, 38.5, east=50.0, team={"together": "own_lands"})
    done = Run(file)
    check_done(done, ("cart_0",))
    assert done.served["cart_0"] == {0, 1}
    fleet = fleet_of(file)
    by = work_plan(file, plan_of(file, fleet, None), fleet).shared.by
    assert set(by) == {0, 1}
    assert dict(done.by) == {task: {COMBINES[number]} for task, number in enumerate(by)}


def members_of(file):
    """By the first way of sharing out that can be driven."""
    fleet = fleet_of(file)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "TRIES", 1)
        work = work_plan(file, plan_of(file, fleet, None), fleet)
    return told_passes(work.rows), fleet.combines, work.team


def driven(passes, combines, team, lag, rng, stop=SHORT, *, obey=True):
    """All ways driven in steps of 0.3 s with stops at random, by what each hears of the others: least
    distance of their outlines [m], in how many steps one is where another one is to cut before, for how many
    steps they wait, and how often one lets another one go first; None where all stand for good.
    """
    units, places, minds, decide = [], [], [], []
    numbers = range(len(combines))
    for number, member in enumerate(team):
        routes = order._routes(passes, number, combines[number], member.run_out)
        made = order._samples(routes, passes, combines[number], member.start, STEP)
        units.append((routes, made))
        places.append(order._bodies(made.place, np.array(combines[number].sheet.outline), shapely))
        found = [crossing_of(rules) for rules in member.job["crossings"] if obey]
        decide.append(Crossings(passes, number, found, combines[number].turn_speed))
        minds.append(Abreast(passes, number, lag if obey or lag is None else -1e3, decide[-1]))
    ways = order.Ways(passes, [routes for routes, _ in units], [made for _, made in units], STEP)
    crop = {(k, n): uncut_before(ways, combines, k, n) for n in numbers for k in range(n)}
    at, least, idle, over, waits, t = [0 for _ in numbers], np.inf, 0, 0, 0, 0
    stops, lets, speeds = [0 for _ in numbers], [-1 for _ in numbers], [0.0 for _ in numbers]
    while any(at[n] < len(units[n][1].way) - 1 for n in numbers):
        moved = False
        heard = [told(units[n][1], at[n], passes, lets[n], speeds[n], stops[n] > 0) for n in numbers]
        for n in numbers:
            routes, made = units[n]
            others = [heard[k] for k in numbers if k != n]
            lets[n] = decide[n].update(t, heard[n], others)
            if at[n] == len(made.way) - 1:
                continue
            begins = rng.random() < stop[0]
            stops[n] = stops[n] - 1 if stops[n] > 0 else int(rng.integers(20, stop[1])) * begins
            task, index = int(made.task[at[n]]), sorted(routes).index(made.task[at[n]])
            route = routes[task]
            free = minds[n].free(index, made.way[at[n]], route.length + route.turn, others)
            moved |= stops[n] > 0
            goes = stops[n] == 0 and free > 0.3
            if goes:
                at[n] += 1
                moved = True
            speeds[n] = min(2.0, np.sqrt(2.0 * max(free, 0.0))) if goes else 0.0
            waits += stops[n] == 0 and not goes
        t += round(STEP * 1e9)
        idle = 0 if moved else idle + 1
        if idle > 30:
            return None
        over += any(crop[k, n][at[k], at[n]] for k, n in crop)
        for n in numbers:
            for k in range(n):
                (ax, ay), (bx, by) = units[n][1].place[at[n], :2], units[k][1].place[at[k], :2]
                if abs(ax - bx) + abs(ay - by) < 40.0:
                    least = min(least, shapely.distance(places[n][at[n]], places[k][at[k]]))
    given = [max(times) for times in zip(*(mind._turned for mind in decide), strict=True)]
    return float(least), over, waits, sum(given)


def crossing_of(rules):
    """As a machine is told it."""
    return Crossing(*(tuple(GivesWay(**rule) for rule in rules.get(k, ())) for k in ("first", "instead")))


def told(made, at, passes, lets=-1, speed=0.0, stands=False):
    """The message of a combine at one of its samples."""
    task, way = int(made.task[at]), float(made.way[at])
    (ax, ay), (bx, by) = passes[task].line_m
    phase = Phase.CUTS if way <= np.hypot(bx - ax, by - ay) + 0.3 else Phase.TURNS
    phase = Phase.STANDS if stands else phase
    phase = Phase.DONE if at == len(made.way) - 1 else phase
    nothing = [0.0] * 3
    return PeerState(0, True, 0.1, *nothing, speed, 0.0, phase=phase, task=task, come=way, lets_first=lets)


@pytest.mark.parametrize(
    ("north", "lag", "east"), [(28.5, 22.0, 50.0), (23.0, 30.0, 40.0), (46.0, 40.0, 90.0)]
)
def test_the_order_at_the_turns_neither_lets_them_touch_nor_stand_for_good(north, lag, east):
    """However long one of them stops, and wherever; without the rules they come over each other."""
    passes, combines, team = members_of(file_of(1, north, lag, east))
    rng = np.random.default_rng(3)
    made = [driven(passes, combines, team, lag, rng) for _ in range(4)]
    assert None not in made
    assert min(made)[0] > 0.5
    assert all(given == 0 for *_, given in made)  # the order in echelon stays as it is
    assert min(driven(passes, combines, team, lag, rng, obey=False) for _ in range(4))[0] == 0.0


@pytest.fixture(scope="module")
def blind():
    """Layout 19, three combines, shared out as where they do not look ahead: they wait for each other."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(engine, "is_needed_soon", lambda job, combine: False)
        return members_of(layout_file(19, 2))


@pytest.mark.parametrize("seed", [16, 19])
def test_the_order_of_combines_with_lands_of_their_own(seed, blind, monkeypatch):
    """Layouts with three combines, likewise; nor does one drive where another one is to cut before, looked at
    10 m less far ahead than it is planned.
    """
    passes, combines, team = blind if seed == 19 else members_of(layout_file(seed, 1))
    monkeypatch.setattr(uncut, "AHEAD", uncut.AHEAD - 10.0)
    rng = np.random.default_rng(3)
    made = [driven(passes, combines, team, None, rng, stop) for stop in (SHORT, LONG, SHORT, LONG)]
    assert None not in made
    assert min(made)[0] > 0.3
    assert max(steps for _, steps, *_ in made) == 0
    touched = crossed = False
    for _ in range(12):
        least, steps, *_ = driven(passes, combines, team, None, rng, LONG, obey=False)
        touched, crossed = touched or least == 0.0, crossed or steps > 100
        if touched and crossed:
            return
    pytest.fail(f"without the rules: touched {touched}, drove where another one is to cut before {crossed}")


def test_where_combines_and_carts_beside_them_are_near_each_other():
    """As found from the distance of each pair, where no cart leaves."""
    passes, combines, team = members_of(file_of(1, 38.5, east=50.0, team={"together": "own_lands"}))
    ways = order.ways_of(passes, combines, [m.start for m in team], [m.run_out for m in team])
    first, second = ways.samples
    outlines = [np.array(c.sheet.outline) for c in combines]
    boxes = [order._beside(c, -order.CART, order.CART) for c in combines]
    body, cart = (
        [order._bodies(s.place, shape, shapely) for s, shape in zip(ways.samples, shapes, strict=True)]
        for shapes in (outlines, boxes)
    )

    def is_near(a, b):
        return shapely.distance(a[:, None], b[None, :]) < order.APART

    beside = first.beside[:, None] & second.turns & is_near(cart[0], body[1])
    beside |= first.turns[:, None] & second.beside & is_near(body[0], cart[1])
    asked = ~(first.leaves[:, None] | second.leaves)
    shapes = [order._shapes(way, combine) for way, combine in zip(ways.samples, combines, strict=True)]
    found = order._near(ways.samples, shapes, with_carts=True)
    assert (found == (is_near(*body) | beside))[asked].all()
    assert (beside & ~is_near(*body))[asked].sum() > 50


def test_combines_that_stop_wait_less_for_each_other(blind, monkeypatch):
    """Since who stands lets others go first."""
    passes, combines, team = blind

    def waits():
        draws = [np.random.default_rng(seed) for seed in range(3)]
        made = [driven(passes, combines, team, None, rng, LONG) for rng in draws]
        assert None not in made
        return [sum(row[i] for row in made) for i in (2, 3)]

    steps, given = waits()
    assert given > 0
    monkeypatch.setattr(crossings, "EARLIER", np.inf)
    assert waits()[0] > 1.2 * steps


def message(task, come, phase=Phase.CUTS):
    return PeerState(0, True, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, phase=phase, task=task, come=come, calls=True)


BESIDE = (
    Pass(((0.0, 0.0), (0.0, 80.0))),
    Pass(((5.0, 4.0), (5.0, 80.0)), combine=1),
    Pass(((30.0, 80.0), (30.0, 0.0))),
)


def test_how_far_the_one_behind_may_go():
    meeting = Crossing((GivesWay(1, 60.0, 2, 10.0),))
    mind = Abreast(BESIDE, 1, 20.0, Crossings(BESIDE, 1, [meeting], 2.0))
    assert leader_of(BESIDE, 1) == 0
    assert leader_of(BESIDE, 2) is None
    assert begins_ahead(BESIDE[0], BESIDE[1]) == pytest.approx(-4.0)
    assert mind.free(0, 2.0, 100.0, [message(0, 50.0)]) == pytest.approx(50.0 - 4.0 - 20.0 - 2.0)
    assert mind.free(0, 2.0, 100.0, [message(0, 81.0, Phase.TURNS)]) == pytest.approx(58.0)
    assert mind.free(0, 2.0, 100.0, [message(2, 10.1)]) == np.inf
    assert mind.free(0, -9.0, 100.0, []) == pytest.approx(8.0)  # nothing heard: not into the pass


def test_a_call_without_a_way_goes_after_one_that_needs_a_cart_as_much():
    calls = Calls(BESIDE, 15.0)
    combines = {k: replace(message(k, 10.0), remaining=50.0) for k in (0, 1)}
    assert calls.neediest(10.0, combines, [])[0] == 0
    calls.no_way(0, 12.0)
    assert calls.neediest(12.0, combines, []) == (1, 2.0)
    assert calls.neediest(41.0, combines, [])[0] == 1
    calls.no_way(1, 43.0)
    assert calls.neediest(43.0, combines, []) == (0, 31.0)


@pytest.mark.parametrize(("tried", "first"), [(20.0, 0), (300.0, 0), (320.0, 1)])
def test_a_cart_looks_on_for_a_way_to_a_combine_that_needs_it_before_another_one(tried, first):
    """As long again as there was none: then the other one, 500 m away, would be served before, too."""
    calls = Calls(BESIDE, 15.0)
    combines = {
        k: replace(message(k, 10.0), remaining=50.0, stands_in=s) for k, s in enumerate((100.0, 2000.0))
    }
    combines[1] = replace(combines[1], x=500.0)
    for now in np.arange(0.0, tried, 5.0):
        assert calls.neediest(now, combines, [])[0] == 0
        calls.no_way(0, now)
    assert calls.neediest(tried, combines, [])[0] == first
    assert calls.neediest(tried + 40.0, combines, [])[0] == 0  # it has not looked any more


@pytest.mark.parametrize(
    ("waits", "stands", "goes"), [(True, True, True), (False, True, False), (True, False, False)]
)
def test_a_cart_that_waits_for_one_leaves_it_for_one_that_stands(waits, stands, goes):
    """And does not set out to the first one again at once, though that is done last and so goes first."""
    calls = Calls(BESIDE, 15.0)
    phase = Phase.STANDS if stands else Phase.CUTS
    combines = {k: replace(message(k, 10.0), remaining=50.0, may_unload=True) for k in (0, 1)}
    combines[0] = replace(combines[0], remaining=500.0, stands_in=0.0)
    combines[1] = replace(combines[1], phase=phase)
    assert calls.neediest(10.0, combines, [])[0] == 0
    assert calls.turns_to_standing(12.0, 0, combines, [], waits=waits) is goes
    assert calls.neediest(12.0, combines, [])[0] == int(goes)


@pytest.mark.parametrize(("file", "said"), [
    (file_of(1, 28.5, lag=15.0), "lag_m"),
    (file_of(1, 40.0, plan={"headland_rounds": 1}), "opening rounds"),
])  # fmt: skip
def test_what_two_combines_cannot_do_is_refused(file, said):
    fleet = fleet_of(file)
    with pytest.raises(InputError, match=said):
        work_plan(file, plan_of(file, fleet, None), fleet)


def test_passes_on_which_they_cannot_keep_clear_are_refused():
    """Three of them: the first combine's way leads back beside the last pass of the second."""
    with pytest.raises(InputError, match="keep clear"):
        members_of(file_of(1, 12.0))
