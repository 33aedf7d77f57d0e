"""Which number of which port an FMU variable is: as the scenario says, else by name, with units checked."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from swath.core.component import Port
from swath.core.errors import InputError, near_miss
from swath.core.layout import Field
from swath.link.fmi.description import Description, Variable
from swath.link.fmi.units import Scale, Unit, describe, parse_unit, scale
from swath.signals.flat import amounts, flat_fields
from swath.signals.setup import LinkSetup

RATE = "/s"
KNOWN = ".is_known"  # port.field.is_known: whether a number is there, for those that may be nan
Value = Any  # number, boolean, list of numbers


@dataclass(frozen=True)
class Into:
    """An FMU input and the number it gets.

    mode: `last` value, `sum` or `rate` (sum / time) over a step, `known` = whether the last value is a number
    """

    variable: Variable
    port: str
    field: Field
    mode: str
    scale: Scale


@dataclass(frozen=True)
class Out:
    """A number of an output port and the FMU variable it comes from."""

    port: str
    field: Field
    variable: Variable
    scale: Scale


@dataclass(frozen=True)
class Wiring:
    """How an FMU fills its slot.

    inputs, outputs: in the order in which its numbers are passed
    constants: port -> field -> value
    inputs_ports, output_ports: those that it needs and gives
    starts: FMU variable -> start value
    notes: what the user should know
    """

    inputs: tuple[Into, ...]
    outputs: tuple[Out, ...]
    constants: Mapping[str, Mapping[str, Value]]
    input_ports: tuple[Port, ...]
    output_ports: tuple[Port, ...]
    starts: Mapping[str, Value]
    notes: tuple[str, ...]


def make_wiring(fmu: Description, setup: LinkSetup, params: Any) -> Wiring:
    """The wiring of an FMU in a slot.

    params: `inputs`, `outputs`, `constants`, `parameters`, `units` as in the level. InputError where a name,
        a unit or a value does not fit, or something is missing
    """
    return _Maker(fmu, setup, params).make()


class _Maker:
    def __init__(self, fmu: Description, setup: LinkSetup, params: Any) -> None:
        self.fmu, self.setup, self.params = fmu, setup, params
        self.unitless: list[str] = []
        self.notes: list[str] = []

    def make(self) -> Wiring:
        self._check_names()
        inputs = self._inputs()
        constants = self._constants()
        outputs = self._outputs(constants)
        has = {p.name: {o.field.name for o in outputs if o.port == p.name} for p in self.setup.outputs}
        ports = [p for p in self.setup.outputs if has[p.name] or p.name in constants]
        if not ports:
            text = f"expected outputs of the FMU for {_listed(self.setup.outputs[0])}; none of its names fits"
            raise InputError("outputs", None, text)
        for port in ports:
            self._check_whole(port, has[port.name] | set(constants.get(port.name, {})))
        if self.unitless:
            listed = ", ".join(self.unitless)
            self.notes.append(f"variables without a unit are taken in SI units: {listed}")
        used = {i.port for i in inputs}
        return Wiring(
            inputs=tuple(sorted(inputs, key=_call_order)),
            outputs=tuple(sorted(outputs, key=_call_order)),
            constants=constants,
            input_ports=tuple(
                replace(p, history=p.history or bool(amounts(p.signal)))
                for p in self.setup.inputs
                if p.name in used
            ),
            output_ports=tuple(ports),
            starts=dict(self.params.parameters),
            notes=tuple(self.notes),
        )

    def _check_names(self) -> None:
        """Every variable that the scenario names is there, and every start value fits it."""
        for key in ("inputs", "parameters", "units"):
            for name in getattr(self.params, key):
                self._variable(name, f"{key}.{name}")
        for name, unit in self.params.units.items():
            _parsed(name, unit)
        for name, source in self.params.outputs.items():
            self._variable(source, f"outputs.{name}")
        for name, value in self.params.parameters.items():
            variable, text = self.fmu.variables[name], None
            if variable.kind == "other" or variable.causality in ("calculatedParameter", "independent"):
                text = f"expected a variable that can be set, it is of causality {variable.causality}"
            elif (variable.kind == "string") != isinstance(value, str):
                text = "expected text" if variable.kind == "string" else "expected a number"
            elif isinstance(value, list) and len(value) != variable.size:
                text = f"expected {variable.size} numbers"
            if text is not None:
                raise InputError(f"parameters.{name}", value, text)

    def _variable(self, name: str, key: str) -> None:
        if name not in self.fmu.variables:
            hint = near_miss(name, self.fmu.variables)
            text = f"expected a variable of {self.fmu.file.name}{hint} (swath fmu show lists them)"
            raise InputError(key, name, text)

    # inputs

    def _inputs(self) -> list[Into]:
        given: dict[str, str] = dict(self.params.inputs)
        open_ones = []
        for variable in self.fmu.of("input"):
            if variable.name in given or variable.name in self.params.parameters or variable.kind == "other":
                continue
            guess = self._guess(variable)
            if guess is None:
                open_ones.append(variable.name)
            else:
                given[variable.name] = guess
        if open_ones:
            listed = ", ".join(open_ones)
            self.notes.append(f"inputs of the FMU that nothing feeds stay at their start values: {listed}")
        return [self._into(self.fmu.variables[name], target) for name, target in given.items()]

    def _guess(self, variable: Variable) -> str | None:
        """The one number whose name fits that of an input."""
        wanted, hits = _plain(variable.name), []
        for port in self.setup.inputs:
            for name in flat_fields(port.signal):
                for target in (name, name + RATE) if amounts(port.signal) else (name, name + KNOWN):
                    spellings = _spellings(port.name, target)
                    if wanted in spellings:
                        hits.append((spellings.index(wanted), f"{port.name}.{target}"))
        best = [t for rank, t in hits if rank == min(r for r, _ in hits)]
        if len(best) > 1:
            text = f"expected one of {' or '.join(best)}; the name fits each of them"
            raise InputError(f"inputs.{variable.name}", None, text)
        return best[0] if best else None

    def _into(self, variable: Variable, target: str) -> Into:
        key, bare = f"inputs.{variable.name}", target.removesuffix(RATE).removesuffix(KNOWN)
        if variable.causality != "input" and variable.variability != "tunable":
            text = f"expected an input of the FMU, it is of causality {variable.causality}"
            raise InputError(key, target, text)
        _check_kind(key, target, variable)
        port, field = self._field(key, bare, target, self.setup.inputs)
        if variable.is_array != (field.kind == "array"):
            what = "an array" if variable.is_array else "a single number"
            raise InputError(key, target, f"expected {what}, like {variable.name} of the FMU")
        if target.endswith(KNOWN):
            if not field.quantity.nan or variable.is_array:
                raise InputError(key, target, f"expected {bare}: it is always known")
            return Into(variable, port.name, field, "known", Scale())
        adds_up = field.quantity.is_amount
        if bare != target and not adds_up:
            raise InputError(key, target, f"expected {bare}: only amounts have a rate")
        mode = "rate" if bare != target else "sum" if adds_up else "last"
        unit, ours = self._unit(variable), parse_unit(field.unit)
        if unit is not None and mode == "sum" and unit.fits(ours.per_second) and not unit.fits(ours):
            mode = "rate"
        ours = ours.per_second if mode == "rate" else ours
        return Into(variable, port.name, field, mode, self._scale(key, target, variable, unit, ours))

    # outputs

    def _outputs(self, constants: Mapping[str, Mapping[str, Value]]) -> list[Out]:
        outs: dict[tuple[str, str], Out] = {}
        for target, source in self.params.outputs.items():
            key = f"outputs.{target}"
            port, field = self._field(key, target, target, self.setup.outputs)
            outs[port.name, field.name] = self._out(key, port, field, self.fmu.variables[source])
        for port in self.setup.outputs:
            for field in flat_fields(port.signal).values():
                if (port.name, field.name) in outs or field.name in constants.get(port.name, {}):
                    continue
                if (variable := self._guess_output(port, field)) is not None:
                    key = f"outputs.{port.name}.{field.name}"
                    outs[port.name, field.name] = self._out(key, port, field, variable)
        return list(outs.values())

    def _constants(self) -> dict[str, dict[str, Value]]:
        found: dict[str, dict[str, Value]] = {}
        for target, value in self.params.constants.items():
            key = f"constants.{target}"
            port, field = self._field(key, target, target, self.setup.outputs)
            if (field.kind == "array") != isinstance(value, list):
                what = "a list of numbers" if field.kind == "array" else "a number"
                raise InputError(key, value, f"expected {what}")
            found.setdefault(port.name, {})[field.name] = float("nan") if value == "nan" else value
        return found

    def _guess_output(self, port: Port, field: Field) -> Variable | None:
        names = _spellings(port.name, field.name)
        fits = [
            v
            for v in self.fmu.of("output")
            if _plain(v.name) in names and v.kind != "other" and v.is_array == (field.kind == "array")
        ]
        return min(fits, key=lambda v: names.index(_plain(v.name)), default=None)

    def _out(self, key: str, port: Port, field: Field, variable: Variable) -> Out:
        _check_kind(key, variable.name, variable)
        if variable.is_array != (field.kind == "array"):
            what = "an array" if field.kind == "array" else "a single number"
            raise InputError(key, variable.name, f"expected {what}")
        unit, ours = self._unit(variable), parse_unit(field.unit)
        return Out(port.name, field, variable, self._scale(key, variable.name, variable, unit, ours))

    def _check_whole(self, port: Port, has: set[str]) -> None:
        fields = flat_fields(port.signal).values()
        if missing := [f"{port.name}.{f.name}" for f in fields if f.default is None and f.name not in has]:
            listed = ", ".join(missing)
            text = f"expected an FMU variable under outputs, or a value under constants, for {listed}"
            raise InputError("outputs", None, text)

    # units

    def _unit(self, variable: Variable) -> Unit | None:
        override = self.params.units.get(variable.name)
        if override is not None:
            return _parsed(variable.name, override)
        if variable.unit is None and variable.unit_name is not None:
            says = f"{variable.unit_name!r} says nothing; write one here"
            raise InputError(f"units.{variable.name}", None, f"expected a unit that the FMU defines, {says}")
        return variable.unit

    def _scale(self, key: str, value: str, variable: Variable, theirs: Unit | None, ours: Unit) -> Scale:
        if theirs is None:
            if ours.name and variable.kind == "real":
                self.unitless.append(f"{variable.name} [{ours.name}]")
            return Scale()
        found = scale(theirs, ours)
        if found is None:
            text = (
                f"expected {ours.name or 'a plain number'}, but {variable.name} is in {theirs.name} "
                f"({describe(theirs)}); units: {{{variable.name}: ...}} overrides what the FMU says"
            )
            raise InputError(key, value, text)
        return found

    def _field(self, key: str, name: str, value: str, ports: tuple[Port, ...]) -> tuple[Port, Field]:
        there = {f"{p.name}.{f}": (p, field) for p in ports for f, field in flat_fields(p.signal).items()}
        if name not in there:
            listed = "; ".join(_listed(p) for p in ports) or "nothing, the slot has no such ports"
            raise InputError(key, value, f"expected port.field of {listed}{near_miss(name, there)}")
        return there[name]


def _check_kind(key: str, value: str, variable: Variable) -> None:
    if not variable.is_number:
        raise InputError(key, value, f"expected a number, {variable.name} is of type {variable.type}")


def _call_order(wire: Into | Out) -> tuple[str, str]:
    """Variables that one call can set or get lie side by side."""
    return wire.variable.type, wire.variable.variability


def _listed(port: Port) -> str:
    return f"{port.name} ({', '.join(flat_fields(port.signal))})"


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def _spellings(port: str, field: str) -> list[str]:
    """Names that an FMU variable may have for a field, the surest first."""
    bare = field.removesuffix(RATE)
    names = [bare] if bare == field else [f"{bare}_flow", f"{bare}_rate"]
    return [_plain(f"{port}.{n}") for n in names] + [_plain(n) for n in names]


def _parsed(name: str, unit: str) -> Unit:
    try:
        return parse_unit(unit)
    except InputError as error:
        raise InputError(f"units.{name}", unit, error.expected) from error
