"""Solids of obstacles as they stand at t = 0."""

from swath.field.solid.obstacles import things_of
from swath.field.solid.solids import merge


def solids_of(obstacles, field):
    return merge(*(thing.in_world for thing in things_of(obstacles, field)))
