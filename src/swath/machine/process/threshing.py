"""Process level `threshing`: the organs of level `organs` as one part, with the numbers of the data sheet."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from swath.core.component import Inputs, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.field.site_setup import SiteSetup
from swath.machine.cleaning.overload import Shoe
from swath.machine.feeder.model import Feeder
from swath.machine.feeder.model import Params as FeederParams
from swath.machine.organ import Organ
from swath.machine.process import organs
from swath.machine.returns.model import Returns
from swath.machine.separation.model import Params as RotorParams
from swath.machine.separation.model import Rotors
from swath.machine.threshing.model import Drum, Threshability
from swath.machine.threshing.model import Params as DrumParams
from swath.scenario.slots import SLOTS
from swath.signals import MachineLoad, OrganWork

OUTSIDE = {"flow": ("header", "flow"), "state": ("motion", "state"), "engine": ("powertrain", "engine")}
DRY = 12.0  # moisture of the straw at which `Drum` and `Rotors` take no factor for it [%]
WIRES = {slot.name: slot.wires for slot in SLOTS}


@dataclass(frozen=True)
class Params(organs.Params):
    """Threshing, separation and cleaning.

    threshability: factor on threshing and separation [1]; 1 = as the stand's straw is moist, another one in
        place of that: 0.8 = moist straw in the evening, where losses are 2 to 4 times as high
    """

    threshability: Threshability = 1.0


class ThreshingProcess(organs.Organs):
    """Transport, threshing, separation and cleaning with delays and losses that depend on the load."""

    kept = (*organs.Organs.kept, "_organs", "_returned")
    inputs = organs.Organs.inputs[:4]
    outputs = (Port("load", MachineLoad),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        super().__init__(params, setup)
        drum = DrumParams(params.threshability, ears_through_percent=0.0)
        straw = None if params.threshability == 1.0 else DRY  # what it is set to stands in place of moisture
        self._organs: dict[str, Organ] = {  # in the order of their slots
            "returns": Returns(None, setup),
            "feeder": Feeder(FeederParams(straw_moisture_percent=straw), setup),
            "threshing": Drum(drum, setup),
            "separation": Rotors(RotorParams(params.threshability, short_percent=0.0), setup),
            "cleaning": Shoe(None, setup),
        }

    def reset(self, stream: Stream) -> Outputs:
        """Empty, but for the tank's start."""
        self._given: dict[str, dict[str, Any]] = {name: {} for name in (*self._organs, "process")}
        self._ways: dict[tuple[str, str], list[tuple[dict[str, Any], str]]] = {}  # of what is sent, to inputs
        ports = {name: organ.inputs for name, organ in self._organs.items()}
        for slot, own in {**ports, "process": organs.Organs.inputs[4:]}.items():
            for port in own:
                self._ways.setdefault(WIRES[slot][port.name], []).append((self._given[slot], port.name))
                self._given[slot][port.name] = None
        for name, organ in self._organs.items():
            self._send(name, organ.reset(stream))
        self._returned = self._given["process"]["returned"]
        return super().reset(stream)

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Step the organs, then what is behind them."""
        for port, source in OUTSIDE.items():
            self._bring(source, inputs.get(port))
        self._given["returns"]["fed"] = self._returned
        for name, organ in self._organs.items():
            self._send(name, organ.step(t, dt, self._given[name]))
        self._returned = self._given["process"]["returned"]
        return super().step(t, dt, {**inputs, **self._given["process"]})

    def _send(self, name: str, outputs: Outputs) -> None:
        for output, sample in outputs.items():
            for target, port in self._ways.get((name, output), ()):
                target[port] = (sample,)

    def _bring(self, source: tuple[str, str], given: Any) -> None:
        for target, port in self._ways.get(source, ()):
            target[port] = given

    def _held(self, works: Mapping[str, OrganWork]) -> Sequence[Sequence[float]]:
        return [part for organ in self._organs.values() for part in organ.inside]

    def _organ_loads(self, t: int, works: Mapping[str, OrganWork]) -> Outputs:
        return {}


LEVEL = Level(
    ThreshingProcess,
    Params,
    summary="feeder, drum, rotors, shoe, returns, elevator, tank: delays and losses that depend on the load",
    cost="about 170 us per step, 70 us more when straw is laid",
    tolerance="steady losses equal the closed forms, mass within 1e-12; the rates are fitted to one machine",
    numbers=("transport", "threshing", "cleaning"),
    checked=organs.LEVEL.checked,
)
