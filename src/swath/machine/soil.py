"""What a tyre can take from the soil under a load: firm ground, or soil of a cone index after Brixius.

Firm: numbers of the sheet; cornering and slip stiffness over load fall with load^-load_sensitivity.

Brixius (1987, ASAE paper 87-1622; in ASAE D497), not compared with the printed text:

    Bn  = (CI b d / W) (1 + 5 delta / h) / (1 + 3 b / d)           mobility number
    GT/W = 0.88 (1 - exp(-0.1 Bn)) (1 - exp(-7.5 s)) + 0.04        gross traction
    MR/W = 1 / Bn + 0.04 + 0.5 s / sqrt(Bn)                        motion resistance

CI cone index, b width, d diameter, h section height, delta deflection of the tyre, W its load, s slip. Here
the slip is counted from the wheel that rolls without torque, so the 0.04 of the gross traction is left out.
The motion resistance is a force of the soil along the ground, which the tread of driven wheels overcomes.
Rut and end of mobility (Maclaurin, cited in docs/explanation/machine.md; not compared with the printed text):

    N = CI (b d)^0.8 delta^0.4 / W,   rut = 0.224 d / N^1.25,   stuck where N < 1.85

Side stiffness and side friction are those of the sheet times 1 - exp(-0.1 Bn): an estimate, D497 has none.
"""

from dataclasses import dataclass
from math import exp, pow, sqrt
from typing import NamedTuple

LEAST_MOBILITY = 4.0  # below it no wheel moves on its own
STUCK = 1.85  # of `Brixius.number`: below it a vehicle does not get through


class Grip(NamedTuple):
    """All over load: side, along: slip stiffness [1/rad, 1]; side_top, along_top: friction; drag: rolling."""

    side: float
    along: float
    side_top: float
    along_top: float
    drag: float


@dataclass(frozen=True)
class Firm:
    """Rigid ground. load: the load [N] for which the numbers of `grip` hold."""

    grip: Grip
    load: float
    sensitivity: float
    exponential = False

    def at(self, load: float, slip: float) -> Grip:
        """Grip under a load [N]."""
        g = self.grip
        share = min(max(load / self.load, 0.1), 4.0) ** -self.sensitivity
        return Grip(g.side * share, g.along * share, g.side_top, g.along_top, g.drag)


@dataclass(frozen=True)
class Brixius:
    """Soil of a cone index [Pa]. diameter, width, section height of the tyre; deflection at `load` [m, N]."""

    grip: Grip
    cone_index: float
    diameter: float
    width: float
    section: float
    deflection: float
    load: float
    exponential = True

    def mobility(self, load: float) -> float:
        """Mobility number Bn under a load [N]."""
        bent = 1.0 + 5.0 * self.deflection * load / (self.load * self.section)
        wide = 1.0 + 3.0 * self.width / self.diameter
        base = self.cone_index * self.width * self.diameter / max(load, 1.0)
        return max(base * bent / wide, LEAST_MOBILITY)

    def number(self, load: float) -> float:
        """Mobility number N of Maclaurin under a load [N]."""
        bent = self.deflection * load / self.load
        return self.cone_index * pow(self.width * self.diameter, 0.8) * pow(bent, 0.4) / max(load, 1.0)

    def rut(self, load: float) -> float:
        """Depth [m] that the first pass of the wheel leaves under a load [N], at most half its diameter."""
        return min(0.224 * self.diameter / pow(self.number(load), 1.25), 0.5 * self.diameter)

    def at(self, load: float, slip: float) -> Grip:
        """Grip under a load [N] at a longitudinal slip."""
        g, bn = self.grip, self.mobility(load)
        firm = 1.0 - exp(-0.1 * bn)
        top = 0.88 * firm
        drag = 1.0 / bn + 0.04 + 0.5 * min(abs(slip), 1.0) / sqrt(bn)
        return Grip(g.side * firm, 7.5 * top, g.side_top * firm, top, drag)
