"""Many worlds of a scenario as one vector environment of gymnasium, in step in one process (extra `gym`)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import fsum
from typing import Any

import numpy as np

from swath.core.errors import InputError, MissingExtra
from swath.core.schedule import NS
from swath.driving_task import OF_CROP, Driven, Score, Task, known_words, scan_of
from swath.runtime.worlds import Worlds, groups_in_step

try:
    import gymnasium
    from gymnasium.utils import seeding
    from gymnasium.vector import AutoresetMode
    from gymnasium.vector.utils import batch_space
except ImportError as error:
    raise MissingExtra("gym", "swath.VectorEnv") from error


Seen = np.ndarray | dict[str, np.ndarray]


@dataclass
class _Cohort:
    """Worlds that began at one time. members: which environments they are; driven: their worlds."""

    worlds: Worlds
    members: np.ndarray
    driven: Sequence[Driven]
    scores: Sequence[Score]
    wanted: np.ndarray


class VectorEnv(gymnasium.vector.VectorEnv):  # type: ignore[misc]
    """`Env`, many times: each environment gives the bits that it gives alone.

    Worlds that begin in one step go in step (docs/explanation/kernels.md): a step of `num_envs` costs what
    `num_envs` worlds in step cost while episodes begin and end together. Environments that are reset while
    others go on are a batch of their own from then on.

    Parameters
    ----------
    scenario : str
        As in `swath.load_scenario`.
    num_envs : int
        Number of environments.
    autoreset_mode : AutoresetMode or str
        NextStep, SameStep or Disabled of gymnasium. With Disabled, environments that are over give their last
        observation and no reward until `reset`, with `options={"reset_mask": ...}` for some of them.
    render_mode : str
        `rgb_array`: `render` gives a picture of each, as `Env.render`.
    **task
        The other keywords of `Env`. With `seeds` worlds whose batch is over are used again, and not built
        anew.

    Raises
    ------
    InputError
        As `swath.load_scenario`.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        scenario: str = "straight",
        *,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **task: Any,
    ) -> None:
        if num_envs < 1:
            raise InputError("num_envs", num_envs, "expected >= 1")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError("render_mode", render_mode, "expected rgb_array or None")
        known_words(Task, task, ("num_envs", "autoreset_mode", "render_mode"))
        self.task, self.render_mode = Task(scenario, **task), render_mode
        modes = [mode.value for mode in AutoresetMode]
        if autoreset_mode not in (*AutoresetMode, *modes):
            raise InputError("autoreset_mode", autoreset_mode, f"expected one of {', '.join(modes)}")
        self.num_envs, self.mode = num_envs, AutoresetMode(autoreset_mode)
        fps = max(1, round(NS / max(self.task.period, 1)))
        self.metadata = {**self.metadata, "autoreset_mode": self.mode, "render_fps": fps}
        self.single_observation_space, self.single_action_space = self.task.seen, self.task.action
        self.observation_space = batch_space(self.task.seen, num_envs)
        self.action_space = batch_space(self.task.action, num_envs)
        spaces = {"values": self.task.values} if self.task.seen is self.task.values else self.task.seen
        self._seen = {name: np.zeros((num_envs, *own.shape), own.dtype) for name, own in spaces.items()}
        self._randoms: list[np.random.Generator | None] = [None] * num_envs
        self._cohorts: list[_Cohort] = []
        self._scores: list[Any] = [None] * num_envs
        self.driven: list[Driven | None] = [None] * num_envs  # worlds of the present or last episodes
        self._spare: list[Driven] = []
        seeds = self.task.seeds
        self.most_kept = 0 if seeds is None else max(num_envs, len(seeds))  # worlds beside those that go
        self._terminated, self._truncated = np.zeros((2, num_envs), np.bool_)
        self._way, self._reward = np.zeros((2, num_envs))

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Begin episodes.

        Parameters
        ----------
        seed : int or sequence of int
            Seed of the first, the others count on; or one for each.
        options : mapping
            `reset_mask`, bool (num_envs,): only these.

        Returns
        -------
        tuple
            Observations, and what is known of them.
        """
        seeds: Sequence[int | None]
        if seed is None or isinstance(seed, int | np.integer):
            seeds = [None if seed is None else int(seed) + k for k in range(self.num_envs)]
        else:
            seeds = seed
        if len(seeds) != self.num_envs:
            raise InputError("seed", list(seeds), f"expected {self.num_envs}")
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise InputError("reset_mask", mask.tolist(), f"expected {self.num_envs} bool, one of them true")
        infos: dict[str, Any] = {}
        self._begin(np.flatnonzero(mask), seeds, infos)
        return self._observation(), infos

    def step(self, actions: Any) -> tuple[Seen, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Drive all for one period, as `Env.step`; environments that were over before begin anew."""
        return self.go(self.task.checked(actions, self.action_space.shape))

    def go(self, actions: np.ndarray) -> tuple[Seen, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """As `step`, with actions that are within the space."""
        over = self._terminated | self._truncated
        if not self._cohorts and not over.any():
            raise InputError("step", None, "expected after reset")
        self._reward[:] = 0.0
        infos: dict[str, Any] = {}
        for cohort in self._cohorts:
            self._drive(cohort, actions, infos)
        self._retire()
        if self.mode is AutoresetMode.NEXT_STEP:
            self._begin(np.flatnonzero(over), [None] * self.num_envs, infos)
        terminated, truncated = self._terminated.copy(), self._truncated.copy()
        ended = np.flatnonzero(terminated | truncated)
        if self.mode is AutoresetMode.SAME_STEP and len(ended):
            for index in ended.tolist():
                last = {"final_obs": self.one(index), "final_info": taken(infos, index)}
                infos = self._add_info(infos, last, index)
            self._begin(ended, [None] * self.num_envs, infos)
        return self._observation(), self._reward.copy(), terminated, truncated, infos

    def close_extras(self, **kwargs: Any) -> None:
        """Close the worlds."""
        for driven in (*(each for cohort in self._cohorts for each in cohort.driven), *self._spare):
            driven.world.close()
        self._cohorts, self._spare, self.driven = [], [], [None] * self.num_envs
        self._terminated[:] = self._truncated[:] = False

    def render(self) -> tuple[np.ndarray, ...] | None:
        """As `Env.render`, of each."""
        if self.render_mode is None:
            return None
        from swath.report.field_plot import top_view

        if None in self.driven:
            raise InputError("render", None, "expected after reset")
        return tuple(top_view(own.world, self.task.machine) for own in self.driven if own is not None)

    @property
    def scores(self) -> list[Score]:
        """The scores of each environment, with the limits as they were judged last."""
        return list(self._scores)

    def _begin(self, which: np.ndarray, seeds: Sequence[int | None], infos: dict[str, Any]) -> None:
        """Cohorts of environments, taken out of those in which they are."""
        if not len(which):
            return
        for cohort in self._cohorts:
            cohort.worlds.lockstep.stop(np.flatnonzero(np.isin(cohort.members, which)))
        self._retire()
        driven = []
        for index in which.tolist():
            seed, random = seeds[index], self._randoms[index]
            if random is None or seed is not None:
                random = self._randoms[index] = seeding.np_random(seed)[0]
            own = self.task.drawn(random) if seed is None else seed
            spare = next((each for each in reversed(self._spare) if each.seed == own), None)
            if spare is not None:
                self._spare.remove(spare)
            driven.append(spare or self.task.begin(own))
            driven[-1].tell_nothing()
            self.driven[index] = driven[-1]
        for group in groups_in_step([each.world for each in driven]):
            self._join(which[group], [driven[k] for k in group])
        driven_seeds = np.zeros(self.num_envs, np.int64) if "seed" not in infos else infos["seed"]
        driven_seeds[which] = [each.seed for each in driven]
        infos["seed"], infos["_seed"] = driven_seeds, self._mask(infos, "seed", which)

    def _join(self, which: np.ndarray, driven: list[Driven]) -> None:
        """A cohort of these environments."""
        worlds = Worlds([each.world for each in driven], is_whole=False)
        scores = [
            Score(run.evaluation, each.world.scenario.run.distance_m)
            for run, each in zip(worlds.runs, driven, strict=True)
        ]
        cohort = _Cohort(worlds, which, driven, scores, np.array([each.wanted for each in driven]))
        worlds.begin()
        self._cohorts.append(cohort)
        for index, score in zip(which.tolist(), scores, strict=True):
            self._scores[index] = score
        self._terminated[which] = self._truncated[which] = False
        self._way[which] = 0.0
        self._look(cohort, np.arange(len(which)))

    def _retire(self) -> None:
        """Let go of cohorts that are over; with `seeds` the newest of their worlds are kept."""
        over = [cohort for cohort in self._cohorts if not cohort.worlds.lockstep.going]
        self._spare += (driven for cohort in over for driven in cohort.driven)
        count = max(len(self._spare) - self.most_kept, 0)
        for driven in self._spare[:count]:
            driven.world.close()
            driven.world.graph.let_go()
        del self._spare[:count]
        self._cohorts = [cohort for cohort in self._cohorts if cohort.worlds.lockstep.going]

    def _drive(self, cohort: _Cohort, actions: np.ndarray, infos: dict[str, Any]) -> None:
        worlds, lockstep = cohort.worlds, cohort.worlds.lockstep
        begin = lockstep.t
        for driven, action in zip(cohort.driven, actions[cohort.members].tolist(), strict=True):
            driven.tell(action)
        latest = round(cohort.driven[0].world.scenario.run.max_duration_s * NS)
        until = min(begin + self.task.period, latest)
        for ending in worlds.advance(until):
            if lockstep.errors:
                raise next(iter(lockstep.errors.values()))
            self._settle(cohort, np.array(ending), begin, is_end=True, infos=infos)
            self._terminated[cohort.members[ending]] = True
        if lockstep.going:
            rest, is_over = np.array(lockstep.going), until >= latest
            self._settle(cohort, rest, begin, is_end=is_over, infos=infos)
            if is_over:
                self._truncated[cohort.members[rest]] = True
                lockstep.stop(lockstep.going)

    def _settle(
        self, cohort: _Cohort, which: np.ndarray, begin: int, *, is_end: bool, infos: dict[str, Any]
    ) -> None:
        """Observation, reward and what is reported of worlds of a cohort, at the end of their step."""
        self._look(cohort, which)
        worlds, members, period = cohort.worlds, cohort.members[which], self.task.limits_period
        way, before = np.array(worlds.driven())[which], self._way[members]
        self._way[members] = way
        share = (way - before) / np.array([cohort.scores[k].distance_m for k in which.tolist()])
        self._reward[members] = share
        graphs = [worlds.worlds[k].graph for k in which.tolist()]
        self._tell(infos, "t_s", members, [graph.t / NS for graph in graphs], float)
        self._tell(infos, "ended", members, [graph.ended for graph in graphs], object)
        parts = infos.setdefault("reward", {})
        self._tell(parts, "driven", members, share, float)
        infos["_reward"] = self._mask(infos, "reward", members)
        for row, (k, graph) in enumerate(zip(which.tolist(), graphs, strict=True)):
            if is_end or graph.t // period > begin // period:
                score, run = cohort.scores[k], worlds.runs[k]
                tracks = {n: own.arrays() for n, own in run.recorder.tracks.items()} if run.has_tracks else {}
                own = score.parts(float(way[row] - before[row]), tracks, is_end=is_end, is_due=True)
                self._reward[members[row]] = fsum(own.values())
                for name, value in own.items():
                    self._tell(parts, name, members[row : row + 1], value, float)
        limits = np.fromiter((cohort.scores[k].limits for k in which.tolist()), object, len(which))
        self._tell(infos, "limits", members, limits, object)

    def _look(self, cohort: _Cohort, which: np.ndarray) -> None:
        """Note what worlds of a cohort see."""
        task, members, seen = self.task, cohort.members[which], self._seen
        newest = cohort.worlds.lockstep.newest
        samples = (newest((f"{task.machine}.{name}", name)) for name in ("edge", "odometry"))
        edge, odometry = (None if sent is None else sent.stacked for sent in samples)
        outputs = [output for _, output, *_ in OF_CROP] if task.flow else []
        readings = [newest((f"{task.machine}.{task.flow}", output)) for output in outputs]
        crop = [None if sent is None else sent.stacked for sent in readings]
        seen["values"][members] = task.values_of(edge, odometry, cohort.wanted, crop)[which]
        if task.lidar and (scan := newest((task.lidar, "scan"))) is not None:
            seen["scan"][members] = scan_of(scan.stacked.arrays["ranges"][which])
        if task.camera:
            sent, pictures = newest((task.camera, "image")), seen["picture"]
            for world, place in zip(which.tolist(), members.tolist(), strict=True):
                colour = None if sent is None else sent.view(world).colour
                is_there = colour is not None and colour.shape == pictures.shape[1:]
                pictures[place] = colour if is_there else 0

    def one(self, index: int) -> Seen:
        """The observation of one environment."""
        seen = {name: array[index].copy() for name, array in self._seen.items()}
        return seen if len(seen) > 1 else seen["values"]

    def _observation(self) -> Seen:
        seen = {name: array.copy() for name, array in self._seen.items()}
        return seen if len(seen) > 1 else seen["values"]

    def _tell(self, infos: dict[str, Any], name: str, which: np.ndarray, values: Any, kind: type) -> None:
        if name not in infos:
            infos[name] = np.full(self.num_envs, None) if kind is object else np.zeros(self.num_envs, kind)
        infos[name][which] = values
        infos[f"_{name}"] = self._mask(infos, name, which)

    def _mask(self, infos: Mapping[str, Any], name: str, which: np.ndarray) -> np.ndarray:
        """Which environments something is reported of."""
        mask: np.ndarray = infos.get(f"_{name}", np.zeros(self.num_envs, np.bool_))
        mask[which] = True
        return mask


def taken(infos: dict[str, Any], index: int) -> dict[str, Any]:
    """What is reported of one environment, as `Env` gives it, taken out of what is reported of all."""
    found: dict[str, Any] = {}
    for name in [name for name in infos if f"_{name}" in infos and infos[f"_{name}"][index]]:
        value, mask = infos[name], infos[f"_{name}"]
        if isinstance(value, dict):
            found[name] = taken(value, index)
        else:
            found[name] = value[index].item() if isinstance(value[index], np.generic) else value[index]
            value[index] = None if value.dtype == object else 0
        mask[index] = False
        if not mask.any():
            del infos[name], infos[f"_{name}"]
    return found
