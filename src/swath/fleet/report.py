"""What a job comes to, in words, numbers and a picture: tables, results.json, report.html."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.errors import InputError
from swath.core.whole_file import check_folder, new_file, write_whole
from swath.fleet.ground import shapely_here
from swath.fleet.machines import Cart
from swath.fleet.replay import COLOURS, write_replay
from swath.fleet.worked import CUT, SHOWN, STATES, Worked, checked, litres_per_ha, used
from swath.judge.summary import json_safe
from swath.report.html import write_page
from swath.report.plots import BLUE, GREY, INK, ORANGE, STYLE, as_image, figure

FILES = ("results.json", "job.png", "report.html", "replay.html", "plan.json", "draws.json")


def check_target(out: Path) -> None:
    """Make a folder. InputError unless it is new, empty, or that of an earlier job, and can be made."""
    check_folder(out, FILES, "that of an earlier job")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("--out", str(out), f"expected a folder that can be made: {error.strerror}") from None


def result_rows(w: Worked) -> list[tuple[str, str, str]]:
    """Name, number and unit of what a job comes to."""
    plan = w.schedule.plan
    rows = [("until the last grain is at the truck", f"{w.ends / 3600.0:.2f}", "h")]
    if w.draws:
        low, high, mean = min(w.draws), max(w.draws), math.fsum(w.draws) / len(w.draws)
        value = f"{low / 3600.0:.3f} to {high / 3600.0:.3f}, mean {mean / 3600.0:.3f}"
        rows.append((f"the same in {len(w.draws)} draws", value, "h"))
    rows += [
        ("until the last pass is cut", f"{w.cut / 3600.0:.2f}", "h"),
        ("field", f"{plan.area / 1e4:.2f}", "ha"),
        ("passes", str(len(plan.passes)), ""),
        ("ground that no pass of the plan cuts", f"{100.0 * plan.left / plan.area:.3f}", "%"),
        ("grain at the truck", f"{w.schedule.delivered / 1000.0:.1f}", "t"),
        ("mass error, over all grain", f"{w.mass_error:.0e}", "1"),
        ("harvested per hour", f"{0.36 * plan.area / w.cut if w.cut else 0.0:.2f}", "ha/h"),
        ("field efficiency", f"{100.0 * w.efficiency:.1f}", "%"),
        ("diesel of all machines", f"{litres_per_ha(w):.1f}", "l/ha"),
    ]
    if w.places:
        rows.append(("most that a machine was off its path", f"{100.0 * w.stray:.1f}", "cm"))
        rows.append(("machines over each other", f"{math.fsum(w.contact.values()):.1f}", "s"))
    return rows


def machine_rows(w: Worked) -> tuple[tuple[str, ...], list[list[str]]]:
    """Heads and rows of the minutes of all machines."""
    rows, took = [], used(w)
    for name in w.spans:
        out = [p for p in w.poured if p.source == name]
        minutes = [f"{w.minutes(name, state):.1f}" for state in SHOWN]
        tons = math.fsum(p.amount for p in out) / 1000.0
        driven = f"{took[name].way / 1000.0:.1f}", f"{took[name].litres:.0f}"
        rows.append([name, *minutes, str(len(out)), f"{tons:.1f}", *driven])
    return ("machine", *SHOWN, "loads", "grain t", "way km", "diesel l"), rows


def pair_rows(w: Worked) -> list[tuple[str, str, str, str]]:
    """Which cart took grain of which combine, how often, and how much of it while the combine cut."""
    kinds = [s.kind for s in w.schedule.table.segments]
    pairs: dict[tuple[str, str], list[tuple[float, bool]]] = {}
    for p in w.poured:
        if p.target != "truck":
            pairs.setdefault((p.source, p.target), []).append((p.amount, kinds[p.during[0]] == CUT))
    rows = []
    for (source, target), loads in sorted(pairs.items()):
        grain = math.fsum(kg for kg, _ in loads)
        moving = 100.0 * math.fsum(kg for kg, on_the_go in loads if on_the_go) / max(grain, 1e-9)
        rows.append((f"{source}, {target}", str(len(loads)), f"{grain / 1000.0:.1f}", f"{moving:.0f}"))
    return rows


def wait_rows(w: Worked) -> list[tuple[str, str, str]]:
    """Machine, for what or whom it waited, minutes; the longest first."""
    rows = [(name, reason, minutes) for name in w.spans for reason, minutes in w.waited(name).items()]
    return [(n, r, f"{m:.1f}") for n, r, m in sorted(rows, key=lambda row: -row[2]) if m >= 0.05]


def to_dict(w: Worked) -> dict[str, Any]:
    """Plain numbers of a job, in SI."""
    schedule, took = w.schedule, used(w)
    return {
        "level": w.level,
        "duration_s": w.ends,
        **({"draws_s": list(w.draws)} if w.draws else {}),
        "harvest_time_s": w.cut,
        "area_m2": schedule.plan.area,
        "left_m2": schedule.plan.left,
        "grain_kg": schedule.harvested,
        "mass_error": w.mass_error,
        "field_efficiency": w.efficiency,
        "diesel_l_per_ha": litres_per_ha(w),
        "stray_m": w.stray,
        "contact_s": {", ".join(pair): s for pair, s in w.contact.items()} if w.places else None,
        "notes": checked(w),
        "poured": [
            {"from": p.source, "to": p.target, "kg": p.amount, "begin_s": p.begins, "end_s": p.ends}
            for p in w.poured
        ],
        "machines": {
            name: {
                "kind": "cart" if isinstance(schedule.machines.by_name[name], Cart) else "combine",
                "times_s": {state: 60.0 * w.minutes(name, state) for state in STATES},
                "waits_s": {reason: 60.0 * minutes for reason, minutes in w.waited(name).items()},
                "way_m": took[name].way,
                "fuel_l": took[name].litres,
                "timeline": [[s.state, s.begin, s.end, s.reason] for s in spans],
            }
            for name, spans in w.spans.items()
        },
    }


def write_result(w: Worked, name: str, summary: str, out: Path) -> None:
    """Write the files of a job."""
    check_target(out)
    out.mkdir(parents=True, exist_ok=True)
    fig = draw(w)
    with new_file(out / "job.png") as file:
        fig.savefig(file, format="png", dpi=130, metadata={"Software": None})
    text = json.dumps(json_safe({"name": name, **to_dict(w)}), indent=2, allow_nan=False)
    write_whole(out / "results.json", text + "\n")
    w.schedule.plan.write(out / "plan.json")
    write_replay(w, name, f"{summary}; level {w.level}", out)
    head, rows = machine_rows(w)
    write_page(
        out / "report.html", "fleet.html.j2", name=name, summary=summary, level=w.level,
        results=result_rows(w), head=head, machines=rows, waits=wait_rows(w), loads=pair_rows(w),
        image=as_image(fig, kind="png", dpi=130), notes=checked(w),
    )  # fmt: skip


def draw(w: Worked) -> Any:
    """Map above, timelines below."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        fig = figure(11.0, 7.6 + 0.5 * len(w.spans))
        grid = fig.add_gridspec(2, 1, height_ratios=(6.0, 0.9 + 0.5 * len(w.spans)))
        _map(fig, fig.add_subplot(grid[0]), w)
        _timelines(fig.add_subplot(grid[1]), w)
    return fig


def _map(fig: Any, ax: Any, w: Worked) -> None:
    """Field and holes, passes coloured by when they are cut, ways, waiting places."""
    import matplotlib as mpl

    ground = w.schedule.ground
    for part in shapely_here().get_parts(ground.field):
        for k, ring in enumerate([part.exterior, *part.interiors]):
            x, y = ground.frame.to_map(np.asarray(ring.coords)).T
            ax.fill(x, y, color="white" if k else "#F7F4EC", ec=INK, lw=1.0, zorder=0)
    shades = mpl.colormaps["viridis"]
    cuts: dict[str, list[tuple[float, float]]] = {
        name: [(s.begin, s.end) for s in spans if s.state == CUT] for name, spans in w.spans.items()
    }
    machines = w.schedule.machines.by_name
    shown: set[str] = set()
    for name in w.spans:
        planned = [s for s in w.schedule.table.segments if s.machine == name]
        towed = isinstance(machines[name], Cart)
        for s in planned:
            rows = s.path.track.places[s.path.first[s.index] : s.path.last[s.index] + 1]
            x, y = ground.frame.to_map(rows[:, :2]).T
            if s.kind == CUT:
                ax.plot(x, y, color=shades(0.92 * s.into / max(w.ends, 1.0)), lw=1.6)
                continue
            label = "ways of carts" if towed else "ways of combines"
            ax.plot(
                x, y, color=ORANGE if towed else GREY, lw=0.5, zorder=1,
                label=None if label in shown else label,
            )  # fmt: skip
            shown.add(label)
    x, y = ground.frame.to_map(np.array([ground.truck_place[:2]]))[0]
    ax.plot([x], [y], marker="s", ms=8, color=BLUE, ls="none", label="truck")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=4)
    ax.set_aspect("equal")
    ax.grid(visible=False)
    ax.set(xlabel="east [m]", ylabel="north [m]")
    last = max((end for spans in cuts.values() for _, end in spans), default=1.0)
    scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, last / 3600.0), shades)
    fig.colorbar(scale, ax=ax, label="cut after [h]", shrink=0.8, pad=0.01)


def _timelines(ax: Any, w: Worked) -> None:
    """A bar per machine."""
    for row, spans in enumerate(w.spans.values()):
        for state in SHOWN:
            bars = [(s.begin / 3600.0, (s.end - s.begin) / 3600.0) for s in spans if s.shown == state]
            ax.broken_barh(bars, (row - 0.36, 0.72), color=COLOURS[state], lw=0)
    for state in SHOWN:
        ax.barh([0], [0], color=COLOURS[state], label=state)
    ax.set_yticks(range(len(w.spans)), list(w.spans))
    ax.invert_yaxis()
    ax.set(xlabel="time [h]", xlim=(0.0, w.ends / 3600.0))
    ax.grid(visible=False)
    ax.legend(ncol=5, loc="lower left", bbox_to_anchor=(0.0, 1.0))
