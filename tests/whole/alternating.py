"""A speed law that goes between two speeds, for tests of those who follow."""

from dataclasses import dataclass

from swath.core.component import KeepsState, Port
from swath.core.schedule import NS
from swath.signals import SpeedCommand


class Alternating(KeepsState):
    """fast_m_s and slow_m_s in turn, each for every_s."""

    inputs = ()
    outputs = (Port("command", SpeedCommand),)

    @dataclass(frozen=True)
    class Params:
        every_s: float = 15.0
        fast_m_s: float = 1.2
        slow_m_s: float = 0.4

    def __init__(self, params, setup):
        self.params = params

    def reset(self, stream):
        return {"command": SpeedCommand(0, self.params.fast_m_s)}

    def step(self, t, dt, inputs):
        p = self.params
        is_slow = int((t + dt) / NS // p.every_s) % 2
        return {"command": SpeedCommand(t + dt, p.slow_m_s if is_slow else p.fast_m_s)}
