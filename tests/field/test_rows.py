"""The edge of row crops lies midway between the outer row and the next: against the stems that stand."""

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.field.crop_sheet import load_crop
from swath.field.edges.edge import CurveEdge, StraightEdge, make_edge
from swath.field.edges.present_edge import STEP_M, crop_across, edges_of
from swath.field.field import make_field
from swath.field.field_setup import FieldSetup
from swath.field.prototypes import make_library
from swath.field.site_setup import SiteSetup
from swath.field.stand import uniform
from swath.field.terrain import plane
from swath.judge.evaluators.lateral_error import LateralError
from swath.machine.machine_sheet import load_machine
from swath.record.message_factory import RecordedMachine
from swath.sensing.edge.truth import Params, TruthEdge
from swath.signals import MachineState
from tests.evaluated import evaluation_of

MACHINE = load_machine("lexion-700-class")
STRIP_M = 0.04


def row_field(crop, edge, spacing, azimuth, density, seed=3):
    setup = FieldSetup(Stream(seed, "field"))
    keys = {"stems_per_m2": density, "row_spacing_m": spacing, "row_azimuth_deg": azimuth}
    stand = uniform.Uniform(uniform.Params(crop=crop, **keys), setup)
    sheet = load_crop(crop)
    library = make_library(
        sheet, density_max=density, row_spacing=spacing, seed=setup.stream.child("library"), tile_count=2
    )
    ground = plane.Plane(plane.Params(), setup)
    return make_field(ground, stand, make_edge(edge, setup), crop=sheet, library=library, stream=setup.stream)


def along(edge, s, inside):
    """Corners of a strip along an edge: s and distance to the inside, (2,) each [m]."""
    heading = float(edge.heading_at(s[0]))
    inwards = np.array([-np.sin(heading), np.cos(heading)]) * (1 if edge.crop_side == "left" else -1)
    first, last = edge.point_at(s[0]), edge.point_at(s[1])
    return [first + inside[0] * inwards, last + inside[0] * inwards,
            last + inside[1] * inwards, first + inside[1] * inwards]  # fmt: skip


def feet(field, edge, s, reach):
    """Where stems stand inside of an edge [m], by cutting strip after strip: (n,)."""
    places = []
    for k in range(round(reach / STRIP_M)):
        cut = field.cut(along(edge, s, (k * STRIP_M, (k + 1) * STRIP_M)), 0.05)
        places += [(k + 0.5) * STRIP_M] * cut.stem_count
    return np.array(places)


def beside(edge, s, side, off):
    """Pose whose header end is `off` [m] inside of the edge at s, the machine along it."""
    heading = float(edge.heading_at(s))
    left = off if edge.crop_side == "left" else -off
    end = edge.point_at(s) + left * np.array([-np.sin(heading), np.cos(heading)])
    c, sn = np.cos(heading), np.sin(heading)
    x, y = end - np.array([[c, -sn], [sn, c]]) @ np.array(MACHINE.header_end(side))
    return Pose.from_euler((x, y, 0.0), yaw=heading)


def told(field, pose, side):
    """World point (2,) of the edge that level `truth` tells."""
    setup = SiteSetup(field, MACHINE, Pose.identity(), side, 0.04, edge=field.first_edge)
    state = MachineState(0, pose, 0.0, 0.0, 0.0, 0.0, 0.0)
    edge = TruthEdge(Params(), setup).step(0, 40_000_000, {"state": state})["edge"]
    assert edge.is_found
    return pose.apply([edge.reference_x, edge.offset, 0.0])[:2]


CASES = [(crop, side, seed) for seed in (1, 2) for crop in ("maize", "soy") for side in ("left", "right")]


@pytest.mark.parametrize(("crop", "side", "seed"), CASES)
def test_the_edge_is_half_a_spacing_outside_of_the_outer_row(crop, side, seed):
    """Spacings of 0.4 to 0.9 m, rows in any direction, a line anywhere beside them, stands thin and dense.

    Against the stems: from the line to the first row it is half a spacing, to the second one and a half. The
    truth, the lateral error and what stands after a pass that went astray by 0.3 of the spacing say the same.
    """
    rng = np.random.default_rng(seed)
    spacing, azimuth = float(rng.uniform(0.4, 0.9)), float(rng.uniform(0.0, 360.0))
    density = float(rng.uniform(3.0, 9.0))
    x, y = (float(v) for v in rng.uniform(-20.0, 20.0, 2))
    heading = 90.0 - azimuth + float(rng.choice([0.0, 180.0]))
    crop_side = "right" if side == "left" else "left"
    wrapped = (heading + 180.0) % 360.0 - 180.0
    line = StraightEdge(x_m=x, y_m=y, heading_deg=wrapped, length_m=60.0, crop_side=crop_side)
    field = row_field(crop, line, spacing, azimuth, density)
    edge = field.first_edge
    moved = float(np.hypot(*(edge.point_at(0.0) - np.array([x, y]))))
    assert moved <= 0.5 * spacing + 1e-6
    assert field.notes == [f"field.edge: moved by {moved:.2f} m to midway between two rows"]
    pose = beside(edge, 15.0, side, 0.05)
    assert float(edge.signed_distance(*told(field, pose, side))) == pytest.approx(0.0, abs=0.015)
    judge = evaluation_of(field, RecordedMachine("combine", MACHINE, side, {}, edge=edge))
    lateral = judge.find("combine", LateralError)
    end = pose.apply([*MACHINE.header_end(side), 0.0])
    assert float(lateral._error(*end[:2])) == pytest.approx(0.05, abs=1e-6)

    found = feet(row_field(crop, line, spacing, azimuth, density), edge, (20.0, 40.0), 2.0 * spacing)
    first, second = found[found < spacing], found[found > spacing]
    assert len(first) > 20
    assert len(second) > 20
    assert first.mean() == pytest.approx(0.5 * spacing, abs=0.5 * STRIP_M)
    assert second.mean() == pytest.approx(1.5 * spacing, abs=0.5 * STRIP_M)

    rows = 6
    for stray in (-0.3, 0.3):
        field = row_field(crop, line, spacing, azimuth, density)
        field.cut(along(edge, (-5.0, 60.0), (-1.0, (rows + stray) * spacing)), 0.05)
        wall = told(field, beside(edge, 15.0, side, rows * spacing), side)
        assert float(edge.signed_distance(*wall)) == pytest.approx(rows * spacing, abs=0.015)


@pytest.mark.parametrize("crop", ["maize", "soy"])
@pytest.mark.parametrize("angle", [12.0, 45.0, -70.0, 90.0])
def test_an_edge_across_the_rows_is_where_they_end(crop, angle):
    field = row_field(
        crop, StraightEdge(x_m=0.2, heading_deg=90.0 + angle, crop_begins_m=None), 0.6, 0.0, 6.0
    )
    edge = field.first_edge
    assert not field.notes
    assert edge.point_at(0.0) == pytest.approx([0.2, 0.0])
    off = [
        float(edge.signed_distance(*told(field, beside(edge, s, "left", 0.0), "left"))) for s in (10, 31, 52)
    ]
    assert off == pytest.approx([0.0] * 3, abs=0.02)
    stems = feet(field, edge, (100.0, 140.0), 1.0)
    assert stems.min() < 0.1


def test_a_line_that_strays_from_its_rows_ends_one_after_the_other():
    """1 deg: each row goes on for some 43 m beyond the one before, and its ground with it."""
    line = StraightEdge(heading_deg=91.0, length_m=300.0, crop_begins_m=None)
    field = row_field("maize", line, 0.75, 0.0, 8.0)
    assert not field.notes
    places = []
    for north in range(5, 120, 5):
        pose = Pose.from_euler((-4.0, float(north), 0.0), yaw=0.5 * np.pi)
        crop = crop_across(field, pose, np.zeros(1), 4.0, -8.0)
        places += [float(p) * STEP_M - 8.0 for p in edges_of(crop)[0]]
    steps = np.array(places) / 0.75
    assert np.abs(steps - np.round(steps)).max() < 0.03
    assert len(np.unique(np.round(steps))) in (3, 4)


def test_drilled_crops_and_bends_keep_their_line():
    for spacing, edge in ((0.25, StraightEdge(x_m=0.1)), (0.75, CurveEdge(x_m=0.1, run_in_m=20.0))):
        field = row_field("soy", edge, spacing, 0.0, 30.0)
        assert not field.notes
        assert field.first_edge.point_at(0.0) == pytest.approx([0.1, 0.0])
