"""Whether everything that left the field is somewhere: in a machine, lost, or on the ground."""

from collections.abc import Mapping, Sequence
from math import fsum

import numpy as np

from swath.core.registry import Level
from swath.core.together import Samples, field_of
from swath.judge.evaluator import EvaluatorSetup, Metric
from swath.judge.together import Bits
from swath.signals import CropFlow, MachineLoad, Signal, UnloadState


class MassBalance:
    """Recounts the field and compares with what all its machines account for."""

    OF_FIELD = True
    SIGNALS = (CropFlow, MachineLoad, UnloadState)
    METRICS = (
        Metric("mass_balance_error", "", "the worse of grain and straw: |left the field - in machines, "
               "losses and on the ground| / left the field", "Harvest", "lower", decimals=-1,
               is_windowed=False),
        Metric("stubble_straw_kg", "kg", "straw below the cut, which stays in the field", "Harvest", "",
               "straw left as stubble", "", 1, is_windowed=False),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self._in_transit: dict[str, list[float]] = {}  # machine -> grain, straw between header and process
        self._shed: dict[str, float] = {}
        self._loads: dict[str, MachineLoad] = {}
        self._unloads: dict[str, UnloadState] = {}

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Note what a header took in and what a machine holds."""
        for signal in outputs.values():
            if isinstance(signal, CropFlow):
                name = slot.partition(".")[0]
                moving = self._in_transit.setdefault(name, [0.0, 0.0])
                moving[0] += signal.grain
                moving[1] += signal.straw
                self._shed[name] = self._shed.get(name, 0.0) + signal.lost_grain
            elif isinstance(signal, MachineLoad):
                name = slot.partition(".")[0]
                self._loads[name] = signal
                self._in_transit[name] = [0.0, 0.0]
            elif isinstance(signal, UnloadState):
                self._unloads[slot.partition(".")[0]] = signal

    @classmethod
    def together(cls, evaluators: Sequence["MassBalance"]) -> "_Together":
        """Of many worlds."""
        return _Together(evaluators)

    def metrics(self) -> dict[str, float]:
        """The error as it stands now."""
        missing = self.setup.field.recount()
        held = [self.accounted(name) for name in self._in_transit]
        boxes = [box.gained for box in self.setup.bodies.boxes.values()]
        on_ground = fsum([self.setup.field.ground_grain_kg, *boxes])
        grain = balance_error(float(missing.grain), fsum(h[0] for h in held) + on_ground)
        straw = balance_error(float(missing.straw), fsum(h[1] for h in held))
        return {"mass_balance_error": max(grain, straw), "stubble_straw_kg": float(missing.stubble)}

    def accounted(self, name: str) -> tuple[float, float]:
        """Grain and straw [kg] that a machine has taken in and holds, has lost, or has laid behind it.

        Grain that it unloaded is where it went: with another machine, or on the ground.
        """
        grain, straw = self._in_transit.get(name, (0.0, 0.0))
        grain += self._shed.get(name, 0.0)
        if (load := self._loads.get(name)) is not None:
            grain += load.tank_grain - load.tank_start + load.lost_grain + load.held_grain
            straw += load.dropped_straw + load.held_straw
            if (unload := self._unloads.get(name)) is not None:  # drawn, and not yet booked by the process
                grain += load.unloaded_grain - unload.drawn + unload.held
        return grain, straw


class _Together:
    """By machine. moving: grain, straw between header and process, grain that was shed, (3, worlds)"""

    def __init__(self, evaluators: Sequence[MassBalance]) -> None:
        self._evaluators = evaluators
        self._moving: dict[str, np.ndarray] = {}
        self._loads: dict[str, Samples] = {}
        self._unloads: dict[str, Samples] = {}

    def see(self, slot: str, t: int, outputs: Mapping[str, Samples], active: Bits) -> None:
        """Note what headers took in and what machines hold."""
        name, n = slot.partition(".")[0], len(self._evaluators)
        for samples in outputs.values():
            if samples.kind is CropFlow:
                moving = self._moving.setdefault(name, np.zeros((3, n)))
                for k, part in enumerate(("grain", "straw", "lost_grain")):
                    moving[k] += field_of(samples, part)
            elif samples.kind is MachineLoad:
                self._loads[name] = samples
                self._moving.setdefault(name, np.zeros((3, n)))[:2] = 0.0
            elif samples.kind is UnloadState:
                self._unloads[name] = samples

    def give(self, world: int) -> None:
        """What was seen of a world."""
        e = self._evaluators[world]
        for name, moving in self._moving.items():
            grain, straw, shed = moving[:, world].tolist()
            e._in_transit[name], e._shed[name] = [grain, straw], shed
        e._loads = {name: samples.of(world) for name, samples in self._loads.items()}
        e._unloads = {name: samples.of(world) for name, samples in self._unloads.items()}


def balance_error(missing: float, accounted: float) -> float:
    """|missing - accounted| / missing; 0 when both are 0, inf when only `missing` is."""
    gap = abs(missing - accounted)
    if gap == 0.0:
        return 0.0
    return gap / abs(missing) if missing else float("inf")


LEVEL = Level(MassBalance, None, summary="whether everything that left the field is somewhere")
