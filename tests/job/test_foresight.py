"""A cart is called before passes beside which none can drive, where the tank would be full in them."""

from collections import deque
from types import SimpleNamespace

import pytest

from swath.job import engine
from swath.job.foresight import is_needed_soon
from tests.job.jobs import finished, job_file
from tests.job.layouts import layout_file

GRAIN = 4000.0  # kg, of a pass


class Known(list):
    """Passes, of which those from one on come. first: their number"""

    first = 1

    def coming(self, combine):
        return range(self.first, len(self))


def job_of(beside, *, phase="cut", left=0.5, tank=3000.0, taken=-1, mode="on_the_go"):
    """A combine in the first of some passes, tank of 9 t. beside: which of them a cart may drive beside"""
    passes = Known(SimpleNamespace(area=GRAIN, length=1.0, cart_beside=b) for b in beside)
    passes.first = 1 if taken < 0 else taken + 1
    spec = SimpleNamespace(tank=9000.0)
    combine = SimpleNamespace(task=passes[0], phase=phase, left=left, tank=tank, spec=spec, taken=taken)
    file = SimpleNamespace(unload=SimpleNamespace(mode=mode))
    return SimpleNamespace(file=file, passes=passes, grain_per_m2=1.0), combine


@pytest.mark.parametrize(("beside", "more", "is_called"), [
    # 5.0 t at the end of the present pass, beside which a cart may drive; then 1.1 times 4 t without one
    ((True, False, True), {}, True),
    ((True, False, True), {"tank": 2000.0}, False),  # 4.0 + 4.4 t
    ((True, False, False, True), {"tank": 1000.0}, True),  # 3.0 + 8.8 t
    ((True, True, False, True), {}, False),  # the next one is soon enough
    ((False, True, False, True), {"tank": 1000.0}, True),  # 3 t, 7 t at the end of the second pass, 11.4 t
    ((False, True, True), {"tank": 3500.0}, True),  # 5.5 t, and full before the end of the second one
    ((False, True, False, True), {"tank": 8000.0}, False),  # full before: it stands, whoever is called
    ((True, False, False), {}, False),  # its last passes: at the end a cart comes anyway
    ((True, False, True), {"phase": "way", "tank": 1000.0}, True),  # 5.0 t at the end of the pass it turns to
    ((True, False, True), {"taken": 1, "left": 0.0, "phase": "stand", "tank": 6000.0}, False),
    ((True, False, True), {"tank": 10.0}, False),  # nothing to be poured yet
    ((True, False, True), {"mode": "standing"}, False),
])  # fmt: skip
def test_a_cart_is_needed_where_the_tank_would_be_full_in_passes_without_one(beside, more, is_called):
    assert is_needed_soon(*job_of(beside, **more)) is is_called


def test_combines_stand_less_where_every_other_pass_has_crop_on_its_left(monkeypatch):
    def stood(job):
        return sum(c.timeline.time(state) for c in job.combines for state in ("wait", "unload"))

    seen = finished(layout_file(3, 2))
    monkeypatch.setattr(engine, "is_needed_soon", lambda job, c: False)
    blind = finished(layout_file(3, 2))
    assert stood(seen) < 0.6 * stood(blind)
    assert seen.time < 0.95 * blind.time


def test_what_comes_is_known_as_far_as_no_other_one_decides_on_it():
    alone, echelon, lands = (
        finished(job_file(n, 1, team={"together": how})).passes
        for n, how in ((1, "own_lands"), (2, "echelon"), (2, "own_lands"))
    )
    for passes in (alone, echelon, lands):
        passes._row.extend([4, 5])
        passes._lands = {0: deque([7, 8]), 1: deque([9])}
        passes._own = {0: 1, 1: 0}
    assert alone.coming(alone._combines[0]) == [9, 7, 8]  # the land that it has begun, then the rest
    assert echelon.coming(echelon._combines[0]) == []
    assert lands.coming(lands._combines[1]) == [7, 8]
    lands._headland.append(0)
    assert lands.coming(lands._combines[1]) == []
