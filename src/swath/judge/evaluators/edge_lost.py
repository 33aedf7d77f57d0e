"""When a machine steers itself and its edge detection reports no edge."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import fsum

import numpy as np

from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import Samples, field_of
from swath.judge.evaluator import EvaluatorSetup, Event, Metric
from swath.judge.header_path import HeaderPath
from swath.judge.together import Bits
from swath.signals import CropEdge, MachineState, Signal, SteerCommand

GROUP = "Edge detection"
LEAST_S = 1.0  # shorter losses are no event


class EdgeLost:
    """Events `edge_lost`: the automatic steered, then no edge was reported for LEAST_S or longer.

    An event begins with the first sample without an edge and ends with the next one with an edge, whether or
    not the automatic has handed over to a person meanwhile.
    """

    OF_FIELD = False
    SIGNALS = (MachineState, CropEdge, SteerCommand)
    NEWEST = (MachineState,)
    METRICS = (
        Metric("edge_lost_count", "", f"times that the edge was lost for {LEAST_S:g} s or longer while the "
               "machine steered itself", GROUP, "lower", "edge lost, times", "", 0),
        Metric("edge_lost_s", "s", "time without an edge in all those times", GROUP, "lower",
               "edge lost, time", "", 1),
        Metric("edge_lost_m", "m", "way driven without an edge in all those times", GROUP, "lower",
               "edge lost, way", "", 1),
    )  # fmt: skip
    EVENTS = ("edge_lost",)

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self._end = HeaderPath(setup.machine).end
        self._state: MachineState | None = None
        self._is_steering = self._is_listed = self._has_edges = self._was_found = False
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

    @classmethod
    def together(cls, evaluators: Sequence["EdgeLost"]) -> "_Together":
        """Of many worlds."""
        return _Together(evaluators)

    def metrics(self) -> dict[str, float]:
        """Of all losses; nothing of a machine without an edge detection."""
        if not self._has_edges:
            return {}
        times, ways = [0.0], [0.0]
        for event in self._events:
            end_t, end = event.end_t, event.end_distance
            if end_t is None and self._state is not None:
                end_t, end = self._state.t, self._state.distance
            times.append(((end_t or event.t) - event.t) / NS)
            ways.append(end - event.distance)
        count = float(len(self._events))
        return {"edge_lost_count": count, "edge_lost_s": fsum(times), "edge_lost_m": fsum(ways)}

    @property
    def notes(self) -> Sequence[str]:
        """Whether the edge was lost, or never found."""
        if self._events:
            m = self.metrics()
            count = f"{m['edge_lost_count']:.0f} times" if len(self._events) > 1 else "once"
            return [f"the edge was lost {count}, for {m['edge_lost_s']:.1f} s and {m['edge_lost_m']:.1f} m"]
        return ["no edge was ever found"] if self._has_edges and not self._was_found else []

    def events(self) -> Sequence[Event]:
        """Every loss that lasted long enough."""
        if self._is_listed and self._state is not None:
            last = self._events[-1]
            text = f"no edge for {(self._state.t - last.t) / NS:.1f} s, and none since"
            self._events[-1] = replace(last, text=text)
        return self._events

    def _see_edge(self, edge: CropEdge, state: MachineState) -> None:
        self._has_edges = True
        if edge.is_found:
            self._was_found = True
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


class _Together:
    """Shows an edge to those who see none or saw none before, and when the automatic comes and goes."""

    def __init__(self, evaluators: Sequence[EdgeLost]) -> None:
        self._evaluators = evaluators
        self._state: Samples | None = None
        self._was_found, self._was_steering = np.zeros((2, len(evaluators)), np.bool_)

    def see(self, slot: str, t: int, outputs: Mapping[str, Samples], active: Bits) -> None:
        """Note whether there are edges."""
        for samples in outputs.values():
            if samples.kind is MachineState:
                self._state = samples
            elif samples.kind is SteerCommand:
                is_steering = np.broadcast_to(field_of(samples, "is_engaged"), self._was_steering.shape)
                for world in np.flatnonzero(is_steering != self._was_steering).tolist():
                    self._evaluators[world]._is_steering = bool(is_steering[world])
                self._was_steering[:] = is_steering
            elif samples.kind is CropEdge and self._state is not None:
                is_found = (field_of(samples, "confidence") > 0.0) & np.isfinite(field_of(samples, "offset"))
                for world in np.flatnonzero(active & ~(is_found & self._was_found)).tolist():
                    own: dict[str, Signal] = {"state": self._state.of(world), "edge": samples.of(world)}
                    self._evaluators[world].see(slot, t, own)
                self._was_found[:] = is_found

    def give(self, world: int) -> None:
        """What was seen of a world."""
        if self._state is not None:
            self._evaluators[world].see("", 0, {"state": self._state.of(world)})


LEVEL = Level(EdgeLost, None, summary="when the machine steers itself and no edge is reported")
