"""What many runs cost their user: a step of a vector environment, and a run of a function test in step.

CPU milliseconds of this process: a step of 0.1 s a world in `swath.VectorEnv` with few and with many worlds
and in `swath.Env`, all with LiDAR and detector; then a run of a case alone and one of 64 in step.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from _harness import machine, write_json

SETS = {
    "combine.lidar.level": "profile",
    "combine.header.level": "profile",
    "combine.motion": {"level": "kinematic", "start_speed_kmh": 7},
    "combine.edge": "otsu",
    "run": {"distance_m": 400, "max_duration_s": 200},
}
CASE = """
format: swath test case 1
objective: drives
source: estimated
scenario: straight
set: {combine.lidar.level: profile, combine.header.level: profile, combine.motion.level: kinematic,
      combine.edge: otsu, run.distance_m: 20}
vary: {speed_kmh: {key: combine.speed.speed_kmh, at: [5, 8]}}
expect: {distance_m: {min: 20}}
"""


def stepped(env: Any, count: int, steps: int) -> dict[str, float]:
    """Milliseconds a world: to begin, and a step after a second."""
    action = env.action_space.sample() * 0
    begin = time.process_time()
    env.reset(seed=1)
    reset = time.process_time() - begin
    for _ in range(10):
        env.step(action)
    begin = time.process_time()
    for _ in range(steps):
        env.step(action)
    spent = time.process_time() - begin
    env.close()
    return {"reset_ms": 1e3 * reset / count, "step_ms": 1e3 * spent / steps / count}


def tested(count: int) -> dict[str, float]:
    """Milliseconds a run, alone and with `count` in step."""
    from swath.runtime.kept import KeptFields
    from swath.tools.function_test.one_run import results_in
    from swath.tools.function_test.plan import Plan

    with tempfile.TemporaryDirectory() as folder:
        case = Path(folder) / "case.yaml"
        case.write_text(CASE, encoding="utf-8")
        runs, fields = tuple(Plan(str(case), seeds=count // 2).runs()), KeptFields()
        next(results_in([runs[0]], fields))
        begin = time.process_time()
        alone = [next(results_in([run], fields)) for run in runs[:8]]
        middle = time.process_time()
        in_step = {result["id"]: result["digest"] for result in results_in(runs, fields)}
        end = time.process_time()
    assert all(in_step[result["id"]] == result["digest"] for result in alone)
    return {"alone_ms": 1e3 * (middle - begin) / len(alone), "in_step_ms": 1e3 * (end - middle) / count}


def main(out_dir: Path | str = "out/bench", *, worlds: int = 256, steps: int = 20) -> dict[str, Any]:
    """Measure, print, write environments.json."""
    import swath
    from swath.core.process.collector import collected_rarely

    with collected_rarely():
        rows = {"Env": stepped(swath.Env("straight", sets=SETS), 1, steps)}
        for count in (1, 16, worlds):
            env = swath.VectorEnv("straight", num_envs=count, sets=SETS, autoreset_mode="Disabled")
            rows[f"VectorEnv, {count}"] = stepped(env, count, steps)
        runs = tested(64)
    for name, row in rows.items():
        print(f"{name:16} step of 0.1 s {row['step_ms']:6.2f} ms a world, reset {row['reset_ms']:5.0f}")
    print(f"a run of 20 m of a case: alone {runs['alone_ms']:.0f} ms, 64 in step {runs['in_step_ms']:.0f} ms")
    data = {"machine": machine(), "environments": rows, "runs": runs}
    write_json(Path(out_dir), "environments", data)
    return data


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", default="out/bench")
    parser.add_argument("--worlds", type=int, default=256)
    parser.add_argument("--steps", type=int, default=20)
    given = parser.parse_args()
    main(given.out, worlds=given.worlds, steps=given.steps)
