"""Profiles along an edge as kernels read them: `profile.Profile` in the stand frame."""

import warp as wp

wp.set_module_options({"fuse_fp": False, "enable_backward": False})

RUN = wp.constant(16)  # steps along a line that are looked up together


@wp.struct
class Profile:
    """The station is the world's: one struct a world.

    turn: the world's heading in it; tile_size: of the field's tiles [m], 64 cut cells
    Of the stations: x, y [m]; direction of the edge, its curvature [1/m]. Of their columns, `column` [m]
    apart: z of the ground's plane at the station [m], its slopes; scale and lean of the plants, stems per m2
    Of the bins, bins_per_m from the first station on: crop grows from `reach` inwards, and is cut between
    near and far [m]; inner: code of what is there instead inside of the edge's line [cm]; outer: and outside
    cut: code of what the header leaves; bite: of each station, how far `reach` differs nearby [m]
    begin: of the crop along the line, from the first station on [m]
    """

    turn: wp.vec2d
    tile_size: wp.float64
    x: wp.array(dtype=wp.float64)
    y: wp.array(dtype=wp.float64)
    z: wp.array(dtype=wp.float64)
    cosine: wp.array(dtype=float)
    sine: wp.array(dtype=float)
    curvature: wp.array(dtype=float)
    slope_x: wp.array(dtype=float)
    slope_y: wp.array(dtype=float)
    stand: wp.array(dtype=wp.vec4)
    columns: int
    column: float
    bins_per_m: float
    reach: wp.array(dtype=float)
    near: wp.array(dtype=float)
    far: wp.array(dtype=float)
    inner: wp.array(dtype=int)
    outer: int
    cut: wp.array(dtype=int)
    is_left: int
    bite: wp.array(dtype=float)
    begin: float
    reflectance: wp.array(dtype=float)


@wp.struct
class Beside:
    """station: that a place is beside; along: way from the first station; inside: of the line [m]."""

    station: int
    along: wp.float64
    inside: wp.float64


@wp.func
def beside(profile: Profile, x: wp.float64, y: wp.float64, station: int) -> Beside:
    """Where a place of the world [m] lies along the line; station: near it."""
    c = profile.turn[0]
    s = profile.turn[1]
    u = c * x + s * y
    v = c * y - s * x
    last = profile.x.shape[0] - 1
    k = station
    along = wp.float64(0.0)
    left = wp.float64(0.0)
    tries = int(0)
    while tries < 1000:
        du = u - profile.x[k]
        dv = v - profile.y[k]
        cosine = wp.float64(profile.cosine[k])
        sine = wp.float64(profile.sine[k])
        along = du * cosine + dv * sine
        left = dv * cosine - du * sine - wp.float64(0.5 * profile.curvature[k]) * along * along
        next = wp.clamp(k + int(wp.floor(along + wp.float64(0.5))), 0, last)
        tries += 1
        if next == k:
            tries = 1000
        k = next
    found = Beside()
    found.station = k
    found.along = wp.float64(k) + along
    found.inside = left
    if profile.is_left == 0:
        found.inside = -left
    return found


@wp.func
def bin_at(profile: Profile, along: wp.float64, last: int) -> int:
    """The bin of a way along the line from the first station on [m]."""
    return wp.clamp(int(wp.floor(along * wp.float64(profile.bins_per_m))), 0, last)


@wp.func_native("""
const double per = 1.0 / (double)(after - first), way = end - begin;
bool* line = (bool*)crop.data;
for (int i = first; i < after; ++i) {
  const float inside = (float)(begin + ((double)(i - first) + 0.5) * per * way);
  line[i] = (inside >= reach) & !((inside >= near) & (inside < far));
}
""")
def fill_run(
    crop: wp.array(dtype=wp.bool),
    first: int,
    after: int,
    begin: wp.float64,
    end: wp.float64,
    reach: float,
    near: float,
    far: float,
): ...


@wp.func
def crop_along(
    profile: Profile,
    x: wp.float64,
    y: wp.float64,
    dx: wp.float64,
    dy: wp.float64,
    crop: wp.array(dtype=wp.bool),
    station: int,
) -> int:
    """Whether crop stands at the middles of steps from a place on [m]; returns the station there.

    station: one near that place
    """
    last = profile.reach.shape[0] - 1
    count = crop.shape[0]
    first = int(0)
    begin = beside(profile, x, y, station)
    while first < count:  # straight in between: an edge bends by less than 0.1 mm on such a way
        after = wp.min(first + RUN, count)
        way = wp.float64(after)
        end = beside(profile, x + way * dx, y + way * dy, begin.station)
        per = wp.float64(1.0) / wp.float64(after - first)
        b = bin_at(profile, begin.along, last)
        reach = profile.reach[b]
        near = profile.near[b]
        far = profile.far[b]
        if b == bin_at(profile, end.along, last):  # nearly always, on a line across the edge
            fill_run(crop, first, after, begin.inside, end.inside, reach, near, far)
        else:
            for i in range(first, after):
                share = (wp.float64(i - first) + wp.float64(0.5)) * per
                inside = float(begin.inside + share * (end.inside - begin.inside))
                b = bin_at(profile, begin.along + share * (end.along - begin.along), last)
                is_cut = inside >= profile.near[b] and inside < profile.far[b]
                crop[i] = inside >= profile.reach[b] and not is_cut
        begin = end
        first = after
    return begin.station


@wp.kernel
def stands_along(
    profiles: wp.array(dtype=Profile),
    of: wp.array(dtype=int),
    starts: wp.array2d(dtype=wp.float64),
    steps: wp.array2d(dtype=wp.float64),
    crop: wp.array2d(dtype=wp.bool),
    stations: wp.array(dtype=int),
):
    """Whether crop stands at the middles of steps from starts on [m], a line each, in one thread.

    of: the profile of each line; stations: of the last line beside each profile
    """
    for line in range(starts.shape[0]):
        p = of[line]
        x = starts[line, 0]
        y = starts[line, 1]
        stations[p] = crop_along(profiles[p], x, y, steps[line, 0], steps[line, 1], crop[line], stations[p])


@wp.func
def cells_in(profile: Profile, corners: wp.array2d(dtype=wp.float64), n: int, cell: wp.float64) -> int:
    last = profile.reach.shape[0] - 1
    lowest = corners[0, 1]
    highest = corners[0, 1]
    for i in range(1, n):
        lowest = wp.min(lowest, corners[i, 1])
        highest = wp.max(highest, corners[i, 1])
    half = wp.float64(0.5)
    first_row = int(wp.ceil(lowest / cell - half))
    last_row = int(wp.floor(highest / cell - half))
    if lowest == highest:  # no edge bounds a row
        last_row = first_row - 1
    station = int(0)
    found = int(0)
    for row in range(first_row, last_row + 1):
        y = (wp.float64(row) + half) * cell
        low = wp.float64(-1.0e30)
        high = wp.float64(1.0e30)
        for i in range(n):
            k = (i + 1) % n
            rise = corners[k, 1] - corners[i, 1]
            if rise != wp.float64(0.0):
                x = corners[i, 0] + (corners[k, 0] - corners[i, 0]) / rise * (y - corners[i, 1])
                if rise > wp.float64(0.0):
                    high = wp.min(high, x)
                else:
                    low = wp.max(low, x)
        for column in range(int(wp.ceil(low / cell - half)), int(wp.floor(high / cell - half)) + 1):
            place = beside(profile, (wp.float64(column) + half) * cell, y, station)
            station = place.station
            inside = float(place.inside)
            b = bin_at(profile, place.along, last)
            if inside >= profile.reach[b] and not (inside >= profile.near[b] and inside < profile.far[b]):
                found += 1
    return found


@wp.kernel
def standing_cells(
    profile: Profile,
    polygons: wp.array3d(dtype=wp.float64),
    counts: wp.array(dtype=int),
    cell: wp.float64,
):
    """Cells [m] in which crop stands and whose middles are in convex anticlockwise polygons [m]; one thread.

    polygons: (n, corners, 2); counts: of cells, (n,)
    """
    for p in range(counts.shape[0]):
        counts[p] = cells_in(profile, polygons[p], polygons.shape[1], cell)
