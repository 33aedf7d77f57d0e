"""The machine alone, one core: real-time factor of every level of motion, and how far they are apart."""

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import numpy as np
from _harness import interleave, machine, median, write_json

from swath.core.component import Port
from swath.core.graph import Graph, Node
from swath.core.random import Stream
from swath.core.schedule import NS, Slot
from swath.machine.machine_sheet import load_machine, with_grain
from swath.machine.motion import kinematic, multibody, single_track
from swath.machine.powertrain import hydrostat
from swath.machine.process import threshing
from swath.signals import CropFlow, SpeedCommand, SteerState

SECONDS = 10.0
FIELD = """
format: swath scenario 2
name: machine
seed: 1
run: {distance_m: 40, max_duration_s: 60}
field:
  terrain: {level: formula, slope_percent: 3.0, roughness_class: C}
  stand: {level: uniform, stems_per_m2: 100}
  edge: {shape: straight, x_m: 20, y_m: 5, heading_deg: 90, length_m: 150}
machines:
  combine: {edge_side: left}
"""
LEVELS: dict[str, tuple[Any, Any]] = {
    "kinematic": (kinematic.Kinematic, kinematic.Params),
    "single_track": (single_track.SingleTrack, single_track.Params),
    "multibody": (multibody.Multibody, multibody.Params),
}
RATES = (50.0, 200.0)
WHOLE_RATES = (50.0, 100.0, 200.0)  # of the motion, with process (10 Hz) and powertrain (20 Hz)
GRAIN, STRAW = 0.97, 0.63  # fed per area [kg/m2]
CASES = [(3.0, 2.5), (11.0, 1.0), (11.0, 2.5), (28.0, 1.0), (28.0, 2.5), (3.0, 6.0), (11.0, 4.0)]


def rough_site() -> Any:
    """A machine's setup on a bundled kind of rough ground, pages of the way in memory."""
    import tempfile

    from swath.field.site_setup import SiteSetup
    from swath.runtime.assembly import assemble
    from swath.scenario.scenario import load_scenario

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "machine.yaml"
        file.write_text(FIELD, encoding="utf-8")
        world = assemble(load_scenario(str(file)))
    world.graph.reset()
    state = world.graph.latest("combine.motion", "state")
    forward = state.pose.rotation[:2, 0]
    way = state.pose.position[:2] + np.outer(np.arange(-10.0, 80.0, 5.0), forward)
    world.field.ensure(way[:, 0], way[:, 1], 20.0)
    return SiteSetup(world.field, world.leader.card, state.pose, "left", 1.0 / 200.0)


def drive(motion: Any, seconds: float, rate: float, steer: float, speed: float) -> list[Any]:
    """Constant inputs; the states."""
    step = round(NS / rate)
    inputs = {"steering": SteerState(0, steer, 0.0), "speed": SpeedCommand(0, speed)}
    return [motion.step(i * step, step, inputs)["state"] for i in range(round(seconds * rate))]


class Given:
    """Straight on at a speed [m/s] with a full header: stands for steering, speed control and header."""

    inputs = ()
    outputs = (Port("steering", SteerState), Port("speed", SpeedCommand), Port("flow", CropFlow))

    def __init__(self, speed: float, width: float) -> None:
        self._speed, self._width = speed, width

    def reset(self, stream: Stream) -> dict[str, Any]:
        return self.step(0, 0, {})

    def step(self, t: int, dt: int, inputs: Any) -> dict[str, Any]:
        t, h = t + dt, dt / NS
        area = self._width * self._speed * h
        flow = CropFlow(t, GRAIN * area, STRAW * area, area, 0, 1.0, h)
        return {"steering": SteerState(t, 0.0, 0.0), "speed": SpeedCommand(t, self._speed), "flow": flow}

    def save(self) -> dict[str, Any]:
        return {}

    def load(self, state: Any) -> None:
        pass


def whole(site: Any, rate: float) -> Graph:
    """single_track, threshing and hydrostat in a graph, the straw laid on the field; 20 s on their way."""

    def slot(name: str, hz: float) -> Slot:
        return Slot(name, round(NS / hz))

    params = single_track.Params(start_speed_kmh=7.2)
    state, engine, load = ("motion", "state"), ("powertrain", "engine"), ("process", "load")
    to_motion = {
        "steering": ("given", "steering"),
        "speed": ("given", "speed"),
        "drive": engine,
        "load": load,
    }
    to_process = {"flow": ("given", "flow"), "state": state, "engine": engine}
    process = threshing.ThreshingProcess(threshing.Params(), site)
    powertrain = hydrostat.HydrostatPowertrain(hydrostat.Params(), site)
    nodes = [
        Node(slot("given", 10.0), Given(2.0, site.machine.header_width)),
        Node(slot("motion", rate), single_track.SingleTrack(params, site), to_motion),
        Node(slot("process", 10.0), process, to_process),
        Node(slot("powertrain", 20.0), powertrain, {"state": state, "load": load}),
    ]
    graph = Graph(nodes, 1)
    graph.reset()
    graph.run(20 * NS)
    return graph


def factors(site: Any) -> dict[str, float]:
    """Simulated over CPU seconds per level and rate, on rough ground at 2 m/s."""
    jobs: dict[str, Callable[[], Any]] = {}
    for name, (component, params) in LEVELS.items():
        for rate in RATES:
            motion = component(params(start_speed_kmh=7.2), site)
            motion.reset(Stream(1, "bench"))
            kept = motion.save()

            def job(motion: Any = motion, kept: Any = kept, rate: float = rate) -> None:
                motion.load(kept)
                drive(motion, SECONDS, rate, 0.0, 2.0)

            jobs[f"{name} {rate:.0f} Hz"] = job
    for rate in WHOLE_RATES:
        graph = whole(site, rate)
        saved = graph.save()

        def run(graph: Graph = graph, saved: Any = saved) -> None:
            graph.load(saved)
            graph.run(graph.t + round(SECONDS * NS))

        jobs[f"single_track {rate:.0f} Hz + threshing + hydrostat"] = run
    return {name: SECONDS / median(times) for name, times in interleave(jobs, rounds=5).items()}


class Flat:
    """Level ground."""

    def ground_height(self, x: Any, y: Any) -> Any:
        return np.zeros(np.broadcast(x, y).shape)


def turn(name: str, speed: float, steer: float, grain: float) -> tuple[float, float]:
    """Step of the steering angle: final curvature [1/m], sideways way after 30 deg of turn [m]."""
    from types import SimpleNamespace

    from swath.core.frames import Pose

    card = load_machine("lexion-700")
    component, params = LEVELS[name]
    extra = {"grain_kg": grain} if name == "multibody" else {}
    used = card if name == "multibody" else with_grain(card, grain)
    site = SimpleNamespace(field=Flat(), machine=used, start=Pose.identity(), period=0.01)
    motion = component(params(start_speed_kmh=speed * 3.6, **extra), site)
    motion.reset(Stream(1, "bench"))
    first = drive(motion, 0.5, 100.0, 0.0, speed)[-1]
    seconds = 1.2 * math.pi / 6 * card.wheelbase / math.tan(steer) / speed + 4.0
    states = drive(motion, seconds, 100.0, steer, speed)
    yaw = first.pose.euler()[2]
    turned = np.unwrap([s.pose.euler()[2] - yaw for s in states])
    way = np.array([s.pose.position[:2] - first.pose.position[:2] for s in states])
    aside = way @ [-math.sin(yaw), math.cos(yaw)]
    return float(np.mean([s.yaw_rate / s.speed for s in states[-100:]])), float(
        np.interp(math.pi / 6, turned, aside)
    )


def deviations() -> list[dict[str, float]]:
    """Each cheaper level against the multibody, in percent."""
    rows = []
    for grain in (0.0, 8000.0):
        for degrees, speed in CASES:
            found = {n: turn(n, speed, math.radians(degrees), grain) for n in LEVELS}
            gain, aside = found["multibody"]
            row = {"steer_deg": degrees, "speed_m_s": speed, "grain_kg": grain, "aside_m": aside}
            for n in ("single_track", "kinematic"):
                row[f"{n}_yaw_gain_percent"] = 100.0 * (found[n][0] / gain - 1.0)
                row[f"{n}_aside_percent"] = 100.0 * (found[n][1] / aside - 1.0)
            rows.append(row)
    return rows


def main(out_dir: Path | str = "out/bench") -> dict[str, Any]:
    """Measure, print, write machine.json."""
    from rich.console import Console
    from rich.table import Table

    console = Console(width=110)
    speed = factors(rough_site())
    title = "Machine alone, one core, rough ground, 2 m/s"
    table = Table("level and rate", "simulated over CPU time", title=title)
    for name, factor in speed.items():
        table.add_row(name, f"{factor:.0f}")
    console.print(table)
    rows = deviations()
    table = Table(title="Against the multibody: yaw gain, sideways way after 30 deg of turn")
    for column in ("steer", "speed", "grain", "single track", "aside", "kinematic", "aside"):
        table.add_column(column, justify="right")
    for r in rows:
        shown = [
            f"{r[f'{n}_{k}_percent']:+.2f} %"
            for n in ("single_track", "kinematic")
            for k in ("yaw_gain", "aside")
        ]
        table.add_row(
            f"{r['steer_deg']:.0f} deg", f"{r['speed_m_s']:g} m/s", f"{r['grain_kg']:.0f} kg", *shown
        )
    console.print(table)
    data = {"machine": machine(), "real_time_factor": speed, "deviations": rows}
    write_json(Path(out_dir), "machine", data)
    return data


if __name__ == "__main__":
    main()
