"""Which combine a cart goes to first where one stands in the way of the other."""

from collections.abc import Mapping

from swath.job.driver import Driver
from swath.job.engine import Job
from swath.job.give_way import GiveWay, stands_alone
from swath.job.standoff import PATIENCE
from swath.job.states import CombineState


def hand_over(job: Job, drivers: Mapping[str, Driver], give_way: GiveWay) -> None:
    """The cart of a combine goes to the one that stops it for PATIENCE, standing with no cart of its own:
    neither would go on before.
    """
    states = {c.spec.name: c for c in job.combines}
    for c in job.combines:
        if c.cart is None or c.is_pouring or give_way.stood(c.spec.name, job.time) < PATIENCE:
            continue
        other: CombineState | None = c
        for _ in job.combines:  # one may be stopped by another one that is
            other = states.get(drivers[other.spec.name].blocked) if other is not None else None
            if other is not None and other.cart is None and stands_alone(other):
                job.hand_over(c.cart, other)
                break
