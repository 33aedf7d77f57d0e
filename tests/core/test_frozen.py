"""Quick frozen dataclasses do all that plain ones do."""

import copy
import pickle
from dataclasses import FrozenInstanceError, asdict, field, fields, replace

import pytest

from swath.core.frozen import changed, frozen
from swath.signals import MachineLoad, SpeedCommand


@frozen
class Base:
    t: int


@frozen
class Point(Base):
    x: float
    y: float = 2.0


def test_makes_compares_and_copies():
    a = Point(1, 3.0)
    assert (a.t, a.x, a.y) == (1, 3.0, 2.0)
    assert a == Point(t=1, x=3.0, y=2.0)
    assert hash(a) == hash(Point(1, 3.0))
    assert repr(a) == "Point(t=1, x=3.0, y=2.0)"
    assert replace(a, x=4.0) == Point(1, 4.0)
    assert asdict(a) == {"t": 1, "x": 3.0, "y": 2.0}
    assert [f.name for f in fields(Point)] == ["t", "x", "y"]
    assert pickle.loads(pickle.dumps(a)) == copy.copy(a) == a


def test_cannot_be_changed_or_made_wrongly():
    with pytest.raises(FrozenInstanceError):
        Point(1, 3.0).x = 4.0
    for wrong in ((), (1,), (1, 2, 3, 4)):
        with pytest.raises(TypeError):
            Point(*wrong)
    with pytest.raises(TypeError, match="z"):
        Point(1, 2.0, z=3.0)


def test_changed_is_replace_and_refuses_other_names():
    a = Point(1, 3.0)
    b = changed(a, x=4.0, t=2)
    assert (type(b), b, a) == (Point, replace(a, x=4.0, t=2), Point(1, 3.0))
    with pytest.raises(TypeError, match="z"):
        changed(a, z=3.0)
    a.__dict__["length"] = 5.0  # as a cached property that x = 4.0 would make wrong
    with pytest.raises(TypeError, match="Point"):
        changed(a, x=4.0)


def test_samples_are_such():
    assert MachineLoad(0, *[0.0] * 7).tank_level == 0.0
    with pytest.raises(FrozenInstanceError):
        SpeedCommand(0, 1.0).speed = 2.0


def test_what_it_cannot_do_is_refused():
    with pytest.raises(TypeError, match="plain"):

        @frozen
        class Made:
            items: list = field(default_factory=list)

    with pytest.raises(TypeError, match="plain"):

        @frozen
        class Checked:
            x: float

            def __post_init__(self):
                pass
