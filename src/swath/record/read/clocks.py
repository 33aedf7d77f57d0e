"""Clocks of a recording: stamps of messages on the clock of its log, which says when they were received."""

from collections.abc import Callable
from dataclasses import dataclass, field

from swath.core.schedule import NS

LATE, EARLY = 2 * NS, NS  # a stamp this far before, or after, it was received is of another clock
STEP = NS // 8  # a clock that differs by more is set, by less it is slowed down: ntpd steps from 0.128 s
SCALES = {"TAI": 37, "GPS time": 18}  # seconds ahead of UTC, since 2017
PACE = 0.5, 2.0  # of a clock over the log's: where messages were written at another, neither shows steps


@dataclass
class _Clock:
    """shift: from its stamps to the log's clock [ns]; begun, last: (stamp, received) since it was set.

    least: delay so far, usual: time between messages [ns]
    """

    shift: int
    begun: tuple[int, int]
    last: tuple[int, int]
    least: int
    usual: int | None = None

    def follow(self, stamp: int, t: int) -> int:
        """How far it was set since the last stamp [ns], taken out of the shift; 0 where it runs on."""
        moved, passed = stamp - self.last[0], t - self.last[1]
        ran, lasted = self.last[0] - self.begun[0], self.last[1] - self.begun[1]
        step, late = moved - passed, t - stamp - self.shift
        back = max(moved, step) < -STEP
        usual = moved if self.usual is None else self.usual
        ahead = min(moved - usual, step, self.least - late) > STEP
        if not (back or ahead) or not PACE[0] * lasted < ran < PACE[1] * lasted:
            step, self.usual = 0, moved
        else:
            self.shift, self.begun = self.shift - step, (stamp, t)
        self.least, self.last = min(self.least, t - stamp - self.shift), (stamp, t)
        return step


@dataclass
class Clocks:
    """The clocks of messages, one for each frame and kind of message.

    Those that differ from the log's, or from each other, by no more than a delay count as one, and stamps as
    they are. Others count by the scale of time that lies as far ahead, else from when the first message was
    received. After a clock was set, its stamps go on from those before. zeros: shifts that were met [ns]
    """

    zeros: list[int] = field(default_factory=lambda: [0])
    _of: dict[str, _Clock] = field(default_factory=dict)

    def again(self) -> "Clocks":
        """Begin another pass through the recording."""
        return Clocks([*self.zeros])

    def time(self, of: str, stamp: int, t: int, note: Callable[[str], None]) -> int:
        """A stamp on the clock of the log [ns]; `t`, when it was received, where it is 0 and that is not.

        note: takes what was assumed
        """
        if stamp == 0 and t > LATE:
            return t
        clock = self._of.get(of)
        if clock is None:
            zero = self._zero(of, t - stamp, note)
            clock = self._of[of] = _Clock(zero, (stamp, t), (stamp, t), t - stamp - zero)
        elif step := clock.follow(stamp, t):
            to = "back" if step < 0 else "ahead"
            far = f"{to} by {abs(step) / NS:.2f} s"
            note(f"timeline: the clock of {of} was set {far}: its times go on from before")
        return stamp + clock.shift

    def _zero(self, of: str, late: int, note: Callable[[str], None]) -> int:
        scales = {-seconds * NS: f"{seconds} s ahead: {name}" for name, seconds in SCALES.items()}
        for zero in (*self.zeros, *scales):
            if -EARLY <= late - zero <= LATE:
                if zero not in self.zeros:
                    self.zeros.append(zero)
                    note(f"clock: stamps of {of} are {scales[zero]}, which is taken off")
                return zero
        self.zeros.append(late)
        text = "they count from when the first was received, as if that took no time"
        note(f"clock: stamps of {of} are not on the clock of the log: {text}")
        return late
