import numpy as np
import pytest

from swath.core.errors import InputError
from swath.data.cards import card_names
from swath.sensing.beam import Beam, echo_index, spot_pattern, sub_rays
from swath.sensing.card import load_lidar


@pytest.mark.parametrize("count", [1, 7, 19, 37, 61, 5, 12])
@pytest.mark.parametrize("profile", ["uniform", "gaussian"])
def test_pattern_is_centred_inside_the_spot_and_holds_the_profile(count, profile):
    pattern = spot_pattern(count, profile)
    assert pattern.shape == (count, 2)
    radius = np.hypot(*pattern.T)
    assert radius.max() < 1.0
    if count >= 19:
        assert np.abs(pattern.mean(axis=0)).max() < 0.04
        # second moment of the disc: 1/2 uniform; gaussian exp(-2 r^2) cut at r = 1: 1/2 - 1/(e^2 - 1)
        expected = 0.5 if profile == "uniform" else 0.5 - 1.0 / (np.e**2 - 1)
        assert np.mean(radius**2) == pytest.approx(expected, abs=0.03)


def test_spot_grows_from_the_exit_with_the_full_divergence():
    beam = Beam((0.013, 0.013), (4.7e-3, 4.7e-3), "uniform")
    assert beam.diameter(10.0)[0] == pytest.approx(0.060)  # data sheet arithmetic: 13 mm + 47 mm
    ring = np.stack([np.cos(np.linspace(0, 6, 9)), np.sin(np.linspace(0, 6, 9))], axis=1)
    axes = np.eye(3)[None]
    start, direction = sub_rays(np.zeros((1, 3)), axes, beam, ring[None])
    at_10 = start + direction * (10.0 / direction[..., :1])
    assert np.allclose(np.linalg.norm(at_10[0, :, 1:], axis=1), 0.030, atol=1e-6)


def test_echo_rules_on_known_distances():
    d = np.array([[5.0, 3.0, np.nan, 4.0, 6.0], [np.nan] * 5])
    assert echo_index(d, "nearest", 0.0).tolist() == [1, -1]
    assert echo_index(d, "percentile", 0.0).tolist() == [1, -1]
    assert echo_index(d, "percentile", 50.0).tolist() == [3, -1]
    assert echo_index(d, "percentile", 75.0).tolist() == [0, -1]
    assert echo_index(d, "percentile", 100.0).tolist() == [4, -1]


def test_percentile_echo_is_monotone_in_the_percentile():
    d = np.random.default_rng(1).uniform(2, 9, (40, 19))
    d[d > 8] = np.nan
    row = np.arange(40)
    ranges = [d[row, echo_index(d, "percentile", p)] for p in range(0, 101, 5)]
    assert np.all(np.diff(np.array(ranges), axis=0) >= 0)


@pytest.mark.parametrize(
    ("name", "spot_mm_at_8_m"),
    [
        ("sick-lms111", (128, 128)),
        ("sick-lms511-hr", (51, 51)),
        ("sick-lms511-sr", (108, 108)),
        ("sick-tim561", (122, 76)),
        ("velodyne-vlp16", (37, 22)),
    ],
)
def test_bundled_scanners_have_their_published_spots(name, spot_mm_at_8_m):
    card = load_lidar(name)
    assert np.allclose(card.beam.diameter(8.0) * 1e3, spot_mm_at_8_m, atol=1.0)


def test_every_bundled_scanner_loads_with_a_source_for_each_number():
    names = card_names("sensors")
    assert len(names) >= 5
    for name in names:
        assert load_lidar(name).noise[:, 1].max() < 0.1


def test_faulty_card_names_key_and_file(tmp_path):
    from swath.data.cards import find_card

    text = find_card("sensors", "sick-lms111").read_text()
    bad = tmp_path / "mine.yaml"
    bad.write_text(text.replace("[15.0, 15.0]", "[15.0]"))
    with pytest.raises(InputError, match=r"beam.divergence_mrad = \[15.0\].*mine.yaml"):
        load_lidar("mine.yaml", tmp_path)
    bad.write_text(text.replace("tag: S", "tag: sure"))
    with pytest.raises(InputError, match="tag and a source"):
        load_lidar("mine.yaml", tmp_path)
    with pytest.raises(InputError, match="did you mean 'sick-lms111'"):
        load_lidar("sick-lms11")
