"""Unloading, heap, link, cooperation: closed forms of a box of 6 x 3 x 1.55 m, of tank and flow."""

import math

import numpy as np
import pytest

from swath.core.frames import Pose
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.field.moisture import Moisture
from swath.field.site_setup import Bodies
from swath.field.weather import SiteWeather, Weather
from swath.machine.heap.open_box import Surface, largest_heap
from swath.machine.machine_sheet import load_machine
from swath.signals import (
    CropFlow,
    HeapState,
    MachineLoad,
    MachineState,
    Odometry,
    PeerState,
    Scan,
    UnloadCommand,
    UnloadState,
)
from swath.signals.setup import ControlSetup
from tests.control.box_rig import lidar, look
from tests.levels.limits import each_level, make
from tests.machine.machine_fakes import STREAM, Ground, site

CART, COMBINE = load_machine("tractor-grain-cart"), load_machine("lexion-700")
BOX = CART.box
SLOPE = math.tan(math.radians(25.0))
ONE_SPOT = 25.5  # m3, closed form of a cone in the middle whose foot is on the rim, in this box
STILL = {"state": MachineState(0, Pose.identity(), 0.0, 0.0, 0.0, 0.0, 0.0)}


def site_of(machine, name="cart"):
    setup = site(Ground(), machine)
    return setup.__class__(**{**vars(setup), "name": name, "bodies": Bodies(), "peer": COMBINE})


@each_level("dust")
def test_dust_of_crop_and_wheels_is_raised_and_drifts_with_the_wind(level, limit):
    """10 kg/s of crop at 8 % of moisture and 2 g/kg for 6 s, 2 m/s over soil of 1 g/m, in air of 4 m/s."""
    setup = site_of(COMBINE, "combine")
    setup.field.weather, setup.field.plumes = SiteWeather(Weather(wind_m_s=4.0, wind_azimuth_deg=90.0)), {}
    setup.field.moisture = Moisture(straw_moisture_percent=8.0)
    dust = make("dust", level, setup, grams_per_kg=2.0, soil_g_per_m=1.0)
    dust.reset(STREAM)
    flow = CropFlow(0, 0.4, 0.6, 1.0, 0, 1.0, 0.1)
    for i in range(60):
        state = MachineState(0, Pose.from_euler((0.2 * i, 0, 0)), 2.0, 0.0, 0.0, 0.0, 0.2 * i)
        dust.step(i * NS // 10, NS // 10, {"state": state, "flow": (flow,)})
    rows = setup.field.plumes["combine"].rows
    assert dust.raised == pytest.approx(60 * 2e-3 + 11.8e-3, rel=limit)
    assert rows[:, 4].sum() == pytest.approx(dust.raised, rel=limit)
    first = rows[:3]
    assert first[:, 0] - first[:, 3] == pytest.approx(COMBINE.knife_x + 1.8, abs=0.1)


@each_level("unload")
def test_time_to_empty_a_full_tank(level, limit):
    """12 m3 at 120 l/s: 100 s."""
    params = {} if level == "ideal" else {"run_up_s": 0.0, "run_out_s": 0.0, "taper_percent": 0.0}
    unload = make("unload", level, site_of(COMBINE, "combine"), **params)
    unload.reset(STREAM)
    full = COMBINE.drivetrain.tank
    load = MachineLoad(0, full, *[0.0] * 6, tank_start=full)
    out = UnloadCommand(0, math.pi / 2, True)
    dt, seconds, drawn = NS // 20, 0.0, 0.0
    for i in range(3000):
        found = unload.step(i * dt, dt, {"command": out, "load": load, **STILL})["unload"]
        seconds += 0.05 if found.drawn > drawn else 0.0
        drawn = found.drawn
    assert drawn == pytest.approx(full, rel=1e-12)
    assert seconds == pytest.approx(100.0, rel=limit)
    assert found.held == 0.0
    assert found.missed == pytest.approx(full, rel=1e-12)  # there is no box


@each_level("heap")
def test_first_grain_over_the_rim(level, limit):
    setup = site_of(CART)
    heap = make("heap", level, setup, repose_deg=25.0)
    heap.reset(STREAM)
    setup.bodies.add("cart.trailer", heap_body(), Pose.identity())
    while not setup.field.grain:
        heap.pour(20.0, 0.0, 0.0, setup.field, Pose.identity())
    state = heap.step(0, NS, {})["heap"]
    assert state.grain / 770.0 == pytest.approx(ONE_SPOT, rel=limit)
    assert state.spilled == pytest.approx(setup.field.grain[0][2])


def heap_body():
    from swath.field.solid.solids import trailer_body

    return trailer_body(CART.hitch, 3.6, BOX)


@each_level("peer_link")
def test_relative_place_of_the_other_machine(level, limit):
    """7 m to the left of a machine that heads north, turned by 0.1 rad."""
    params = {"delay_ms": 0.0, "position_sd_cm": 0.0} if level == "radio" else {}
    link = make("peer_link", level, site_of(CART), **params)
    link.reset(Stream(1, "cart.peer_link"))
    own = MachineState(NS, Pose.from_euler((5.0, 3.0, 0.0), yaw=math.pi / 2), 1.0, 0.0, 0.0, 0.0, 0.0)
    other = MachineState(
        NS, Pose.from_euler((-2.0, 4.0, 0.0), yaw=math.pi / 2 + 0.1), 1.3, 0.0, 0.0, 0.0, 0.0
    )
    peer = link.step(0, NS, {"state": own, "peer_state": other})["peer"]
    found = (peer.x, peer.y, peer.heading, peer.speed, peer.age)
    np.testing.assert_allclose(found, (1.0, 7.0, 0.1, 1.3, 0.0), atol=max(limit, 1e-12))


@each_level("box")
def test_box_of_the_machine_beside(level, limit):
    """3 deg askew, 0.4 m ahead of the pipe, filled to 0.7 m below the rim."""
    sees = lidar(level=level)
    seen, truth = look("cart.heap.start_percent=55", ahead=0.4, left=8.5, heading=3.0, sees=sees)
    assert seen.is_seen
    np.testing.assert_allclose(
        (seen.x, seen.y, seen.rim_height), (truth.x, truth.y, truth.rim_height), atol=limit
    )
    assert seen.heading == pytest.approx(truth.heading, abs=max(limit * math.radians(1.0) / 0.1, 1e-9))
    assert truth.profile == pytest.approx(0.55 * BOX.depth - BOX.depth)
    for found, wanted in ((seen.profile, truth.profile), (seen.freeboard, truth.freeboard)):
        known = np.isfinite(found)
        assert known.all()
        np.testing.assert_allclose(found[known], wanted[known], atol=limit)


@each_level("scan_filter")
def test_echoes_on_the_machine_beside(level, limit):
    """Straight down onto level ground from 30 m, the box askew: what its body, header and box cover goes."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(-12.0, 20.0, 0.2), np.arange(-4.0, 16.0, 0.2)))
    level_range, height = np.hypot(x, y), 30.0
    none = np.zeros(len(x))
    scan = Scan(
        NS, none, np.arctan2(y, x), -np.arctan2(height, level_range),
        np.hypot(level_range, height)[:, None].astype(np.float32), np.ones((len(x), 1), np.float32),
    )  # fmt: skip
    outline = {
        "body_front": 4.6, "body_rear": -1.3, "body_width": 2.6, "box_x": -5.5, "box_y": 0.2,
        "box_heading": 0.1, "box_length": 6.0, "box_width": 3.0, "header_front": 6.0, "header_left": 0.5,
        "header_width": 5.0,
    }  # fmt: skip
    peer = PeerState(NS, True, 0.0, 3.0, 8.0, 0.05, 0.0, 0.0, 0.0, **outline)
    mounting = {"scan": Pose.from_euler((0.0, 0.0, height))}
    part = make("scan_filter", level, ControlSetup(COMBINE, mounting, "left", 0.04))
    part.reset(STREAM)
    inputs = {"scan": scan, "peer": peer, "odometry": Odometry(NS, 0.0, 0.0, 0.0)}
    seen = part.step(NS - 1, 1, inputs)["scan"]
    gone = np.isnan(seen.azimuth)
    assert np.isnan(seen.ranges[:, 0])[gone].all()
    assert (seen.ranges[~gone] == scan.ranges[~gone]).all()
    at = complex(3.0, 8.0), 0.05
    away = np.full(len(x), np.inf)
    box = (-5.5, 0.2, 0.1, 6.0, 3.0)
    for px, py, turn, length, width in ((1.65, 0, 0, 5.9, 2.6), (5.3, 0.5, 0, 1.4, 5.0), box):
        own = ((x + 1j * y - at[0]) * np.exp(-1j * at[1]) - complex(px, py)) * np.exp(-1j * turn)
        away = np.minimum(away, np.maximum(abs(own.real) - 0.5 * length, abs(own.imag) - 0.5 * width))
    sure = np.abs(away - limit) > 1e-4
    assert (gone == (away <= limit))[sure].all()
    assert part.step(NS, 1, inputs) == {}  # the same scan again


@each_level("cooperate")
def test_what_a_strategy_fills(level, limit):
    """Poured to the point where it is wanted, 120 l/s, stream of 0.1 m; at most 0.1 % runs over."""
    if level == "unloader":
        stops(make("cooperate", level, ControlSetup(COMBINE, {}, "left", 0.05)), limit)
        return
    keeper = make("cooperate", level, ControlSetup(CART, {}, "left", 0.5))
    keeper.reset(STREAM)
    surface, spilled, poured, wanted = Surface(BOX, SLOPE, 0.1), 0.0, 0.0, None
    peer = PeerState(0, True, 0.0, 0.0, -8.4, 0.0, 1.2, 0.0, 0.0, impact_x=0.0, impact_y=8.4)
    for i in range(900):
        if wanted is None or not wanted.is_full:
            for share, dx, dy in stream_of(0.1):
                spilled += surface.pour(share * 0.06, (wanted.spot if wanted else 0.0) + dx, dy)
            poured += 0.06
        profile = surface.profile((np.arange(12) + 0.5) * 0.5 - 3.0)
        heap = HeapState(0, 0.0, 0.0, 0.0, 0.0, profile, surface.freeboard(12))
        t = (i + 1) * NS // 2
        peer = PeerState(t, True, 0.0, 0.0, -8.4, 0.0, 1.2, 0.0, 0.0, impact_x=0.0, impact_y=8.4)
        inputs = {"peer": peer, "odometry": Odometry(t, 1.2, 0.0, 0.0), "heap": heap, "unload": None}
        wanted = keeper.step(t - NS // 2, NS // 2, inputs)["station"]
    low, high = limit
    assert low <= surface.volume / largest_heap(BOX, SLOPE) <= high
    assert spilled <= 1e-3 * poured


def stream_of(sd):
    far = math.sqrt(3.0) * sd
    return [(1 / 3, 0, 0), (1 / 6, far, 0), (1 / 6, -far, 0), (1 / 6, 0, far), (1 / 6, 0, -far)]


def stops(unloader, limit):
    """A box under the stream until 5 s, then it is gone: the auger stops within a step."""
    unloader.reset(STREAM)
    box = {"box_x": -5.5, "box_y": 0.0, "box_heading": 0.0, "box_length": 6.0, "box_width": 3.0}
    load, pipe = (
        MachineLoad(0, 5e3, *[0.0] * 7, tank_level=0.8),
        UnloadState(0, 1.5, 0.0, 0, 0, 0, 0, 0.0, 8.4),
    )
    on, dt = [], NS // 20
    for i in range(160):
        t = (i + 1) * dt
        x = 5.5 if t <= 5 * NS else 15.5
        peer = PeerState(t, True, 0.0, x, 8.4, 0.0, 1.2, 0.0, 0.0, **box)
        inputs = {"peer": peer, "odometry": Odometry(t, 1.2, 0.0, 0.0), "load": load, "unload": pipe}
        on.append(unloader.step(t - dt, dt, inputs)["command"].is_running)
    times = np.flatnonzero(on) * 0.05 + 0.05
    assert times[0] == pytest.approx(1.0, abs=0.1)  # steady for a second
    assert times[-1] == pytest.approx(5.0, abs=limit + 1e-9)
