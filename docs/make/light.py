"""`python -m docs.make.light`: the table of the clear sky, `src/swath/data/light/clear-sky.yaml`.

SPECTRL2 as pvlib has it, with the air of a summer's day on a field; below 5 deg, where it has no multiple
scattering, its colours with the illuminance of Janiczek and DeYoung 1987 (US Naval Observatory Circular 171;
Seidelmann 1992, Explanatory Supplement to the Astronomical Almanac, 9.34).
"""

from pathlib import Path

import numpy as np

FILE = Path("src/swath/data/light/clear-sky.yaml")
WAVELENGTHS = (460, 540, 620, 850, 905, 940, 1550)  # colours of a camera, scanners [nm]
ELEVATIONS = (-12, -10, -8, -6, -5, -4, -3, -2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20,
              25, 30, 40, 50, 60, 75, 90)  # fmt: skip
AIR = {"precipitable_water": 2.0, "ozone": 0.31, "aerosol_turbidity_500nm": 0.15, "ground_albedo": 0.2,
       "surface_pressure": 101_325.0, "dayofyear": 206}  # fmt: skip
LOWEST = 1.0  # of SPECTRL2 [deg]: its colours serve below, too
SCATTERS = 5.0  # from this elevation on its illuminance counts [deg]
BAND = 20.0  # half width over which it is averaged [nm]
# From this elevation [deg] on: coefficients of lg E in x = elevation / 90 deg
CLEAR_SKY = (
    (20.0, 3.74, 3.97, -4.07, 1.47),
    (5.0, 3.05, 13.28, -45.98, 64.33),
    (-0.8, 2.88, 22.26, -207.64, 1034.30),
    (-5.0, 2.88, 21.81, -258.11, -858.36),
    (-12.0, 2.70, 12.17, -431.69, -1899.83),
)
HEAD = """# Clear sky by the sun's elevation: SPECTRL2 (Bird and Riordan 1986, Journal of Climate and Applied Meteorology
# 25, 87-97) with 2 cm of water, 0.31 cm of ozone, aerosol depth 0.15 at 500 nm, on 25 July; below 5 deg with the
# illuminance of Janiczek and DeYoung 1987. Made by `python -m docs.make.light`.
# rows: elevation [deg]; across the sun, then of the sky on level ground: irradiance at the wavelengths
# [mW/(m2 nm)], illuminance [lx], irradiance of 300 to 4000 nm [W/m2]
"""


def illuminance(elevation: float) -> float:
    """Illuminance on level ground under a clear sky [lx], -12 to 90 deg."""
    x = elevation / 90.0
    row = next((r for r in CLEAR_SKY if elevation >= r[0]), CLEAR_SKY[-1])
    return float(10.0 ** (row[1] + x * (row[2] + x * (row[3] + x * row[4]))))


def luminous(wavelength: np.ndarray) -> np.ndarray:
    """V of a wavelength [nm] of CIE 1924, by Wyman, Sloan and Shirley 2013 (JCGT 2, 2)."""

    def lobe(height: float, at: float, below: float, above: float) -> np.ndarray:
        return height * np.exp(-0.5 * ((wavelength - at) / np.where(wavelength < at, below, above)) ** 2)

    return lobe(0.821, 568.8, 46.9, 40.5) + lobe(0.286, 530.9, 16.3, 31.1)


def of_sun_and_sky(elevation: float) -> list[list[float]]:
    """Two lists: of the sun, of the sky, as in a row."""
    from pvlib.atmosphere import get_relative_airmass
    from pvlib.spectrum import spectrl2

    zenith = 90.0 - max(elevation, LOWEST)
    mass = get_relative_airmass(zenith, "kastenyoung1989")
    made = spectrl2(apparent_zenith=zenith, aoi=zenith, surface_tilt=0, relative_airmass=mass, **AIR)
    at = np.ravel(made["wavelength"])
    fine, seen = np.arange(-BAND, BAND + 1.0), np.arange(380.0, 781.0)
    found = []
    for name in ("dni", "dhi"):
        spectrum = np.ravel(made[name])
        bands = [1e3 * np.interp(w + fine, at, spectrum).mean() for w in WAVELENGTHS]
        lux = 683.0 * np.trapezoid(np.interp(seen, at, spectrum) * luminous(seen), seen)
        found.append(np.array([*bands, lux, np.trapezoid(spectrum, at)]))
    sun, sky = found
    if elevation <= 0.0:
        sun = 0.0 * sun
    if elevation < SCATTERS:
        level = sun[-2] * np.sin(np.radians(max(elevation, 0.0))) + sky[-2]
        share = illuminance(elevation) / level
        sun, sky = sun * share, sky * share
    return [[float(f"{v:.4g}") for v in values] for values in (sun, sky)]


def text() -> str:
    """Of the file."""
    rows = "".join(
        f"  - [{e}, {', '.join(f'{v:g}' for part in of_sun_and_sky(e) for v in part)}]\n" for e in ELEVATIONS
    )
    return f"{HEAD}wavelengths_nm: {list(WAVELENGTHS)}\nrows:\n{rows}"


if __name__ == "__main__":
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_text(text())
