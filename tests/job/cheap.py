"""Jobs of the level with sensors at a low cost: the edge known, kinematic machines, slow slots."""

import pickle
from dataclasses import replace
from pathlib import Path

from swath.core.schedule import NS
from swath.job.machines import fleet_of
from swath.job.work import plan_of
from swath.judge.catalogue import EvaluatorCatalogue
from swath.record.digest import Digest
from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from swath.scenario.scenario import parse_scenario
from swath.signals import HeapState
from swath.tools.fleet.whole import scenario_text
from swath.tools.fleet.work_plan import work_plan


def cheap_sets(combines, carts, broken_off=15):
    """Changes of the scenario of a job with these machines. broken_off: of loads, m before a pass ends"""
    made = [f"{m}.motion=kinematic" for m in (*combines, *carts)]
    for m in (*combines, *carts):
        made += [f"{m}.gnss.level=ideal", f"{m}.gnss.rate_hz=5"]
        made += [f"{m}.{s}.rate_hz=10" for s in ("motion", "steering", "pose", "odometry", "steer", "speed")]
    for m in combines:
        made += [f"{m}.{key}" for key in (
            "lidar=off", "scan_filter=off", "edge={level: truth, wires: {}}", "imu=off", "edge.rate_hz=10",
            f"job.unload_to_m={broken_off}", "header.rate_hz=10", "process.rate_hz=5",
            "cooperate.rate_hz=10", "unload.rate_hz=10",
        )]  # fmt: skip
    for m in carts:
        made += [
            f"{m}.job.break_off_m={broken_off}",
            *(f"{m}.{s}.rate_hz=10" for s in ("imu", "cooperate", "heap")),
        ]
    return made


def cheap_text(file, plan, faster):
    """The scenario as YAML. faster: speeds of machines on the field over the file's; passes as there"""
    fleet = fleet_of(file)
    work = work_plan(file, plan, fleet)
    for row in work.rows:
        row["speed_kmh"] *= faster.get(fleet.combines[row.get("combine", 0)].name, 1.0)
    carts = {n: replace(c, speed_kmh=c.speed_kmh * faster.get(n, 1.0)) for n, c in file.carts.items()}
    return scenario_text(replace(file, carts=carts), work, fleet, None)


class CheapRun:
    """A job run until it ends, or until a time. evaluators: classes, none = all; faster: see `cheap_text`;
    latest: signals by machine and kind; brought_at: when the last grain left a box at the truck [s]
    """

    def __init__(self, file, until_s=None, state=None, sets=None, evaluators=(), faster=None):
        self.plan = plan_of(file, fleet_of(file), None)
        text = cheap_text(file, self.plan, faster or {})
        sets = cheap_sets(file.combines, file.carts) if sets is None else sets
        self.world = assemble(parse_scenario(text, base=Path.cwd(), sets=sets))
        catalogue = EvaluatorCatalogue(evaluators) if evaluators else None
        self.digest, self.evaluation = Digest(), make_evaluation(self.world, catalogue)
        self.latest, self.brought_at = {}, 0.0
        if state is not None:
            self.world.load(state["world"])
            self.digest.load(state["digest"])
        self.go_on(until_s, resume=state is not None)

    def go_on(self, until_s=None, *, resume=True):
        drive(self.world, [self.digest, self.evaluation, self._keep], until_s=until_s, resume=resume)
        return self

    def saved(self):
        return pickle.loads(pickle.dumps({"world": self.world.save(), "digest": self.digest.save()}))

    def of(self, machine, kind):
        return self.latest[machine, kind]

    def _keep(self, slot, t, outputs):
        machine = slot.partition(".")[0]
        for signal in outputs.values():
            before = self.latest.get((machine, type(signal)), signal)
            if isinstance(signal, HeapState) and signal.emptied > before.emptied:
                self.brought_at = signal.t / NS
            self.latest[machine, type(signal)] = signal
        self.see(slot, t)

    def see(self, slot, t):
        """What a test keeps of it, at every step of a slot."""
