"""Commands of swath as they are printed, to be typed."""

import shlex


def command(*words: object) -> str:
    """`swath` and words that a shell reads as they are: one with a blank stands in quotes."""
    return shlex.join(["swath", *map(str, words)])
