"""COCO: categories, masks as run lengths, and annotations (https://cocodataset.org, format of data).

Things (persons, vehicles ...) have an annotation each, with `iscrowd` 0; what cannot be counted (crop, soil
...) has one per picture, with `iscrowd` 1. Masks are run lengths in columns, as pycocotools packs them.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from swath.field.memory_layout import Organ
from swath.signals import U8, U16, Mask

THINGS = ("person", "animal", "vehicle", "machine", "tree", "hedge", "building", "post", "stone", "other")
STUFF = {
    "crop": (Organ.STEM, Organ.EAR, Organ.LEAF, Organ.AWN, Organ.BRANCH, Organ.POD, Organ.COB),
    "stubble": (Organ.STUBBLE,),
    "straw": (Organ.STRAW,),
    "soil": (Organ.GROUND,),
    "weed": (Organ.WEED,),
}
LEAST_AREA = 10  # a thing of which fewer pixels are seen has no annotation
NAMES = (*THINGS, *STUFF)
CATEGORIES = [
    {"id": k, "name": name, "supercategory": "thing" if name in THINGS else "stuff"}
    for k, name in enumerate(NAMES, start=1)
]


def category_of(kind: str) -> int:
    """Number of a kind of obstacle."""
    return NAMES.index(kind if kind in THINGS else "other") + 1


def category_map(label: U8, instance: U16, kinds: tuple[str, ...]) -> U8:
    """Category of every pixel, 0 = none (sky)."""
    table = np.zeros(len(Organ), np.uint8)
    for name, organs in STUFF.items():
        table[list(organs)] = NAMES.index(name) + 1
    things = np.array([0, *(category_of(kind) for kind in kinds)], np.uint8)
    return np.where(instance > 0, things[instance], table[label]).astype(np.uint8)


def annotations_of(
    instance: U16, categories: U8, kinds: tuple[str, ...], areas: Mapping[int, float]
) -> list[dict[str, Any]]:
    """One per thing, then one per kind of stuff; without `id` and `image_id`.

    areas: pixels that show the things by number, in parts: `share_area`
    """
    numbers = np.flatnonzero(np.bincount(instance.ravel())[1:] >= LEAST_AREA) + 1
    found = [
        {**_annotation(instance == n, category_of(kinds[n - 1]), 0), "instance": n, "share_area": areas[n]}
        for n in numbers.tolist()
    ]
    for name in STUFF:
        mask = categories == NAMES.index(name) + 1
        if mask.any():
            found.append(_annotation(mask, NAMES.index(name) + 1, 1))
    return found


def _annotation(mask: Mask, category: int, is_crowd: int) -> dict[str, Any]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    left, top = int(columns[0]), int(rows[0])
    return {
        "category_id": category,
        "iscrowd": is_crowd,
        "area": int(mask.sum()),
        "bbox": [left, top, int(columns[-1]) - left + 1, int(rows[-1]) - top + 1],
        "segmentation": {"size": [*mask.shape], "counts": packed(run_lengths(mask))},
    }


def run_lengths(mask: Mask) -> list[int]:
    """Lengths of runs of 0 and 1 in turn along the columns, the first of 0."""
    flat = mask.ravel(order="F").astype(np.int8)
    changes = np.flatnonzero(np.diff(flat)) + 1
    ends = np.concatenate([[0], changes, [len(flat)]])
    lengths: list[int] = np.diff(ends).tolist()
    return [0, *lengths] if flat[0] else lengths


def packed(lengths: Iterable[int]) -> str:
    """Run lengths as text: from the fourth on less the one two before, five bits a letter from `0` on, the
    sixth bit: more to come (rleToString of pycocotools).
    """
    values, letters = list(lengths), []
    for k, value in enumerate(values):
        x = value - values[k - 2] if k > 2 else value
        more = True
        while more:
            part = x & 0x1F
            x >>= 5
            more = not (x == -1 if part & 0x10 else x == 0)
            letters.append(chr(48 + (part | 0x20 if more else part)))
    return "".join(letters)


def unpacked(text: str) -> list[int]:
    """The run lengths in a text of `packed`."""
    values: list[int] = []
    at = 0
    while at < len(text):
        x = shift = 0
        more = True
        while more:
            letter = ord(text[at]) - 48
            at += 1
            x |= (letter & 0x1F) << shift
            shift += 5
            more = bool(letter & 0x20)
        if letter & 0x10:
            x |= -1 << shift
        values.append(x + values[-2] if len(values) > 2 else x)
    return values


def is_annotation(data: Any, height: int, width: int) -> bool:
    """Whether data is an annotation, as `annotations_of` makes them, of a picture of so many pixels. Data of
    another form may raise anything.
    """
    sizes = unpacked(data["segmentation"]["counts"])
    is_mask = data["segmentation"]["size"] == [height, width] and min(sizes) >= 0
    is_box = len(data["bbox"]) == 4 and all(0 <= number <= max(height, width) for number in data["bbox"])
    is_named = data["category_id"] in range(1, len(NAMES) + 1) and data["iscrowd"] in (0, 1)
    return is_mask and sum(sizes) == height * width and is_box and is_named


def mask_of(segmentation: dict[str, Any]) -> Mask:
    """The mask (height, width) of run lengths."""
    lengths = unpacked(segmentation["counts"])
    flat = np.repeat(np.arange(len(lengths)) % 2 == 1, lengths)
    return flat.reshape(segmentation["size"], order="F")
