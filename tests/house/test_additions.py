"""How many files an addition touches: a toy of every kind is added to one copy, and works there."""

import numpy as np
import pytest

from tests.house.extended import SCENARIO, SOURCE, Extended, columns, finite, messages, summary

SIGNAL = '''"""What a air speed radar measures."""

from typing import Annotated

from swath.core.frozen import frozen
from swath.core.signal import About, Quantity, Signal


@frozen
class AirSpeed(Signal, about=About("sensor")):
    """Speed over ground, measured without wheels."""

    speed: Annotated[float, Quantity("m/s", "measured over ground", column="radar_speed_m_s")]
    gust: Annotated[float, Quantity("m/s", "of the air", nan="calm")]
'''
SENSOR = '''"""Air speed without an error but a scale."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Gt

from swath.core.component import Inputs, Outputs, Port, State
from swath.core.random import Stream
from swath.core.registry import Level
from swath.field.site_setup import SiteSetup
from swath.signals import MachineState
from swath.signals.air_speed import AirSpeed


@dataclass(frozen=True)
class Params:
    """scale: measured over true."""

    scale: Annotated[float, Gt(0)] = 1.0


class ScaledRadar:
    """The true speed times a number."""

    inputs = (Port("state", MachineState),)
    outputs = (Port("speed", AirSpeed),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        self.scale = params.scale

    def reset(self, stream: Stream) -> Outputs:
        return {"speed": AirSpeed(0, 0.0, 0.0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        return {"speed": AirSpeed(t + dt, self.scale * inputs["state"].speed, 1e-9 * t)}

    def save(self) -> State:
        return {}

    def load(self, state: State) -> None:
        pass


LEVEL = Level(ScaledRadar, Params, "true speed times a scale", cost="none", tolerance="exact at scale 1")
'''
SLOT = """    _sensor(
        "air_speed",
        ("swath.sensing.air_speed",),
        "scaled",
        20.0,
        (Port("speed", AirSpeed),),
        _STATE,
    ),
    _of_control(
        "edge",
"""
METRIC = '''"""The highest speed of a run."""

from collections.abc import Mapping

from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Metric
from swath.signals import MachineState, Signal


class TopSpeed:
    """The highest speed that was driven."""

    OF_FIELD = False
    METRICS = (Metric("top_speed_m_s", "m/s", "highest speed driven", "Run", ""),)

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.top = float("nan")

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self.top = max(signal.speed, self.top) if self.top == self.top else signal.speed

    def metrics(self) -> dict[str, float]:
        return {"top_speed_m_s": self.top}


LEVEL = Level(TopSpeed, None, summary="the highest speed")
'''
DETECTOR = (
    (SOURCE.parents[1] / "examples" / "my_edge_detector.py").read_text(encoding="utf-8")
    + """
LEVEL = Level(MyEdgeDetector, MyEdgeDetector.Params, "step at a fixed height", tolerance="0.1 m")
""".replace("LEVEL", "from swath.core.registry import Level\n\nLEVEL", 1)
)
HABIT = '''"""Asparagus: one thick bare spear."""

import numpy as np

from swath.field.crop import BareYield, Crop, Habit
from swath.field.plants.drawing import Drawing
from swath.field.plants.parts import Plants, Stalks, assemble, normal, shared, stalk_capsules


def make(crop: Crop, count: int, rng: np.random.Generator, how: Drawing) -> Plants:
    """Straw is shared out by height."""
    height = normal(rng, crop.stand.height, crop.stand.height * crop.stand.height_cv, count)
    stalks = Stalks(height, np.zeros(count), np.zeros(count), np.ones(count))
    parts = [stalk_capsules(crop.stem, stalks, how.stalk_parts)]
    return assemble(height, np.zeros(count), shared(height, crop.yields.straw_mass), parts)


HABIT = Habit(make, yields=BareYield)
'''


def sheet(kind, name, *changes):
    """A bundled data sheet's text with pieces of it replaced."""
    text = (SOURCE / "data" / kind / f"{name}.yaml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


def add_a_kind_of_sensor(extended):
    extended.write("signals/air_speed.py", SIGNAL)
    extended.write("sensing/air_speed/__init__.py", '"""Levels of air speed."""\n')
    extended.write("sensing/air_speed/scaled.py", SENSOR)
    slots = "scenario/slots.py"
    before = "\n_STATE = "
    extended.change(slots, before, "from swath.signals.air_speed import AirSpeed\n" + before)
    extended.change(slots, '    _of_control(\n        "edge",\n', SLOT)


def add_a_crop_habit(extended):
    extended.write("field/plants/asparagus.py", HABIT)
    changes = (
        ("name: stubble", "name: asparagus"),
        ("habit: stubble", "habit: asparagus"),
        ("height_cm: {value: 15,", "height_cm: {value: 80,"),
    )
    extended.write("data/crops/asparagus.yaml", sheet("crops", "stubble", *changes))


def add_a_type_of_machine(extended):
    last = '    "truck": _VEHICLE,\n'
    new = '    "sprayer": {**_VEHICLE, "gnss": "ideal"},\n'
    extended.change("scenario/machine_types.py", last, last + new)
    text = sheet("machines", "tractor-grain-cart", ("type: tractor_with_trailer", "type: sprayer"))
    (extended.folder / "own.yaml").write_text(text[: text.index("trailer:\n")], encoding="utf-8")


ADDITIONS = {
    "sensor": add_a_kind_of_sensor,
    "metric": lambda extended: extended.write("judge/evaluators/top_speed.py", METRIC),
    "detector": lambda extended: extended.write("control/edge/fixed_height.py", DETECTOR),
    "habit": add_a_crop_habit,
    "machine": add_a_type_of_machine,
}
SCENARIOS = {
    "measured": f"{SCENARIO}    air_speed: scaled\n    air_speed_rear: {{scale: 1.5, rate_hz: 5}}\n"
    "expect: {combine: {top_speed_m_s: {max: 0.5}, air_speed_speed_gust_m_s: {max: 99}}}\n",
    "detector": SCENARIO.replace("distance_m: 3, max_duration_s: 6", "distance_m: 22, max_duration_s: 20")
    + "    start: {offset_m: 0.3}\n    edge: fixed_height\n",
    "habit": SCENARIO.replace("level: uniform,", "level: uniform, crop: asparagus,"),
    "machine": SCENARIO[: SCENARIO.index("machines:")]
    + "machines: {sprayer: {machine: own.yaml, speed: {speed_kmh: 6}}}\n",
}


class Added:
    """touched: files by addition; status and out: exit code and folder by run; listed: what is printed."""

    def __init__(self, extended):
        self.touched, before = {}, set()
        for name, add in ADDITIONS.items():
            add(extended)
            self.touched[name] = extended.touched() - before
            before |= self.touched[name]
        self.out, runs = {name: extended.folder / name for name in SCENARIOS}, []
        for name, text in SCENARIOS.items():
            (extended.folder / f"{name}.yaml").write_text(text, encoding="utf-8")
            runs.append(["run", f"{name}.yaml", "--out", self.out[name], "--quiet", "--no-report"])
        *ran, levels, metrics = extended.commands(
            *runs, ["levels", "air_speed"], ["metrics", "top_speed_m_s"]
        )
        self.status = {name: code for name, (code, _) in zip(SCENARIOS, ran, strict=True)}
        self.listed = levels[1] + metrics[1]


@pytest.fixture(scope="module")
def added(tmp_path_factory):
    return Added(Extended(tmp_path_factory.mktemp("extended")))


def test_a_kind_of_sensor_touches_four_files(added):
    assert len(added.touched["sensor"]) == 4
    out = added.out["measured"]
    found = messages(out, "/combine/air_speed/speed")
    assert {schema for schema, _ in found} == {"swath_msgs/msg/AirSpeed"}
    assert len(found) > 20
    rear = [m for _, m in messages(out, "/combine/air_speed_rear/speed")]
    assert 0 < len(rear) < 0.6 * len(found)
    tracks = columns(out)
    assert finite(tracks["radar_speed_m_s"])[-1] == pytest.approx(finite(tracks["speed_m_s"])[-1], rel=0.02)
    speeds = {(m.header.stamp.sec, m.header.stamp.nanosec): m.speed for _, m in found}
    last = rear[-1].header.stamp
    assert rear[-1].speed == pytest.approx(1.5 * speeds[last.sec, last.nanosec], rel=0.02)
    gust, rear = (finite(tracks[f"air_speed{n}_speed_gust_m_s"]) for n in ("", "_rear"))
    assert gust[-1] >= rear[-1] > 0.5 * finite(tracks["t_s"])[-1]  # by rule, nothing declares its column
    (limit,) = (e for e in summary(out)["expect"] if e["name"] == "air_speed_speed_gust_m_s")
    assert limit["result"] == "pass"
    assert "air_speed" in added.listed


def test_a_metric_touches_one_file(added):
    assert len(added.touched["metric"]) == 1
    assert added.status["measured"] == 1  # driven faster than the limit
    told = summary(added.out["measured"])
    assert told["top_speed_m_s"] == pytest.approx(7 / 3.6, rel=0.05)
    (limit,) = (e for e in told["expect"] if e["name"] == "top_speed_m_s")
    assert limit["result"] == "fail"
    assert "highest speed driven" in added.listed


def test_an_edge_detector_touches_one_file(added):
    assert len(added.touched["detector"]) == 1
    assert added.status["detector"] == 0
    aside = finite(columns(added.out["detector"])["lateral_error_m"])
    assert summary(added.out["detector"])["detection_availability"] > 0.9
    assert abs(aside[0]) > 0.15
    assert np.abs(aside[-len(aside) // 10 :]).max() < 0.1  # it came back to the edge


def test_a_crop_habit_touches_two_files(added):
    assert len(added.touched["habit"]) == 2
    assert added.status["habit"] == 0
    assert summary(added.out["habit"])["mass_balance_error"] < 1e-9
    tracks = columns(added.out["habit"])
    assert np.isfinite(np.asarray(tracks["edge_offset_m"], float)).mean() > 0.5  # rays meet a step of 0.6 m
    assert finite(tracks["edge_offset_m"])[-1] == pytest.approx(finite(tracks["edge_true_m"])[-1], abs=0.5)
    fed = 300 * 0.34e-3 * 12.0 * finite(tracks["speed_m_s"])[-1]  # of whole spears [kg/s]
    assert 0.2 * fed < finite(tracks["feeder_flow_kg_s"])[-1] < fed


def test_a_type_of_machine_touches_one_file(added):
    assert len(added.touched["machine"]) == 1
    assert added.status["machine"] == 0
    resolved = (added.out["machine"] / "scenario.yaml").read_text(encoding="utf-8")
    there = [slot for slot in ("motion", "gnss", "lidar", "header") if f"    {slot}:" in resolved]
    assert there == ["motion", "gnss"]
    assert messages(added.out["machine"], "/sprayer/gnss/fix_odometry")
