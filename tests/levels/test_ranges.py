"""The ranges that levels of headers and of sensors of motion declare: closed forms at both ends and within.

Every level's range names a quantity of a run; the sources that levels name are there.
"""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from swath.core.errors import InputError
from swath.core.frames import Pose
from swath.core.registry import OWN_LAW, WITNESSES, Checked
from swath.core.schedule import NS
from swath.core.units import DEG, KMH
from swath.field.stand import uniform
from swath.machine import SLOPES
from swath.machine import header as headers
from swath.machine.unload import auger
from swath.machine.unload.auger import DRAG, fall_time
from swath.runtime.assembly import assemble
from swath.runtime.credibility import Credibility, Scene
from swath.runtime.met import QUANTITIES
from swath.scenario.scenario import load_scenario
from swath.scenario.slots import CATALOGUE
from swath.sensing import SPEED, TURN
from swath.sensing.gnss.antenna import Place as Antenna
from swath.sensing.imu.strapdown import GRAVITY
from swath.sensing.imu.strapdown import Place as Unit
from swath.sensing.lidar.empirical import CHECKED as EMPIRICAL
from swath.sensing.lidar.empirical import DRIVEN, compared_stems
from swath.sensing.tables import load_table
from swath.signals import MachineState, SteerState
from tests.field.made_field import made_field
from tests.levels.limits import LIMITS, keys_of, make
from tests.levels.test_sensors import ZERO_GNSS, ZERO_IMU, post_ahead, reset
from tests.machine.machine_fakes import STREAM, Ground, site
from tests.machine.process_rig import Rig, state
from tests.machine.test_powertrain_engine import DRIVETRAIN, DYNAMICS, SITE, STEP, load_of
from tests.machine.test_process_threshing import steady
from tests.machine.test_unload import COMBINE, pour, setup_with_box
from tests.sensing.driven_states import circle, feed, setup_of, straight

SPEEDS = [SPEED.low * KMH, 1.0 * KMH, 7.0 * KMH, SPEED.high * KMH]
RATES = [TURN.low * DEG, -1.0 * DEG, 1.0 * DEG, TURN.high * DEG]
ROOT = Path(__file__).parents[2]


def levels():
    for kind in CATALOGUE.registry.packages:
        for name in CATALOGUE.registry.names(kind):
            yield kind, name, CATALOGUE.registry.get(kind, name)


def test_ranges_name_quantities_of_a_run_and_their_sources():
    count = 0
    for kind, name, level in levels():
        for checked in level.checked:
            count += 1
            assert checked.quantity in QUANTITIES, (kind, name)
            assert checked.low <= checked.high
            if checked.source.endswith(".py"):
                assert (ROOT / checked.source).is_file(), checked.source
    assert count >= 20


def own_law_rows():
    """Rows of the table of docs/reference/levels.md: (slot, quantity) -> levels."""
    text = (ROOT / "docs" / "reference" / "levels.md").read_text(encoding="utf-8")
    rows = text.partition("| by its own law alone |")[2].partition("\n\n")[0].splitlines()[2:]
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    return {(slot, q): {*levels.split(", ")} for q, where in cells for slot, _, levels in
            (part.partition(": ") for part in where.split("; "))}  # fmt: skip


def test_every_range_has_its_witness_and_the_page_names_those_that_have_no_other_law():
    count, found = dict.fromkeys(WITNESSES, 0), {}
    for kind, name, level in levels():
        for checked in level.checked:
            count[checked.witness] += 1  # KeyError: none of these
            if checked.witness == OWN_LAW:
                found.setdefault((kind, checked.quantity), set()).add(name)
    assert sum(count.values()) >= 100, count
    assert found == own_law_rows()


def test_the_page_has_by_how_much_use_beyond_a_range_moves_metrics():
    text = (ROOT / "docs" / "reference" / "levels.md").read_text(encoding="utf-8")
    rows = text.partition("| beyond the range |")[2].partition("\n\n")[0].splitlines()[2:]
    stems, *others = (row.strip("| ").split(" | ") for row in rows)
    found = {"stems_per_m2": compared_stems(load_table("rye-median"))}
    found |= {checked.quantity: checked for checked in EMPIRICAL if checked.beyond is not None}
    assert list(found) == ["stems_per_m2", "wind_lean_deg", "weeds_per_m2"]
    for checked, (_, up_to, *cells) in zip(found.values(), [stems, *others], strict=True):
        assert f"{checked.beyond.high:g}" in up_to
        *lengths, count = checked.beyond.moved.values()
        assert cells == [*(f"{100.0 * moved:.3g} cm" for moved in lengths), f"{count:g}"]
    for low, high in DRIVEN.values():
        assert {f"{low:g}", f"{high:g}"} & {*stems[1].replace(",", "").split()}


def test_a_range_of_an_unknown_quantity_is_an_error():
    world = assemble(load_scenario("straight", sets=["combine.lidar=off", "combine.edge=truth"]))
    scene = Scene(world)
    scene.ranges["combine"]["motion"] = (Checked("ground_sped_kmh", 0.0, 1.0, "made"),)
    watch = Credibility(scene)
    world.graph.reset()
    moved = MachineState(NS, Pose.identity(), 1.0, 0.0, 0.0, 0.0, 1.0)
    with pytest.raises(InputError, match="ground_sped_kmh: expected one of ground_speed_kmh"):
        watch.see("combine.motion", NS, {"state": moved})


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("level", ["ideal", "error"])
def test_odometry(level, speed, rate):
    sensor = reset(make("odometry", level, setup_of(), **dict.fromkeys(keys_of("odometry", level), 0.0)))
    true = MachineState(0, Pose.identity(), speed, 0.0, rate, 0.1, 0.0)
    for k in range(5):
        inputs = {"state": true, "steering": SteerState(0, 0.1, 0.0)}
        found = sensor.step(k * 20_000_000, 20_000_000, inputs)["odometry"]
    assert (found.speed, found.yaw_rate) == pytest.approx((speed, rate), rel=1e-9)


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("level", ["ideal", "error"])
def test_imu(level, speed, rate):
    zero = ZERO_IMU if level == "error" else {}
    unit = {"mount": Unit(x_m=0.0, y_m=0.0, z_m=0.0)}
    sensor = reset(make("imu", level, setup_of(period=0.01), **unit, **zero))
    last = feed(sensor, circle(speed, speed / rate), 30, step=10_000_000)[-1]
    assert (last.rate_x, last.rate_y, last.rate_z) == pytest.approx((0.0, 0.0, rate), abs=1e-4)
    forces = (last.force_x, last.force_y, last.force_z)
    assert forces == pytest.approx((0.0, speed * rate, GRAVITY), abs=0.01)


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("level", ["ideal", "error", "sky"])
def test_gnss(level, speed, rate):
    above = {"antenna": Antenna(x_m=0.0, y_m=0.0, z_m=4.0)}
    sensor = reset(make("gnss", level, setup_of(), **above, **({} if level == "ideal" else ZERO_GNSS)))
    for fix in feed(sensor, circle(speed, speed / rate), 20):
        x, y, _ = circle(speed, speed / rate)(fix.t / NS).position
        assert (fix.x, fix.y, fix.z) == pytest.approx((x, y, 4.0), abs=1e-3)
        assert fix.speed == pytest.approx(abs(speed), abs=1e-3)


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("level", ["ideal", "radar"])
def test_ground_speed(level, speed):
    setup = SimpleNamespace(base=None, machine=None, edge_side="left", period=0.1)
    sensor = reset(make("ground_speed", level, setup, **({"noise": "none"} if level == "radar" else {})))
    if level == "ideal":
        last = MachineState(0, Pose.identity(), speed, 0.0, 0.0, 0.0, 0.0)
        found = sensor.step(0, NS // 10, {"state": last})["speed"]
    else:
        found = feed(sensor, straight(speed), 10)[-1]
    assert found.speed == pytest.approx(speed, rel=1e-6)


@pytest.mark.parametrize("speed", [SPEED.low * KMH, *SPEEDS[1:-1], SPEED.high * KMH])
@pytest.mark.parametrize("level", ["fixed_height", "height_control"])
def test_headers_take_what_grows_on_their_way(level, speed):
    """0.8 kg/m2 of grain on 12 m."""
    header = make("header", level, site(Ground(), period=0.02))
    header.reset(STREAM)
    grain, dt, count = 0.0, NS // 50, 101
    for k in range(count):
        here = state((k + 1) * dt, 0.02 * speed * k, speed)
        grain += header.step(k * dt, dt, {"state": (here,)})["flow"].grain
    lost = {"fixed_height": 1e-9, "height_control": 0.01}[level]
    assert grain == pytest.approx(0.8 * 12.0 * 0.02 * abs(speed) * (count - 1), rel=lost)


@pytest.mark.parametrize("speed", [SPEEDS[1], SPEED.high * KMH])
@pytest.mark.parametrize("stems", [headers.PROFILE_STEMS.low, headers.PROFILE_STEMS.high])
def test_profile_header_takes_what_plants_give(stems, speed):
    field = made_field(stand=uniform.Params(stems_per_m2=stems))
    one, other = (grain_of(level, field, speed) for level in ("profile", "fixed_height"))
    assert one == pytest.approx(other, rel=0.02)


def grain_of(level, field, speed):
    """What a header takes on 4 m along the edge of a field [kg]."""
    header = make("header", level, replace(site(field, period=0.02), edge=field.first_edge))
    end = site().machine.header_end("left")
    header.reset(STREAM)
    grain, dt = 0.0, NS // 50
    for k in range(round(4.0 / (0.02 * speed)) + 1):
        way = 0.02 * speed * k
        pose = Pose.from_euler([-end[1], 10.0 - end[0] + way, 0.0], yaw=math.pi / 2)
        here = MachineState((k + 1) * dt, pose, speed, 0.0, 0.0, 0.0, way)
        grain += header.step(k * dt, dt, {"state": (here,)})["flow"].grain
    return grain


ACROSS, ALONG = ([end.low, -3.0, 7.0, end.high] for end in SLOPES)  # percent


def tilt(across, along):
    """Roll and pitch on ground that rises to the right and ahead [percent]."""
    return {"roll": -math.atan(0.01 * across), "pitch": -math.atan(0.01 * along)}


@pytest.mark.parametrize(
    ("speed", "across", "along"), list(zip(SPEEDS[1:] + SPEEDS[-1:], ACROSS, ALONG, strict=True))
)
def test_threshing_loses_what_the_closed_form_says(speed, across, along):
    load = Rig(engine=False).run(speed, 60.0, **tilt(across, along))
    slope = 1.0 + 2.0 * abs(0.01 * across) + max(0.01 * along, 0.0)  # by which the shoe has more to do
    found = load.threshing_loss, load.separation_loss, load.cleaning_loss
    assert found == pytest.approx(steady(speed, slope)[:3], rel=1e-6)


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("along", ALONG)
@pytest.mark.parametrize("level", ["ideal", "hydrostat"])
def test_powertrain_pulls_weight_uphill_and_against_rolling(level, speed, along):
    part = make("powertrain", level, SITE)
    part.reset(STREAM)
    for k in range(100):
        here = state((k + 1) * STEP, 0.05 * speed * k, speed, **tilt(0.0, along))
        engine = part.step(k * STEP, STEP, {"state": here, "load": load_of()})["engine"]
    rolling = math.copysign(DYNAMICS.rolling_resistance, speed)
    wheels = 9.81 * DYNAMICS.mass * (rolling + math.sin(math.atan(0.01 * along))) * speed
    efficiency = DRIVETRAIN.hydrostat.efficiency
    asked = wheels / efficiency if wheels > 0.0 else wheels * efficiency
    assert engine.propulsion_power == pytest.approx(asked, rel=1e-3)


@pytest.mark.parametrize("speed", [SPEEDS[0], SPEEDS[-1]])
@pytest.mark.parametrize("level", [auger.PRESETS["ideal"], auger.LEVEL])
def test_the_stream_leaves_with_the_speed_of_the_machine(level, speed):
    setup, _ = setup_with_box()
    pour(level, setup, 20.0, speed=speed)
    still, _ = setup_with_box()
    pour(level, still, 20.0)
    fell = fall_time(COMBINE.pipe.z, 2.5 * math.sqrt(0.5))
    thrown = speed * (fell - 0.5 * DRAG * fell**2)  # on in the air, which takes from it
    moved = np.array([a[0] - b[0] for a, b in zip(setup.field.grain, still.field.grain, strict=True)])
    steps = (moved - thrown) / (0.05 * speed)  # since the start, when it left the mouth
    assert steps == pytest.approx(np.round(steps), abs=0.05)
    assert {*np.diff(np.round(steps))} <= {0.0, 1.0}  # several places a step


@pytest.mark.parametrize("speed", [SPEEDS[0], SPEEDS[-1]])
@pytest.mark.parametrize("level", ["ideal", "error", "rays"])
def test_radar_tells_the_speed_towards_a_post(level, speed):
    found = post_ahead(level, speed).radial_speed[0]
    assert found == pytest.approx(-speed, abs=LIMITS["radar"][level].value)
