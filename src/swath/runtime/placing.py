"""Where a machine starts, and whether edge and field go on for as long as the run does."""

from collections.abc import Mapping

import numpy as np

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.portable import product
from swath.field.field import Field
from swath.field.site_setup import TRAILER, Bodies, why_outside
from swath.field.track import EdgeShape
from swath.runtime.world import Machine
from swath.scenario.resolved import MachineSection
from swath.scenario.scenario import Scenario
from swath.scenario.sections import StartPose
from swath.signals.setup import MachineGeometry

LOOK_AHEAD_M = 5.0  # the edge must go on this far beyond where the header ends up


def edge_of(section: MachineSection, field: Field) -> EdgeShape:
    """The initial edge that a machine follows: the one it names, else the first of the field."""
    name = section.common.field_edge
    if name is None:
        return field.first_edge
    if name not in field.edges:
        expected = f"expected one of field.edges: {', '.join(field.edges)}"
        raise InputError(f"{section.name}.field_edge", name, expected)
    return field.edges[name].shape


def start_pose(section: MachineSection, field: Field, edge: EdgeShape, machine: MachineGeometry) -> Pose:
    """pose_world_machine at t = 0, level; motion puts it on the ground."""
    start = section.start
    if isinstance(start, StartPose):
        x, y, yaw = start.x_m, start.y_m, np.radians(start.heading_deg)
    else:
        along = float(edge.heading_at(start.along_edge_m))
        yaw = along + np.radians(start.heading_error_deg)
        left = np.array([-np.sin(along), np.cos(along)])
        end = edge.point_at(start.along_edge_m) + start.offset_m * left
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        x, y = end - product(turn, np.array(machine.header_end(section.common.edge_side)))
    return Pose.from_euler((x, y, float(field.ground_at(x, y))), yaw=float(yaw))


def check_side(section: MachineSection, edge: EdgeShape) -> None:
    """The crop must stand on the machine's side of its edge; only a machine that cuts has one."""
    if not section.has("header") or edge.crop_side != section.common.edge_side:
        return
    side = section.common.edge_side
    other = "right" if side == "left" else "left"
    expected = f"expected {other}, because the crop stands to the {edge.crop_side} of the edge"
    raise InputError(f"{section.name}.edge_side", side, expected)


def check_start(machines: Mapping[str, Machine], field: Field, bodies: Bodies) -> None:
    """No machine may start in another one or in an obstacle, and one that cuts must start in the field."""
    for contact in bodies.contacts():
        at = f"({contact.point[0]:.1f}, {contact.point[1]:.1f})"
        expected = f"expected another place: it overlaps {contact.second} at {at} m"
        raise InputError(f"{contact.first.removesuffix(TRAILER)}.start", None, expected)
    for name, machine in machines.items():
        if machine.cuts and (why := why_outside(field, machine.sheet, machine.start)):
            raise InputError(f"{name}.start", None, f"expected a place in the field: {why}")


def check_room(scenario: Scenario, machine: Machine, field: Field) -> None:
    """The edge of a machine that cuts, and the field around it, must go on for as long as the run does."""
    start, edge = machine.section.start, machine.edge
    if isinstance(start, StartPose) or not machine.cuts:
        return
    begin, distance = start.along_edge_m, scenario.run.distance_m
    room = edge.length - (0.0 if edge.is_closed else begin) - LOOK_AHEAD_M
    if distance > room:
        expected = f"expected at most {max(room, 0.0):.0f} m, the edge ends there"
        raise InputError("run.distance_m", distance, expected)
    s = np.linspace(begin, begin + distance + LOOK_AHEAD_M, 200)
    along, at = edge.heading_at(s), edge.point_at(s)
    left = np.stack([-np.sin(along), np.cos(along)], axis=1)
    inward = -1.0 if machine.edge_side == "left" else 1.0
    for across in (0.0, inward * machine.sheet.header_width):
        points = at + across * left
        is_inside = field.covers(points[:, 0], points[:, 1])
        if not np.all(is_inside):
            short = float(s[np.argmin(is_inside)] - begin)
            expected = f"expected a field that covers the run, it ends after {short:.0f} m"
            raise InputError("run.distance_m", distance, expected)
