"""The files of a job: results.json, picture and report."""

import json
import math
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.whole_file import new_file, write_whole
from swath.job.standoff import Standoff
from swath.job.timeline import STATES
from swath.job.work import JobResult
from swath.judge.summary import json_safe
from swath.machine.fuel import DIESEL
from swath.report.html import write_page
from swath.report.plots import as_image
from swath.tools.fleet.picture import draw

FILES = ("results.json", "job.png", "report.html", "run")


def check_target(out: Path) -> None:
    """InputError unless a folder is new, empty, or that of an earlier job."""
    if out.exists() and (not out.is_dir() or any(p.name not in FILES for p in out.iterdir())):
        raise InputError("--out", str(out), "expected a new or empty folder, or that of an earlier job")


def result_rows(r: JobResult) -> list[tuple[str, str, str]]:
    """Name, number and unit of what a job comes to."""
    cut, passes = len(r.pass_times), len(r.plan.passes)
    left = 100.0 * max(r.plan.area_left, 0.0) / r.plan.area
    rows = [
        ("until the last grain is at the truck", f"{r.duration / 3600.0:.2f}", "h"),
        *_spread_rows(r),
        ("until the last pass is cut", f"{r.harvest_time / 3600.0:.2f}", "h"),
        ("field", f"{r.area / 1e4:.2f}", "ha"),
        ("passes that are cut", f"{cut} of {passes}", ""),
        ("ground that no pass of the plan cuts", f"{left:.3f}", "%"),
        *_ground_rows(r),
        ("grain at the truck", f"{r.grain / 1000.0:.1f}", "t"),
        ("mass error, over all grain", f"{r.mass_error:.0e}", "1"),
        ("harvested per hour", f"{r.hectares_per_hour:.2f}", "ha/h"),
        ("field efficiency", f"{100.0 * r.field_efficiency:.1f}", "%"),
        ("diesel of all machines", f"{r.litres_per_ha:.1f}", "l/ha"),
    ]
    if r.contacts:
        touched = [p for p in r.contacts if p.touched > 0.0]
        rows.append(("bodies over each other", f"{math.fsum(p.touched for p in touched):.1f}", "s"))
        rows.append(("standoffs that were not solved", str(sum(bool(s.driven_on) for s in r.standoffs)), ""))
    if r.digest:
        rows.append(("digest", r.digest[:16], ""))
    return rows


def _spread_rows(r: JobResult) -> list[tuple[str, str, str]]:
    """What the duration is where speeds differ."""
    if r.spread is None:
        return []
    made = [seconds / 3600.0 for seconds in r.spread.durations]
    value = f"{min(made):.3f} to {max(made):.3f}, mean {r.spread.mean / 3600.0:.3f}"
    return [(f"the same with speeds up to {r.spread.percent:g} % off", value, "h")]


def _ground_rows(r: JobResult) -> list[tuple[str, str, str]]:
    """What the knives of driven machines went over."""
    if r.ground is None or r.planned is None:
        return []
    share = 100.0 / r.plan.area
    return [
        ("ground that no knife went over, as driven", f"{share * r.ground.left:.3f}", "%"),
        ("widest strip of it", f"{r.ground.widest:.2f}", "m"),
        ("ground that knives went over again, as driven", f"{share * r.ground.twice:.2f}", "%"),
        ("the same on the planned lines, overlap and corners", f"{share * r.planned.twice:.2f}", "%"),
    ]


def standoff_rows(r: JobResult) -> list[tuple[str, ...]]:
    """When and where two machines stood in each other's way, and who made room."""
    return [
        (f"{s.time:.0f} s", f"{s.first}, {s.second}", f"{s.x:.0f}, {s.y:.0f}", _who(s)) for s in r.standoffs
    ]


def _who(s: Standoff) -> str:
    if s.driven_on:
        return f"NOT SOLVED: {s.driven_on} drove on"
    return s.solved_by or "nobody could yet"


def contact_rows(r: JobResult) -> list[tuple[str, str, str, str]]:
    """Of each pair of driven machines: least clearance, seconds of contact, how often."""
    return [
        (f"{p.first}, {p.second}", f"{p.least:.2f}", f"{p.touched:.1f}", str(len(p.times)))
        for p in r.contacts
    ]


def machine_rows(r: JobResult) -> tuple[tuple[str, ...], list[list[str]]]:
    """Heads and rows of the times of all machines."""
    rows = [
        [
            m.name, *(f"{m.times[s] / 60.0:.1f}" for s in STATES), str(m.loads), f"{m.grain / 1000.0:.1f}",
            f"{m.way / 1000.0:.1f}", f"{m.fuel / DIESEL:.0f}",
        ]
        for m in r.machines
    ]  # fmt: skip
    return ("machine", *STATES, "loads", "grain t", "way km", "diesel l"), rows


def write_result(r: JobResult, out: Path) -> None:
    """Write the files of a job."""
    check_target(out)
    out.mkdir(parents=True, exist_ok=True)
    fig = draw(r)
    with new_file(out / "job.png") as file:
        fig.savefig(file, format="png", dpi=130, metadata={"Software": None})
    text = json.dumps(json_safe(to_dict(r)), indent=2, allow_nan=False)
    write_whole(out / "results.json", text + "\n")
    head, rows = machine_rows(r)
    write_page(
        out / "report.html",
        "fleet.html.j2",
        name=r.file.name,
        summary=r.file.summary,
        level=r.level,
        results=result_rows(r),
        head=head,
        machines=rows,
        pairs=contact_rows(r),
        image=as_image(fig, kind="png", dpi=130),
        notes=r.notes,
    )


def to_dict(r: JobResult) -> dict[str, Any]:
    """Plain numbers of a job, in SI."""
    return {
        "name": r.file.name,
        "level": r.level,
        "duration_s": r.duration,
        **({} if r.spread is None else {
            "spread": {"percent": r.spread.percent, "duration_s": list(r.spread.durations)}
        }),
        "harvest_time_s": r.harvest_time,
        "area_m2": r.area,
        "grain_kg": r.grain,
        "mass_error": r.mass_error,
        "field_efficiency": r.field_efficiency,
        "diesel_l_per_ha": r.litres_per_ha,
        "digest": r.digest,
        "notes": list(r.notes),
        **{
            key: {"once_m2": g.once, "twice_m2": g.twice, "left_m2": g.left, "widest_left_m": g.widest}
            for key, g in (("swept", r.ground), ("swept_planned", r.planned)) if g is not None
        },
        "contacts": [
            {"first": p.first, "second": p.second, "least_clearance_m": p.least, "touched_s": p.touched,
             "begin_end_s": p.times, "places_m": p.places}
            for p in r.contacts
        ],
        "standoffs": [
            {"time_s": s.time, "first": s.first, "second": s.second, "place_m": [s.x, s.y],
             "solved_by": s.solved_by or None, "driven_on": s.driven_on or None}
            for s in r.standoffs
        ],
        "machines": {
            m.name: {
                "kind": m.kind, "times_s": m.times, "way_m": m.way, "fuel_kg": m.fuel, "grain_kg": m.grain,
                "loads": m.loads, "timeline": [[s.state, s.start, s.end] for s in m.timeline.spans],
            }
            for m in r.machines
        },
        "passes": [
            {"kind": p.kind, "length_m": p.length, "area_m2": p.area, "cart_beside": p.cart_beside,
             "begin_end_s": r.pass_times.get(i)}
            for i, p in enumerate(r.plan.passes)
        ],
    }  # fmt: skip
