"""How fast a machine may drive by what it sees of the crop edge: fast where it is sure, slowly where it is
not, not at all where it has seen nothing for some metres.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from swath.compiled import Compiled
from swath.control.speed.guard import CHOICES, Guard
from swath.core.abilities import EDGE_LOST, Ending
from swath.core.component import State
from swath.core.random import Stream
from swath.core.rows import row_of
from swath.core.together import Samples
from swath.core.units import KMH
from swath.kernels import Repeated, Rows, shared
from swath.signals import CropEdge, GuidanceState, Odometry, SpeedCommand

# of `bound_speeds`
SEEN = (
    "offset", "confidence", "curvature", "seen_to", "reference_x", "offset_sd", "other_offset",
    "other_chance",
)  # fmt: skip


class EdgeGuards(Compiled):
    """Bounds wanted speeds by the edge, in many worlds.

    wanted: (worlds,) [m/s]; blind: driven without knowing the edge [m]; reasons: why worlds are to end
    """

    reads: ClassVar = {"edge": CropEdge, "odometry": Odometry, "guidance": GuidanceState}

    def __init__(self, guards: Sequence[Guard], wanted: Sequence[float]) -> None:
        from swath.control.speed import edge_guard_kernel as kernel

        n = len(guards)
        super().__init__(n, {"command": row_of(SpeedCommand, n)})
        rows = [
            (p.blind_m, p.slow_kmh * KMH, p.sure, p.bend_m_s2, p.room_m) for p in guards
        ]  # in the order of `Limits`
        choices = [CHOICES.index(p.when_lost) for p in guards]
        limits = [(c, v, *row) for c, v, row in zip(choices, wanted, rows, strict=True)]
        self._limits, self._driven = Rows(kernel.Limits, n, limits), Rows(kernel.Driven, n)
        self.wanted, self.blind = self._limits.of["wanted"], self._driven.of["blind"]
        self.reasons: dict[int, str] = {}

    def reset(self, streams: Sequence[Stream]) -> Mapping[str, Samples]:
        """Nothing driven yet."""
        self._driven.clear()
        self.reasons.clear()
        self.sent["command"].arrays["speed"][:] = self.wanted
        return self.sent_at(0)

    def launches(self) -> Sequence[Repeated]:
        """The speeds that may be driven over the next step."""
        from swath.control.speed.edge_guard_kernel import bound_speeds

        given = [self._limits.array, self._driven.array, shared(self.clock), shared(self.needs)]
        edge = ["edge" in self.given, *(self.column("edge", name) for name in SEEN)]
        led = self.column("guidance", "is_following", otherwise=False)
        command = shared(self.sent["command"].arrays["speed"])
        given += [*edge, self.column("odometry", "speed"), led, command]
        return [self.launch(bound_speeds, *given)]

    def supply(self, stage: int) -> None:
        """Machines that stopped because they no longer saw the edge."""
        for world in np.flatnonzero(self._driven.of["is_over"]).tolist():
            known = f"none known to {self._limits.of['room'][world]:g} m"
            why = Ending(f"no crop edge seen for {self.blind[world]:.1f} m, {known}", EDGE_LOST)
            self.reasons.setdefault(world, why)

    def save(self, world: int) -> State:
        """Everything that is needed to go on exactly."""
        return {"driven": self._driven.save(world), "reason": str(self.reasons.get(world, ""))}

    def load(self, world: int, state: State) -> None:
        """Take on a state that `save` gave."""
        self._driven.load(world, state["driven"])
        self.reasons.pop(world, None)
        if state["reason"]:
            self.reasons[world] = Ending(state["reason"], EDGE_LOST)


class EdgeGuard:
    """Bounds a wanted speed by the edge, in one world."""

    def __init__(self, params: Guard) -> None:
        self._own = EdgeGuards([params], [0.0])

    def reset(self) -> None:
        """Nothing driven yet."""
        self._own.reset(())

    def limit(
        self,
        wanted: float,
        edge: CropEdge | None,
        odometry: Odometry | None,
        dt: int,
        guidance: GuidanceState | None = None,
    ) -> float:
        """The speed [m/s] that may be driven instead of a wanted one, over the next `dt` [ns].

        guidance: of steering that may follow a path instead of the edge
        """
        self._own.wanted[0] = wanted
        made = self._own.step(0, dt, {"edge": edge, "odometry": odometry, "guidance": guidance})
        return float(made["command"].arrays["speed"][0])

    @property
    def blind(self) -> float:
        """Driven without knowing the edge [m]."""
        return float(self._own.blind[0])

    @property
    def reason(self) -> str:
        """Why the run is to end, empty where it is not."""
        return self._own.reasons.get(0, "")

    def save(self) -> State:
        """Everything that is needed to go on exactly."""
        return self._own.save(0)

    def load(self, state: State) -> None:
        """Take on a state that `save` gave."""
        self._own.load(0, state)
