"""No package grows by more than a twentieth unseen."""

import pytest

from tests.house.package_sizes import lines_of, reviewed, sizes

GROWS = 1.05
FREE = 20  # lines: what a small package may grow by


def test_no_package_grows_unseen():
    known = reviewed()
    grown = [
        f"{package}: {lines} lines, {known.get(package, 0)} reviewed"
        for package, lines in sizes().items()
        if lines > max(known.get(package, 0) * GROWS, known.get(package, 0) + FREE)
    ]
    assert not grown, f"{'; '.join(grown)}. Worth it? `python -m tests.house.package_sizes --write` says yes"


def test_what_is_reviewed_is_there():
    assert reviewed().keys() <= sizes().keys()


@pytest.mark.parametrize(
    ("suffix", "text", "lines"),
    [
        (".py", '"""Doc.\n\nMore."""\n\n# own line\nX = 1  # beside\n"""Of X."""\nY = """a\n\nb"""\n', 3),
        (".py", 'def f():\n    """Doc."""\n    return (\n        1\n    )\n', 4),
        (".cpp", "// a\n/* b\n   c */\nint x; // d\n\nint y; /* e */\n", 2),
        (".js", "/** a\n * b */\nconst x = 1;\n", 1),
        (".css", "/* a */\na { b: c }\n", 1),
        (".j2", "{# a\nb #}\n<p>{# c #}</p>\n<!-- d -->\n", 1),
        (".yaml", "a: 1\n", 0),
    ],
)
def test_lines_that_count(suffix, text, lines):
    assert lines_of(text, suffix) == lines
