"""Steering level `station_or_path`: a station beside another machine, or else the path of the job."""

from dataclasses import dataclass, field

from swath.control.steer.path import Params as PathParams
from swath.control.steer.path import PathSteer
from swath.control.steer.station import Params as StationParams
from swath.control.steer.station import StationSteer
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.signals import GuidancePath, GuidanceState, JobState, Odometry, PoseEstimate, SteerCommand
from swath.signals import Station as Wanted
from swath.signals.setup import ControlSetup


@dataclass(frozen=True)
class Params:
    """station: as of level `station`; path: as of level `path`"""

    station: StationParams = field(default_factory=StationParams)
    path: PathParams = field(default_factory=PathParams)


class StationOrPath(KeepsState):
    """Both laws go along all the time; the job says which leads."""

    kept = ("_path",)
    inputs = (
        Port("station", Wanted),
        Port("pose", PoseEstimate),
        Port("odometry", Odometry),
        Port("path", GuidancePath, optional=True),
        Port("job", JobState),
    )
    outputs = (Port("command", SteerCommand), Port("guidance", GuidanceState))

    def __init__(self, params: Params, setup: ControlSetup) -> None:
        self._station, self._path = StationSteer(params.station, setup), PathSteer(params.path, setup)

    def reset(self, stream: Stream) -> Outputs:
        """Straight on."""
        self._station.reset(stream)
        return self._path.reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The wanted curvature, valid at t + dt."""
        job: JobState = inputs["job"]
        made = dict(self._path.step(t, dt, inputs))
        if job.by_station:
            made |= self._station.step(t, dt, inputs)
        command = made["command"]
        assert isinstance(command, SteerCommand)
        self._path.was_commanded(command.curvature)
        return made


LEVEL = Level(
    StationOrPath,
    Params,
    summary="a station beside another machine, or the path of the job, as the job says",
    cost="about 90 us per step",
    tolerance="against the differential equation of `station` within 2 cm; beside none as `path`",
)
