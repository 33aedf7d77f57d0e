"""Turns between two places: the shortest of arcs and straights (`dubins`), and one with a steering that needs
time (`clothoid`).
"""

from swath.control.turns.limits import TurnLimits, limits_of

__all__ = ["TurnLimits", "limits_of"]
