"""The header level `profile` as a kernel over worlds."""

import warp as wp

from swath.field.edges.profile_kernel import Profile, beside

wp.set_module_options({"fuse_fp": False, "enable_backward": False})


@wp.struct
class Knife:
    """Of a header, alike in a run: where its knife is in the machine, its ends to the left and right; forget:
    way of the fill gauge, bin: of the profile [m]; crop_is_left: 1, else 0.
    """

    x: wp.float64
    left: wp.float64
    right: wp.float64
    forget: wp.float64
    bin: wp.float64
    crop_is_left: wp.float64


@wp.struct
class Cutting:
    """What goes on from step to step. of the ends next to the edge (near) and away from it (far): way along
    the profile and place inside of the line when they were looked at last [m]; the last bin that they passed.

    is_begun: 0 before the first state
    is_refused: it came back
    cut, swept: of the fill gauge [m2]
    """

    near_along: wp.float64
    near_inside: wp.float64
    far_along: wp.float64
    far_inside: wp.float64
    cut: wp.float64
    swept: wp.float64
    station: int
    near_bin: int
    far_bin: int
    is_begun: int
    is_refused: int


@wp.struct
class Taken:
    """Of a square metre, by station [kg, kg, 1, kg]; left: grain on ears below the knife."""

    grain: wp.array(dtype=wp.float64)
    straw: wp.array(dtype=wp.float64)
    stems: wp.array(dtype=wp.float64)
    left: wp.array(dtype=wp.float64)


@wp.func
def bin_before(along: wp.float64, bin: wp.float64) -> int:
    """The last bin whose middle lies before a place along the profile."""
    return int(wp.floor(along / bin - wp.float64(0.5)))


@wp.func
def between(x: wp.float64, x0: wp.float64, y0: wp.float64, x1: wp.float64, y1: wp.float64) -> wp.float64:
    """Ordinate y at x on the line through two points, x0 < x1."""
    return y0 + (y1 - y0) * (x - x0) / (x1 - x0)


@wp.kernel
def cut_along(
    profiles: wp.array(dtype=Profile),
    taken: wp.array(dtype=Taken),
    knives: wp.array(dtype=Knife),
    cuttings: wp.array(dtype=Cutting),
    head: wp.array(dtype=wp.int64),
    poses: wp.array3d(dtype=wp.float64),
    clock: wp.array(dtype=wp.int64),
    needs: wp.array(dtype=int),
    flows: wp.array2d(dtype=wp.float64),
    counts: wp.array2d(dtype=wp.int64),
):
    """One world a thread.

    head, poses: of the trail of the new ones, (k, world, 12)
    clock: begin, end, length of the step [ns]
    needs: 1 where a knife goes where it cannot; flows, counts: as `header.FLOWS`, one memory
    """
    w = wp.tid()
    profile = profiles[w]
    per_m2 = taken[w]
    knife = knives[w]
    c = cuttings[w]
    grain = wp.float64(0.0)
    straw = wp.float64(0.0)
    area = wp.float64(0.0)
    stems = wp.float64(0.0)
    remains = wp.float64(0.0)
    moved = wp.float64(0.0)
    swept = wp.float64(0.0)
    last = profile.reach.shape[0] - 1
    for i in range(int(head[1])):
        px = poses[i, w, 0]
        py = poses[i, w, 1]
        ax = poses[i, w, 3]
        bx = poses[i, w, 4]
        ay = poses[i, w, 6]
        by = poses[i, w, 7]
        left = beside(
            profile, px + ax * knife.x + bx * knife.left, py + ay * knife.x + by * knife.left, c.station
        )
        right = beside(
            profile,
            px + ax * knife.x + bx * knife.right,
            py + ay * knife.x + by * knife.right,
            left.station,
        )
        near = left
        far = right
        if knife.crop_is_left == wp.float64(1.0):
            near = right
            far = left
        c.station = near.station
        if far.inside <= near.inside and c.is_begun == 1:
            c.is_refused = 1
        near_bin = bin_before(near.along, knife.bin)
        far_bin = bin_before(far.along, knife.bin)
        if c.is_begun == 0:
            c.is_begun = 1
            c.near_bin = near_bin
            c.far_bin = far_bin
        else:
            moved += wp.abs(near.along - c.near_along) + wp.abs(far.along - c.far_along)
            for b in range(c.near_bin + 1, near_bin + 1):
                if b >= 0 and b <= last:
                    s = (wp.float64(b) + wp.float64(0.5)) * knife.bin
                    place = between(s, c.near_along, c.near_inside, near.along, near.inside)
                    profile.near[b] = float(place)
            for b in range(c.far_bin + 1, far_bin + 1):
                if b >= 0 and b <= last:
                    s = (wp.float64(b) + wp.float64(0.5)) * knife.bin
                    place = between(s, c.far_along, c.far_inside, far.along, far.inside)
                    profile.far[b] = float(place)
            # bins that both ends have passed now are cut
            before = wp.min(c.near_bin, c.far_bin)
            c.near_bin = wp.max(c.near_bin, near_bin)
            c.far_bin = wp.max(c.far_bin, far_bin)
            for b in range(before + 1, wp.min(c.near_bin, c.far_bin) + 1):
                if b >= 0 and b <= last:
                    low = wp.max(wp.float64(profile.near[b]), wp.float64(profile.reach[b]))
                    wide = wp.max(wp.float64(profile.far[b]) - low, wp.float64(0.0))
                    if wp.isfinite(wide) and wp.isfinite(low):
                        station = wp.min(
                            int((wp.float64(b) + wp.float64(0.5)) * knife.bin + wp.float64(0.5)),
                            profile.x.shape[0] - 1,
                        )
                        bent = wp.float64(profile.curvature[station])
                        if profile.is_left == 0:
                            bent = -bent
                        ground = wide * knife.bin * (wp.float64(1.0) - bent * (low + wp.float64(0.5) * wide))
                        area += ground
                        grain += ground * per_m2.grain[station]
                        straw += ground * per_m2.straw[station]
                        stems += ground * per_m2.stems[station]
                        remains += ground * per_m2.left[station]
                    swept += (knife.left - knife.right) * knife.bin
        c.near_along = near.along
        c.near_inside = near.inside
        c.far_along = far.along
        c.far_inside = far.inside
    # forget over a metre of travel, as tell_flows.cpp
    kept = wp.exp(-wp.float64(0.5) * moved / knife.forget)
    c.cut = c.cut * kept + area
    c.swept = c.swept * kept + swept
    fill = wp.float64(0.0)
    if moved > wp.float64(1.0e-6) and c.swept > wp.float64(0.0):
        fill = wp.min(c.cut / c.swept, wp.float64(1.0))
    cuttings[w] = c
    if c.is_refused == 1:
        needs[0] = 1
    flows[w, 0] = grain
    flows[w, 1] = straw
    flows[w, 2] = area
    counts[w, 3] = wp.int64(wp.floor(stems + wp.float64(0.5)))
    flows[w, 4] = fill
    flows[w, 5] = wp.float64(clock[2]) / wp.float64(1.0e9)
    flows[w, 6] = remains
