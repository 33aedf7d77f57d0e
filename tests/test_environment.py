"""A scenario as an environment of gymnasium."""

import importlib
import runpy
import subprocess
import sys
import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import swath
from swath.core.errors import InputError
from swath.scenario.scenario import scenario_names

pytest.importorskip("gymnasium")
KEPT = importlib.import_module("swath.environment").KEPT
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
    import gymnasium
    from gymnasium.utils.env_checker import check_env

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make("swath/straight", sets=SETS, render_mode="rgb_array").unwrapped)


@pytest.mark.parametrize("order", ["import swath, gymnasium", "import gymnasium, swath"])
def test_ids_are_known_whichever_is_imported_first(order):
    """And nothing of ours goes on watching imports."""
    ask = "print(*[name for name in gymnasium.registry if name.startswith('swath/')])"
    ask += "; import sys; assert not [f for f in sys.meta_path if 'swath' in type(f).__module__]"
    run = subprocess.run(
        [sys.executable, "-c", f"{order}; {ask}"], capture_output=True, text=True, check=True
    )
    assert run.stdout.split() == [f"swath/{name}" for name in scenario_names()]


def test_gymnasium_makes_one_and_several_by_id():
    import gymnasium

    env = gymnasium.make("swath/straight", sets=SETS, render_mode="rgb_array", machine="combine")
    env.reset(seed=3)
    env.step(np.zeros(1, np.float32))
    assert env.render().shape == (300, 300, 3)
    env.close()


def in_vector(mode, sets, actions, **kwargs):
    """Observations and rewards of two environments, (step_count, 2, ...); and the vector environment."""
    import gymnasium

    many = gymnasium.make_vec(
        "swath/straight", num_envs=2, vectorization_mode=mode, sets=sets, vector_kwargs=kwargs
    )
    seen, rewards = [many.reset(seed=3)[0]], []
    for action in actions:
        now, reward, *_ = many.step(np.array(action, np.float32).reshape(2, 1))
        seen.append(now)
        rewards.append(reward)
    return np.array(seen), np.array(rewards), many


@pytest.mark.filterwarnings("ignore:.*ERROR. (Received|Traceback|Raising):UserWarning")
def test_several_in_processes_of_their_own_give_the_same_as_one_after_another():
    """Seeds 3 and 4, beyond the end of their episodes; and an error of one is the user's."""
    sets = {**SETS, "run.distance_m": 1}
    actions = [[0.3, -0.3]] * 9
    seen, rewards, sync = in_vector("sync", sets, actions)
    sync.close()
    alone = swath.Env("straight", sets=sets)
    assert np.array_equal(alone.reset(seed=4)[0], seen[0, 1])
    assert np.array_equal(alone.step([-0.3])[0], seen[1, 1])
    alone.close()
    assert (rewards == 0.0).any(), "an episode ended, the next began"
    apart, paid, many = in_vector("async", sets, actions, context="spawn")
    assert np.array_equal(seen, apart)
    assert np.array_equal(rewards, paid)
    with pytest.raises(InputError, match=r"action = .*: expected 1 finite number"):
        many.step(np.array([[0.0], [np.nan]], np.float32))
    many.close()


IN_STEP = {
    "run.distance_m": 1,
    "combine.lidar": {"level": "profile", "sector_deg": [-30, 30]},
    "combine.header.level": "profile",
    "combine.edge": "otsu",
    "combine.motion": {"level": "kinematic", "start_speed_kmh": 7},
    "expect": {"distance_m": {"max": 0.6}, "lateral_error_m": {"max": 0.01, "hold": "always"}},
}


def same(one, other):
    """Whether two nested results of an environment are the same bits."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    one, other = np.asarray(one), np.asarray(other)
    if one.dtype == object:
        return one.shape == other.shape and all(
            _alike(a, b) for a, b in zip(one.ravel(), other.ravel(), strict=True)
        )
    return one.dtype == other.dtype and np.array_equal(one, other)


def _alike(one, other):
    return same(one, other) if isinstance(one, dict | np.ndarray) else one == other


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({}, {"autoreset_mode": "SameStep", "scan": True, "limits_s": 0.2}),
        ({}, {"autoreset_mode": "NextStep", "seeds": [5, 9], "speed": True}),
        (
            {
                "run.max_duration_s": 0.45,
                "expect": {"edge_rmse_m": {"max": 1e-9}, "grain_cut_kg": {"max": 1e-9}},
            },
            {"autoreset_mode": "NextStep", "limits_s": 0.1},
        ),
        ({"combine.lidar": "off", "combine.edge": "truth"}, {"autoreset_mode": "NextStep"}),
        ({"combine.lidar.fault.loss_percent": 40.0}, {"autoreset_mode": "NextStep"}),
        (
            {
                "combine.process.level": "organs",
                "combine.crop_flow": "counted",
                "combine.settings": {"level": "fixed", "rate_hz": 10},
            },
            {"autoreset_mode": "NextStep", "settings": ["fan_rpm", "concave_mm"], "period_s": 0.2},
        ),
        (
            {
                "combine.lidar": "off",
                "combine.edge": "truth",
                "combine.header.level": "fixed_height",
                "combine.camera": {"level": "rays", "rate_hz": 10, "width_px": 32, "height_px": 24},
                "field.stand.level": "uniform",
                "run.distance_m": 0.4,
                "expect": {"distance_m": {"max": 0.3}},
            },
            {"autoreset_mode": "SameStep", "picture": True, "num_envs": 2},
        ),
    ],
    ids=[
        "same step, scans",
        "seeds, speed",
        "truncated",
        "part by part",
        "lost",
        "settings",
        "pictures",
    ],
)
def test_worlds_in_step_give_the_bits_of_environments_of_their_own(more, words):
    """Two or three environments, each beyond the end of its first episode."""
    import gymnasium

    mode, task = words["autoreset_mode"], {k: v for k, v in words.items() if k != "autoreset_mode"}
    task = {"num_envs": 3, **task, "sets": {**IN_STEP, **more}}
    many = gymnasium.make_vec("swath/straight", autoreset_mode=mode, **task)
    assert isinstance(many.unwrapped, swath.VectorEnv)
    by_mode = {"vectorization_mode": "sync", "vector_kwargs": {"autoreset_mode": mode}}
    sync = gymnasium.make_vec("swath/straight", **by_mode, **task)
    assert many.observation_space == sync.observation_space
    assert many.action_space == sync.action_space
    for one, other in zip(many.reset(seed=3), sync.reset(seed=3), strict=True):
        assert same(one, other)
    random, ends = np.random.default_rng(4), 0
    for _ in range(6 if "picture" in words else 12):
        actions = random.uniform(-0.5, 0.5, many.action_space.shape).astype(np.float32)
        if "speed" in words:
            actions[:, 1] = [0.9, 0.5, 0.9]
        found, wanted = many.step(actions), sync.step(actions)
        for one, other in zip(found, wanted, strict=True):
            assert same(one, other)
        ends += found[2] | found[3]
    assert (ends >= 1).all()
    many.close()
    sync.close()


def test_pictures_from_above_are_those_of_environments_of_their_own():
    many = swath.VectorEnv("straight", num_envs=2, sets=IN_STEP, render_mode="rgb_array")
    with pytest.raises(InputError, match="expected after reset"):
        many.render()
    many.reset(seed=3)
    many.step(np.zeros((2, 1), np.float32))
    alone = swath.Env("straight", sets=IN_STEP, render_mode="rgb_array")
    alone.reset(seed=4)
    alone.step(np.zeros(1, np.float32))
    assert np.array_equal(many.render()[1], alone.render())
    many.close()
    alone.close()


def test_few_worlds_of_earlier_episodes_are_kept():
    """However many seeds there are; the same seed gives the same episode."""
    env = swath.Env("straight", sets={**IN_STEP, "run.max_duration_s": 0.1}, seeds=range(100))
    first, _, info = episode(env, [0.2], seed=1)
    worlds = [env.world]
    for seed in [*range(2, 2 + KEPT), *range(4, 7), 1]:
        found, _, _ = episode(env, [0.2], seed=seed)
        worlds += [env.world] * (not any(env.world is other for other in worlds))
    assert info["t_s"] == 0.1
    assert np.array_equal(found, first)
    assert len(worlds) == KEPT + 2
    env.close()


def test_without_autoreset_all_wait_until_they_are_reset():
    sets = {**IN_STEP, "run.distance_m": 3}
    many = swath.VectorEnv("straight", num_envs=3, sets=sets, autoreset_mode="Disabled", speed=True)
    first, _ = many.reset(seed=1)
    fast = np.array([[0.0, 0.9], [0.0, 0.9], [0.0, -1.0]])
    while not many.step(fast)[2].any():
        pass
    seen, rewards, terminated, *_ = many.step(fast)
    assert terminated.tolist() == [True, True, False]
    assert (rewards != 0.0).tolist() == [False, False, True]
    again, infos = many.reset(seed=1, options={"reset_mask": np.array([True, False, False])})
    assert np.array_equal(again[0], first[0])
    assert np.array_equal(again[1:], seen[1:])
    assert infos["_seed"].tolist() == [True, False, False]
    seen, rewards, terminated, *_ = many.step(fast)
    assert terminated.tolist() == [False, True, False]
    many.close()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"num_envs": 0}, "num_envs = 0: expected >= 1"),
        ({"picture": True}, "picture = True: expected a machine with a camera"),
        ({"render_mode": "human"}, "render_mode = human: expected rgb_array"),
        ({"seeds": []}, "seeds = .*expected at least one"),
        ({"limits_s": 0.0}, "limits_s = 0.0: expected > 0"),
    ],
)
def test_what_a_vector_environment_cannot_do_is_refused(words, said):
    with pytest.raises(InputError, match=said):
        swath.VectorEnv("straight", **words)


def test_actions_of_many_that_are_none_are_refused():
    many = swath.VectorEnv("straight", num_envs=2, sets=IN_STEP)
    with pytest.raises(InputError, match="expected after reset"):
        many.step(np.zeros((2, 1)))
    many.reset(seed=1)
    for actions in (np.zeros((3, 1)), [[0.0], [np.nan]]):
        with pytest.raises(InputError, match="expected 1 finite number for each of 2 environments"):
            many.step(actions)
    with pytest.raises(InputError, match="reset_mask"):
        many.reset(options={"reset_mask": np.zeros(2, bool)})
    many.close()


def test_without_the_extra_the_error_says_what_to_install():
    hidden = "import sys; sys.modules['gymnasium'] = None; import swath; swath.Env('straight')"
    run = subprocess.run([sys.executable, "-c", hidden], capture_output=True, text=True)
    assert run.returncode == 1
    assert "swath.Env needs an optional part: pip install 'swath[gym]'" in run.stderr


def test_the_picture_from_above_shows_crop_stubble_and_the_machine_where_they_are():
    env = swath.Env("straight", sets={**SETS, "run.distance_m": 20}, render_mode="rgb_array")
    env.reset(seed=3)
    before = env.render()
    for _ in range(40):
        env.step(np.zeros(1, np.float32))
    world, picture = env.world, env.render()
    x0, y0, _ = world.bodies.pose_of("combine").position
    assert picture[150, 150].tolist() == [0x00, 0x72, 0xB2]
    rows, columns = np.meshgrid(np.arange(5, 300, 10), np.arange(5, 300, 10), indexing="ij")
    stands = world.field.standing(x0 + 0.1 * (columns + 0.5 - 150), y0 - 0.1 * (rows + 0.5 - 150))
    shown = picture[rows, columns]
    is_body = (shown == [0x00, 0x72, 0xB2]).all(axis=-1)
    assert ((shown == [0xE9, 0xC4, 0x6A]).all(axis=-1) == stands)[~is_body].all()
    assert 100 < stands.sum() < 800
    assert (before != picture).any()
    env.close()


def test_a_picture_is_an_observation():
    from gymnasium.utils.env_checker import check_env

    camera = {"combine.camera": {"level": "rays", "rate_hz": 10, "width_px": 32, "height_px": 24}}
    env = swath.Env("straight", sets=SETS | camera, picture=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
    env.reset(seed=1)
    for _ in range(3):
        seen, *_ = env.step(np.zeros(1, np.float32))
    image = env.world.graph.latest("combine.camera", "image")
    assert seen["picture"].shape == (24, 32, 3)
    assert seen["picture"].std() > 10
    assert np.array_equal(seen["picture"], image.colour)
    env.close()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"picture": True}, "picture = True: expected a machine with a camera"),
        ({"render_mode": "human"}, "render_mode = human: expected rgb_array"),
        ({"picture": True, "sets": {"combine.camera": {"level": "rays", "channels": ["depth"]}}}, "colour"),
    ],
)
def test_what_cannot_be_shown_is_refused(words, said):
    with pytest.raises(InputError, match=said):
        swath.Env("straight", **words)


def test_the_return_is_the_share_driven_less_what_is_broken():
    env = swath.Env("straight", sets=SETS)
    rows, rewards, info = episode(env, [0.0])
    env.close()
    driven = info["limits"][0]["value"]
    assert [e["result"] for e in info["limits"][:2]] == ["fail", "pass"]
    assert sum(rewards) == pytest.approx(driven / 3.0 - (driven - 2.0) / 2.0, abs=1e-9)
    assert rows[-1, 5] == pytest.approx(7 / 3.6, rel=0.1)  # odometry sees the speed


@pytest.mark.parametrize("speed", [False, True])
@pytest.mark.parametrize(
    "action", ["left", {"a": 1}, [np.nan], [np.inf], [0.1, np.nan], [0.1, -np.inf], [], [0.1, 0.2, 0.3]]
)
def test_an_action_that_is_none_is_refused_and_drives_nothing(action, speed):
    env = swath.Env("straight", sets=SETS, speed=speed)
    env.reset(seed=1)
    with pytest.raises(InputError, match=f"action = .*: expected {1 + speed} finite number"):
        env.step(action)
    assert env.world.graph.t == 0
    assert env.step(env.action_space.sample() * 0)[4]["t_s"] == 0.1
    env.close()


MADE_BY = {
    "Env": swath.Env,
    "VectorEnv": swath.VectorEnv,
    "make": lambda name, **words: importlib.import_module("gymnasium").make(f"swath/{name}", **words),
    "make_vec": lambda name, **words: importlib.import_module("gymnasium").make_vec(f"swath/{name}", **words),
}
UNKNOWN = {
    "perod_s": "did you mean 'period_s'",
    "period_ms": "expected in s",
    "reward": "one of sets, machine",
}


@pytest.mark.parametrize("word", UNKNOWN)
@pytest.mark.parametrize("make", MADE_BY)
def test_a_keyword_that_is_not_known_is_named_with_the_nearest(make, word):
    with pytest.raises(InputError, match=f"{word} = 1: unknown keyword.*{UNKNOWN[word]}"):
        MADE_BY[make]("straight", **{word: 1})


def test_an_autoreset_mode_that_is_none_is_named():
    with pytest.raises(InputError, match="autoreset_mode = Never: expected one of NextStep"):
        swath.VectorEnv("straight", autoreset_mode="Never")


def test_an_action_outside_its_space_is_cut_and_told_once():
    within, beyond = (swath.Env("straight", sets=SETS) for _ in range(2))
    for env in (within, beyond):
        env.reset(seed=1)
    seen = within.step(np.ones(1, np.float32))[0]
    with pytest.warns(UserWarning, match=r"an action lies 6 outside its space, -1 to 1.*ClipAction"):
        assert np.array_equal(beyond.step(np.array([7.0]))[0], seen)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        beyond.step(np.array([7.0]))
        within.step(np.array([1.0 + 1e-7]))
    many = swath.VectorEnv("straight", num_envs=2, sets=IN_STEP)
    many.reset(seed=1)
    with pytest.warns(UserWarning, match="an action lies 2 outside its space"):
        many.step(np.array([[0.0], [-3.0]]))
    for env in (within, beyond, many):
        env.close()


def test_the_same_seed_and_actions_give_the_same_and_left_is_left():
    env = swath.Env("straight", sets=SETS)
    first, rewards, _ = episode(env, [0.3])
    again, paid, _ = episode(env, [0.3])
    other, _, _ = episode(env, [-0.3])
    env.close()
    assert np.array_equal(first, again)
    assert rewards == paid
    assert first[-1, 6] > 0.02 > -0.02 > other[-1, 6]  # yaw rate
    assert first[-1, 1] < 0.0 < other[-1, 1]  # turned left, the edge bears right


def test_speed_is_an_action_too():
    env = swath.Env("straight", sets=SETS, speed=True, speed_kmh=12)
    fast, _, info = episode(env, [0.0, 1.0])
    slow, _, later = episode(env, [0.0, -0.5])
    env.close()
    assert fast[-1, 5] > 2.0 > 1.0 > slow[-1, 5]
    assert info["t_s"] < later["t_s"]


THRESHES = {
    "run.distance_m": 40,
    "combine.lidar": "off",
    "combine.edge.level": "truth",
    "combine.motion.start_speed_kmh": 7,
    "combine.process.level": "organs",
    "combine.settings": {"level": "fixed", "rate_hz": 10},
    "combine.crop_flow": {"level": "counted", "loss_hits_per_kg": 0, "camera_noise_percent": 0},
}
BROKEN = 13
CLIMBS = {**THRESHES, "combine.settings": {"level": "climb"}}


def threshed(action):
    """What is observed at the end of a run in which the policy sets drum and concave, and the power."""
    env = swath.Env("straight", sets=THRESHES, steer=False, settings=["drum_rpm", "concave_mm"], period_s=0.5)
    rows, _, _ = episode(env, action)
    power = env.world.graph.latest("combine.process", "organs").threshing_power
    env.close()
    assert env.action_space.shape == (2,)
    assert rows.shape[1] == 15
    return rows[-1], power


def test_settings_are_an_action():
    """A fifth more drum with a closer concave breaks more than the machine's own, and takes more power."""
    (own, power), (hard, more), (soft, less) = map(threshed, ([0.0, 0.0], [0.5, -0.5], [-0.5, 0.5]))
    assert own[8] > 5.0
    assert hard[BROKEN] > 1.5 * own[BROKEN] > 0.0
    assert soft[BROKEN] < own[BROKEN]
    assert less < power < more
    assert more == pytest.approx(power * 1.2 * 0.8**-0.2, rel=0.1)


def test_settings_that_are_no_action_stay_as_the_scenario_has_them():
    said = {"level": "fixed", "rate_hz": 10, "concave_mm": 8, "drum_rpm": 600}
    env = swath.Env(
        "straight", sets={**THRESHES, "combine.settings": said}, settings=["fan_rpm", "drum_rpm"], steer=False
    )
    env.reset(seed=1)
    env.step([0.0, 0.5])
    now = env.world.graph.latest("combine.settings", "settings")
    assert now.concave == pytest.approx(0.008)
    assert now.drum == pytest.approx(1.2 * 600.0 * np.pi / 30.0)
    assert np.isnan(now.upper)
    assert now.fan > 0.0
    env.close()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"settings": ["drum"]}, "settings = drum: expected some of drum_rpm"),
        ({"settings": ["drum_rpm"], "sets": SETS}, "expected organs, by sets=.*combine.settings"),
        ({"settings": ["drum_rpm"], "settings_percent": 100}, "settings_percent = 100: expected > 0"),
        ({"settings": ["drum_rpm"], "settings_percent": "ten"}, "settings_percent = ten: expected a number"),
        ({"settings": "drum_rpm"}, "settings = drum_rpm: expected a list"),
        ({"settings": ["drum_rpm", "drum_rpm"]}, "each once"),
        ({"settings": ["drum_rpm"], "sets": CLIMBS}, "combine.settings.level = climb: expected fixed"),
        ({"steer": False}, "steer = False: expected an action"),
    ],
)
def test_settings_that_nobody_could_set_are_refused(words, said):
    with pytest.raises(InputError, match=said):
        swath.Env("straight", **{"sets": THRESHES, **words})


def test_a_machine_that_is_not_there_is_refused():
    with pytest.raises(InputError, match="expected one of combine"):
        swath.Env("straight", machine="cart")


def test_the_example_steers(capsys):
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    said = capsys.readouterr().out
    assert "lateral_rms_m" in said
    assert "fail" not in said


def test_the_example_of_ppo_hands_worlds_on_as_its_learner_has_them(monkeypatch):
    """stable-baselines3 itself is not there: its base class of environments is enough for that."""
    ppo = stand_ins(monkeypatch)
    monkeypatch.setitem(ppo["SETS"], "run", {"distance_m": 100, "max_duration_s": 0.3})
    envs, alone = ppo["InStep"](2, seed=1), swath.Env("straight", sets=ppo["SETS"])
    first = envs.reset()
    assert np.array_equal(first[1], np.float32(alone.reset(seed=2)[0] * ppo["SCALE"]))
    for step in range(3):
        envs.step_async(np.array([[0.5], [-2.0]]))
        seen, worth, over, infos = envs.step_wait()
        last, *_ = alone.step([-ppo["TURN"]])
        assert over.tolist() == [step == 2] * 2
        assert (worth <= 1.0).all()
    assert np.array_equal(infos[1]["terminal_observation"], np.float32(last * ppo["SCALE"]))
    assert bool(infos[1]["TimeLimit.truncated"])
    assert not np.array_equal(seen[1], infos[1]["terminal_observation"])
    envs.close()
    alone.close()


def stand_ins(monkeypatch):
    """The names of the example, with empty modules of its learner where that is not installed."""

    class VecEnv:
        def __init__(self, count, seen, action):
            self.num_envs, self.observation_space, self.action_space = count, seen, action

        def step(self, actions):
            self.step_async(actions)
            return self.step_wait()

    base = "stable_baselines3"
    for name, offered in (
        ("torch", {}),
        (base, {"PPO": object}),
        (f"{base}.common", {}),
        (f"{base}.common.callbacks", {"BaseCallback": object}),
        (f"{base}.common.vec_env", {"VecEnv": VecEnv}),
    ):
        module = ModuleType(name)
        vars(module).update(offered)
        monkeypatch.setitem(sys.modules, name, module)
    return runpy.run_path(str(EXAMPLE.parent / "ppo" / "steer.py"))
