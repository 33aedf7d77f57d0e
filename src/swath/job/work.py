"""A job from its file to its result, at one of its levels."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.job.contact import PairClearance
from swath.job.digest import digest_of
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.fleet import FleetFile
from swath.job.kinematic import Kinematic
from swath.job.lands import plan_field
from swath.job.machines import Fleet, fleet_of
from swath.job.motion import Motion
from swath.job.plan import FieldPlan, Shared
from swath.job.plan_files import plan_from_file
from swath.job.recorded import read_day, recorded_plan
from swath.job.spread import Spread
from swath.job.standoff import Standoff
from swath.job.swept import SweptGround, swept_ground, track_along
from swath.job.timeline import STATES, Timeline
from swath.machine.fuel import DIESEL

Array = NDArray[np.float64]
SHARED_OUT = "passes were shared out among combines before the job"
ShareOut = Callable[[FleetFile, FieldPlan, Fleet], Shared]
LEVELS: dict[str, type[Events] | type[Kinematic]] = {"events": Events, "kinematic": Kinematic}


@dataclass(frozen=True)
class MachineResult:
    """way [m], fuel [kg], times [s] by state, loads: poured (combine) or brought (cart) [kg]."""

    name: str
    kind: str
    timeline: Timeline
    way: float
    fuel: float
    grain: float
    loads: int

    @property
    def times(self) -> dict[str, float]:
        """State -> time [s]."""
        return {state: self.timeline.time(state) for state in STATES}


@dataclass(frozen=True)
class JobResult:
    """What a job comes to. duration [s]; area [m2]; grain at the truck, lost [kg]; pass_times: begin, end
    [s].

    field_efficiency: area over what the combines could cut with the full header at the speed that the crop
    allows in the time that they took, without turns, unloading and waiting
    contacts: of all pairs of driven machines; standoffs: of driven machines, and who made room
    ground: that their knives went over, and swept: that passes driven exactly would; digest: see
    `saved.digest_of`; spread: of the duration, where it was asked for
    """

    level: str
    file: FleetFile
    plan: FieldPlan
    machines: tuple[MachineResult, ...]
    duration: float
    harvest_time: float
    area: float
    grain: float
    mass_error: float
    field_efficiency: float
    pass_times: dict[int, tuple[float, float]]
    ways: tuple[Array, ...]
    notes: tuple[str, ...] = ()
    contacts: tuple[PairClearance, ...] = ()
    standoffs: tuple[Standoff, ...] = ()
    digest: str = ""
    ground: SweptGround | None = None
    planned: SweptGround | None = None
    spread: Spread | None = None

    @property
    def litres_per_ha(self) -> float:
        """Diesel of all machines [l/ha]."""
        return math.fsum(m.fuel for m in self.machines) / DIESEL / (self.area / 1e4)

    @property
    def hectares_per_hour(self) -> float:
        """Of all combines together, until the last has cut its last pass."""
        return self.area / 1e4 / (self.harvest_time / 3600.0)


def plan_of(file: FleetFile, fleet: Fleet, base: Path | None) -> FieldPlan:
    """The plan of a job's field."""
    lead = fleet.combines[0]
    header = lead.sheet.header_width
    if file.field.boundary_m is not None:
        count, echelon = len(fleet.combines), file.team.together == "echelon"
        abreast, teams = (count, 1) if echelon else (1, count)
        return plan_field(
            file.field.boundary_m, header, file.plan, pipe=lead.pipe, abreast=abreast, teams=teams
        )
    if file.field.file is not None:
        path = Path(file.field.file)
        return plan_from_file(
            path if path.is_absolute() or base is None else base / path, header, file.plan, pipe=lead.pipe
        )
    assert file.field.log is not None
    path = Path(file.field.log)
    there = base / path if base is not None and not path.is_absolute() and (base / path).exists() else path
    return recorded_plan(read_day(there, lead.limits), lead.pipe)


def work_off(
    file: FleetFile, base: Path | None = None, level: str = "events", share_out: ShareOut | None = None
) -> JobResult:
    """Run a job until the field is empty and the grain at the truck.

    share_out: says before the job which combine cuts which pass, and how it turns then; none: whoever is done
    takes the next one
    """
    fleet, motion = fleet_of(file, base), motion_of(level)
    plan = plan_of(file, fleet, base)
    if not plan.passes:
        raise InputError("plan", None, "expected at least one pass")
    job = Job(file, plan if share_out is None else share_out(file, plan, fleet), fleet, motion)
    job.run()
    made = result_of(job, level)
    return made if share_out is None else replace(made, notes=(*made.notes, SHARED_OUT))


def motion_of(level: str) -> Motion:
    """The motion of a level by its name."""
    if level not in LEVELS:
        raise InputError("--level", level, f"expected one of {', '.join(LEVELS)}, sensors")
    return LEVELS[level]()


def result_of(job: Job, level: str) -> JobResult:
    """What a finished job comes to."""
    machines = [
        MachineResult(c.spec.name, "combine", c.timeline, c.way, c.fuel, c.poured, len(c.loads))
        for c in job.combines
    ] + [
        MachineResult(
            k.spec.name, "cart", k.timeline, k.way, k.fuel, k.delivered,
            len([s for s in k.timeline.spans if s.state == "unload"]),
        )
        for k in job.carts
    ]  # fmt: skip
    area = math.fsum(c.area for c in job.combines)
    cut = math.fsum(c.cut for c in job.combines)
    held = math.fsum([c.tank for c in job.combines] + [k.grain for k in job.carts])
    harvest = max(end for _, end in job.pass_times.values())
    possible = math.fsum(
        c.spec.speed_in(job.grain_per_m2 * job.plan.width) * c.spec.sheet.header_width for c in job.combines
    )
    return JobResult(
        level, job.file, job.plan, tuple(machines), job.time, harvest, area, job.at_truck,
        mass_error=abs(job.started + cut - job.at_truck - held) / max(cut, 1.0),
        field_efficiency=area / (possible * harvest), pass_times=dict(job.pass_times),
        ways=tuple(job.ways), notes=job.plan.notes,
        contacts=tuple(job.motion.watch.pairs) if isinstance(job.motion, Kinematic) else (),
        standoffs=tuple(job.motion.standoffs) if isinstance(job.motion, Kinematic) else (),
        digest=digest_of(job), **_swept(job),
    )  # fmt: skip


def _swept(job: Job) -> dict[str, Any]:
    """Ground of the driven knives and of the planned ones; nothing where none was driven."""
    if not isinstance(job.motion, Kinematic):
        return {}
    plan, width = job.plan, job.combines[0].spec.sheet.header_width
    lines = [track_along(p.line) for p in plan.passes]
    return {
        "ground": swept_ground(job.motion.tracks, width, plan.boundary, plan.holes),
        "planned": swept_ground(lines, width, plan.boundary, plan.holes),
    }
