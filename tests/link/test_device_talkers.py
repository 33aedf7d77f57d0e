"""Receivers beside each other on one line: whose positions count does not hang on the order of sentences."""

import itertools
import math
import random

import pytest

from swath.link.device import nmea

GN, GP, P = "GN", "GP", "P"


def gga(t, talker=GN, lat="5206.0000", quality=4, height="298.4"):
    time = f"{10 + int(t) // 3600:02d}{int(t) // 60 % 60:02d}{t % 60:05.2f}"
    if talker == P:
        return f"PANDA,{time},{lat},N,01012.0000,E,{quality},12,0.8,345.0,1.0,4.0,65535,0,0,0"
    return f"{talker}GGA,{time},{lat},N,01012.0000,E,{quality},12,0.8,{height},M,46.6,M,1.0,0000"


def rmc(t, talker=GN, knots=4.0):
    time = f"10{int(t) // 60 % 60:02d}{t % 60:05.2f}"
    return f"{talker}RMC,{time},A,5206.0000,N,01012.0000,E,{knots},90.0,150726,,,N"


def vtg(talker=GN, knots=4.0):
    return f"{talker}VTG,90.0,T,,M,{knots},N,,K,A"


def heard(bodies):
    listener = nmea.Listener()
    told = listener.feed(b"".join(map(nmea.sentence, bodies)))
    return told, listener


OTHER = "5206.0010"  # 1.85 m further north


@pytest.mark.parametrize("order", [*itertools.permutations(range(3))])
@pytest.mark.parametrize("place", [1, 2, 3])  # a speed has no time of its own
def test_the_best_fix_counts_in_every_order_and_the_other_is_named(order, place):
    seconds = []
    for t in range(20):
        of_time = [gga(t), gga(t, GP, OTHER, 1), rmc(t, GP, 9.0)]
        made = [of_time[k] for k in order]
        seconds += [*made[:place], vtg(GN, 4.0), *made[place:]]
    told, listener = heard(seconds)
    assert len(told) >= 18
    for epoch in told:
        assert epoch.latitude == pytest.approx(math.radians(52.1), abs=1e-12)
        assert epoch.quality == 4
        assert epoch.speed == pytest.approx(4.0 * nmea.KNOT)
    assert listener.unknown["sources: positions of GP, those of GN count"] >= 18


@pytest.mark.parametrize("quality", ["4", "45", "12", "44404"])
@pytest.mark.parametrize("talkers", ["GN" * 10 + "GP" * 10, "GPGN", "GPGNGN", "GPGNGLGN"])
def test_a_receiver_that_changes_its_talker_says_each_epoch(talkers, quality):
    names = [talkers[k : k + 2] for k in range(0, len(talkers), 2)]
    bodies = []
    for t in range(40):
        name, place = names[t % len(names)], f"5206.{t:04d}"
        bodies += [gga(t, name, place, int(quality[t % len(quality)])), rmc(t, name, t / 10.0), vtg(name)]
    told, listener = heard(bodies)
    assert [e.seconds - 36_000 for e in told] == [*range(40)]
    assert [round((math.degrees(e.latitude) - 52.1) * 60e4) for e in told] == [*range(40)]
    assert not listener.unknown


def test_a_receiver_that_changes_its_talker_beside_another_one():
    told, listener = heard([s for t in range(20) for s in (gga(t, "GB", OTHER, 4), gga(t, (GN, GP)[t % 2]))])
    assert len({e.latitude for e in told}) == 1
    assert listener.unknown["sources: positions of GB, those of GN count"] >= 18


def test_one_position_that_two_talkers_say_is_of_one_source():
    told, listener = heard([s for t in range(20) for s in (gga(t, GP), gga(t))])
    assert len(told) == 20
    assert not listener.unknown


def test_another_source_that_is_left_alone_counts_after_it_was_silent():
    told, listener = heard([s for t in range(20) for s in (gga(t), gga(t, GP, OTHER))[t // 10 :]])
    assert [e.seconds - 36_000 for e in told] == [t for t in range(20) if not 10 <= t <= 11]
    assert set(listener.unknown) == {"sources: positions of GP, those of GN count"}


@pytest.mark.parametrize("first", [0.0, 0.5])
def test_receivers_that_take_turns_do_not_jump(first):
    bodies = [gga(t + 0.5, GP, OTHER, 1) if k else gga(t) for t in range(20) for k in (0, 1)]
    told, _ = heard(bodies[1:] if first else bodies)
    assert len({e.latitude for e in told}) == 1
    assert len(told) >= 18


def test_what_only_one_says_is_taken_from_it_and_is_no_doubt():
    heading = "HEHDT,45.0,T"
    told, listener = heard([s for t in range(9) for s in (gga(t), heading, vtg(GP))])
    assert all(e.heading == pytest.approx(math.radians(45.0)) for e in told)
    assert all(e.speed == pytest.approx(4.0 * nmea.KNOT) for e in told)
    assert not listener.unknown


def test_a_height_of_another_is_not_put_beside_a_position():
    told, listener = heard([s for t in range(9) for s in (gga(t, height=""), gga(t, GP, OTHER, 1))])
    assert all(math.isnan(e.height) for e in told)
    assert listener.unknown["heights: positions without a height above the ellipsoid"] == len(told)


def test_before_the_first_fix_no_talker_is_chosen():
    bodies = [s for t in range(5) for s in (gga(t, quality=0), gga(t, GP, OTHER, 0))]
    bodies += [s for t in range(5, 12) for s in (gga(t), gga(t, GP, OTHER, 1))]
    told, _ = heard(bodies)
    assert [e.quality for e in told] == [0] * 5 + [4] * (len(told) - 5)


def test_sentences_of_agopengps_are_a_talker_of_their_own():
    told, listener = heard([s for t in range(9) for s in (gga(t, P, OTHER, 1), gga(t))])
    assert {e.quality for e in told} == {4}
    assert "sources: positions of P, those of GN count" in listener.unknown


def test_drawn_streams_that_lack_sentences_are_one_track():
    for seed in range(20):
        draw = random.Random(seed)
        bodies = []
        for t in range(30):
            of_time = [gga(t), gga(t, GP, OTHER, draw.choice((1, 2)))]
            draw.shuffle(of_time)
            bodies += of_time[:1] if t % 3 == 2 and draw.random() < 0.5 else of_time
        told, _ = heard(bodies)
        places = [round(math.degrees(e.latitude), 9) for e in told if e.quality]
        assert len(set(places)) == 1, seed
