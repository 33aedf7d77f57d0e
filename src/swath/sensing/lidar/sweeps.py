"""Sweeps of the scanners of many worlds: from the states of the machines between two of them to rows."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from swath.compiled import Compiled
from swath.core.component import KeepsState, State
from swath.core.errors import SwathError
from swath.core.random import Stream
from swath.core.rows import Room, row_of
from swath.core.together import Samples
from swath.kernels import Repeated, of_worlds
from swath.rays.bodies import pack_canopy
from swath.rays.single.buffers import CLAMPED, MISPLACED
from swath.sensing.sweep import ROOM
from swath.signals import MachineState, Scan, ScanTruth, WindowState


class Sweeps(Compiled):
    """The scanners of a slot in all worlds, which have the same beams; a level says what these meet.

    near: [m] farther away the level has to be asked where a machine is, see `take_states`
    """

    hears: ClassVar = {"state": MachineState}
    near: ClassVar = float("inf")

    def __init__(self, parts: Sequence[Any]) -> None:
        n, first = len(parts), parts[0]
        count, echoes = len(first.azimuth), first.scanner.echo_count
        room = len(first.rays.beams.distance)  # beams for which there is memory
        scanned = dict.fromkeys(("ranges", "intensity"), Room((count, echoes), room))
        hit = {"points": Room((count, echoes, 3), room), "sensor_position": Room((count, 3), room)}
        alike = {"beam_t": first.scanner.beam_t, "azimuth": first.azimuth, "elevation": first.elevation}
        scan, truth = row_of(Scan, n, rooms=scanned, alike=alike), row_of(ScanTruth, n, rooms=hit)
        sent = {"scan": scan, "truth": truth}
        if first.scanner.window is not None:
            sent["window"] = row_of(WindowState, n)
        super().__init__(n, sent)
        self.parts: Sequence[Any] = parts
        self.arrays = {
            name: row.roomy(name, room) for row, names in ((scan, scanned), (truth, hit)) for name in names
        }
        self.words = np.zeros((n, 3), np.uint64)
        self.states, self.last = np.zeros((n, ROOM, 13)), np.zeros((n, 13))
        self.counts, self.swept = np.zeros(n, np.int32), np.zeros(n, np.int64)
        self.laid_at, self.looked_at = np.zeros((n, 2)), np.zeros(n, np.int32)
        self._flags = np.zeros((n, 1), np.int32)
        self._swinging = [part for part in parts if part.scanner.noise.angle != 0.0]
        self._lit = [part.scanner for part in parts if part.scanner.is_lit]

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Empty scans."""
        self.last[:, 0] = -1.0
        for world, (part, stream) in enumerate(zip(self.parts, streams, strict=True)):
            part.rays.lie_in(
                *(array[world] for array in self.arrays.values()),
                words=self.words[world],
                flags=self._flags[world],
            )
            part.swept = self.swept[world : world + 1]
            part.begin(stream)
            part.rays.aims_as(self.parts[0].rays)
            if (window := part.scanner.window) is not None:
                self.sent["window"].put(world, window.told)
        for array in self.arrays.values():
            array[:] = np.nan
        self._launches = None  # which know the bias of the instances
        self.looked_at[:] = 1
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """The states of the machines between two sweeps, the beams, what these meet, the scans."""
        from swath.sensing.native.kernel import report_sweeps
        from swath.sensing.native.sweep_kernel import aim_sweeps, take_states

        aimed, canopies, beams, electronics = self._scanners()
        trail, states = self.heard["state"], self.states.reshape(self.worlds, -1)
        heard = self.clock, self.needs, self.active, trail.head, trail.stamps, trail.memory["pose"]
        own = self.last, states, self.counts, self.words, self.swept, self.laid_at
        is_asked = int(bool(self._swinging or self._lit))
        found = [
            self.launch(take_states, *heard, *own, self.near, is_asked),
            self.launch(aim_sweeps, self.clock, self.active, states, self.counts, aimed, beams),
            *self.casts(canopies, beams),
            self.launch(report_sweeps, self.needs, self.active, electronics, beams, self.looked_at),
        ]
        self._cast, self._reported = len(found) - 2, len(found) - 1
        return found

    @abstractmethod
    def casts(self, *scanners: Any) -> Sequence[Repeated]:
        """The launches that find what beams meet. scanners: `Canopy`, `Beams` of all worlds."""

    def supply(self, stage: int) -> None:
        """Before a sweep how its beams swing, and the light; then what is said of beams and scans."""
        end = int(self.clock[1])
        if stage == 0:
            for part in self._swinging:
                part.rays.swing(end)
            for scanner in self._lit:
                scanner.see_light(end)
        elif stage == self._cast:
            self._take_flags()
        elif stage == self._reported:
            self._take_scans()

    def save(self, world: int) -> State:
        """Where a scanner was last, and what it keeps."""
        return {**KeepsState.save(self.parts[world]), "last": self.last[world].copy()}

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        KeepsState.load(self.parts[world], state)
        self.last[world] = state["last"]
        self.looked_at[:] = 1

    def _scanners(self) -> list[Any]:
        """What kernels know of them: `Aiming`, `Canopy`, `Beams`, `Electronics`."""
        from swath.rays.single.kernel import Beams, Canopy
        from swath.sensing.native.kernel import Aiming, Electronics

        packed: dict[Any, Any] = {}
        kinds = Aiming, Canopy, Beams, Electronics
        held: list[tuple[Any, ...]] = []
        for part in self.parts:
            rays, library = part.rays, part.setup.field.library
            about = id(part.table), *part.beam.values(), library.row_spacing, library.density_max
            if about not in packed:
                packed[about] = pack_canopy(part.table, part.setup.field, **part.beam)
            held.append((rays.aiming(), packed[about], rays.beams.struct(), rays.electronics()))
        self._held = held
        return [of_worlds(kind, own) for kind, own in zip(kinds, zip(*held, strict=True), strict=True)]

    def _take_flags(self) -> None:
        for world in np.flatnonzero(self._flags[:, 0]).tolist():
            part = self.parts[world]
            found = part.rays.beams.take_flags()
            try:
                if found & MISPLACED:
                    part.check_origins()
                part.note(found >> CLAMPED)
            except SwathError as error:
                self.errors[world] = error

    def _take_scans(self) -> None:
        """Beams drop out."""
        scan, truth = self.sent["scan"].arrays, self.sent["truth"].arrays
        for world in np.flatnonzero((self.looked_at != 0) & self.active).tolist():
            scanner, ranges = self.parts[world].scanner, scan["ranges"][world]
            if (lost := scanner.seen(int(self.clock[1]), ranges)) is not None:
                for array in (ranges, scan["intensity"][world], truth["points"][world]):
                    array[lost] = np.nan
            self.looked_at[world] = scanner.looks
