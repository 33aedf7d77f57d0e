"""Pacing by a clock that a test moves: deadlines, overruns and whom they belong to, the three policies."""

import pytest

from swath.runtime.pacing import Exchange, OverrunError, Pacer, scheduling
from swath.scenario.sections import RealTime
from tests.fake_clock import FakeClock

MS, NS = 1_000_000, 1_000_000_000


class Rig:
    """A pacer with a clock and two slots whose costs are written by hand."""

    def __init__(self, **keys):
        self.clock, self.costs, self.exchanges = FakeClock(), {"lidar": 0.0, "motion": 0.0}, []
        plan = RealTime(**{"grace_s": 0.0, **keys})
        self.pacer = Pacer(plan, lambda: self.costs, clock=self.clock, relieve=self.relieve)

    def relieve(self, t):
        if len(self.exchanges) == 1:
            return None
        self.exchanges.append(t)
        return Exchange(t, "combine.lidar", "plants", "empirical")

    def tick(self, t_ms, **used_ms):
        for slot, ms in used_ms.items():
            self.clock.t += round(ms * MS)
            if slot in self.costs:
                self.costs[slot] += ms * 1e-3
        self.pacer(round(t_ms * MS))


def test_every_tick_begins_at_its_absolute_deadline():
    rig = Rig(factor=2.0)
    rig.tick(5)
    start = rig.clock.t
    for k in range(2, 40):
        rig.tick(5 * k, motion=1.7)
        assert rig.clock.t - start == (5 * k - 5) * MS // 2
    assert rig.pacer.report()["max_late_ms"] == 0.0
    assert rig.pacer.overruns.total() == 0


def test_time_that_is_left_goes_into_work_in_advance_as_long_as_a_piece_fits_in():
    rig, done = Rig(), []

    def piece():
        if len(done) == 6:
            return False
        done.append(rig.clock.t)
        rig.clock.t += 2 * MS
        return True

    rig.pacer = Pacer(RealTime(grace_s=0.0), clock=rig.clock, prepare=piece)
    rig.tick(10)
    rig.tick(20, motion=3)
    begin = rig.clock.t - 7 * MS
    assert done == [begin, begin + 2 * MS]  # 3 ms are left then: a piece may take longer
    rig.tick(30, motion=8)
    assert len(done) == 2
    for k in range(4, 20):
        rig.tick(10 * k, motion=1)
    assert len(done) == 6
    assert rig.pacer.report()["max_late_ms"] == 0.0


def test_work_in_advance_that_takes_longer_than_is_left_is_left_for_a_while():
    rig, done = Rig(), []

    def piece():
        done.append(rig.clock.t)
        rig.clock.t += 12 * MS
        return True

    rig.pacer = Pacer(RealTime(grace_s=0.0), clock=rig.clock, prepare=piece)
    for k in range(1, 41):
        rig.tick(5 * k)
    assert len(done) == 1  # 12 ms are longer than all that is left between two ticks
    assert rig.pacer.report()["late"]["up to 20 ms"] == 1
    for k in range(41, 300):
        rig.tick(5 * k)
    assert 2 <= len(done) <= 5


def test_lateness_within_the_tolerance_is_caught_up():
    rig = Rig(tolerance_ms=20)
    for k in range(1, 20):
        rig.tick(10 * k, lidar=25 if k == 5 else 1)
    assert rig.clock.t - 7 * NS == 180 * MS + 1 * MS  # the first tick begins when it is called
    report = rig.pacer.report()
    assert report["max_late_ms"] == 15.0
    assert report["overruns"] == 0
    assert report["late"]["up to 20 ms"] == 2  # 15 ms, then 6 ms
    assert sum(report["late"].values()) == report["ticks"] == 19


def test_an_overrun_shifts_the_deadlines_and_belongs_to_the_slot_that_used_the_time():
    rig = Rig(tolerance_ms=20)
    rig.tick(10)
    rig.tick(20, motion=3, lidar=40)
    after = rig.clock.t
    rig.tick(30, motion=3)
    assert rig.clock.t == after + 10 * MS
    rig.tick(40, files=50, motion=1)
    rig.clock.wake_late = 43 * MS
    rig.tick(50, motion=1)
    report = rig.pacer.report()
    assert report["overruns_by_slot"] == {"lidar": 1, "recording": 1, "system": 1}
    assert report["slipped_s"] == pytest.approx(0.033 + 0.041 + 0.043)
    assert "3 overruns over 20 ms" in rig.pacer.notes[0]


def test_time_used_over_several_ticks_is_added_up():
    rig = Rig(tolerance_ms=20)
    rig.tick(10)
    for k in range(2, 6):
        rig.tick(10 * k, lidar=10, motion=7)
    assert rig.pacer.overruns == {"lidar": 1}


def test_fail_names_time_and_slot():
    rig = Rig(on_overrun="fail")
    rig.tick(10)
    with pytest.raises(OverrunError, match=r"35 ms late at 0\.02 s .* at most 20 ms; lidar used most"):
        rig.tick(20, lidar=45)


def test_the_start_may_be_late():
    rig = Rig(on_overrun="fail", grace_s=0.5)
    rig.tick(10)
    rig.tick(20, lidar=3000)
    rig.tick(30, lidar=5)
    report = rig.pacer.report()
    assert (report["start_slipped_s"], report["slipped_s"], report["max_late_ms"]) == (2.99, 0.0, 0.0)
    with pytest.raises(OverrunError):
        rig.tick(600, lidar=700)


def test_degrade_waits_for_several_overruns_in_a_while():
    rig = Rig(on_overrun="degrade", patience=3, window_s=1.0, grace_s=0.0)
    rig.tick(10)
    for t in (100, 900, 1150):  # never three within a second
        rig.tick(t, lidar=2000)
    assert rig.exchanges == []
    rig.tick(1200, lidar=2000)
    assert rig.exchanges == [1200 * MS]
    for t in (1300, 1400, 1500, 1600):  # nothing is left to take: it slips
        rig.tick(t, lidar=2000)
    assert rig.pacer.report()["degraded"] == [
        {"t_s": 1.2, "slot": "combine.lidar", "from": "plants", "to": "empirical"}
    ]
    assert rig.pacer.notes[-1] == "real time: combine.lidar went from plants to empirical at 1.2 s"


def test_scheduling_is_had_or_refused_with_the_reason(monkeypatch):
    import os

    asked = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda pid, policy, param: asked.append(policy))
    with scheduling(50) as had:
        assert had == "fifo 50"
    assert asked == [os.SCHED_FIFO, os.sched_getscheduler(0)]

    def refuse(pid, policy, param):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with scheduling(50) as had:
        assert had == "fifo 50 refused: Operation not permitted"
    with scheduling(None) as had:
        assert had == "default"
