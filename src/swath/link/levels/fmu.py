"""Level `fmu` of any slot: a model from Simulink, Modelica or elsewhere, exported as a co-simulation FMU.

What it needs and gives is mapped to ports by name or in the scenario; docs/how-to/simulink.md has the rules.

`Feed` gives its inputs their numbers sub-step by sub-step, so that amounts neither vanish nor double.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import accumulate, pairwise
from math import isfinite, isnan
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from swath.core.component import Inputs, Outputs, State
from swath.core.errors import InputError, SwathError
from swath.core.foreign_code import need_allowed
from swath.core.random import Stream
from swath.core.registry import Level
from swath.core.schedule import NS
from swath.link.fmi.calls import FmuError
from swath.link.fmi.composite import Composite, describe_system
from swath.link.fmi.description import Description, read_fmu
from swath.link.fmi.ssp import SUFFIXES, System, read_system
from swath.link.fmi.unit import Unit, make_unit
from swath.link.fmi.wiring import KNOWN, Into, Wiring, make_wiring
from swath.signals import Signal
from swath.signals.flat import build, read
from swath.signals.setup import LinkSetup


class Feed:
    """Holds the newest values, and spreads amounts over the sub-steps in which they arose.

    A sample of amounts covers the time (t - dt, t]. What lies before the step of the FMU counts at its start.
    A single number that is nan, which says that there is none, leaves the FMU the value before, at first its
    start value; with passes_nan it gets nan.
    silent: ports of which nothing came; unknown: port.field that is nan now -> what nan means
    held: port.field -> steps in which the value before was held
    """

    def __init__(self, inputs: Sequence[Into], starts: Sequence[float], *, passes_nan: bool = False) -> None:
        ends = accumulate(i.variable.size for i in inputs)
        placed = [
            (into, slice(end - into.variable.size, end)) for into, end in zip(inputs, ends, strict=True)
        ]
        self._held = [p for p in placed if p[0].mode in ("last", "known")]
        self._amounts = [p for p in placed if p[0].mode not in ("last", "known")]
        self._starts, self._passes_nan = list(starts), passes_nan
        self.reset()

    def reset(self) -> None:
        """Start values, nothing fed."""
        self._numbers = list(self._starts)
        self._samples: dict[str, list[tuple[int, int, Signal]]] = {}
        self.silent: list[str] = []
        self.unknown: dict[str, str] = {}
        self.held: Counter[str] = Counter()

    def take(self, t: int, dt: int, inputs: Inputs) -> None:
        """The inputs of a step from t to t + dt [ns]."""
        self.unknown = {}
        for into, place in self._held:
            sample = inputs.get(into.port)
            if sample is None and into.port not in self.silent:
                self.silent.append(into.port)
            if isinstance(sample, tuple):
                sample = sample[-1] if sample else None
            if sample is not None:
                self._take(into, place, read(sample, into.field.name))
        for port in {into.port for into, _ in self._amounts}:
            self._samples[port] = [_span(s, t, t + dt) for s in inputs.get(port) or ()]

    def numbers(self, a: int, b: int) -> list[float]:
        """All inputs for the sub-step from a to b [ns], arrays element by element."""
        for into, place in self._amounts:
            total = 0.0
            for start, end, sample in self._samples.get(into.port, ()):
                overlap = min(end, b) - max(start, a)
                if overlap > 0:
                    total += read(sample, into.field.name) * (overlap / (end - start))
            self._put(into, place, total * NS / (b - a) if into.mode == "rate" else total)
        return list(self._numbers)

    def save(self) -> dict[str, Any]:
        """The values held."""
        return {"numbers": list(self._numbers), "held": dict(self.held)}

    def load(self, state: Mapping[str, Any]) -> None:
        """Take on states that `save` gave."""
        self._numbers, self.held = list(state["numbers"]), Counter(state["held"])

    def _take(self, into: Into, place: slice, value: Any) -> None:
        is_known = into.field.kind == "array" or not isnan(value)
        name = f"{into.port}.{into.field.name}"
        if into.mode == "known":
            self._numbers[place.start] = float(is_known)
        elif is_known or not into.field.quantity.nan:
            self._put(into, place, value)
        else:
            self.unknown[name] = into.field.quantity.nan
            if self._passes_nan:
                self._put(into, place, value)
            else:
                self.held[name] += 1

    def _put(self, into: Into, place: slice, value: Any) -> None:
        if not into.variable.is_array:
            self._numbers[place.start] = into.scale.theirs(float(value))
            return
        numbers = np.asarray(value, dtype=np.float64).ravel()
        if len(numbers) != into.variable.size:
            raise FmuError(
                f"{into.port}.{into.field.name} has {len(numbers)} numbers, "
                f"but {into.variable.name} of the FMU takes {into.variable.size}"
            )
        self._numbers[place] = (numbers if into.scale.is_same else into.scale.theirs(numbers)).tolist()


def _span(sample: Signal, start: int, end: int) -> tuple[int, int, Signal]:
    """The time that a sample of amounts covers within a step [ns]."""
    covered = round(float(getattr(sample, "dt", 0.0)) * NS)
    first, last = max(sample.t - covered, start), min(sample.t, end)
    return (start, start + 1, sample) if last <= first else (first, last, sample)


class FmuPart:
    """Fills a slot with an FMU, or with a composite that looks like one.

    step: of the FMU within the slot's period [ns]
    notes: about the FMU itself
    """

    def __init__(
        self,
        wiring: Wiring,
        unit: Unit,
        setup: LinkSetup,
        file: Path,
        step: int,
        notes: Sequence[str],
        *,
        passes_nan: bool = False,
    ) -> None:
        self.inputs, self.outputs = wiring.input_ports, wiring.output_ports
        self._wiring, self._unit, self._step_ns = wiring, unit, step
        self._slot, self._file, self._who = setup.slot, file.name, f"{setup.name}: {file.name}"
        self._notes = (*notes, *wiring.notes)
        starts = [i.variable.numbers(wiring.starts.get(i.variable.name)) for i in wiring.inputs]
        flat = [x for numbers in starts for x in numbers]
        self._feed = Feed(wiring.inputs, flat, passes_nan=passes_nan)

    @property
    def notes(self) -> list[str]:
        """What the user should know about the run."""
        silent = [f"nothing comes from {port}, its slot is off or silent" for port in self._feed.silent]
        held = [
            f"{name} was nan in {count} steps: the FMU got the value before; {name}{KNOWN} would say so"
            for name, count in self._feed.held.items()
            if not self._is_told(name)
        ]
        notes = (*self._notes, *self._unit.notes, *silent, *held)
        return [f"{self._slot}: {self._file}: {note}" for note in notes]

    def reset(self, stream: Stream) -> Outputs:
        """The FMU initialised with its start values; its outputs at t = 0."""
        self._feed.reset()
        with self._named(" at the start"):
            return samples_of(self._wiring, 0, self._unit.start(self._wiring.starts))

    def step(self, t: int, dt: int, inputs: Inputs) -> Outputs:
        """The FMU from t to t + dt, in sub-steps when they are shorter."""
        with self._named(f" at t = {t / NS:.4g} s" if t else " at the start"):
            self._feed.take(t, dt, inputs)
            end = t + dt
            over = dt // self._step_ns  # ns that steps of whole ns may leave over: they are no step
            spans = pairwise([*range(t, end - over, self._step_ns), end])
            steps = [(at / NS, (to - at) / NS, self._feed.numbers(at, to)) for at, to in spans]
            numbers = self._unit.run(steps)
            try:
                return samples_of(self._wiring, end, numbers)
            except FmuError as error:
                nan = [f"{name} is nan ({means})" for name, means in self._feed.unknown.items()]
                raise FmuError("; ".join([str(error), *nan])) from error

    def _is_told(self, name: str) -> bool:
        """Whether the FMU has an input that says so when it holds a value."""
        return any(i.mode == "known" and f"{i.port}.{i.field.name}" == name for i in self._wiring.inputs)

    def save(self) -> State:
        """The state of the FMU. SwathError for an FMU that cannot save it."""
        with self._named():
            return {"fmu": self._unit.save(), "feed": self._feed.save()}

    def load(self, state: State) -> None:
        """Take on a state that `save` gave."""
        self._feed.load(state["feed"])
        with self._named():
            self._unit.load(state["fmu"])

    def close(self) -> None:
        """Let go of the FMU."""
        self._unit.close()

    @contextmanager
    def _named(self, when: str = "") -> Iterator[None]:
        """Errors of the FMU with slot, file and time."""
        try:
            yield
        except FmuError as error:
            raise SwathError(f"{self._who}{when}: {error}") from error


def samples_of(wiring: Wiring, t: int, numbers: Sequence[float]) -> Outputs:
    """The outputs at t [ns] from the flat list. FmuError where the FMU gives what is not a number."""
    values = {p.name: dict(wiring.constants.get(p.name, {})) for p in wiring.output_ports}
    at = 0
    for out in wiring.outputs:
        variable, scale = out.variable, out.scale
        own, at = numbers[at : at + variable.size], at + variable.size
        if not out.field.quantity.nan and not all(map(isfinite, own)):
            bad = next(x for x in own if not isfinite(x))
            raise FmuError(f"its variable {variable.name} is {bad}, expected a finite number")
        if variable.is_array:
            value: Any = scale.ours(np.asarray(own, dtype=np.float64))
        else:
            value = own[0] if scale.is_same else scale.ours(own[0])
        values[out.port][out.field.name] = value
    return {p.name: build(p.signal, t, values[p.name]) for p in wiring.output_ports}


TOOL = "swath "  # what the FMUs that swath exports name as their tool; they know nan


@dataclass(frozen=True)
class Params:
    """file: the FMU (FMI 1, 2 or 3, co-simulation), or a system of several (.ssp, .ssd).

    inputs: variable of the FMU -> port.field that feeds it; where the names fit, it need not be written.
        `flow.grain` of the header is the mass of a step [kg], `flow.grain/s` the flow [kg/s];
        `edge.offset.is_known` is 1 where the number is there, 0 where it is nan
    outputs: port.field -> variable of the FMU, likewise
    constants: port.field -> value, for what the FMU does not give; `nan` where nan means nothing
    parameters: variable of the FMU -> start value, in the FMU's own unit
    units: variable of the FMU -> unit such as km/h, where the FMU names none or a wrong one
    nan: what the FMU gets for a single number that is nan, `hold` = the value before, or `pass` = nan; null =
        pass to FMUs that swath exported, else hold
    step_ms: step of the FMU within the slot's period; null = the whole period
    component: of a system, the one FMU that fills this slot; null = the whole system
    process: `here`, or `own` = a process of its own, whose crash or hang is an error that names it
    timeout_s: for an answer of its own process
    """

    file: str
    inputs: dict[str, str] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    constants: dict[str, bool | float | Literal["nan"] | list[float]] = field(default_factory=dict)
    parameters: dict[str, bool | float | str | list[float]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    nan: Literal["hold", "pass"] | None = None
    step_ms: Annotated[float, Gt(0), Le(1e6)] | None = None
    component: str | None = None
    process: Literal["here", "own"] = "here"
    timeout_s: Annotated[float, Gt(0), Ge(0.1), Le(3600)] = 10.0

    @property
    def foreign_code(self) -> tuple[str, ...]:
        """The FMU: foreign code."""
        return (self.file,)


def make_part(params: Params, setup: LinkSetup) -> FmuPart:
    """The component. InputError where the FMU, a name, a unit or a step does not fit."""
    file = setup.base / params.file
    need_allowed("file", file)
    whole, params = _open(file, params)
    fmu = describe_system(whole)[0] if isinstance(whole, System) else whole
    wiring = make_wiring(fmu, setup, params)
    step = _step(params, fmu, setup.control.period)
    inputs, outputs = [i.variable for i in wiring.inputs], [o.variable for o in wiring.outputs]
    where: Any = {"own": params.process == "own", "timeout_s": params.timeout_s}
    if isinstance(whole, System):
        unit: Unit = Composite(whole, setup.name, inputs, outputs, **where)
    else:
        unit = make_unit(whole, setup.name, inputs, outputs, **where)
    is_own = fmu.tool.startswith(TOOL)
    passes = is_own if params.nan is None else params.nan == "pass"
    return FmuPart(wiring, unit, setup, file, step, _notes(fmu, step), passes_nan=passes)


def _open(file: Path, params: Params) -> tuple[Description | System, Params]:
    """The FMU, the system, or the one component of it that was named, with the start values it has there."""
    if file.suffix.lower() not in SUFFIXES:
        if params.component is not None:
            raise InputError("component", params.component, f"expected a file {' or '.join(SUFFIXES)}")
        return read_fmu(file).sized(params.parameters), params
    system = read_system(file)
    if params.component is None:
        return system, params
    if params.component not in system.components:
        listed = ", ".join(system.components)
        raise InputError("component", params.component, f"expected one of {listed}")
    fmu = system.components[params.component]
    own = {name: value for (path, name), value in system.starts.items() if path == params.component}
    params = replace(params, parameters={**own, **params.parameters})
    return replace(fmu.sized(params.parameters), package=system), params


def _step(params: Params, fmu: Description, period: float) -> int:
    """Step of the FMU [ns]. InputError where it cannot take such steps."""
    whole = round(period * 1e9)
    step = whole if params.step_ms is None else min(round(params.step_ms * 1e6), whole)
    if not _is_multiple(whole, step) and not fmu.variable_step:
        text = f"expected a whole part of the slot's period of {whole * 1e-6:g} ms, the FMU has a fixed step"
        raise InputError("step_ms", params.step_ms, text)
    if fmu.fixed_step and not fmu.variable_step:
        own = round(fmu.fixed_step * 1e9)
        if not _is_multiple(step, own):
            text = f"expected a multiple of the FMU's fixed step of {own * 1e-6:g} ms"
            raise InputError("step_ms", step * 1e-6, text)
    return step


def _is_multiple(whole: int, part: int) -> bool:
    """Whether one is several of the other, each rounded to a nanosecond."""
    return abs(whole - (count := round(whole / part)) * part) <= count / 2 + 0.5


def _notes(fmu: Description, step: int) -> list[str]:
    notes = []
    if fmu.faults:
        more = f" (and {len(fmu.faults) - 1} more, see swath fmu check)" if len(fmu.faults) > 1 else ""
        notes.append(f"its description breaks the standard, used all the same: {fmu.faults[0]}{more}")
    own = round((fmu.default_step or 0.0) * 1e9)
    if own and not _is_multiple(step, own) and not fmu.variable_step:
        notes.append(f"it was made for steps of {own * 1e-6:g} ms and takes {step * 1e-6:g} ms; see step_ms")
    if not fmu.saves_state:
        notes.append("its state cannot be saved, nor can a run with it")
    if fmu.needs_tool:
        notes.append("it says that it needs the tool that exported it")
    return notes


LEVEL = Level(
    make_part,
    Params,
    summary="a co-simulation FMU (FMI 1, 2 or 3), or a system of several (SSP)",
    cost="the FMU's own, and about 20 us per step; 50 us in a process of its own",
    tolerance="the FMU's own; masses reach it without loss",
    is_link=True,
)
