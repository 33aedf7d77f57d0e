"""A recorded run as an OSI trace: a single-channel file, each message after its length in four bytes."""

import struct
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.link.osi.messages import TYPES, Writer
from swath.machine.machine_sheet import load_machine
from swath.record.read.feed import exact_samples, exact_topic
from swath.record.read.files import Log, open_log
from swath.record.read.frames import own_mounting
from swath.record.samples import SUFFIX
from swath.scenario.scenario import load_scenario
from swath.signals import MachineState

LENGTH = struct.Struct("<I")


def write_trace(run: Path, out: Path, *, kind: str = "sd", slot: str | None = None) -> int:
    """Write the scans of a run folder to `out`; returns how many.

    kind: `sd` SensorData, `sv` SensorView; slot: the scanner, such as `combine.lidar`, None = the first that
    was recorded. InputError where the run has no such scans, or not bit for bit; MissingExtra.
    """
    if kind not in TYPES:
        raise InputError("--type", kind, f"expected one of {', '.join(TYPES)}")
    if out.suffix != ".osi":
        raise InputError("--out", str(out), "expected a file such as x.osi")
    if not (run / "scenario.yaml").is_file():
        raise InputError("run", str(run), "expected a run folder, it has no scenario.yaml")
    scenario, log = load_scenario(run), open_log(run)
    scanners = _scanners(log)
    if slot not in (None, *scanners):
        raise InputError("--slot", slot, f"expected a scanner of the recording: {', '.join(scanners)}")
    if not scanners:
        text = "expected scans bit for bit, as a run with `record: exact` or `full` has them"
        raise InputError("recording", None, text, file=log.path)
    slot = slot or scanners[0]
    host, mounting = slot.partition(".")[0], own_mounting(log, slot)
    if mounting is None:
        raise InputError("--slot", slot, "expected a scanner with a mounting", file=log.path)
    sheets = {
        name: load_machine(m.sheet.as_posix(), header_width_m=m.common.header_width_m)
        for name, m in scenario.machines.items()
    }
    writer = Writer(host, sheets, mounting)
    make = writer.sensor_data if kind == "sd" else writer.sensor_view
    states = {name: list(_samples(log, f"{name}.motion", "state")) for name in sheets}
    out.parent.mkdir(parents=True, exist_ok=True)
    unfinished, count = out.with_name(out.name + ".part"), 0
    with unfinished.open("wb") as file:
        for scan in _samples(log, slot, "scan"):
            message = make(scan, {name: _newest(found, scan.t) for name, found in states.items()})
            data = message.SerializeToString(deterministic=True)
            file.write(LENGTH.pack(len(data)) + data)
            count += 1
    unfinished.replace(out)
    return count


def _scanners(log: Log) -> list[str]:
    """Slots (`combine.lidar`) whose scans are recorded bit for bit."""
    ends = f"/scan{SUFFIX}"
    return [topic.removesuffix(ends)[1:].replace("/", ".") for topic in log.topics() if topic.endswith(ends)]


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
