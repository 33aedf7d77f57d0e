"""Weather, light, ground and headland of the bundled domain are felt: runs change as physics says."""

import numpy as np

from swath.core.schedule import NS
from swath.runtime.assembly import assemble
from swath.runtime.job import run_unrecorded
from swath.scenario.overrides import layered
from swath.scenario.scenario import load_scenario
from swath.tools.function_test.odd.binding import find_odd, read_odd

ODD = read_odd(find_odd("wheat-harvest"))
CALM = {
    "weather.dust": 0.0, "weather.rain": 0.0, "weather.chaff": 0.0, "weather.fog": "false",
    "weather.wind_speed": 0.0, "weather.sunlight": 2000.0, "process.straw_moisture": 10.0,
    "process.residue_on_sensor": "false", "process.lean": 0.0, "process.dust_raised": 0.0,
    "temporary.wet_spot": "false", "temporary.weeds": 0.0, "terrain.side_slope": 0.0,
    "terrain.undulation": 0.0, "communication.scan_loss": 0.0, "edge.bend": 0.0, "edge.entry_offset": 0.0,
}  # fmt: skip
FAR = ["combine.lidar.step_deg=3", "combine.lidar.mount.pitch_deg=4", "combine.lidar.reach_m=60"]
DRIVEN = [
    "combine.lidar.level=empirical", "combine.lidar.step_deg=10", "combine.edge=truth",
    "combine.speed.guard={}", "combine.motion.start_speed_kmh=7",
]  # fmt: skip


def scenario(rng, sets, **changed):
    """Of a drawn stand, speed and crop in calm weather, with attributes changed."""
    point = {
        axis.name: axis.labels[0] if not axis.edges else axis.value(axis.count // 2, 0.5) for axis in ODD.axes
    }
    drawn = {"process.density": rng.uniform(300, 600), "process.crop_length": rng.uniform(80, 110),
             "process.speed": rng.uniform(5, 9)}  # fmt: skip
    point |= CALM | drawn | {name.replace("__", "."): value for name, value in changed.items()}
    return load_scenario("straight", sets=layered(ODD.case.sets(point, None), sets))


def scan(seed, **changed):
    """Beams with an echo from beyond 15 m, and mean intensity of all echoes."""
    world = assemble(scenario(np.random.default_rng(seed), FAR, **changed))
    world.graph.reset()
    world.graph.run(NS // 10)
    seen = world.graph.latest("combine.lidar", "scan")
    return int(np.sum(seen.ranges > 15.0)), float(np.nanmean(seen.intensity))


def test_fog_light_wet_straw_and_dirt_take_from_what_the_scanner_sees():
    rng = np.random.default_rng([2, 76])
    far, bright = scan(2)
    assert far > 5
    in_fog, _ = scan(2, weather__fog="true")
    in_sun, _ = scan(2, weather__sunlight=rng.uniform(60e3, 100e3))
    _, wet = scan(2, process__straw_moisture=rng.uniform(28, 35))
    behind_dirt, dim = scan(2, process__residue_on_sensor="true")
    assert in_fog < in_sun < far
    assert behind_dirt <= far
    assert dim < 0.75 * bright  # T^2 of 6 g/m2
    assert 0.7 * bright < wet < bright


def drive(seed, metres, *more, **changed):
    made = scenario(np.random.default_rng(seed), [*DRIVEN, f"run.distance_m={metres}", *more], **changed)
    return run_unrecorded(made)


def test_soft_soil_is_slower_and_nearer_to_its_end():
    rng = np.random.default_rng([1, 77])
    soft, firm = (drive(1, 3, terrain__soil_strength=rng.uniform(*of)) for of in ((500, 700), (2200, 3000)))
    assert soft["least_mobility"] < 0.5 * firm["least_mobility"]
    assert soft["simulated_s"] > firm["simulated_s"]


def test_a_wet_spot_is_where_the_run_comes_by():
    at, start = {}, "combine.start.along_edge_m=21"
    for spot in ("false", "true"):
        at[spot] = drive(3, 6, start, temporary__wet_spot=spot)
    assert at["true"]["least_mobility"] < 0.5 * at["false"]["least_mobility"]
    assert at["true"]["simulated_s"] > at["false"]["simulated_s"]


def test_a_slanted_headland_cuts_less_on_the_first_metres():
    straight, slanted = (
        drive(4, 6, edge__headland_shape=shape)["area_cut_m2"] for shape in ("straight", "slanted")
    )
    assert 0.4 * straight < slanted < 0.9 * straight
