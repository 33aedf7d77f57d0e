"""Process level `threshing`: the path of grain and straw through the machine, and what each part loses.

Header -> feeder house -> drum -> rotors -> straw outlet; what falls through -> shoe -> elevator -> tank, or
back to the drum. Equations, sources and validation: docs/explanation/machine.md.

Threshing and separation along a drum or a rotor are two coupled exponentials: grain in the ear u and free
grain in the straw f over the length x:

    du/dx = -lambda u,   df/dx = lambda u - beta f,   separated = 1 - u - f

(Miu, Combine Harvesters, 2015; separation alone: Boettinger, Beck and Kutzbach). Both rates fall with the
layer.
"""

from dataclasses import dataclass
from math import exp, expm1, fsum, hypot
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from swath.core import portable
from swath.core.component import Inputs, KeepsState, Outputs, Port
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.core.units import PERCENT
from swath.field.site_setup import SiteSetup
from swath.machine import SLOPES, SPEED
from swath.machine.compensated_sum import Total
from swath.machine.drivetrain_sheet import Cleaning, drivetrain_of
from swath.machine.process.straw_outlet import StrawOutlet
from swath.machine.process.transport import Conveyor, Masses, Mixer, flow_delay
from swath.machine.process.unloading_pipe import UnloadingPipe
from swath.signals import CropFlow, EngineState, MachineLoad, MachineState, UnloadState

Array = NDArray[np.float64]
FRONT, WIDTH, EAR, FREE, STRAW, FED, SCALE = range(
    7
)  # rows: front and width of the length, kg, factor on rates


def coupled(ear: float, free: float, threshing: float, separation: float) -> tuple[float, float]:
    """(grain in the ear, free grain) after a length, from those before it; both rates times the length.

    Exact for any two rates, equal ones too.
    """
    gap = separation - threshing
    grown = 1.0 + 0.5 * gap if abs(gap) < 1e-6 else expm1(gap) / gap
    left = exp(-separation)
    return ear * exp(-threshing), free * left + ear * threshing * left * grown


class Rotor(KeepsState):
    """Parcels of crop that pass through the rotors; each parcel of one step is exact on its own.

    A parcel has a front and a width; it is threshed until its front comes to the end, then leaves bit by bit.
    threshing, separation: rates over the whole length at the nominal layer; exponent: both go with
    layer^-exponent; passage: time through it at nominal speed [s]
    """

    kept = ("_parcels",)

    def __init__(self, threshing: float, separation: float, exponent: float, passage: float) -> None:
        if abs(separation - threshing) < 1e-6 * threshing:
            separation = threshing * (1.0 + 1e-6)  # two rates that are never equal need no limit
        self._rates, self._exponent, self._passage = (threshing, separation), exponent, passage
        self.clear()

    def clear(self) -> None:
        """Empty it."""
        self._parcels = np.zeros((7, 0))

    def advance(
        self,
        crop: tuple[float, float, float, float],
        *,
        layer: float,
        dt: float,
        ratio: float,
        threshability: float,
    ) -> tuple[float, list[float]]:
        """Take in a step's crop [kg] and move everything on by dt [s].

        crop: grain in the ear, free grain, straw, and the grain it had before the drum [kg]
        layer: thickness of what enters, 1 = nominal; ratio: rotor speed over nominal; threshability: factor
        on both rates. Returns the grain separated [kg] and what leaves [kg], four as `crop`
        """
        path = dt * ratio / self._passage
        if any(crop):
            scale = max(layer, 1e-3) ** -self._exponent
            new = np.array([[0.0], [path], *([m] for m in crop), [scale]])
            self._parcels = np.concatenate([self._parcels, new], axis=1)
        p = self._parcels
        if p.shape[1] == 0:
            return 0.0, [0.0] * 4
        front = p[FRONT] + path
        done = (np.minimum(front, 1.0) - p[FRONT]) * p[SCALE]
        threshing, separation = self._rates
        still, kept = portable.exp(
            done * np.array([[-threshability * threshing], [-threshability * separation]])
        )
        ear = p[EAR] * still
        free = p[FREE] * kept + p[EAR] * (still - kept) * (threshing / (separation - threshing))
        separated = float((p[EAR] + p[FREE] - ear - free).sum())
        p[FRONT], p[EAR], p[FREE] = front, ear, free
        return separated, self._leave()

    def held(self) -> tuple[float, float]:
        """Grain and straw in it [kg]."""
        total = self._parcels.sum(axis=1)
        return float(total[EAR] + total[FREE]), float(total[STRAW])

    def _leave(self) -> list[float]:
        """Take out what is beyond the end; the first parcels first."""
        p, out, whole = self._parcels, np.zeros(4), 0
        for i in range(p.shape[1]):
            over = float(p[FRONT, i]) - 1.0
            if over <= 0.0:
                break
            if over >= float(p[WIDTH, i]) - 1e-12:
                out += p[EAR:SCALE, i]
                whole += 1
                continue
            gone = p[EAR:SCALE, i] * (over / float(p[WIDTH, i]))
            p[EAR:SCALE, i] -= gone
            p[WIDTH, i] -= over
            p[FRONT, i] = 1.0
            out += gone
        self._parcels = p[:, whole:]
        result: list[float] = out.tolist()
        return result


TOTALS = ("tank", "lost", "straw", "unloaded")
PARTS = ("_spread", "_header", "_feeder", "_rotor", "_shoe", "_returns", "_elevator", "_lift")
JOINED = 0.02  # transports join what entered within this time [s], or this share of their length
RETURNS_MAX = 0.3  # of the shoe's grain


@dataclass(frozen=True)
class Params:
    """Threshing, separation and cleaning.

    straw: `swath` = laid in a swath, `chop` = chopped and spread over the header's width
    swath_width_m: width of the straw swath
    swath_step_m: travel after which the straw dropped on it is laid down in a swath
    spread_step_m: travel after which the straw dropped on it is spread
    threshability: factor on threshing and separation [1]; 1 = dry wheat, 0.8 = moist straw in the evening,
        where losses are 2 to 4 times as high
    tank_start_percent: level of grain in the tank at the start
    unload_at_percent: level at which the tank is emptied while driving, none = never; a slot `unload` empties
        it instead
    """

    straw: Literal["swath", "chop"] = "swath"
    swath_width_m: Annotated[float, Gt(0), Le(15)] = 1.4
    swath_step_m: Annotated[float, Gt(0), Le(5)] = 0.25
    spread_step_m: Annotated[float, Gt(0), Le(20)] = 1.5
    threshability: Annotated[float, Ge(0.2), Le(3)] = 1.0
    tank_start_percent: Annotated[float, Ge(0), Le(100)] = 0.0
    unload_at_percent: Annotated[float, Gt(0), Le(100)] | None = None


@dataclass
class Flows:
    """Masses of one step [kg]; unthreshed, separation, cleaning: grain lost by each."""

    header: float = 0.0
    feeder: float = 0.0
    drum: float = 0.0
    rotor: float = 0.0
    shoe: float = 0.0
    chopper: float = 0.0
    returns: float = 0.0
    unloaded: float = 0.0
    tank: float = 0.0
    straw: float = 0.0
    unthreshed: float = 0.0
    separation: float = 0.0
    cleaning: float = 0.0


class ThreshingProcess(KeepsState):
    """Transport, threshing, separation and cleaning with delays and losses that depend on the load."""

    kept = (*PARTS, "_totals", "_tank_start", "_back", "_loss_share", "_shoe_loss", "_is_unloading",
            "_outlet")  # fmt: skip
    steps_any_length = True

    inputs = (
        Port("flow", CropFlow, history=True),
        Port("state", MachineState),
        Port("engine", EngineState, optional=True),
        Port("unload", UnloadState, optional=True),
    )
    outputs = (Port("load", MachineLoad),)

    def __init__(self, params: Params, setup: SiteSetup) -> None:
        p, w = params, drivetrain_of(setup.machine)
        self._p, self._drivetrain = p, w
        rear, is_swath = setup.machine.body[0], p.straw == "swath"
        width, step = p.swath_width_m, p.swath_step_m
        if not is_swath:
            width, step = setup.machine.header_width, p.spread_step_m
        self._outlet = StrawOutlet(setup.field, rear, width, step, ridge=is_swath)
        self._pipe = UnloadingPipe(setup)
        self._tank_start = w.tank * p.tank_start_percent * PERCENT
        t = w.transport
        self._spread, self._lift = Mixer(2), Mixer(1)
        self._header = Conveyor(1.0, 2, joined=JOINED)
        self._feeder = Conveyor(t.feeder, 2, joined=JOINED)
        self._shoe = Conveyor(t.shoe, 2, joined=JOINED)
        self._elevator = Conveyor(1.0, 1, joined=JOINED / 2)
        self._returns = Conveyor(t.returns, 2, joined=JOINED)
        d = w.threshing
        self._rotor = Rotor(d.rotor_threshing, d.rotor_separation, d.rotor_exponent, t.rotor)

    def reset(self, stream: Stream) -> Outputs:
        """Empty, but for the tank's start."""
        for part in PARTS:
            getattr(self, part).clear()
        self._totals = {name: Total() for name in TOTALS}
        self._back = [0.0, 0.0]
        self._loss_share, self._shoe_loss, self._is_unloading = 0.0, 0.0, False
        self._outlet.reset()
        return {"load": self._load(0, 1.0, Flows())}

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """Move everything on by dt; the engine's speed of the last sample drives it."""
        h = dt / NS
        engine: EngineState | None = inputs.get("engine")
        ratio = 1.0 if engine is None else engine.speed_ratio
        flows = Flows()
        fed = self._feed(inputs["flow"], h, ratio, flows)
        pan = self._thresh(fed, h, ratio, flows)
        clean = self._clean(pan, h, ratio, inputs["state"], flows)
        unload: UnloadState | None = inputs.get("unload")
        self._store(clean, h, ratio, flows, unload)
        over = float(self._drivetrain.bulk.over_rim(self._content(), flows.tank))
        self._totals["tank"].add(flows.tank - over)
        for loss in (flows.unthreshed, flows.separation, flows.cleaning, over):
            self._totals["lost"].add(loss)
        self._totals["straw"].add(flows.straw)
        self._outlet.drop(flows.straw, inputs["state"])
        if unload is None:
            self._pipe.pour(flows.unloaded, inputs["state"])
        return {"load": self._load(t + dt, h, flows)}

    def _feed(self, cut: tuple[CropFlow, ...], h: float, ratio: float, flows: Flows) -> Masses:
        """Header and feeder house: grain and straw [kg] that reach the drum."""
        t = self._drivetrain.transport
        masses = [fsum(f.grain for f in cut), fsum(f.straw for f in cut)]
        flows.header = fsum(masses)
        spread = self._spread.advance(masses, h, t.header_spread)
        delay = flow_delay(fsum(self._header.held()) + fsum(spread), t.header, t.feed, t.exponent)
        gathered = self._header.advance(spread, h * ratio / delay)
        flows.feeder = fsum(gathered)
        return self._feeder.advance(gathered, h * ratio)

    def _thresh(self, fed: Masses, h: float, ratio: float, flows: Flows) -> Masses:
        """Drum and rotors: grain and chaff [kg] that fall through."""
        d, threshability = self._drivetrain.threshing, self._p.threshability * ratio
        back = self._returns.advance(self._back, h * ratio)
        grain, straw = fed[0] + back[0], fed[1] + back[1]
        flows.drum, flows.returns = grain + straw, fsum(back)
        layer = straw / h / d.straw / max(ratio, 0.05)
        scale = threshability * max(layer, 1e-3) ** -d.drum_exponent
        ear, free = coupled(grain, 0.0, d.drum_threshing * scale, d.drum_separation * scale)
        chaff, through = straw * d.chaff, grain - ear - free
        crop = (ear, free, straw - chaff, grain)
        more, out = self._rotor.advance(crop, layer=layer, dt=h, ratio=ratio, threshability=threshability)
        flows.rotor = straw
        flows.unthreshed, flows.separation, flows.straw, leaving = out
        if leaving > 0.0:
            self._loss_share = (flows.unthreshed + flows.separation) / leaving
        return [through + more, chaff]

    def _clean(self, pan: Masses, h: float, ratio: float, state: MachineState, flows: Flows) -> Masses:
        """Shoe: clean grain [kg]; some goes over the rear with the chaff, some back to the drum."""
        c = self._drivetrain.cleaning
        grain, chaff = self._shoe.advance(pan, h * ratio)
        flows.shoe = grain + chaff
        load = shoe_load(flows.shoe / h, c, state)
        self._shoe_loss = shoe_loss(load, c) if grain > 0.0 else 0.0
        back = min(c.returns * load, RETURNS_MAX)
        flows.cleaning = grain * self._shoe_loss
        self._back = [(grain - flows.cleaning) * back, chaff * back]
        flows.straw += chaff - self._back[1]
        return [grain - flows.cleaning - self._back[0]]

    def _store(self, clean: Masses, h: float, ratio: float, flows: Flows, unload: UnloadState | None) -> None:
        """Elevator and tank; what an auger of its own slot drew is booked."""
        t, w = self._drivetrain.transport, self._drivetrain
        delay = flow_delay(self._elevator.held()[0] + clean[0], t.elevator, t.grain_feed, t.exponent)
        (flows.tank,) = self._lift.advance(
            self._elevator.advance(clean, h * ratio / delay), h, t.elevator_lag
        )
        flows.chopper = flows.straw if self._p.straw == "chop" else 0.0
        if unload is not None:
            flows.unloaded = max(unload.drawn - self._totals["unloaded"].value, 0.0)
            self._totals["unloaded"].add(flows.unloaded)
            return
        if self._p.unload_at_percent is None:
            return
        content = self._content()
        if content >= w.tank * self._p.unload_at_percent * PERCENT:
            self._is_unloading = True
        if self._is_unloading:
            flows.unloaded = min(w.unloading * h * ratio, content)
            self._is_unloading = flows.unloaded < content
            self._totals["unloaded"].add(flows.unloaded)

    def _content(self) -> float:
        """Grain in the tank [kg]."""
        return self._tank_start + self._totals["tank"].value - self._totals["unloaded"].value

    def _held(self) -> tuple[float, float]:
        """Grain and straw inside [kg]."""
        both = (self._spread, self._header, self._feeder, self._shoe, self._returns)
        held = [part.held() for part in both] + [list(self._rotor.held()), self._back]
        grain = fsum(h[0] for h in held) + self._elevator.held()[0] + self._lift.held()[0]
        return grain, fsum(h[1] for h in held)

    def _load(self, t: int, h: float, f: Flows) -> MachineLoad:
        grain, straw = self._held()
        rotors = self._loss_share
        is_running = f.unthreshed + f.separation + f.cleaning > 0.0
        return MachineLoad(
            t,
            self._content(),
            self._totals["lost"].value,
            self._totals["straw"].value,
            grain,
            straw,
            f.tank / h,
            f.straw / h,
            unloaded_grain=self._totals["unloaded"].value,
            tank_start=self._tank_start,
            header_flow=f.header / h,
            feeder_flow=f.feeder / h,
            drum_flow=f.drum / h,
            rotor_flow=f.rotor / h,
            shoe_flow=f.shoe / h,
            chopper_flow=f.chopper / h,
            return_flow=f.returns / h,
            unload_flow=f.unloaded / h,
            threshing_loss=f.unthreshed / h,
            separation_loss=f.separation / h,
            cleaning_loss=f.cleaning / h,
            loss_share=rotors + (1.0 - rotors) * self._shoe_loss if is_running else 0.0,
            tank_level=self._content() / self._drivetrain.tank if self._drivetrain.tank > 0.0 else 0.0,
        )


def shoe_load(flow: float, shoe: Cleaning, state: MachineState) -> float:
    """Load of the shoe over its nominal one: grain and chaff [kg/s], heavier on a slope."""
    rise, side, up = (float(v) for v in state.pose.rotation[2])  # -sin(pitch), tan(roll) * up
    slope = shoe.side_slope * abs(side / up) + shoe.up_slope * max(0.0, rise / hypot(side, up))
    return flow / shoe.flow * (1.0 + slope)


def shoe_loss(load: float, shoe: Cleaning) -> float:
    """Share of the grain on the shoe that goes over the rear."""
    over = min(max(0.0, load - shoe.knee) / shoe.doubling, 30.0)
    return float(min(1.0, shoe.loss * 2.0**over))


LEVEL = Level(
    ThreshingProcess,
    Params,
    summary="feeder, drum, rotors, shoe, returns, elevator, tank: delays and losses that depend on the load",
    cost="about 90 us per step, 70 us more when straw is laid",
    tolerance="steady losses equal the closed forms, mass within 1e-12; the rates are fitted to one machine",
    numbers=("transport", "threshing", "cleaning"),
    checked=(SPEED, *SLOPES),
)
