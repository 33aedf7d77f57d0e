"""Definitions of ROS messages: rosbags makes code of them, so names are names and constants are constants."""

import pytest

from swath.record.read.definitions import definitions_of, types_of_idl, types_of_msg

GOOD = """module a { module msg {
module Scan_Constants { const uint8 FIRST = 1; const int32 LESS = -2; const string TEXT = "a (b (c)) << d"; };
// remark (with (brackets))
/* one more << ( ( */
@verbatim (language="comment", text="what (it (is))")
struct Scan { @unit (value="m") double range; sequence<sequence<float>> rows; long twice[2]; };
}; };"""


def idl(constant):
    inside = f"module B_Constants {{ const long X = {constant}; }}; struct B {{ long a; }};"
    return f"module a {{ module msg {{ {inside} }}; }};"


def test_honest_idl_is_read():
    types = types_of_idl(GOOD)
    constants, fields = types["a/msg/Scan"]
    assert [(name, value) for name, _, value in constants] == [
        ("FIRST", 1),
        ("LESS", -2),
        ("TEXT", "a (b (c)) << d"),
    ]
    assert [name for name, _ in fields] == ["range", "rows", "twice"]


@pytest.mark.parametrize("constant", [
    "(" * 24 + "1" + ")" * 24, "1 << (1 << 35)", "1 << 99999999", "((1))", "1 <<\n 2",
    "((" * 9 + "1" + "))" * 9,
])  # fmt: skip
def test_expressions_are_refused_at_once(constant):
    with pytest.raises(ValueError, match=r"bracket|expression"):
        types_of_idl(idl(constant))


@pytest.mark.parametrize("text", [
    "int32 __init__", "int32 _x", "int32 X__class__\\nint32 __getattr__", "int32 a\\nint32 __X=1",
    "int32 a-b", "int32 é", 'int32 a"""', "int32 x\\nint32 eval(1)=3", "int32 a;import os",
])  # fmt: skip
def test_odd_names_are_no_definition(text):
    with pytest.raises(Exception):  # noqa: B017 - those of rosbags are of their own
        types_of_msg(text.replace("\\n", "\n"), "a/msg/B")


@pytest.mark.parametrize(
    "value", ["__import__('os').system('touch ACTED')", "''' + open('ACTED','w').name + '''", "\\'"]
)
def test_texts_of_constants_are_texts(value, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    from rosbags.typesys import Stores, TypesysError, get_typestore

    try:
        found = definitions_of(f"string X={value}\nint32 a".encode(), "a/msg/B")
    except TypesysError:
        return
    store = get_typestore(Stores.EMPTY)
    store.register(found.types)
    assert store.types["a/msg/B"].X.strip("'") == value.strip("'")
    assert not [*tmp_path.iterdir()]
