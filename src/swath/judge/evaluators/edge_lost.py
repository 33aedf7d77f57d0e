"""When a machine steers itself and its edge detection reports no edge."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Event, Metric
from swath.judge.header_path import HeaderPath
from swath.signals import CropEdge, MachineState, Signal, SteerCommand

LEAST_S = 1.0  # shorter losses are no event


class EdgeLost:
    """Events `edge_lost`: the automatic steered, then no edge was reported for LEAST_S or longer.

    An event begins with the first sample without an edge and ends with the next one with an edge, whether or
    not the automatic has handed over to a person meanwhile.
    """

    OF_FIELD = False
    SIGNALS = (MachineState, CropEdge, SteerCommand)
    METRICS: tuple[Metric, ...] = ()
    EVENTS = ("edge_lost",)

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self._end = HeaderPath(setup.machine).end
        self._state: MachineState | None = None
        self._is_steering = self._is_listed = False
        self._begin: Event | None = None
        self._events: list[Event] = []

    def see(self, slot: str, t: int, outputs: Mapping[str, Signal]) -> None:
        """Note whether there is an edge."""
        for signal in outputs.values():
            if isinstance(signal, MachineState):
                self._state = signal
            elif isinstance(signal, SteerCommand):
                self._is_steering = signal.is_engaged
            elif isinstance(signal, CropEdge) and self._state is not None:
                self._see_edge(signal, self._state)

    def metrics(self) -> dict[str, float]:
        """None."""
        return {}

    def events(self) -> Sequence[Event]:
        """Every loss that lasted long enough."""
        return self._events

    def _see_edge(self, edge: CropEdge, state: MachineState) -> None:
        if edge.is_found:
            if self._is_listed:
                last = self._events[-1]
                text = f"no edge for {(edge.t - last.t) / NS:.1f} s"
                self._events[-1] = replace(last, text=text, end_t=edge.t, end_distance=state.distance)
            self._begin, self._is_listed = None, False
        elif self._begin is None:
            if self._is_steering:
                x, y, _ = (float(v) for v in state.pose.apply(self._end))
                self._begin = Event(
                    edge.t, "edge_lost", self.setup.name, x, y, state.distance, "no edge since", end_t=None
                )
        elif not self._is_listed and edge.t - self._begin.t >= LEAST_S * NS:
            self._events.append(self._begin)
            self._is_listed = True


LEVEL = Level(EdgeLost, None, summary="when the machine steers itself and no edge is reported")
