"""When a combine pours into the cart beside it, and when the two part: for `swath.job.engine.Job`."""

from typing import Any

from swath.job.cart_ways import beside
from swath.job.states import DONE, CartState, CombineState, at

SHORT_POUR = 8.0  # s before the end of a pass within which pouring is not begun


def ready_after(job: Any, c: CombineState) -> float:
    """Time until grain flows with a cart that has just come beside [s]."""
    assert c.cart is not None
    time: float = max(c.cart.spec.align, c.spec.swing) + job.file.unload.ramps_s
    if c.phase == "stand" and c.task is not None and not c.task.cart_beside:
        time += job.file.unload.pocket_s
    return time


def pours(job: Any, c: CombineState) -> bool:
    """Begin or end to pour; True where that changed."""
    cart = c.cart
    if cart is None or cart.phase != "beside":
        return False
    if c.is_pouring:
        if cart.grain < cart.spec.load - DONE and (c.tank > DONE or _stays(job, c, cart)):
            return False
        c.is_pouring = False
        note_load(c)
        _parts(c, cart)
        return True
    if c.timer > DONE or c.tank <= DONE:
        return False
    may = c.phase == "stand" or (
        c.phase == "cut" and may_pour_driving(job, c) and c.left > SHORT_POUR * max(c.pace, 0.1)
    )
    if may:
        c.is_pouring = True
        c.loads.append((job.time, -c.poured, "standing" if c.phase == "stand" else "on the go"))
    return may


def _stays(job: Any, c: CombineState, cart: CartState) -> bool:
    """True for a cart that can take all that is left of the last pass, while nobody else wants it: so it
    need not come back.
    """
    is_last = c.phase == "cut" and job.passes.left() == 0
    wanted = any(o.cart is None and o.tank >= o.spec.call for o in job.combines if o is not c)
    return is_last and not wanted and cart.grain + c.left * c.per_metre <= cart.spec.load


def may_pour_driving(job: Any, c: CombineState) -> bool:
    """True in a pass on whose left a cart may drive."""
    return job.file.unload.mode == "on_the_go" and c.task is not None and c.task.cart_beside


def waits_at_end(job: Any, c: CombineState) -> bool:
    """True where a combine stands at the end of a pass to pour there: until a cart comes, or one is ready."""
    if job.file.unload.mode != "on_the_go":
        return c.tank + _next_grain(job, c) > c.spec.tank
    return _came_late(job, c) and not job.goes_on_pouring(c)


def _next_grain(job: Any, c: CombineState) -> float:
    """Grain of a pass like the one that ends [kg]."""
    assert c.task is not None
    wants = job.file.unload.mode == "at_headland" and job.passes.left() > 0
    return c.task.area * float(job.grain_per_m2) if wants else 0.0


def _came_late(job: Any, c: CombineState) -> bool:
    """True at the end of a pass on whose left a cart may drive, where one has just come beside a combine that
    is half full, and other combines have to share the carts.
    """
    is_there = c.cart is not None and c.cart.phase == "beside" and not c.is_pouring
    are_few = len(job.carts) < len(job.combines)
    return is_there and are_few and c.tank >= 0.5 * c.spec.tank and may_pour_driving(job, c)


def note_load(c: CombineState) -> None:
    """How much the load that ends now was."""
    begun, before, kind = c.loads[-1]
    c.loads[-1] = (begun, c.poured + before, kind)


def _parts(c: CombineState, cart: CartState) -> None:
    """The cart is done with a combine."""
    c.cart, c.called, cart.combine = None, False, None
    cart.phase, cart.place = "idle", beside(at(c), c.spec, cart.spec)
