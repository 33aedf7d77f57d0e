"""The compiled recount of a field against stems counted one by one in Python, to the last bit."""

from math import floor, fsum, sqrt

import numpy as np
import pytest

from swath.field.edges.edge import StraightEdge, TeethParams
from swath.field.memory_layout import MIRROR_X, MIRROR_Y, STANDING
from swath.field.stand import uniform
from tests.field.made_field import CROP, made_field, rectangle


def taken(library, stem, stand, length, code):
    """Grain, straw, grain left and stubble of a stem whose cell has a code [kg]."""
    if code == STANDING:
        return 0.0, 0.0, 0.0, 0.0
    height = 0.01 * code
    above = min(max(1.0 - height / (float(library.stem_height[stem]) * stand[0]), 0.0), 1.0)
    whole = float(library.straw_kg[stem]) * length
    straw = whole * above**CROP.yields.straw_exponent
    grain = float(library.grain_kg[stem])
    is_high = float(library.ear_height[stem]) * stand[0] > height
    return (grain, straw, 0.0, whole - straw) if is_high else (0.0, straw, grain, whole - straw)


def counted(field, before):
    """(grain, straw, grain left, stubble, stems of the crop) gone since. before: codes (512, 512) of pages"""
    library, sums, stems = field.library, [[], [], [], []], 0
    size = library.tile_size
    for key, start in before.items():
        slot, now = field.store.keys[key], field.store.codes_of(key)
        now = np.full((512, 512), now) if isinstance(now, int) else now
        for ty in range(8):
            for tx in range(8):
                then, after = (c[64 * ty : 64 * ty + 64, 64 * tx : 64 * tx + 64] for c in (start, now))
                prototype = int(field.pages.tile_prototype[slot, ty, tx])
                stand = field.pages.tile_stand[slot, ty, tx].astype(float).tolist()
                length = sqrt(stand[0] ** 2 + stand[1] ** 2 + stand[2] ** 2)
                kind, masses = prototype & (MIRROR_X - 1), []
                for stem in range(library.stem_start[kind], library.stem_start[kind + 1]):
                    if library.stem_rank[stem] >= stand[3]:
                        continue
                    x, y = library.stem_xy[stem].astype(float).tolist()
                    x, y = size - x if prototype & MIRROR_X else x, size - y if prototype & MIRROR_Y else y
                    column, row = (min(max(floor(v * (64 / size)), 0), 63) for v in (x, y))
                    old, new = int(then[row, column]), int(after[row, column])
                    if old != new:
                        was, gone = (taken(library, stem, stand, length, code) for code in (old, new))
                        masses.append([b - a for a, b in zip(was, gone, strict=True)])
                        stems += old == STANDING and not library.is_weed[stem]
                for total, column in zip(sums, zip(*masses, strict=True), strict=False):
                    total.append(fsum(column))
    return (*(fsum(total) for total in sums), stems)


@pytest.mark.parametrize("density", [500.0, 180.0])
def test_the_recount_is_that_of_the_stems_one_by_one(density):
    """Over toothed edges, cut at several heights, again lower, and above ears, which stay in the field."""
    edge = StraightEdge(heading_deg=70.0, teeth=TeethParams(amplitude_m=0.5, wavelength_m=2.0))
    stand = uniform.Params(stems_per_m2=density, height_factor=1.1)
    field, fresh = (made_field(edge=edge, stand=stand) for _ in range(2))
    field.ensure(0.0, 0.0, 12.0)
    fresh.ensure(0.0, 0.0, 12.0)
    for n, height in enumerate((0.3, 0.1, 0.95, 0.12, 0.4)):
        field.cut(rectangle(1.3 * n, -4.0, 1.3 * n + 2.0, 5.0), height)
    before = {}
    for key in field.store.recut:
        codes = fresh.store.codes_of(key)
        before[key] = np.full((512, 512), codes) if isinstance(codes, int) else codes
    found = field.recount()
    grain, straw, left, stubble, stems = counted(field, before)
    assert (found.grain, found.straw, found.grain_left) == (grain, straw, left)
    assert (found.stubble, found.stem_count) == (stubble, stems)
    assert grain > 10.0
    assert left > 0.5
