"""Passes beside which no cart can drive: a cart is called so that the tank is emptied before them."""

from collections.abc import Iterator
from typing import Any

from swath.control.job.tank import EMPTY, MORE
from swath.job.states import DONE, CombineState


def is_needed_soon(job: Any, c: CombineState) -> bool:
    """Whether the tank has to be emptied in the first pass from now beside which a cart may drive: it has
    room until then, but not until the end of those after it beside which none may.
    """
    if job.file.unload.mode != "on_the_go" or c.task is None or c.tank <= EMPTY * c.spec.tank:
        return False
    level = c.tank + c.left / c.task.length * _grain(job, c.task) if c.phase in ("cut", "stand") else c.tank
    coming = _coming(job, c)
    is_beside = c.phase == "cut" and c.left > DONE and c.task.cart_beside
    if not is_beside and c.phase == "way":
        is_beside, level = c.task.cart_beside, level + _grain(job, c.task)
    while not is_beside:
        task = next(coming, None)
        if task is None or level > c.spec.tank:
            return False
        is_beside, level = task.cart_beside, level + _grain(job, task)
    return level + _blind(job, coming) > c.spec.tank


def _coming(job: Any, c: CombineState) -> Iterator[Any]:
    """Passes of a combine behind the present one, as far as they are known."""
    taken = [c.taken] if c.taken >= 0 else []
    return (job.passes[i] for i in (*taken, *job.passes.coming(c)))


def _blind(job: Any, coming: Iterator[Any]) -> float:
    """Grain of the passes up to the next beside which a cart may drive, and some more; 0 of a last one, at
    whose end it comes [kg].
    """
    found = 0.0
    for task in coming:
        if task.cart_beside:
            return MORE * found
        found += _grain(job, task)
    return 0.0


def _grain(job: Any, task: Any) -> float:
    return float(task.area * job.grain_per_m2)
