"""The page that plays a job from above: the field, what is cut, machines to scale, fill, why they wait."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.whole_file import write_whole
from swath.fleet.ground import shapely_here
from swath.fleet.machines import Cart
from swath.fleet.worked import CUT, SHOWN, WAIT, Worked, grain, state_of, stays
from swath.replay.writer import packed, render
from swath.report.plots import BLUE, CROP, GREEN, GREY, ORANGE, PURPLE, SKY

Array = NDArray[np.float64]
FILE = "replay.html"
SCRIPTS = ("data", "timeline", "job")
EVERY = 5  # samples of driven bodies, which are 0.1 s apart
NEAR = (0.05, 0.05, 0.01, 0.01)  # m, m, rad, rad that a place may be off the line between those kept
TOLD = 30.0  # s: longer waits are moments
COLOURS = dict(
    zip(SHOWN, (CROP, SKY, PURPLE, "#8cccb0", GREEN, BLUE, ORANGE, "#f2a97c", "#8c2d04", GREY), strict=True)
)


def write_replay(w: Worked, name: str, about: str, out: Path) -> Path:
    """Write the page of a job into a folder."""
    values, arrays = collected(w)
    data = packed({"name": name, "about": about, **values}, arrays)
    return write_whole(out / FILE, render(name, data, body="job", scripts=SCRIPTS))


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


def _cuts(w: Worked) -> Array:
    """What headers go over: middle of the knife from and to [m], width [m], from and to [s]; (n, 7)."""
    machines = w.schedule.machines.by_name
    rows = []
    for s, into, out in stays(w):
        if state_of(s) != CUT:
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
        text = f"{p.amount / 1000.0:.1f} t into {p.target}"
        found.append({"machine": p.source, "t_s": p.begins, "end_s": p.ends, "kind": kind, "text": text})
    for name, spans in w.spans.items():
        found += [
            {"machine": name, "t_s": s.begin, "end_s": s.end, "kind": "gap",
             "text": f"waits {s.end - s.begin:.0f} s for {s.reason}"}
            for s in spans if s.state == WAIT and s.end - s.begin >= TOLD
        ]  # fmt: skip
    return sorted(found, key=lambda e: (e["t_s"], e["machine"]))
