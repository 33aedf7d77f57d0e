"""What a policy is given to do in a scenario, and what that is worth (extra `gym`)."""

import dataclasses
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import tan
from typing import Any

import numpy as np

from swath.api import Sets, load_scenario
from swath.control.settings.fixed import PRESETS, UNITS
from swath.core.abilities import HasRange
from swath.core.component import Port
from swath.core.errors import Extra, InputError, SwathError
from swath.core.number_text import num
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.together import Given, InWorlds, KeepsRows, Samples, field_of
from swath.core.units import KMH, PERCENT
from swath.documents.validation import unknown_key
from swath.judge.evaluation import Evaluation
from swath.judge.windows import FIELD
from swath.runtime.assembly import assemble, exchange
from swath.runtime.world import Machine, World
from swath.scenario.machine_types import ORGANS
from swath.scenario.scenario import Scenario
from swath.scenario.slots import kind_of
from swath.sensing.camera.rays import SceneCamera
from swath.signals import OrganSettings, Signal, SpeedCommand, SteerCommand
from swath.signals.settings import NAMES, own_settings

with Extra("gym", "swath.Env"):
    from gymnasium import logger, spaces

OBSERVED = (  # name, largest size; the edge's offset counts from the header end, > 0 left
    ("offset_m", 10.0), ("heading_rad", np.pi), ("curvature_1_m", 0.5), ("confidence", 1.0),
    ("offset_sd_m", 10.0), ("speed_m_s", 20.0), ("yaw_rate_rad_s", 3.0), ("steer_rad", 1.6),
)  # fmt: skip
OF_EDGE = ("offset", "heading", "curvature", "confidence", "offset_sd")
OF_ODOMETRY = ("speed", "yaw_rate", "steer_angle")
OF_CROP = (  # with settings, too: name, output of `crop_flow` and its field, largest size
    ("feed_kg_s", "feed", "flow", 200.0), ("grain_kg_s", "grain", "flow", 100.0),
    ("separation_loss_kg_s", "loss", "separation", 50.0), ("cleaning_loss_kg_s", "loss", "cleaning", 50.0),
    ("returns_kg_s", "returns", "flow", 50.0), ("broken", "quality", "broken", 1.0),
    ("foreign", "quality", "foreign", 1.0),
)  # fmt: skip
OUTSIDE = 1e-6  # of an action beyond its space: more than float32 rounds off
FIXED = "fixed", *PRESETS  # levels of settings in whose place a policy may be


class Commanded(InWorlds):
    """A part of a machine that sends what it was given last.

    port: its output; kind: of what it sends; scales: its fields that are given, with what an action of the
    policy is worth in each; more: its other fields; rest: values before the first action
    """

    def __init__(
        self,
        port: str,
        kind: type[Signal],
        scales: Mapping[str, Callable[[float], float]],
        rest: Sequence[float],
        **more: Any,
    ) -> None:
        self.inputs: tuple[Port, ...] = ()
        self.outputs = (Port(port, kind),)
        self.kind, self.scales, self.more = kind, scales, more
        self.rest, self.values = rest, rest

    def tell(self, action: Sequence[float]) -> None:
        """What holds from now on."""
        self.values = [scale(a) for scale, a in zip(self.scales.values(), action, strict=True)]

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
        first, values = self.parts[0], np.array([part.values for part in self.parts], dtype=float)
        given = {name: values[:, k].copy() for k, name in enumerate(first.scales)}
        more = {name: np.full(len(values), value) for name, value in first.more.items()}
        return {first.outputs[0].name: Samples(first.kind, t, given | more)}


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
        steer: bool = True,
        speed: bool = False,
        speed_kmh: float = 10.0,
        settings: Sequence[str] = (),
        settings_percent: float = 40.0,
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
        self.with_steer, self.with_speed, self.top = steer, speed, speed_kmh * KMH
        if isinstance(settings, str) or not isinstance(settings, Sequence):
            raise InputError("settings", settings, f"expected a list with some of {', '.join(UNITS)}")
        if not isinstance(settings_percent, float | int):
            raise InputError("settings_percent", settings_percent, "expected a number")
        self.settings, self.change = tuple(settings), settings_percent * PERCENT
        self.slot = self.flow = ""  # of the settings, and of the sensors of what becomes of the crop
        if self.settings:
            self.slot, self.flow = self._with_organs(first, settings_percent)
        count = steer + speed + len(self.settings)
        if not count:
            raise InputError("steer", steer, "expected an action: steer, speed or settings")
        largest = [size for _, size in OBSERVED]
        largest += [size for *_, size in OF_CROP if self.flow]
        size = np.array(largest, dtype=np.float32)
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
        self.action = spaces.Box(-1.0, 1.0, shape=(count,), dtype=np.float32)

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
        wanted = geometry.header_end(machine.edge_side)[1] if geometry.has_header else 0.0
        told = {}
        if self.with_steer:
            tightest = tan(geometry.max_steer) / geometry.wheelbase
            curvature = {"curvature": lambda a: a * tightest}
            told["steer"] = Commanded("command", SteerCommand, curvature, [0.0], is_engaged=True)
        if self.with_speed:
            given = {"speed": lambda a: 0.5 * (1.0 + a) * self.top}
            told["speed"] = Commanded("command", SpeedCommand, given, [0.0])
        if self.settings:
            told[self.slot] = self._settings_of(world, machine)
        for slot, part in told.items():
            exchange(world, f"{self.machine}.{slot}", part, {})
        return Driven(seed, world, tuple(told.values()), wanted)

    def _settings_of(self, world: World, machine: Machine) -> Commanded:
        """Settings around those of the scenario, else those that the machine has for its crop."""
        said, fields = machine.slots[self.slot].params, dict(zip(UNITS, NAMES, strict=True))
        given = {
            f: getattr(said, key) * UNITS[key] for key, f in fields.items() if getattr(said, key) is not None
        }
        own = own_settings(machine.sheet.works, str(world.field.stand.crop), OrganSettings(0, **given))
        scales = {
            fields[key]: lambda a, own=own[fields[key]]: own * (1.0 + self.change * a)
            for key in self.settings
        }
        rest = {name: value for name, value in given.items() if name not in scales}
        return Commanded("settings", OrganSettings, scales, [own[name] for name in scales], **rest)

    def _with_organs(self, scenario: Scenario, percent: float) -> tuple[str, str]:
        """Slots of the settings and of the sensors on the crop's way. InputError without them."""
        for key in self.settings:
            if key not in UNITS or self.settings.count(key) > 1:
                raise InputError("settings", key, f"expected some of {', '.join(UNITS)}, each once")
        if not 0.0 < percent < 100.0:
            raise InputError("settings_percent", percent, "expected > 0 and < 100")
        there, name = scenario.machines[self.machine].slots, self.machine
        wanted = ("settings", "crop_flow")
        slots = [[slot for slot, c in there.items() if c.kind.name == kind] for kind in wanted]
        if not all(slots) or not set(ORGANS) & set(there):
            such = {"process.level": "organs", "settings": "fixed", "crop_flow": "counted"}
            sets = {f"{name}.{key}": level for key, level in such.items()}
            raise InputError("settings", list(self.settings), f"expected organs, by sets={sets}")
        if (level := there[slots[0][0]].level) not in FIXED:
            expected = f"expected {' or '.join(FIXED)}, which the policy sets"
            raise InputError(f"{name}.{slots[0][0]}.level", level, expected)
        return slots[0][0], slots[1][0]

    def checked(self, actions: Any, shape: tuple[int, ...]) -> np.ndarray:
        """Actions within the space, the first outside it with a warning.

        InputError for what is no finite number, or of another shape.
        """
        count = shape[-1]
        try:
            values = np.asarray(actions, dtype=float)
        except (TypeError, ValueError):
            values = np.full(shape, np.nan)
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
                f"an action lies {num(far)} outside its space, -1 to 1, and is cut, as all such from now on: "
                "gymnasium.wrappers.ClipAction says that this is meant, RescaleAction maps another range"
            )
        return cut

    def values_of(
        self,
        edge: Samples | None,
        odometry: Samples | None,
        wanted: np.ndarray,
        crop: Sequence[Samples | None] = (),
    ) -> np.ndarray:
        """`OBSERVED` and `OF_CROP` of worlds, float32, (n, 8 or 15). wanted: y of the header end in each;
        crop: the newest of each of `OF_CROP`.
        """
        found = np.zeros((len(wanted), len(self.values.low)))
        if edge is not None:
            columns = [np.broadcast_to(field_of(edge, name), len(wanted)) for name in OF_EDGE]
            offset, confidence = columns[0], columns[3]
            found[:, : len(OF_EDGE)] = np.transpose([offset - wanted, *columns[1:]])
            found[~((confidence > 0.0) & np.isfinite(offset)), : len(OF_EDGE)] = 0.0
        if odometry is not None:
            for k, name in enumerate(OF_ODOMETRY, len(OF_EDGE)):
                found[:, k] = field_of(odometry, name)
        for k, (sent, (_, _, name, _)) in enumerate(zip(crop, OF_CROP, strict=False), len(OBSERVED)):
            if sent is not None:
                found[:, k] = field_of(sent, name)
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

    told: parts that send its actions, in their order
    wanted: as `values_of` has it
    """

    seed: int
    world: World
    told: tuple[Commanded, ...]
    wanted: float

    def tell(self, action: Sequence[float]) -> None:
        """What holds from now on. action: within the space."""
        left = list(action)
        for part in self.told:
            part.tell(left[: len(part.scales)])
            del left[: len(part.scales)]

    def tell_nothing(self) -> None:
        """What holds before the first action."""
        for part in self.told:
            part.values = part.rest


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
