"""What the echoes of a scan are of: the truth for detectors that are trained or tested on scans.

A level says what its own rays met. `unknown` is an echo of which it does not know that: measured heights have
no names, and where an echo is made of several hits no one thing may have more than half of it. `dust` is all
that is in the air: dust, chaff, drops, fog, and what noise makes.
"""

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from swath.field.memory_layout import Organ
from swath.field.site_setup import SiteSetup
from swath.field.solid.solids import merge
from swath.rays.single.buffers import BeamBuffer
from swath.signals import F32, F64, U8, Mask

SAME = 0.05  # a ray met the machine where it met something no farther from it [m]; a body may lag by 5 ms


class Label(IntEnum):
    """What an echo is of; 0 = no echo."""

    NONE = 0
    UNKNOWN = 1
    CROP = 2
    WEED = 3
    STUBBLE = 4
    STRAW = 5
    GROUND = 6
    OBSTACLE = 7
    OWN_MACHINE = 8
    DUST = 9


OF_ORGAN: U8 = np.full(len(Organ), Label.CROP, np.uint8)
for _organ in (Organ.NONE, Organ.GROUND, Organ.STRAW, Organ.STUBBLE, Organ.WEED):
    OF_ORGAN[_organ] = Label[_organ.name]
OF_ORGAN[Organ.SOLID] = Label.OBSTACLE  # or the own machine, see `tell_own`


def tell_own(labels: U8, origins: F64, directions: F64, distance: F32 | F64, setup: SiteSetup) -> None:
    """Make obstacles the own machine where rays met that, its trailer included, in the array of labels (n,).

    origins, directions: world (n, 3); distance: at which each ray met something [m], (n,)
    """
    own = setup.bodies.own(setup.name)
    body = merge(*(seen.solids for seen in setup.bodies.in_sight(setup.name) if seen.name in own))
    hard = np.flatnonzero(labels == Label.OBSTACLE)
    beams = BeamBuffer(len(hard))
    beams.origins[: len(hard)], beams.directions[: len(hard)] = origins[hard], directions[hard]
    if len(hard) and beams.meet(body, float(np.max(distance[hard])) + 1.0):
        labels[hard[np.abs(beams.distance[: len(hard)] - distance[hard]) < SAME]] = Label.OWN_MACHINE


def changed(before: F64, after: F64) -> Mask:
    """Where the air took the place of what rays met, nan = nothing."""
    return np.asarray((before != after) & ~(np.isnan(before) & np.isnan(after)))


def of_echoes(of_rays: U8, share: NDArray[np.float64]) -> U8:
    """Labels of echoes (n, k) from those of sub-rays (n, s) and the share of each in an echo (n, k, s)."""
    of_each = np.stack([(share * (of_rays == label)[:, None]).sum(axis=2) for label in Label])
    best = np.where(of_each.max(axis=0) > 0.5, of_each.argmax(axis=0), Label.UNKNOWN)
    return np.where(share.sum(axis=2) > 0.0, best, Label.NONE).astype(np.uint8)
