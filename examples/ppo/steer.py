"""PPO of stable-baselines3 learns to steer along the crop edge, in worlds that go in step.

    pip install 'swath[gym]' stable-baselines3      # the curve here: version 2.9.2, torch 2.13
    python examples/ppo/steer.py

The policy sees what `swath.Env` shows. A step is worth the more the nearer the header end is to where it
should be, 0.1 m out over the stubble, as the detector sees it. Written beside this file: `curve.csv` and
`curve.png`, how far off the worlds were while it learned; then the policy alone drives in worlds that it has
not seen.
"""

import argparse
import csv
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

import swath

SETS = {
    "combine.lidar.level": "profile",
    "combine.header.level": "profile",
    "combine.motion": {"level": "kinematic", "start_speed_kmh": 7},
    "combine.edge": "otsu",
    "run": {"distance_m": 100, "max_duration_s": 12},
    "expect": {"lateral_rms_m": {"max": 0.1}},
}
OUT_M, TURN = 0.1, 0.3  # where the header end should be [m], share of the tightest turn that the policy has
HALF = 60  # steps of half an episode
SCALE = np.array([1.0, 4.0, 10.0, 1.0, 1.0, 0.5, 4.0, 4.0])  # of what is seen, to numbers of about 1


class InStep(VecEnv):
    """The worlds of `swath.VectorEnv` as stable-baselines3 has its environments.

    off: lateral error of the last step [m]
    """

    def __init__(self, count: int, seed: int, autoreset_mode: str = "SameStep") -> None:
        self.worlds = swath.VectorEnv("straight", num_envs=count, sets=SETS, autoreset_mode=autoreset_mode,
                                      seeds=range(seed, seed + 4 * count))  # fmt: skip
        self.first, self.off = seed, np.zeros(count)
        one = self.worlds
        super().__init__(count, one.single_observation_space, one.single_action_space)

    def reset(self) -> np.ndarray:
        return np.asarray(self.worlds.reset(seed=self.first)[0] * SCALE, np.float32)

    def step_async(self, actions: np.ndarray) -> None:
        self.actions = TURN * np.clip(actions, -1.0, 1.0)

    def step_wait(self) -> Any:
        seen, _, terminated, truncated, told = self.worlds.step(self.actions)
        over, infos = terminated | truncated, [dict[str, Any]() for _ in range(self.num_envs)]
        now = seen.copy()
        for k in np.flatnonzero(over & ("final_obs" in told)).tolist():
            now[k] = told["final_obs"][k]
            infos[k] = {
                "terminal_observation": np.float32(now[k] * SCALE),
                "TimeLimit.truncated": truncated[k],
            }
        self.off = np.where(now[:, 3] > 0.0, np.abs(now[:, 0] + OUT_M), 1.0)
        worth = 1.0 - np.minimum(self.off, 1.0) - 0.05 * np.abs(self.actions[:, 0])
        return np.float32(seen * SCALE), np.float32(worth), over, infos

    def close(self) -> None:
        self.worlds.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.worlds, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


class Curve(BaseCallback):
    """Notes how far off the worlds are. rows: steps, CPU seconds, root mean square of each rollout [m]."""

    def __init__(self) -> None:
        super().__init__()
        self.rows, self._squares = list[tuple[int, float, float]](), list[float]()

    def _on_step(self) -> bool:
        self._squares.append(float(np.mean(self.training_env.off**2)))
        return True

    def _on_rollout_end(self) -> None:
        off = float(np.sqrt(np.mean(self._squares)))
        self.rows.append((self.num_timesteps, round(time.process_time(), 1), round(off, 4)))
        print("{:8d} steps, {:6.1f} s of CPU, {:.3f} m off".format(*self.rows[-1]), flush=True)
        self._squares.clear()


def draw(rows: Sequence[tuple[int, float, float]], file: Path) -> None:
    """The curve as a picture."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 3.2), layout="constrained")
    for first, colour, what in (
        (0, "#56B4E9", "6 s from the start beside the line"),
        (1, "#0072B2", "6 s then"),
    ):
        steps, _, off = np.transpose(rows[first::2])
        axes.plot(steps / 1000.0, 100.0 * off, color=colour, label=what)
    axes.axhline(10.0, color="#D55E00", linewidth=1.0)
    axes.set(xlabel="steps of 0.1 s, thousands", ylabel="off the line, RMS [cm]", ylim=(0, None),
             title=f"PPO learns to steer: {rows[-1][1]:.0f} s of one core")  # fmt: skip
    axes.legend(frameon=False)
    figure.savefig(file, dpi=100)


def lateral_rms(policy: PPO, seed: int, count: int) -> Sequence[float]:
    """What the policy alone comes to in each of `count` worlds, as a test judges it [m]."""
    envs = InStep(count, seed, "Disabled")
    seen, over = envs.reset(), np.zeros(count, bool)
    while not over.all():
        envs.step_async(policy.predict(seen, deterministic=True)[0])
        seen, _, over, _ = envs.step_wait()
    limits = [limit for score in envs.worlds.scores for limit in score.limits]
    found = [limit["value"] for limit in limits if limit["name"] == "lateral_rms_m"]
    envs.close()
    return found


def main(steps: int, count: int, out: Path) -> None:
    torch.set_num_threads(1)
    curve = Curve()
    policy = PPO("MlpPolicy", InStep(count, seed=1), n_steps=HALF, batch_size=15 * count, gamma=0.9, seed=1,
                 learning_rate=1e-3, policy_kwargs={"net_arch": [32, 32], "log_std_init": -1.0})  # fmt: skip
    policy.learn(steps, callback=curve)
    with (out / "curve.csv").open("w", newline="") as file:
        csv.writer(file).writerows([("steps", "cpu_s", "off_m"), *curve.rows])
    draw(curve.rows, out / "curve.png")
    found = lateral_rms(policy, seed=100_000, count=16)
    print(f"alone in 16 new worlds: lateral RMS {np.mean(found):.3f} m, worst {max(found):.3f} m")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--steps", type=int, default=60_000)
    parser.add_argument("--worlds", type=int, default=32)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    told = parser.parse_args()
    main(told.steps, told.worlds, told.out)
