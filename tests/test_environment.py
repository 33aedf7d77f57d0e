"""A scenario as an environment of gymnasium."""

import runpy
import warnings
from pathlib import Path

import numpy as np
import pytest

import swath
from swath.core.errors import InputError

pytest.importorskip("gymnasium")
EXAMPLE = Path(__file__).parents[1] / "examples" / "gym_steering.py"
SETS = {
    "run.distance_m": 3,
    "combine.lidar": "off",
    "combine.edge.level": "truth",
    "combine.motion.start_speed_kmh": 7,
    "expect": {"distance_m": {"max": 2}, "grain_cut_kg": {"min": 1}},
}


def episode(env, action, seed=3):
    seen, _ = env.reset(seed=seed)
    rows, rewards, is_over, info = [seen], [], False, {}
    while not is_over:
        seen, reward, terminated, truncated, info = env.step(np.array(action, dtype=np.float32))
        rows.append(seen)
        rewards.append(reward)
        is_over = terminated or truncated
    return np.array(rows), rewards, info


def test_the_checker_of_gymnasium_passes():
    from gymnasium.utils.env_checker import check_env

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(swath.Env("straight", sets=SETS), skip_render_check=True)


def test_the_return_is_the_share_driven_less_what_is_broken():
    env = swath.Env("straight", sets=SETS)
    rows, rewards, info = episode(env, [0.0])
    env.close()
    driven = info["limits"][0]["value"]
    assert [e["result"] for e in info["limits"][:2]] == ["fail", "pass"]
    assert sum(rewards) == pytest.approx(driven / 3.0 - (driven - 2.0) / 2.0, abs=1e-9)
    assert rows[-1, 5] == pytest.approx(7 / 3.6, rel=0.1)  # odometry sees the speed


@pytest.mark.parametrize("speed", [False, True])
@pytest.mark.parametrize("action", [[np.nan], [np.inf], [0.1, np.nan], [0.1, -np.inf], [], [0.1, 0.2, 0.3]])
def test_an_action_that_is_none_is_refused_and_drives_nothing(action, speed):
    env = swath.Env("straight", sets=SETS, speed=speed)
    env.reset(seed=1)
    with pytest.raises(InputError, match=f"action = .*: expected {1 + speed} finite number"):
        env.step(np.array(action, dtype=np.float32))
    assert env.world.graph.t == 0
    assert env.step(env.action_space.sample() * 0)[4]["t_s"] == 0.1
    env.close()


def test_the_same_seed_and_actions_give_the_same_and_left_is_left():
    env = swath.Env("straight", sets=SETS)
    first, _, _ = episode(env, [0.3])
    again, _, _ = episode(env, [0.3])
    other, _, _ = episode(env, [-0.3])
    env.close()
    assert np.array_equal(first, again)
    assert first[-1, 6] > 0.02 > -0.02 > other[-1, 6]  # yaw rate
    assert first[-1, 1] < 0.0 < other[-1, 1]  # turned left, the edge bears right


def test_speed_is_an_action_too():
    env = swath.Env("straight", sets=SETS, speed=True, speed_kmh=12)
    fast, _, info = episode(env, [0.0, 1.0])
    slow, _, later = episode(env, [0.0, -0.5])
    env.close()
    assert fast[-1, 5] > 2.0 > 1.0 > slow[-1, 5]
    assert info["t_s"] < later["t_s"]


def test_a_machine_that_is_not_there_is_refused():
    with pytest.raises(InputError, match="expected one of combine"):
        swath.Env("straight", machine="cart")


def test_the_example_steers(capsys):
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    said = capsys.readouterr().out
    assert "lateral_rms_m" in said
    assert "fail" not in said
