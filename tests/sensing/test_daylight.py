"""The sun in a scanner's receiver against the closed forms of its reach and of its false echoes."""

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.random import Stream
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from swath.sensing.echo import with_false_echoes

TEXT = """
format: swath scenario 2
name: bright
run: {{distance_m: 4, max_duration_s: 6}}
field: {{edge: {{shape: straight}}{weather}}}
machines:
  combine:
    motion: single_track
    lidar: {{sub_rays: 1, step_deg: 10, sensor: {sensor}, daylight: {daylight}}}
"""


def scanner(elevation, daylight, sensor="sick-lms511-hr"):
    weather = (
        "" if elevation is None else f", weather: {{sun_azimuth_deg: 200, sun_elevation_deg: {elevation}}}"
    )
    text = TEXT.format(weather=weather, sensor=sensor, daylight=daylight)
    return assemble(parse_scenario(text)).leader.parts["lidar"].scanner


def reach(made):
    return (0.1 / made.least_energy) ** 0.5


@pytest.mark.parametrize("elevation", [-6.0, 10.0, 90.0])
def test_reach_falls_with_the_fourth_root_of_the_noise(elevation):
    dark = scanner(elevation, "{}")
    quiet, loud = (scanner(elevation, f"{{shot_noise: {n}}}") for n in (1.0, 15.0))
    x = (reach(dark) / reach(quiet)) ** 4 - 1.0
    assert 0.0 <= x < 1.3
    assert reach(loud) / reach(dark) == pytest.approx((1.0 + 15.0 * x) ** -0.25, rel=1e-9)


def test_a_full_day_of_fifteen_times_the_noise_halves_the_reach():
    bright = next(e for e in np.arange(50.0, 70.0, 0.5) if lux(e) >= 100_000.0)
    made = scanner(bright, "{shot_noise: 15}")
    assert reach(made) == pytest.approx(0.5 * made.sheet.range_10, rel=0.01)


def lux(elevation):
    from swath.field.light import light

    return light(np.radians(elevation)).lux


def test_a_sheet_whose_reach_holds_by_day_reaches_further_in_the_dark():
    made = scanner(-12.0, "{shot_noise: 15}", "ouster-os1-64")
    assert made.sheet.reach_klx == 100.0
    assert reach(made) == pytest.approx(2.0 * made.sheet.range_10, rel=1e-3)


def test_a_threshold_that_stays_is_crossed_as_often_as_rice_says():
    made = scanner(40.0, "{shot_noise: 3, threshold_sd: 6}")
    dark = scanner(-12.0, "{shot_noise: 3, threshold_sd: 6}")
    assert made.least_energy == dark.least_energy
    bandwidth = 0.44 / made.sheet.pulse
    assert dark.false_per_m * 299_792_458.0 / 2.0 == pytest.approx(
        bandwidth / 3**0.5 * np.exp(-18.0), rel=1e-3
    )
    assert made.false_per_m > 1000.0 * dark.false_per_m


def test_false_echoes_come_before_what_is_met_as_a_poisson_process():
    far = np.repeat([[30.0, 31.0], [np.nan, np.nan]], 20_000, axis=0)
    distance, albedo = with_false_echoes(
        far, np.ones_like(far), 0.02, (1.0, 40.0), 1e-4, Stream(1, "air").at(5)
    )
    false = np.isfinite(distance).all(axis=1) & (distance[:, 0] == distance[:, 1])
    assert false[:20_000].mean() == pytest.approx(1 - np.exp(-0.02 * 29.0), abs=0.015)
    assert false[20_000:].mean() == pytest.approx(1 - np.exp(-0.02 * 39.0), abs=0.015)
    assert (albedo[false] / distance[false] ** 2 >= 1e-4).all()


def test_light_without_a_sun_is_refused():
    with pytest.raises(InputError, match="with a sun"):
        scanner(None, "{shot_noise: 2}")


@pytest.mark.parametrize("level", ["empirical", "plants", "profile"])
def test_the_receiver_sees_the_light_of_the_hour(tmp_path, level):
    """The sun of the file's hours rises by 60 deg within 10 s: the reach falls as closed forms have it."""
    hours = "hour,sun_elevation_deg,sun_azimuth_deg\n12,-12,180\n12.00275,48,180\n13,48,180\n"
    (tmp_path / "hours.csv").write_text(hours)
    rays = "sub_rays: 1, " if level == "plants" else ""
    text = f"""
format: swath scenario 2
name: dawn
run: {{distance_m: 24, max_duration_s: 12}}
field:
  edge: {{shape: straight}}
  weather: {{time: "2026-07-25T12:00+02:00", file: {tmp_path / "hours.csv"}}}
machines:
  combine:
    motion: {{level: single_track, start_speed_kmh: 4}}
    header: {{level: {"profile" if level == "profile" else "fixed_height"}}}
    lidar: {{level: {level}, sector_deg: [-5, 5], {rays}daylight: {{shot_noise: 15}}}}
    edge: truth
    steer: preview
    speed: {{speed_kmh: 4}}
    steering: actuator
"""
    world = assemble(parse_scenario(text))
    made = world.leader.parts["lidar"].scanner
    dark = reach(made)
    drive(world)
    assert dark == pytest.approx(made.sheet.range_10, rel=1e-3)
    assert reach(made) == pytest.approx(reach(scanner(48.0, "{shot_noise: 15}")), rel=1e-3)
    assert made.least[0] == np.float32(made.least_energy)
