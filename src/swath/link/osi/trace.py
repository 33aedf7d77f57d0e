"""A sensor of a recorded run as an OSI trace: one channel, each message after its length in four bytes."""

import struct
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.files.whole_file import new_file
from swath.core.foreign_code import code_unread
from swath.link.osi.messages import TYPES, Writer
from swath.machine.machine_sheet import load_machine
from swath.record.read.feed import exact_samples, exact_topic
from swath.record.read.files import Log, open_log
from swath.record.read.frames import own_mounting
from swath.record.samples import SUFFIX
from swath.runtime.folder import check_run_folder
from swath.scenario.scenario import load_scenario
from swath.signals import MachineState

LENGTH = struct.Struct("<I")


def write_trace(run: Path, out: Path, *, kind: str = "sd", slot: str | None = None) -> int:
    """Write the scans, or the detections of a radar, of a run folder to `out`; returns how many.

    kind: `sd` SensorData, `sv` SensorView; slot: such as `combine.lidar`, None = the first scanner that was
    recorded, else the first radar. InputError where the run has none, or not bit for bit; MissingExtra.
    """
    if kind not in TYPES:
        raise InputError("--type", kind, f"expected one of {', '.join(TYPES)}")
    if out.suffix != ".osi":
        raise InputError("--out", str(out), "expected a file such as x.osi")
    check_run_folder(run, "scenario.yaml")
    log = open_log(run)
    with code_unread():
        scenario = load_scenario(run)
    sensors = _sensors(log)
    if slot not in (None, *sensors):
        listed = ", ".join(sensors)
        raise InputError("--slot", slot, f"expected a scanner or radar of the recording: {listed}")
    if not sensors:
        text = "expected scans bit for bit, as a run with `record: exact` or `full` has them"
        raise InputError("recording", None, text, file=log.path)
    slot = slot or next(iter(sensors))
    host, mounting = slot.partition(".")[0], own_mounting(log, slot)
    if mounting is None:
        raise InputError("--slot", slot, "expected a sensor with a mounting", file=log.path)
    sheets = {
        name: load_machine(m.sheet.as_posix(), header_width_m=m.common.header_width_m)
        for name, m in scenario.machines.items()
    }
    writer = Writer(host, sheets, mounting)
    make = writer.sensor_data if kind == "sd" else writer.sensor_view
    states = {name: list(_samples(log, f"{name}.motion", "state")) for name in sheets}
    count = 0
    with new_file(out) as file:
        for sample in _samples(log, slot, sensors[slot]):
            message = make(sample, {name: _newest(found, sample.t) for name, found in states.items()})
            data = message.SerializeToString(deterministic=True)
            file.write(LENGTH.pack(len(data)) + data)
            count += 1
    return count


def _sensors(log: Log) -> dict[str, str]:
    """Slots (`combine.lidar`) whose scans or targets are recorded bit for bit, and that output."""
    ends = {output: f"/{output}{SUFFIX}" for output in ("scan", "targets")}
    return {
        topic.removesuffix(end)[1:].replace("/", "."): output
        for output, end in ends.items()
        for topic in log.topics()
        if topic.endswith(end)
    }


def _newest(states: Sequence[MachineState], t: int) -> MachineState:
    """The newest state at t [ns]."""
    return states[max(bisect_right(states, t, key=lambda state: state.t) - 1, 0)]


def _samples(log: Log, slot: str, output: str) -> Iterator[Any]:
    topic = exact_topic(slot, output)
    if topic not in log.topics():
        text = "expected samples bit for bit, as a run with `record: exact` or `full` has them"
        raise InputError("recording", f"{slot}.{output}", text, file=log.path)
    for _, sample in exact_samples(log.messages((topic,))):
        yield sample
