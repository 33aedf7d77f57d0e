"""Whether everything that left the field is somewhere: in a machine, lost, or on the ground."""

from math import fsum
from typing import Any

from swath.core.blocks import Seen
from swath.core.registry import Level
from swath.judge.evaluator import EvaluatorSetup, Later, Metric, added_up
from swath.signals import CropFlow, MachineLoad, UnloadState


class MassBalance(Later):
    """Recounts the field and compares with what all its machines account for."""

    OF_FIELD = True
    SIGNALS = (CropFlow, MachineLoad, UnloadState)
    METRICS = (
        Metric("mass_balance_error", "", "the worse of grain and straw: |left the field - in machines, "
               "losses and on the ground| / left the field", "Harvest", "lower",
               is_windowed=False, is_identity=True),
        Metric("stubble_straw_kg", "kg", "straw below the cut, which stays in the field", "Harvest", "",
               "straw left as stubble", is_windowed=False),
    )  # fmt: skip

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self._in_transit: dict[str, list[float]] = {}  # machine -> grain, straw between header and process
        self._shed: dict[str, float] = {}
        self._loads: dict[str, MachineLoad] = {}
        self._unloads: dict[str, UnloadState] = {}

    def take(self, seen: Seen) -> None:
        """Note what headers took in and what machines hold."""
        for name in seen.machines(CropFlow):
            flows, loads = seen.of(CropFlow, name), seen.of(MachineLoad, name)
            assert flows is not None
            moving = self._in_transit.get(name, [0.0, 0.0])
            self._shed[name] = added_up(self._shed.get(name, 0.0), flows["lost_grain"])
            is_new: Any = slice(None)
            if loads is not None:  # which hold what came before
                moving, is_new = [0.0, 0.0], flows.orders > loads.orders[-1]
            parts = zip(moving, ("grain", "straw"), strict=True)
            self._in_transit[name] = [added_up(begin, flows[part][is_new]) for begin, part in parts]
        for name in seen.machines(MachineLoad):
            loads = seen.of(MachineLoad, name)
            assert loads is not None
            self._loads[name] = loads.newest
            if seen.of(CropFlow, name) is None:
                self._in_transit[name] = [0.0, 0.0]
        for name in seen.machines(UnloadState):
            unloads = seen.of(UnloadState, name)
            assert unloads is not None
            self._unloads[name] = unloads.newest

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


def balance_error(missing: float, accounted: float) -> float:
    """|missing - accounted| / missing; 0 when both are 0, inf when only `missing` is."""
    gap = abs(missing - accounted)
    if gap == 0.0:
        return 0.0
    return gap / abs(missing) if missing else float("inf")


LEVEL = Level(MassBalance, None, summary="whether everything that left the field is somewhere")
