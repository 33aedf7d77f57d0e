"""What the organs of a combine have in common, and one from elsewhere (an FMU, ROS 2, a log) in their row."""

from collections.abc import Sequence
from functools import partial
from math import fsum
from operator import add, attrgetter
from typing import Any, TypeVar

from swath.core.abilities import Closes, HasNotes, StepsAnyLength
from swath.core.component import Component, Inputs, KeepsState, Outputs, Port
from swath.core.errors import SwathError
from swath.core.frozen import changed
from swath.core.random import Stream
from swath.core.schedule import NS
from swath.core.signal import Signal
from swath.field.site_setup import SiteSetup
from swath.machine.compensated_sum import Total
from swath.machine.transport import Conveyor, Masses, Mixer
from swath.signals import CropFlow, CropStream, EngineState, OrganSettings, OrganWork
from swath.signals.flat import amounts
from swath.signals.settings import CROPS, own_settings

S = TypeVar("S", bound=Signal)
ENGINE = Port("engine", EngineState, optional=True)
SETTINGS = Port("settings", OrganSettings, optional=True)
ACTUAL = Port("actual", OrganSettings)
JOINED = 0.02  # transports join what entered within this time [s], or this share of their length
SHARED = ("unthreshed", "free", "broken", "straw", "short", "chaff")  # fields of what is in transport
OF_STREAM = attrgetter(*SHARED)


def crop(name: str) -> Port:
    """An input that takes in every sample of a stream."""
    return Port(name, CropStream, history=True)


def given(*names: str) -> tuple[Port, ...]:
    """The outputs of an organ: streams by name, and its work."""
    return (*(Port(name, CropStream) for name in names), Port("work", OrganWork))


def ratio_of(inputs: Inputs) -> float:
    """Engine speed over the rated speed; 1 without an engine."""
    engine: EngineState | None = inputs.get("engine")
    return 1.0 if engine is None else engine.speed_ratio


def moisture(streams: Sequence[CropStream]) -> tuple[float, float]:
    """Moistures of grain and straw of the newest sample, which what is sent on has, too."""
    newest = streams[-1] if streams else CropStream(0)
    return newest.grain_moisture, newest.straw_moisture


def sent(t: int, h: float, masses: Sequence[float], wet: tuple[float, float]) -> CropStream:
    """The sample of masses [kg], in the order of `SHARED`, that went on within h [s] up to t [ns]."""
    ear, free, broken, straw, short, chaff = masses
    return CropStream(t, ear, free, broken, straw, short, chaff, h, *wet)


def masses(streams: Sequence[CropStream]) -> Masses:
    """Masses that came with some samples [kg], in the order of `SHARED`."""
    if len(streams) == 1:
        return [*OF_STREAM(streams[0])]
    if len(streams) == 2:
        return [*map(add, OF_STREAM(streams[0]), OF_STREAM(streams[1]))]
    return [fsum(getattr(s, name) for s in streams) for name in SHARED]


def added(samples: Sequence[S]) -> S:
    """Samples as one: amounts added up, the rest from the newest. SwathError without any."""
    if not samples:
        raise SwathError(
            "an organ sent nothing within a step of who takes it: expected one rate_hz of all organs"
        )
    newest = samples[-1]
    if len(samples) == 1:
        return newest
    sums = {name: fsum(getattr(s, name) for s in samples) for name in amounts(type(newest))}
    return changed(newest, **sums)


FAR = 3.0  # over wheat's, the farthest that the manual of `CROPS` sets a crop (lower sieve in maize)


class Setting(KeepsState):
    """What an organ's actuators have come to, and what the manual has for the crop in the field.

    names: of `OrganSettings`; rates: how fast each moves, in SI per second; own: the manual's values
    beyond: those that came to less or more than `FAR` of the manual's
    """

    kept = ("_now", "_told", "beyond")

    def __init__(self, setup: SiteSetup, **rates: float) -> None:
        self._works, self._crop, self._rates = setup.machine.works, str(setup.field.stand.crop), rates
        self.own = own_settings(self._works, self._crop)
        self._rest, self._ones = {name: self.own[name] for name in rates}, dict.fromkeys(rates, 1.0)
        self.crop = CROPS.get(self._crop, CROPS["wheat"])
        self._now: dict[str, float] | None = None
        self._told: dict[str, float] | None = None
        self.beyond: list[str] = []

    def clear(self) -> None:
        """They begin where they are first wanted."""
        self._now, self._told, self.beyond = None, None, []

    def over_own(self, inputs: Inputs, h: float) -> dict[str, float]:
        """Every setting over the manual's after h [s] towards what `settings` wants."""
        asked = inputs.get("settings")
        if asked is None and (self._now is None or self._now is self._rest):
            self._now = self._rest
            return self._ones
        wanted = own_settings(self._works, self._crop, asked)
        now = wanted if self._now is None else self._now
        steps = {name: rate * h for name, rate in self._rates.items()}
        self._now = {n: min(max(wanted[n], now[n] - step), now[n] + step) for n, step in steps.items()}
        over = {name: value / self.own[name] for name, value in self._now.items()}
        for name, ratio in over.items():
            if not 1.0 / FAR <= ratio <= FAR and name not in self.beyond:
                self.beyond.append(name)
        return over

    def moved(self, t: int) -> dict[str, OrganSettings]:
        """The output `actual` at t [ns]: what they have come to, where it changed and somebody sets them."""
        now = self._now
        if now is None or now is self._rest or now == self._told:
            return {}
        self._told = now
        return {"actual": OrganSettings(t, **now)}


class Organ(KeepsState):
    """A built-in organ: its streams at the start, and the sample of its work.

    inside: what it held when it worked last, as `held` has it
    """

    inside: Sequence[Sequence[float]] = ()
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    steps_any_length = True

    @property
    def notes(self) -> Sequence[str]:
        """Settings that no law was made for."""
        setting: Setting | None = getattr(self, "_set", None)
        beyond = [] if setting is None else setting.beyond
        return [
            f"{n} was set beyond 1/{FAR:g} to {FAR:g} of the manual's, where no law holds" for n in beyond
        ]

    def start(self) -> None:
        """Empty it."""

    def reset(self, stream: Stream) -> Outputs:
        """Empty; nothing flows."""
        self.start()
        self.inside = ()
        return {port.name: port.signal(0) for port in self.outputs}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Work on what came within dt."""
        raise NotImplementedError

    def held(self) -> Sequence[Sequence[float]]:
        """Grain and material other than grain in each of its parts [kg]."""
        return ()

    def work(self, t: int, h: float, grain: float, mog: float, **more: float) -> OrganWork:
        """What was worked on in a step of h [s] that ended at t [ns]."""
        inside = self.inside = self.held()
        held = map(fsum, zip(*inside, strict=True)) if inside else (0.0, 0.0)
        return OrganWork(t, grain, mog, h, *held, **more)


def in_transport(part: Conveyor | Mixer) -> tuple[float, float]:
    """Grain and material other than grain in a transport of the `SHARED` masses [kg]."""
    ear, free, _, straw, short, chaff = part.held()
    return ear + free, straw + short + chaff


class LinkedOrgan(KeepsState):
    """An organ from elsewhere. What is in it is booked here: what came in and did not go out.

    feeds: its inputs that bring crop. SwathError where more goes out than came in. A step shorter than the
    others, at the end of a run, leaves what came in it.
    """

    kept = ("part", "_books", "_period")
    steps_any_length = True

    def __init__(self, part: Component, setup: SiteSetup, *, feeds: Sequence[Port], name: str) -> None:
        self.part, self._feeds, self._name = part, feeds, f"{setup.name}.{name}"
        self._passed = {port.name for port in part.inputs}
        own = {port.name: port for port in feeds}
        self.inputs = (*(p for p in part.inputs if p.name not in own), *feeds)
        self.outputs = (*(p for p in part.outputs if p.name != "work"), Port("work", OrganWork))

    @property
    def notes(self) -> Sequence[str]:
        """Notes of the part."""
        return self.part.notes if isinstance(self.part, HasNotes) else ()

    def reset(self, stream: Stream) -> Outputs:
        """As the part begins, with empty books."""
        self._books, self._period = {"grain": Total(), "mog": Total()}, 0
        return {**self.part.reset(stream), "work": OrganWork(0)}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Step the part and book what came and went."""
        came = [sample for port in self._feeds for sample in inputs[port.name]]
        fed = fsum(s.grain for s in came), fsum(_mog(s) for s in came)
        is_rest = dt < self._period and not (
            isinstance(self.part, StepsAnyLength) and self.part.steps_any_length
        )
        self._period = max(self._period, dt)
        if is_rest:
            made: Outputs = {p.name: CropStream(t + dt) for p in self.outputs if p.signal is CropStream}
        else:
            made = self.part.step(t, dt, {k: v for k, v in inputs.items() if k in self._passed})
        told: Any = made.pop("work", None)
        gone = [s for s in made.values() if isinstance(s, CropStream)]
        out = fsum(s.grain for s in gone), fsum(s.mog for s in gone)
        held = {}
        for (what, book), more, less in zip(self._books.items(), fed, out, strict=True):
            book.add(more)
            book.add(-less)
            held[f"held_{what}"] = book.value
            if book.value < -1e-6 * (1.0 + less):
                expected = f"it gives {-book.value:.3g} kg of {what} more than it took in"
                raise SwathError(f"{self._name} at t = {t / NS:.4g} s: {expected}")
        if not isinstance(told, OrganWork):
            over = made.get("over")
            lost = over.grain / fed[0] if isinstance(over, CropStream) and fed[0] > 0.0 else 0.0
            told = OrganWork(t + dt, *fed, dt / NS, loss_share=min(max(lost, 0.0), 1.0))
        return {**made, "work": changed(told, **held)}

    def close(self) -> None:
        """Let go of the part."""
        if isinstance(self.part, Closes):
            self.part.close()


linked_feeder, linked_threshing, linked_separation, linked_cleaning, linked_returns = (
    partial(LinkedOrgan, name=name, feeds=feeds)
    for name, feeds in {
        "feeder": (Port("flow", CropFlow, history=True),),
        "threshing": (crop("fed"), crop("back")),
        "separation": (crop("fed"),),
        "cleaning": (crop("pan"), crop("more")),
        "returns": (crop("fed"),),
    }.items()
)


def _mog(sample: Any) -> float:
    return sample.mog if isinstance(sample, CropStream) else sample.straw
