"""A clock that a test moves."""

NS = 1_000_000_000


class FakeClock:
    """Moves by what is slept, by `work` [ns] per look, and wakes `wake_late` [ns] late."""

    def __init__(self):
        self.t, self.work, self.wake_late, self.slept = 7 * NS, 0, 0, 0

    def now(self):
        self.t += self.work
        return self.t

    def sleep(self, duration):
        self.t += duration + self.wake_late
        self.slept += duration
