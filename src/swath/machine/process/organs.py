"""Process level `organs`: elevator, tank and straw behind organs in slots of their own, their loads added up.

Header -> feeder -> threshing -> separation -> straw outlet; what falls through goes to cleaning, from there
to elevator and tank, or over the returns back to threshing. The organs run at the rate of the process.
Equations, sources and validation: docs/explanation/machine.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import fsum
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.together import plain
from swath.core.units import PERCENT
from swath.field.site_setup import SiteSetup
from swath.machine import DRIVEN, SLOPES
from swath.machine.compensated_sum import Total
from swath.machine.drivetrain_sheet import drivetrain_of
from swath.machine.organ import ENGINE, JOINED, added, crop, ratio_of
from swath.machine.process.straw_outlet import StrawOutlet
from swath.machine.process.unloading_pipe import UnloadingPipe
from swath.machine.transport import Conveyor, Masses, Mixer, flow_delay
from swath.scenario.machine_types import ORGANS
from swath.signals import CropFlow, CropStream, MachineLoad, MachineState, OrganLoads, OrganWork, UnloadState

STREAMS = ("straw", "chaff", "clean", "returned")
TOTALS = ("tank", "mog", "broken", "lost", "straw", "unloaded")


@dataclass(frozen=True)
class Params:
    """Straw and tank.

    straw: `swath` = laid in a swath, `chop` = chopped and spread over the header's width
    swath_width_m: width of the straw swath
    swath_step_m: travel after which the straw dropped on it is laid down in a swath
    spread_step_m: travel after which the straw dropped on it is spread
    tank_start_percent: level of grain in the tank at the start
    unload_at_percent: level at which the tank is emptied while driving, none = never; a slot `unload` empties
        it instead
    """

    straw: Literal["swath", "chop"] = "swath"
    swath_width_m: Annotated[float, Gt(0), Le(15)] = 1.4
    swath_step_m: Annotated[float, Gt(0), Le(5)] = 0.25
    spread_step_m: Annotated[float, Gt(0), Le(20)] = 1.5
    tank_start_percent: Annotated[float, Ge(0), Le(100)] = 0.0
    unload_at_percent: Annotated[float, Gt(0), Le(100)] | None = None


class Organs(KeepsState):
    """Adds up what the organs did, fills the tank and lays the straw."""

    kept: ClassVar[tuple[str, ...]] = (
        *("_elevator", "_lift", "_totals", "_tank_start", "_is_unloading", "_outlet", "_quality"),
    )
    steps_any_length = True

    inputs: tuple[Port, ...] = (
        Port("flow", CropFlow, history=True),
        Port("state", MachineState),
        ENGINE,
        Port("unload", UnloadState, optional=True),
        *(crop(name) for name in STREAMS),
        *(Port(name, OrganWork, history=True) for name in ORGANS),
    )
    outputs: tuple[Port, ...] = (Port("load", MachineLoad), Port("organs", OrganLoads))

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        p, w = params, drivetrain_of(setup.machine)
        self._p, self._drivetrain = p, w
        c, header = w.consumers, setup.machine.header_width
        self._empty = {"feeder": c.header_width * header, "cleaning": c.cleaning}  # until their first step
        rear, is_swath = setup.machine.body[0], p.straw == "swath"
        width, step = p.swath_width_m, p.swath_step_m
        if not is_swath:
            width, step = header, p.spread_step_m
        self._outlet = StrawOutlet(setup.field, rear, width, step, is_swath)
        self._pipe = UnloadingPipe(setup)
        self._tank_start = w.tank * p.tank_start_percent * PERCENT
        self._elevator, self._lift = Conveyor(1.0, 3, joined=JOINED / 2), Mixer(3)

    def reset(self, stream: Stream) -> Outputs:
        """Empty, but for the tank's start."""
        self._elevator.clear()
        self._lift.clear()
        self._totals = {name: Total() for name in TOTALS}
        self._is_unloading = False
        self._quality = [0.0, 0.0]
        self._outlet.reset()
        at_rest = {name: OrganWork(0, power=self._empty.get(name, 0.0)) for name in ORGANS}
        return self._sample(0, 1.0, at_rest, CropStream(0), {})

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Take what the organs gave within dt; the engine's speed of the last sample drives the elevator."""
        h, ratio, totals = dt / NS, ratio_of(inputs), self._totals
        works = {name: added(inputs[name]) for name in ORGANS}
        over, light, clean, back = (added(inputs[name]) for name in STREAMS)
        tank, mog, broken = self._lifted([clean.grain, clean.mog, clean.broken], h, ratio)
        unload: UnloadState | None = inputs.get("unload")
        drawn = self._draw(h, ratio, unload)
        over_rim = float(self._drivetrain.bulk.over_rim(self._content(), tank))
        straw, losses = over.mog + light.mog, (over.unthreshed, over.free, light.grain)
        totals["tank"].add(tank - over_rim)
        totals["mog"].add(mog)
        totals["broken"].add(broken)
        self._quality = [broken / tank, mog / tank] if tank > 0.0 else [0.0, 0.0]
        for loss in (*losses, over_rim):
            totals["lost"].add(loss)
        totals["straw"].add(straw)
        self._outlet.drop(straw, plain(inputs["state"].pose))
        if unload is None:
            self._pipe.pour(drawn, inputs["state"])
        rotors, shoe = (works[name].loss_share for name in ("separation", "cleaning"))
        cut = fsum(f.grain for f in inputs["flow"]), fsum(f.straw for f in inputs["flow"])
        flows = {
            "grain_flow": tank / h,
            "straw_flow": straw / h,
            "header_flow": fsum(cut) / h,
            "chopper_flow": straw / h if self._p.straw == "chop" else 0.0,
            "unload_flow": drawn / h,
            "threshing_loss": losses[0] / h,
            "separation_loss": losses[1] / h,
            "cleaning_loss": losses[2] / h,
            "loss_share": rotors + (1.0 - rotors) * shoe if any(losses) else 0.0,
        }
        return self._sample(t + dt, h, works, back, flows)

    def _lifted(self, clean: Masses, h: float, ratio: float) -> Masses:
        """Grain, other material and broken grain [kg] at the top of the elevator."""
        t = self._drivetrain.transport
        delay = flow_delay(self._elevator.held()[0] + clean[0], t.elevator, t.grain_feed, t.exponent)
        return self._lift.advance(self._elevator.advance(clean, h * ratio / delay), h, t.elevator_lag)

    def _draw(self, h: float, ratio: float, unload: UnloadState | None) -> float:
        """Grain that leaves the tank [kg]; what an auger of its own slot drew is booked."""
        w, unloaded, content = self._drivetrain, self._totals["unloaded"], self._content()
        drawn, limit = 0.0, self._p.unload_at_percent
        if unload is not None:
            drawn = max(unload.drawn - unloaded.value, 0.0)
        elif limit is not None:
            if content >= w.tank * limit * PERCENT:
                self._is_unloading = True
            if self._is_unloading:
                drawn = min(w.unloading * h * ratio, content)
                self._is_unloading = drawn < content
        unloaded.add(drawn)
        return drawn

    def _content(self) -> float:
        """Grain in the tank [kg]."""
        return self._tank_start + self._totals["tank"].value - self._totals["unloaded"].value

    def _held(self, works: Mapping[str, OrganWork]) -> Sequence[Sequence[float]]:
        """Grain and other material in the organs [kg]."""
        return [(work.held_grain, work.held_mog) for work in works.values()]

    def _sample(
        self, t: int, h: float, works: Mapping[str, OrganWork], back: CropStream, flows: Mapping[str, float]
    ) -> Outputs:
        """back: on its way to the returns, which take it in their next step."""
        inside = [*self._held(works), (back.grain, back.mog)]
        lifted, totals, tank = self._elevator, self._totals, self._drivetrain.tank
        grains, mogs = zip(*inside, strict=True)
        grain = fsum(grains) + lifted.held()[0] + self._lift.held()[0]
        mog = fsum((*mogs, lifted.held()[1], self._lift.held()[1], totals["mog"].value))
        drum, content = works["threshing"], self._content()
        given: dict[str, float] = {
            "tank_grain": content,
            "lost_grain": totals["lost"].value,
            "dropped_straw": totals["straw"].value,
            "held_grain": grain,
            "held_straw": mog,
            "grain_flow": 0.0,
            "straw_flow": 0.0,
            "unloaded_grain": totals["unloaded"].value,
            "tank_start": self._tank_start,
            "feeder_flow": _flow(works["feeder"], h),
            "drum_flow": _flow(drum, h),
            "rotor_flow": drum.mog / h,
            "shoe_flow": _flow(works["cleaning"], h),
            "return_flow": _flow(works["returns"], h),
            "tank_level": content / tank if tank > 0.0 else 0.0,
            **flows,
        }
        return {"load": MachineLoad(t, **given), **self._organ_loads(t, works)}

    def _organ_loads(self, t: int, works: Mapping[str, OrganWork]) -> Outputs:
        powers = {name: works[name].power for name in ORGANS}
        loads = OrganLoads(
            t,
            header_power=powers["feeder"],
            threshing_power=powers["threshing"],
            separation_power=powers["separation"],
            cleaning_power=powers["cleaning"] + powers["returns"],
            tank_mog=self._totals["mog"].value,
            tank_broken=self._totals["broken"].value,
            broken_share=self._quality[0],
            mog_share=self._quality[1],
            blockage=max(work.blockage for work in works.values()),
        )
        return {"organs": loads}


def _flow(work: OrganWork, h: float) -> float:
    """Crop that an organ worked on [kg/s]."""
    return (work.grain + work.mog) / h


LEVEL = Level(
    Organs,
    Params,
    summary="elevator, tank and straw; feeder, threshing, separation, cleaning and returns are slots",
    cost="about 60 us per step, 70 us more when straw is laid, and 100 us for the organs",
    tolerance="mass within 1e-12; equal to `threshing` where the organs are those of it",
    numbers=("transport",),
    checked=(DRIVEN, *SLOPES),
)
