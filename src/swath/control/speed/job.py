"""Speed level `job`: as fast as the job says, beside another machine as its station wants.

Along the crop edge it keeps to the edge guard; where a path leads, only to the stop before obstacles.
"""

from dataclasses import dataclass, field

from swath.control.speed.guards import GUARD_INPUTS, Guarded, Guards
from swath.control.speed.station import Params as StationParams
from swath.control.speed.station import StationSpeed
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.signals import GuidanceState, JobState, Odometry, SpeedCommand
from swath.signals import Station as Wanted
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params(Guarded):
    """station: as of level `station`"""

    station: StationParams = field(default_factory=StationParams)


class JobSpeed(KeepsState):
    """The wish of the job, less where the edge leads and is not sure."""

    kept = ("_guard",)
    inputs = (
        Port("job", JobState),
        Port("station", Wanted, optional=True),
        Port("odometry", Odometry, optional=True),
        *GUARD_INPUTS,
    )
    outputs = (Port("command", SpeedCommand),)

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._station = StationSpeed(params.station, setup)
        self._guard = Guards(params, setup.machine)

    def reset(self, stream: Stream) -> Outputs:
        """At rest."""
        self._guard.reset()
        return {"command": SpeedCommand(0, 0.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The command that is valid at t + dt."""
        job: JobState = inputs["job"]
        if job.by_station and inputs.get("station") is not None:
            return self._station.step(t, dt, inputs)
        guidance: GuidanceState | None = inputs.get("guidance")
        seen = dict(inputs)
        if not job.by_edge or (guidance is not None and guidance.is_following):
            seen["edge"] = None
        return {"command": SpeedCommand(t + dt, self._guard.limit(job.speed, seen, dt))}

    def end_reason(self, t: int) -> str:
        """Why the run ends: the machine stopped because it no longer saw the edge."""
        return self._guard.reason


LEVEL = Level(
    JobSpeed,
    Params,
    summary="as the job wants; less where the edge is not sure, none before obstacles",
    cost="20 us per step",
    tolerance="exact",
)
