"""What runs come to, to the bit: rows of numbers, which stay where a change means to leave results alone.

    python -m tests.proof.proof                     # compare the stored rows; says what was and what is
    python -m tests.proof.proof 'level/header/*'    # some of them
    python -m tests.proof.proof --write 'part/*'    # after a change that means to change values: these alone
    python -m tests.proof.proof --write case/rain   # a row that was not stored, by its whole name
    python -m tests.proof.proof --show case/rain    # what any row comes to, to compare with another checkout

A row is a summary without clocks and digest, and the numbers by moment of tracks or of what a part sends, of
the first `FIRST_S` and the last `LAST_S`: the whole would take 10 kB a simulated second, and what goes wrong
in between shows at the end and in the summary. `rows/` holds a file of each that is stored: its JSON, packed
by xz; numbers are written with as many digits as tell them from their neighbours. `--show` prints the whole.
"""

import argparse
import fnmatch
import json
import lzma
import os
import re
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

import swath
from swath.api import load_scenario
from swath.core.errors import SwathError
from swath.core.process.collector import collected_rarely
from swath.core.schedule import NS
from swath.runtime.hooks import RunHook
from swath.runtime.job import run_job, run_unrecorded
from swath.runtime.saves import Saves, saves_in
from swath.scenario.slots import CATALOGUE, SLOTS
from swath.tools.function_test.case import find_cases
from swath.tools.part.isolate import IsolatedPart

FOLDER = Path(__file__).with_name("rows")
# of a summary, not of what it is; `ended` stands in its notes, what the digest is made of in the tracks
CLOCK = ("versions", "wall_s", "real_time_factor", "cost", "swath", "files", "inputs", "ended", "digest")
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
LONG_S, SHORT_S, TURNED_S = 6.0, 2.5, 8.0
FIRST_S, LAST_S = 0.1, 0.5  # of a run, from its begin and to its end, of which every moment is kept
TIME, GONE = "t_s", "(nothing)"
SAID = 20  # differences of a row that are printed
MOVING = {"combine.motion.start_speed_kmh": 7}
CHEAP = {"combine.lidar.level": "empirical", "combine.lidar.sector_deg": [-45, 45]}
KERNELS = {
    "combine.lidar.level": "profile", "combine.header.level": "profile", "combine.motion.level": "kinematic",
    "combine.edge.level": "otsu",
}  # fmt: skip
PARTS = ("motion", "header", "process", "lidar", "odometry", "imu", "edge", "steer", "speed", "steering")
SAVED_S = (1.0, 2.0, 3.0)


class _Tracks(RunHook):
    """Keeps the tracks of a run."""

    def begin(self, run):
        self.recorder = run.recorder


def plain(value):
    """A value as JSON, from which it can be told to the bit; a signal by its fields."""
    if isinstance(value, Mapping):
        return {str(key): plain(own) for key, own in value.items()}
    if is_dataclass(value):
        return {each.name: plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, list | tuple):
        return [plain(own) for own in value]
    if isinstance(value, np.ndarray):
        return {value.dtype.str: plain([*value])}
    if isinstance(value, np.float32):
        return float(str(value))
    return value.item() if isinstance(value, np.generic) else value


def kept(found):
    """Of columns by their names, one of them the time, the moments that are stored."""
    if isinstance(found, list):
        return [kept(own) for own in found]
    if not isinstance(found, dict):
        return found
    if not isinstance(times := found.get(TIME), list):
        return {key: kept(own) for key, own in found.items()}
    places = [k for k, t in enumerate(times) if t <= FIRST_S or t > times[-1] - LAST_S]
    return {name: [own[k] for k in places] for name, own in found.items()}


def judged(summary):
    """A summary without clocks and versions."""
    return plain({key: value for key, value in summary.items() if key not in CLOCK})


def driven(scenario, sets, seconds=LONG_S, seed=None):
    """Summary and tracks of a run in memory."""
    return _driven(load_scenario(scenario, sets={"run.max_duration_s": seconds, **sets}, seed=seed))


def _driven(scenario):
    hook = _Tracks()
    summary = run_unrecorded(scenario, hooks=[hook])
    tracks = {
        name: {column: plain([*values]) for column, values in own.items()}
        for name, own in hook.recorder.tracks.items()
    }
    return {"summary": judged(summary), "tracks": tracks}


def case(name):
    """A case of the catalogue: its first point at its first seed."""
    (found,) = find_cases(name)
    sets = [text for text in found.sets(found.grid_point(0)) if not text.startswith("run.max_duration_s=")]
    sets.append("run.max_duration_s=3.5")
    return _driven(load_scenario(found.scenario, sets=sets, seed=found.seeds[0]))


def level(slot, name):
    """A level of a slot in `straight`, at speed; beside cheap parts, or beside those that it goes with."""
    with suppress(SwathError):
        base = {} if slot == "lidar" else CHEAP
        return driven("straight", {**MOVING, **base, f"combine.{slot}": name}, SHORT_S)
    return driven("straight", {**MOVING, **KERNELS, f"combine.{slot}": name}, SHORT_S)


def worlds(sets, n, **more):
    """Worlds in step, which end at different times."""
    vary = {"combine.motion.start_speed_kmh": (5.0, 8.0), "run.max_duration_s": [2.0, 3.1, 2.5]}
    found = swath.worlds("straight", n=n, vary=vary, sets={"run.distance_m": 4.5, **sets}, seed=3, **more)
    return [judged(run.summary) for run in found]


def environment():
    """An episode of an environment."""
    env = swath.Env("straight", sets={**KERNELS, **MOVING, "run.distance_m": 2}, speed=True, scan=True)
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
        "straight", num_envs=3, autoreset_mode=mode, sets={**KERNELS, **MOVING, "run.distance_m": 2}
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
        **MOVING,
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
    sent = {}
    for arrival in given:
        columns = sent.setdefault(arrival.output[1], {TIME: []})
        columns[TIME].append(arrival.t / NS)
        for each in fields(arrival.sample):
            columns.setdefault(each.name, []).append(plain(getattr(arrival.sample, each.name)))
    return sent


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
    turning = {**MOVING, "combine.lidar.level": "empirical", "field.edge.run_in_m": 1}
    rows["scenario/bend/in the bend"] = partial(driven, "bend", turning, TURNED_S)
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


def made(row: Row) -> Any:
    """What a row comes to, as JSON has it, or the kind of its error."""
    try:
        with collected_rarely(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = row()
    except SwathError as error:
        found = f"{type(error).__name__}: {getattr(error, 'key', '')}"
    return json.loads(json.dumps(found))


def file_of(name: str) -> Path:
    """Where a row is stored."""
    return FOLDER / (re.sub(r"\W+", "-", name) + ".json.xz")


def stored(name: str) -> Any:
    """A row as it was written last, None where it is not stored."""
    file = file_of(name)
    return json.loads(lzma.decompress(file.read_bytes())) if file.exists() else None


def store(name: str, found: Any) -> None:
    """Write a row."""
    FOLDER.mkdir(exist_ok=True)
    text = json.dumps(found, sort_keys=True, separators=(",", ":"))
    file_of(name).write_bytes(lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME))


def differences(was: Any, found: Any, where: str = "", times: Sequence[float] = ()) -> Iterator[str]:
    """What differs to the bit: a line for each value, for each column the first moment.

    times: of the moments, where `was` is a column
    """
    if isinstance(was, dict) and isinstance(found, dict):
        own = times if isinstance(times := was.get(TIME), list) else ()
        for key in sorted({*was, *found}):
            yield from differences(was.get(key, GONE), found.get(key, GONE), f"{where}/{key}".strip("/"), own)
    elif isinstance(was, list) and isinstance(found, list) and len(was) == len(found):
        names = (
            [f" at {t:g} s" for t in times] if len(times) == len(was) else [f"[{k}]" for k in range(len(was))]
        )
        each = [[*differences(*pair, where + name)] for name, *pair in zip(names, was, found, strict=True)]
        first, *more = [*filter(None, each)] or [[]]
        yield from first
        if more:
            yield f"{where}: and {len(more)} more of {len(was)}"
    elif isinstance(was, list) and isinstance(found, list):
        yield f"{where}: had {len(was)} values, has {len(found)}"
    elif json.dumps(was) != json.dumps(found):
        yield f"{where}: was {was}, is {found}"


def chosen(patterns: Sequence[str]) -> dict[str, Row]:
    """Rows by name."""
    return {name: row for name, row in all_rows().items() if any(fnmatch.fnmatch(name, p) for p in patterns)}


def stored_rows(patterns: Sequence[str] = ("*",)) -> dict[str, Row]:
    """Those of them that are stored."""
    return {name: row for name, row in chosen(patterns).items() if file_of(name).exists()}


def main() -> int:
    """Compare, write or show rows."""
    os.environ.setdefault("SWATH_THREADS", "1")
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("rows", nargs="*", default=["*"], metavar="ROW", help="names, with * for any text")
    parser.add_argument("--write", action="store_true", help="store these rows")
    parser.add_argument("--show", action="store_true", help="print what they come to")
    args = parser.parse_args()
    if args.show:
        for name, row in chosen(args.rows).items():
            print(name, json.dumps(made(row), sort_keys=True, indent=1))
        return 0
    rows, differ = stored_rows(args.rows), 0
    if args.write:
        rows |= {name: row for name, row in all_rows().items() if name in args.rows}
    for name, row in rows.items():
        started, was, found = time.process_time(), stored(name), kept(made(row))
        said = [*differences(was, found)]
        differ += bool(said)
        print(f"{'differs' if said else 'same':7} {time.process_time() - started:6.1f} s  {name}", flush=True)
        for line in said[:SAID] if was else ():
            print(f"    {line}")
        if len(said) > SAID and was:
            print(f"    and {len(said) - SAID} more")
        if args.write:
            store(name, found)
    if args.write:
        for file in {*FOLDER.iterdir()} - {file_of(name) for name in all_rows()}:
            file.unlink()
    return int(differ > 0 and not args.write)


if __name__ == "__main__":
    sys.exit(main())
