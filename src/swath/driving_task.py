"""What a policy is given to do in a scenario, and what that is worth (extra `gym`)."""

import dataclasses
import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import tan
from typing import Any

import numpy as np

from swath.api import Sets, load_scenario
from swath.core.abilities import HasRange
from swath.core.component import Port
from swath.core.errors import Extra, InputError, SwathError
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.together import Given, InWorlds, KeepsRows, Samples, field_of
from swath.core.units import KMH
from swath.documents.validation import unknown_key
from swath.judge.evaluation import Evaluation
from swath.judge.windows import FIELD
from swath.runtime.assembly import assemble, exchange
from swath.runtime.world import World
from swath.scenario.scenario import Scenario
from swath.scenario.slots import kind_of
from swath.sensing.camera.rays import SceneCamera
from swath.signals import Signal, SpeedCommand, SteerCommand

with Extra("gym", "swath.Env"):
    from gymnasium import logger, spaces

OBSERVED = (  # name, largest size; the edge's offset counts from the header end, > 0 left
    ("offset_m", 10.0), ("heading_rad", np.pi), ("curvature_1_m", 0.5), ("confidence", 1.0),
    ("offset_sd_m", 10.0), ("speed_m_s", 20.0), ("yaw_rate_rad_s", 3.0), ("steer_rad", 1.6),
)  # fmt: skip
OF_EDGE = ("offset", "heading", "curvature", "confidence", "offset_sd")
OF_ODOMETRY = ("speed", "yaw_rate", "steer_angle")
OUTSIDE = 1e-6  # of an action beyond its space: more than float32 rounds off


class Commanded(InWorlds):
    """A part of a machine that sends what it was given last. kind: of the command.

    field: the field of it that is given; more: its other fields; value: given last
    """

    def __init__(self, kind: type[Signal], field: str, **more: Any) -> None:
        self.inputs: tuple[Port, ...] = ()
        self.outputs = (Port("command", kind),)
        self.kind, self.field, self.more, self.value = kind, field, more, 0.0

    @classmethod
    def together(cls, parts: Sequence["Commanded"]) -> "Commands":
        """Make one object that steps these parts of many worlds together."""
        return Commands(parts)


class Commands(KeepsRows):
    """The parts of many worlds, stepped together."""

    def __init__(self, parts: Sequence[Commanded]) -> None:
        self.parts, self.errors = parts, dict[int, SwathError]()

    def reset(self, streams: Sequence[Stream]) -> dict[str, Samples]:
        """The commands at t = 0."""
        return self._samples(0)

    def step(self, t: int, dt: int, inputs: Given) -> dict[str, Samples]:
        """The commands valid at t + dt."""
        return self._samples(t + dt)

    def _samples(self, t: int) -> dict[str, Samples]:
        first, values = self.parts[0], np.array([part.value for part in self.parts])
        more = {name: np.full(len(values), value) for name, value in first.more.items()}
        return {"command": Samples(first.kind, t, {first.field: values, **more})}


@dataclass
class Score:
    """What driving in a world is worth. evaluation: with its limits; distance_m: to be driven in all."""

    evaluation: Evaluation
    distance_m: float
    limits: list[dict[str, Any]] = dataclasses.field(default_factory=list)  # as they stood last

    def __post_init__(self) -> None:
        self.names = {limit.name for limit in self.evaluation.expect}
        self._excess = [0.0] * len(self.evaluation.expect)

    def parts(self, way: float, tracks: Mapping[str, Any], *, is_end: bool, is_due: bool) -> dict[str, float]:
        """Parts of the reward of a step over `way` [m]. is_due: the limits are judged."""
        parts = {"driven": way / self.distance_m}
        if not is_due:
            return parts
        metrics = {name: self.evaluation.metrics(name, self.names) for name in self.evaluation.machines}
        metrics[FIELD] = self.evaluation.metrics(FIELD, self.names) if is_end else {}
        self.limits = self.evaluation.check(metrics, tracks)
        for index, entry in enumerate(self.limits):
            if entry["value"] is None and not is_end:
                continue  # nothing to judge yet
            excess = _excess(entry)
            name = f"{entry['subject']}.{entry['name']}"
            parts[name] = parts.get(name, 0.0) + self._excess[index] - excess
            self._excess[index] = excess
        return parts


class Task:
    """What a policy is given to do, as `Env` explains it: spaces, and worlds in which it drives."""

    def __init__(
        self,
        scenario: str,
        *,
        sets: Sets = (),
        machine: str | None = None,
        period_s: float = 0.1,
        speed: bool = False,
        speed_kmh: float = 10.0,
        limits_s: float = 1.0,
        code: bool = False,
        picture: bool = False,
        scan: bool = False,
        seeds: Sequence[int] | None = None,
    ) -> None:
        self.scenario, self.sets, self.code, self.seeds = scenario, sets, code, seeds
        for name, value in (("period_s", period_s), ("limits_s", limits_s)):
            if not value > 0.0:
                raise InputError(name, value, "expected > 0")
        if seeds is not None and not len(seeds):
            raise InputError("seeds", [], "expected at least one")
        first = load_scenario(scenario, sets=sets, code=code)
        self.machine = machine or next(iter(first.machines))
        if self.machine not in first.machines:
            raise InputError("machine", machine, f"expected one of {', '.join(first.machines)}")
        self.period, self.limits_period = round(period_s * NS), round(limits_s * NS)
        self.with_speed, self.top = speed, speed_kmh * KMH
        size = np.array([largest for _, largest in OBSERVED], dtype=np.float32)
        self.values = spaces.Box(-size, size, dtype=np.float32)
        self.camera = self._first(first, "camera", "picture") if picture else ""
        self.lidar = self._first(first, "lidar", "scan") if scan else ""
        seen: dict[str, Any] = {"values": self.values}
        if picture:
            seen["picture"] = spaces.Box(0, 255, shape=self._picture_shape(first), dtype=np.uint8)
        if scan:
            seen["scan"] = self._scan_space(first)
        self._has_warned = False
        self.seen = spaces.Dict(seen) if picture or scan else self.values
        self.action = spaces.Box(-1.0, 1.0, shape=(2 if speed else 1,), dtype=np.float32)

    def drawn(self, random: np.random.Generator) -> int:
        """The seed of an episode that was given none."""
        if self.seeds is None:
            return int(random.integers(1, 2**31))
        return int(self.seeds[int(random.integers(len(self.seeds)))])

    def begin(self, seed: int) -> "Driven":
        """A world in which the policy drives."""
        world = assemble(load_scenario(self.scenario, sets=self.sets, seed=seed, code=self.code))
        machine = world.machines[self.machine]
        geometry = machine.recorded().geometry
        tightest = tan(geometry.max_steer) / geometry.wheelbase
        wanted = geometry.header_end(machine.edge_side)[1] if geometry.has_header else 0.0
        steer = Commanded(SteerCommand, "curvature", is_engaged=True)
        exchange(world, f"{self.machine}.steer", steer, {})
        speed = Commanded(SpeedCommand, "speed")
        if self.with_speed:
            exchange(world, f"{self.machine}.speed", speed, {})
        return Driven(seed, world, steer, speed, tightest, self.top, wanted)

    def checked(self, actions: Any, shape: tuple[int, ...]) -> np.ndarray:
        """Actions within the space, the first outside it with a warning.

        InputError for what is no finite number, or of another shape.
        """
        values, count = np.asarray(actions, dtype=float), shape[-1]
        if len(shape) == 1:
            values = values.reshape(-1)
        if values.shape != shape or not np.isfinite(values).all():
            each = f" for each of {shape[0]} environments" if len(shape) > 1 else ""
            expected = f"expected {count} finite number{'s' * (count > 1)}{each}"
            raise InputError("action", actions, expected)
        cut: np.ndarray = np.clip(values, -1.0, 1.0)
        if not self._has_warned and (far := float(np.abs(values - cut).max())) > OUTSIDE:
            self._has_warned = True
            logger.warn(
                f"an action lies {far:.3g} outside its space, -1 to 1, and is cut, as all such from now on: "
                "gymnasium.wrappers.ClipAction says that this is meant, RescaleAction maps another range"
            )
        return cut

    def values_of(self, edge: Samples | None, odometry: Samples | None, wanted: np.ndarray) -> np.ndarray:
        """`OBSERVED` of worlds, float32, (n, 8). wanted: y of the header end in each."""
        found = np.zeros((len(wanted), len(OBSERVED)))
        if edge is not None:
            columns = [np.broadcast_to(field_of(edge, name), len(wanted)) for name in OF_EDGE]
            offset, confidence = columns[0], columns[3]
            found[:, : len(OF_EDGE)] = np.transpose([offset - wanted, *columns[1:]])
            found[~((confidence > 0.0) & np.isfinite(offset)), : len(OF_EDGE)] = 0.0
        if odometry is not None:
            for k, name in enumerate(OF_ODOMETRY, len(OF_EDGE)):
                found[:, k] = field_of(odometry, name)
        seen: np.ndarray = np.clip(np.nan_to_num(found), self.values.low, self.values.high)
        return seen.astype(np.float32)

    def _first(self, scenario: Scenario, wanted: str, key: str) -> str:
        """The machine's first slot of a kind. InputError without one."""
        slots = ((slot, kind_of(slot)) for slot in scenario.machines[self.machine].slots)
        found = next((slot for slot, kind in slots if kind is not None and kind.name == wanted), None)
        if found is None:
            such = f"sets={{'{self.machine}.{wanted}': '{'rays' if wanted == 'camera' else 'empirical'}'}}"
            raise InputError(key, True, f"expected a machine with a {wanted}, such as {such}")
        return f"{self.machine}.{found}"

    def _part(self, scenario: Scenario, name: str) -> Any:
        world = assemble(scenario, only=[name])
        part = world.machines[self.machine].parts[name.rpartition(".")[2]]
        world.close()
        return part

    def _picture_shape(self, scenario: Scenario) -> tuple[int, int, int]:
        """Height, width, 3. InputError of a camera that has no colours or no size before it has seen."""
        part = self._part(scenario, self.camera)
        if not isinstance(part, SceneCamera) or "colour" not in part.params.channels:
            expected = "expected a camera of level rays or error with the channel colour"
            raise InputError(self.camera, None, expected)
        return part.pinhole.height, part.pinhole.width, 3

    def _scan_space(self, scenario: Scenario) -> spaces.Box:
        """Ranges of the beams. InputError of a scanner that does not say how many it has."""
        part = self._part(scenario, self.lidar)
        if not (isinstance(part, HasRange) and hasattr(part, "azimuth")):
            expected = "expected a scanner of level profile, empirical or plants"
            raise InputError(self.lidar, None, expected)
        return spaces.Box(0.0, part.range_limits[1], shape=(len(part.azimuth),), dtype=np.float32)


def known_words(of: type, words: Mapping[str, Any], more: Sequence[str] = ()) -> None:
    """InputError for keywords that neither the class nor `more` has, with the nearest that it has."""
    known = [p.name for p in inspect.signature(of).parameters.values() if p.kind is p.KEYWORD_ONLY]
    for name, value in words.items():
        if name not in (*known, *more):
            raise InputError(name, value, unknown_key(name, (*known, *more), "unknown keyword"))


@dataclass
class Driven:
    """A world that a policy drives.

    tightest: curvature of the tightest turn [1/m]
    top: speed [m/s]
    wanted: as `values_of` has it
    """

    seed: int
    world: World
    steer: Commanded
    speed: Commanded
    tightest: float
    top: float
    wanted: float

    def tell(self, action: Sequence[float]) -> None:
        """What holds from now on. action: within the space."""
        self.steer.value = action[0] * self.tightest
        if len(action) > 1:
            self.speed.value = 0.5 * (1.0 + action[1]) * self.top

    def tell_nothing(self) -> None:
        """What holds before the first action."""
        self.steer.value = self.speed.value = 0.0


def scan_of(ranges: np.ndarray) -> np.ndarray:
    """A scan as it is observed. ranges: (..., beams, echoes) [m], nan = no echo."""
    found: np.ndarray = np.nan_to_num(ranges[..., 0], nan=0.0).astype(np.float32)
    return found


def _excess(entry: Mapping[str, Any]) -> float:
    """How far a limit is broken: the excess relative to the bound, at most 1; 1 for no value."""
    if entry["result"] == "pass":
        return 0.0
    if entry["value"] is None:
        return 1.0
    limit, value = entry["limit"], float(entry["value"])
    beyond = [
        (abs(value - bound), abs(bound))
        for key, bound in limit.items()
        if key in ("min", "max") and (value < bound if key == "min" else value > bound)
    ]
    return max((min(1.0, way / size) if size else 1.0 for way, size in beyond), default=1.0)
