"""The spread table: its interpolation, what it is fitted to, and how it lies on disk."""

from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from statistics import NormalDist

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.core.random import Stream
from swath.core.units import DEG
from swath.field.crop_sheet import load_crop
from swath.rays.spread import Spread, quantile_nodes
from swath.sensing.tables import load_table, save_table
from swath.tools.calibrate.fit import (
    SMALL,
    fit_correlation,
    fit_plants,
    normal_scores,
)
from swath.tools.calibrate.measured import COLUMNS, fit_samples, read_samples
from swath.tools.calibrate.stand_scans import LINE, EchoSettings, Place, Returns, SampleStands
from swath.tools.distributions import compare


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A coarse table of wheat, how it agrees with other stands, and its file; a silhouette has few rays."""
    made, out, said = [], tmp_path_factory.mktemp("small") / "mine.npz", StringIO()

    def kept(*args, **more):
        made.append(fit_plants(*args, **more))
        return made[0]

    with pytest.MonkeyPatch.context() as patch, redirect_stdout(said):
        patch.setitem(SampleStands.silhouette.__kwdefaults__, "rays", 4_000)
        patch.setattr("swath.tools.calibrate.fit.fit_plants", kept)
        assert main(["calibrate", "lidar", "--quick", "--sub-rays", "19", "--out", str(out)]) == 0
    assert "wasserstein_m" in said.getvalue()
    return *made[0], out


def test_a_coarse_table_already_tells_other_stands_of_other_plants(small):
    _, held_out, _ = small
    assert [h.is_cut for h in held_out].count(False) == SMALL.standing.held_out
    assert [h.is_cut for h in held_out].count(True) == SMALL.stubble.held_out
    assert max(h.agreement.wasserstein_m for h in held_out if not h.is_cut) < 0.07
    assert max(h.agreement.wasserstein_m for h in held_out if h.is_cut) < 0.03
    assert np.mean([abs(h.agreement.ground_bias) for h in held_out]) < 0.03


def test_trends_of_the_fit(small):
    """Denser, flatter: higher and narrower. Steeper, thinner: more ground."""
    table, *_ = small
    middle = table.standing.quantile[..., quantile_nodes().searchsorted(0.5)]
    assert (np.diff(middle, axis=0) > 0).all()
    assert (np.diff(middle, axis=2) < 0).all()
    for grid in (table.standing, table.stubble):
        assert (np.diff(grid.ground_share, axis=0) <= 0).all()
        assert (np.diff(grid.ground_share, axis=2) >= 0).all()
        assert (np.diff(grid.quantile, axis=-1) <= 0).all()
    assert (np.diff(table.silhouette, axis=1) < 0).all()


def test_depths_of_beams_through_the_side_vary_less(small):
    """Half of a spot is stopped at a depth of ln 2, however thick the pieces are; of thin stems it takes more
    pieces than of ears, and their number varies by less."""
    side = small[0].side
    assert side.median == pytest.approx(np.log(2.0), rel=0.1)
    stems = int(np.searchsorted(side.height, 0.6))
    assert (side.factor[:, -1] == 1.0).all()
    assert (side.factor[:, stems].mean(axis=1) < 0.85).all()


def test_a_table_that_knows_no_sides_is_refused(tmp_path):
    path = tmp_path / "old.npz"
    table = load_table("wheat-median")
    save_table(table, path)
    with np.load(path) as data:
        kept = {name: data[name] for name in data.files}
    again = load_table(str(path))
    assert np.array_equal(again.side.factor, table.side.factor)
    np.savez(path, **{name: array for name, array in kept.items() if not name.startswith("side_")})
    with pytest.raises(InputError, match="makes the table anew"):
        load_table(str(path))


def test_ground_share_between_nodes_follows_the_thin_ray():
    """exp(-n A cot(depression)) between nodes exactly, as double logarithms go linearly."""
    density, depression = np.array([100.0, 400.0]), np.array([15.0, 60.0]) * DEG
    thin = np.exp(-0.003 * density[:, None] / np.tan(depression))
    grid = Spread(
        density, np.array([0.85]), depression, np.array([0.05]),
        quantile=np.tile(np.linspace(1.1, 0.0, 41), (2, 1, 2, 1, 1)), ground_share=thin[:, None, :, None],
        ground_lift=np.zeros((2, 1, 2, 1)),
    )  # fmt: skip
    _, share, _ = grid.cell(217.0, 0.85, 33.0 * DEG, 0.05)
    assert share == pytest.approx(np.exp(-0.003 * 217.0 / np.tan(33.0 * DEG)), abs=1e-9)
    drawn = grid.heights((np.arange(10_000) + 0.5) / 10_000, 217.0, 0.85, 33.0 * DEG, 0.05)
    assert np.mean(drawn == 0.0) == pytest.approx(share, abs=1e-3)


def test_the_command_writes_a_table_that_comes_back(small, tmp_path):
    table, _, out = small
    back = load_table(str(out))
    assert back.about["crop"] == "wheat"
    files = save_table(replace(table, about=back.about), tmp_path / out.name)
    assert [f.read_bytes() for f in files] == [(out.parent / f.name).read_bytes() for f in files]
    assert np.allclose(back.standing.quantile, table.standing.quantile, atol=5e-4)
    assert np.allclose(back.stubble.quantile, table.stubble.quantile, atol=5e-4)
    assert back.correlation == table.correlation
    assert back.about["range"]["depression_deg"] == [9.0, 45.0]


def test_what_comes_back_too_weakly_of_a_long_spot_is_lost():
    """At 10 deg a spot of 15 cm is 0.9 m long. Its far part is a pulse of its own where the crop is thin; a
    receiver of less reach misses it, and reports what is nearer and higher."""
    stands = SampleStands(load_crop("wheat"), Stream(1, "x"), tile_count=6)
    place = Place(200.0, 0.85, 10.0 * DEG, 0.15)
    blunt, sharp = (
        stands.scan(place, 60, EchoSettings(sensor=name), Stream(1, "y")).height
        for name in ("sick-lms111", "sick-lms511-sr")
    )
    assert np.mean(blunt - sharp) > 0.001
    again = SampleStands(load_crop("wheat"), Stream(1, "x"), tile_count=6)
    seen = again.scan(place, 60, EchoSettings(sensor="sick-lms511-sr"), Stream(1, "y")).height
    assert np.array_equal(seen, sharp, equal_nan=True)  # same seed, same bytes


def test_silhouette_reaches_down_through_the_densest_crop():
    """The branch layer of rape shades ten times as much as wheat: still known below it."""
    found = SampleStands(load_crop("rape"), Stream(1, "x"), tile_count=2).silhouette(
        Stream(1, "y"), relative_max=1.6, fine=0.02, rays=4000
    )
    for area in found:  # at 0.1, 0.5, 0.8 and 1 of the height
        assert area[5] > area[25] > area[40] > 5.0 * area[50] > 0.0
        assert area[0] < 1.3 * area[20]  # bare stems below the branches


def test_bad_tables_are_named(tmp_path):
    with pytest.raises(InputError, match="wheat-median"):
        load_table("no-such")
    (tmp_path / "t.npz").write_bytes(b"nothing")
    with pytest.raises(InputError, match=r"t\.npz"):
        load_table("t.npz", tmp_path)
    np.savez(tmp_path / "old.npz", silhouette=np.ones(3), lean=np.zeros((4, 2)))
    with pytest.raises(InputError, match="makes the table anew"):
        load_table("old.npz", tmp_path)


def test_correlation_length_is_found_again():
    rng = np.random.default_rng(1)
    places, seen = [], []
    for spot in (0.05, 0.10):
        gap = rng.choice([0.02, 0.05, 0.1], (400, LINE))
        z = rng.standard_normal((400, LINE))
        for k in range(1, LINE):
            rho = np.exp(-gap[:, k] / (0.01 + 0.4 * spot))
            z[:, k] = rho * z[:, k - 1] + np.sqrt(1 - rho**2) * z[:, k]
        places.append(Place(400.0, 0.85, 0.3, spot))
        seen.append(Returns(np.exp(z), z < -9, gap, z))
    c0, c1 = fit_correlation(places, seen)
    for spot in (0.05, 0.10):
        assert c0 + c1 * spot == pytest.approx(0.01 + 0.4 * spot, rel=0.1)


def test_normal_scores_of_ranks_with_ties_and_gaps():
    z = np.random.default_rng(2).permutation(101).astype(float)
    expected = [NormalDist().inv_cdf((v + 0.5) / 101) for v in z]
    assert np.allclose(normal_scores(z**3), expected, atol=1e-3)
    assert normal_scores(np.array([1.0, np.nan, 1.0])).tolist()[::2] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_measured_beams_over_known_stands(tmp_path, monkeypatch):
    """Two stands, one angle: the table gives back what was measured, and says so on held-out beams."""
    monkeypatch.setitem(SampleStands.silhouette.__kwdefaults__, "rays", 4_000)
    rng = np.random.default_rng(4)
    n = 3000
    density = np.where(np.arange(n) % 2 == 0, 200.0, 600.0)
    height = np.where(
        rng.uniform(size=n) < 20.0 / density,
        rng.normal(0.0, 0.01, n),
        0.9 - rng.gamma(2.0, 20.0 / density, n).clip(max=0.8),
    )
    columns = dict(
        zip(COLUMNS, (density, np.full(n, 0.85), np.full(n, 25.0), np.full(n, 60.0), height), strict=True)
    )
    path = tmp_path / "beams.csv"
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, rows, delimiter=",", header=",".join(COLUMNS), comments="")
    wheat, echo = load_crop("wheat"), EchoSettings(sub_rays=7)
    table, held_out = fit_samples(wheat, read_samples(path), SMALL.with_lines(3).stubble, echo, 1)
    assert len(held_out) == 2
    assert all(h.agreement.wasserstein_m < 0.03 for h in held_out)
    share = Stream(1, "x").at().uniform(size=4000)
    found = compare(table.standing.heights(share, 600.0, 0.85, 25.0 * DEG, 0.06), height[density == 600.0])
    assert found.wasserstein_m < 0.02
    assert abs(found.ground_bias) < 0.03


def test_the_command_refuses_what_is_no_table(tmp_path, capsys):
    assert main(["calibrate", "lidar", "--out", str(tmp_path / "t.yaml")]) == 2
    assert "--out" in capsys.readouterr().err
    (tmp_path / "few.csv").write_text("stems_per_m2,height_m\n1,2\n", encoding="utf-8")
    assert (
        main(["calibrate", "lidar", "--from", str(tmp_path / "few.csv"), "--out", str(tmp_path / "t.npz")])
        == 2
    )
    assert "crop_height_m" in capsys.readouterr().err
