"""The machines of a run as a page draws them: geometry, what is mounted, and their tracks."""

from typing import Any

import numpy as np

from swath.core.frames import Pose
from swath.machine.machine_sheet import MachineSheet
from swath.record.charts import Columns
from swath.runtime.world import Machine
from swath.sensing.camera.rays import RaysCamera
from swath.signals import F64

POSE = ("t_s", "x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad")
STATE = (
    *POSE, "speed_m_s", "steer_rad", "distance_m", "edge_t_s", "edge_offset_m", "edge_heading_rad",
    "edge_reference_m", "edge_true_m", "engaged", "header_lift_rad", "header_tilt_rad", "knife_height_m",
    "tank_level", "trailer_x_m", "trailer_y_m", "trailer_z_m", "trailer_yaw_rad", "unload_angle_rad",
    "unload_flow_kg_s", "heap_level",
)  # fmt: skip
MOST_ROWS = 3000
CUTTING_HEIGHT = 0.15  # where neither tracks nor scenario say one [m]
LEAST_STUBBLE = 0.02  # a knife nearer to the ground slides over it [m]
OPTICAL = "_optical"


def thinned(columns: Columns) -> dict[str, np.ndarray]:
    """At most MOST_ROWS rows of a machine's tracks, every one where they fit, and the last."""
    count = len(columns["t_s"])
    keep = np.unique(np.append(np.arange(0, count, max(1, -(-count // MOST_ROWS))), count - 1))
    return {name: values[keep] for name, values in columns.items()}


def derived(columns: Columns, edge_side: str) -> dict[str, np.ndarray]:
    """Columns that charts show and tracks do not have: error of the detected edge [m], > 0 towards the crop.

    edge_side: of the machine, `left` or `right`
    """
    found = dict(columns)
    if "edge_offset_m" in columns and "edge_true_m" in columns:
        left_of_it = columns["edge_offset_m"] - columns["edge_true_m"]
        found["edge_error_m"] = -left_of_it if edge_side == "left" else left_of_it
    return found


def cutting_height(machine: Machine, columns: Columns) -> F64:
    """Height of the knife above ground at every row [m]."""
    set_height = CUTTING_HEIGHT
    for slot in machine.slots_of("header"):
        set_height = float(machine.section.slots[slot].plain().get("cutting_height_m", set_height))
    height = columns.get("knife_height_m")
    count = len(columns["t_s"])
    if height is None:
        return np.full(count, set_height)
    return np.where(np.isfinite(height), np.maximum(height, LEAST_STUBBLE), set_height)


def describe(machine: Machine) -> dict[str, Any]:
    """Geometry and sensors of a machine, plain values."""
    sheet = machine.sheet
    return {
        "name": machine.name,
        "type": sheet.type,
        "sheet": sheet.name,
        "side": machine.edge_side,
        "cuts": machine.cuts,
        "steered_x": sheet.steered_x,
        "tracks": [sheet.front_track, sheet.rear_track],
        "radii": [sheet.dynamics.front.radius, sheet.dynamics.rear.radius],
        "widths": [sheet.dynamics.front.patch_width, sheet.dynamics.rear.patch_width],
        "header": [
            sheet.header_width, sheet.knife_x, sheet.header_y, sheet.header_height, sheet.header_depth
        ],
        "body": list(sheet.body),
        "trailer": _trailer(sheet),
        "box": None if sheet.box is None else vars(sheet.box),
        "pipe": None if sheet.pipe is None else vars(sheet.pipe),
        "sensors": [
            {"slot": slot, **plain_pose(pose), **_frustum(machine.parts.get(slot))}
            for slot, pose in machine.mountings.items()
            if not slot.endswith(OPTICAL)
        ],
    }  # fmt: skip


def _trailer(sheet: MachineSheet) -> dict[str, float] | None:
    """Drawbar, width, radius of the tyres and where the trailer ends, of a machine that tows one [m]."""
    t = sheet.trailer
    if t is None:
        return None
    return {"drawbar": t.drawbar, "width": t.width, "track": t.track, "radius": t.radius}


def plain_pose(pose: Pose) -> dict[str, Any]:
    """A pose as plain numbers: position, rotation row by row."""
    return {
        "position": [round(float(v), 5) for v in pose.position],
        "rotation": [round(float(v), 6) for v in np.ravel(pose.rotation)],
    }


def _frustum(part: Any) -> dict[str, Any]:
    """Of a camera: tangents of its half angles, across and up."""
    if not isinstance(part, RaysCamera):
        return {}
    lens = part.pinhole
    return {"frustum": [0.5 * lens.width / lens.focal, 0.5 * lens.height / lens.focal]}
