"""What may go wrong with what a slot sends, as a scenario says it."""

from typing import Annotated

from pydantic import BaseModel, Field, model_validator

from swath.documents.validation import STRICT

Seconds = Annotated[float, Field(ge=0, le=1e6)]
Share = Annotated[float, Field(ge=0, le=100)]
Windows = list[tuple[Seconds, Seconds]]
ByField = dict[str, Annotated[float, Field(ge=-1e6, le=1e6)]]


class FaultSection(BaseModel):
    """A fault of a slot's output: first the values, then held, lost and late samples."""

    model_config = STRICT
    scale: Annotated[ByField, Field(description="field: factor; -1 turns the sign round")] = {}
    bias: Annotated[
        ByField, Field(description="field with its unit, such as `offset_m` or `heading_deg`: added")
    ] = {}
    noise: Annotated[ByField, Field(description="field with its unit: standard deviation, white")] = {}
    stuck: Annotated[ByField, Field(description="field with its unit: the value that it always has")] = {}
    beam_loss_percent: Annotated[Share, Field(description="of the beams of a scan, others in each [%]")] = 0.0
    dead_beams_percent: Annotated[Share, Field(description="of the beams of a scan, always the same [%]")] = (
        0.0
    )
    hold_s: Annotated[
        Windows, Field(description="[from, to]: the last sample before comes again and again, stamped anew")
    ] = []
    silent_s: Annotated[Windows, Field(description="[from, to]: nothing is sent")] = []
    loss_percent: Annotated[Share, Field(description="of the samples, at random [%]")] = 0.0
    burst_ms: Annotated[
        float, Field(ge=0, le=1e6, description="samples are lost together for so long; 0: each for itself")
    ] = 0.0
    latency_ms: Annotated[
        float,
        Field(ge=0, le=60_000, description="a sample leaves so much later, at the slot's next step [ms]"),
    ] = 0.0

    @model_validator(mode="after")
    def _has_windows(self) -> "FaultSection":
        if any(first >= last for first, last in (*self.hold_s, *self.silent_s)):
            raise ValueError("expected [from, to] with from < to")
        return self
