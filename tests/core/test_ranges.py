"""Every numeric field of every signal has a range: what lies in it is taken, what lies outside is refused."""

from dataclasses import replace
from random import Random

import numpy as np
import pytest
from docs.make.signals import bundled_signals

from swath.core.checked import CheckedOutput
from swath.core.component import Port
from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.layout import layout
from swath.core.signal import span_of
from swath.signals.flat import build, flat_fields
from swath.signals.radar import RadarTargets
from swath.signals.scan import Scan

FIELDS = [
    (signal, name)
    for signal in bundled_signals()
    for name, field in layout(signal).items()
    if field.kind != "bool"
]
RANGES = {(signal, name): span_of(name, layout(signal)[name].quantity) for signal, name in FIELDS}
RECEIVED = [(Scan, "intensity"), (RadarTargets, "rcs"), (RadarTargets, "snr")]
DRAWN = 3  # inside and outside, of each field


def test_every_field_has_a_range():
    """A signal without numbers, or a field that nobody thought of, would be an empty proof."""
    without = [f"{s.__name__}.{name}" for (s, name), ends in RANGES.items() if not np.isfinite(ends).all()]
    print(f"{len({s for s, _ in FIELDS})} signals, {len(FIELDS)} fields, {len(without)} without a range")
    assert without == []
    assert all(low < high for low, high in RANGES.values())
    assert len(FIELDS) > 250


def sample(signal):
    """One with the middle of each range."""
    values = {}
    for name, field in flat_fields(signal).items():
        low, high = span_of(name, field.quantity)
        middle = 0.0 if not np.isfinite(low + high) or low <= 0.0 <= high else 0.5 * (low + high)
        size = int(np.prod([d if isinstance(d, int) else 2 for d in field.quantity.shape]))
        values[name] = {"array": np.full(size, middle), "bool": False, "int": min(2, high)}.get(
            field.kind, middle
        )
    return build(signal, 0, values)


def with_value(right, name, value):
    """A sample with this number in a field; in one place of an array, beside right ones."""
    was = getattr(right, name)
    if isinstance(was, Pose):
        return replace(right, **{name: Pose(np.array([value, 0.0, 0.0]), was.rotation)})
    if isinstance(was, np.ndarray):
        made = was.astype(np.int64 if was.dtype.kind == "u" else was.dtype)
        made.flat[-1] = value
        return replace(right, **{name: made})
    return replace(right, **{name: value})


@pytest.mark.parametrize(("signal", "name"), RECEIVED)
def test_received_power_is_taken_as_a_device_counts_it(signal, name):
    """Shares, raw counts of 8 to 16 bits, decibels, -1 of a driver for "not measured"."""
    check = CheckedOutput("m.slot", "my.py:Mine", (Port("sent", signal),))
    for raw in (-1.0, 0.0, 0.5, 255.0, 65_535.0, *(Random(name).uniform(-120.0, 60.0) for _ in range(DRAWN))):
        assert check.pass_on(0, {"sent": with_value(sample(signal), name, raw)})
    for wrong in (-np.inf, np.inf):
        with pytest.raises(InputError, match=rf"m\.slot\.sent\.{name} = "):
            check.pass_on(0, {"sent": with_value(sample(signal), name, wrong)})


@pytest.mark.parametrize("signal", bundled_signals(), ids=lambda signal: signal.__name__)
def test_in_range_is_taken_outside_is_refused(signal):
    rng, check = Random(signal.__name__), CheckedOutput("m.slot", "my.py:Mine", (Port("sent", signal),))
    right = sample(signal)
    assert check.pass_on(0, {"sent": right})
    for name in (name for kind, name in FIELDS if kind is signal):
        (low, high), number = RANGES[signal, name], layout(signal)[name].number
        is_whole = number.kind in "iu"
        far = max(high - low, 1.0)
        inside = [low, high, *(rng.uniform(low, high) for _ in range(DRAWN))]
        outside = [*(low - rng.uniform(0.01, 9.0) * far for _ in range(DRAWN)),
                   *(high + rng.uniform(0.01, 9.0) * far for _ in range(DRAWN)), float("inf")]  # fmt: skip
        if is_whole:
            inside = [round(v) for v in inside]
            outside = [int(np.floor(v)) if v < low else int(np.ceil(v)) for v in outside[:-1]]
        ends = np.float32 if number == np.float32 else type(inside[0])
        for value in inside:
            assert check.pass_on(0, {"sent": with_value(right, name, ends(value))})
        for value in outside:
            with pytest.raises(InputError) as found:
                check.pass_on(0, {"sent": with_value(right, name, value)})
            text = str(found.value)
            assert f"m.slot.sent.{name} = " in text
            assert "my.py:Mine" in text
            assert f"expected a{'n array' * isinstance(getattr(right, name), np.ndarray)}" in text
            assert f"from {low:g} to {high:g}" in text
