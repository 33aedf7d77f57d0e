"""What a job comes to, in words, numbers and pictures: tables, results.json, report.html, replay.html."""

import math
import os
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.core.files.whole_file import write_whole
from swath.core.number_text import num
from swath.documents.json_file import read_object, write_json
from swath.fleet.ground import shapely_here
from swath.fleet.machines import Cart
from swath.fleet.worked import CUT, SHOWN, STATES, WAIT, Worked, checked, grain, litres_per_ha, stays, used
from swath.replay.writer import packed, render
from swath.report import plots
from swath.report.html import Beside, Figure, Items, Section, Table, counted, write_page

Array = NDArray[np.float64]
SCRIPTS = ("data", "timeline", "job")
EVERY = 5  # samples of driven bodies, which are 0.1 s apart
NEAR = (0.05, 0.05, 0.01, 0.01)  # m, m, rad, rad that a place may be off the line between those kept
TOLD = 30.0  # s: longer waits are moments
LOADS = ("pair", "loads", "grain t", "of it while cutting %")
ABOUT_MINUTES = (
    "Field efficiency: the area over what the headers could cut at the speed that the crop allows, in the "
    "time until the last pass is cut. Minutes go until the last grain is at the truck, way and diesel until "
    "all machines are home. load: a cart while grain flows into it. Who meets a partner waits "
    "for it, or for ground that another one has; diesel of carts is an estimate."
)
ABOUT_ROUTES = (
    "Swaths of combines as wide as their headers, coloured by when they were cut; paths of carts by when."
)
DOES = plots.CROP, plots.SKY, plots.PURPLE, "#8cccb0", plots.GREEN, plots.BLUE
COLOURS = dict(zip(SHOWN, (*DOES, plots.ORANGE, "#f2a97c", "#8c2d04", plots.GREY), strict=True))


def check_target(out: Path, name: str, changes: str = "") -> None:
    """InputError for a folder with the results of another job than this, or of it with other changes."""
    kept = out / "results.json"
    has = (
        read_object(kept, "--out", "results of a job")
        if os.path.isfile(kept)
        else {"name": name, "set": changes}
    )
    if (was := (has.get("name"), has.get("set", ""))) != (name, changes):
        lies = was[0] if was[0] != name else f"{name} with {was[1] or 'no changes'}"
        expected = f"expected a new or empty folder, or an earlier {name}, not of {lies}; or --replace"
        raise InputError("--out", str(out), expected)


def result_rows(w: Worked) -> list[tuple[str, str, str]]:
    """Name, number and unit of what a job comes to."""
    plan = w.schedule.plan
    rows = [("until the last grain is at the truck", num(w.ends / 3600.0), "h")]
    if w.schedule.bound > 0.0:
        bound, plans = w.schedule.bound, len(w.schedule.compared)
        rows.append(("no plan takes less than", num(bound / 3600.0), "h"))
        rows.append(
            (
                f"more than that, best of {counted(plans, 'plan')}",
                num(100.0 * (w.ends / bound - 1.0)),
                "%",
            )
        )
    if w.draws:
        low, high, mean = min(w.draws), max(w.draws), math.fsum(w.draws) / len(w.draws)
        value = f"{num(low / 3600.0)} to {num(high / 3600.0)}, mean {num(mean / 3600.0)}"
        rows.append((f"the same in {len(w.draws)} draws", value, "h"))
    rows += [
        ("until the last pass is cut", num(w.cut / 3600.0), "h"),
        ("field", num(plan.area / 1e4), "ha"),
        ("passes", str(len(plan.passes)), ""),
        ("ground that no pass of the plan cuts", num(100.0 * plan.left / plan.area), "%"),
        ("grain at the truck", num(w.schedule.delivered / 1000.0), "t"),
        ("mass error, over all grain", num(w.mass_error), ""),
        ("harvested per hour", num(0.36 * plan.area / w.cut if w.cut else 0.0), "ha/h"),
        ("field efficiency", num(100.0 * w.efficiency), "%"),
        ("diesel of all machines", num(litres_per_ha(w)), "l/ha"),
    ]
    if w.places:
        rows.append(("most that a machine was off its path", num(100.0 * w.stray), "cm"))
        rows.append(("machines over each other", num(math.fsum(w.contact.values())), "s"))
    return rows


def hour_rows(w: Worked) -> tuple[tuple[str, ...], list[list[str]]]:
    """Heads and rows of the hours of all machines by what they went for, and their sum."""
    went = {name: w.went(name) for name in w.spans}
    rows = [
        [n, *(num(h, places=3) for h in (*of.values(), math.fsum(of.values())))] for n, of in went.items()
    ]
    return ("machine", *next(iter(went.values())), "in all"), rows


def load_rows(w: Worked) -> tuple[tuple[str, ...], list[list[str]]]:
    """Heads and rows of what all machines poured, drove and burnt."""
    rows, took = [], used(w)
    for name in w.spans:
        out = [p for p in w.poured if p.source == name]
        tons = math.fsum(p.amount for p in out) / 1000.0
        driven = num(took[name].way / 1000.0), num(took[name].litres)
        rows.append([name, str(len(out)), num(tons), *driven])
    return ("machine", "loads", "grain t", "way km", "diesel l"), rows


def machine_rows(w: Worked) -> tuple[tuple[str, ...], list[list[str]]]:
    """Heads and rows of the minutes of all machines, and of what they did."""
    (first, *head), rows = load_rows(w)
    minutes = [[num(w.minutes(name, state)) for state in SHOWN] for name in w.spans]
    return (first, *SHOWN, *head), [[r[0], *m, *r[1:]] for r, m in zip(rows, minutes, strict=True)]


def pair_rows(w: Worked) -> list[tuple[str, str, str, str]]:
    """Which cart took grain of which combine, how often, and how much of it while the combine cut."""
    kinds = [s.kind for s in w.schedule.table.segments]
    pairs: dict[tuple[str, str], list[tuple[float, bool]]] = {}
    for p in w.poured:
        if p.target != "truck":
            pairs.setdefault((p.source, p.target), []).append((p.amount, kinds[p.during[0]] == CUT))
    rows = []
    for (source, target), loads in sorted(pairs.items()):
        mass = math.fsum(kg for kg, _ in loads)
        moving = 100.0 * math.fsum(kg for kg, on_the_go in loads if on_the_go) / max(mass, 1e-9)
        rows.append((f"{source}, {target}", str(len(loads)), num(mass / 1000.0), num(moving)))
    return rows


def wait_rows(w: Worked) -> list[tuple[str, str, str]]:
    """Machine, for what or whom it waited, minutes; the longest first."""
    rows = [(name, reason, minutes) for name in w.spans for reason, minutes in w.waited(name).items()]
    return [(n, r, num(m)) for n, r, m in sorted(rows, key=lambda row: -row[2]) if m >= 0.05]


def to_dict(w: Worked) -> dict[str, Any]:
    """Plain numbers of a job, in SI."""
    schedule, took = w.schedule, used(w)
    return {
        "level": w.level,
        "duration_s": w.ends,
        **({"draws_s": list(w.draws)} if w.draws else {}),
        "bound_s": schedule.bound,
        "plans": [{"what": what, "duration_s": ends} for what, ends in schedule.compared],
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


def write_result(w: Worked, name: str, summary: str, out: Path, changes: str = "") -> None:
    """Write the files of a job. changes: of its keys, by which the folder is known."""
    plots.write_picture(out / "job.png", draw(w))
    write_json(out / "results.json", {"name": name, **({"set": changes} if changes else {}), **to_dict(w)})
    w.schedule.plan.write(out / "plan.json")
    told = f"{summary}; " if summary else ""
    write_replay(w, name, f"{told}machines at the level {w.level}", out)
    head, rows = machine_rows(w)
    notes = checked(w)
    routes = [
        Figure(f"Route of {machine}", plots.as_image(_drawn(_route, w, machine)), f"`{machine}`")
        for machine in w.spans
    ]
    sections = [
        Table("Results", ("", "", "unit"), result_rows(w), (1,)),
        Section("Notes", [Items(notes)] if notes else []),
        Section("Route of each machine", [ABOUT_ROUTES, Beside(routes, "pair")]),
        Section("Where time went", [
            Figure("Where time went", plots.as_image(_drawn(_times, w)), "Minutes of each machine, and when"),
            Table("", head, rows, range(1, len(head)), ABOUT_MINUTES),
        ]),
        Table("What machines waited for", ("machine", "for", "min"), wait_rows(w), (2,)),
        Table("Loads from combines to carts", LOADS, pair_rows(w), (1, 2, 3)),
    ]  # fmt: skip
    write_page(
        out / "report.html", sections, heading=name, title=f"{name}, fleet", lead=outcome(w),
        top=(f"{told}machines at the level {w.level}. [Replay from above](replay.html)",),
    )  # fmt: skip


def outcome(w: Worked) -> str:
    """What a job takes, and how far that is from the least that any plan could take."""
    took, bound = f"**{num(w.ends / 3600.0)} h** until the last grain is at the truck", w.schedule.bound
    if bound <= 0.0:
        return took
    plans = counted(len(w.schedule.compared), "plan")
    gap = 100.0 * (w.ends / bound - 1.0)
    return f"{took}, the best of {plans}; none takes less than {num(bound / 3600.0)} h (gap {num(gap)} %)"


def draw(w: Worked) -> Any:
    """Map above, timelines below."""
    return _drawn(_job, w)


def _drawn(on: Callable[..., Any], *args: Any) -> Any:
    with plots.styled():
        return on(*args)


def _job(w: Worked) -> Any:
    fig = plots.figure(11.0, 7.6 + 0.5 * len(w.spans))
    grid = fig.add_gridspec(2, 1, height_ratios=(6.0, 0.9 + 0.5 * len(w.spans)))
    _map(fig, fig.add_subplot(grid[0]), w, list(w.spans))
    _timelines(fig.add_subplot(grid[1]), w)
    return fig


def _route(w: Worked, name: str) -> Any:
    fig = plots.figure(5.4, 4.0)
    _map(fig, fig.add_subplot(), w, [name])
    return fig


def _times(w: Worked) -> Any:
    """Minutes of each machine above, when it did what below."""
    fig = plots.figure(11.0, 2.2 + 0.8 * len(w.spans))
    above, below = fig.subplots(2, 1)
    for row, name in enumerate(w.spans):
        start = 0.0
        for state in SHOWN:
            minutes = w.minutes(name, state)
            above.barh([row], [minutes], 0.72, start, color=COLOURS[state])
            start += minutes
    above.set(xlabel="min in all", xlim=(0.0, w.ends / 60.0))
    _rows_of_machines(above, w)
    _timelines(below, w, has_legend=False)
    return fig


def _map(fig: Any, ax: Any, w: Worked, names: Sequence[str]) -> None:
    """Field and holes, swaths of machines as wide as they are and their paths, coloured by when."""
    import matplotlib as mpl
    from matplotlib.collections import LineCollection, PolyCollection

    ground, hours = w.schedule.ground, mpl.colors.Normalize(0.0, max(w.ends, 1.0) / 3600.0)
    for part in shapely_here().get_parts(ground.field):
        for k, ring in enumerate([part.exterior, *part.interiors]):
            x, y = _mapped(w, np.asarray(ring.coords)).T
            ax.fill(x, y, color="#ffffff" if k else plots.SOIL, ec=plots.INK, lw=0.8, zorder=0)
    shades: dict[str, Any] = {"cmap": "viridis", "norm": hours}
    for name in names:
        ends, width, begins, _ = np.split(_cuts(w, [name]), (4, 5, 6), axis=1)
        a, b = ends[:, :2], ends[:, 2:]
        along = (b - a) / np.maximum(np.hypot(*(b - a).T), 1e-9)[:, None]
        aside = 0.5 * width * np.column_stack([-along[:, 1], along[:, 0]])
        strips = np.stack([a - aside, b - aside, b + aside, a + aside], axis=1)
        ax.add_collection(PolyCollection([*strips], array=begins[:, 0] / 3600.0, lw=0.0, zorder=1, **shades))
        rows = thinned(_track(w, name))
        line = np.stack([rows[:-1, 1:3], rows[1:, 1:3]], axis=1)
        look = (
            {"colors": plots.GREY, "lw": 0.5} if len(strips) else {"array": rows[:-1, 0] / 3600.0, "lw": 1.0}
        )
        ax.add_collection(LineCollection([*line], zorder=2, **look, **({} if len(strips) else shades)))
    ((x, y),) = _mapped(w, np.array([ground.truck_place[:2]]))
    ax.plot([x], [y], marker="s", ms=6, color=plots.BLUE, ls="none", label="truck")
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0))
    ax.set_aspect("equal", adjustable="datalim")
    ax.autoscale()
    ax.grid(visible=False)
    ax.set(xlabel="east [m]", ylabel="north [m]")
    fig.colorbar(mpl.cm.ScalarMappable(hours, "viridis"), ax=ax, label="after [h]", shrink=0.8, pad=0.01)


def _timelines(ax: Any, w: Worked, has_legend: bool = True) -> None:
    """When each machine did what."""
    for row, spans in enumerate(w.spans.values()):
        for state in SHOWN:
            bars = [(s.begin / 3600.0, (s.end - s.begin) / 3600.0) for s in spans if s.shown == state]
            ax.broken_barh(bars, (row - 0.36, 0.72), color=COLOURS[state], lw=0)
    ax.set(xlabel="time [h]", xlim=(0.0, w.ends / 3600.0))
    _rows_of_machines(ax, w, has_legend)


def _rows_of_machines(ax: Any, w: Worked, has_legend: bool = True) -> None:
    ax.set_yticks(range(len(w.spans)), list(w.spans))
    ax.invert_yaxis()
    ax.grid(visible=False)
    if has_legend:
        for state in SHOWN:
            ax.barh([0], [0], color=COLOURS[state], label=state)
        ax.legend(ncol=5, loc="lower left", bbox_to_anchor=(0.0, 1.0))


def write_replay(w: Worked, name: str, about: str, out: Path) -> Path:
    """Write the page of a job into a folder."""
    values, arrays = collected(w)
    data = packed({"name": name, "about": about, **values}, arrays)
    return write_whole(out / "replay.html", render(name, data, body="job", scripts=SCRIPTS))


def collected(w: Worked) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Plain values and arrays of the page. Places are metres from the frame's origin, east and north."""
    machines, ground, held = w.schedule.machines, w.schedule.ground, grain(w)
    arrays: dict[str, NDArray[Any]] = {"cuts": _cuts(w).astype(np.float32)}
    shown = []
    for k, name in enumerate(w.spans):
        m = machines.by_name[name]
        arrays[f"track_{k}"] = thinned(_track(w, name)).T.astype(np.float32)
        arrays[f"fill_{k}"] = np.stack(held[name]).astype(np.float32)
        body = m.body if ground.frame.side > 0.0 else m.body.mirrored()
        shown.append({
            "name": name, "kind": "cart" if isinstance(m, Cart) else "combine",
            "own": [list(r) for r in body.own], "towed": [list(r) for r in body.towed],
            "raised": body.raised, "hitch": body.hitch, "drawbar": body.drawbar,
            "holds": m.load if isinstance(m, Cart) else m.tank,
            "pipe": None if isinstance(m, Cart) else [m.pipe_x, ground.frame.side * m.pipe_y],
            "spans": [[SHOWN.index(s.shown), round(s.begin, 1), round(s.end, 1), s.reason]
                      for s in w.spans[name]],
        })  # fmt: skip
    arrays["at_truck"] = np.stack(held["truck"]).astype(np.float32)
    rings = [r for part in shapely_here().get_parts(ground.field) for r in (part.exterior, *part.interiors)]
    values: dict[str, Any] = {
        "duration": max(w.ends, w.cut, 1.0), "machines": shown, "states": list(SHOWN),
        "colours": list(COLOURS.values()), "moments": [],
        "events": _moments(w), "rings": [_mapped(w, np.asarray(r.coords)).round(2).tolist() for r in rings],
        "truck": _mapped(w, np.asarray(ground.truck.exterior.coords)).round(2).tolist(),
        "pours": [[p.source, p.target, round(p.begins, 1), round(p.ends, 1)] for p in w.poured],
    }  # fmt: skip
    return values, arrays


def _mapped(w: Worked, points: Array) -> Array:
    """Points of the frame, turned as they lie on the map."""
    frame = w.schedule.ground.frame
    return frame.to_map(points[:, :2]) - frame.to_map([(0.0, 0.0)])


def _track(w: Worked, name: str) -> Array:
    """Time [s], x, y [m], heading, heading of the trailer [rad] of a machine, (n, 5)."""
    if len(w.clock):
        rows = np.column_stack([w.clock, w.places[name]])[::EVERY]
    else:
        parts = []
        for s, into, out in stays(w):
            if s.machine != name:
                continue
            a, b = int(s.path.first[s.index]), int(s.path.last[s.index])
            d = s.path.track.distance[a : b + 1]
            share = (d - d[0]) / max(d[-1] - d[0], 1e-9)
            parts.append(np.column_stack([into + share * s.spent, s.path.track.places[a : b + 1]]))
            parts.append(np.array([[out, *s.path.track.places[b]]]))
        rows = np.concatenate(parts)
        rows = rows[np.concatenate([[True], np.diff(rows[:, 0]) > 1e-6])]
    frame = w.schedule.ground.frame
    rows[:, 3:] = frame.side * (np.unwrap(rows[:, 3:], axis=0) + frame.direction)
    rows[:, 1:3] = _mapped(w, rows[:, 1:3])
    return rows


def thinned(rows: Array) -> Array:
    """Rows of a track without those that lie on the line between their neighbours. (n, 5), times first."""
    while len(rows) > 2:
        odd = np.arange(1, len(rows) - 1, 2)
        before, here, after = rows[odd - 1], rows[odd], rows[odd + 1]
        share = (here[:, :1] - before[:, :1]) / np.maximum(after[:, :1] - before[:, :1], 1e-9)
        off = np.abs(before + share * (after - before) - here)[:, 1:]
        drop = odd[(off < np.array(NEAR)).all(axis=1)]
        if not len(drop):
            break
        rows = np.delete(rows, drop, axis=0)
    return rows


def _cuts(w: Worked, names: Collection[str] = ()) -> Array:
    """What headers of machines, by default of all, go over: middle of the knife from and to, width [m], from
    and to [s]; (n, 7).
    """
    machines = w.schedule.machines.by_name
    rows = []
    for s, into, out in stays(w):
        if s.kind != CUT or (names and s.machine not in names):
            continue
        m = machines[s.machine]
        assert not isinstance(m, Cart)
        a, b = s.path.track.places[s.path.first[s.index]], s.path.track.places[s.path.last[s.index]]
        knife = m.knife * np.array([math.cos(a[2]), math.sin(a[2])])
        ends = _mapped(w, np.array([a[:2] + knife, b[:2] + knife])).ravel()
        rows.append((*ends, m.width, into, min(into + s.spent, out)))
    return np.array(rows).reshape(-1, 7)


def _moments(w: Worked) -> list[dict[str, Any]]:
    """Loads and long waits, as a page lists them."""
    found = []
    for p in w.poured:
        kind = "change" if p.target == "truck" else "load"
        text = f"{num(p.amount / 1000.0)} t into {p.target}"
        found.append({"machine": p.source, "t_s": p.begins, "end_s": p.ends, "kind": kind, "text": text})
    for name, spans in w.spans.items():
        found += [
            {"machine": name, "t_s": s.begin, "end_s": s.end, "kind": "gap",
             "text": f"waits {num(s.end - s.begin)} s for {s.reason}"}
            for s in spans if s.state == WAIT and s.end - s.begin >= TOLD
        ]  # fmt: skip
    return sorted(found, key=lambda e: (e["t_s"], e["machine"]))
