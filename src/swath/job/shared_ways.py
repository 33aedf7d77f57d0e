"""Ways of carts to combines where passes are shared out before the job: those that carts with sensors find.

To a combine that stands in the middle of a pass a cart drives around standing crop and along passes that are
cut, by the search of the level with sensors (`swath.control.job.cart_ways`); other carts are not in its way.
"""

import math
from collections.abc import Sequence

from swath.control.job.cart_ways import CartWays, Way
from swath.control.job.carts import BEYOND
from swath.control.job.passes import Pass
from swath.control.job.shuttle import Params
from swath.control.turns.dubins import Place
from swath.job.cart_ways import WayBeside, aside, box_behind, box_offset, straight_first
from swath.job.machines import Combine
from swath.job.messages import Messages
from swath.job.path import Array, Pose, ahead_of, through
from swath.job.states import CartState, CombineState, at

RADIUS = Params.radius_m  # m, tightest turn of a cart with sensors
LONGER = 60.0  # m over the straight line, from where on a shorter way is looked for
SHORTER = 10.0  # m, at least, that it has to be


class SharedWays:
    """passes: as machines are told them; boundary: of the field (n, 2) [m]; combine: any of them; places: of
    carts at the truck
    """

    def __init__(
        self, passes: Sequence[Pass], boundary: Array, combine: Combine, places: Sequence[Pose]
    ) -> None:
        self._messages = Messages(passes)
        ring = [(x, y) for x, y in boundary.tolist()]
        beside, width = aside(combine), combine.sheet.header_width
        self._ways = CartWays(passes, ring, width, beside, RADIUS, [place[:2] for place in places])

    def to_combine(
        self, cart: CartState, here: Pose, out: float, combines: Sequence[CombineState], known: WayBeside
    ) -> WayBeside | None:
        """A way that is shorter than a known one to where the cart's combine is now; None where there is
        none, or that is short already. out: straight on first [m]
        """
        combine, begin = cart.combine, ahead_of(here, out)
        assert combine is not None
        target = at(combine)
        far = math.hypot(target.x - here.x, target.y - here.y)
        if combine.phase == "done" or known.place(combine) < far + LONGER:
            return None
        found = self._found(combine, begin, combines)
        if found is None:
            return None
        path = straight_first(here, out, through(found.points, RADIUS))
        length = self._messages.length(combine.index) if combine.task is not None else 0.0
        first = path.length - BEYOND - length - box_offset(combine.spec) + box_behind(cart.spec)
        made = WayBeside(path, first, length, path.length - found.beside)
        return made if 0.0 < made.place(combine) < known.place(combine) - SHORTER else None

    def _found(self, combine: CombineState, here: Pose, combines: Sequence[CombineState]) -> Way | None:
        """To its pass; to one that it has not begun also over crop that is cut before."""
        peer, *rest = (
            self._messages.to_cart(c, here) for c in (combine, *(o for o in combines if o is not combine))
        )
        task = combine.index if combine.task is not None else peer.task
        place = Place(*here)
        way = self._ways.to_pass(place, task, peer, (), rest)
        if way is None and task > peer.task:
            way = self._ways.to_pass(place, task, peer, (), rest, soon=True)
        return way
