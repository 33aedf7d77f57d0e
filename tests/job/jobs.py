"""Jobs for tests: a rectangular field, and one machine of each kind unless told otherwise."""

from copy import deepcopy
from dataclasses import replace

from swath.job.digest import digest_of
from swath.job.engine import Job
from swath.job.events import Events
from swath.job.fleet import (
    FORMAT,
    CartSettings,
    CombineSettings,
    FieldSettings,
    FleetFile,
    TeamSettings,
    TruckSettings,
    UnloadSettings,
)
from swath.job.lands import PlanSettings
from swath.job.machines import fleet_of
from swath.job.plan import FieldPlan
from swath.job.work import plan_of, result_of

RECTANGLE = [(0.0, 0.0), (600.0, 0.0), (600.0, 300.0), (0.0, 300.0)]


def job_file(
    combines=1, carts=1, combine=None, cart=None, plan=None, truck=None, unload=None, team=None, **field
):
    """A job file; the named arguments are keys of its sections."""
    field = {"boundary_m": RECTANGLE, **field}
    mode = {} if carts else {"mode": "standing"}
    return FleetFile(
        format=FORMAT,
        field=FieldSettings(**field),
        combines={f"combine_{i}": CombineSettings(**(combine or {})) for i in range(combines)},
        carts={f"cart_{i}": CartSettings(**(cart or {})) for i in range(carts)},
        plan=PlanSettings(**(plan or {})),
        truck=TruckSettings(**(truck or {})),
        unload=UnloadSettings(**{**mode, **(unload or {})}),
        team=TeamSettings(**(team or {})),
    )


def finished(file, plan=None, motion=None, beside=None):
    """A job that has run. plan: instead of that of the file; beside: of all its passes, for what it tests."""
    fleet = fleet_of(file)
    plan = plan or plan_of(file, fleet, None)
    if beside is not None:
        plan = with_beside(plan, beside)
    job = Job(file, plan, fleet, motion or Events())
    job.run()
    return job


def digests_of_copied(file, plan, at):
    """Digests of a job that goes on as a copy from a time [s], and of the same one not copied."""
    whole = Job(file, plan, fleet_of(file), Events())
    whole.run(at)
    again = deepcopy(whole)
    again.run()
    whole.run()
    return digest_of(again), digest_of(whole)


def with_beside(plan: FieldPlan, beside):
    return replace(plan, passes=tuple(replace(p, cart_beside=beside) for p in plan.passes))


def result(file, **changes):
    return result_of(finished(file, **changes), "events")
