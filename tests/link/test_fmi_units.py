"""Units of FMU variables against the definitions of the SI, and what is refused."""

from math import isclose, pi

import pytest

from swath.core.errors import InputError
from swath.core.signal import signal_types
from swath.link.fmi.units import Unit, parse_unit, scale
from swath.signals.flat import flat_fields


@pytest.mark.parametrize(
    ("theirs", "ours", "factor"),
    [
        ("km/h", "m/s", 1 / 3.6),
        ("t/h", "kg/s", 1000 / 3600),
        ("kg.m/s2", "N", 1.0),
        ("kg m s^-2", "N", 1.0),
        ("kW", "W", 1000.0),
        ("rpm", "rad/s", 2 * pi / 60),
        ("deg", "rad", pi / 180),
        ("1/km", "1/m", 1e-3),
        ("g/h", "kg/s", 1e-3 / 3600),
        ("ha", "m2", 1e4),
        ("mm", "m", 1e-3),
        ("min", "s", 60.0),
        ("l/s", "m3/s", 1e-3),
        ("%", "", 0.01),
        ("-", "", 1.0),
    ],
)
def test_factors(theirs, ours, factor):
    found = scale(parse_unit(theirs), parse_unit(ours))
    assert found is not None
    assert isclose(found.ours(1.0), factor, rel_tol=1e-12)
    assert isclose(found.theirs(found.ours(3.25)), 3.25, rel_tol=1e-12)


def test_offset_of_a_temperature():
    found = scale(parse_unit("degC"), parse_unit("K"))
    assert found.ours(20.0) == pytest.approx(293.15)
    assert found.theirs(273.15) == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("a", "b"), [("kg", "kg/s"), ("m", "m2"), ("1/s", "rad/s"), ("Hz", "rad/s"), ("N", "W")]
)
def test_different_quantities(a, b):
    assert scale(parse_unit(a), parse_unit(b)) is None


def test_a_plain_number_may_stand_for_an_angle():
    assert scale(Unit(""), parse_unit("rad")).is_same


@pytest.mark.parametrize("text", ["stems", "km/", "kg//s", "m^x", "furlong/s"])
def test_unknown_units(text):
    if text in ("km/", "kg//s"):
        parse_unit(text)  # an empty part means nothing
        return
    with pytest.raises(InputError, match="expected a unit such as"):
        parse_unit(text)


def test_every_unit_of_every_signal_is_known():
    for signal in signal_types():
        for field in flat_fields(signal).values():
            assert parse_unit(field.unit).factor == 1.0, (signal, field)
