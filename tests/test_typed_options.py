"""Numbers as people type them: read as they are meant or refused in one line, never another number."""

import random
import re
from fractions import Fraction

import pytest

from swath.commands.main import UsageError, main, make_parser, subcommands
from swath.core.errors import InputError
from swath.core.typed_numbers import number_form, number_in, numbers_in, range_in, unit_of
from swath.core.units import UNITS
from swath.documents.validation import checked
from swath.documents.yaml_document import parse
from swath.tools.function_test.case import Varied
from swath.tools.tune.parameters import Parameter, read_parameter

DRAWS = 300
MARKS = ("'", "’", " ", "\u00a0", ",")
FULL = str.maketrans("0123456789", "０１２３４５６７８９")


def _grouped(whole, mark):
    return f"{whole:,}".replace(",", mark)


def drawn(rng, unit):
    """A text, what it means (None: nothing unique), and whether it has to be read."""
    value = Fraction(rng.randrange(1, 4000), rng.choice((1, 4, 100)))
    number, whole = f"{float(value):.12g}", rng.randrange(1000, 10**7)
    same = [u for u in UNITS.values() if u.kind == UNITS[unit].kind and u.factor != UNITS[unit].factor]
    other = rng.choice([u for u in UNITS.values() if u.kind not in (UNITS[unit].kind, "ratio")])
    forms = [
        (number, value, True),
        (f"+{number}", value, True),
        (f" {number} ", value, True),
        (f"−{number}", -value, True),
        (number.translate(FULL), value, True),
        (f"{number}e2", value * 100, True),
        (f"{number}E-1", value / 10, False),
        (f"00{number}", value, True),
        (f"{whole:_}", Fraction(whole), True),
        (f"{number}.", None, False),
        (number.replace(".", ","), value if "." not in number else None, "." not in number),
        *((_grouped(whole, mark), None, False) for mark in MARKS),
        (f"{_grouped(whole, '.')},5", None, False),
        (f"{_grouped(whole, ',')}.5", None, False),
        (f"–{number}", None, False),
        ("inf", None, False),
        ("nan", None, False),
        ("1e999", None, False),
        (f"1/{whole}", None, False),
        (hex(whole), None, False),
        (f"{number}..{whole}", None, False),
        (f"{number}-{whole}", None, False),
        (f"[{number}]", None, False),
        (f"~{number}", None, False),
        (f"{number} {other.symbol}", None, False),
        (f"{number}qq", None, False),
        ("", None, False),
    ]
    if unit:
        forms += [
            (
                f"{number}{' ' * UNITS[unit].symbol[0].isdigit()}{UNITS[unit].symbol}",
                value,
                unit != "fraction",
            )
        ]
        forms += [
            (f"{number} {u.symbol}", value * Fraction(u.factor) / Fraction(UNITS[unit].factor), True)
            for u in same
            if u.symbol[0].isalpha() and " " not in u.symbol
        ][:3]
    return rng.choice(forms)


def numeric_options():
    for parser in subcommands(make_parser()[0]):
        for action in parser._actions:
            if action.type in (int, float) and action.option_strings:
                yield parser, action


def test_drawn_forms_of_all_numeric_options():
    rng, options = random.Random(86), list(numeric_options())
    assert len(options) > 90
    for count in range(DRAWS):
        parser, action = options[count % len(options)]
        unit, is_whole = vars(action).get("unit") or unit_of(action.dest), action.type is int
        text, meant, is_read = drawn(rng, unit)
        try:
            found = parser._get_value(action, text)
        except Exception as error:
            said = str(error)
            assert "\n" not in said
            assert f"expected a{' whole' * is_whole} number, not {text!r}" in said
            assert not is_read or (is_whole and meant.denominator != 1), (action.dest, text, said)
            continue
        if meant is None:
            assert text.endswith(".")
            meant = Fraction(text[:-1]) if text.count(".") == 1 else None
        assert found == pytest.approx(float(meant), rel=1e-11), (action.dest, text)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("5 %", "percent", 5.0),
        ("5%", "fraction", 0.05),
        ("10 km/h", "kmh", 10.0),
        ("10 km / h", "kmh", 10.0),
        ("10 m/s", "kmh", 36.0),
        ("12ft", "m", 3.6576),
        ("12 FT", "m", 3.6576),
        ("2min", "s", 120.0),
        ("45°", "deg", 45.0),
        ("300 1/m²", "per_m2", 300.0),
        ("5 kn", "kmh", 9.26),
        ("5 kn", "kn", 5.0),
        (".5", "", 0.5),
        ("5.", "", 5.0),
        ("010", "", 10.0),
        ("1_000.5", "", 1000.5),
        ("٥", "", 5.0),
    ],
)
def test_what_is_read(text, unit, value):
    assert number_in(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "unit", "meant"),
    [
        ("2,5", "m", "2.5"),
        ("2,5 m", "m", "2.5 m"),
        ("1,000", "", "1.000 or 1000"),
        ("1.000,5", "", "1000.5"),
        ("1,000.5", "", "1000.5"),
        ("1'000", "", "1000"),
        ("1 000", "", "1000"),
        ("1/4", "", "0.25"),
        ("0x10", "", "16"),
        ("–5", "", "-5"),
        ("5 %", "", ""),
        ("5²", "", ""),
        ("½", "", ""),
        ("1_5", "", ""),
        ("5m m", "m", ""),
        ("5 m", "s", "m is a unit of length, not of time"),
        ("inf", "", "must be finite"),
        ("1e999", "", "too large"),
        ("1e-999", "", "too small"),
        ("1:30", "", ""),
        ("9" * 5000, "", ""),
        ("1" + " " * 5000 + "m", "m", ""),
        ("(" * 200, "", ""),
    ],
)
def test_what_is_refused_with_what_was_meant(text, unit, meant):
    with pytest.raises(ValueError, match=re.escape(meant) if meant else r"^$"):
        number_in(text, unit)


@pytest.mark.parametrize("text", ["2.5", "1.0e-3", "7_5", "1e16"])
def test_a_whole_number_is_whole(text):
    with pytest.raises(ValueError, match=r"^$"):
        number_in(text, is_whole=True)


def test_whole_numbers_are_exact():
    assert number_in(str((1 << 63) - 1), is_whole=True) == (1 << 63) - 1
    assert number_in("1e3", is_whole=True) == 1000
    assert isinstance(number_in("5.0", is_whole=True), int)


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("2..8", 2, 8),
        ("-2..-1", -2, -1),
        (".5..1.", 0.5, 1),
        (" 2 .. 8 ", 2, 8),
        ("1e2..1e3", 100, 1000),
        ("1m..2m", 1, 2),
        ("1ft..1 m", 0.3048, 1),
        ("1..2m", 1, 2),
    ],
)
def test_ranges(text, low, high):
    assert range_in(text, "m") == (low, high)


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("0...8", "did you mean 0..8"),
        ("0.5...8", "did you mean 0.5..8"),
        ("2-8", "did you mean 2..8"),
        ("2–8", "did you mean 2..8"),
        ("0…8", "did you mean 0..8"),
        ("2 to 8", "did you mean 2..8"),
        ("0:8:2", "did you mean 0..8"),
        ("0..8..2", "did you mean 0..8"),
        ("[0,8]", "did you mean 0..8"),
        ("8-2", "did you mean 2..8"),
        ("2,5..8,5", "did you mean 2.5..8.5"),
        ("8..0", "lower end first: 0..8"),
        ("2..2", "lower end first"),
        ("0..inf", "finite"),
        ("nan..2", "finite"),
        ("..5", ""),
        ("5..", ""),
        ("0..8 km/h", "is km/h the unit of both ends"),
        ("0m/s..8m", "m is a unit of length"),
        ("a..b", ""),
    ],
)
def test_ranges_that_are_none(text, meant):
    with pytest.raises(InputError) as found:
        read_parameter(f"combine.speed.speed_m_s={text}")
    said = str(found.value)
    assert meant in said
    assert "expected" in said
    assert "\n" not in said


def test_choices_stay_choices():
    assert read_parameter("k=2,5") == Parameter("k", choices=(2, 5))
    assert read_parameter("k=2.5,otsu").choices == (2.5, "otsu")
    assert read_parameter("k=../a.py:A,../b.py:B").choices == ("../a.py:A", "../b.py:B")
    assert read_parameter("k='1_000',5m.yaml,3d,on").choices == ("1_000", "5m.yaml", "3d", "on")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1_000,2", "written 1000"),
        ("12ft,15ft", "written 3.6576"),
        ("2,1'000", "did you mean 1000"),
        ("inf,2", "finite"),
    ],
)
def test_choices_that_yaml_takes_for_text_are_refused(text, said):
    with pytest.raises(InputError, match=said):
        read_parameter(f"combine.lidar.mount.z_m={text}")


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("25 m", ", without the unit"),
        ("25", ", without quotes"),
        ("12ft", ", written 3.6576"),
        ("2,5", "; did you mean 2.5?"),
        ("1_000", ", written 1000"),
        ("３", ", written 3"),
        ("5 kg", "; kg is a unit of mass, not of length"),
        ("far", ""),
        (True, ""),
    ],
)
def test_what_a_document_says_of_text_in_the_place_of_a_number(value, said):
    assert number_form("height_m", value) == f"expected a number in m{said}"


def test_lists_of_numbers():
    assert numbers_in("--origin", "-33.9, 18.4", ("deg", "deg", "m"), "lat,lon", least=2) == [-33.9, 18.4]
    assert numbers_in("--antenna", "1ft,0,2 m", ("m",) * 3, "x,y,z") == [0.3048, 0.0, 2.0]
    for text in ("1;2;3", "1,5,0,3", "1,2", "1,2,inf", "1,2,5 s", "1,2,"):
        with pytest.raises(InputError, match="expected three numbers x,y,z"):
            numbers_in("--antenna", text, ("m",) * 3, "x,y,z")


def test_what_begins_with_a_minus_and_a_digit_is_a_value():
    parser = make_parser("height-map")[0]
    line = ["height-map", "build", "run", "--out", "x.npz"]
    assert parser.parse_args([*line, "--origin", "-33.9,18.4"]).origin == "-33.9,18.4"
    assert parser.parse_args([*line, "--cell-m", "-1e3"]).cell_m == -1000.0
    with pytest.raises(UsageError, match="expected one argument"):
        parser.parse_args([*line, "--cell-m", "-x"])


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("12mph", "written 19.312128"),
        ("1:30", "expected a number in km/h"),
        ("1_0", "expected a number"),
        ("5,5", "did you mean 5.5"),
        ("~", "expected a number"),
        ("on", "expected a number"),
    ],
)
def test_set_takes_a_number_for_a_number_alone(value, said, capsys):
    assert main(["run", "straight", "--set", f"combine.speed.speed_kmh={value}"]) == 2
    assert said in capsys.readouterr().err


def test_an_option_of_a_bus_that_looks_like_a_number_is_one():
    from types import SimpleNamespace

    from swath.link.can.command import _where
    from swath.link.can.steering import Params

    args = SimpleNamespace(interface="virtual", channel="x", option=["bitrate=500_000"])
    with pytest.raises(InputError, match="--option bitrate = 500_000: expected a number, written 500000"):
        _where(args, Params().where)
    args.option = ["bitrate=500000"]
    assert dict(_where(args, Params().where).options)["bitrate"] == 500000


@pytest.mark.parametrize(
    ("text", "said"), [("0..8", ", written [0, 8]"), ("2-8", ", written [2, 8]"), ("a..b", "")]
)
def test_a_range_in_a_document_is_a_list(text, said):
    document = parse(f"key: combine.speed.speed_kmh\nrange: {text}")
    with pytest.raises(InputError) as found:
        checked(Varied, document)
    assert f"range = {text}: expected a list{said}" in str(found.value)
