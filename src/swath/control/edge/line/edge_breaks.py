"""Where an edge breaks off: into a hole of the crop, outward at the next tooth, or inward for good."""

from math import sqrt

from swath.control.edge.arc_track import Arc
from swath.control.edge.blocks import Block, Found, find_edge
from swath.control.edge.line.inner_edge import InnerEdge
from swath.control.edge.populations import middle_of
from swath.core.component import KeepsState
from swath.signals import F64

LEAST_GAIN = 6.0  # nat of an edge over none, in a block
LEAD = 5.0  # nat by which a place outside the gate shows that the edge broke off
WIDEST = 0.8  # m beside the track that a gate may reach
FLANK, RAGGEDS = 0.17, 3.0  # m inward, or of the scatter: a step
CHANCE = 4.0  # standard deviations of block and line, within which a step is none
HOLE, NEARER = 0.3, 0.5  # m inward from which on an edge beside a line that broke off is a hole's; part of it
OUT = 0.2  # m: a step outward
SUNKEN = 0.25  # of the crop's height
BENDS, NOISE, GROWS = 3, 0.03, 0.08  # blocks, m between two, m in all: crop stands out ever further
STAYS = 2.0  # m along which all crop stands out: no tooth


class EdgeBreaks(KeepsState):
    """What is seen beside a line that broke off. inner: the edge that goes on there."""

    kept = ("_hole", "_beside", "_outside", "inner")

    def __init__(self) -> None:
        self.inner = InnerEdge()
        self.clear()

    def clear(self) -> None:
        """Nothing seen."""
        self._hole = float("nan")  # beside a line that broke off: where another edge was seen [m]
        self._beside = 0.0  # the track: the last block that fitted [m]
        # beside a line along bites [m], distance along it [m]: the last blocks, ever further outside
        self._outside: tuple[tuple[float, float], ...] = ()
        self.inner.clear()

    def fits(self, beside: float) -> None:
        """A block's edge lies on the line, `beside` it [m]."""
        self._hole, self._beside = float("nan"), beside
        self.inner.clear()

    def broke_off(self, best: float) -> None:
        """Another edge is seen, `best` beside the line [m]."""
        self._hole = best

    def stepped(self) -> None:
        """The line goes on at the edge that was seen beside it."""
        self._hole = float("nan")
        self.inner.clear()

    def is_hole(self, found: Found, arc: Arc, scatter: float, row: float, *, is_even: bool) -> bool:
        """The edge steps into the crop, or still stands where it was seen when the line broke off.

        Steps outward are left to the gate: behind a tooth, crop that stands out is the edge.

        scatter: of the blocks about the line [m2]; row: of the crop to the next one [m], where one ends in a
        bend across them the edge steps; is_even: they fitted it, and the edge has no bites
        """
        inward = found.beside if found.lead < LEAD else found.best
        if self._hole > 0.0:
            return inward > max(HOLE, row, NEARER * self._hole)
        own = sqrt(found.variance + float(arc.covariance[0, 0]))  # thin stands show a block less well
        return (
            is_even and arc.unseen < 1.0 and inward > max(FLANK, row, RAGGEDS * sqrt(scatter), CHANCE * own)
        )

    def step_out(self, found: Found, block: Block, ratios: F64) -> Found | None:
        """Crop stands out beside a line that fitted so far: the edge has bites, and here it is, outside.

        ratios: of the classes, as `find_edge` takes them
        """
        if not (self._beside > -0.5 * OUT and -WIDEST <= found.best < -OUT):
            return None
        wide = find_edge(block, ratios, WIDEST)
        is_one = wide.gain >= LEAST_GAIN and wide.lead < LEAD and wide.beside < -OUT
        return wide if is_one else None

    def bends_away(self, found: Found, distance: float, *, has_bites: bool) -> float | None:
        """Distance along a line of bites from which the edge leaves it outward, far or for long [m], or None.

        Bites come back to the line: of teeth and saws of up to 0.6 m single blocks lie so far outside it.
        """
        beside = found.beside if found.lead < LEAD else found.best
        if not has_bites or beside > -OUT or found.gain + found.lead < LEAST_GAIN:
            self._outside = ()
            return None
        before = self._outside if self._outside and beside < self._outside[-1][0] + NOISE else ()
        self._outside = (*before, (beside, distance))
        first, since = self._outside[0]
        if len(self._outside) < BENDS or (beside > first - GROWS and distance < since + STAYS):
            return None
        self._outside = ()
        return since

    def follow(self, found: Found, arc: Arc | None, *, is_inside: bool) -> bool:
        """Another edge goes on beside the line: whether one is seen."""
        if arc is None or not is_inside or found.gain + found.lead < LEAST_GAIN:
            self.inner.clear()
            return False
        self.inner.add(found.best, arc.beside(found.best), found.variance, arc.distance)
        return True


def is_sunken(block: Block, found: Found, height: float) -> bool:
    """Behind the edge the rays end lower than further in: they go on over a hole to its far wall.

    height: of the crop [m]
    """
    near, inner = block.two_strips(found.beside)
    return middle_of(inner) - middle_of(near) > SUNKEN * height
