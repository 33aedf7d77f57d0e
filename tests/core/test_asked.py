"""Parameters that tell when they are read: every way of reading, on fields that are drawn."""

import pickle
from copy import deepcopy
from dataclasses import asdict, dataclass, field, fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swath.core.asked import ALL, PRESENT, Asked, asking, bare, gathered, replaced, telling

NAMES = ("a", "b", "c", "d")


@dataclass(frozen=True)
class Inner:
    x: float = 0.0
    y: float = 0.0


@dataclass(frozen=True)
class Params:
    a: float = 0.0
    b: str = "b"
    c: tuple[float, ...] = ()
    d: bool = False
    inner: Inner = field(default_factory=Inner)
    maybe: Inner | None = None
    several: tuple[Inner, ...] = ()


OTHER = {"a": 1.0, "b": "other", "c": (1.0,), "d": True}
some = st.sets(st.sampled_from(NAMES))


def unread(asked: Asked) -> set[str]:
    return {key.removeprefix("k.") for key, parts in asked.by.items() if not parts}


@given(changed=some, read=some)
def test_what_was_set_and_not_read_is_left(changed, read):
    asked = Asked()
    held = asked.watched(Params(**{name: OTHER[name] for name in changed}), "k")
    with asking("part"):
        assert all(
            getattr(held, name) == (OTHER if name in changed else asdict(Params()))[name] for name in read
        )
    assert unread(asked) == changed - read


@given(changed=some, read=some)
def test_who_asks_is_known_each_time_a_run_begins(changed, read):
    asked = Asked()
    held = asked.watched(Params(**{name: OTHER[name] for name in changed}), "k", NAMES)
    asked.begin()
    for part in ("one", "two"):
        with asking(part):
            [getattr(held, name) for name in read]
    assert asked.by == {f"k.{n}": {"one", "two"} if n in read else set() for n in sorted(changed)}
    asked.begin_again()
    assert unread(asked) == changed


def test_reads_of_nobody_do_not_count():
    asked, own = Asked(), Asked(is_of_parts=True)
    assert asked.watched(Params(a=1.0), "k").a == own.watched(Params(a=1.0), "k").a == 1.0
    assert (asked.by["k.a"], own.by["k.a"], PRESENT.part) == (set(), {ALL}, None)


def test_inside_of_others():
    asked = Asked(is_of_parts=True)
    held = asked.watched(Params(inner=Inner(x=1.0), maybe=Inner(), several=(Inner(y=2.0), Inner(x=3.0))), "k")
    assert set(asked.by) == {"k.inner.x", "k.maybe", "k.several.0.y", "k.several.1.x"}
    assert (held.inner.y, held.several[0].x, held.several[1].x) == (0.0, 0.0, 3.0)
    assert unread(asked) == {"inner.x", "maybe", "several.0.y"}


@pytest.mark.parametrize(
    "use",
    [vars, asdict, hash, repr, deepcopy, replace, pickle.dumps, lambda p: p == Params(**OTHER), fields],
    ids=["vars", "asdict", "hash", "repr", "deepcopy", "replace", "pickle", "equal", "fields"],
)
def test_is_like_the_plain_one_and_reads_of_all_of_it_count(use):
    plain, asked = Params(**OTHER), Asked(is_of_parts=True)
    held = asked.watched(plain, "k")
    assert isinstance(held, Params)
    assert held.__class__ is Params
    assert bare(held) == plain
    assert unread(asked) == set(NAMES)
    assert use(held) == use(plain)
    assert unread(asked) == (set(NAMES) if use is fields else set())
    assert held == plain


@given(changed=some, read=some)
def test_a_changed_copy_goes_on_telling(changed, read):
    asked = Asked(is_of_parts=True)
    held = replaced(asked.watched(Params(**OTHER), "k"), **{name: OTHER[name] for name in changed})
    assert [getattr(held, name) for name in read] == [OTHER[name] for name in read]
    assert unread(asked) == set(NAMES) - (read - changed)
    assert bare(held) == Params(**OTHER)


def test_what_is_made_tells_for_what_it_is_made_of():
    asked = Asked()
    held = asked.watched(Params(a=2.0, b="x"), "k", NAMES)
    made, tell = gathered(lambda: held.a * 2.0)
    later = telling(Inner(x=made), {"x": tell})
    with asking("part"):
        assert (later.y, unread(asked)) == (0.0, {"a", "b"})
        assert later.x == 4.0
    assert asked.by == {"k.a": {"part"}, "k.b": set()}
