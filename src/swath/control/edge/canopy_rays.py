"""Every beam of a scan as a ray through the canopy: the class of its answer, and where it counts.

A ray says one thing at one place. Where it was stopped, crop stands somewhere on its way from the top of the
canopy to its echo; where it went on, none stands between the top and the lower limit. Either is evidence at
that end of the way that lies deeper in the crop, less a part of a mean free path. The rays are followed in
compiled code (`detector_kernel`), over memory that is here.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.control.edge.blocks import Block
from swath.control.edge.detector_rows import BEAM, RAY
from swath.control.edge.ground_profile import CELL, SETTLES, STUBBLE, unseen
from swath.core.component import State
from swath.core.frames import Pose
from swath.kernels import filled
from swath.signals import F64, beam_directions


class CanopyRays:
    """The rays of one scanner.

    mounting: pose_machine_sensor; usual: height of the stubble that the driver expects, and its standard
    deviation [m]; row: (1,) of ROW; block: what they are counted in
    """

    def __init__(self, mounting: Pose, usual: tuple[float, float], row: NDArray[Any], block: Block) -> None:
        self._mounting, self._usual, self._row, self.block = mounting, usual, row, block
        self._canopy, self._beams = row["canopy"], np.zeros(0, BEAM)
        self._mean, self._covariance = unseen(int(row["detector"]["cells"][0]), usual)

    def clear(self) -> None:
        """Nothing seen; all beams count again."""
        self.block.clear()
        self._beams["before"] = np.nan
        self._mean[:], self._covariance[:] = unseen(int(self._row["detector"]["cells"][0]), self._usual)
        own, ground, beams = self._canopy, self._row["ground"], len(self._beams)
        own[:] = 0
        own["beams"], own["cell_travel"] = beams, CELL - SETTLES
        own["chance"] = share = 1.0 / own["chance"].shape[1]
        stubble, variance = self._mean[:, STUBBLE], self._covariance[:, STUBBLE, STUBBLE]
        ground["plane"] = (share * stubble).sum()
        ground["plane_sd"] = np.sqrt((share * ((stubble - ground["plane"]) ** 2 + variance)).sum())

    def aim(self, azimuth: F64, elevation: F64, beam_t: F64) -> bool:
        """Angles [rad] and times [s] of the beams from now on; whether `memory` is another now."""
        with np.errstate(invalid="ignore"):
            directions = self._mounting.turn(beam_directions(azimuth, elevation))
        count = len(beam_t)
        is_longer = self._make_room(count) | self.block.make_room(count)
        self._beams["aim"][:count] = directions
        self._beams["ago"][:count] = np.clip(np.nan_to_num(beam_t), -0.5, 0.0)
        self._canopy["beams"] = count
        return is_longer

    def _make_room(self, beams: int) -> bool:
        more = np.zeros(max(beams - len(self._beams), 0), BEAM)
        more["before"] = np.nan
        if len(more):
            self._beams = np.concatenate([self._beams, more])
        return len(more) > 0

    def make_room(self) -> bool:
        """Let the block have room for one more scan; whether its memory is another now."""
        return self.block.make_room(int(self._canopy["beams"][0]))

    def memory(self) -> Any:
        """A struct with all of it, for kernels."""
        from swath.control.edge.detector_kernel import Memory

        own = {"row": self._row, "beams": self._beams, "answers": self.block.rays}
        own |= {"counts": self.block.counts, "solid": self.block.solid, "mean": self._mean}
        flat = {name: array.view(np.float64).reshape(-1) for name, array in own.items()}
        size = max(4 * len(self._beams), 5 * self._mean.shape[1])
        scratch = np.zeros((RAY.itemsize // 8 + 3) * len(self._beams) + size)
        told = np.zeros((4, len(self.block.rays)))
        return filled(Memory, scratch=scratch, told=told, covariance=self._covariance.reshape(-1), **flat)

    def save(self) -> State:
        """Everything that is needed to go on exactly; where the beams go is not."""
        kept = {"mean": self._mean, "covariance": self._covariance, "beams": self._beams}
        kept |= {"canopy": self._canopy, "ground": self._row["ground"]}
        return {name: array.copy() for name, array in kept.items()}

    def load(self, state: State) -> None:
        """Take on a state that `save` gave; `memory` is another then."""
        count, beams = float(self._canopy["beams"][0]), state["beams"]
        self._mean[:], self._covariance[:] = state["mean"], state["covariance"]
        self._canopy[:], self._row["ground"][:] = state["canopy"], state["ground"]
        self._canopy["beams"] = count
        self._make_room(len(beams))
        self._beams["before"] = np.nan
        for name in ("before", "echoes", "is_dead"):
            self._beams[name][: len(beams)] = beams[name]
        self.make_room()
