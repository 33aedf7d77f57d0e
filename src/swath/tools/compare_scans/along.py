"""Both clouds in one frame: along a path and to its left, by the poses, by each one's own path, or by ICP."""

from dataclasses import dataclass, replace
from math import acos, degrees, pi

import numpy as np

from swath.core.errors import InputError, MissingExtra
from swath.core.random import Stream
from swath.signals import F64
from swath.tools.compare_scans.clouds import Cloud, axis_track
from swath.tools.height_map.poses import PoseTrack

TURN_MAX = 0.6 * pi  # of a path, away from its first heading: more is a headland [rad]
STEP_M, SMOOTH_M = 0.5, 2.0  # of a path: between its points; standard deviation of the weights along it
MOVED_M = 0.2  # between points of a path: above the noise of RTK at rest, chosen
COARSE = 8  # steps between the points among which the nearest is looked for
AT_ONCE = 1 << 16  # points that are placed together, to save memory
ICP_POINTS, ICP_STEPS = 20_000, 60  # points that ICP lays on the others; its iterations at most
ICP_REST_M = 0.3  # RMS from the nearest points above which it found another place, chosen
ICP_MOVED_M, ICP_TURNED_DEG = 5.0, 5.0  # poses are not so wrong: another place was found


@dataclass(frozen=True)
class Place:
    """Where echoes lie: s along the path from its start, d to its left, both (n,) [m]."""

    s: F64
    d: F64


class Path:
    """A path, smoothed, straight on beyond its ends."""

    def __init__(self, track: PoseTrack, name: str) -> None:
        flat = _moved(track.position[:, :2])
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(flat, axis=0).T))])
        self.length = float(way[-1])
        if self.length < 2.0 * STEP_M:
            raise InputError("poses", name, f"expected a path, it is {self.length:.2f} m long")
        self.s = np.linspace(0.0, self.length, round(self.length / STEP_M) + 1)
        raw = np.stack([np.interp(self.s, way, flat[:, k]) for k in (0, 1)], axis=1)
        self.xy = _smooth(raw)
        step = np.gradient(self.xy, axis=0)
        self.heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
        turned = float(np.abs(self.heading - self.heading[0]).max())
        if turned > TURN_MAX:
            expected = f"expected one pass, its path turns by {degrees(turned):.0f} deg: cut the recording"
            raise InputError("poses", name, expected)

    def at(self, s: F64) -> tuple[F64, F64]:
        """Points (n, 2) and headings (n,) [rad]."""
        heading = np.interp(s, self.s, self.heading)
        inside = np.clip(s, self.s[0], self.s[-1])
        ahead = np.stack([np.cos(heading), np.sin(heading)], axis=1)
        place = np.stack([np.interp(inside, self.s, self.xy[:, k]) for k in (0, 1)], axis=1)
        return place + (s - inside)[:, None] * ahead, heading

    def place(self, points: F64) -> Place:
        """Of world points (n, >=2)."""
        parts = [self._some(points[i : i + AT_ONCE, :2]) for i in range(0, len(points), AT_ONCE)]
        s, d = (np.concatenate(p) for p in zip(*parts, strict=True))
        return Place(s, d)

    def _some(self, xy: F64) -> tuple[F64, F64]:
        coarse = self.xy[::COARSE]
        far = (xy[:, :1] - coarse[:, 0]) ** 2 + (xy[:, 1:] - coarse[:, 1]) ** 2
        s = self.s[::COARSE][far.argmin(axis=1)]
        d = np.zeros(len(s))
        for _ in range(8):  # along the tangent to the foot of the perpendicular
            foot, heading = self.at(s)
            dx, dy = (xy - foot).T
            d = np.cos(heading) * dy - np.sin(heading) * dx
            s = s + np.cos(heading) * dx + np.sin(heading) * dy
        return s, d


def _moved(xy: F64) -> F64:
    """The points that lie MOVED_M from the last one of them: noise at rest is no way."""
    kept = [0]
    for number, (x, y) in enumerate(xy):
        if (x - xy[kept[-1], 0]) ** 2 + (y - xy[kept[-1], 1]) ** 2 >= MOVED_M**2:
            kept.append(number)
    return np.asarray(xy[kept])


def _smooth(xy: F64) -> F64:
    """Gaussian along the path; mirrored in its ends, which so stay where they are."""
    reach = round(3.0 * SMOOTH_M / STEP_M)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) * STEP_M / SMOOTH_M) ** 2)
    padded = np.pad(xy, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    columns = [np.convolve(padded[:, k], weight / weight.sum(), "valid") for k in (0, 1)]
    return np.stack(columns, axis=1)


def aligned(a: Cloud, b: Cloud, how: str, notes: list[str]) -> tuple[Place, Place]:
    """Both clouds along one path, A's where there is a choice. InputError where they cannot be laid over each
    other; `notes` gets what was taken for granted.
    """
    if how == "path":
        for cloud in (a, b):
            if cloud.track is None:
                raise InputError("--align", how, f"expected poses in both, {cloud.name} has none")
        one, other = (Path(c.track, c.name).place(c.points) for c in (a, b) if c.track is not None)
        return one, other
    whose = a if a.track is not None or b.track is None else b
    track = whose.track
    if track is None:
        track = axis_track(a.points)
        yaw = degrees(track.angle[0, 2])
        notes.append(f"neither has a path: along is the longer axis of {a.name}, {yaw:.1f} deg from east")
    path = Path(track, whose.name)
    _check_overlap(a, b)
    if how == "icp":
        b = replace(b, points=_by_icp(a, b, notes))
    return path.place(a.points), path.place(b.points)


def _check_overlap(a: Cloud, b: Cloud) -> None:
    ends = [np.percentile(c.points[:, :2], [1.0, 99.0], axis=0) for c in (a, b)]
    low, high = np.maximum(ends[0][0], ends[1][0]), np.minimum(ends[0][1], ends[1][1])
    if (high - low > 0.0).all():
        return
    where = [f"x {e[0][0]:.0f} to {e[1][0]:.0f}, y {e[0][1]:.0f} to {e[1][1]:.0f}" for e in ends]
    expected = (
        f"expected one place: {a.name} lies at {where[0]} m, {b.name} at {where[1]} m; --align path lays "
        "them over each other by their own paths, --field says where local metres begin"
    )
    raise InputError("--align", "pose", expected)


def _by_icp(a: Cloud, b: Cloud, notes: list[str]) -> F64:
    """Points of B moved onto those of A. InputError where what was found is not plausible."""
    try:
        import scipy.spatial  # noqa: F401  that trimesh looks neighbours up with
        from trimesh.registration import icp
    except ImportError as error:
        raise MissingExtra("mesh", "--align icp") from error
    middle = a.points.mean(axis=0)
    low, high = np.percentile(a.points, [0.5, 99.5], axis=0)
    inside = ((b.points >= low - 1.0) & (b.points <= high + 1.0)).all(axis=1)
    some = _sample(b.points[inside] - middle, 1)
    if not len(some):
        raise InputError("--align", "icp", "expected two clouds of one place: they have no point in common")
    among = _sample(a.points - middle, 0, 5 * ICP_POINTS)
    matrix, _, rest = icp(some, among, max_iterations=ICP_STEPS, reflection=False, scale=False)
    moved = np.asarray(matrix[:3, 3] + matrix[:3, :3] @ some.mean(axis=0) - some.mean(axis=0))
    turned = degrees(acos(min(1.0, max(-1.0, 0.5 * (float(np.trace(matrix[:3, :3])) - 1.0)))))
    rest = float(np.sqrt(rest))
    text = (
        f"ICP moves {b.name} by {moved[0]:.2f}, {moved[1]:.2f}, {moved[2]:.2f} m and turns it by "
        f"{turned:.2f} deg; its points then lie {rest:.2f} m (RMS) from the nearest of {a.name}"
    )
    if np.linalg.norm(moved) > ICP_MOVED_M or turned > ICP_TURNED_DEG or rest > ICP_REST_M:
        raise InputError("--align", "icp", f"expected two clouds of one place: {text}")
    notes.append(text)
    return np.asarray((b.points - middle) @ matrix[:3, :3].T + matrix[:3, 3] + middle)


def _sample(points: F64, number: int, most: int = ICP_POINTS) -> F64:
    if len(points) <= most:
        return points
    rng = Stream(1, "compare scans icp").at(number)
    return np.asarray(points[np.sort(rng.choice(len(points), most, replace=False))])
