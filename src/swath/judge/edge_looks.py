"""What stands on lines across machines at the time of each reported edge, looked up by compiled code."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from swath.compiled import Compiled
from swath.core.blocks import Blocks
from swath.core.rows import Row, Trail, row_of
from swath.field.edges.present_edge import SIDE_M, STEP_M
from swath.field.field import Field
from swath.field.memory_layout import MOVED
from swath.judge.evaluator import EvaluatorSetup
from swath.judge.waking import times_of
from swath.kernels import Repeated, filled, of_worlds
from swath.signals import F64, CropEdge, MachineState

FAR_M = 8.0  # an edge this near to the header end may be detected
COUNT = round(2.0 * (FAR_M + SIDE_M) / STEP_M)  # steps of a line across the machine
ROOM = 32  # edges of a world that are noted between two looks, more at the cost of a look in between
LOOK, WAIT, TAKE = 1, 2, 3  # what a launch asks for: what stands, another state, that rows are taken
POOLS = ("table", "table_x", "table_y", "cut_slot", "cut", "tile_stand")  # of pages, that are read
# what is noted of a sample, beside its time and the distance, its place and the begin of the line
REPORTED = ("reference_x", "offset", "confidence", "is_held", "offset_sd")


class EdgeLooks(Compiled):
    """Lines across machines, one in each world, looked along whenever its edge is sent.

    reference: x of the line, the newest that was reported [m]
    rows: (worlds, ROOM, 16) t, distance, REPORTED but the reference; x, y of the header end at the reference,
        then at the knife, then the machine's y axis and its x axis in the world, then the begin of the line
    crop: (worlds, ROOM, 1, COUNT) whether it stands at the middles of the steps
    counts: how many there are
    asks: what could not be done; waits: 1 = the truth has to be asked for the time of an edge
    """

    reads: ClassVar = {"edge": CropEdge, "state": MachineState}

    def __init__(self, setups: Sequence[EvaluatorSetup]) -> None:
        n = len(setups)
        super().__init__(n, {})
        self._setups = setups
        self.rows, self.crop = np.zeros((n, ROOM, 16)), np.zeros((n, ROOM, 1, COUNT), np.bool_)
        self.counts, self.asks, self.waits = np.zeros((3, n), np.int32)
        self.reference = np.zeros(n)

    def launches(self) -> Sequence[Repeated]:
        """One launch."""
        from swath.field.cutting.land_kernel import Land
        from swath.field.edges.profile_kernel import Profile
        from swath.judge.look_kernel import Across, look_across

        n, edge, state = self.worlds, self.given["edge"], self.given["state"]
        self._machines = [_known_of(setup) for setup in self._setups]
        kinds = Across, Land, Profile
        structs = [of_worlds(kind, [own[k] for own in self._machines]) for k, kind in enumerate(kinds)]
        self._structs = [array.numpy() for array in structs]  # the same memory
        own = self.asks, self.waits, self.reference, np.zeros((n, 1, 2)), np.zeros((n, 2))
        found = np.zeros((n, 1), np.int32), np.zeros(n, np.int32), self.rows, self.crop, self.counts
        reported = (self.column("edge", name) for name in REPORTED)
        place = times_of(state), state.arrays["pose"], state.arrays["distance"]
        given = self.needs, self.active, *structs, times_of(edge), *reported, *place
        return [self.launch(look_across, *given, *own, *found)]

    def supply(self, stage: int) -> None:
        """Look where compiled code could not: it knows what was missing from then on."""
        for world in (self.asks == LOOK).nonzero()[0].tolist():
            setup, n = self._setups[world], self.counts[world]
            _, width = span_across(setup)
            bx, by, _, _, x, y = self.rows[world, n, 10:].tolist()
            self.crop[world, n] = setup.field.standing_along([(x, y)], (bx * width, by * width), COUNT)
            self.counts[world] += 1
            self._machines[world] = _known_of(setup)
            for array, struct in zip(self._structs, self._machines[world], strict=True):
                array[world] = struct.numpy_value()

    def take(self, world: int) -> tuple[F64, NDArray[np.uint8]]:
        """Rows of a world, and packed what stood."""
        n, self.counts[world] = int(self.counts[world]), 0
        return self.rows[world, :n].copy(), np.packbits(self.crop[world, :n, 0], axis=1)

    def look_at(self, edge: Sequence[float], place: Sequence[float]) -> None:
        """Look in the only world. edge: t [ns] and REPORTED; place: row of `States`."""
        if self._launches is None:
            state = row_of(MachineState, 1, ("pose", "distance"))
            self.link({"edge": row_of(CropEdge, 1, REPORTED), "state": state}, {}, self.clock)
        reported, state = self.given["edge"], self.given["state"]
        reported.stamp[0] = state.stamp[0] = edge[0]
        reported.memory[0] = tuple(edge[1:])
        state.memory[0] = tuple(place[:12]), place[12]
        self.go()


class LooksOfAll(EdgeLooks):
    """The same for judges of many worlds: what was seen is theirs at the next look.

    blocks: what was sent since then
    """

    blocks: Blocks

    def __init__(self, judges: Sequence[Any]) -> None:
        super().__init__([judge.setup for judge in judges])
        self._judges = judges

    def link(self, rows: Mapping[str, Row], trails: Mapping[str, Trail], clock: NDArray[np.int64]) -> None:
        """Go on where the judges are."""
        self.reference[:] = [judge.reference for judge in self._judges]
        self.waits[:] = [judge.is_waiting for judge in self._judges]
        super().link(rows, trails, clock)

    def supply(self, stage: int) -> None:
        """Also ask the truth for the times of edges; take rows where there is no room for more."""
        super().supply(stage)
        edge = self.given["edge"]
        for world in (self.asks == WAIT).nonzero()[0].tolist():
            self.tell(world)
            judge, t = self._judges[world], times_of(edge)
            reported = [t[world % len(t)], *(edge.number(world, name) for name in REPORTED)]
            judge.wait(list(map(float, reported)), self.blocks.waiting(world, MachineState, judge.setup.name))
            self.reference[world], self.waits[world] = judge.reference, judge.is_waiting
        for world in (self.counts == ROOM).nonzero()[0].tolist():
            self.tell(world)

    def look(self) -> None:
        """Tell all judges."""
        for world in self.counts.nonzero()[0].tolist():
            self.tell(world)

    def tell(self, world: int) -> None:
        """Tell one of them what was seen for it."""
        if self.counts[world]:
            self._judges[world].add(*self.take(world), float(self.reference[world]))


def span_across(setup: EvaluatorSetup) -> tuple[float, float]:
    """Where a line across a machine begins, on the cut side, and its step, y in the machine frame [m]."""
    machine = setup.machine
    end_y = float(machine.geometry.header_end(machine.edge_side)[1])
    begin = end_y + (1.0 if machine.edge_side == "left" else -1.0) * (FAR_M + SIDE_M)
    return begin, (2.0 * end_y - begin - begin) / COUNT


def _known_of(setup: EvaluatorSetup) -> tuple[Any, Any, Any]:
    """What the kernel knows of a machine and its field as it lies in memory now."""
    from swath.field.cutting.land_kernel import Land
    from swath.field.edges.profile_kernel import Profile
    from swath.judge.look_kernel import Across

    (begin, width), field = span_across(setup), setup.field
    knife_x, end_y = setup.machine.geometry.header_end(setup.machine.edge_side)[:2]
    line = {"begin": begin, "width": width, "end_y": end_y, "knife_x": knife_x}
    if not isinstance(field, Field):  # another truth, which is asked itself
        return filled(Across, counters=np.zeros(MOVED + 1, np.int64), moved=-1, **line), Land(), Profile()
    line |= {"turn": field.to_stand([1.0, 0.0], [0.0, 1.0])[0].tolist(), "cell": field.maker.cell}
    held = {"counters": field.store.counters, "moved": int(field.store.counters[MOVED])}
    if field.profile is not None:
        return filled(Across, has_profile=1, **held, **line), Land(), field.profile.struct()
    pools = {name: getattr(field.pages, name) for name in POOLS}
    return filled(Across, **held, **line), filled(Land, **pools), Profile()
