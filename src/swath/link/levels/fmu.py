"""Level `fmu` of any slot: a model from Simulink, Modelica or elsewhere, exported as a co-simulation FMU.

What it needs and gives is mapped to ports by name or in the scenario; docs/how-to/simulink.md has the rules.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le

from swath.core.errors import InputError
from swath.core.foreign_code import need_allowed
from swath.core.registry import Level
from swath.link.fmi.composite import Composite, describe_system
from swath.link.fmi.description import Description, read_fmu
from swath.link.fmi.part import FmuPart
from swath.link.fmi.ssp import SUFFIXES, System, read_system
from swath.link.fmi.unit import Unit, make_unit
from swath.link.fmi.wiring import make_wiring
from swath.signals.setup import LinkSetup

TOOL = "swath "  # what the FMUs that swath exports name as their tool; they know nan


@dataclass(frozen=True)
class Params:
    """file: the FMU (FMI 1, 2 or 3, co-simulation), or a system of several (.ssp, .ssd)
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
    if whole % step and not fmu.variable_step:
        text = f"expected a whole part of the slot's period of {whole * 1e-6:g} ms, the FMU has a fixed step"
        raise InputError("step_ms", params.step_ms, text)
    if fmu.fixed_step and not fmu.variable_step:
        own = round(fmu.fixed_step * 1e9)
        if step % own:
            text = f"expected a multiple of the FMU's fixed step of {own * 1e-6:g} ms"
            raise InputError("step_ms", step * 1e-6, text)
    return step


def _notes(fmu: Description, step: int) -> list[str]:
    notes = []
    if fmu.faults:
        more = f" (and {len(fmu.faults) - 1} more, see swath fmu check)" if len(fmu.faults) > 1 else ""
        notes.append(f"its description breaks the standard, used all the same: {fmu.faults[0]}{more}")
    own = round((fmu.default_step or 0.0) * 1e9)
    if own and step % own and not fmu.variable_step:
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
