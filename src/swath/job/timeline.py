"""Who did what when: the times of each machine by state."""

import math
from dataclasses import dataclass, field

STATES = ("cut", "turn", "unload", "wait", "transport", "load")
"""load: a cart beside a combine that pours; unload: a combine standing to pour, or a cart at the truck."""


@dataclass(frozen=True)
class Span:
    """A machine's state from start to end [s]. pass_index: of the pass being cut, else -1."""

    state: str
    start: float
    end: float
    pass_index: int = -1


@dataclass
class Timeline:
    """Spans of one machine in order, without gaps."""

    spans: list[Span] = field(default_factory=list)

    def add(self, state: str, start: float, end: float, pass_index: int = -1) -> None:
        """Append a span, joined to the one before where it goes on."""
        if end <= start:
            return
        last = self.spans[-1] if self.spans else None
        if last is not None and (last.state, last.pass_index) == (state, pass_index) and last.end == start:
            self.spans[-1] = Span(state, last.start, end, pass_index)
        else:
            self.spans.append(Span(state, start, end, pass_index))

    def time(self, state: str) -> float:
        """Time in a state [s]."""
        return math.fsum(s.end - s.start for s in self.spans if s.state == state)

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.spans[-1].end if self.spans else 0.0
