"""A scenario as an environment of gymnasium: somebody else's policy steers (extra `gym`)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swath.api import Sets
from swath.core.errors import MissingExtra
from swath.driving_task import known_words
from swath.runtime.world import World
from swath.vector_environment import Seen, VectorEnv, taken

try:
    import gymnasium
except ImportError as error:
    raise MissingExtra("gym", "swath.Env") from error

KEPT = 16  # worlds of earlier episodes that wait for their seed to be drawn again


class Env(gymnasium.Env):  # type: ignore[misc]
    """A machine of a scenario that a policy drives; everything else is as in the scenario.

    Action, in [-1, 1]: path curvature as a share of the tightest turn, > 0 left; with `speed` also the wanted
    speed, from 0 to `speed_kmh`, with `settings` these, 0 as the scenario sets them, else as the machine has
    them for its crop. Observation, float32, shape (8,), what control may see: the detected edge beside the
    header end, and odometry, as `OBSERVED` names them; 0 where no edge is found (confidence 0); with
    `settings` (15,), the sensors on the crop's way, too, as `OF_CROP` names them. With `picture` or `scan` a
    dict of these `values` and of the newest `picture` of the machine's first camera, sRGB uint8, (height,
    width, 3), black before there is one, or the newest `scan` of its first LiDAR, ranges [m], (beams,), 0 =
    no echo.

    The sum of all rewards of an episode is the share of `run.distance_m` that was driven, less, for every
    limit under `expect`, how far it is broken at the end: the excess relative to the bound, at most
    1. `info["reward"]` has these parts of each step, `info["limits"]` each limit's entry as in summary.json.
    Terminated: the distance is driven, or something ended the run; truncated: `run.max_duration_s`.

    Parameters
    ----------
    scenario : str
        As in `swath.load_scenario`.
    sets : mapping or sequence of str
        As in `swath.load_scenario`.
    machine : str
        Name of the machine that is driven, by default the first.
    period_s : float
        Time between two actions [s].
    steer : bool
        Whether the policy steers; else as in the scenario.
    speed : bool
        Whether the action has the speed, too.
    speed_kmh : float
        Greatest speed of an action [km/h].
    settings : sequence of str
        Settings of the organs that the action has, too: keys of `settings: fixed`, such as `drum_rpm`.
    settings_percent : float
        Greatest change of a setting by an action, of what the scenario sets, else of the machine's own [%].
    limits_s : float
        Time after which limits are judged again [s]; those of the field are judged at the end.
    code : bool
        As in `swath.load_scenario`.
    picture, scan : bool
        Whether the observation has the picture, or the scan.
    seeds : sequence of int
        Seeds from which a reset without one draws.
    render_mode : str
        `rgb_array`: `render` gives the field from above as it is, the machine in the middle, north up.

    Raises
    ------
    InputError
        As `swath.load_scenario`.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(
        self,
        scenario: str = "straight",
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
        render_mode: str | None = None,
        **unknown: Any,
    ) -> None:
        known_words(Env, unknown)
        self._one = VectorEnv(
            scenario, autoreset_mode="Disabled", render_mode=render_mode, sets=sets, machine=machine,
            period_s=period_s, steer=steer, speed=speed, speed_kmh=speed_kmh, settings=settings,
            settings_percent=settings_percent, limits_s=limits_s, code=code, picture=picture, scan=scan,
            seeds=seeds,
        )  # fmt: skip
        self._one.most_kept = min(self._one.most_kept, KEPT)
        self.task, self.render_mode = self._one.task, render_mode
        self.metadata = {**self.metadata, "render_fps": self._one.metadata["render_fps"]}
        self.observation_space, self.action_space = self.task.seen, self.task.action

    @property
    def world(self) -> World | None:
        """The world of the present or last episode; None before the first, and once it is closed."""
        driven = self._one.driven[0]
        return None if driven is None else driven.world

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Begin an episode. Returns the observation and what is known of it."""
        super().reset(seed=seed)
        own = self.task.drawn(self.np_random) if seed is None else seed
        _, infos = self._one.reset(seed=own)
        return self._one.one(0), taken(infos, 0)

    def step(self, action: np.ndarray) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Drive for one period.

        Returns observation, reward, terminated, truncated, info. InputError for an action that is no finite
        number or not one for each axis of the space; what is out of it is cut, the first time with a warning
        of gymnasium.
        """
        actions = self.task.checked(action, self.action_space.shape)
        _, reward, terminated, truncated, infos = self._one.go(actions[None])
        return self._one.one(0), float(reward[0]), bool(terminated[0]), bool(truncated[0]), taken(infos, 0)

    def render(self) -> np.ndarray | None:
        """With `rgb_array` 30 m by 30 m around the machine, uint8 (300, 300, 3); None without a render
        mode.
        """
        pictures = self._one.render()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Close the world."""
        self._one.close_extras()
