"""Sweeps of the scanners of many worlds: from the states of the machines between two of them to rows."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from swath.compiled import Compiled
from swath.core.component import KeepsState, Outputs, State
from swath.core.errors import SwathError
from swath.core.random import Stream
from swath.core.rows import Room, row_of
from swath.core.together import Samples
from swath.kernels import Repeated, repeatable, shared
from swath.sensing.scanner import ScanningLidar
from swath.sensing.sweep import ROOM
from swath.signals import MachineState, Scan, ScanTruth, WindowState


class Sweeps(Compiled):
    """The scanners of a slot in all worlds, which have the same beams; Python makes each scan."""

    hears: ClassVar = {"state": MachineState}

    def __init__(self, parts: Sequence[Any], room: int = 0) -> None:
        n, first = len(parts), parts[0]
        count, echoes = len(first.azimuth), first.scanner.echo_count
        room = max(room, count)  # beams for which there is memory
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
        self.laid_at = np.zeros((n, 2))

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Empty scans."""
        self.last[:, 0] = -1.0
        for world, (part, stream) in enumerate(zip(self.parts, streams, strict=True)):
            part.begin(stream)
            if (window := part.scanner.window) is not None:
                self.sent["window"].put(world, window.told)
        for array in self.arrays.values():
            array[:] = np.nan
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """The states of the machines; `supply` makes the scans."""
        return [self.taking(float("inf"), is_asked=True)]

    def taking(self, most: float, *, is_asked: bool) -> Repeated:
        """The launch that takes the states between two sweeps, see `take_states`."""
        from swath.sensing.native.profile_kernel import take_states

        trail, flat = self.heard["state"], self.states.reshape(self.worlds, -1)
        heard = self.clock, self.needs, trail.head, trail.stamps, trail.memory["pose"]
        own = self.last, flat, self.counts, self.words, self.swept, self.laid_at
        return repeatable(
            take_states, [*map(shared, (*heard, *own)), most, int(is_asked)], threads=self.worlds
        )

    def supply(self, stage: int) -> None:
        """The sweeps that end now, every beam from where the sensor was at its own time."""
        end = int(self.clock[1])
        for world in np.flatnonzero(self.active).tolist():
            part, count = self.parts[world], int(self.counts[world])
            try:
                outputs: Outputs = part.scan_from(
                    end, *part.scanner.sweep.of(self.states[world, :count], end)
                )
            except SwathError as error:
                self.errors[world] = error
                continue
            for output, sample in outputs.items():
                self.sent[output].put(world, sample)

    def save(self, world: int) -> State:
        """Where a scanner was last, and what it keeps."""
        return {**KeepsState.save(self.parts[world]), "last": self.last[world].copy()}

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        KeepsState.load(self.parts[world], state)
        self.last[world] = state["last"]


def beams_of(part: ScanningLidar) -> tuple[bytes, ...]:
    """The times and directions of its beams, which are the same in all worlds that go in step, and whether it
    says something of its window.
    """
    beams = part.scanner.beam_t, part.azimuth, part.elevation
    return (*(np.asarray(a).tobytes() for a in beams), bytes(part.scanner.window is not None))
