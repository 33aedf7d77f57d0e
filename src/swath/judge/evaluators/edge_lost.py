"""When a machine steers itself and its edge detection reports no edge."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import fsum

import numpy as np

from swath.core.blocks import Block, Seen
from swath.core.number_text import num
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.judge.evaluator import EvaluatorSetup, Event, Later, Metric, held
from swath.judge.header_path import HeaderPath
from swath.signals import CropEdge, MachineState, SteerCommand

GROUP = "Edge detection"
LEAST_S = 1.0  # shorter losses are no event


class EdgeLost(Later):
    """Events `edge_lost`: the automatic steered, then no edge was reported for LEAST_S or longer.

    An event begins with the first sample without an edge and ends with the next one with an edge, whether or
    not the automatic has handed over to a person meanwhile.
    """

    SIGNALS = (MachineState, CropEdge, SteerCommand)
    METRICS = (
        Metric("edge_lost_count", "", f"times that the edge was lost for {num(LEAST_S)} s or longer while "
               "the machine steered itself", GROUP, "lower", "edge lost, times"),
        Metric("edge_lost_s", "s", "time without an edge in all those times", GROUP, "lower",
               "edge lost, time"),
        Metric("edge_lost_m", "m", "way driven without an edge in all those times", GROUP, "lower",
               "edge lost, distance"),
    )  # fmt: skip
    EVENTS = ("edge_lost",)

    def __init__(self, setup: EvaluatorSetup) -> None:
        self.setup = setup
        self._end = HeaderPath(setup.machine).end
        self._state: MachineState | None = None
        self._is_steering = self._is_listed = self._has_edges = self._was_found = False
        self._begin: Event | None = None
        self._events: list[Event] = []

    def take(self, seen: Seen) -> None:
        """Note whether there was an edge."""
        states, edges, commands = seen.of(MachineState), seen.of(CropEdge), seen.of(SteerCommand)
        if edges is not None and (states is not None or self._state is not None):
            is_found = (edges["confidence"] > 0.0) & np.isfinite(edges["offset"])
            for k, found in enumerate(is_found.tolist()):
                if found and self._was_found and self._begin is None:
                    continue
                order = edges.orders[k : k + 1]
                at = -1 if states is None else int(states.before(order)[0])
                if at >= 0 or self._state is not None:
                    steers = held(commands, "is_engaged", order, self._is_steering)[0] > 0.0
                    self._see_edge(int(edges["t"][k]), partial(self._at, states, at), found, bool(steers))
        if commands is not None:
            self._is_steering = bool(commands["is_engaged"][-1])
        if states is not None:
            self._state = states.newest

    def metrics(self) -> dict[str, float]:
        """Metrics of all losses of the edge; none of a machine without an edge detection."""
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
            count = f"{num(m['edge_lost_count'])} times" if len(self._events) > 1 else "once"
            return [f"the edge was lost {count}, for {num(m['edge_lost_s'])} s and {num(m['edge_lost_m'])} m"]
        return ["no edge was ever found"] if self._has_edges and not self._was_found else []

    def events(self) -> Sequence[Event]:
        """Every loss that lasted long enough."""
        if self._is_listed and self._state is not None:
            last = self._events[-1]
            text = f"no edge for {num((self._state.t - last.t) / NS, places=1)} s, and none since"
            self._events[-1] = replace(last, text=text)
        return self._events

    def _at(self, states: Block | None, k: int) -> MachineState:
        """The kth of some states; before the first the newest before these."""
        found: MachineState | None = self._state if states is None or k < 0 else states.sample(k)
        assert found is not None
        return found

    def _see_edge(self, t: int, ask: Callable[[], MachineState], is_found: bool, is_steering: bool) -> None:
        """An edge, or none. ask: gives where the machine was."""
        self._has_edges = True
        if is_found:
            self._was_found = True
            if self._is_listed:
                last = self._events[-1]
                text = f"no edge for {num((t - last.t) / NS, places=1)} s"
                self._events[-1] = replace(last, text=text, end_t=t, end_distance=ask().distance)
            self._begin, self._is_listed = None, False
        elif self._begin is None:
            if is_steering:
                state = ask()
                x, y, _ = (float(v) for v in state.pose.apply(self._end))
                self._begin = Event(
                    t, "edge_lost", self.setup.name, x, y, state.distance, "no edge since", end_t=None
                )
        elif not self._is_listed and t - self._begin.t >= LEAST_S * NS:
            self._events.append(self._begin)
            self._is_listed = True


LEVEL = Level(EdgeLost, None, summary="when the machine steers itself and no edge is reported")
