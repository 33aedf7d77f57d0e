"""A network of the user's, an ONNX file, between samples and numbers: what the levels `onnx` share.

It runs on one thread, by onnxruntime, with those rewrites of the graph alone that do not depend on the
processor. So the same samples give the same bytes on one processor, whatever else runs. Between processors
the last bits of sums may differ, as onnxruntime takes its kernels by what instructions there are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from swath.core import portable
from swath.core.component import Inputs, KeepsState, Port
from swath.core.errors import Extra, InputError, near_miss
from swath.core.files.read_file import open_to_read
from swath.core.foreign_code import need_allowed
from swath.core.frames import Pose
from swath.signals import F64, Image, Inertial, Odometry, Scan, Signal
from swath.signals.flat import flat_fields, read

MOST_BYTES, LONGEST = 1 << 30, 160  # of a file; characters of what onnxruntime says
PORTS = {  # that a network may be fed from, by name; `scan_left`, `image_rear` ... need wires
    "scan": Port("scan", Scan, unit="m", shape=(None,)),
    "image": Port("image", Image),
    "odometry": Port("odometry", Odometry),
    "inertial": Port("inertial", Inertial),
}
SEEN = "scan", "image"  # the network answers when one of these is new
POINTS = "points"  # beside the fields of a scan or an image
TYPES = {
    "tensor(float)": np.float32, "tensor(double)": np.float64, "tensor(float16)": np.float16,
    "tensor(uint8)": np.uint8, "tensor(int32)": np.int32, "tensor(int64)": np.int64,
}  # fmt: skip
Array = NDArray[Any]


@dataclass(frozen=True)
class Into:
    """What an input of the network is given: (field - mean) / sd.

    field: `port.field` of a sample, such as scan.ranges or image.colour; `scan.points` and `image.points` (of
        the depth) are x, y, z in the machine's frame [m]
    mean: of a field, in its SI unit; a list: along its last axis
    sd: as mean
    none: what the network is given where a number is nan
    last: so many newest samples, the oldest first, on an axis before the others; none before the first
    channels: where the channels of a picture go

    InputError for an sd of 0.
    """

    field: str
    mean: float | list[float] = 0.0
    sd: float | list[float] = 1.0
    none: float = 0.0
    last: Annotated[int, Ge(1), Le(1000)] = 1
    channels: Literal["last", "first"] = "last"

    def __post_init__(self) -> None:
        if not np.all(np.asarray(self.sd)):
            raise InputError("sd", self.sd, "expected numbers that are not 0")

    @property
    def port(self) -> str:
        """The port that it comes from."""
        return self.field.partition(".")[0]


@dataclass(frozen=True)
class From:
    """Where a number, or a column of numbers, comes from: add + scale * law(tensor).

    tensor: output of the network
    index: along its last axis; none = the whole tensor
    law: what is done to it first
    scale: to the SI unit of the field
    add: in that unit
    """

    tensor: str
    index: Annotated[int, Ge(0)] | None = None
    law: Literal["none", "exp", "sigmoid"] = "none"
    scale: float = 1.0
    add: float = 0.0

    def of(self, answer: Mapping[str, Array], key: str) -> F64:
        """The numbers (n,). InputError for an index that is not there."""
        try:
            whole = np.asarray(answer[self.tensor], dtype=np.float64)
        except (TypeError, ValueError):  # texts, or lists of tensors
            raise InputError(f"{key}.tensor", self.tensor, "expected a tensor of numbers") from None
        if self.index is not None:
            if whole.ndim == 0 or self.index >= whole.shape[-1]:
                shape = f"{self.tensor} has shape {list(whole.shape)}"
                raise InputError(f"{key}.index", self.index, f"expected a place on its last axis: {shape}")
            whole = whole[..., self.index]
        if self.law == "exp":
            whole = np.asarray(portable.exp(whole))
        elif self.law == "sigmoid":
            whole = np.asarray(1.0 / (1.0 + portable.exp(-whole)))
        return np.ravel(self.add + self.scale * whole)


Told = dict[str, From | float]
"""What each field of a sample is told by: the network, or a number that is always the same."""


class Network(KeepsState):
    """The network with its inputs and outputs.

    ports: that it is fed from; mountings: by port pose_machine_sensor
    """

    kept = ("_newest", "_seen")

    def __init__(
        self, file: str, inputs: Mapping[str, Into], outputs: Told, mountings: Mapping[str, Pose]
    ) -> None:
        need_allowed("file", file)
        with Extra("onnx", "a network (level onnx)"):
            import onnxruntime
        with open_to_read(Path(file), "file", "a network in ONNX", MOST_BYTES) as opened:
            data = opened.read()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # of a library in C++, one class each
            expected = f"expected a network (ONNX): {_reason(error)}"
            raise InputError("file", file, expected) from error
        self._inputs, self._mountings = dict(inputs), mountings
        self._wanted = {each.name: each for each in self._session.get_inputs()}
        _check_names("inputs", self._inputs, self._wanted, "inputs of the network")
        given = [each.name for each in self._session.get_outputs()]
        for field, told in outputs.items():
            if isinstance(told, From) and told.tensor not in given:
                expected = f"expected an output of the network: {', '.join(given)}"
                raise InputError(f"outputs.{field}.tensor", told.tensor, expected)
        self._told = outputs
        ports = {into.port: _port(f"inputs.{n}.field", into, mountings) for n, into in inputs.items()}
        self.ports = tuple(ports.values())
        self.forget()

    def forget(self) -> None:
        """Nothing was seen."""
        self._newest: dict[str, list[Any]] = {}  # by input: what it was given of the newest samples
        self._seen: dict[str, int] = {}  # time of the newest sample by port

    def take(self, inputs: Inputs) -> bool:
        """Take what is new; whether the network is to answer."""
        new = {}
        for port in self.ports:
            sample = inputs.get(port.name)
            if sample is not None and sample.t > self._seen.get(port.name, 0):
                self._seen[port.name], new[port.name] = sample.t, sample
        for name, into in self._inputs.items():
            if into.port in new:
                held = self._newest.setdefault(name, [])
                held.append(self._values(name, new[into.port]))
                del held[: -into.last]
        senses = [p.name for p in self.ports if p.name.partition("_")[0] in SEEN]
        return len(self._newest) == len(self._inputs) and any(name in new for name in senses or self._seen)

    def answer(self) -> dict[str, F64]:
        """Each field's numbers (n,), by what was taken last. InputError where shapes do not fit."""
        fed = {name: self._shaped(name, self._newest[name]) for name in self._inputs}
        names = sorted({told.tensor for told in self._told.values() if isinstance(told, From)})
        try:
            got = dict(zip(names, self._session.run(names, fed), strict=True))
        except Exception as error:
            raise InputError("file", None, f"expected a network that runs: {_reason(error)}") from error
        return {
            field: told.of(got, f"outputs.{field}") if isinstance(told, From) else np.array([told])
            for field, told in self._told.items()
        }

    def _values(self, name: str, sample: Signal) -> Array:
        """What a sample gives an input, nan as it is."""
        into = self._inputs[name]
        field = into.field.partition(".")[2]
        if field == POINTS and isinstance(sample, Scan | Image):
            points = sample.points() if isinstance(sample, Scan) else _of_depth(sample)
            value = self._mountings[into.port].apply(points.reshape(-1, 3)).reshape(points.shape)
        else:
            value = np.asarray(read(sample, field), dtype=np.float64)
        for key, numbers in (("mean", into.mean), ("sd", into.sd)):
            wide = (value.shape or (1,))[-1]
            if isinstance(numbers, list) and len(numbers) != wide:
                expected = f"expected one number, or {wide} as on its last axis"
                raise InputError(f"inputs.{name}.{key}", numbers, expected)
        value = (value - np.asarray(into.mean)) / np.asarray(into.sd)
        value = np.where(np.isnan(value), into.none, value)
        return np.moveaxis(value, -1, 0) if into.channels == "first" else value

    def _shaped(self, name: str, held: Sequence[Array]) -> Array:
        """The samples held in the shape that the network declares."""
        into, wanted = self._inputs[name], self._wanted[name]
        rows = [*[np.full_like(held[0], into.none)] * (into.last - len(held)), *held]
        value = np.stack(rows) if into.last > 1 else rows[0]
        shape = _fitting(value.shape, wanted.shape)
        if shape is None or wanted.type not in TYPES:
            what = f"{list(wanted.shape)} of {wanted.type}"
            expected = f"expected what fits the network's {what}, this is {list(value.shape)}"
            raise InputError(f"inputs.{name}.field", into.field, expected)
        return value.reshape(shape).astype(TYPES[wanted.type])


def _reason(error: Exception) -> str:
    """What onnxruntime says, without its numbers and names of classes."""
    return str(error).partition("\n")[0].rpartition(" : ")[2][:LONGEST]


def _fitting(given: Sequence[int], declared: Sequence[Any]) -> list[int] | None:
    """Sizes of the declared axes, of which some are open: the given ones, axes of 1 left out or put
    before; else all numbers in their order, with 1 for what is open. None where neither fits.
    """
    sizes, free = [n for n in given if n != 1], [k for k, size in enumerate(declared) if size != 1]
    shape = [1] * len(declared)
    for k, size in zip(free, [1] * (len(free) - len(sizes)) + sizes, strict=False):
        shape[k] = size
    flat = [size if isinstance(size, int) else 1 for size in declared]
    for found in (shape, flat):
        is_declared = all(not isinstance(b, int) or a == b for a, b in zip(found, declared, strict=True))
        if is_declared and prod(found) == prod(given):
            return found
    return None


def _check_names(key: str, given: Mapping[str, Any], wanted: Mapping[str, Any], what: str) -> None:
    for name in given:
        if name not in wanted:
            expected = f"expected {what}: {', '.join(wanted)}{near_miss(name, [*wanted])}"
            raise InputError(f"{key}.{name}", None, expected)
    if missing := [name for name in wanted if name not in given]:
        raise InputError(key, ", ".join(given) or "none", f"expected all {what}, also {', '.join(missing)}")


def _port(key: str, into: Into, mountings: Mapping[str, Pose]) -> Port:
    """The port that an input comes from. InputError for a field that its samples do not have."""
    kind = PORTS.get(into.port, PORTS.get(into.port.partition("_")[0]))
    if kind is None:
        raise InputError(key, into.field, f"expected a field of {', '.join(PORTS)}, such as scan.ranges")
    field, points = into.field.partition(".")[2], [POINTS] if kind.name in SEEN else []
    fields = [*flat_fields(kind.signal), *points]
    if field not in fields:
        raise InputError(key, into.field, f"expected one of {', '.join(fields)}{near_miss(field, fields)}")
    if field == POINTS and into.port not in mountings:
        raise InputError(key, into.field, "expected a port that is wired to a sensor with a mounting")
    return Port(into.port, kind.signal, kind.unit, kind.shape)


def _of_depth(image: Image) -> F64:
    """Points in the camera's frame (x forward, y left, z up) from a depth along its axis [m], (h, w, 3)."""
    depth = image.depth.astype(np.float64)
    rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]]
    across = -(columns - image.centre_x) / image.focal * depth
    up = -(rows - image.centre_y) / image.focal * depth
    return np.stack([depth, across, up], axis=-1)
