"""What the parts of a machine that touch the world are given: field, machine, what stands around."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.field.field import Field
from swath.field.grain import GrainReceiver, GroundReceiver
from swath.field.memory_layout import Solids
from swath.field.projection import Origin
from swath.field.solids import merge, moved
from swath.field.track import EdgeShape
from swath.signals.setup import MachineGeometry


class Bodies:
    """The bodies of all machines by name, where they stand now. One such list is shared by all sites.

    Whoever moves a machine places it anew after every step, and after `load`.
    """

    def __init__(self) -> None:
        self._solids: dict[str, Solids] = {}
        self._poses: dict[str, Pose] = {}
        self._starts: dict[str, Pose] = {}

    def add(self, name: str, solids: Solids, pose: Pose) -> None:
        """A machine's solids in its own frame, and where it starts."""
        self._solids[name] = solids
        self._poses[name] = self._starts[name] = pose

    def remove(self, name: str) -> None:
        """Take one away; nothing where there is none of that name."""
        self._solids.pop(name, None)
        self._poses.pop(name, None)

    def place(self, name: str, pose: Pose) -> None:
        """Move a machine. Raises InputError for a name that was not added."""
        if name not in self._solids:
            raise InputError("machine", name, f"expected one of {', '.join(sorted(self._solids)) or 'none'}")
        self._poses[name] = pose

    def others(self, name: str) -> Solids:
        """Solids of all machines but one, in the world."""
        rest = sorted(n for n in self._solids if n != name)
        return merge(*(moved(self._solids[n], self._poses[n]) for n in rest))

    def reset(self) -> None:
        """All of them where they were added."""
        self._poses = {name: self._starts[name] for name in self._poses}

    def save(self) -> dict[str, Any]:
        """Where all machines stand."""
        return {n: np.vstack([p.position, p.rotation]) for n, p in self._poses.items()}

    def load(self, state: dict[str, Any]) -> None:
        """Put all machines back."""
        for name, rows in state.items():
            self.place(name, Pose(np.array(rows[0]), np.array(rows[1:])))


@dataclass(frozen=True)
class SiteSetup:
    """What a component of the machine or a sensor may know, the truth included.

    field: the one truth; machine: data-sheet geometry; start: pose_world_machine at t = 0
    edge_side: `left` or `right`, the end of the header that follows the edge
    period [s] of the component; name: of the machine; obstacles: in the world; bodies: of all machines
    base: folder that relative file names start from
    origin: where on Earth the world's origin lies, if that is known
    edge: line of the initial edge that the machine follows, such as `field.edges["west"].shape`
    grain_receiver: takes what the machine's tank is emptied into; None = the ground
    """

    field: Field
    machine: MachineGeometry
    start: Pose
    edge_side: str
    period: float
    name: str = ""
    obstacles: Solids = dataclasses.field(default_factory=Solids)
    bodies: Bodies = dataclasses.field(default_factory=Bodies)
    base: Path = dataclasses.field(default_factory=Path)
    origin: Origin | None = None
    edge: EdgeShape | None = None
    grain_receiver: GrainReceiver | None = None

    @property
    def receiver(self) -> GrainReceiver:
        """Whoever takes the grain that leaves the machine."""
        return GroundReceiver(self.field) if self.grain_receiver is None else self.grain_receiver

    def solids(self) -> Solids:
        """Everything hard that this machine's sensors can see: obstacles and the other machines."""
        return merge(self.obstacles, self.bodies.others(self.name))
