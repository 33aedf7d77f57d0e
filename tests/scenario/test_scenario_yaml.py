"""YAML with places: what is read, what is refused, what is written."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swath.core.errors import InputError
from swath.documents.yaml_document import dump, parse, read_document


def refusal(text):
    with pytest.raises(InputError) as caught:
        parse(text, "f.yaml")
    return str(caught.value)


def test_numbers_words_and_text():
    data = parse(
        "a: 1e3\nb: yes\nc: 2018-07-01\nd: 1:30\ne: ~\nf: 0x10\ng: .5\nh: 'true'\ni: True\nj: 08\nk:"
    ).data
    assert data == {
        "a": 1000.0, "b": "yes", "c": "2018-07-01", "d": "1:30", "e": None, "f": 16,
        "g": 0.5, "h": "true", "i": True, "j": 8, "k": None,
    }  # fmt: skip


def test_every_key_has_its_line():
    document = parse("a:\n  b:\n    - c: 1\n    - d: 2\n  e: {f: 3,\n    g: 4}\n", "f.yaml")
    lines = {
        path: document.place(path).line for path in [("a", "b", 1, "d"), ("a", "e", "g"), ("a", "e", "zz")]
    }
    assert lines == {("a", "b", 1, "d"): 4, ("a", "e", "g"): 6, ("a", "e", "zz"): 5}


def test_anchors_and_merges():
    document = parse("base: &b {x: 1, y: 2}\none: {<<: *b, y: 3}\ntwo: *b\n", "f.yaml")
    assert document.data["one"] == {"x": 1, "y": 3}
    assert document.data["two"] == {"x": 1, "y": 2}
    assert (document.place(("one", "x")).line, document.place(("one", "y")).line) == (1, 2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3", "a: written twice, first in line 1 (f.yaml:3)"),
        ("a:\n  b: 1\n  b: 1", "a.b: written twice, first in line 2 (f.yaml:3)"),
        ("a: [1, 2", "(f.yaml:1)"),
        ("a: 1\n\tb: 2", "(f.yaml:2)"),
        ("a: b: c", "mapping values are not allowed here, column 5 (f.yaml:1)"),
        ("a: *b", "found undefined alias"),
        ("a: 1\n---\nb: 2", "(f.yaml:2)"),
        ("a: &x [*x]", "nested deeper than 24"),
        ("[" * 5000, "nested deeper than 24"),
        ("a: .nan", "a = .nan: expected a finite number (f.yaml:1)"),
        ("a: .inf", "a = .inf: expected a finite number (f.yaml:1)"),
        ("a: 1e400", "a = 1e400: expected a finite number (f.yaml:1)"),
        ("a: 99999999999999999999", "expected a finite number (f.yaml:1)"),
        ("a: !!python/name:os.system x", "is not understood here (f.yaml:1)"),
        ("a: !mine {b: 1}", "the tag !mine is not understood here (f.yaml:1)"),
        ("? [1, 2]\n: 3", "expected a name before the colon (f.yaml:1)"),
        ('a: "\\ud800"', "expected text in Unicode (f.yaml:1)"),
        ("a: 1\nb: \x01", "a character that YAML does not allow (f.yaml:2)"),
        ("<<: 3", "expected `<<` to name a mapping"),
    ],
)
def test_refusals_are_one_line_with_a_place(text, message):
    said = refusal(text)
    assert message in said
    assert "\n" not in said


def test_exploding_aliases_are_refused():
    rows = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    rows += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    assert "more than 50000 values" in refusal("\n".join(rows))


def test_files_that_are_no_text(tmp_path):
    (tmp_path / "a.yaml").write_bytes(b"a: \xff\xfe")
    (tmp_path / "b.yaml").write_bytes(b"\xef\xbb\xbfa: 1")
    (tmp_path / "c.yaml").write_bytes(b"#" * (2 << 20))
    with pytest.raises(InputError, match="expected text in UTF-8"):
        read_document(tmp_path / "a.yaml")
    assert read_document(tmp_path / "b.yaml").data == {"a": 1}
    with pytest.raises(InputError, match="at most 1 MiB"):
        read_document(tmp_path / "c.yaml")
    with pytest.raises(InputError, match="expected a YAML file: Is a directory"):
        read_document(tmp_path)


TEXT = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Cn"]), max_size=12)
PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**62), 2**62)
    | st.floats(allow_nan=False, allow_infinity=False)
    | TEXT
    | st.sampled_from(["yes", "1e3", "0x10", ".nan", "~", "null", "<<", "=", "1:30", "- a", "# b", "08"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT.filter(bool), inner, max_size=4),
    max_leaves=12,
)


@given(st.dictionaries(TEXT.filter(bool), PLAIN, max_size=4))
def test_what_is_written_is_read_back(data):
    again = parse(dump(data)).data
    assert again == data
    assert math.isfinite(len(repr(again)))
