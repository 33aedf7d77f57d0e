"""A field that was worked on and reset is bit for bit the field at the start, and works the same again."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.field.paging.pages import SLOT_POOLS
from swath.field.site_setup import Bodies
from swath.field.solid.solids import post
from tests.field.made_field import made_field, rectangle


def work(field):
    """Cut, lay straw over borders of pages and pour grain; what came out of it."""
    cuts = [field.cut(rectangle(0.0, 3.0 * n, 5.0, 3.0 * n + 3.4), 0.12) for n in range(12)]
    for n in range(12):
        field.deposit_straw(rectangle(1.0, 3.0 * n, 2.4, 3.0 * n + 3.0), 2.0 + 0.1 * n, heading=np.pi / 2)
        field.deposit_grain(-3.0, 0.4 * n, 5.0)
    return cuts, field.straw_kg, field.ground_grain_kg, field.recount()


def shown(field, key):
    """Everything that rays read of a page, by name."""
    p, slot = field.pages, field.store.keys[key]
    page = {name: getattr(p, name)[slot].copy() for name in SLOT_POOLS if name != "cut_slot"}
    codes = np.broadcast_to(field.store.codes_of(key), (512, 512))
    return page | {"codes": codes.copy(), "code_max": field.store.code_max[slot].copy()}


@pytest.mark.parametrize("page_limit", [1024, 6])
def test_a_reset_field_is_a_fresh_one(page_limit):
    field, fresh = (made_field(page_limit=page_limit) for _ in range(2))
    places = [(i, j) for i in range(-4, 4) for j in range(-4, 4)]
    if page_limit > len(places):
        field.store.need(places)
    first = work(field)
    assert field.recount().stem_count > 0
    assert first[1:3] == (pytest.approx(12 * 2.0 + 6.6), pytest.approx(60.0))
    here, recut = set(field.store.keys), set(field.store.recut)
    field.reset()
    made, make = set(), field.store.make
    field.store.make = lambda keys: made.update(keys) or make(keys)
    assert (field.straw_kg, field.ground_grain_kg, field.recount().stem_count) == (0.0, 0.0, 0)
    assert field.save()["keys"].size == 0
    for one in (field, fresh):
        one.store.need(places)
    assert made == set(places) - (here - recut)  # what was not cut is not made again
    for key in places:
        after, at_start = shown(field, key), shown(fresh, key)
        for name in at_start:
            assert np.array_equal(after[name], at_start[name]), (key, name)
    assert work(field) == first == work(fresh)


def test_grain_on_the_ground_is_counted_saved_and_loaded():
    field = made_field()
    rng = np.random.Generator(np.random.Philox(2))
    mass = rng.uniform(0.0, 3.0, 5000)
    for x, y, m in zip(rng.normal(0, 4, 5000), rng.normal(0, 4, 5000), mass, strict=True):
        field.deposit_grain(x, y, m)
    assert field.ground_grain_kg == pytest.approx(mass.sum(), rel=1e-13)
    assert sum(m for _, _, m in field.grain.piles()) == pytest.approx(mass.sum(), rel=1e-13)
    other = made_field()
    other.load(field.save())
    assert other.ground_grain_kg == field.ground_grain_kg
    field.deposit_grain(100.2, -7.3, 4.0)
    assert field.grain.piles()[-1] == (100.25, -7.25, 4.0)
    for bad in ((0.0, 0.0, -1.0), (0.0, 0.0, np.nan), (np.nan, 0.0, 1.0), (1e9, 0.0, 1.0)):
        with pytest.raises(InputError, match="expected"):
            field.deposit_grain(*bad)


def test_bodies_go_back_to_where_they_started():
    bodies = Bodies()
    bodies.add("combine", post([0, 0, 0], 2.0, 0.1), Pose.from_euler((1.0, 2.0, 0.0)))
    bodies.place("combine", Pose.from_euler((50.0, 2.0, 0.0), yaw=1.0))
    bodies.reset()
    assert bodies.others("").capsule_a == pytest.approx(np.array([[1.0, 2.0, 0.0]]))


def test_kept_pages_are_not_made_again():
    field = made_field()
    field.keep_pages()
    first = work(field)
    made, field.maker.make = field.maker.make, None  # whoever asks for a page anew fails
    field.reset()
    again = work(field)
    assert made is not None
    assert again[1:] == first[1:]
    assert again[0] == first[0]
