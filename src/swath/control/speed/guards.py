"""What every speed law keeps to, beside its own wish: the crop edge is seen, and nothing is in the way."""

from dataclasses import dataclass, field

from swath.control.speed.edge_guard import EdgeGuard
from swath.control.speed.guard import Guard
from swath.control.speed.obstacle_stop import ObstacleStop, Stop
from swath.core.component import Inputs, KeepsState, Port
from swath.signals import CropEdge, GuidanceState, Objects
from swath.signals.setup import MachineGeometry

GUARD_INPUTS = (
    Port("edge", CropEdge, optional=True),
    Port("objects", Objects, optional=True),
    Port("guidance", GuidanceState, optional=True),
)


@dataclass(frozen=True, kw_only=True)
class Guarded:
    """What slows down or stops a speed law.

    guard: what it does where the edge is not confidently seen
    stop: what it does before objects on its path
    """

    guard: Guard = field(default_factory=Guard)
    stop: Stop = field(default_factory=Stop)


class Guards(KeepsState):
    """Both together; needs the inputs `edge`, `objects`, `guidance` and `odometry`, each may be missing."""

    kept = ("_edge", "_stop")

    def __init__(self, params: Guarded, machine: MachineGeometry) -> None:
        self._edge = EdgeGuard(params.guard)
        self._stop = ObstacleStop(params.stop, machine)

    def reset(self) -> None:
        """Nothing driven yet."""
        self._edge.reset()
        self._stop.reset()

    def limit(self, wanted: float, inputs: Inputs, dt: int) -> float:
        """The speed [m/s] that may be driven instead of a wanted one, over the next `dt` [ns]."""
        odometry = inputs.get("odometry")
        by_edge = self._edge.limit(wanted, inputs.get("edge"), odometry, dt, inputs.get("guidance"))
        return self._stop.limit(wanted, inputs.get("objects"), odometry, dt, by_edge)

    @property
    def reason(self) -> str:
        """Why the run ends: the machine stopped because it no longer saw the edge."""
        return self._edge.reason
