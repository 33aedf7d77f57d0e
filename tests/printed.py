"""What a command prints, looked at as a reader does: words, columns, lines."""

import re

from swath.terminal import tables


def run_of(whole, words):
    """The pieces that a word was broken into: as long ones as there are, each behind a dot, `/` or `,`."""
    pieces, made = tables.INSIDE.split(whole), []
    while pieces:
        ends = [n for n in range(len(pieces), 0, -1) if "".join(pieces[:n]) in words] or [len(pieces)]
        made.append("".join(pieces[: ends[0]]))
        pieces = pieces[ends[0] :]
    return made


def words_of(lines):
    """All words of lines, and what stands in the cells of their tables."""
    parts = [part for line in lines for part in re.split(r" {2,}", line.strip())]
    return {w for part in parts for w in (part, *tables.BLANK.split(part))}


def are_whole(lines, columns, printed):
    """Fails where a word of a table is broken, or a line is too long that is more than one word.
    printed: heads and rows of the tables.
    """
    words = words_of(lines)
    for heads, rows in printed:
        for text in (str(text) for row in (heads, *rows) for text in row):
            for whole in tables.BLANK.split(text.strip()):
                assert whole in words or all(p in words for p in run_of(whole, words)), whole
    wide = [line for line in lines if len(line) > columns and " " in line]  # a path alone may be
    assert not printed or not wide
