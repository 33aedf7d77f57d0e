"""Sections of a scenario that are the same whatever levels it chooses, and faults of what a slot sends."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, model_validator

from swath.documents.validation import NAME_PATTERN, STRICT, WIRE_PATTERN

Seconds = Annotated[float, Field(ge=0, le=1e6)]
Share = Annotated[float, Field(ge=0, le=100)]
LONGEST_SUMMARY = 500  # characters
Windows = list[tuple[Seconds, Seconds]]
ByField = dict[str, Annotated[float, Field(ge=-1e6, le=1e6)]]


class Section(BaseModel):
    """What takes only the keys that it has."""

    model_config = STRICT


class FaultSection(Section):
    """A fault of a slot's output: first the values, then held, lost and late samples."""

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


Metres = Annotated[float, Field(ge=-1e6, le=1e6)]


class Head(Section):
    """Name, summary and seed."""

    name: Annotated[str, Field(pattern=NAME_PATTERN, description="default: the file's name")]
    summary: Annotated[str, Field(max_length=LONGEST_SUMMARY, description="one line")] = ""
    seed: Annotated[int, Field(ge=0, lt=1 << 63, description="of every random stream")] = 1


class Run(Section):
    """How long a run lasts: it ends at whichever limit comes first."""

    distance_m: Annotated[
        float, Field(gt=0, le=1e6, description="driven by a machine that cuts; without one, by any [m]")
    ] = 120.0
    max_duration_s: Annotated[float, Field(gt=0, le=1e6, description="simulated time [s]")] = 120.0
    record: Annotated[
        Literal["none", "thinned", "standard", "exact", "full"],
        Field(
            description="none: summary.json alone; standard: run.mcap with a message of every sample; exact: "
            "and the samples bit for bit; full: and the scans' truth too; thinned: as exact, few messages"
        ),
    ] = "exact"
    on_contact: Annotated[
        Literal["end", "note"], Field(description="a machine touched something: the run ends, or goes on")
    ] = "end"


class RealTime(Section):
    """A run in step with the clock on the wall. Without the section a run goes as fast as it can."""

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


class Bounds(Section):
    """Bounds of a value; both included."""

    min: Annotated[float | None, Field(description="smallest value that passes")] = None
    max: Annotated[float | None, Field(description="largest value that passes")] = None

    @model_validator(mode="after")
    def _has_a_bound(self) -> "Bounds":
        if self.min is None and self.max is None:
            raise ValueError("expected min, max or both")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError("expected min <= max")
        return self


Distance = Annotated[float, Field(ge=0, le=1e6)]
WINDOW = "from_m", "to_m", "from_s", "to_s", "after", "before", "within_m", "within_s"  # keys of a limit


class Speciality(Section):
    """What a limit of an example is there to show: without it the limit's value is another one."""

    without: Annotated[
        list[Annotated[str, Field(pattern=r"^[^=\s]+=.+$")]],
        Field(min_length=1, description="changes that take it away, as `--set` takes them"),
    ]
    by: Annotated[float, Field(gt=0, description="least change of the limit's value that they make")]
    run_m: Annotated[
        float, Field(gt=0, le=20, description="both are driven so far: `--set run.distance_m` [m]")
    ] = 20.0


class Limit(Bounds):
    """Bounds of a metric, or with `hold` of a column of the tracks, in the whole run or a window of it."""

    hold: Annotated[
        Literal["always", "eventually"] | Annotated[float, Field(gt=0, le=1)] | None,
        Field(description="of a column: at every sample, at one, or for this share of the time"),
    ] = None
    while_: Annotated[
        dict[str, Bounds], Field(alias="while", description="only samples at which these columns are so")
    ] = {}
    because: Annotated[
        str | None,
        Field(description="of a count of events: only those because of this obstacle, by its name or kind"),
    ] = None
    from_m: Annotated[Distance | None, Field(description="window: from this distance driven on [m]")] = None
    to_m: Annotated[Distance | None, Field(description="window: up to this distance driven [m]")] = None
    from_s: Annotated[Distance | None, Field(description="window: from this time on [s]")] = None
    to_s: Annotated[Distance | None, Field(description="window: up to this time [s]")] = None
    after: Annotated[
        str | None,
        Field(description="window: from the end of each event of this kind; from_ counts from it"),
    ] = None
    before: Annotated[
        str | None, Field(description="window: up to each event of this kind, as long as within_ says")
    ] = None
    within_m: Annotated[
        Distance | None, Field(description="how far from the event the window reaches [m]")
    ] = None
    within_s: Annotated[
        Distance | None, Field(description="how long before or after the event the window lasts [s]")
    ] = None
    speciality: Annotated[
        Speciality | None, Field(description="what an example is there to show, and how to take it away")
    ] = None

    @model_validator(mode="after")
    def _has_a_window(self) -> "Limit":
        within = self.within_m is not None or self.within_s is not None
        begin = self.from_m is not None or self.from_s is not None
        end = self.to_m is not None or self.to_s is not None
        if self.after and self.before:
            raise ValueError("expected after or before, not both")
        if within and not (self.after or self.before):
            raise ValueError("expected after or before with within_m and within_s; without, to_m and to_s")
        if end and (self.after or self.before):
            raise ValueError("expected within_m or within_s with an event, instead of to_m and to_s")
        if self.before and (begin or not within):
            raise ValueError("expected within_m or within_s with before, and neither from_m nor from_s")
        for low, high in ((self.from_m, self.to_m), (self.from_s, self.to_s),
                          (self.from_m, self.within_m), (self.from_s, self.within_s)):  # fmt: skip
            if low is not None and high is not None and low > high:
                raise ValueError("expected a window that begins before it ends")
        return self

    def plain(self) -> dict[str, Any]:
        """Give the keys as a file would have them."""
        written = self.model_dump(mode="json", exclude_none=True, by_alias=True)
        return {key: value for key, value in written.items() if value != {}}

    @property
    def window(self) -> dict[str, Any]:
        """The keys of the window that are set."""
        return {key: value for key, value in self.plain().items() if key in WINDOW}

    @property
    def rule(self) -> dict[str, Any]:
        """The keys that are set of what has to hold in the window."""
        return {k: v for k, v in self.plain().items() if k not in (*WINDOW, "speciality")}


class StartAlongEdge(Section):
    """Start on the nominal edge, heading along it."""

    along_edge_m: Annotated[Metres, Field(description="of the header end from the edge's start [m]")] = 0.0
    offset_m: Annotated[
        float, Field(ge=-100, le=100, description="of the header end, to the left of the edge [m]")
    ] = 0.0
    heading_error_deg: Annotated[
        float, Field(ge=-90, le=90, description="against the edge's direction, to the left [deg]")
    ] = 0.0


class StartPose(Section):
    """Start at a place in the world, the middle of the fixed axle."""

    x_m: Annotated[Metres, Field(description="east [m]")]
    y_m: Annotated[Metres, Field(description="north [m]")]
    heading_deg: Annotated[
        float, Field(ge=-360, le=360, description="of the forward axis, from east to the left [deg]")
    ] = 0.0


class GeoPlace(Section):
    """Where on Earth the world's origin lies (WGS 84)."""

    latitude_deg: Annotated[float, Field(ge=-80, le=84, description="within the zones of UTM [deg]")]
    longitude_deg: Annotated[float, Field(ge=-180, le=180, description="east of Greenwich [deg]")]
    height_m: Annotated[float, Field(ge=-1000, le=10_000, description="of z = 0 above the ellipsoid [m]")] = (
        0.0
    )


ConeIndex = Annotated[float, Field(ge=100, le=10_000)]


class WetSpot(Section):
    """A round place of softer soil."""

    x_m: Annotated[Metres, Field(description="of its middle, east [m]")]
    y_m: Annotated[Metres, Field(description="of its middle, north [m]")]
    radius_m: Annotated[float, Field(gt=0, le=1000, description="of the spot [m]")]
    cone_index_kpa: Annotated[ConeIndex, Field(description="strength of its soil [kPa]")] = 400.0


class SoilSection(Section):
    """Ground that gives way under wheels; without the section it is firm. docs/explanation/machine.md."""

    cone_index_kpa: Annotated[
        ConeIndex, Field(description="strength of the soil: 450 soft, 900 tilled, 1200 firm, 1800 hard [kPa]")
    ] = 1200.0
    file: Annotated[str | None, Field(description="GeoTIFF of it in kPa; cone_index_kpa beyond the map")] = (
        None
    )
    wet_spots: Annotated[list[WetSpot], Field(description="where it is softer")] = []
    ruts: Annotated[bool, Field(description="whether wheels leave ruts that sensors and wheels meet")] = True
    pass_exponent: Annotated[
        float, Field(ge=1, le=10, description="a of depth ~ passes^(1/a): 2-3 loose, 4-5 firm soil [1]")
    ] = 3.0


class FieldCommon(Section):
    """What the field takes beside its parts."""

    seed: Annotated[
        int | None,
        Field(ge=0, lt=1 << 63, description="of terrain and stand alone; default: that of the run"),
    ] = None
    state_file: Annotated[
        str | None,
        Field(description="what earlier runs left of this field, written by swath run --save-field"),
    ] = None
    soil: Annotated[SoilSection | None, Field(description="strength of the soil; default: firm ground")] = (
        None
    )
    origin: Annotated[
        GeoPlace | None, Field(description="where a made field lies on Earth; an imported one knows")
    ] = None


class SlotCommon(Section):
    """What every slot of a machine takes beside its level's own keys."""

    rate_hz: Annotated[float, Field(gt=0, le=10_000, description="how often it runs [Hz]")]
    offset_ms: Annotated[float, Field(ge=0, le=1e6, description="when its first step begins [ms]")] = 0.0
    latch: Annotated[bool, Field(description="see only samples from before the tick")] = False
    wires: Annotated[
        dict[str, Annotated[str, Field(pattern=WIRE_PATTERN)]],
        Field(description="input: slot.output, or machine.slot.output; overrides the slot's own"),
    ] = {}
    peer: Annotated[
        str | None,
        Field(description="of a slot that hears another machine: which one; default: that of the machine"),
    ] = None
    fault: Annotated[
        FaultSection | None,
        Field(description="errors of what it sends: docs/explanation/obstacles.md"),
    ] = None
    mount_error: Annotated[
        ByField | None,
        Field(description="keys of the sensor's `mount`: how far off it really sits, unknown to control"),
    ] = None
    device: Annotated[
        str | None,
        Field(description="address at which it is served as a device: docs/how-to/devices.md"),
    ] = None


BodyPlace = Annotated[float, Field(ge=-50, le=50)]


class BodySection(Section):
    """The shape of a machine from the user's own file."""

    file: Annotated[str, Field(description="URDF, SDF, or a mesh (OBJ, PLY, STL, GLB; extra mesh)")]
    x_m: Annotated[
        BodyPlace, Field(description="the file's origin ahead of the middle of the fixed axle [m]")
    ] = 0.0
    y_m: Annotated[BodyPlace, Field(description="the file's origin to the left of it [m]")] = 0.0
    z_m: Annotated[BodyPlace, Field(description="the file's origin above the ground [m]")] = 0.0
    heading_deg: Annotated[
        float, Field(ge=-360, le=360, description="the file's x axis to the left of ahead [deg]")
    ] = 0.0
    scale: Annotated[float, Field(gt=0, le=1e4, description="on top of the unit")] = 1.0
    unit: Annotated[
        Literal["m", "cm", "mm", "inch"], Field(description="of a mesh; URDF and SDF are in m")
    ] = "m"
    up: Annotated[
        Literal["x", "y", "z"] | None,
        Field(description="axis of a mesh that points up; default: y in GLB, else z"),
    ] = None
    header: Annotated[
        str | None,
        Field(description="link, or part of a mesh, that the header lifts with all that hangs on it; header"),
    ] = None
    reflectance: Annotated[float, Field(gt=0, le=1, description="at 905 nm, diffuse")] = 0.3


class MachineCommon(Section):
    """What a machine section takes beside its slots."""

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
    peer: Annotated[
        str | None, Field(description="name of the machine that it works with: its slot `peer_link` hears it")
    ] = None
    body: Annotated[
        BodySection | None,
        Field(description="its shape from your own file: docs/reference/scenario.md; default: boxes"),
    ] = None
