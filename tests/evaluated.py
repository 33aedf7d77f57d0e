"""Evaluators for tests that drive a world, or a made run, themselves."""

from swath.core.frames import Pose
from swath.field.memory_layout import Solids
from swath.field.site_setup import Bodies
from swath.judge.catalogue import load_evaluators
from swath.judge.evaluation import Evaluation
from swath.judge.evaluator import EvaluatorSetup


def evaluation_of(field, *machines, overlap=0.0, expect=(), own=(), gaps=()):
    """All evaluators for machines that have an edge of their own."""
    known = {m.name: m for m in machines}
    bodies = Bodies()
    for name in known:
        bodies.add(name, Solids(), Pose.identity())
    more = {"overlap": overlap, "gaps": gaps, "bodies": bodies}
    setups = {name: EvaluatorSetup(field, known, name, **more) for name in known}
    return Evaluation(load_evaluators(own), setups, expect)


def metrics_of(evaluation, machine="combine"):
    """Metrics of a machine and of the field, as they stand together in summary.json."""
    return {**evaluation.metrics(machine), **evaluation.metrics("field")}
