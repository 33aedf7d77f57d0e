"""Rays against every primitive, in float64 numpy with other formulas than the kernel: slow and plain."""

from itertools import pairwise

import numpy as np

from swath.field.memory_layout import MIRROR_X, MIRROR_Y, STANDING, Organ, Pages, PlantLibrary, Shape

BIG = 1e30


def ball_span(o, d, c, r):
    """Entry and exit of balls, (m,), for one ray with any d."""
    m = o - c
    qa, qb, qc = d @ d, m @ d, (m * m).sum(1) - r * r
    disc = qb * qb - qa * qc
    root = np.sqrt(np.maximum(disc, 0.0))
    hit = disc >= 0
    return np.where(hit, (-qb - root) / qa, BIG), np.where(hit, (-qb + root) / qa, -BIG)


def capsule_span(o, d, a, b, r):
    """Entry and exit of capsules: the union of a cylinder between two planes and two balls, all convex."""
    u = b - a
    length = np.maximum(np.linalg.norm(u, axis=1), 1e-30)
    u = u / length[:, None]
    m = o - a
    du, mu = u @ d, (m * u).sum(1)
    dp, mp = d - du[:, None] * u, m - mu[:, None] * u
    qa, qb, qc = (dp * dp).sum(1), (dp * mp).sum(1), (mp * mp).sum(1) - r * r
    disc = qb * qb - qa * qc
    with np.errstate(all="ignore"):
        root = np.sqrt(np.maximum(disc, 0.0))
        t0 = np.where(qa > 1e-18, (-qb - root) / qa, np.where(qc < 0, -BIG, BIG))
        t1 = np.where(qa > 1e-18, (-qb + root) / qa, np.where(qc < 0, BIG, -BIG))
        s0 = np.where(np.abs(du) > 1e-15, (0 - mu) / du, np.where(mu > 0, -BIG, BIG))
        s1 = np.where(np.abs(du) > 1e-15, (length - mu) / du, np.where(mu < length, BIG, -BIG))
    enter = np.maximum(t0, np.minimum(s0, s1))
    leave = np.minimum(t1, np.maximum(s0, s1))
    none = (disc < 0) | (enter > leave)
    enter, leave = np.where(none, BIG, enter), np.where(none, -BIG, leave)
    for end in (a, b):
        e, x = ball_span(o, d, end, r)
        enter, leave = np.minimum(enter, e), np.maximum(leave, x)
    return enter, leave


def ribbon_hit(o, d, a, b, w):
    """Distance to parallelograms by solving o + t d = a + s u + v w with Cramer's rule."""
    u = b - a
    n = np.cross(u, w)
    with np.errstate(all="ignore"):
        t = ((a - o) * n).sum(1) / (n @ d)
        q = o + t[:, None] * d - a
        nn = (n * n).sum(1)
        s = (np.cross(q, w) * n).sum(1) / nn
        v = (np.cross(u, q) * n).sum(1) / nn
        hit = (s >= 0) & (s <= 1) & (np.abs(v) <= 1) & np.isfinite(t)
    return np.where(hit, t, BIG)


def triangle_hit(o, d, a, b, w):
    """Distance to triangles a - w, a + w, b: the plane's, where all three sides have the point inside."""
    corners = np.stack([a - w, a + w, b], axis=1)
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(all="ignore"):
        t = ((a - o) * n).sum(1) / (n @ d)
        q = (o + t[:, None] * d)[:, None] - corners
        inside = (np.cross(np.roll(corners, -1, axis=1) - corners, q) * n[:, None]).sum(2)
        hit = (inside >= 0).all(axis=1) & np.isfinite(t)
    return np.where(hit, t, BIG)


def cell_code(pages: Pages, cell_x: int, cell_y: int) -> int:
    i, j = cell_x // 512 - pages.table_x, cell_y // 512 - pages.table_y
    if not (0 <= i < pages.table.shape[1] and 0 <= j < pages.table.shape[0]) or pages.table[j, i] < 0:
        return STANDING
    row = pages.cut_slot[pages.table[j, i]]
    return int(-1 - row) if row < 0 else int(pages.cut[row, cell_y % 512, cell_x % 512])


def tile_hit(library: PlantLibrary, pages: Pages, tx, ty, o, d, t0, t1):
    """Nearest plant hit (t, organ) in tile (tx, ty), stand frame, within [t0, t1]."""
    slot = pages.table[ty // 8 - pages.table_y, tx // 8 - pages.table_x]
    ground, sx, sy = pages.tile_plane[slot, ty % 8, tx % 8].astype(float)
    scale, lx, ly, fraction = pages.tile_stand[slot, ty % 8, tx % 8].astype(float)
    kind = int(pages.tile_prototype[slot, ty % 8, tx % 8])
    size = library.tile_size
    row = np.array([-sx, -sy, 1.0]) / scale
    matrix = np.array([[1.0, 0, 0] - lx * row, [0, 1.0, 0] - ly * row, row])
    shift = np.zeros(3)
    q0 = np.array([tx * size, ty * size, ground - (sx + sy) * 0.5 * size])
    for axis, flag in enumerate((MIRROR_X, MIRROR_Y)):
        if kind & flag:
            matrix[axis] *= -1
            shift[axis] = size
    po, pd = matrix @ (o - q0) + shift, matrix @ d
    k = kind & 0xFFFF
    mine = np.flatnonzero(
        (library.owner >= library.stem_start[k]) & (library.owner < library.stem_start[k + 1])
    )
    mine = mine[library.stem_rank[library.owner[mine]] < fraction]
    starts, stops = library.a[mine].astype(float), library.b[mine].astype(float)
    radius, width = library.radius[mine].astype(float), library.width[mine].astype(float)
    middles = 0.5 * (starts + stops)
    reaches = 1e-6 + np.linalg.norm(stops - middles, axis=1) + radius + np.linalg.norm(width, axis=1)
    ends = np.stack([po + t0 * pd, po + t1 * pd])
    best = (BIG, Organ.NONE)
    periods = [range(int(np.floor(v.min() / size)), int(np.floor(v.max() / size)) + 1) for v in ends[:, :2].T]
    for nx in periods[0]:
        for ny in periods[1]:
            move = np.array([nx * size, ny * size, 0.0])
            near = np.flatnonzero(passes_within(middles + move - po, pd, reaches))
            if not len(near):
                continue
            a, b = starts[near] + move, stops[near] + move
            r, w, kind_of = radius[near], width[near], library.shape[mine[near]]
            t = first_hits(po, pd, a, b, r, w, t0, kind_of)
            for i in np.argsort(t):
                if t[i] > min(t1, best[0]):
                    break
                foot = library.base[mine[near[i]]].astype(float) + move[:2]
                for axis, flag in enumerate((MIRROR_X, MIRROR_Y)):
                    foot[axis] = size - foot[axis] if kind & flag else foot[axis]
                code = cell_code(
                    pages,
                    tx * 64 + int(np.floor(foot[0] * 64 / size)),
                    ty * 64 + int(np.floor(foot[1] * 64 / size)),
                )
                found = clipped(
                    po, pd, a[i], b[i], r[i], w[i], t[i], t0, code, 0.01 * code / scale, kind_of[i]
                )
                if found < min(best[0], t1):
                    organ = Organ(int(library.organ[mine[near[i]]]))
                    best = (found, Organ.STUBBLE if code != STANDING and organ == Organ.STEM else organ)
    return best


def passes_within(away, d, reach):
    """Whether a ray comes as near to points, seen from its origin, as they reach: nothing else can be hit."""
    along = away @ d / (d @ d)
    return ((away - along[:, None] * d) ** 2).sum(axis=1) <= reach * reach


def first_hits(o, d, a, b, r, w, t0, kind):
    enter, leave = capsule_span(o, d, a, b, r)
    inside = (enter < t0) & (leave >= t0) & (t0 > 0)
    capsule = np.where(inside, t0, np.where(enter >= t0, enter, BIG))
    ribbon = np.where(kind == Shape.TRIANGLE, triangle_hit(o, d, a, b, w), ribbon_hit(o, d, a, b, w))
    return np.where(r > 0, capsule, np.where(ribbon >= t0, ribbon, BIG))


def clipped(o, d, a, b, r, w, t, t0, code, top, kind):
    if code == STANDING:
        return t
    if code == 0:
        return BIG
    if kind == Shape.CAPSULE and min(a[2], b[2]) > top:
        return BIG
    if r == 0:
        return BIG if o[2] + t * d[2] > top else t
    low, high = (a, b) if a[2] <= b[2] else (b, a)
    if high[2] > top:
        high = low + (top - low[2]) / (high[2] - low[2]) * (high - low)
    return first_hits(o, d, low[None], high[None], np.array([r]), w[None], t0, np.array([kind]))[0]


def patch_hit(h, o, d, gap, t0, t1):
    """First root of the ray's height above a bilinear patch with corners h = (h00, h10, h01, h11)."""
    x, y = np.array([o[0], d[0]]) / gap, np.array([o[1], d[1]]) / gap
    c = h[3] - h[2] - h[1] + h[0]
    poly = np.array(
        [
            o[2] - h[0] - (h[1] - h[0]) * x[0] - (h[2] - h[0]) * y[0] - c * x[0] * y[0],
            d[2] - (h[1] - h[0]) * x[1] - (h[2] - h[0]) * y[1] - c * (x[0] * y[1] + x[1] * y[0]),
            -c * x[1] * y[1],
        ]
    )
    roots = (
        np.roots(poly[::-1]) if abs(poly[2]) > 1e-14 else np.array([-poly[0] / poly[1]] if poly[1] else [])
    )
    good = [float(t.real) for t in roots if abs(t.imag) < 1e-12 and t0 <= t.real <= t1]
    return min(good, default=BIG)


def cast_slowly(library: PlantLibrary, pages: Pages, origins, directions, range_max, *, ground=True):
    """(distance, organ) of rays given in the stand frame; nan and NONE where nothing is hit."""
    size = library.tile_size
    distance, organs = np.full(len(origins), np.nan), np.zeros(len(origins), int)
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        for tx, ty, t0, t1 in tiles_along(o, d, size, range_max):
            px, py = tx // 8 - pages.table_x, ty // 8 - pages.table_y
            if not (0 <= px < pages.table.shape[1] and 0 <= py < pages.table.shape[0]):
                break
            best = tile_hit(library, pages, tx, ty, o, d, t0, t1)
            if ground:
                t = ground_hit(pages, pages.table[py, px], tx, ty, size, o, d, t0, t1)
                if t < best[0]:
                    best = (t, Organ.GROUND)
            if best[0] <= t1:
                distance[i], organs[i] = best
                break
    return distance, organs


def ground_hit(pages, slot, tx, ty, size, o, d, t0, t1):
    gap, best = size / 8, BIG
    surface = (pages.ground[slot] + pages.straw[slot]).astype(float)
    for j in range(8):
        for i in range(8):
            ix, iy = tx % 8 * 8 + i, ty % 8 * 8 + j
            p = o - np.array([tx * size + i * gap, ty * size + j * gap, 0.0])
            s0, s1 = t0, t1
            for axis in (0, 1):
                if d[axis] != 0:
                    crossings = sorted([-p[axis] / d[axis], (gap - p[axis]) / d[axis]])
                    s0, s1 = max(s0, crossings[0]), min(s1, crossings[1])
                elif not 0 <= p[axis] <= gap:
                    s1 = -1.0
            if s0 <= s1:
                corners = surface[iy : iy + 2, ix : ix + 2].ravel()
                best = min(best, patch_hit(corners, p, d, gap, s0 - 1e-9, s1 + 1e-9))
    return best


def tiles_along(o, d, size, range_max):
    """(tile x, tile y, entry, exit) along a ray, by sorting all crossings of tile sides."""
    cuts = [0.0, range_max]
    for axis in (0, 1):
        if d[axis] != 0:
            ends = sorted([o[axis], o[axis] + range_max * d[axis]])
            sides = np.arange(np.floor(ends[0] / size) + 1, np.floor(ends[1] / size) + 1) * size
            cuts += [float(t) for t in (sides - o[axis]) / d[axis] if 0 < t < range_max]
    cuts.sort()
    for t0, t1 in pairwise(cuts):
        middle = (o + 0.5 * (t0 + t1) * d) / size
        yield int(np.floor(middle[0])), int(np.floor(middle[1])), t0, t1
