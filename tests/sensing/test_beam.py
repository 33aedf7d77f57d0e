from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swath.core.errors import InputError
from swath.documents.data_sheets import find_sheet, read_sheet, sheet_names
from swath.rays.hits import Spots
from swath.sensing.beam import (
    FWHM_TO_E2,
    Beam,
    full_angle,
    offsets_of,
    random_pattern,
    spot_pattern,
    turned_pattern,
)
from swath.sensing.lidar_sheet import load_lidar

NESTED = [1, 7, 19, 37, 61]
E2 = np.exp(-2.0)


def energy_inside(radius, profile):
    """Share of a spot's energy within a radius, by the profiles' own formulas."""
    return radius**2 if profile == "uniform" else (1 - np.exp(-2 * radius**2)) / (1 - E2)


@pytest.mark.parametrize("count", [*NESTED, 5, 12])
@pytest.mark.parametrize("profile", ["uniform", "gaussian"])
def test_pattern_is_centred_inside_the_spot_and_holds_the_profile(count, profile):
    pattern = spot_pattern(count, profile)
    assert pattern.position.shape == (count, 2)
    assert pattern.weight.sum() == pytest.approx(1.0, abs=1e-12)
    assert pattern.weight.min() > 0.0
    assert pattern.outermost < 1.0
    radius = np.hypot(*pattern.position.T)
    if count in NESTED:
        assert np.abs(pattern.weight @ pattern.position).max() < 1e-12
    if count in NESTED[1:]:
        # second moment of the disc: 1/2 uniform; gaussian exp(-2 r^2) cut at r = 1: 1/2 - 1/(e^2 - 1)
        expected = 0.5 if profile == "uniform" else 0.5 - 1.0 / (np.e**2 - 1)
        # no polynomial of the energy for the gaussian: a little low, its rim is thin
        tolerance = 1e-12 if profile == "uniform" else 0.036 if count < 37 else 0.015
        assert pattern.weight @ radius**2 == pytest.approx(expected, abs=tolerance)
        share = energy_inside(radius, profile)
        assert pattern.weight @ share == pytest.approx(0.5, abs=1e-12)
        if count != 19:
            assert pattern.weight @ share**2 == pytest.approx(1 / 3, abs=1e-12)
        if count == 61:
            assert pattern.weight @ share**3 == pytest.approx(1 / 4, abs=1e-12)


@pytest.mark.parametrize("profile", ["uniform", "gaussian"])
def test_patterns_are_nested_and_round(profile):
    for small, large in pairwise(NESTED):
        few, many = spot_pattern(small, profile), spot_pattern(large, profile)
        apart = np.linalg.norm(few.position[:, None] - many.position[None], axis=2)
        assert apart.min(axis=1).max() < 1e-12
        x, y = many.position.T
        assert many.weight @ (x * y) == pytest.approx(0.0, abs=1e-12)
        assert many.weight @ (x**2 - y**2) == pytest.approx(0.0, abs=1e-12)
        assert (
            np.linalg.norm(many.position[:, None] - many.position[None], axis=2)[
                ~np.eye(large, dtype=bool)
            ].min()
            > 0.02
        )  # no two sub-rays on one place


def test_weights_follow_the_energy_of_rings():
    # what lies within 3/4 of a uniform spot's radius: 9/16 of its energy
    for count, tolerance in ((19, 0.2), (37, 0.15), (61, 0.1)):
        pattern = spot_pattern(count, "uniform")
        inside = pattern.weight[np.hypot(*pattern.position.T) < 0.75].sum()
        assert inside == pytest.approx(9 / 16, abs=tolerance)


def test_outermost_sub_ray_lies_where_the_docs_say():
    outermost = [spot_pattern(n, "uniform").outermost for n in NESTED]
    assert outermost == pytest.approx(np.sqrt([0.0, 2 / 3, 2 / 3, 5 / 6, 0.94]))


def test_more_sub_rays_see_more_of_the_energy_behind_an_edge():
    """Energy of a uniform spot on one side of a straight edge, anywhere across it: root mean square error."""
    rng = np.random.default_rng(2)
    turn, at = rng.uniform(0, 2 * np.pi, 1000), rng.uniform(-1, 1, 1000)
    exact = 0.5 + (at * np.sqrt(1 - at**2) + np.arcsin(at)) / np.pi
    errors = []
    for count in NESTED:
        pattern = spot_pattern(count, "uniform")
        beside = (
            np.cos(turn)[:, None] * pattern.position[:, 0] + np.sin(turn)[:, None] * pattern.position[:, 1]
        )
        errors.append(np.sqrt(np.mean(((beside < at[:, None]) @ pattern.weight - exact) ** 2)))
    assert np.all(np.array(errors) < [0.3, 0.075, 0.035, 0.022, 0.017])
    assert np.all(np.diff(errors) < 0)


@pytest.mark.parametrize("profile", ["uniform", "gaussian"])
def test_random_and_turned_patterns_keep_the_energy(profile):
    rng = np.random.default_rng(3)
    drawn = random_pattern(rng, 2000, 19, profile)
    radius = np.hypot(drawn.position[..., 0], drawn.position[..., 1])
    assert radius.max() <= 1.0
    share = energy_inside(radius, profile).ravel()
    assert np.histogram(share, 4, (0, 1))[0] / share.size == pytest.approx([0.25] * 4, abs=0.01)
    fixed = spot_pattern(19, profile)
    turned = turned_pattern(rng, 5, fixed)
    assert turned.position.shape == (5, 19, 2)
    assert np.allclose(np.hypot(*np.moveaxis(turned.position, 2, 0)), np.hypot(*fixed.position.T))


def test_spot_grows_from_the_exit_with_the_full_divergence():
    beam = Beam((0.013, 0.013), (4.7e-3, 4.7e-3), "uniform")
    assert beam.diameter(10.0)[0] == pytest.approx(0.060)  # data sheet arithmetic: 13 mm + 47 mm
    ring = np.stack([np.cos(np.linspace(0, 6, 9)), np.sin(np.linspace(0, 6, 9))], axis=1)
    axes = np.eye(3)[None]
    start, direction = Spots(np.zeros((1, 3)), axes, offsets_of(beam, ring[None])).rays()
    at_10 = start + direction * (10.0 / direction[..., :1])
    assert np.allclose(np.linalg.norm(at_10[0, :, 1:], axis=1), 0.030, atol=1e-6)


def test_conventions_mean_what_they_say():
    assert full_angle(3.0, "half_angle", "1/e2", "gaussian") == 6.0
    assert full_angle(3.0, "full_angle", "edge", "gaussian") == 3.0
    assert full_angle(3.0, "full_angle", "FWHM", "uniform") == 3.0
    # half the peak of exp(-2 (r/w)^2) is where the FWHM ends
    w = 0.5 * full_angle(1.0, "full_angle", "FWHM", "gaussian")
    assert np.exp(-2.0 * (0.5 / w) ** 2) == pytest.approx(0.5)


@given(st.integers(2, 217), st.sampled_from(["uniform", "gaussian"]))
def test_any_count_of_sub_rays_works(count, profile):
    pattern = spot_pattern(count, profile)
    assert pattern.position.shape == (count, 2)
    assert pattern.weight.sum() == pytest.approx(1.0)
    assert 0.0 < pattern.outermost < 1.0


@pytest.mark.parametrize(
    ("name", "spot_mm_at_8_m"),
    [
        ("sick-lms111", (128, 128)),
        ("sick-lms511-hr", (51, 51)),
        ("sick-lms511-sr", (108, 108)),
        ("sick-tim561", (122, 76)),
        ("velodyne-vlp16", (37, 22)),
        ("sick-lms291", (108, 108)),
    ],
)
def test_bundled_scanners_have_their_published_spots(name, spot_mm_at_8_m):
    sheet = load_lidar(name)
    assert np.allclose(sheet.beam.diameter(8.0) * 1e3, spot_mm_at_8_m, atol=1.0)


def test_ouster_spot_is_converted_from_its_half_width():
    # data sheet: 10 mm + 0.13 deg, both at half maximum
    spot = load_lidar("ouster-os1-64").beam.diameter(10.0) / FWHM_TO_E2
    assert np.allclose(spot, 0.010 + 10 * np.radians(0.13), atol=2e-4)


def test_every_bundled_scanner_loads_with_a_source_for_each_number():
    names = [n for n in sheet_names("sensors") if read_sheet("sensors", n).value("kind") == "lidar"]
    assert len(names) >= 10
    for name in names:
        sheet = load_lidar(name)
        assert sheet.noise[:, 1].max() < 0.11
        assert sheet.echo_count >= 1
        assert 1e-9 < sheet.pulse < 20e-9


def test_faulty_sheet_names_key_and_file(tmp_path):
    text = find_sheet("sensors", "sick-lms111").read_text()
    bad = tmp_path / "mine.yaml"
    bad.write_text(text.replace("[15.0, 15.0]", "[15.0]"))
    with pytest.raises(InputError, match=r"beam.divergence_mrad.1: expected a value.*mine.yaml"):
        load_lidar("mine.yaml", tmp_path)
    bad.write_text(text.replace("  convention: full_angle\n", ""))
    with pytest.raises(InputError, match=r"beam.convention.*missing.*mine.yaml"):
        load_lidar("mine.yaml", tmp_path)
    bad.write_text(text.replace("contour: edge", "contour: 1/e"))
    with pytest.raises(InputError, match=r"beam.contour = '?1/e'?: expected one of 1/e2, FWHM, edge"):
        load_lidar("mine.yaml", tmp_path)
    bad.write_text(text.replace("tag: S", "tag: sure"))
    with pytest.raises(InputError, match=r"tag = sure: expected one of S seen in the source"):
        load_lidar("mine.yaml", tmp_path)
    with pytest.raises(InputError, match="did you mean 'sick-lms111'"):
        load_lidar("sick-lms11")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "divergence_mrad",
            "divergance_mrad",
            r"beam.divergance_mrad: unknown key, .*'divergence_mrad'",
        ),
        ("  count:", "  cuont:", r"echo.cuont: unknown key, did you mean 'count'\?"),
        ("divergence_mrad: {value: [15.0", "divergence_mrad: {value: [860", "<= 100"),
        ("step_deg", "step_rad", "scan.step_rad: unknown key, did you mean 'step_deg'.* expected in deg"),
        (
            "step_deg: {value: 0.5",
            "step_deg: {unit: deg, value: 0.5",
            "step_deg.unit = deg: unknown key",
        ),
        ("kind: lidar", "kind: radar", "kind = radar: expected one of lidar"),
        ("noise_mm: {value:", "noise_mm: {vale:", r"expected a number, or \{value: 4.7, tag: S"),
        ("[5, 12.0], [20", "[25, 12.0], [20", "range.noise_mm.*whose first numbers rise"),
        ("step_deg: {value: 0.5", "step_deg: -0.5 #", "step_deg = -0.5: expected >"),
    ],
)
def test_a_slip_in_an_own_sheet_is_named_with_its_line(tmp_path, old, new, message):
    text = find_sheet("sensors", "sick-lms111").read_text()
    assert old in text
    path = tmp_path / "mine.yaml"
    path.write_text(text.replace(old, new))
    line = 1 + text[: text.index(old)].count("\n")
    with pytest.raises(InputError, match=rf"{message}.*mine.yaml:{line}\)"):
        load_lidar("mine.yaml", tmp_path)
