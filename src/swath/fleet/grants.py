"""Granted ground while machines drive: five verbs, after the blockade of open-rmf.

set       a machine's path under a reservation: the segments that it will enter, in order
ready     it wants to go as far as a segment
reached   it has entered a segment, and with it left all before
release   it needs no more of its path than up to a segment
cancel    it no longer wants to go on: what it was granted and has not entered is free again

Every message names its reservation; one of an older reservation is ignored, and one that comes late or
twice changes nothing, since what was reached or asked for only grows. A machine that hears nothing stands
at the end of what it was granted. A segment is granted when all that the order puts before it are left, so
nothing overlaps whoever is late, and since the order has no circle, some machine can always go on.
"""

from dataclasses import dataclass

from swath.fleet.table import Order


@dataclass
class _Held:
    """reservation: number; path: segments in order; place: of each in it; wants, granted, at: places in the
    path, -1 for none
    """

    reservation: int
    path: list[int]
    place: dict[int, int]
    wants: int = -1
    granted: int = -1
    at: int = -1


class Grants:
    """Hands out the segments of an order. `granted` says how far a machine may go."""

    def __init__(self, order: Order) -> None:
        self.order = order
        self._entered: set[int] = set()
        self._held: dict[str, _Held] = {}
        self._group = {number: group for group in order.groups for number in group}
        self._asked: set[int] = set()

    def set(self, machine: str, reservation: int, path: list[int]) -> None:
        """A machine's segments from here on. Ignored for a reservation that is not newer than its last."""
        held = self._held.get(machine)
        if held is None or reservation > held.reservation:
            self._held[machine] = _Held(reservation, list(path), {n: i for i, n in enumerate(path)})

    def ready(self, machine: str, reservation: int, segment: int) -> None:
        """A machine wants to go as far as a segment of its path."""
        held = self._of(machine, reservation)
        if held is not None and held.place.get(segment, -1) > held.wants:
            self._asked.update(held.path[held.at + 1 : held.place[segment] + 1])
            held.wants = held.place[segment]

    def reached(self, machine: str, reservation: int, segment: int) -> None:
        """A machine has entered a segment; ignored for one that it was not granted."""
        held = self._of(machine, reservation)
        if held is not None and held.at < held.place.get(segment, -1) <= held.granted:
            self._entered.update(held.path[held.at + 1 : held.place[segment] + 1])
            held.at = held.place[segment]

    def release(self, machine: str, reservation: int, segment: int) -> None:
        """A path ends with a segment that its machine may go to: nothing behind it is granted any more."""
        held = self._of(machine, reservation)
        if held is not None and held.place.get(segment, -1) >= held.granted:
            held.wants = min(held.wants, held.place[segment])

    def cancel(self, machine: str, reservation: int) -> None:
        """A machine stands where it is: what it was granted and has not entered is free again."""
        held = self._of(machine, reservation)
        if held is not None:
            self._asked.difference_update(held.path[held.at + 1 :])
            held.wants = held.granted = held.at

    def granted(self, machine: str) -> int | None:
        """The segment that a machine may go as far as, None before its first."""
        held = self._held.get(machine)
        if held is None:
            return None
        while held.granted < held.wants and self._is_free(held.path[held.granted + 1]):
            held.granted += 1
        return held.path[held.granted] if held.granted >= 0 else None

    def _of(self, machine: str, reservation: int) -> _Held | None:
        held = self._held.get(machine)
        return held if held is not None and held.reservation == reservation else None

    def waits_for(self, segment: int) -> tuple[int, int] | None:
        """What a segment is not granted for: the one that is entered at that moment, itself or a partner's,
        and what has to be entered, or asked for, before; None where nothing has.
        """
        for member in self._group[segment]:
            if member != segment and member not in self._asked:
                return member, member
            for other, waits in self.order.before[member]:
                if other not in self._entered and not (waits and member == segment):
                    return member, other
        return None

    def _is_free(self, segment: int) -> bool:
        """Whether all that comes before a segment is left, and who enters with it is there and ready, too."""
        return self.waits_for(segment) is None
