"""The image sensor against its own data sheet, by the photon transfer of EMVA Standard 1288."""

from itertools import count
from pathlib import Path

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.sensing.camera.camera_sheet import load_camera
from swath.sensing.camera.error import ImageSensor, photon_rate

SIZE = (120, 160)
CARDS = ("camera-global-3um45", "camera-rolling-wide", "camera_60deg.yaml")
EXPOSURE = 2e-3


def sheet_of(name):
    return load_camera(name, Path(__file__).parent)


def made(sheet, stream="a"):
    sensor = ImageSensor(sheet, SIZE)
    sensor.reset(Stream(5, stream))
    return sensor


def gain_of(sheet):
    """The dark noise is to be seen over the steps of the numbers (EMVA 1288, section 2.5)."""
    return max(1.0, np.ceil(1.0 / (sheet.system_gain * sheet.dark_noise)))


def saturation_of(sheet, gain):
    return min(sheet.full_well, (sheet.digital_max - sheet.black_level) / (gain * sheet.system_gain))


def photon_transfer(sheet, steps=50, seed=1):
    """K, dark noise [electrons] and efficiency of pairs of flat fields (EMVA 1288, sections 6 and 7)."""
    sensor, rng = made(sheet), np.random.default_rng(seed)
    at = gain_of(sheet)
    photons = np.linspace(0.0, 0.7 * saturation_of(sheet, at) / sheet.efficiency(0), steps)
    mean, variance = [], []
    for mu in photons:
        a, b = (sensor.expose(np.full(SIZE, mu), EXPOSURE, rng, gain=at).astype(float) for _ in range(2))
        mean.append(0.5 * (a.mean() + b.mean()))
        variance.append(0.5 * ((a - b) ** 2).mean() - 0.5 * (a.mean() - b.mean()) ** 2)
    grey, noise = np.array(mean), np.array(variance)
    gain = np.polyfit(grey - grey[0], noise - noise[0], 1)[0]
    response = np.polyfit(photons, grey - grey[0], 1)[0]
    dark = [sensor.expose(np.zeros(SIZE), EXPOSURE, rng, gain=at).astype(float) for _ in range(24)]
    dark_variance = np.var(dark, axis=0, ddof=1).mean()  # less that of the dark current's electrons
    dark_noise = np.sqrt((dark_variance - 1.0 / 12.0) / gain**2 - sheet.dark_current * EXPOSURE)
    return gain / at, dark_noise, response / gain


@pytest.mark.parametrize("card", CARDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_photon_transfer_gives_the_card_back(card, seed):
    sheet = sheet_of(card)
    gain, dark_noise, efficiency = photon_transfer(sheet, seed=seed)
    assert gain == pytest.approx(sheet.system_gain, rel=0.02)
    assert dark_noise == pytest.approx(sheet.dark_noise, rel=0.02)
    assert efficiency == pytest.approx(sheet.efficiency(0), rel=0.02)


@pytest.mark.parametrize("pixels", [1, 4, 16])
def test_binned_pixels_are_means_of_pixels(pixels):
    """The mean of n pixels: the same numbers, noise less by sqrt(n)."""
    sheet = sheet_of(CARDS[0])
    rng, level = np.random.default_rng(2), 4000.0
    one = np.mean(
        [made(sheet, str(k)).expose(np.full(SIZE, level), EXPOSURE, rng) for k in range(pixels)], axis=0
    )
    binned = made(sheet.mean_of(pixels)).expose(np.full(SIZE, level * pixels), EXPOSURE, rng).astype(float)
    assert binned.mean() == pytest.approx(one.mean(), rel=1e-3)
    assert binned.std() == pytest.approx(one.std(), rel=0.03)


def test_saturation_and_black():
    sheet = sheet_of(CARDS[2])
    sensor, rng = made(sheet), np.random.default_rng(3)
    full = sensor.expose(np.full(SIZE, 1e6), EXPOSURE, rng)
    well = sheet.system_gain * sheet.full_well + sheet.black_level
    assert full.mean() == pytest.approx(min(well, sheet.digital_max), rel=1e-3)
    assert sensor.expose(np.full(SIZE, 1e6), EXPOSURE, rng, gain=4.0).min() == sheet.digital_max
    assert sensor.expose(np.zeros(SIZE), EXPOSURE, rng).mean() == pytest.approx(sheet.black_level, abs=0.3)


def test_fixed_pattern_is_that_of_the_sheet():
    """DSNU and PRNU from the mean of many pictures (EMVA 1288, section 8)."""
    sheet = sheet_of(CARDS[2])
    sensor, rng = made(sheet), np.random.default_rng(4)

    def mean(level):
        return np.mean([sensor.expose(np.full(SIZE, level), EXPOSURE, rng) for _ in range(100)], axis=0)

    dark, lit = mean(0.0), mean(16000.0)
    rest = sheet.dark_noise**2 / 100.0  # of the temporal noise
    dsnu = np.sqrt((dark.std() / sheet.system_gain) ** 2 - rest)
    assert dsnu == pytest.approx(sheet.dsnu, rel=0.05)
    signal = lit - dark
    noise = (16000.0 * 0.5 + 2 * sheet.dark_noise**2) / 100.0 * sheet.system_gain**2
    assert np.sqrt(signal.var() - noise) / signal.mean() == pytest.approx(sheet.prnu, rel=0.05)


def test_photons_of_an_irradiance():
    """EMVA 1288 eq. 3: 50.34 photons per um2, ms, um and uW/cm2 (0.01 W/m2)."""
    assert photon_rate(0.01, 1e-6, 1e-6) * 1e-3 == pytest.approx(50.34, rel=1e-3)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("card", CARDS)
def test_the_package_of_the_standard_gives_the_card_back(card, tmp_path, monkeypatch):
    """The evaluation of the package emva1288, where it is installed: pairs at 50 exposure times."""
    loader = pytest.importorskip("emva1288.process.loader")
    process = pytest.importorskip("emva1288.process.data")
    evaluate = pytest.importorskip("emva1288.process.results")
    monkeypatch.setattr(np, "asfarray", np.asarray, raising=False)  # version 1.0 is older than numpy 2
    sheet = sheet_of(card)
    sensor, rng, gain = made(sheet), np.random.default_rng(6), gain_of(sheet)
    top = saturation_of(sheet, gain) * 1.2 / sheet.efficiency(0)
    times = np.linspace(0.02, 1.0, 50) * 10e-3
    number, images = count(), {"temporal": {}, "spatial": {}}

    def take(mu, exposure, times):
        taken = [sensor.expose(np.full(SIZE, mu), exposure, rng, gain=gain).astype(int) for _ in range(times)]
        names = [f"{next(number)}.npy" for _ in taken]
        for name, picture in zip(names, taken, strict=True):
            np.save(tmp_path / name, picture)
        return names

    for exposure in times.tolist():
        mu = top * exposure / times[-1]
        images["temporal"][exposure * 1e9] = {0.0: take(0.0, exposure, 2), mu: take(mu, exposure, 2)}
    half = times[25]
    mu = 0.4 * top
    images["spatial"][half * 1e9] = {0.0: take(0.0, half, 16), mu: take(mu, half, 16)}
    loaded = loader.LoadImageData(images, path=str(tmp_path), fload=np.load)
    found = evaluate.Results1288(process.Data1288(loaded.data).data)
    measured = [found.K, found.QE, found.sigma_d]
    card = [gain * sheet.system_gain, 100.0 * sheet.efficiency(0), sheet.dark_noise]
    assert measured == pytest.approx(card, rel=0.02)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("quantum_efficiency_percent: [50]|quantum_efficiency_percent: [50, 40]", "three: red, green, blue"),
        ("quantum_efficiency_percent: [50]|quantum_efficiency_percent: [130]", "at most 100"),
        ("bits: 12|bits: 40", "bits = 40: expected <= 16"),
        ("distortion: [-0.2, 0.05, 0.001, -0.0005, 0.0]|distortion: [1, 2]", "expected 0 or 5 or 8 numbers"),
        ("exposure_min_ms: 0.01|exposure_min_ms: 30", "expected at most exposure_max_ms"),
        ("shutter: rolling|shutter: both", "shutter = both"),
    ],
)
def test_a_sheet_that_is_no_camera_is_refused_with_its_line(tmp_path, change, expected):
    text = Path(__file__).with_name("camera_60deg.yaml").read_text()
    old, new = change.split("|")
    assert old in text
    (tmp_path / "mine.yaml").write_text(text.replace(old, new))
    with pytest.raises(InputError, match=expected) as caught:
        load_camera("mine.yaml", tmp_path)
    assert "mine.yaml:" in str(caught.value)
