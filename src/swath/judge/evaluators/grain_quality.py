"""What is in the tank beside whole grain, what each organ of a combine loses, and whether it blocks."""

from collections.abc import Sequence

import numpy as np

from swath.core.blocks import Block, Seen
from swath.core.number_text import num
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Event, Later, Metric, added_up
from swath.signals import MachineLoad, MachineState, OrganLoads

GROUP = "Crop and engine"
LOSSES = ("threshing_loss", "separation_loss", "cleaning_loss")


class GrainQuality(Later):
    """Events `blockage`: an organ takes no more; of a process whose organs are slots."""

    SIGNALS = (MachineState, MachineLoad, OrganLoads)
    METRICS = (
        Metric("broken_percent", "%", "broken grain, of the grain that came into the tank", GROUP, "lower",
               "broken grain", is_windowed=False),
        Metric("tank_mog_percent", "%", "material other than grain that came into the tank, over the grain",
               GROUP, "lower", "beside grain in the tank", is_windowed=False),
        Metric("threshing_loss_percent", "%", "unthreshed grain over the rear, of the grain in the crop "
               "that leaves, mean weighted by the flow", GROUP, "lower", "lost by threshing",
               is_windowed=False),
        Metric("separation_loss_percent", "%", "free grain in the straw, of the same", GROUP, "lower",
               "lost by separation", is_windowed=False),
        Metric("cleaning_loss_percent", "%", "grain over the shoe's rear, of the same", GROUP, "lower",
               "lost by cleaning", is_windowed=False),
    )  # fmt: skip
    EVENTS = ("blockage",)

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self._state: MachineState | None = None
        self._organs: OrganLoads | None = None
        self._load: MachineLoad | None = None
        self._lost, self._weight = dict.fromkeys(LOSSES, 0.0), 0.0  # shares times flow, and flow
        self._events: list[Event] = []
        self._is_blocked = False

    def take(self, seen: Seen) -> None:
        """Note loads and blockages."""
        states, loads, organs = seen.of(MachineState), seen.of(MachineLoad), seen.of(OrganLoads)
        if states is not None:
            self._state = states.newest
        if loads is not None:
            self._load = loads.newest
            self._weigh(loads)
        if organs is not None:
            self._organs = organs.newest
            for t, share in zip(organs["t"].tolist(), (organs["blockage"] >= 1.0).tolist(), strict=True):
                if share and not self._is_blocked:
                    self._note(t)
                self._is_blocked = share

    def metrics(self) -> dict[str, float]:
        """Those of a process whose organs are slots."""
        if self._organs is None or self._load is None or self._load.tank_gain <= 0.0:
            return {}
        gain, o = self._load.tank_gain, self._organs
        found = {"broken_percent": o.tank_broken / gain, "tank_mog_percent": o.tank_mog / gain}
        if self._weight > 0.0:
            found |= {f"{name}_percent": lost / self._weight for name, lost in self._lost.items()}
        return {name: 100.0 * share for name, share in found.items()}

    def events(self) -> Sequence[Event]:
        """Where it blocked."""
        return self._events

    def _weigh(self, loads: Block) -> None:
        """Add the losses of the crop that leaves, by what is in the drum, each its part of `loss_share`."""
        leaves = loads["straw_flow"] > 0.0
        if not leaves.any():
            return
        first, second, third = flows = [loads[name][leaves] for name in LOSSES]
        lost, weight = first + second + third, loads["drum_flow"][leaves]
        share = weight * loads["loss_share"][leaves] / np.where(lost > 0.0, lost, 1.0)
        self._weight = added_up(self._weight, weight)
        for name, flow in zip(LOSSES, flows, strict=True):
            self._lost[name] = added_up(self._lost[name], flow * share)

    def _note(self, t: int) -> None:
        name, state = self.setup.name, self._state
        x, y, distance = 0.0, 0.0, 0.0
        if state is not None:
            (x, y, _), distance = np.asarray(state.pose.position).tolist(), state.distance
        text = f"{name} blocks at {num(t / NS)} s, after {num(distance)} m: more straw than its drum takes"
        self._events.append(Event(t, "blockage", name, x, y, distance, text, t))


LEVEL = Level(GrainQuality, None, summary="broken grain, cleanliness, losses by organ, blockage")
