"""Positions with exchanged axes, other units, other signs: refused with the entry that mends them, anywhere
on earth and in any direction; right ones are read.
"""

import re

import numpy as np
import pytest

pytest.importorskip("scipy")
pytest.importorskip("pyproj")
pytest.importorskip("shapefile")

from swath.core.errors import InputError
from swath.field.projection import transform
from swath.field_io.log import read_log
from tests.field.unit_logs import Harvest, table

SEEDS = range(12)


def drawn(seed):
    """A harvest somewhere on earth, in some direction."""
    rng = np.random.default_rng(seed)
    lat = float(rng.uniform(15, 68)) * rng.choice([-1, 1])
    return Harvest(lat, float(rng.uniform(-179, 179)), azimuth_deg=float(rng.uniform(0, 360)),
                   width=float(rng.uniform(5, 13)), speed=float(rng.uniform(1.2, 2.6)), seed=seed, passes=8,
                   length=160.0)  # fmt: skip


def minutes(degrees):
    """Degrees as NMEA 0183 writes them."""
    whole = np.trunc(degrees)
    return 100.0 * whole + 60.0 * (degrees - whole)


WRONG = {
    "exchanged": lambda lat, lon: (lon, lat),
    "rad": lambda lat, lon: (np.radians(lat), np.radians(lon)),
    "ddmm": lambda lat, lon: (minutes(lat), minutes(lon)),
    "1e-7 deg": lambda lat, lon: (1e7 * lat, 1e7 * lon),
    "exchanged, ddmm": lambda lat, lon: (minutes(lon), minutes(lat)),
    "deg W": lambda lat, lon: (lat, -lon),
    "deg S": lambda lat, lon: (-lat, lon),
}  # fmt: skip


def witnesses(h):
    """All that a log may hold about its way."""
    return {
        "time_s": h.t, "speed_m_s": h.speed * h.one, "distance_m": h.speed * h.one,
        "width_m": h.width * h.one, "heading_deg": h.course, "flow_kg_s": h.flow,
    }  # fmt: skip


def written(path, lat, lon, columns):
    """Text; positions of ten decimals."""
    cells = {"lat": [f"{v:.10f}" for v in lat], "lon": [f"{v:.10f}" for v in lon]}
    return table(path / "log.csv", cells | columns)


def off(log, h):
    """Farthest from the true place [m]."""
    true = transform(np.column_stack([h.lon, h.lat]), "EPSG:4326", f"EPSG:{log.epsg}")
    return float(np.abs(log.position - true).max()) if len(log) == len(true) else np.inf


@pytest.mark.parametrize("seed", SEEDS)
def test_right_positions_are_read_without_a_word_whatever_the_log_holds(tmp_path, seed):
    h = drawn(seed)
    held = np.random.default_rng(seed).random(3) < 0.5
    left = np.array(["speed_m_s", "distance_m", "heading_deg"])[held]
    columns = {name: values for name, values in witnesses(h).items() if name not in left}
    log = read_log(written(tmp_path, h.lat, h.lon, columns))
    assert off(log, h) < 0.01
    assert not [note for note in log.notes if note.startswith("positions")]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("wrong", WRONG)
def test_wrong_positions_are_refused_with_entries_that_mend_them(tmp_path, wrong, seed):
    h = drawn(seed)
    if wrong.startswith("deg") and min(h.course[0] % 90, 90 - h.course[0] % 90) < 16:
        pytest.skip("a sign turns passes along an axis by less than a compass may")
    log = written(tmp_path, *WRONG[wrong](h.lat, h.lon), witnesses(h))
    with pytest.raises(InputError) as refused:
        read_log(log)
    assert refused.value.key == "log.positions"
    mended = []
    for entries in re.findall(r"lat: \{.*?\}, lon: \{.*?\}", refused.value.expected):
        (tmp_path / "map.yaml").write_text("\n".join(re.findall(r"\w+: \{.*?\}", entries)))
        mended.append(off(read_log(log, tmp_path / "map.yaml"), h))
    assert min(mended) < 0.01, refused.value.expected
