"""From blocks of rays to a track of the edge: where it begins, goes on, breaks off, or cannot be seen."""

from collections import deque
from dataclasses import dataclass, replace
from math import isfinite, tan

import numpy as np

from swath.control.edge.arc_track import KEPT, Arc, ArcTrack
from swath.control.edge.blocks import Block, Found, find_edge, split
from swath.control.edge.canopy_classes import LIMIT
from swath.control.edge.canopy_feet import OBLIQUE, CanopyFeet
from swath.control.edge.canopy_rays import EdgeFrame, RayAnswers
from swath.control.edge.inner_edge import LONG, InnerEdge
from swath.control.edge.near_line import EdgePoints
from swath.control.edge.populations import Populations, crop_excess, middle_of, overlap_of
from swath.control.edge.ragged_line import bite_of, ragged_line
from swath.core.component import KeepsState

BLOCK, LONGEST = 0.4, 1.2  # m of travel of a block, and of one that says little
LEAST_GAIN = 6.0  # nat of an edge over none, in a block
BEGIN_GAIN = 20.0  # nat of two populations over one, at first
LEAD = 5.0  # nat by which a place outside the gate shows that the edge broke off
GATE, WIDENING, WIDEST = 0.28, 0.025, 0.8  # m, 1/m, m: + WIDENING times the square of the way unseen
MOST_ALIKE, MORE_CROP = 0.93, 0.03  # overlap of both sides' classes; share of rays that only crop stops
HEIGHT = 0.85  # m, of a crop that was not seen yet
LEARNED = 0.15  # m beside the track: blocks further off teach nothing
STRAIGHTEN = 0.3  # part of the bend that is kept where the edge broke off
UNEVEN = 0.12  # m, by which the ground's level may change over 8 blocks
TALL, LOW_SHARE, LOW_STEP = 0.5, 0.94, 0.03  # m, [1], m: crop lower than this share less this step is lodged
RAGGED_M = 6.0  # m of travel over which it is seen how ragged the edge is
SUNKEN = 0.25  # of the crop's height
MAT = 0.3  # m inside the track: there crop that lies flat is looked for
RELIC_M, ELSEWHERE, TURNED = 15.0, 0.8, 0.5  # m that a lost line is remembered; m, rad from it: another edge
FLANK, RAGGEDS, USED = 0.17, 3.0, 0.9  # m inward, or of the scatter: a step; of a line that fitted so often
CHANCE = 4.0  # standard deviations of block and line, within which a step is none
HOLE, NEARER = 0.3, 0.5  # m inward from which on an edge beside a line that broke off is a hole's; part of it
YOUNG, RISES = 6, 0.09  # blocks that may show a false start; m by which crop rises where its front is seen
OUT, DEEP, SHALLOW = 0.2, 0.2, 0.1  # m: a step outward; bites that are followed no more; that are none
FADING, ALONG = 10.0, 0.3  # m, over which bites are forgotten; rad from the heading: beyond it is a bend
DOUBT = 1.2  # of the swing of lodged tops: standard deviation of a block there


@dataclass(frozen=True)
class Search:
    """spread: standard deviation of where the edge begins [m]; forget: unseen for so long it is lost [m];
    usual: height of the crop where it stands upright [m], 0 = unknown"""

    spread: float
    forget: float
    usual: float = 0.0


class BlockTrack(KeepsState):
    """The edge in the frame at rest, from rays in its own frame.

    track, points: of the edge; populations: of the answers on both sides; feet: behind the canopy's edge
    followed: blocks since the edge began
    height: of the crop, that rays were cut with [m]; agreed: share 0..1 of late blocks that fitted
    scatter: of the blocks about the track, beyond their own variance [m2]
    blank: mean width of the strip about the edge between the rays that show it [m]
    bite: how deep the bites of the edge are [m], along which the track is smooth; 0 where it follows them
    turn_sd: standard deviation of its angle there [rad]
    """

    kept = (
        "track", "points", "populations", "feet", "height", "agreed", "scatter", "blank", "followed",
        "_block", "_scans", "_is_lodged", "_lodged_blocks", "_is_broken", "_usual", "_levels", "_scatters",
        "_lost", "_rise", "_hole", "bite", "turn_sd", "_beside", "_inner",
    )  # fmt: skip

    def __init__(self, search: Search) -> None:
        self._search = search
        self.track, self.points, self._block = ArcTrack(), EdgePoints(), Block()
        self.populations, self.feet = Populations(search.usual), CanopyFeet()
        self._inner = InnerEdge()
        self.clear()

    def clear(self) -> None:
        """Nothing seen."""
        for part in (self.track, self.points, self._block, self.populations, self.feet, self._inner):
            part.clear()
        self._scans: list[RayAnswers] = []
        self.height, self.agreed, self.scatter, self._is_lodged = HEIGHT, 0.0, 0.0, False
        self.blank, self.followed, self._lodged_blocks = 0.0, 0, 0
        self._is_broken = False  # the last blocks showed no standing edge near the track
        self._usual = float("nan")  # height of the first metre of crop
        self._levels: deque[float] = deque(maxlen=8)  # of the ground, block by block
        self._rise = 0.0  # of the ground from where the crop is seen to where the stubble is [m]
        self._scatters: deque[tuple[float, float]] = deque(maxlen=KEPT)  # (way, scatter before its block)
        self.bite, self.turn_sd = 0.0, 0.0
        self._beside = 0.0  # the track: the last block that fitted [m]
        self._hole = float("nan")  # beside a line that broke off: where another edge was seen [m]
        self._lost: tuple[Arc, float] | None = None  # the track before, and how far back it was lost [m]

    def add(
        self,
        rays: RayAnswers,
        travel: float,
        frame: EdgeFrame,
        at: tuple[float, float, float],
        level: float,
        rise: float = 0.0,
    ) -> None:
        """The rays of a scan in the edge's frame, as the machine sees it from `at` x, u [m], heading [rad].

        level: of the stubble's plane at the edge [m]; rise: of the ground from where the crop is seen to
        where the stubble is, further ahead, over which heights are counted [m]
        """
        self._block.add(rays, travel)
        self._scans.append(rays)
        if self._lost is not None:
            self._lost = self._lost[0], self._lost[1] + travel
        if self._block.travel < BLOCK:
            return
        self._levels.append(level)
        self._rise = rise
        if self.track.arc is None:
            is_done = self._begin(frame, at) or self._block.travel >= LONGEST
        elif self.followed < YOUNG and self._is_front():
            is_done = self._begin_anew(frame, at)
        else:
            is_done = self._go_on(self.track.arc, frame, at)
        if is_done:
            self._block.clear()
            self._scans = []

    def _begin(self, frame: EdgeFrame, at: tuple[float, float, float]) -> bool:
        """Look for two populations anywhere near the header end."""
        place, gain, crop, stubble = split(self._block, 0.0, self._search.spread)
        is_edge = gain > BEGIN_GAIN and overlap_of(crop, stubble) < MOST_ALIKE
        if not (is_edge and crop_excess(crop, stubble) > MORE_CROP):
            return False
        if self._is_another(frame, place, at):
            return False
        self._lost = None
        self.populations.begin(*self._block.sides(place))
        self.height = self._crop_height()
        c, s = float(np.cos(frame.angle)), float(np.sin(frame.angle))
        along = self._block.along
        x, u = frame.x + c * along - s * place, frame.u + s * along + c * place
        c, s = float(np.cos(at[2])), float(np.sin(at[2]))
        self.points.clear()
        self.followed, self.bite = 0, 0.0
        self.track.begin(Arc(at[0] + c * x - s * u, at[1] + s * x + c * u, at[2] + frame.angle, 0.0))
        return True

    def _begin_anew(self, frame: EdgeFrame, at: tuple[float, float, float]) -> bool:
        """What the edge began with was none, or another."""
        self.track.clear()
        self._begin(frame, at)
        return True

    def _is_front(self) -> bool:
        """The crop rises from block to block: what is seen is its front, from a headland before it."""
        now = self.populations.height_of(self._block.sides(0.0)[0])
        return now > self.height + RISES

    def _is_another(self, frame: EdgeFrame, place: float, at: tuple[float, float, float]) -> bool:
        """An edge that lies beside the line just lost is not that edge, but the far wall of a hole."""
        if self._lost is None or self._lost[1] > RELIC_M:
            return False
        old = self._lost[0].frame(*at)
        beside = frame.u + place - old.u - (frame.x + self._block.along - old.x) * tan(old.angle)
        return abs(old.angle) < TURNED and abs(beside) > ELSEWHERE

    def _go_on(self, arc: Arc, frame: EdgeFrame, at: tuple[float, float, float]) -> bool:
        """A block is full: where is its edge? False when it needs more rays."""
        block, heading = self._block, at[2]
        bites = self.bite + OUT if self.bite > 0.0 else 0.0
        gate = min(WIDEST, max(GATE + WIDENING * arc.unseen**2, bites))
        found = find_edge(block, self.populations.ratios(), gate)
        wide = self._step_out(found, arc, heading)
        if wide is not None:
            found, self.bite = wide, -wide.beside
        is_near = found.lead < LEAD
        if self.followed < YOUNG and not (is_near and found.gain >= LEAST_GAIN) and self._begin(frame, at):
            return True
        if found.gain < LEAST_GAIN and is_near and block.travel < LONGEST:
            return False
        self.followed += 1
        self.populations.move(block.travel)
        along = block.along if np.isfinite(block.along) else block.travel
        swing = self._lodged_swing(found, arc.angle - heading)
        if swing > 0.0 and abs(found.beside) < swing + 0.1:
            self._pass_lodged(found, along, swing)
        elif found.gain >= LEAST_GAIN and is_near and not self._is_hole(found, arc):
            self._accept(found, along, heading)
        else:
            broke = not is_near or self._is_hole(found, arc)
            if broke:
                self._hole = found.best
            self._miss(along, broke=broke)
            self._follow_inner(found, is_inside=broke)
        self.height = self._crop_height()
        return True

    def _step_out(self, found: Found, arc: Arc, heading: float) -> Found | None:
        """Crop stands out beside a line that fitted so far: the edge has bites, and here it is, outside."""
        is_used = self.followed >= YOUNG and arc.unseen < 1.0 and self.bite == 0.0
        is_sudden = self._beside > -0.5 * OUT and abs(arc.angle - heading) < ALONG
        if not (is_used and is_sudden) or not -WIDEST <= found.best < -OUT:
            return None
        wide = find_edge(self._block, self.populations.ratios(), WIDEST)
        is_one = wide.gain >= LEAST_GAIN and wide.lead < LEAD and wide.beside < -OUT
        return wide if is_one else None

    def _is_hole(self, found: Found, arc: Arc) -> bool:
        """The edge steps into the crop, or still stands where it was seen when the line broke off.

        Steps outward are left to the gate: behind a tooth, crop that stands out is the edge.
        """
        inward = found.beside if found.lead < LEAD else found.best
        if self._hole > 0.0:
            return inward > max(HOLE, NEARER * self._hole)
        is_used = arc.unseen < 1.0 and self.agreed > USED and self.bite == 0.0
        own = float(np.sqrt(found.variance + arc.covariance[0, 0]))  # thin stands show a block less well
        return is_used and inward > max(FLANK, RAGGEDS * float(np.sqrt(self.scatter)), CHANCE * own)

    def _accept(self, found: Found, along: float, heading: float) -> None:
        self._is_lodged, self._hole = False, float("nan")
        self._inner.clear()
        self._remember_height(found)
        if abs(found.beside) < LEARNED:
            self.populations.add(*self._block.sides(found.beside))
        self.track.advance(along)
        edge = self.track.arc
        assert edge is not None
        x = edge.x - found.beside * float(np.sin(edge.angle))
        u = edge.u + found.beside * float(np.cos(edge.angle))
        self.points.add(x, u, found.variance, edge.way)
        own = 0.0
        if self._is_broken:  # what the track drifted by across the hole is not the edge's
            self.points.found_again(edge.way)
            own = float(edge.covariance[0, 0])
        self._is_broken = self._is_sunken(found)
        self.blank += min(1.0, self._block.travel / RAGGED_M) * (found.blank - self.blank)
        self._scatters.append((edge.way, self.scatter))
        more = max(0.0, found.beside**2 - found.variance - own)
        self.scatter += min(1.0, self._block.travel / RAGGED_M) * (more - self.scatter)
        self.track.accept(found.beside, found.variance)
        self._beside = found.beside
        self._smooth(heading)
        self.agreed += 0.2 * (1.0 - self.agreed)
        angle = edge.angle - heading
        self.feet.learn(self._scans, self._block.counts, found.beside, self._block.travel, self.height, angle)

    def _smooth(self, heading: float) -> None:
        """Along an edge with bites the track goes on as their outer line."""
        arc = self.track.arc
        assert arc is not None
        bite = max(bite_of(self.points.rows, arc), self.bite * (1.0 - self._block.travel / FADING))
        is_known = self.bite > 0.0 and bite > SHALLOW
        self.bite = bite if is_known or (bite > DEEP and abs(arc.angle - heading) < ALONG) else 0.0
        if self.bite > 0.0:
            self.track.arc, self.turn_sd = ragged_line(self.points.rows, arc, heading)

    def _miss(self, along: float, *, broke: bool) -> None:
        """The block shows no edge here; where it shows one elsewhere, the last blocks are doubted too."""
        arc = self.track.arc
        assert arc is not None
        self._is_broken = self._is_broken or broke
        if broke and arc.unseen < 1.0 and self.bite == 0.0:
            self._take_back()
        self.track.advance(along)
        self.agreed *= 0.8
        arc = self.track.arc
        beside = LONG if self._inner.is_seen else 0.0
        if arc is not None and arc.unseen > self._search.forget + beside:
            self._lost = arc, 0.0
            self.track.clear()

    def _follow_inner(self, found: Found, *, is_inside: bool) -> None:
        """Another edge goes on beside a line that broke off: the line is held until that must be the edge."""
        arc = self.track.arc
        if arc is None or not is_inside or found.gain + found.lead < LEAST_GAIN:
            self._inner.clear()
            return
        s, c = float(np.sin(arc.angle)), float(np.cos(arc.angle))
        place = arc.x - found.best * s, arc.u + found.best * c
        self._inner.add(found.best, place, found.variance, arc.way)
        line = self._inner.line()
        if line is not None:
            self._step_to(arc, *line)
        elif self._inner.is_seen:
            self.points.add(arc.x, arc.u, found.best**2, arc.way)

    def _step_to(self, arc: Arc, beside: float, angle: float) -> None:
        """The edge stepped into the crop: `beside` the arc [m], at an angle to it [rad]."""
        rows = self._inner.rows
        self.points.doubt(float(rows[0, 4]))
        for x, u, variance, way in rows[:, 1:].tolist():
            self.points.add(x, u, variance, way)
        self.points.found_again(float(rows[0, 4]))
        s, c = float(np.sin(arc.angle)), float(np.cos(arc.angle))
        x, u = arc.x - beside * s, arc.u + beside * c
        self.track.begin(Arc(x, u, arc.angle + angle, 0.0, way=arc.way))
        self._is_broken, self._hole = False, float("nan")
        self._inner.clear()

    def _take_back(self) -> None:
        """The last blocks were already wrong: what they did to the track and its scatter goes."""
        way = self.track.rewind(STRAIGHTEN, self.points.rows)
        self.points.doubt(way)
        while self._scatters and self._scatters[-1][0] >= way:
            self.scatter = self._scatters.pop()[1]

    def _lodged_swing(self, found: Found, angle: float) -> float:
        """How far the tops of a stand that has become low may have moved aside [m], 0 where it stands.

        Stems of length h whose tops are at z lean by acos(z / h), their tops lie h sin(lean) beside the feet.
        Compared is the first metre of the crop with itself before. Where the ground ahead rises or falls the
        canopy, seen nearer than the stubble, only seems to: there nothing is said.
        """
        usual, stopped = self._usual, self.populations.heights()[2]
        is_uneven = max(self._levels) - min(self._levels) > UNEVEN
        is_doubtful = is_uneven or (stopped < 0.8 and not self._is_lodged)
        if not usual > TALL or is_doubtful or abs(angle) > 3.0 * OBLIQUE:
            return 0.0
        now = self._first_metre(found)
        if np.isnan(now) and self.populations.has_mat(self._block.just_inside(MAT)):
            now = LIMIT * usual
        if not now < LOW_SHARE * usual - LOW_STEP:
            return 0.0
        return float(np.sqrt(usual**2 - now**2))

    def _is_sunken(self, found: Found) -> bool:
        """Behind the edge the rays end lower than further in: they go on over a hole to its far wall."""
        near, inner = self._block.two_strips(found.beside)
        is_dense = self.populations.heights()[2] > 0.8
        return is_dense and middle_of(inner) - middle_of(near) > SUNKEN * self.height

    def _first_metre(self, found: Found) -> float:
        return self.populations.height_of(self._block.just_inside(found.beside)) + self._rise

    def _remember_height(self, found: Found) -> None:
        now = self._first_metre(found)
        if np.isfinite(now):
            self._usual = now if np.isnan(self._usual) else self._usual + 0.1 * (now - self._usual)

    def _pass_lodged(self, found: Found, along: float, swing: float) -> None:
        """Lodged crop shows an edge that may lie as far off as its tops: the line goes on, less sure."""
        if not self._is_lodged:
            self._take_back()
            self._lodged_blocks, self.bite = 0, 0.0
        self._is_lodged = self._is_broken = True
        self.track.advance(along)
        assert self.track.arc is not None
        unseen, doubt = self.track.arc.unseen, (DOUBT * swing) ** 2
        self._lodged_blocks += 1
        is_flat = np.isnan(self._first_metre(found))  # what stands out there is the wall behind it
        if found.gain >= LEAST_GAIN and not is_flat:  # the tops of all lie off alike: together worth one
            self.track.accept(found.beside, self._lodged_blocks * doubt + found.variance, turns=False)
        arc = self.track.arc
        self.points.add(arc.x, arc.u, doubt, arc.way)
        crop, stubble = self._block.sides(0.0)
        self.populations.add(0.2 * crop, stubble)
        self.track.arc = replace(arc, unseen=min(unseen, 0.5 * self._search.forget))

    def _crop_height(self) -> float:
        height = self.populations.heights()[0]
        return min(max(height, 0.15), 2.5) if isfinite(height) else HEIGHT
