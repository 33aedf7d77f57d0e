"""The field as profiles along its edge against the field of cells, on drawn edges, stands and terrains."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.field.cutting.cut_result import cells_inside
from swath.field.edges.edge import CurveEdge, GapParams, PolylineEdge, StraightEdge, TeethParams
from swath.field.edges.profile import BIN, COLUMN
from swath.field.stand import maps, uniform
from swath.field.terrain import formula
from swath.field.wind import Wind
from tests.field.made_field import made_field


def drawn_edge(rng):
    """A straight or bent edge with gaps and teeth or without."""
    gaps = tuple(
        GapParams(start_m=s, end_m=s + rng.uniform(1, 6), depth_m=rng.uniform(0.5, 4), stubble_height_m=0.05)
        for s in rng.uniform(5, 60, rng.integers(0, 3))
    )
    teeth = None
    if rng.integers(2):
        kind = str(rng.choice(["random", "sawtooth"]))
        teeth = TeethParams(amplitude_m=rng.uniform(0.2, 1.0), wavelength_m=rng.uniform(3, 9), kind=kind)
    common = {"gaps": gaps, "teeth": teeth, "crop_side": str(rng.choice(["left", "right"]))}
    x, y, heading = *rng.uniform(-30, 30, 2), rng.uniform(-180, 180)
    if rng.integers(2):
        return StraightEdge(x_m=x, y_m=y, heading_deg=heading, length_m=90.0, **common)
    bend = {"radius_m": rng.uniform(30, 80), "angle_deg": rng.uniform(-60, 60), "run_in_m": 20.0}
    return CurveEdge(x_m=x, y_m=y, heading_deg=heading, **bend, run_out_m=40.0, **common)


@pytest.mark.parametrize("seed", range(4))
def test_the_same_crop_stands(seed):
    rng = np.random.default_rng(seed)
    edge = drawn_edge(rng)
    cells, field = (made_field(edge=edge, seed=seed) for _ in range(2))
    profile = field.profiled(field.first_edge)
    s, aside = rng.uniform(-3, 70, 4000), rng.uniform(-6, 8, 4000)
    at, heading = field.first_edge.point_at(s), field.first_edge.heading_at(s)
    x, y = at[:, 0] - aside * np.sin(heading), at[:, 1] + aside * np.cos(heading)
    inside, bins = profile.place(x, y)
    clear = np.abs(inside - profile.reach[bins]) > 0.05
    ends = np.array([[g.start, g.end] for g in profile.edge.gaps]).ravel()
    for end in (*ends, 0.0):
        clear &= np.abs(s - end) > BIN
    assert clear.mean() > 0.8
    np.testing.assert_array_equal(field.standing(x, y)[clear], cells.standing(x, y)[clear])


@pytest.mark.parametrize("seed", range(4))
def test_ground_and_stand_of_its_columns(seed):
    rng = np.random.default_rng(seed)
    terrain = formula.Params(slope_percent=rng.uniform(0, 8))
    stand = maps.Params(density_variation=maps.Variation(sd_percent=10.0, length_m=25.0))
    field = made_field(terrain=terrain, stand=stand, edge=drawn_edge(rng), seed=seed)
    p = field.profiled(field.first_edge)
    whole = made_field(terrain=terrain, stand=stand, edge={"edge": p.edge}, seed=seed)
    whole = whole.profiled(p.edge.shape)
    whole.lay(len(p.x))
    for stations in (*rng.integers(0, len(p.x), 3), len(p.x)):
        p.lay(int(stations))
    for name in ("z", "slope_x", "slope_y"):
        np.testing.assert_array_equal(getattr(p, name), getattr(whole, name), strict=True)
    k, stand = np.arange(65, 120), p.stand()
    for column in range(p.z.shape[1]):
        left = COLUMN * (column - p.z.shape[1] // 2)
        u, v = p.x[k] - left * p.sine[k], p.y[k] + left * p.cosine[k]
        x, y = field.maker.to_world(u, v)
        plane = p.z[k, column] + p.slope_x[k, column] * (u - p.x[k]) + p.slope_y[k, column] * (v - p.y[k])
        np.testing.assert_allclose(plane, field.terrain.height(x, y), atol=2e-3)
        np.testing.assert_allclose(stand[k, column, 3], field.stand.density(x, y), rtol=1e-6)


@pytest.mark.parametrize(
    ("given", "what"),
    [
        ({"stand": uniform.Params(wind=Wind(speed_m_s=5.0))}, "wind"),
        ({"stand": maps.Params(tramlines=maps.Tramlines())}, "tramlines"),
        ({"stand": uniform.Params(lean_deg=40.0)}, "lodged crop"),
        ({"boundary": ((-30.0, -5.0), (30.0, -5.0), (30.0, 60.0), (-30.0, 60.0))}, "boundary"),
        ({"edge": CurveEdge(radius_m=8.0)}, "bends"),
        ({"edge": PolylineEdge(points_m=((0.0, 0.0), (0.0, 50.0), (50.0, 60.0)))}, "corners"),
        ({"edge": StraightEdge(teeth=TeethParams(amplitude_m=0.3, wavelength_m=0.2))}, "teeth"),
    ],
)
def test_what_it_cannot_carry_is_refused_and_sent_to_empirical(given, what):
    field = made_field(**given)
    with pytest.raises(InputError, match=f"expected no .*{what}.*; the level empirical"):
        field.profiled(field.first_edge)
    assert field.profile is None


@pytest.mark.parametrize("corners", [3, 4, 16, 17])
def test_standing_area_is_that_of_the_cells_whose_middles_are_inside(corners):
    rng = np.random.default_rng(corners)
    field = made_field(edge=drawn_edge(rng), seed=corners)
    profile = field.profiled(field.first_edge)
    middle = field.first_edge.point_at(np.array([20.0, 35.0, 50.0]))
    angles = np.arange(corners) * 2.0 * np.pi / corners + rng.uniform(0.0, 0.5, (3, 1))
    for place, angle in zip(middle, angles, strict=True):
        polygon = place + 4.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        u, v = cells_inside(polygon / BIN)
        wanted = np.count_nonzero(profile.stands((u + 0.5) * BIN, (v + 0.5) * BIN)) * BIN**2
        assert wanted > 1.0
        assert field.standing_area(polygon) == pytest.approx(wanted, rel=5e-3)  # a bend is a parabola there
    flat = np.array([[0.0, 0.5 * BIN], [1.0, 0.5 * BIN], [2.0, 0.5 * BIN]])
    assert field.standing_area(flat) == 0.0
    fans = np.array([[place, *polygon[[1, 0]]], [place, *polygon[[1, 2]]], flat])  # clockwise, anticlockwise
    assert field.standing_areas(fans).tolist() == [field.standing_area(fan) for fan in fans]


@pytest.mark.parametrize("seed", range(2))
def test_a_cut_takes_what_the_field_of_cells_gives(seed):
    rng = np.random.default_rng(seed)
    cells, field = (made_field(edge=drawn_edge(np.random.default_rng(seed)), seed=seed) for _ in range(2))
    profile, shape = field.profiled(field.first_edge), field.first_edge
    side = 1.0 if shape.crop_side == "left" else -1.0
    ways = np.arange(3.0, 60.0, 0.11)
    near, far = (side * (wide + 0.2 * np.sin(ways / rng.uniform(3, 9))) for wide in (0.1, 6.0))
    at, heading = shape.point_at(ways), shape.heading_at(ways)
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    inner, outer = at + near[:, None] * left, at + far[:, None] * left
    own = its = np.zeros(4)
    for k in range(len(ways) - 1):
        polygon = [inner[k], inner[k + 1], outer[k + 1], outer[k]]
        a, b = field.cut(polygon, 0.12), cells.cut(polygon, 0.12)
        own = own + np.array([a.area, a.grain, a.straw, a.stem_count])
        its = its + np.array([b.area, b.grain, b.straw, b.stem_count])
    np.testing.assert_allclose(own, its, rtol=0.02)
    gone = profile.taken()
    np.testing.assert_allclose(own[:3], [gone.area, gone.grain, gone.straw], rtol=1e-9)
    with pytest.raises(InputError, match="no second pass"):
        field.cut(
            [
                at[100] + 20 * side * left[100],
                at[104] + 20 * side * left[104],
                at[104] + 25 * side * left[104],
            ],
            0.12,
        )
    with pytest.raises(InputError, match="no header whose height changes"):
        field.cut([inner[0], inner[1], outer[1]], 0.3)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_the_ground_at_a_few_points_is_that_of_pages(count):
    cells, field = (made_field(terrain=formula.Params(slope_percent=4.0), seed=3) for _ in range(2))
    x, y = np.random.default_rng(count).uniform(-20, 40, (2, count))
    field.profiled(field.first_edge)
    for found in (field.ground_height(x, y), cells.ground_at(x, y)):
        np.testing.assert_array_equal(found, cells.ground_height(x, y), strict=True)
    assert not len(field.store.keys)
