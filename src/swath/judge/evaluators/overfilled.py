"""What grain tanks and boxes that are full did not hold."""

from collections.abc import Mapping, Sequence

from swath.core.blocks import Seen, newest_of, number_of
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Event, Later, Metric
from swath.machine.drivetrain_sheet import tank_of
from swath.signals import HeapState, MachineLoad, MachineState, Signal

SAME = 1e-9  # of a tank: less below its capacity is full, more above it is more than it holds
LEAST = 0.1  # that runs over the rim of a box before it is an event [kg]


class Overfilled(Later):
    """Events `spill`: grain runs over the rim of a grain tank, or of the box of a cart or truck.

    A machine whose sheet says `tank.when_full: stops` ends the run there. What came to the tank and is not in
    it is what it spilled; a process from elsewhere may report more in it than its sheet says that it holds.
    """

    OF_FIELD = False
    SIGNALS = (MachineState, MachineLoad, HeapState)
    METRICS = (
        Metric("tank_spilled_kg", "kg", "grain that came to a full tank and ran over its rim",
               "Crop and engine", "lower", "spilled from the tank", "", 1, is_windowed=False),
    )  # fmt: skip
    EVENTS = ("spill",)
    live = (MachineLoad, HeapState)

    def __init__(self, setup: EvaluatorSetup) -> None:
        tank = tank_of(setup.machine.geometry)
        self.setup, self._capacity, self._stops = setup, tank.capacity, tank.when_full == "stops"
        self._state: MachineState | None = None
        self._load: tuple[int, float] | None = None  # time, grain that came to the tank so far
        self._spilled = 0.0
        self._events: dict[str, Event] = {}  # by what is full

    def take(self, seen: Seen) -> None:
        """Note where the machine is."""
        if (states := seen.of(MachineState)) is not None:
            self._state = states.sample(-1)

    def see_live(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Look whether what comes stays."""
        if (spilled := number_of(outputs, HeapState, "spilled")) is not None and spilled > LEAST:
            self._note("box", int(number_of(outputs, HeapState, "t")), outputs)
        grain = number_of(outputs, MachineLoad, "tank_grain")
        if grain is None or self._capacity <= 0.0:
            return
        before, self._load = self._load, (int(number_of(outputs, MachineLoad, "t")), _gain(outputs))
        if grain >= (1.0 - SAME) * self._capacity and before is not None:
            came = float(number_of(outputs, MachineLoad, "grain_flow")) * (self._load[0] - before[0]) / NS
            spilled = max(came - (self._load[1] - before[1]), 0.0)
            self._spilled += spilled
            if spilled > SAME * self._capacity or grain > (1.0 + SAME) * self._capacity:
                self._note("grain tank", self._load[0], outputs)

    def metrics(self) -> dict[str, float]:
        """Metrics of a machine with a tank."""
        return {} if self._load is None else {"tank_spilled_kg": self._spilled}

    def events(self) -> Sequence[Event]:
        """One of each thing that is full, from when on."""
        return [*self._events.values()]

    def end_reason(self, t: int) -> str:
        """The full tank, of a machine that stops then."""
        full = self._events.get("grain tank")
        return full.text if full is not None and self._stops else ""

    def _note(self, what: str, t: int, outputs: Mapping[str, Signal]) -> None:
        if what in self._events:
            return
        name = self.setup.name
        state = newest_of(outputs, MachineState, name, self._state)
        x, y, distance = (0.0, 0.0, 0.0)
        if state is not None:
            (x, y, _), distance = state.pose.position.tolist(), state.distance
        text = f"grain runs over the rim of the {what} of {name} from {t / NS:.1f} s, {distance:.0f} m on"
        self._events[what] = Event(t, "spill", name, x, y, distance, text, t)


def _gain(outputs: Mapping[str, Signal]) -> float:
    """As `MachineLoad.tank_gain`."""
    names = "tank_grain", "tank_start", "unloaded_grain"
    grain, start, gone = (float(number_of(outputs, MachineLoad, name)) for name in names)
    return grain - start + gone


LEVEL = Level(Overfilled, None, summary="what grain tanks and boxes that are full did not hold")
