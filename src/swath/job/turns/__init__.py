"""Turns from one pass to the next. `plan(start, end, limits)` gives the pieces of a path between two poses.

`dubins` jumps from straight to full lock; `clothoid` turns the steering at its rate.
"""

from swath.control.turns.limits import TurnLimits, limits_of

__all__ = ["TurnLimits", "limits_of"]
