"""Where a machine starts, and whether edge and field go on for as long as the run does."""

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.field.field import Field
from swath.machine.machine_sheet import MachineSheet
from swath.scenario.resolved import MachineSection
from swath.scenario.scenario import Scenario
from swath.scenario.sections import StartPose

LOOK_AHEAD_M = 5.0  # the edge must go on this far beyond where the header ends up


def start_pose(section: MachineSection, field: Field, card: MachineSheet) -> Pose:
    """pose_world_machine at t = 0, level; motion puts it on the ground."""
    start = section.start
    if isinstance(start, StartPose):
        x, y, yaw = start.x_m, start.y_m, np.radians(start.heading_deg)
    else:
        edge = field.nominal_edge
        along = float(edge.heading_at(start.along_edge_m))
        yaw = along + np.radians(start.heading_error_deg)
        left = np.array([-np.sin(along), np.cos(along)])
        end = edge.point_at(start.along_edge_m) + start.offset_m * left
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        x, y = end - turn @ np.array(card.header_end(section.common.edge_side))
    return Pose.from_euler((x, y, float(field.ground_height(x, y))), yaw=float(yaw))


def check_side(section: MachineSection, field: Field) -> None:
    """The crop must stand on the machine's side of the edge."""
    crop_side, edge_side = field.nominal_edge.crop_side, section.common.edge_side
    if crop_side == edge_side:
        other = "right" if edge_side == "left" else "left"
        expected = f"expected {other}, because the crop stands to the {crop_side} of the edge"
        raise InputError(f"{section.name}.edge_side", edge_side, expected)


def check_room(scenario: Scenario, section: MachineSection, field: Field, card: MachineSheet) -> None:
    """The edge, and the field around it, must go on for as long as the run does."""
    if isinstance(section.start, StartPose):
        return
    begin = section.start.along_edge_m
    room = field.nominal_edge.length - begin - LOOK_AHEAD_M
    if scenario.run.distance_m > room:
        expected = f"expected at most {max(room, 0.0):.0f} m, the edge ends there"
        raise InputError("run.distance_m", scenario.run.distance_m, expected)
    s = np.linspace(begin, begin + scenario.run.distance_m + LOOK_AHEAD_M, 200)
    along, at = field.nominal_edge.heading_at(s), field.nominal_edge.point_at(s)
    left = np.stack([-np.sin(along), np.cos(along)], axis=1)
    inward = -1.0 if section.common.edge_side == "left" else 1.0
    for across in (0.0, inward * card.header_width):
        points = at + across * left
        if not np.all(field.covers(points[:, 0], points[:, 1])):
            short = float(s[np.argmin(field.covers(points[:, 0], points[:, 1]))] - begin)
            expected = f"expected a field that covers the run, it ends after {short:.0f} m"
            raise InputError("run.distance_m", scenario.run.distance_m, expected)
