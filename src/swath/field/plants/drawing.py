"""What is wanted of plants that are drawn."""

from dataclasses import dataclass
from typing import Literal

Detail = Literal["full", "reduced"]  # of the plants that rays meet


@dataclass(frozen=True)
class Drawing:
    """leaves; ears: with what carries the grain (ears, pods, cobs); upright: stalks and ears vertical (for
    closed-form checks). fruit_only: no more of all that than heights and masses of stems and heights of
    ears need; stalk_parts: capsules per stalk, twice as many where branches hang on it; leaf_parts: ribbons
    per leaf, maize has one more; they change no random number of those.
    """

    leaves: bool = True
    ears: bool = True
    upright: bool = False
    fruit_only: bool = False
    stalk_parts: int = 2
    leaf_parts: int = 3
