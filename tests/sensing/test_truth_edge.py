"""Edge level `truth` against closed forms: bends as tight as a machine can drive, breaks, and no edge."""

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.field.edges.edge import CurveEdge, GapParams, StraightEdge
from swath.field.edges.present_edge import STEP_M, crop_across, edges_of
from swath.field.site_setup import SiteSetup
from swath.machine.machine_sheet import load_machine
from swath.sensing.edge.truth import Params, TruthEdge
from swath.signals import MachineState
from tests.field.made_field import made_field, rectangle

MACHINE = load_machine("lexion-700-class")


def seen(field, pose, side="left", **params):
    truth = TruthEdge(Params(**params), SiteSetup(field, MACHINE, Pose.identity(), side, 0.04))
    return truth.step(0, 40_000_000, {"state": MachineState(0, pose, 0.0, 0.0, 0.0, 0.0, 0.0)})["edge"]


def beside(shape, s, side, off=0.0, turned=0.0):
    """Pose whose header end is on the edge at s, `off` [m] to the left of it, the machine along it."""
    along = float(shape.heading_at(s))
    end = shape.point_at(s) + off * np.array([-np.sin(along), np.cos(along)])
    yaw = along + turned
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    x, y = end - turn @ np.array(MACHINE.header_end(side))
    return Pose.from_euler((x, y, 0.0), yaw=yaw)


def true_y(shape, pose, edge):
    """(y of the edge at the reported reference [m], its heading [rad]) in the machine frame."""
    y = edge.offset + np.linspace(-1.0, 1.0, 20001)
    points = pose.apply(np.stack([np.full_like(y, edge.reference_x), y, 0 * y], axis=1))
    s, away = shape.project(points[:, 0], points[:, 1])
    k = np.argmin(np.abs(away))
    return y[k], float(shape.heading_at(s[k])) - pose.euler()[2]


@pytest.mark.parametrize(
    ("side", "radius", "angle"),
    [("left", 8.0, 80.0), ("right", 8.0, 80.0), ("left", 16.0, -80.0), ("right", 40.0, -80.0)],
)
def test_any_radius_a_machine_can_drive_is_right_or_not_seen(side, radius, angle):
    crop_side = "right" if side == "left" else "left"
    params = CurveEdge(
        crop_side=crop_side,
        run_in_m=20.0,
        run_out_m=40.0,
        radius_m=radius,
        angle_deg=angle,
        crop_begins_m=None,
    )
    field = made_field(edge=params)
    shape = field.first_edge
    found = 0
    for s in np.linspace(8.0, 20.0 + radius * np.radians(80.0) + 5.0, 12):
        pose = beside(shape, float(s), side, off=0.1)
        edge = seen(field, pose, side)
        assert edge.is_found, s
        y, heading = true_y(shape, pose, edge)
        assert edge.offset == pytest.approx(y, abs=0.03)
        assert edge.heading == pytest.approx(heading, abs=0.06)
        found += edge.reference_x == 10.0
    assert found > (10 if radius > 30.0 else 1)


def test_beside_nothing_it_sees_nothing():
    field = made_field(edge=StraightEdge())
    shape = field.first_edge
    assert seen(field, beside(shape, 20.0, "left", off=2.8)).is_found
    for off in (3.3, 12.0, -3.3, -20.0):
        edge = seen(field, beside(shape, 20.0, "left", off=off))
        assert not edge.is_found
        assert edge.confidence == 0.0


def test_a_heading_error_is_no_bend():
    field = made_field(edge=StraightEdge())
    for degrees in (-20.0, 25.0):
        edge = seen(field, beside(field.first_edge, 20.0, "left", turned=np.radians(degrees)))
        assert edge.reference_x == 10.0
        assert edge.heading == pytest.approx(-np.radians(degrees), abs=0.01)


def test_it_looks_no_farther_than_a_break():
    """A gap 2 m deep begins 4 m ahead of the knife: the edge is reported before it, and right."""
    field = made_field(edge=StraightEdge(gaps=(GapParams(start_m=30.0, end_m=40.0, depth_m=2.0),)))
    shape = field.first_edge
    pose = beside(shape, 26.0, "left", off=0.1)
    edge = seen(field, pose)
    knife = MACHINE.header_end("left")[0]
    assert edge.seen_to <= knife + 4.0
    assert edge.reference_x < 10.0
    assert edge.offset == pytest.approx(true_y(shape, pose, edge)[0], abs=0.03)


def test_crop_that_begins_ahead_is_seen():
    """From the headland, 7 m before the crop begins."""
    field = made_field(edge=StraightEdge())
    edge = seen(field, beside(field.first_edge, -4.0, "left"))
    assert edge.is_found
    assert edge.offset == pytest.approx(MACHINE.header_end("left")[1], abs=0.02)


def test_lines_across_a_real_field_find_the_edge_where_it_is():
    """Slanted to the edge, and after cuts; islands of crop and of stubble are none."""
    field = made_field(edge=StraightEdge(x_m=1.234, heading_deg=90.0, crop_begins_m=None))

    def places(y, yaw=0.1):
        pose = Pose.from_euler((-3.0, y, 0.0), yaw=yaw - 0.5 * np.pi)
        return [float(p) * STEP_M for p in edges_of(crop_across(field, pose, np.zeros(1), 0.0, 9.0))[0]]

    along = np.linspace(-30.0, 30.0, 40)
    found = np.concatenate([places(y) for y in along])
    slanted = 4.234 / np.cos(0.1)
    assert len(found) == 40
    assert np.abs(found - slanted).max() < 0.03
    assert abs(found.mean() - slanted) < 0.005
    field.cut(rectangle(1.0, -5.0, 2.5, 5.0), 0.15)
    field.cut(rectangle(3.0, -1.0, 3.2, 1.0), 0.15)
    assert places(0.0, yaw=0.0) == pytest.approx([5.5], abs=0.02)


@pytest.mark.parametrize(("side", "angle"), [("left", 60.0), ("left", -60.0), ("right", 1e-3)])
def test_a_machine_that_follows_an_edge_is_told_the_line_across_its_holes(side, angle):
    """In bends too, where the hole is longer than the look ahead, and at a look across its begin and end."""
    gap = GapParams(start_m=25.0, end_m=40.0, depth_m=2.0)
    crop_side = "right" if side == "left" else "left"
    shape = {"run_in_m": 20.0, "radius_m": 20.0, "run_out_m": 40.0, "angle_deg": angle}
    field = made_field(edge=CurveEdge(crop_side=crop_side, gaps=(gap,), crop_begins_m=None, **shape))
    line = field.first_edge
    for s in np.linspace(8.0, 44.0, 13):
        pose = beside(line, float(s), side, off=0.1)
        setup = SiteSetup(field, MACHINE, Pose.identity(), side, 0.04, edge=line)
        state = MachineState(0, pose, 0.0, 0.0, 0.0, 0.0, 0.0)
        edge = TruthEdge(Params(), setup).step(0, 40_000_000, {"state": state})["edge"]
        assert edge.is_found, s
        y, heading = true_y(line, pose, edge)
        assert edge.offset == pytest.approx(y, abs=0.03)
        assert edge.heading == pytest.approx(heading, abs=0.06)
