"""What grain tanks and boxes that are full did not hold."""

from collections.abc import Mapping, Sequence

import numpy as np

from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import Samples, field_of
from swath.judge.evaluator import EvaluatorSetup, Event, Metric
from swath.judge.together import Bits, Woken, newest_of
from swath.machine.drivetrain_sheet import tank_of
from swath.signals import HeapState, MachineLoad, MachineState, Signal

NEARLY = 0.9  # of a tank, from which on it is watched
SAME = 1e-9  # of a tank: less below its capacity is full, more above it is more than it holds
LEAST = 0.1  # that runs over the rim of a box before it is an event [kg]


class Overfilled:
    """Events `spill`: grain runs over the rim of a grain tank, or of the box of a cart or truck.

    A machine whose sheet says `tank.when_full: stops` ends the run there. What came to the tank and is not in
    it is what it spilled; a process from elsewhere may report more in it than its sheet says that it holds.
    """

    OF_FIELD = False
    SIGNALS = (MachineState, MachineLoad, HeapState)
    NEWEST = (MachineState,)
    METRICS = (
        Metric("tank_spilled_kg", "kg", "grain that came to a full tank and ran over its rim",
               "Crop and engine", "lower", "spilled from the tank", "", 1, is_windowed=False),
    )  # fmt: skip
    EVENTS = ("spill",)

    def __init__(self, setup: EvaluatorSetup) -> None:
        tank = tank_of(setup.machine.geometry)
        self.setup, self._capacity, self._stops = setup, tank.capacity, tank.when_full == "stops"
        self._state: MachineState | None = None
        self._load: MachineLoad | None = None
        self._spilled = 0.0
        self._events: dict[str, Event] = {}  # by what is full

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Look whether what comes stays."""
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self._state = signal
            elif isinstance(signal, HeapState) and signal.spilled > LEAST:
                self._note("box", signal.t)
            elif isinstance(signal, MachineLoad) and self._capacity > 0.0:
                before, self._load = self._load, signal
                if signal.tank_grain >= (1.0 - SAME) * self._capacity and before is not None:
                    came = signal.grain_flow * (signal.t - before.t) / NS
                    spilled = max(came - (signal.tank_gain - before.tank_gain), 0.0)
                    self._spilled += spilled
                    beyond = signal.tank_grain - (1.0 + SAME) * self._capacity
                    if spilled > SAME * self._capacity or beyond > 0.0:
                        self._note("grain tank", signal.t)

    @classmethod
    def together(cls, evaluators: Sequence["Overfilled"]) -> Woken:
        """Of many worlds."""
        least = np.array([NEARLY * e._capacity or np.inf for e in evaluators])
        is_near = np.zeros(len(evaluators), np.bool_)

        def asks(t: int, outputs: Mapping[str, Samples], active: Bits) -> Bits | None:
            load = newest_of(outputs, MachineLoad)
            if load is not None:
                is_near[:] = field_of(load, "tank_grain") >= least
            is_first = load is not None and t == 0  # which tells that there is a tank
            return active if is_first or newest_of(outputs, HeapState) is not None else is_near

        return Woken(evaluators, asks)

    def metrics(self) -> dict[str, float]:
        """Of a machine with a tank."""
        return {} if self._load is None else {"tank_spilled_kg": self._spilled}

    def events(self) -> Sequence[Event]:
        """One of each thing that is full, from when on."""
        return [*self._events.values()]

    def end_reason(self, t: int) -> str:
        """The full tank, of a machine that stops then."""
        full = self._events.get("grain tank")
        return full.text if full is not None and self._stops else ""

    def _note(self, what: str, t: int) -> None:
        if what in self._events:
            return
        name, state = self.setup.name, self._state
        x, y, distance = (0.0, 0.0, 0.0)
        if state is not None:
            (x, y, _), distance = state.pose.position.tolist(), state.distance
        text = f"grain runs over the rim of the {what} of {name} from {t / NS:.1f} s, {distance:.0f} m on"
        self._events[what] = Event(t, "spill", name, x, y, distance, text, t)


LEVEL = Level(Overfilled, None, summary="what grain tanks and boxes that are full did not hold")
