"""The evaluators of a world."""

from swath.core.asked import bare, made_of
from swath.core.foreign_code import through
from swath.judge.catalogue import EvaluatorCatalogue, load_evaluators
from swath.judge.evaluation import Evaluation
from swath.judge.evaluator import SETTLING_M, EvaluatorSetup
from swath.runtime.credibility import Credibility, Scene
from swath.runtime.world import World


def make_evaluation(world: World, catalogue: EvaluatorCatalogue | None = None) -> Evaluation:
    """All evaluators of a scenario with its limits, or some without: an observer for `drive`."""
    machines = {name: machine.recorded() for name, machine in world.machines.items()}
    run = world.scenario.run
    setups = {
        name: EvaluatorSetup(
            field=world.field,
            machines=machines,
            name=name,
            overlap=machine.overlap,
            gaps=world.field.gaps_of(machine.edge),
            obstacles=world.obstacles,
            bodies=world.bodies,
            contact_ends_run=bare(run).on_contact == "end",
        )
        for name, machine in world.machines.items()
    }
    setups = {name: made_of(own, run, {"contact_ends_run": "on_contact"}) for name, own in setups.items()}
    expect = world.scenario.expect if catalogue is None else ()
    with through(world.scenario.gate):
        known = catalogue or load_evaluators(world.scenario.evaluators)
    watchers = [Credibility(Scene(world))] if catalogue is None else []
    made = Evaluation(known, setups, expect, watchers)
    made.is_trial = run.distance_m <= SETTLING_M
    return made
