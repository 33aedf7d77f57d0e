"""Edge shapes: distances against brute force, sides, breaks, parameters."""

import json

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.field.edges.boundary import Region
from swath.field.edges.edge import (
    CurveEdge,
    Edge,
    GapParams,
    PolylineEdge,
    StraightEdge,
    TeethParams,
    TrackEdge,
    make_boundary,
    make_edge,
)
from swath.field.edges.track import EdgeShape, curve, polyline, shifted_left, straight
from swath.field.field_setup import FieldSetup
from swath.field.memory_layout import STANDING
from swath.runtime.assembly import assemble
from swath.runtime.job import run_unrecorded
from swath.scenario.scenario import load_scenario
from tests.field.made_field import SETUP, made_field, rectangle

WINDING = [[0.0, 0.0], [40.0, 5.0], [60.0, 40.0], [55.0, 70.0], [90.0, 90.0], [140.0, 85.0]]


def points(count=300, low=-60.0, high=160.0, seed=1):
    rng = np.random.Generator(np.random.Philox(seed))
    return rng.uniform(low, high, (2, count))


def brute_force(shape, x, y, step=0.01):
    """Signed distance by trying a point per centimetre; the side from the nearest one's heading."""
    s = np.arange(-300.0, shape.length + 300.0, step)
    p, heading = shape.point_at(s), shape.heading_at(s)
    result = np.empty(x.shape)
    for n, (px, py) in enumerate(zip(x, y, strict=True)):
        d = np.hypot(p[:, 0] - px, p[:, 1] - py)
        k = int(d.argmin())
        left = np.cos(heading[k]) * (py - p[k, 1]) - np.sin(heading[k]) * (px - p[k, 0])
        result[n] = np.copysign(d[k], left)
    return result if shape.crop_side == "left" else -result


SQUARE = [[0.0, 0.0], [0.0, 60.0], [60.0, 60.0], [60.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize(("points_m", "side"), [(SQUARE, "right"), (SQUARE[::-1], "left")])
def test_a_closed_edge_has_its_crop_inside_alone(points_m, side):
    """Nowhere beyond a corner does it go straight on."""
    shape = EdgeShape(polyline(points_m), side)
    x, y = points(3000, low=-400.0, high=400.0)
    inside = (x > 0.0) & (x < 60.0) & (y > 0.0) & (y < 60.0)
    distance = shape.signed_distance(x, y)
    assert ((distance > 0.0) == inside).all()
    nearest = Region(SQUARE).distance(x, y)
    np.testing.assert_allclose(np.abs(distance), nearest, atol=1e-9)
    few = shape.signed_distance(x[:5], y[:5])
    np.testing.assert_allclose(few, distance[:5], atol=1e-12)


def test_a_closed_edge_goes_round():
    shape = EdgeShape(polyline(SQUARE), "right")
    assert shape.is_closed
    assert shape.length == 240.0
    np.testing.assert_allclose(shape.point_at([-10.0, 250.0]), [[10.0, 0.0], [0.0, 10.0]], atol=1e-12)
    s, _ = shape.project([-500.0, 30.0, 500.0], [30.0, -500.0, 700.0])
    assert (s >= 0.0).all()
    assert (s <= 240.0).all()
    assert not EdgeShape(polyline(SQUARE[:-1]), "right").is_closed


@pytest.mark.parametrize(
    "pieces",
    [
        straight(3.0, -2.0, 0.7, 50.0),
        curve(0.0, 0.0, 0.3, run_in=30.0, radius=40.0, angle=1.4, run_out=30.0),
        curve(0.0, 0.0, 0.3, run_in=0.0, radius=25.0, angle=-2.6, run_out=30.0),
        polyline(WINDING, 10.0),
    ],
)
@pytest.mark.parametrize("side", ["left", "right"])
def test_signed_distance_is_that_of_the_nearest_point(pieces, side):
    shape = EdgeShape(pieces, side)
    x, y = points()
    expected = brute_force(shape, x, y)
    found = shape.signed_distance(x, y)
    far = np.abs(expected) > 0.02
    assert np.abs(found - expected)[far].max() < 1e-3
    assert far.sum() > 250


def test_points_of_the_edge_project_back_onto_themselves():
    shape = EdgeShape(curve(5.0, 5.0, -0.4, run_in=20.0, radius=15.0, angle=2.0, run_out=10.0), "right")
    s = np.linspace(-20.0, shape.length + 20.0, 173)
    found, offset = shape.project(*shape.point_at(s).T)
    assert found == pytest.approx(s, abs=1e-6)
    assert offset == pytest.approx(0.0, abs=1e-8)
    aside = shape.point_at(s) + 0.5 * np.stack([-np.sin(shape.heading_at(s)), np.cos(shape.heading_at(s))], 1)
    assert shape.project(*aside.T)[1] == pytest.approx(0.5, abs=1e-8)


def test_a_curve_has_its_radius_length_and_turn():
    shape = EdgeShape(curve(0.0, 0.0, 0.0, run_in=10.0, radius=40.0, angle=-np.pi / 2, run_out=5.0), "right")
    assert shape.length == pytest.approx(15.0 + 20.0 * np.pi)
    assert shape.point_at(shape.length) == pytest.approx([50.0, -45.0])
    assert shape.heading_at(shape.length) == pytest.approx(-np.pi / 2)


@pytest.mark.parametrize("radius", [0.0, 8.0])
def test_sides_at_corners_are_those_of_the_area_on_that_side(radius):
    shape = EdgeShape(polyline(WINDING, radius), "left")
    s = np.linspace(-400.0, shape.length + 400.0, 40_000)
    left_area = Region(np.vstack([shape.point_at(s), [[600.0, 900.0], [-400.0, 900.0]]]))
    x, y = points(4000, seed=2)
    clear = np.abs(shape.signed_distance(x, y)) > 0.05
    assert np.array_equal((shape.signed_distance(x, y) > 0.0)[clear], left_area.contains(x, y)[clear])


def test_far_pieces_are_left_out_without_changing_the_result():
    rng = np.random.Generator(np.random.Philox(3))
    line = np.stack([np.arange(300) * 2.0, np.cumsum(rng.normal(0.0, 0.1, 300))], axis=-1)
    shape = EdgeShape(polyline(line, 20.0), "right")
    x, y = rng.uniform(200.0, 208.0, 500), rng.uniform(-15.0, 15.0, 500)
    together = shape.signed_distance(x, y)
    spread = shape.signed_distance(np.append(x, [-1e4, 1e4]), np.append(y, [1e4, -1e4]))[:-2]
    assert np.array_equal(together, spread)


TURNS = np.cumsum(np.random.Generator(np.random.Philox(5)).uniform(-0.5, 0.5, 150))


@pytest.mark.parametrize("line", [
    np.cumsum(np.stack([np.cos(TURNS), np.sin(TURNS)], axis=-1) * 4.0, axis=0),
    [[50.0 * np.cos(a), 30.0 * np.sin(a)] for a in np.linspace(0.0, 2.0 * np.pi, 80)],
], ids=["open", "closed"])  # fmt: skip
def test_many_points_project_as_each_does_alone(line):
    shape = EdgeShape(polyline(line, 3.0), "left")
    assert len(shape.pieces) > 100
    x, y = points(3000, np.min(line) - 20.0, np.max(line) + 20.0)
    alone = [shape.project(x[k : k + 1], y[k : k + 1]) for k in range(len(x))]
    for found, each in zip(shape.project(x, y), zip(*alone, strict=True), strict=True):
        assert np.array_equal(found, np.concatenate(each))


def test_rounded_corners_turn_without_jumps():
    shape = EdgeShape(polyline(WINDING, 6.0), "left")
    s = np.arange(0.0, shape.length, 0.01)
    assert np.abs(np.diff(np.unwrap(shape.heading_at(s)))).max() < 0.011 / 5.0
    assert np.abs(np.hypot(*np.diff(shape.point_at(s), axis=0).T) - 0.01).max() < 1e-6


def test_a_line_moved_to_the_left_keeps_its_distance():
    moved = shifted_left(WINDING, 3.0)
    shape = EdgeShape(polyline(WINDING), "left")
    assert shape.project(*moved[[0, -1]].T)[1] == pytest.approx(3.0)
    assert shape.project(*(0.5 * (moved[1:] + moved[:-1])).T)[1] == pytest.approx(3.0)


def test_gaps_and_teeth_take_crop_where_they_should():
    edge = make_edge(
        StraightEdge(
            heading_deg=0.0,
            gaps=(GapParams(start_m=10.0, end_m=14.0, depth_m=3.0),),
            teeth=TeethParams(amplitude_m=0.4, wavelength_m=2.0, kind="sawtooth"),
        ),
        SETUP,
    )
    x = np.array([12.0, 12.0, 12.0, 9.9, 14.1, 20.0, 20.0, 20.0])
    y = np.array([-2.9, -3.1, 0.1, -1.0, -1.0, 0.1, -0.41, -50.0])
    assert edge.code(x, y).tolist() == [0, STANDING, 15, STANDING, STANDING, 15, STANDING, STANDING]
    s = np.linspace(20.0, 60.0, 4001)
    depth = edge.teeth.depth(s)
    assert depth.min() == pytest.approx(0.0, abs=0.01)
    assert depth.max() == pytest.approx(0.4, abs=0.01)
    bitten = edge.code(np.repeat(s, 2), np.stack([-depth + 1e-3, -depth - 1e-3], axis=-1).ravel())
    assert bitten.reshape(-1, 2)[1:-1].mean(axis=0).tolist() == [15.0, STANDING]


def test_random_teeth_depend_on_the_seed_and_stay_within_their_amplitude():
    params = StraightEdge(teeth=TeethParams(amplitude_m=0.5, wavelength_m=1.5))
    s = np.linspace(-500.0, 500.0, 20_001)
    one, two = (make_edge(params, FieldSetup(Stream(n, "field"))).teeth.depth(s) for n in (1, 2))
    assert 0.0 <= one.min() < 0.02 < 0.48 < one.max() <= 0.5
    assert one.mean() == pytest.approx(0.25, abs=0.02)
    assert np.abs(np.corrcoef(one, two)[0, 1]) < 0.1
    assert np.abs(np.diff(one)).max() < 0.06


def test_codes_of_the_field_are_decided_at_cell_centres():
    edge = CurveEdge(
        x_m=-10.0, heading_deg=15.0, run_in_m=7.5, radius_m=15.0, run_out_m=15.0, stubble_height_m=0.2
    )
    field = made_field(edge=edge, boundary=rectangle(-20.0, -20.0, 20.0, 15.0))
    assert field.edges["edge"].teeth is None
    cell = field.maker.cell
    rng = np.random.Generator(np.random.Philox(9))
    n = rng.integers(-1250, 1250, (2, 2500))
    x, y = field.maker.to_world(*((n + 0.5) * cell))
    ahead = field.first_edge.project(x, y)[0] >= 0.0  # behind the beginning of the edge lies the headland
    expected = (field.first_edge.signed_distance(x, y) >= 0.0) & ahead & field.boundary.contains(x, y)
    assert np.array_equal(field.standing(x, y), expected)
    assert 400 < expected.sum() < 2000


def test_region_with_a_hole():
    region = Region(rectangle(0.0, 0.0, 10.0, 8.0), [rectangle(4.0, 3.0, 6.0, 5.0)])
    assert region.contains([1.0, 5.0, 11.0, 5.0, -1.0], [1.0, 4.0, 4.0, 2.9, 3.0]).tolist() == [1, 0, 0, 1, 0]
    assert region.distance([5.0, -3.0], [4.0, -4.0]) == pytest.approx([1.0, 5.0])
    assert region.area == pytest.approx(80.0)


def test_track_from_geojson_and_from_the_folder(tmp_path):
    line = {"type": "LineString", "coordinates": [[1.0, 2.0], [1.0, 3.0], [1.5, 4.0]]}
    collection = {"features": [{"geometry": line}]}
    (tmp_path / "t.geojson").write_text(json.dumps(collection))
    setup = FieldSetup(folder=tmp_path, to_local=lambda p: np.asarray(p) * 100.0)
    shape = make_edge(TrackEdge(file="t.geojson", offset_m=5.0), setup).shape
    assert shape.point_at(0.0) == pytest.approx([95.0, 200.0])
    setup = FieldSetup(tracks=(np.array([[0.0, 0.0], [0.0, 50.0]]),))
    back = make_edge(TrackEdge(is_reversed=True), setup).shape
    assert back.heading_at(10.0) == pytest.approx(-np.pi / 2)
    with pytest.raises(InputError, match=r"field\.edge\.track = 3"):
        make_edge(TrackEdge(track=3), setup)
    (tmp_path / "bad.geojson").write_text('{"features": [{"geometry": 3}]}')
    with pytest.raises(InputError, match="LineStrings"):
        make_edge(TrackEdge(file="bad.geojson"), FieldSetup(folder=tmp_path, to_local=np.asarray))
    with pytest.raises(InputError, match="no such file"):
        make_edge(TrackEdge(file="none.geojson"), FieldSetup(folder=tmp_path, to_local=np.asarray))


@pytest.mark.parametrize(
    "data",
    [
        {"shape": "straight", "length_m": 0.0},
        {"shape": "curve", "radius_m": -40.0},
        {"shape": "polyline", "points_m": [[0.0, 0.0]]},
        {"shape": "straight", "crop_side": "above"},
        {"shape": "straight", "teeth": {"amplitude_m": -1.0, "wavelength_m": 1.0}},
        {"shape": "spiral"},
    ],
)
def test_parameters_out_of_range_are_refused(data):
    with pytest.raises(ValidationError):
        TypeAdapter(Edge).validate_python(data)


def test_shapes_that_cannot_be_are_refused():
    for bad in ([[0.0, 0.0], [0.0, 0.0]], [[0.0, 0.0], [np.nan, 1.0]], [[0.0, 0.0], [5.0, 0.0], [1.0, 0.0]]):
        with pytest.raises(InputError, match=r"field\.edge\.points_m"):
            make_edge(PolylineEdge(points_m=bad), SETUP)
    with pytest.raises(InputError, match="end_m"):
        GapParams(start_m=5.0, end_m=5.0, depth_m=1.0)
    with pytest.raises(InputError, match="inside the boundary"):
        made_field(boundary=rectangle(5000.0, 0.0, 6000.0, 100.0))
    assert make_boundary(None) is None
    with pytest.raises(InputError, match="three points"):
        Region([[0.0, 0.0], [1.0, 1.0]])
    with pytest.raises(InputError, match="1 m2"):
        Region([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])


@pytest.mark.parametrize("seed", [0, 1])
def test_a_slanted_headland_is_driven_into(seed):
    """The knife, 12 m wide, starts half in the field: what it cuts is the way less a triangle."""
    rise, way = float(np.random.default_rng(seed).choice([-1.0, 1.0])) * (0.3 + 0.2 * seed), 14.0
    first = -0.5 if rise > 0.0 else -0.5 - 12.0 * rise  # where the field begins along the edge [m]
    ends = [(-99.0, first - 99.0 * rise), (99.0, first + 99.0 * rise), (99.0, 300.0), (-99.0, 300.0)]
    boundary = f"field.boundary={{points_m: {[list(p) for p in ends]}}}"
    sets = ["combine.lidar=off", "combine.edge=truth", f"run.distance_m={way}", boundary]
    summary = run_unrecorded(load_scenario("straight", sets=sets))
    x = np.linspace(0.0, 12.0, 4001)
    left_out = np.trapezoid(np.maximum(first + rise * x, 0.0), x)
    assert summary["area_cut_m2"] == pytest.approx(12.0 * way - left_out, abs=2.0)
    short = boundary.replace("300.0", "9.0")
    with pytest.raises(InputError, match="a field that covers the run, it ends after"):
        assemble(load_scenario("straight", sets=[*sets[:3], short]))
