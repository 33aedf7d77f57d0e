"""The sections of a scenario file that are the same whatever levels it chooses."""

from typing import Annotated, Literal

from pydantic import BaseModel, Field, model_validator

from swath.documents.hints import NAME_PATTERN, WIRE_PATTERN
from swath.documents.validation import STRICT

Metres = Annotated[float, Field(ge=-1e6, le=1e6)]


class Head(BaseModel):
    """Name, summary and seed."""

    model_config = STRICT
    name: Annotated[str, Field(pattern=NAME_PATTERN, description="default: the file's name")]
    summary: Annotated[str, Field(max_length=500, description="one line")] = ""
    seed: Annotated[int, Field(ge=0, lt=1 << 63, description="of every random stream")] = 1


class Run(BaseModel):
    """How long a run lasts: it ends at whichever limit comes first."""

    model_config = STRICT
    distance_m: Annotated[
        float, Field(gt=0, le=1e6, description="driven by a machine that cuts; without one, by any [m]")
    ] = 120.0
    max_duration_s: Annotated[float, Field(gt=0, le=1e6, description="simulated time [s]")] = 120.0
    record: Annotated[
        Literal["standard", "exact", "full"],
        Field(description="run.mcap: standard messages; and every sample exactly; and the scans' truth too"),
    ] = "exact"
    on_contact: Annotated[
        Literal["end", "note"], Field(description="a machine touched something: the run ends, or goes on")
    ] = "end"


class RealTime(BaseModel):
    """A run in step with the clock on the wall. Without the section a run goes as fast as it can."""

    model_config = STRICT
    pace: Annotated[
        Literal["real_time", "free"], Field(description="free: as fast as it can, the section rests")
    ] = "real_time"
    factor: Annotated[float, Field(ge=0.01, le=100, description="simulated seconds per second")] = 1.0
    on_overrun: Annotated[
        Literal["fail", "slip", "degrade"],
        Field(description="stop with an error, shift the deadlines, or also take the cheaper levels listed"),
    ] = "slip"
    tolerance_ms: Annotated[
        float, Field(ge=0, le=1e5, description="lateness that is caught up; beyond it is an overrun [ms]")
    ] = 20.0
    grace_s: Annotated[
        float,
        Field(ge=0, le=1e4, description="simulated time after a start in which lateness is no overrun [s]"),
    ] = 1.0
    patience: Annotated[
        int, Field(ge=1, le=10_000, description="overruns within window_s before a cheaper level is taken")
    ] = 3
    window_s: Annotated[float, Field(gt=0, le=1e4, description="simulated time [s]")] = 2.0
    spin_ms: Annotated[float, Field(ge=0, le=100, description="busy wait before a deadline [ms]")] = 0.5
    priority: Annotated[
        int | None, Field(ge=1, le=99, description="SCHED_FIFO, asked of the system; default: not asked")
    ] = None


class Limit(BaseModel):
    """Bounds of a metric; both included."""

    model_config = STRICT
    min: Annotated[float | None, Field(description="smallest value kept")] = None
    max: Annotated[float | None, Field(description="largest value kept")] = None

    @model_validator(mode="after")
    def _has_a_bound(self) -> "Limit":
        if self.min is None and self.max is None:
            raise ValueError("expected min, max or both")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError("expected min <= max")
        return self


class StartAlongEdge(BaseModel):
    """Start on the nominal edge, heading along it."""

    model_config = STRICT
    along_edge_m: Annotated[Metres, Field(description="of the header end from the edge's start [m]")] = 0.0
    offset_m: Annotated[
        float, Field(ge=-100, le=100, description="of the header end, to the left of the edge [m]")
    ] = 0.0
    heading_error_deg: Annotated[
        float, Field(ge=-90, le=90, description="against the edge's direction, to the left [deg]")
    ] = 0.0


class StartPose(BaseModel):
    """Start at a place in the world, the middle of the fixed axle."""

    model_config = STRICT
    x_m: Annotated[Metres, Field(description="east [m]")]
    y_m: Annotated[Metres, Field(description="north [m]")]
    heading_deg: Annotated[
        float, Field(ge=-360, le=360, description="of the forward axis, from east to the left [deg]")
    ] = 0.0


class SlotCommon(BaseModel):
    """What every slot of a machine takes beside its level's own keys."""

    model_config = STRICT
    rate_hz: Annotated[float, Field(gt=0, le=10_000, description="how often it runs [Hz]")]
    offset_ms: Annotated[float, Field(ge=0, le=1e6, description="first due this long after 0 [ms]")] = 0.0
    latch: Annotated[bool, Field(description="see only samples from before the tick")] = False
    wires: Annotated[
        dict[str, Annotated[str, Field(pattern=WIRE_PATTERN)]],
        Field(description="input: slot.output, or machine.slot.output; overrides the slot's own"),
    ] = {}


class MachineCommon(BaseModel):
    """What a machine section takes beside its slots."""

    model_config = STRICT
    machine: Annotated[str, Field(description="name in data/machines, or your own YAML file")] = (
        "lexion-700-class"
    )
    header_width_m: Annotated[
        float | None, Field(ge=0.5, le=30, description="of another header on the same machine [m]")
    ] = None
    edge_side: Annotated[
        Literal["left", "right"], Field(description="the end of the header that follows the edge")
    ] = "left"
    field_edge: Annotated[
        str | None, Field(description="name of the edge that it follows, of field.edges; default: the first")
    ] = None
