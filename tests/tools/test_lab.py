"""The lab: where it puts heights, how it compares them, what it writes, and the trends it must show."""

import csv
import textwrap
from functools import cache

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.errors import InputError
from swath.tools.distributions import wasserstein1
from swath.tools.lab.comparison import (
    RATED,
    CaseComparison,
    LevelComparison,
    compare_levels,
    describe,
    list_rows,
    rating_of,
    repeatability,
)
from swath.tools.lab.lab import Case, CaseHeights, Lab, Settings, run_lab
from swath.tools.lab.measured_heights import MeasuredHeights, read_measured
from swath.tools.lab.page import HEAD, LABELS, comparison_rows

pytestmark = pytest.mark.usefixtures("code_allowed")

TINY = {"densities": (150.0,), "sensors": ("sick-lms511-hr",), "depressions_deg": (45.0,)}
TINY |= {"passes": 1, "stops": 2, "levels": ("plants",)}
CASE = Case(200.0, "sick-lms511-hr", 45.0, 0.04)


def heights_of(lab, level="plants"):
    return lab.cases[0].heights[level]


def test_same_settings_same_heights_and_seeds_on_their_own():
    both = heights_of(run_lab(Settings(**TINY, seeds=2)))
    again = heights_of(run_lab(Settings(**TINY, seeds=2)))
    alone = heights_of(run_lab(Settings(**TINY, seed=2, seeds=1)))
    np.testing.assert_array_equal(both[0], again[0])
    np.testing.assert_array_equal(both[1], alone[0])
    assert not np.array_equal(both[0], both[1])


@pytest.mark.parametrize("degrees", [15.0, 60.0])
def test_a_table_of_known_height_is_measured_where_it_is(degrees, tmp_path):
    """A level that sees a plane 0.4 m above the ground: every beam must end on it, however it looks."""
    (tmp_path / "plane.py").write_text(
        textwrap.dedent('''
        """A plane 0.4 m above the ground."""
        import numpy as np
        from dataclasses import dataclass, field
        from swath.sensing.mount import Mount
        from swath.sensing.scanner import Scanner

        @dataclass(frozen=True)
        class Params:
            sensor: str = "sick-lms511-hr"
            mount: Mount = field(default_factory=Mount)
            sector_deg: tuple[float, float] | None = None
            step_deg: float | None = None
            reach_m: float = 40.0
            noise: str = "none"

        class Plane:
            Params = Params
            def __init__(self, params, setup):
                self.scanner = Scanner(params, setup)
            def reset(self, stream):
                return self.scanner.reset(stream)
            def step(self, t, dt, inputs):
                origins, rotations = self.scanner.sweep(inputs["state"], t + dt)
                down = np.einsum("nij,nj->ni", rotations, self.scanner.axes[:, :, 0])[:, 2]
                distance = (0.4 - origins[:, 2]) / down
                points = np.zeros((len(distance), 3))
                return self.scanner.outputs_of(t + dt, distance, np.ones(len(distance)), points, origins)
        ''')
    )
    settings = Settings(
        **TINY | {"levels": ("plane.py:Plane",), "depressions_deg": (degrees,)}, seeds=1, base=tmp_path
    )
    found = np.concatenate(heights_of(run_lab(settings), "plane.py:Plane"))
    assert len(found) == 2 * 41
    np.testing.assert_allclose(found, 0.4, atol=1e-5)


def made_lab(**heights):
    levels = {name: tuple(rows) for name, rows in heights.items()}
    return Lab(Settings(**TINY), 0.85, tuple(levels), (CaseHeights(CASE, levels),), ())


def normal(seed, shift=0.0, count=2000):
    return 0.6 + shift + 0.1 * np.random.default_rng(seed).standard_normal(count)


def test_repeatability_is_the_worst_pair():
    band = repeatability([normal(1), normal(1, shift=0.01), normal(1, shift=-0.04)])
    assert band["wasserstein_m"] == pytest.approx(0.05)
    assert band["p95_bias_m"] == pytest.approx(0.05)
    assert band["std_ratio"] == pytest.approx(0.0, abs=1e-9)
    assert 0.0 < repeatability([normal(1), normal(2)])["ks"] < 0.06
    assert np.isnan(repeatability([normal(1)])["ks"])


@pytest.mark.parametrize(
    ("number", "value", "band", "rating"),
    [
        ("wasserstein_m", 0.05, 0.06, "repeatable"),
        ("wasserstein_m", 0.019, 0.001, "good"),
        ("wasserstein_m", 0.03, 0.001, "fair"),
        ("wasserstein_m", 0.05, 0.001, "off"),
        ("wasserstein_m", 0.019, float("nan"), "good"),
        ("intersection", 0.95, 0.06, "repeatable"),
        ("intersection", 0.80, 0.06, "fair"),
        ("p95_bias_m", -0.05, 0.06, "repeatable"),
        ("p95_bias_m", -0.03, 0.001, "off"),
        ("std_ratio", 0.81, 0.01, "good"),
        ("std_ratio", 0.79, 0.01, "off"),
        ("std_ratio", 0.79, 0.30, "repeatable"),
        ("std_ratio", 1.24, 0.01, "good"),
    ],
)
def test_ratings(number, value, band, rating):
    assert rating_of(number, value, band) == rating


def test_levels_against_real_and_against_the_reference():
    plants = [normal(k) for k in range(3)]
    lab = made_lab(plants=plants, empirical=[h + 0.03 for h in plants])
    real = MeasuredHeights("field.csv", np.concatenate([normal(9), [np.nan]]), {})
    case = compare_levels(lab, real)[0]
    found = {(j.level, j.against): j for j in case.comparisons}
    assert set(found) == {("plants", "real"), ("empirical", "plants"), ("empirical", "real")}
    shifted = found["empirical", "plants"]
    assert shifted.value["wasserstein_m"] == pytest.approx(0.03)
    assert shifted.value["p95_bias_m"] == pytest.approx(0.03)
    assert shifted.ratings["wasserstein_m"] == "fair"
    assert shifted.ratings["p95_bias_m"] == "off"
    assert shifted.rating == "off"
    assert found["plants", "real"].value["p95_bias_m"] == pytest.approx(
        np.mean([np.percentile(h, 95) for h in plants]) - np.percentile(normal(9), 95)
    )


def test_numbers_are_told_in_the_unit_of_their_label():
    rng = np.random.default_rng(1)
    value = {n: float(rng.uniform(-1.0, 1.0)) for n in RATED}
    made = LevelComparison("empirical", "plants", value, {}, dict.fromkeys(RATED, "good"))
    row = comparison_rows([CaseComparison(CaseHeights(CASE, {}), np.zeros(0), (made,))])[0]
    told = dict(zip(HEAD, row, strict=True))
    for n in RATED:
        assert float(told[LABELS[n]]) == pytest.approx(value[n], rel=0.005)


def test_too_few_returns_are_not_compared():
    lab = made_lab(plants=[np.full(500, np.nan)], empirical=[normal(1)])
    assert compare_levels(lab, None)[0].comparisons == ()
    assert [row["against"] for row in list_rows(compare_levels(lab, None))] == ["", ""]


def test_description():
    found = describe(np.array([0.0, 0.04, 0.5, 0.7, np.nan]))
    assert found["ground_share"] == 0.5
    assert found["silent_share"] == pytest.approx(0.2)
    assert found["crop_mean_m"] == pytest.approx(0.6)
    assert found["crop_std_m"] == pytest.approx(0.1)
    assert found["beams"] == 5


def test_real_heights_by_case(tmp_path):
    file = tmp_path / "real.csv"
    rows = ["height_m,stems_per_m2,sensor,depression_deg,note"]
    rows += ["0.7,200,sick-lms511-hr,45,a", "0.8,600,sick-lms511-hr,45,b", ",200,sick-lms511-hr,45.2,c"]
    rows += ["0.9,200,sick-lms511-sr,45,d", "0.6,200,sick-lms511-hr,30,e"]
    file.write_text("\n".join(rows) + "\n")
    np.testing.assert_array_equal(read_measured(file).of(CASE), [0.7, np.nan])
    everywhere = tmp_path / "everywhere.csv"
    everywhere.write_text("height_m\n0.5\n0.6\n")
    np.testing.assert_array_equal(read_measured(everywhere).of(CASE), [0.5, 0.6])
    assert len(read_measured(everywhere).of(Case(600.0, "x", 45.0, 0.04))) == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("z\n1\n", "expected height_m"),
        ("height_m\n0.5\nhigh\n", "height_m = high: expected a number (.*:3)"),
        ("height_m\n850\n", "expected metres"),
        ("height_m\n\n", "at least one number"),
        ("height_m,depression_deg\n0.5,\n", "depression_deg"),
        ("height_m\n0,85\n", "decimals with a point .*:2"),
        ("height_m,height_m\n0.5,0.6\n", "height_m: expected once"),
    ],
)
def test_bad_real_heights(tmp_path, text, said):
    file = tmp_path / "real.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=said):
        read_measured(file)
    with pytest.raises(InputError, match="expected a table, there is no such file"):
        read_measured(tmp_path / "none.csv")


def lab_command(out, *more):
    flags = ["--stems-per-m2", "150", "--sensor", "sick-lms511-hr", "--depression-deg", "45", "--seeds", "2"]
    return main(["lab", "stand", "--out", str(out), *flags, *more])


def test_command(tmp_path, capsys):
    """All levels and real heights: files, the same bytes again, and what the table says is in the files."""
    real = tmp_path / "mine.csv"
    real.write_text("height_m\n" + "\n".join(f"{h:.3f}" for h in normal(5)) + "\n")
    out = tmp_path / "lab"
    assert lab_command(out, "--real", str(real)) == 0
    first = {f.name: f.read_bytes() for f in sorted(out.iterdir())}
    assert set(first) == {"lab.csv", "report.html"}
    assert lab_command(out, "--real", str(real)) == 0
    assert {f.name: f.read_bytes() for f in sorted(out.iterdir())} == first
    with (out / "lab.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {(r["level"], r["against"]) for r in rows} >= {("real", ""), ("plants", "real")}
    page = first["report.html"].decode()
    assert "mine.csv" in page
    assert "No real heights were given" not in page
    assert ">real</td>" in page


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--levels", "plant"], "did you mean 'plants'"),
        (["--set", "ecko=nearest"], "did you mean 'echo'"),
        (["--set", "echo=nearer", "--levels", "plants"], "echo = nearer"),
        (["--stems-per-m2", "0"], "--stems-per-m2"),
        (["--depression-deg", "90"], "--depression-deg"),
        (["--sensor", "sick-lms512"], "sick-lms512"),
        (["--crop", "what"], "what"),
        (["--seeds", "0"], "--seeds"),
    ],
)
def test_bad_options(tmp_path, capsys, more, said):
    assert lab_command(tmp_path / "lab", *more) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "lab").exists()


def test_nothing_is_overwritten(tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("mine")
    assert lab_command(tmp_path) == 2
    assert "--out" in capsys.readouterr().err


# Trends of wheat with leaves, drilled in rows. 2 seeds of 3 x 6 sweeps of 41 beams: means scatter by 4 mm
# (sd of the crop returns over the root of about 400 independent beams, and of two seeds), std by 2 mm; the
# smallest step between neighbours in the nearest echo is 20 mm for the mean and 4 mm for the std.
DEGREES = (15.0, 30.0, 45.0, 60.0)
SENSORS = ("sick-lms511-hr", "sick-lms511-sr")  # spots of 3.7 and 7.3 cm at the crop


@cache
def trends(echo):
    lab = run_lab(
        Settings(seeds=2, passes=3, stops=6, levels=("plants",), sets={"noise": "none", "echo": echo})
    )
    found = {}
    for case in lab.cases:
        seen = describe(np.concatenate(case.heights["plants"]))
        c = case.case
        found[c.density, c.sensor, c.depression_deg] = seen["crop_mean_m"], seen["crop_std_m"]
    return found


@pytest.mark.parametrize("echo", ["nearest", "percentile"])
def test_std_falls_with_density_and_with_the_spot(echo):
    found = trends(echo)
    for degrees in DEGREES:
        for sensor in SENSORS:
            assert found[600.0, sensor, degrees][1] < found[200.0, sensor, degrees][1]
        for density in (200.0, 600.0):
            assert found[density, SENSORS[1], degrees][1] < found[density, SENSORS[0], degrees][1]


def test_std_falls_with_a_flatter_view():
    """Of the nearest echo at every step. The median loses its lower half to the ground when few stems are
    seen steeply, so there it is asked only of the dense stand."""
    for echo, density in (("nearest", 200.0), ("nearest", 600.0), ("percentile", 600.0)):
        for sensor in SENSORS:
            std = [trends(echo)[density, sensor, b][1] for b in DEGREES]
            assert (np.diff(std) > 0.0).all()


@pytest.mark.parametrize("echo", ["nearest", "percentile"])
def test_a_flatter_view_sees_higher_crop(echo):
    """Ehlert, Heisig and Adamek 2010: the apparent height of winter wheat rises with a flatter view."""
    for density in (200.0, 600.0):
        for sensor in SENSORS:
            mean = [trends(echo)[density, sensor, b][0] for b in DEGREES]
            assert (np.diff(mean) < -0.01).all()


def test_a_larger_spot_sees_higher_crop():
    """When the nearest touched thing counts; of the median of the spot it is not so."""
    found = trends("nearest")
    for density in (200.0, 600.0):
        for degrees in DEGREES:
            assert found[density, SENSORS[1], degrees][0] > found[density, SENSORS[0], degrees][0] + 0.01


@pytest.mark.parametrize("degrees", [30.0, pytest.param(60.0, marks=pytest.mark.draws)])
def test_replay_of_passes_aside_agrees(degrees):
    """The lab records passes 0.3 m aside for replay: within 2 cm of plants, in thin crop too.

    Three stands of 1312 beams together: from one thin stand to the next plants itself moves by 2 to 4 cm.
    """
    settings = Settings(
        densities=(200.0,),
        sensors=SENSORS[:1],
        depressions_deg=(degrees,),
        levels=("plants", "replay"),
        seeds=3,
    )
    heights = run_lab(settings).cases[0].heights
    replay, plants = (np.concatenate(heights[level]) for level in ("replay", "plants"))
    assert wasserstein1(replay, plants) < 0.02
    assert np.isnan(replay).mean() < 0.02
