"""From blocks of rays to a track of the edge: where it begins, goes on, breaks off, or cannot be seen.

What a break is shows `edge_breaks`, which crop is lodged `lodging`, which edge has bites `ragged_line`.
"""

from collections import deque
from dataclasses import dataclass, replace
from math import inf, isfinite, tan

import numpy as np

from swath.control.edge.arc_track import KEPT, SAME, Arc, ArcTrack
from swath.control.edge.blocks import EDGES, Block, Found, find_edge, split
from swath.control.edge.canopy_classes import BLOCK, HEADROOM, LAYER, ROOM
from swath.control.edge.canopy_rays import EdgeFrame
from swath.control.edge.feet.canopy_feet import CanopyFeet
from swath.control.edge.feet.lodging import DENSE, Lodging
from swath.control.edge.line.broken_line import carried_on
from swath.control.edge.line.edge_breaks import LEAD, LEAST_GAIN, OUT, WIDEST, EdgeBreaks, is_sunken
from swath.control.edge.line.edge_wall import JaggedWall, Wall, WallsBehind, place_along, wall_of
from swath.control.edge.line.inner_edge import LONG
from swath.control.edge.line.near_line import DISTANCE, EdgePoints
from swath.control.edge.line.ragged_line import bite_of, ragged_line
from swath.control.edge.populations import Populations, crop_excess, overlap_of
from swath.control.edge.profile import EVENLY
from swath.core.component import KeepsState
from swath.signals import F64

LONGEST = 1.2  # m of travel of a block that says little
FIRST = 4.0  # m of travel whose rays add up while there is no edge: so far one is straight, estimated
BEGIN_GAIN = 20.0  # nat of two populations over one, at first
GATE, WIDENING = 0.28, 0.025  # m, 1/m: + WIDENING times the square of the distance unseen
BLURRED, BROAD = 0.08, 0.5  # m, deviation of a block's edge in dust from which on the gate is as wide; m
MOST_ALIKE, MORE_CROP = 0.93, 0.03  # overlap of both sides' classes; share of rays that only crop stops
HEIGHT = 0.85  # m, of a crop that was not seen yet
TALL, MANY = 0.5, 100  # of that height: echoes above are crop; so many show how high it stands
LEARNED = 0.15  # m beside the track: blocks further off teach nothing
RAGGED_M = 6.0  # m of travel over which it is seen how ragged the edge is
RELIC_M, ELSEWHERE, TURNED = 15.0, 0.8, 0.5  # m that a lost line is remembered; m, rad from it: another edge
USED = 0.9  # share of late blocks that fitted, from which on a step is one
YOUNG, RISES = 6, 0.09  # blocks that may show a false start; m by which crop rises where its front is seen
DEEP, SHALLOW = 0.2, 0.1  # m: bites that are followed no more; that are none
# of the crop's height that the wall lies to and fro, rad to the machine, m: bites, too
STEPS, PARALLEL, SLIGHT = 0.41, 0.1, 0.07
FADING, ALONG = 10.0, 0.3  # m, over which bites are forgotten; rad from the heading: beyond it is a bend
FLAT = np.array(
    [[0.2], [1.0], [0.2], [1.0]]
)  # of the counts of both sides beside lodged crop that are learned
LEAST_ABOVE = 0.3  # m between the headroom and the scanner, own choice: no share of dust is divided by less
DOUBT = 1.2  # of the swing of lodged tops: standard deviation of a block there


@dataclass(frozen=True)
class Search:
    """spread: standard deviation of where the edge begins [m]; forget: unseen for so long it is lost [m].

    spacing: of the rows that the crop stands in [m], 0 = unknown
    view: height of the scanner [m]
    """

    spread: float
    forget: float
    spacing: float = 0.0
    view: float = 0.0


class BlockTrack(KeepsState):
    """The edge in the frame at rest, from rays in its own frame.

    track, points: of the edge; populations: of the answers on both sides; feet: behind the canopy's edge
    followed: blocks since the edge began
    height: of the crop, that rays were cut with [m]; agreed: share 0..1 of late blocks that fitted
    scatter: of the blocks about the track, beyond their own variance [m2]
    blank: mean width of the strip about the edge between the rays that show it [m]
    bite: how deep the bites of the edge are [m], along which the track is smooth; 0 where it follows them
    turn_sd: standard deviation of its angle there [rad]; jagged: the wall of the edge, along it
    """

    kept = (
        "track", "points", "populations", "feet", "height", "agreed", "scatter", "blank", "followed",
        "block", "_is_broken", "_scatters", "_lost", "bite", "turn_sd", "_breaks", "_lodging",
        "jagged", "_bends", "_walls", "_headed",
    )  # fmt: skip

    def __init__(self, search: Search, block: Block | None = None) -> None:
        self._search, self.block = search, block or Block()
        self.track, self.points = ArcTrack(), EdgePoints()
        self.populations, self.feet = Populations(), CanopyFeet(search.spacing)
        self._breaks, self._lodging, self.jagged = EdgeBreaks(), Lodging(), JaggedWall()
        self._walls = WallsBehind()
        self.clear()

    def clear(self) -> None:
        """Nothing seen."""
        for part in (self.track, self.points, self.block, self.populations, self.feet):
            part.clear()
        self._breaks.clear()
        self._lodging.clear()
        self.jagged.clear()
        self._walls.clear()
        self._headed = 0.0  # heading where the block began [rad]
        self.height, self.agreed, self.scatter = HEIGHT, 0.0, 0.0
        self.blank, self.followed = 0.0, 0
        self._is_broken = False  # the last blocks showed no standing edge near the track
        # distance, scatter and variance of the wall before its block
        self._scatters: deque[tuple[float, float, float]] = deque(maxlen=KEPT)
        self.bite, self.turn_sd = 0.0, 0.0
        self._bends = float("-inf")  # distance along the edge [m] before which it says nothing of bites
        self._lost: Arc | None = None  # the track before

    def add(self, frame: EdgeFrame, at: tuple[float, float, float], stubble: float) -> None:
        """The newest scan is in the block, where the edge's frame lies as the machine sees it now.

        at: x, u [m] and heading [rad] of the machine; stubble: height of its plane over the ground [m]
        """
        if self.block.travel < BLOCK:
            return
        self._lodging.stubble = stubble
        if self.track.arc is None and self._is_taller():
            is_done = True
        elif self.track.arc is None:
            is_done = self._begin(frame, at)
            if self.block.travel > LONGEST and not is_done:
                is_done = abs(at[2] - self._headed) > PARALLEL
                self.block.fade(min(1.0, FIRST / self.block.travel))
        elif self.followed < YOUNG and self._is_front():
            is_done = self._begin_anew(frame, at)
        else:
            is_done = self._go_on(self.track.arc, frame, at)
        if is_done:
            self.block.clear()
            self._headed = at[2]

    def _is_taller(self) -> bool:
        """Most of an unseen crop stands higher than it was taken to: it counts up to there now."""
        rays = self.block.answers
        echoes = rays["height"][rays["stands"] > 0.0]
        echoes = echoes[echoes > TALL * self.height]
        if len(echoes) < MANY or np.median(echoes) < HEADROOM * self.height:
            return False
        top = float(np.percentile(echoes, 90.0))
        is_taller, self.height = top > self.height, max(top, self.height)
        return is_taller

    def _begin(self, frame: EdgeFrame, at: tuple[float, float, float]) -> bool:
        """Look for two populations anywhere near the header end."""
        place, gain, crop, stubble = split(self.block, 0.0, self._search.spread)
        is_edge = gain > BEGIN_GAIN and overlap_of(crop, stubble) < MOST_ALIKE
        if not (is_edge and crop_excess(crop, stubble) > MORE_CROP):
            return False
        if self._is_another(frame, place, at):
            return False
        self._lost = None
        self.populations.begin(self.block.sides(place))
        self.height = self._crop_height()
        c, s = float(np.cos(frame.angle)), float(np.sin(frame.angle))
        along = self.block.along
        x, u = frame.x + c * along - s * place, frame.u + s * along + c * place
        c, s = float(np.cos(at[2])), float(np.sin(at[2]))
        self.points.clear()
        self._walls.clear()
        self.followed, self.bite, self._bends = 0, 0.0, float("-inf")
        self.track.begin(Arc(at[0] + c * x - s * u, at[1] + s * x + c * u, at[2] + frame.angle, 0.0))
        return True

    def _begin_anew(self, frame: EdgeFrame, at: tuple[float, float, float]) -> bool:
        """What the edge began with was none, or another."""
        self.track.clear()
        self._begin(frame, at)
        return True

    def _is_front(self) -> bool:
        """The crop rises from block to block: what is seen is its front, from a headland before it."""
        now = self.populations.height_of(self.block.sides(0.0)[0])
        return now > self.height + RISES

    def _is_another(self, frame: EdgeFrame, place: float, at: tuple[float, float, float]) -> bool:
        """An edge that lies beside the line just lost is not that edge, but the far wall of a hole."""
        if self._lost is None or self.block.of("lost") > RELIC_M:
            return False
        old = self._lost.frame(*at)
        beside = frame.u + place - old.u - (frame.x + self.block.along - old.x) * tan(old.angle)
        return abs(old.angle) < TURNED and abs(beside) > ELSEWHERE

    def _go_on(self, arc: Arc, frame: EdgeFrame, at: tuple[float, float, float]) -> bool:
        """A block is full: where is its edge? False when it needs more rays."""
        block, heading = self.block, at[2]
        ratios = self._ratios()
        found = self._find(arc, ratios)
        wide = self._step_out(found, arc, heading, ratios)
        if wide is not None:
            found, self.bite = wide, -wide.beside
        is_near = found.lead < LEAD
        if self.followed < YOUNG and not (is_near and found.gain >= LEAST_GAIN) and self._begin(frame, at):
            return True
        if found.gain < LEAST_GAIN and is_near and block.travel < LONGEST:
            return False
        self.followed += 1
        self.populations.move(block.travel)
        angle, wall = arc.angle - heading, wall_of(block.answers, found.beside, block.alike)
        along = place_along(wall, self._middle, angle)
        is_blind = found.blank > EVENLY * BLURRED or found.variance > BROAD**2  # it may lie anywhere there
        swing = self._lodging.swing(block, found.beside, self.populations, angle)
        if swing > 0.0 and abs(found.beside) < swing + 0.1:
            self._pass_lodged(found, along, swing)
        elif found.gain >= LEAST_GAIN and is_near and not (is_blind or self._is_hole(found, arc)):
            self._accept(found, along, heading, wall)
        else:
            broke = not is_near or self._is_hole(found, arc)
            if broke:
                self._breaks.broke_off(found.best)
            self._miss(along, broke=broke)
            self._follow_inner(found, is_inside=broke)
        self._bend_away(found)
        self.height = self._crop_height()
        return True

    def _find(self, arc: Arc, ratios: F64) -> Found:
        """The edge of the block within the gate, which shall not cut off what the block says."""
        bites, row = self.bite + OUT if self.bite > 0.0 else 0.0, self.feet.spacing
        gate = min(WIDEST, max(GATE + WIDENING * arc.unseen**2, bites)) + row  # where rows end it steps
        haze, known = self.block.haze, inf
        if haze[np.abs(EDGES[:-1]) <= BROAD].any():
            known = float(arc.ahead(self.block.travel).covariance[0, 0]) + self._noise
        found = find_edge(self.block, ratios, gate, known)
        is_cut_off = found.variance > BLURRED**2 and found.lead < LEAD and gate < BROAD
        return find_edge(self.block, ratios, BROAD, known) if is_cut_off else found

    def _ratios(self) -> F64:
        """Of the classes, as `find_edge` takes them: dust is as thick in the crop as it is above it."""
        haze = self.block.haze
        above = max(self._search.view - HEADROOM * self.height - ROOM, LEAST_ABOVE)
        return self.populations.ratios(haze * LAYER / above if haze.any() else None)

    def _step_out(self, found: Found, arc: Arc, heading: float, ratios: F64) -> Found | None:
        """A step outward beside a line that fitted so far, along the machine."""
        is_used = self.followed >= YOUNG and arc.unseen < 1.0 and self.bite == 0.0 and not self.feet.spacing
        if not (is_used and abs(arc.angle - heading) < ALONG):
            return None
        return self._breaks.step_out(found, self.block, ratios)

    def _is_hole(self, found: Found, arc: Arc) -> bool:
        is_even = self.agreed > USED and self.bite == 0.0
        return self._breaks.is_hole(found, arc, self.scatter, self.feet.spacing, is_even=is_even)

    @property
    def _middle(self) -> float:
        """Middle of the block's rays along the track [m]."""
        return self.block.along if isfinite(self.block.along) else self.block.travel

    def _accept(self, found: Found, along: float, heading: float, wall: Wall) -> None:
        self._breaks.fits(found.beside)
        self._lodging.stands(self.block, found.beside, self.populations)
        if abs(found.beside) < LEARNED:
            self.populations.add(self.block.sides(found.beside))
        self.track.advance(along)
        edge = self.track.arc
        assert edge is not None
        self.points.add(*edge.beside(found.beside), found.variance, edge.distance)
        own, noise = 0.0, self._noise
        if self._is_broken:  # what the track drifted by across the hole is not the edge's
            self.points.found_again(edge.distance)
            own = float(edge.covariance[0, 0])
        is_dense, was_broken = self.populations.heights()[2] > DENSE, self._is_broken
        self._is_broken = is_dense and is_sunken(self.block, found, self.height)
        self.blank += min(1.0, self.block.travel / RAGGED_M) * (found.blank - self.blank)
        self._scatters.append((edge.distance, self.scatter, self.jagged.variance))
        more = max(0.0, found.beside**2 - found.variance - own)
        self.scatter += min(1.0, self.block.travel / RAGGED_M) * (more - self.scatter)
        self.track.accept(found.beside, found.variance + noise)
        angle = edge.angle - heading
        if not (was_broken or self._is_broken):
            self.jagged.add(wall, self._middle, angle, self.block.travel)
        if is_dense and not self.feet.spacing and isfinite(wall.along) and self.followed >= YOUNG:
            self._walls.add(edge.distance, edge.angle, wall.along - along)
        self._smooth(heading)
        self._turn_away()
        self.agreed += 0.2 * (1.0 - self.agreed)
        self.feet.learn(self.block, found.beside, self.height, angle, edge.angle)

    @property
    def _noise(self) -> float:
        """Of blocks about the line, beyond their own variance [m2]; of rows, whole ones come and go."""
        return self.scatter + self.feet.spacing**2 / 12.0

    def _smooth(self, heading: float) -> None:
        """Along an edge with bites the track goes on as their outer line."""
        arc = self.track.arc
        assert arc is not None
        rows = self.points.rows[self.points.rows[:, DISTANCE] >= self._bends]
        bite = max(bite_of(rows, arc), self.bite * (1.0 - self.block.travel / FADING))
        is_known = self.bite > 0.0 and bite > SHALLOW
        angle = abs(arc.angle - heading)
        deep = max(DEEP, 0.5 * self.feet.spacing)  # of rows, whole ones are missing or none
        has_steps = self.jagged.swing(self.height) > STEPS * self.height and not self.feet.spacing
        if has_steps and angle < PARALLEL and bite > SLIGHT:
            bite = max(bite, deep)
        self.bite = bite if is_known or (bite >= deep and angle < ALONG) else 0.0
        if self.bite > 0.0:
            self.track.arc, self.turn_sd = ragged_line(self.points.rows, arc, heading)

    def _turn_away(self) -> None:
        """Where the edge has turned away, what was seen of its begin lies at its wall."""
        arc = self.track.arc
        if arc is None or self.bite > 0.0:
            self._walls.clear()
            return
        moves = self._walls.moves(arc.angle)
        if len(moves):
            self.points.move(moves)
            self.track.retrace(float(moves[:, 0].min()), self.points.rows, self._noise)

    def _bend_away(self, found: Found) -> None:
        """What seemed bites may be the begin of a bend: from there on the track follows its blocks again."""
        arc, has_bites = self.track.arc, self.bite > 0.0 and not self._lodging.is_lodged
        distance = (
            self._breaks.bends_away(found, arc.distance, has_bites=has_bites) if arc is not None else None
        )
        if distance is None:
            return
        self.track.retrace(distance, self.points.rows, self._noise)
        self.bite, self._bends = 0.0, distance
        self.jagged.clear()
        while self._scatters and self._scatters[-1][0] >= distance:
            _, self.scatter, _ = self._scatters.pop()

    def _miss(self, along: float, *, broke: bool) -> None:
        """The block shows no edge here; where it shows one elsewhere, the last blocks are doubted too."""
        arc = self.track.arc
        assert arc is not None
        self._is_broken = self._is_broken or broke
        if broke:
            self._walls.clear()
        if broke and self.bite == 0.0:
            self._take_back()
        self.track.advance(along)
        self.agreed *= 0.8
        arc = self.track.arc
        beside = LONG if self._breaks.inner.is_seen else 0.0
        if arc is not None and arc.unseen > self._search.forget + beside:
            self._lost, self.block.row["lost"] = arc, 0.0
            self.track.clear()

    def _follow_inner(self, found: Found, *, is_inside: bool) -> None:
        """Another edge goes on beside a line that broke off: the line is held until that must be the edge."""
        arc = self.track.arc
        if not self._breaks.follow(found, arc, is_inside=is_inside):
            return
        assert arc is not None
        line = self._breaks.inner.line()
        if line is not None:
            self._step_to(arc, *line)
        elif self._breaks.inner.is_seen:
            self.points.add(arc.x, arc.u, found.best**2, arc.distance)

    def _step_to(self, arc: Arc, beside: float, angle: float) -> None:
        """The edge stepped into the crop: `beside` the arc [m], at an angle to it [rad]."""
        rows = self._breaks.inner.rows
        self.points.doubt(float(rows[0, 4]))
        for x, u, variance, distance in rows[:, 1:].tolist():
            self.points.add(x, u, variance, distance)
        self.points.found_again(float(rows[0, 4]))
        self.track.begin(Arc(*arc.beside(beside), arc.angle + angle, 0.0, distance=arc.distance))
        self._is_broken = False
        self._breaks.stepped()

    def _take_back(self) -> None:
        """The last blocks were already wrong: what they did to the track and its scatter goes."""
        if self.track.arc is None or self.track.arc.unseen >= 1.0 or not self._scatters:
            return
        arc, last = carried_on(
            self.points.rows, self.track.arc, min(scatter for _, scatter, _ in self._scatters)
        )
        self.track.rewind(arc, last)
        distance = last + SAME
        self.points.doubt(distance)
        while self._scatters and self._scatters[-1][0] >= distance:
            _, self.scatter, self.jagged.variance = self._scatters.pop()

    def _pass_lodged(self, found: Found, along: float, swing: float) -> None:
        """Lodged crop shows an edge that may lie as far off as its tops: the line goes on, less sure."""
        lodging = self._lodging
        self._walls.clear()
        if lodging.lies():
            self._take_back()
            self.bite = 0.0
        self._is_broken = True
        self.track.advance(along)
        assert self.track.arc is not None
        unseen, doubt = self.track.arc.unseen, (DOUBT * swing) ** 2
        top = lodging.first_metre(self.block, found.beside, self.populations)
        if found.gain >= LEAST_GAIN and isfinite(top):  # of flat crop, what stands out is the wall behind it
            # the tops of all lie off alike: together worth one
            self.track.accept(found.beside, lodging.blocks * doubt + found.variance, turns=False)
        arc = self.track.arc
        self.points.add(arc.x, arc.u, doubt, arc.distance)
        self.populations.add(FLAT * self.block.sides(0.0))
        self.track.arc = replace(arc, unseen=min(unseen, 0.5 * self._search.forget))

    def _crop_height(self) -> float:
        height = self.populations.top()
        return min(max(height, 0.15), 2.5) if isfinite(height) else HEIGHT
