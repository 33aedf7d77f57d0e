"""Brightness of surfaces as a Warp kernel: value noise on lattices in the plane of the world."""

import warp as wp

GROUND = wp.constant(1)
STRAW = wp.constant(2)
SOLID = wp.constant(7)
GRAIN = wp.constant(64)


@wp.func
def corner(i: wp.int64, j: wp.int64, salt: wp.uint32) -> float:
    """A number 0 to 1 of a lattice point, the same everywhere: an integer hash."""
    h = wp.uint32(i) * wp.uint32(374761393) + wp.uint32(j) * wp.uint32(668265263) + salt
    h = (h ^ (h >> wp.uint32(15))) * wp.uint32(1597334677)
    h = (h ^ (h >> wp.uint32(13))) * wp.uint32(1183186591)
    h = h ^ (h >> wp.uint32(16))
    return float(h >> wp.uint32(8)) * 5.9604645e-08


@wp.func
def noise(u: wp.float64, v: wp.float64, salt: wp.uint32) -> float:
    """Smooth noise -1 to 1 with a wavelength of about 1, mean 0 over the lattice."""
    fu = wp.floor(u)
    fv = wp.floor(v)
    a = float(u - fu)
    b = float(v - fv)
    a = a * a * (3.0 - 2.0 * a)
    b = b * b * (3.0 - 2.0 * b)
    i = wp.int64(fu)
    j = wp.int64(fv)
    one = wp.int64(1)
    low = corner(i, j, salt) * (1.0 - a) + corner(i + one, j, salt) * a
    high = corner(i, j + one, salt) * (1.0 - a) + corner(i + one, j + one, salt) * a
    return 2.0 * (low * (1.0 - b) + high * b) - 1.0


@wp.func
def resolved(length: float, pixel: float) -> float:
    """Share of a wave of this length that a pixel of this size still shows."""
    return wp.clamp(length / (2.0 * pixel) - 0.5, 0.0, 1.0)


@wp.func
def octave(x: wp.float64, y: wp.float64, length: float, pixel: float, salt: wp.uint32) -> float:
    """Noise of a wavelength [m], without what a pixel does not resolve."""
    share = resolved(length, pixel)
    if share <= 0.0:
        return 0.0
    return share * noise(x / wp.float64(length), y / wp.float64(length), salt)


@wp.func
def stalks(x: wp.float64, y: wp.float64, pixel: float, salt: wp.uint32) -> float:
    """Stalks across each other: of four directions the one that lies on top, -1 to 1."""
    share = resolved(0.010, pixel)
    if share <= 0.0:
        return 0.0
    most = float(-1.0)
    for k in range(4):
        turn = wp.float64(k) * wp.float64(0.83) + wp.float64(0.3)
        c = wp.cos(turn)
        s = wp.sin(turn)
        u = (c * x + s * y) / wp.float64(0.15)
        v = (c * y - s * x) / wp.float64(0.007)
        most = wp.max(most, noise(u, v, salt + wp.uint32(k)))
    return share * 1.6 * (most - 0.45)


@wp.kernel(enable_backward=False)
def brightness(
    points: wp.array(dtype=wp.vec3d),
    organ: wp.array(dtype=wp.uint8),
    pixel: wp.array(dtype=float),
    salt: wp.uint32,
    first: int,
    factor: wp.array(dtype=float),
):
    """What the colour of a surface is multiplied by; pixel: its size there [m]."""
    i = first + wp.tid()
    kind = int(organ[i])
    x = points[i][0]
    y = points[i][1]
    size = pixel[i]
    f = float(1.0)
    if kind == GROUND:
        f += 0.10 * octave(x, y, 3.0, size, salt) + 0.12 * octave(x, y, 0.4, size, salt + wp.uint32(11))
        f += 0.20 * octave(x, y, 0.09, size, salt + wp.uint32(12))
        f += 0.25 * octave(x, y, 0.025, size, salt + wp.uint32(13))
    elif kind == STRAW:
        f += 0.10 * octave(x, y, 0.6, size, salt + wp.uint32(21)) + 0.35 * stalks(
            x, y, size, salt + wp.uint32(22)
        )
    elif kind == GRAIN:
        f += 0.05 * octave(x, y, 0.3, size, salt + wp.uint32(41))
        f += 0.07 * octave(x, y, 0.09, size, salt + wp.uint32(42))
        f += 0.08 * octave(x, y, 0.03, size, salt + wp.uint32(43))
        f += 0.25 * octave(x, y, 0.008, size, salt + wp.uint32(44))
    elif kind != SOLID:
        f += 0.07 * octave(x, y, 5.0, size, salt + wp.uint32(31))
        f += 0.06 * octave(x, y, 0.8, size, salt + wp.uint32(32))
        f += 0.22 * octave(x, y, 0.02, size, salt + wp.uint32(33))
    factor[i] = wp.max(f, 0.05)
