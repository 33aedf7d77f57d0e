"""What a live page begins with: the field about the way ahead, uncut, and the machines where they start."""

from collections.abc import Mapping

import numpy as np

from swath.core.schedule import NS
from swath.record.charts import CHARTS, Columns
from swath.replay.layers import Area, Arrays, Layers, Values
from swath.replay.machines import CUTTING_HEIGHT, POSE, STATE, cutting_height
from swath.replay.moments import WORST
from swath.replay.scans import swath_width
from swath.replay.things import things_of
from swath.replay.writer import area_of
from swath.runtime.world import World
from swath.signals import F64, MachineState

ECHO_UNIT = 1.0 / 200.0  # of echoes about the middle of their scan [m]
STEP, BEYOND = 0.5, 10.0  # between points of the way ahead, and how far it goes on after the distance [m]
COLUMNS = tuple(dict.fromkeys([*STATE, *(curve.column for chart in CHARTS for curve in chart.curves)]))


def starting_rows(world: World) -> Mapping[str, Columns]:
    """The present pose of every machine as one row of its tracks."""
    found = {}
    for name in world.machines:
        state = world.graph.latest(f"{name}.motion", "state")
        if isinstance(state, MachineState):
            values = [world.graph.t / NS, *state.pose.position, *state.pose.euler(), state.distance]
            found[name] = {c: np.array([v]) for c, v in zip((*POSE, "distance_m"), values, strict=True)}
    return found


def ways_ahead(world: World, start: Mapping[str, Columns]) -> Mapping[str, Columns]:
    """Where machines will go if they follow the edge of the first one that cuts; without one straight on."""
    leader = next((name for name in start if world.machines[name].cuts), next(iter(start)))
    own, machine = start[leader], world.machines[leader]
    x, y, yaw = (float(own[c][0]) for c in ("x_m", "y_m", "yaw_rad"))
    along = np.arange(0.0, world.scenario.run.distance_m + BEYOND, STEP)
    if machine.cuts:
        begin = float(machine.edge.project(np.array([x]), np.array([y]))[0][0])
        points: F64 = machine.edge.point_at(begin + along)
        moved = points - points[0]
    else:
        moved = np.stack([np.cos(yaw) * along, np.sin(yaw) * along], axis=1)
    headings = np.unwrap(np.arctan2(np.gradient(moved[:, 1]), np.gradient(moved[:, 0])))
    found = {}
    for name, row in start.items():
        turned = headings + (float(row["yaw_rad"][0]) - headings[0])
        x, y = (float(row[c][0]) for c in ("x_m", "y_m"))
        found[name] = {"t_s": along, "x_m": x + moved[:, 0], "y_m": y + moved[:, 1], "yaw_rad": turned}
    return found


def live_data(world: World, columns: Mapping[str, list[str]], origin: F64) -> tuple[Values, Arrays]:
    """Values and arrays of the page, at the first tick. columns: that frames have, by machine, in order."""
    start = starting_rows(world)
    ahead = ways_ahead(world, start)
    area: Area = area_of(Layers(world, ahead, origin))
    empty = np.array([np.nan])
    rows = {n: {c: start[n].get(c, empty) for c in columns[n]} for n in start}
    layers = Layers(world, rows, origin)
    layers.add_field(area, world.scenario.run.max_duration_s)
    layers.add_machines(ahead)
    things, layers.arrays["mesh"], left_out = things_of(world, [], origin, start)
    scanners = [(name, slot) for name in start for slot in world.machines[name].slots_of("lidar")]
    for k in range(len(scanners)):
        layers.arrays |= {
            f"scan_times_{k}": np.zeros(0, np.float32),
            f"scan_starts_{k}": np.zeros(1, np.uint32),
            f"scan_middle_{k}": np.zeros((0, 3), np.float32),
            f"scan_points_{k}": np.zeros((0, 3), np.int16),
        }
    heights = {n: cutting_height(world.machines[n], rows[n])[0] for n in start}
    values = {
        **layers.values,
        "name": world.scenario.name,
        "about": world.scenario.summary,
        "limits": [0, 0, 0, 0],
        "incomplete": False,
        "duration": 10.0,
        "origin": origin.tolist(),
        "things": things,
        "events": [],
        "moments": [],
        "notes": [
            *layers.notes,
            *([left_out] if left_out else []),
            f"the field is drawn {area_note(world)}; beyond, machines drive over the country around",
            "scans of the past are in replay.html of the finished run",
        ],
        "scanners": [
            {"machine": list(start).index(n), "slot": slot, "unit_m": ECHO_UNIT} for n, slot in scanners
        ],
        "straw": [],
        "live": {
            "columns": list(columns.values()),
            "worst": [vars(worst) for worst in WORST],
            "straw": [_straw(world, n) for n in start],
            "cut_m": [float(heights[n]) if np.isfinite(heights[n]) else CUTTING_HEIGHT for n in start],
        },
    }
    return values, layers.arrays


def _straw(world: World, name: str) -> Values | None:
    """Width [m] and density [kg/m3] of the straw that a machine lays; None where none is drawn."""
    width, is_spread = swath_width(world.machines[name])
    if is_spread or not world.machines[name].slots_of("process"):
        return None
    return {"width": width, "density": world.field.straw_density}


def area_note(world: World) -> str:
    """How far the field goes on the page."""
    return f"about the way ahead, {world.scenario.run.distance_m:g} m along the edge"
