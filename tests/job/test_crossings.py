"""Who goes first where ways of combines meet: as planned, or since the other one let it."""

import numpy as np
import pytest

from swath.control.job.crossings import NONE, Crossing, Crossings, GivesWay, Wait, done_at
from swath.control.job.passes import Pass
from swath.control.steer.path import Segment
from swath.core.units import KMH
from swath.signals import PeerState, Phase

S = 1_000_000_000
SPEED = 2.0  # m/s, in passes and turns


def passes(count=2, each=2):
    """Of each combine so many, 200 m long, with turns of 40 m."""
    line, turn = ((0.0, 0.0), (0.0, 200.0)), (Segment(40.0),)
    return tuple(
        Pass(line, speed_kmh=SPEED / KMH, turn=turn, combine=n) for _ in range(each) for n in range(count)
    )


def meets(waits, until, instead_at, instead_until, wait_m=None):
    """Combine 1 waits in its first pass for combine 0 in its first one, or the other way round."""
    return Crossing((GivesWay(1, waits, 0, until, wait_m),), (GivesWay(0, instead_at, 1, instead_until),))


def says(task, come, speed=SPEED, phase=Phase.CUTS, lets=NONE, age=0.1):
    return PeerState(
        0, True, age, 0.0, 0.0, 0.0, speed, 0.0, phase=phase, task=task, come=come, lets_first=lets
    )


ONE = (meets(50.0, 150.0, 100.0, 90.0),)


def test_when_machines_are_done():
    nothing = [0.0, 0.0]
    assert done_at(nothing, [100.0, 80.0], nothing, [[], []]) == [100.0, 80.0]
    # the second waits at 20 until the first is at 70; the first stands for 5 s at 60
    waits = [[Wait(60.0, NONE, 5.0)], [Wait(20.0, 0, 70.0)]]
    assert done_at(nothing, [100.0, 80.0], nothing, waits) == [105.0, 75.0 + 60.0]
    # from where they are; the first stands for 30 s more
    assert done_at([65.0, 20.0], [100.0, 80.0], [30.0, 0.0], [[], waits[1]]) == [65.0, 35.0 + 60.0]
    # past that already
    assert done_at([75.0, 20.0], [100.0, 80.0], nothing, [[], waits[1]]) == [25.0, 60.0]


@pytest.mark.parametrize(("at", "for_good"), [(60.0, True), (70.0, True), (70.3, False)])
def test_machines_that_wait_for_each_other_for_good(at, for_good):
    """One that waits stands a little before the place."""
    waits = [[Wait(at, 1, 30.0)], [Wait(20.0, 0, 70.0)]]
    ends = done_at([0.0, 0.0], [100.0, 80.0], [0.0, 0.0], waits)
    assert (ends == [np.inf, np.inf]) is for_good
    assert for_good or ends[1] == 130.0


def test_done_as_stepped_through():
    """Against machines that are moved on in small steps, with waits at random."""
    rng, step, found = np.random.default_rng(5), 0.05, []
    for _ in range(60):
        whole = rng.uniform(50.0, 90.0, 3).tolist()
        waits = [[] for _ in whole]
        for _ in range(8):
            n, other = rng.choice(3, 2, replace=False).tolist()
            at, until = rng.uniform(0.0, (whole[n], whole[other])).tolist()
            waits[n].append(Wait(at, other, until))
        for own in waits:
            own.append(Wait(float(rng.uniform(0.0, 50.0)), NONE, float(rng.uniform(0.0, 9.0))))
        waits = [sorted(own) for own in waits]
        made = done_at([0.0] * 3, whole, [0.0] * 3, waits)
        stepped = stepped_through(whole, waits, step)
        assert [np.isinf(v) for v in made] == [np.isinf(v) for v in stepped]
        assert made == pytest.approx(stepped, abs=25.0 * step)
        found.append(any(map(np.isinf, made)))
    assert 5 < sum(found) < 55


def stepped_through(whole, waits, step):
    at, next_one, stood = [0.0] * 3, [0] * 3, [0.0] * 3
    ends, moved, i = [np.inf] * 3, True, -1
    while moved:
        moved, i = False, i + 1
        for n in range(3):
            if at[n] >= whole[n]:
                ends[n] = min(ends[n], i * step)
                continue
            rest = waits[n][next_one[n] :]
            while rest and at[n] >= rest[0].at:
                _, other, until = rest[0]
                if other == NONE:
                    if stood[n] < until:
                        stood[n] += step
                        moved = True
                        break
                    stood[n] = 0.0
                elif at[other] < until:
                    break
                next_one[n] += 1
                rest = rest[1:]
                moved = True
            else:
                at[n] = min(at[n] + step, *(w.at for w in rest[:1]), whole[n])
                moved = True
    return ends


def held(mind):
    """The rules that hold now, pass by pass."""
    return [rule for task in range(3) for rule in mind.rules(task)]


def test_one_that_stands_lets_the_other_one_go_first():
    first = Crossings(passes(), 0, ONE, SPEED)
    other = Crossings(passes(), 1, ONE, SPEED)
    stands, waits = says(0, 20.0, 0.0, Phase.STANDS), says(1, 49.8, 0.0)
    assert held(other) == [ONE[0].first[0]]
    assert first.update(0, stands, [waits]) == 0
    assert held(first) == [ONE[0].instead[0]]
    assert other.update(S // 10, waits, [says(0, 20.0, 0.0, Phase.STANDS, lets=0)]) == NONE
    assert held(other) == [ONE[0].instead[0]]
    # told until the other one is past it
    assert first.update(S, stands, [says(1, 89.0)]) == 0
    assert first.update(2 * S, stands, [says(1, 91.0)]) == NONE
    assert held(first) == [ONE[0].instead[0]]


def test_who_was_let_first_and_stands_lets_the_other_one_go_again():
    meetings = (Crossing((GivesWay(2, 10.0, 1, 90.0),)), *ONE)
    first, other = (Crossings(passes(), n, meetings, SPEED) for n in (0, 1))
    assert first.update(0, says(0, 20.0, 0.0, Phase.STANDS), [says(1, 49.8, 0.0)]) == 1
    stands, waits = says(1, 49.8, 0.0, Phase.STANDS), says(0, 99.8, 0.0)
    assert other.update(3 * S, stands, [says(0, 99.8, 0.0, lets=1)]) == 1 + 2  # for the second time
    assert first.update(3 * S, waits, [says(1, 49.8, 0.0, Phase.STANDS, lets=3)]) == NONE
    assert first.update(4 * S, waits, [says(1, 49.8, 0.0, Phase.STANDS, lets=1)]) == NONE  # an old one
    assert [held(mind) for mind in (first, other)] == [[ONE[0].first[0], meetings[0].first[0]]] * 2


@pytest.mark.parametrize(("own", "other", "t"), [
    (says(0, 20.0, 0.0, Phase.STANDS), says(1, 40.0, 0.0), 0),  # it does not wait there
    (says(0, 20.0, 0.0, Phase.STANDS), says(1, 49.8, 1.0), 0),
    (says(0, 20.0, 0.0, Phase.STANDS), says(1, 49.8, 0.0, age=2.0), 0),  # of long ago
    (says(0, 20.0, 0.0, Phase.STANDS), says(1, 49.8, 0.0), 3 * S),  # the other one's slot
    (says(0, 140.0, 0.0, Phase.STANDS), says(1, 49.8, 0.0), 0),  # it is there already
    (says(0, 96.0), says(1, 49.8, 0.0), 0),  # it cannot come to rest before it
])  # fmt: skip
def test_where_nobody_is_let_first(own, other, t):
    first = Crossings(passes(), 0, ONE, SPEED)
    assert first.update(t, own, [other]) == NONE
    assert held(first) == [ONE[0].first[0]]


@pytest.mark.parametrize(("come", "until", "told"), [
    (90.0, 120.0, NONE),
    (60.0, 120.0, 0),
])  # fmt: skip
def test_who_is_through_sooner_lets_nobody_go_first(come, until, told):
    meeting = (meets(50.0, until, 100.0, 90.0),)
    assert Crossings(passes(), 0, meeting, SPEED).update(0, says(0, come), [says(1, 49.8, 0.0)]) == told


@pytest.mark.parametrize(("come", "speed", "may"), [
    (199.8, 0.0, True),  # it stands a little behind the end of its pass, as machines do
    (200.4, 0.0, True),
    (199.8, 1.0, False),  # it cannot come to rest there
    (201.0, 2.0, True),  # past that it waits at the crossing
    (234.5, 2.0, False),
])  # fmt: skip
def test_one_that_is_past_the_end_of_its_pass_lets_the_other_one_go_first_too(come, speed, may):
    """To wait at the end of the pass, or, past that, in its turn."""
    meeting = (Crossing((GivesWay(1, 50.0, 2, 40.0),), (GivesWay(0, 235.0, 1, 90.0, 199.5),)),)
    made = Crossings(passes(), 0, meeting, SPEED).update(0, says(0, come, speed), [says(1, 49.8, 0.0)])
    assert (made == 0) is may


def test_nobody_is_let_first_where_it_must_not():
    fixed = (Crossing(ONE[0].first),)
    assert Crossings(passes(), 0, fixed, SPEED).update(
        0, says(0, 20.0, 0.0, Phase.STANDS), [says(1, 49.8, 0.0)]
    ) == NONE  # fmt: skip


@pytest.mark.parametrize("may", [True, False])
def test_those_that_would_wait_for_each_other_for_good(may):
    """Behind the crossing the other one waits for it again: both at once, or none."""
    then = meets(60.0, 150.0, 110.0, 120.0)
    meetings = (*ONE, then if may else Crossing(then.first))
    first = Crossings(passes(), 0, meetings, SPEED)
    stands, waits = says(0, 20.0, 0.0, Phase.STANDS), says(1, 49.8, 0.0)
    told = {first.update(round(0.1 * i * S), stands, [waits]) for i in range(10)}
    assert told == ({0, 1} if may else {NONE})


def test_a_third_one_is_known_to_wait():
    """What one lets another one do must not bring a third one to wait for good, either."""
    three = passes(3)
    through = GivesWay(2, 30.0, 0, 100.5), GivesWay(1, 80.0, 2, 60.0)  # 1 for 2, 2 for 0: 1 not before 0
    meetings = (*ONE, Crossing(through[:1]), Crossing(through[1:]))
    told = says(0, 20.0, 0.0, Phase.STANDS), says(1, 49.8, 0.0), says(2, 10.0)
    assert Crossings(three, 0, meetings[:2], SPEED).update(0, told[0], list(told[1:])) == 0
    assert Crossings(three, 0, meetings, SPEED).update(0, told[0], list(told[1:])) == NONE
    assert Crossings(three, 0, meetings[:2], SPEED).update(0, told[0], [told[1]]) == NONE  # not heard


def test_where_one_waits():
    """At the end of the pass, unless it is past that."""
    rule = GivesWay(3, 150.0, 0, 10.0, 90.0)
    assert rule.hold(2, 50.0) == rule.hold(3, 50.0) == rule.hold(3, 90.5) == 90.0
    assert rule.hold(3, 91.5) == 150.0
    assert GivesWay(3, 150.0, 0, 10.0).hold(3, 50.0) == 150.0


def test_what_was_let_is_saved_and_loaded():
    first, again = (Crossings(passes(), 0, ONE, SPEED) for _ in range(2))
    stands, waits = says(0, 20.0, 0.0, Phase.STANDS), says(1, 49.8, 0.0)
    first.update(0, stands, [waits])
    again.load(first.save())
    assert again.update(S // 2, stands, [waits]) == 0
    assert held(again) == [ONE[0].instead[0]]
    again.reset()
    assert held(again) == [ONE[0].first[0]]
