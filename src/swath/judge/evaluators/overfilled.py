"""What grain tanks and boxes that are full did not hold."""

from collections.abc import Mapping, Sequence

from swath.core.blocks import Block, Seen, Shown
from swath.core.number_text import num
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

    SIGNALS = (MachineState, MachineLoad, HeapState)
    METRICS = (
        Metric("tank_spilled_kg", "kg", "grain that came to a full tank and ran over its rim",
               "Crop and engine", "lower", "spilled from the tank", is_windowed=False),
    )  # fmt: skip
    EVENTS = ("spill",)

    def __init__(self, setup: EvaluatorSetup) -> None:
        tank = tank_of(setup.machine.geometry)
        self.setup, self._capacity, self._stops = setup, tank.capacity, tank.when_full == "stops"
        self._state: MachineState | None = None
        self._load: tuple[int, float] | None = None  # time, grain that came to the tank so far
        self._spilled = 0.0
        self._events: dict[str, Event] = {}  # by what is full

    @property
    def live(self) -> tuple[type[Signal], ...]:
        """What ends a run is looked at when it comes."""
        return (MachineLoad, HeapState) if self._stops else ()

    def take(self, seen: Seen) -> None:
        """Note where the machine is, and what did not stay."""
        states = seen.of(MachineState)
        for kind in (HeapState, MachineLoad) if not self._stops else ():
            if (block := seen.of(kind)) is not None:
                self._look(block, states)
        if states is not None:
            self._state = states.newest

    def see_live(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Note what does not stay."""
        waiting = outputs.waiting(MachineState, self.setup.name) if isinstance(outputs, Shown) else None
        self._state = self._state if waiting is None else waiting.newest
        for block in Seen.of_one(slot, t, outputs).blocks:
            self._look(block, None)

    def _look(self, block: Block, states: Block | None) -> None:
        """Look whether what comes stays. states: of the machine, not yet taken in."""
        if issubclass(block.kind, HeapState):
            for k in (block["spilled"] > LEAST).nonzero()[0][:1].tolist():
                self._note("box", int(block["t"][k]), block, k, states)
        if not issubclass(block.kind, MachineLoad) or self._capacity <= 0.0:
            return
        grain, flow, times = block["tank_grain"], block["grain_flow"], block["t"].tolist()
        gain = (grain - block["tank_start"] + block["unloaded_grain"]).tolist()  # as `tank_gain`
        for k in (grain >= (1.0 - SAME) * self._capacity).nonzero()[0].tolist():
            before = (times[k - 1], gain[k - 1]) if k else self._load
            if before is None:
                continue
            came = float(flow[k]) * (times[k] - before[0]) / NS
            spilled = max(came - (gain[k] - before[1]), 0.0)
            self._spilled += spilled
            if spilled > SAME * self._capacity or grain[k] > (1.0 + SAME) * self._capacity:
                self._note("grain tank", times[k], block, k, states)
        self._load = times[-1], gain[-1]

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

    def _note(self, what: str, t: int, block: Block, k: int, states: Block | None) -> None:
        if what in self._events:
            return
        name, state = self.setup.name, self._state
        at = -1 if states is None else int(states.before(block.orders[k : k + 1])[0])
        if states is not None and at >= 0:
            state = states.sample(at)
        x, y, distance = (0.0, 0.0, 0.0)
        if state is not None:
            (x, y, _), distance = state.pose.position.tolist(), state.distance
        text = f"grain runs over the rim of the {what} of {name} from {num(t / NS)} s, {num(distance)} m on"
        self._events[what] = Event(t, "spill", name, x, y, distance, text, t)


LEVEL = Level(Overfilled, None, summary="what grain tanks and boxes that are full did not hold")
