"""What runs come to, byte for byte: rows of hashes, which stay where a change means to leave results alone.

    python -m tests.proof.proof                      # compare all rows, some CPU-minutes
    python -m tests.proof.proof 'case/*' level/edge/otsu   # some of them
    python -m tests.proof.proof --write 'case/rain'  # after a change that means to change values: these alone
    python -m tests.proof.proof --show 'case/rain'   # what a row comes to, to compare with another checkout

`rows.json` holds them; the tests compare the rows of `QUICK`.
"""

import argparse
import fnmatch
import hashlib
import json
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path

import numpy as np

import swath
from swath.api import load_scenario
from swath.core.errors import SwathError
from swath.core.process.collector import collected_rarely
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job, run_unrecorded
from swath.runtime.saves import Saves, saves_in
from swath.scenario.slots import CATALOGUE, SLOTS
from swath.tools.function_test.case import find_cases
from swath.tools.part.isolate import IsolatedPart

FILE = Path(__file__).with_name("rows.json")
# of a summary, not of what it is; `ended` stands in its notes
CLOCK = ("versions", "wall_s", "real_time_factor", "cost", "swath", "files", "inputs", "ended")
SCENARIOS = (
    "bend", "feed-rate", "gnss-lost", "laser-pilot", "look-ahead", "person-at-edge", "record-run",
    "second-pass", "straight", "two-combines", "two-scanners", "unload-on-the-go",
)  # fmt: skip
CART = (
    "unload",
    "heap",
    "peer_link",
    "box",
    "cooperate",
    "crop_flow",
    "dust",
)  # kinds that `straight` cannot use
LONG_S, SHORT_S = 6.0, 2.5
CHEAP = {"combine.lidar.level": "empirical", "combine.lidar.sector_deg": [-45, 45]}
KERNELS = {
    "combine.lidar.level": "profile", "combine.header.level": "profile", "combine.motion.level": "kinematic",
    "combine.edge.level": "otsu",
}  # fmt: skip
PARTS = ("motion", "header", "process", "lidar", "odometry", "imu", "edge", "steer", "speed", "steering")
SAVED_S = (1.0, 2.0, 3.0)
QUICK = (
    "scenario/straight/kernels", "scenario/straight/empirical *", "level/steer/*", "worlds/*",
    "environment/*", "part/*",
)  # fmt: skip


class _Tracks(RunHook):
    """Keeps the tracks of a run."""

    def begin(self, run):
        self.recorder = run.recorder


def plain(value):
    """A value as JSON; arrays and numbers to the bit."""
    if isinstance(value, Mapping):
        return {str(key): plain(own) for key, own in value.items()}
    if isinstance(value, list | tuple):
        return [plain(own) for own in value]
    if isinstance(value, np.ndarray):
        if value.dtype == object:
            return [plain(own) for own in value]
        return [value.dtype.str, list(value.shape), hashlib.sha256(np.ascontiguousarray(value)).hexdigest()]
    return value.item() if isinstance(value, np.generic) else value


def judged(summary):
    """A summary without clocks and versions."""
    return plain({key: value for key, value in summary.items() if key not in CLOCK})


def driven(scenario, sets, seconds=LONG_S, seed=None):
    """Summary and tracks of a run in memory."""
    hook = _Tracks()
    sets = {"run.max_duration_s": seconds, **sets}
    summary = run_unrecorded(load_scenario(scenario, sets=sets, seed=seed), hooks=[hook])
    tracks = {name: own.by_column for name, own in hook.recorder.tracks.items()}
    return {"summary": judged(summary), "tracks": plain(tracks)}


def case(name):
    """A case of the catalogue: its first point at its first seed."""
    (found,) = find_cases(name)
    sets = [text for text in found.sets(found.grid_point(0)) if not text.startswith("run.max_duration_s=")]
    scenario = load_scenario(found.scenario, sets=[*sets, "run.max_duration_s=3.5"], seed=found.seeds[0])
    hook = _Tracks()
    summary = run_unrecorded(scenario, hooks=[hook])
    return {
        "summary": judged(summary),
        "tracks": plain(hook.recorder.tracks[next(iter(scenario.machines))].by_column),
    }


def level(slot, name):
    """A level of a slot in `straight`, with little else that costs."""
    base = {} if slot == "lidar" else dict(CHEAP)
    return driven("straight", {**base, f"combine.{slot}": name}, SHORT_S)


def worlds(sets, n, **more):
    """Worlds in step, which end at different times."""
    vary = {"combine.motion.start_speed_kmh": (5.0, 8.0), "run.max_duration_s": [2.0, 3.1, 2.5]}
    found = swath.worlds("straight", n=n, vary=vary, sets={"run.distance_m": 4.5, **sets}, seed=3, **more)
    return [judged(run.summary) for run in found]


def environment():
    """An episode of an environment."""
    env = swath.Env("straight", sets={**KERNELS, "run.distance_m": 4}, speed=True, scan=True)
    seen, told = env.reset(seed=5)
    steps = [[seen, told]]
    for k in range(30):
        steps.append(list(env.step(np.array([0.1 * np.sin(k), 0.5], np.float32))))
        if steps[-1][2] or steps[-1][3]:
            break
    env.close()
    return plain(steps)


def vector(mode):
    """Steps of an environment of three, over the ends of episodes."""
    env = swath.VectorEnv(
        "straight", num_envs=3, autoreset_mode=mode, sets={**KERNELS, "run.distance_m": 2.5}
    )
    steps = [list(env.reset(seed=[1, 2, 3]))]
    told = (np.full((3, 1), 0.05 * np.sin(k), np.float32) for k in range(25))
    steps += [list(env.step(actions)) for actions in told]
    env.close()
    return plain(steps)


@cache
def _recorded():
    """A recorded run with saves; the folder stays as long as this process."""
    folder = tempfile.TemporaryDirectory(prefix="swath-proof-")
    sets = {
        **CHEAP,
        "combine.imu": "error",
        "run.record": "full",
        "run.max_duration_s": 4,
        "combine.edge.level": "otsu",
    }
    out = Path(folder.name) / "run"
    run_job(load_scenario("straight", sets=sets, seed=4), out, hooks=[Saves(1.0)])
    return folder, out


def part(slot):
    """A slot alone, with the inputs that it had in a recorded run."""
    from swath.record.read.files import open_log

    _, out = _recorded()
    log = open_log(out)
    made = IsolatedPart(load_scenario(out / "scenario.yaml"), f"combine.{slot}")
    given = made.run(made.recorded(log), end=log.end())
    made.world.close()
    digest = hashlib.sha256()
    from swath.record.digest import sample_bytes

    for arrival in given:
        digest.update(sample_bytes(*arrival.output, arrival.t, arrival.sample))
    return [len(given), digest.hexdigest()]


def saved():
    """The run that the branches go on from: its summary, its saves."""
    _, out = _recorded()
    summary = json.loads((out / "summary.json").read_text())
    return {"summary": judged(summary), "saves": len(saves_in(out))}


def branched(at_s):
    """What goes on from a moment of a run, after a change."""
    folder, out = _recorded()
    target = Path(folder.name) / f"branch {at_s}"
    made = swath.branch(out, at_s, target, sets={"combine.speed.speed_kmh": "5"}, report=False)
    summary = judged(made.summary)
    return {key: value for key, value in summary.items() if key != "branch"}


Row = Callable[[], object]


def all_rows() -> dict[str, Row]:
    """Every row and how it is made."""
    rows: dict[str, Row] = {}
    for name in SCENARIOS:
        rows[f"scenario/{name}/as it is"] = partial(driven, name, {}, SHORT_S if "two" in name else LONG_S)
    for lidar in ("profile", "empirical"):
        for edge in ("otsu", "likelihood_ratio", "truth"):
            sets = {"combine.lidar.level": lidar, "combine.edge.level": edge}
            rows[f"scenario/straight/{lidar} {edge}"] = partial(driven, "straight", sets)
    rows["scenario/straight/kernels"] = partial(driven, "straight", KERNELS)
    for one in find_cases("catalogue"):
        rows[f"case/{one.name}"] = partial(case, one.name)
    for slot in SLOTS:
        if slot.name not in CART and slot.name != "camera":  # a picture a tenth of a second costs 5 s
            for name in CATALOGUE.registry.names(slot.name):
                rows[f"level/{slot.name}/{name}"] = partial(level, slot.name, name)
    rows["worlds/kernels"] = partial(worlds, KERNELS, 6)
    rows["worlds/as shipped"] = partial(worlds, CHEAP, 3)
    rows["worlds/otsu, one by one"] = partial(worlds, {**CHEAP, "combine.edge.level": "otsu"}, 2, together=1)
    rows["environment/one"] = environment
    for mode in ("NextStep", "SameStep"):
        rows[f"environment/{mode}"] = partial(vector, mode)
    for slot in PARTS:
        rows[f"part/{slot}"] = partial(part, slot)
    rows["branch/the run"] = saved
    for at_s in SAVED_S:
        rows[f"branch/{at_s:g} s"] = partial(branched, at_s)
        rows[f"branch/{at_s + 0.35:g} s"] = partial(branched, at_s + 0.35)
    return rows


def text_of(row: Row) -> str:
    """What a row comes to, or the kind of its error."""
    try:
        with collected_rarely(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            made = row()
    except SwathError as error:
        made = f"{type(error).__name__}: {getattr(error, 'key', '')}"
    return json.dumps(made, sort_keys=True, indent=1)


def value_of(row: Row) -> str:
    """Its hash."""
    return hashlib.sha256(text_of(row).encode()).hexdigest()[:16]


def stored() -> dict[str, str]:
    """The rows as they were written last."""
    return json.loads(FILE.read_text()) if FILE.exists() else {}


def chosen(patterns) -> dict[str, Row]:
    """Rows by name."""
    return {name: row for name, row in all_rows().items() if any(fnmatch.fnmatch(name, p) for p in patterns)}


def main() -> int:
    """Compare, write or show rows."""
    os.environ.setdefault("SWATH_THREADS", "1")
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("rows", nargs="*", default=["*"], metavar="ROW", help="names, with * for any text")
    parser.add_argument("--write", action="store_true", help="store these rows")
    parser.add_argument("--show", action="store_true", help="print what they come to")
    args = parser.parse_args()
    known, differ = stored(), 0
    for name, row in chosen(args.rows).items():
        started = time.process_time()
        if args.show:
            print(name, text_of(row))
            continue
        value = value_of(row)
        differs = name in known and value != known[name]
        differ += differs
        spent = time.process_time() - started
        said = "differs" if differs else "same" if name in known else "no row"
        print(f"{said:7} {spent:6.1f} s  {name}", flush=True)
        if args.write:
            known = {**stored(), name: value}
            FILE.write_text(json.dumps(dict(sorted(known.items())), indent=0) + "\n")
    if args.write:
        every = all_rows()
        kept = {name: value for name, value in sorted(stored().items()) if name in every}
        FILE.write_text(json.dumps(kept, indent=0) + "\n")
    return int(differ > 0 and not args.write)


if __name__ == "__main__":
    sys.exit(main())
