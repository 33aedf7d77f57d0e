"""A scenario as an environment of gymnasium: somebody else's policy steers (extra `gym`)."""

from collections.abc import Mapping
from math import fsum, tan
from typing import Any

import numpy as np

from swath.api import Sets, load_scenario
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.errors import InputError, MissingExtra
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.units import KMH
from swath.judge.windows import FIELD
from swath.record.tracks import Tracks
from swath.runtime.assembly import assemble, exchange
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive, driven_m, has_arrived
from swath.runtime.world import World
from swath.scenario.scenario import Scenario
from swath.scenario.slots import kind_of
from swath.sensing.camera.rays import SceneCamera
from swath.signals import Signal, SpeedCommand, SteerCommand

try:
    import gymnasium
    from gymnasium import spaces
except ImportError as error:
    raise MissingExtra("gym", "swath.Env") from error

OBSERVED = (  # name, largest size; the edge's offset counts from the header end, > 0 left
    ("offset_m", 10.0), ("heading_rad", np.pi), ("curvature_1_m", 0.5), ("confidence", 1.0),
    ("offset_sd_m", 10.0), ("speed_m_s", 20.0), ("yaw_rate_rad_s", 3.0), ("steer_rad", 1.6),
)  # fmt: skip
TRACK_PERIOD = NS // 50
Seen = np.ndarray | dict[str, np.ndarray]


class Commanded(KeepsState):
    """A part of a machine that sends what it was told last. make: sample from time and number."""

    def __init__(self, port: Port, make: Any, value: float) -> None:
        self.inputs: tuple[Port, ...] = ()
        self.outputs = (port,)
        self._make, self.value = make, value

    def reset(self, stream: Stream) -> Outputs:
        """The command at t = 0."""
        return {"command": self._make(0, self.value)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The command valid at t + dt."""
        return {"command": self._make(t + dt, self.value)}


class Env(gymnasium.Env):  # type: ignore[misc]
    """A machine of a scenario that a policy drives; everything else is as in the scenario.

    Action, in [-1, 1]: path curvature as a share of the tightest turn, > 0 left; with `speed` also the wanted
    speed, from 0 to `speed_kmh`. Observation, float32, shape (8,), what control may see: the detected edge
    beside the header end, and odometry, as `OBSERVED` names them; 0 where no edge is found (confidence 0).
    With `picture` a dict of these `values` and the newest `picture` of the machine's first camera, sRGB
    uint8, (height, width, 3), black before there is one.

    The sum of all rewards of an episode is the share of `run.distance_m` that was driven, less, for every
    limit under `expect`, how far it is broken at the end: the excess relative to the bound, at most
    1. `info["reward"]` has these parts of each step, `info["limits"]` each limit's entry as in summary.json.
    Limits of the field count at the end. Terminated: the distance is driven, or something ended the run;
    truncated: `run.max_duration_s`.

    A reset with a seed is the scenario with that seed, without one the seed is drawn. machine: which one, by
    default the first; period_s: between two actions; code: as in `swath.load_scenario`, as the InputError.
    render_mode `rgb_array`: `render` gives the field from above as it is, the machine in the middle, north
    up.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        scenario: str = "straight",
        *,
        sets: Sets = (),
        machine: str | None = None,
        period_s: float = 0.1,
        speed: bool = False,
        speed_kmh: float = 10.0,
        code: bool = False,
        picture: bool = False,
        render_mode: str | None = None,
    ) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError("render_mode", render_mode, "expected rgb_array or None")
        self.scenario, self.sets, self.code, self.render_mode = scenario, sets, code, render_mode
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / period_s))}
        first = load_scenario(scenario, sets=sets, code=code)
        self.machine = machine or next(iter(first.machines))
        if self.machine not in first.machines:
            raise InputError("machine", machine, f"expected one of {', '.join(first.machines)}")
        self.period, self.with_speed, self.top = round(period_s * NS), speed, speed_kmh * KMH
        size = np.array([largest for _, largest in OBSERVED], dtype=np.float32)
        self._values = self.observation_space = spaces.Box(-size, size, dtype=np.float32)
        self._camera = self._camera_of(first) if picture else ""
        if picture:
            shape = self._picture_shape(first)
            seen = spaces.Box(0, 255, shape=shape, dtype=np.uint8)
            self.observation_space = spaces.Dict({"values": self._values, "picture": seen})
        self.action_space = spaces.Box(-1.0, 1.0, shape=(2 if speed else 1,), dtype=np.float32)
        self.world: World | None = None

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Begin an episode. Returns the observation and what is known of it."""
        super().reset(seed=seed)
        own = int(self.np_random.integers(1, 2**31)) if seed is None else seed
        self.close()
        self._begin(load_scenario(self.scenario, sets=self.sets, seed=own, code=self.code))
        return self._observation(), {"seed": own}

    def _begin(self, scenario: Scenario) -> None:
        world = self.world = assemble(scenario)
        geometry = world.machines[self.machine].recorded().geometry
        self._tightest = tan(geometry.max_steer) / geometry.wheelbase
        side = world.machines[self.machine].edge_side
        self._wanted = geometry.header_end(side)[1] if geometry.has_header else 0.0
        self._steer = Commanded(
            Port("command", SteerCommand), lambda t, value: SteerCommand(t, value, True), 0.0
        )
        exchange(world, f"{self.machine}.steer", self._steer, {})
        self._speed = Commanded(Port("command", SpeedCommand), SpeedCommand, 0.0)
        if self.with_speed:
            exchange(world, f"{self.machine}.speed", self._speed, {})
        self.evaluation = make_evaluation(world)
        self._tracks = {
            name: Tracks(machine.recorded(), TRACK_PERIOD, self.evaluation.columns(name))
            for name, machine in world.machines.items()
        }
        self._driven, self._excess = 0.0, dict.fromkeys(range(len(self.evaluation.expect)), 0.0)
        drive(world, [self.evaluation, self._note], until_s=0.0)

    def step(self, action: np.ndarray) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Drive for one period. Returns observation, reward, terminated, truncated, info. InputError for an
        action that is no finite number or not one for each axis of the space; what is out of it is cut.
        """
        world, count = self._running(), self.action_space.shape[0]
        told = np.asarray(action, dtype=float).reshape(-1)
        if len(told) != count or not np.isfinite(told).all():
            raise InputError("action", action, f"expected {count} finite number{'s' * (count > 1)}")
        told = np.clip(told, -1.0, 1.0)
        self._steer.value = float(told[0]) * self._tightest
        if self.with_speed:
            self._speed.value = 0.5 * (1.0 + float(told[1])) * self.top
        until = (world.graph.t + self.period) / NS
        drive(world, [self.evaluation, self._note], until_s=until, resume=True)
        terminated = bool(world.graph.ended) or has_arrived(world)
        truncated = not terminated and world.graph.t >= round(world.scenario.run.max_duration_s * NS)
        parts, limits = self._judged(is_end=terminated or truncated)
        info = {"reward": parts, "limits": limits, "t_s": world.graph.t / NS, "ended": world.graph.ended}
        return self._observation(), fsum(parts.values()), terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """With `rgb_array` 30 m by 30 m around the machine, uint8 (300, 300, 3); None without a render
        mode.
        """
        if self.render_mode is None:
            return None
        from swath.report.top_view import top_view

        return top_view(self._running(), self.machine)

    def close(self) -> None:
        """Close the world."""
        if self.world is not None:
            self.world.close()
            self.world = None

    def _running(self) -> World:
        if self.world is None:
            raise InputError("step", None, "expected after reset")
        return self.world

    def _note(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        for output, signal in outputs.items():
            self._tracks[slot.partition(".")[0]].take(t, f"{slot}.{output}", signal)

    def _judged(self, *, is_end: bool) -> tuple[dict[str, float], list[dict[str, Any]]]:
        """Parts of the reward of the last step, and the limits as they stand."""
        world = self._running()
        metrics = {name: self.evaluation.metrics(name) for name in world.machines}
        metrics[FIELD] = self.evaluation.metrics(FIELD) if is_end else {}
        tracks = {name: own.arrays() for name, own in self._tracks.items()}
        limits = self.evaluation.check(metrics, tracks)
        way = driven_m(world)
        parts = {"driven": (way - self._driven) / world.scenario.run.distance_m}
        self._driven = way
        for index, entry in enumerate(limits):
            if entry["value"] is None and not is_end:
                continue  # nothing to judge yet
            excess = _excess(entry)
            name = f"{entry['subject']}.{entry['name']}"
            parts[name] = parts.get(name, 0.0) + self._excess[index] - excess
            self._excess[index] = excess
        return parts, limits

    def _camera_of(self, scenario: Scenario) -> str:
        """The machine's first camera slot. InputError without one."""
        slots = ((slot, kind_of(slot)) for slot in scenario.machines[self.machine].slots)
        found = next((slot for slot, kind in slots if kind is not None and kind.name == "camera"), None)
        if found is None:
            expected = f"expected a machine with a camera, such as sets={{'{self.machine}.camera': 'rays'}}"
            raise InputError("picture", True, expected)
        return found

    def _picture_shape(self, scenario: Scenario) -> tuple[int, int, int]:
        """Height, width, 3. InputError of a camera that has no colours or no size before it has seen."""
        name = f"{self.machine}.{self._camera}"
        world = assemble(scenario, only=[name])
        part = world.machines[self.machine].parts[self._camera]
        world.close()
        if not isinstance(part, SceneCamera) or "colour" not in part.params.channels:
            raise InputError(name, None, "expected a camera of level rays or error with the channel colour")
        return part.pinhole.height, part.pinhole.width, 3

    def _observation(self) -> Seen:
        values = self._observed()
        if not self._camera:
            return values
        image: Any = self._running().graph.latest(f"{self.machine}.{self._camera}", "image")
        shape = self.observation_space["picture"].shape
        is_there = image is not None and image.colour.shape == shape
        return {"values": values, "picture": image.colour.copy() if is_there else np.zeros(shape, np.uint8)}

    def _observed(self) -> np.ndarray:
        graph = self._running().graph
        edge: Any = graph.latest(f"{self.machine}.edge", "edge")
        odometry: Any = graph.latest(f"{self.machine}.odometry", "odometry")
        found = edge is not None and edge.is_found
        values = [0.0] * 5
        if found:
            values = [
                edge.offset - self._wanted,
                edge.heading,
                edge.curvature,
                edge.confidence,
                edge.offset_sd,
            ]
        values += [odometry.speed, odometry.yaw_rate, odometry.steer_angle] if odometry else [0.0] * 3
        low, high = self._values.low, self._values.high
        seen: np.ndarray = np.clip(np.nan_to_num(np.array(values)), low, high).astype(np.float32)
        return seen


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
