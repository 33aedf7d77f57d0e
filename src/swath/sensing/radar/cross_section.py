"""Radar cross sections of solids as a radar sees them from where it is, as of metal.

Geometrical optics, and for rods the far-field formula where that is less: Knott, Shaeffer and Tuley 2004,
Radar Cross Section, tables of simple shapes.
"""

from math import hypot, log10, pi

import numpy as np

from swath.core.portable import product
from swath.field.memory_layout import Solids
from swath.field.site_setup import Body
from swath.signals import F64

MACHINE = 20.0  # dBsm, usual 15 to 25 of tractors and combines, uncited
LEAST = -60.0  # dBsm of what shows nothing
BANDS = 50e9  # cross sections of sheets at 24 GHz hold below, those at 77 GHz above [Hz]


def rod(radius: float, length: float, distance: float, wavelength: float) -> float:
    """A rod seen square to its middle [m2].

    2 pi a L^2 / l far away, pi a R near: there only the part within the first Fresnel zone adds up.
    """
    return min(2.0 * pi * radius * length**2 / wavelength, pi * radius * distance)


def cross_section(body: Body, eye: F64, frequency: float, wavelength: float) -> float:
    """Cross section of a body from a point in the world (3,) [dBsm]: its own, else that of its solids."""
    if body.rcs_dbsm is not None:
        return body.rcs_dbsm[0 if frequency < BANDS else 1]
    if body.kind == "machine":
        return MACHINE
    area = _of_solids(body.solids, eye, wavelength) + _of_mesh(body, eye)
    return max(10.0 * log10(max(area, 1e-30)), LEAST)


def _of_solids(solids: Solids, eye: F64, wavelength: float) -> float:
    """Powers of all parts added [m2]."""
    area = 0.0
    for a, b, r in zip(solids.capsule_a, solids.capsule_b, solids.capsule_radius.tolist(), strict=True):
        length = hypot(*(b - a).tolist())
        away = eye - a
        along = float(product(away, b - a)) / max(length, 1e-9)
        square = max(float(product(away, away)) - along * along, 0.0) ** 0.5
        inside = length > 0.0 and 0.0 <= along <= length
        area += rod(float(r), length, square, wavelength) if inside else pi * r * r
    for centre, axes, half in solids.ellipsoids:
        u = _unit(product(axes.T, eye - centre))
        below = float(product(half * half, u * u))
        area += pi * float(half[0] * half[1] * half[2]) ** 2 / below**2
    for centre, axes, half in solids.boxes:
        area += silhouette(half, product(axes.T, eye - centre))
    return area


def _of_mesh(body: Body, eye: F64) -> float:
    if not body.solids.mesh_shape:
        return 0.0
    return silhouette(body.half, body.pose.inverse().apply(eye) - body.middle)


def silhouette(half: F64, away: F64) -> float:
    """Area [m2] of a box with half sizes (3,), seen from a direction in its frame; the cross section of a
    rough thing that scatters what it meets to all sides: no flash of a flat plate.
    """
    u = np.abs(_unit(away))
    faces = 4.0 * np.array([half[1] * half[2], half[0] * half[2], half[0] * half[1]])
    return float(product(faces, u))


def _unit(v: F64) -> F64:
    return np.asarray(v / max(hypot(*v.tolist()), 1e-9))
