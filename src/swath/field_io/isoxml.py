"""Task data of ISO 11783-10 as one table: TASKDATA.XML names devices and logs, TLG files hold the records."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError
from swath.documents.packed import member_names
from swath.field_io.taskfiles import (
    Element,
    TaskFiles,
    elements,
    hex_number,
    is_log_file,
    number,
    task_files,
)
from swath.field_io.timelog import (
    MOST_VALUES,
    Description,
    TimeLog,
    Value,
    check_values,
    column_names,
    read_time_log,
)

Array = NDArray[np.float64]
DESCRIBED = ("CTP", "DVC", "DET", "DVP", "DPD", "TLG", "XFR")
FEW_VALUES, VALUES_PER_BYTE = 20_000_000, 32  # held of any task data; more per byte, up to MOST_VALUES
MOST_PROBLEMS = 100  # that are told of one set of task data


@dataclass(frozen=True)
class TaskData:
    """All time logs of a TASKDATA folder, in the order of their first records; problems of every file.

    crop: its name where the data know one only
    """

    path: Path
    logs: tuple[TimeLog, ...]
    devices: dict[str, str]
    problems: tuple[str, ...]
    crop: str = ""

    def __len__(self) -> int:
        return sum(len(log) for log in self.logs)

    @property
    def time(self) -> Array:
        """Seconds since the first record, shape (n,)."""
        all_times = np.concatenate([log.time for log in self.logs])
        return np.asarray((all_times - all_times.min()) / np.timedelta64(1, "s"), dtype=float)

    def columns(self) -> dict[str, Any]:
        """Columns of all logs, one after the other: log, machine (text), time_s, lat_deg, lon_deg,
        elevation_m and one per channel; nan where a log has no such channel.
        """
        count = [len(log) for log in self.logs]
        channels = [column_names(log.channels) for log in self.logs]
        check_values(len(self), len({name for names in channels for name in names}), self.path)
        names = np.array([log.name for log in self.logs])
        made: dict[str, Any] = {"log": np.repeat(names, count).tolist(), "time_s": self.time}
        made["machine"] = np.repeat(np.array([log.device for log in self.logs]), count).tolist()
        made["lat_deg"] = np.concatenate([log.lat for log in self.logs])
        made["lon_deg"] = np.concatenate([log.lon for log in self.logs])
        up = np.concatenate([log.up for log in self.logs])
        if np.isfinite(up).any():
            made["elevation_m"] = up
        start = np.concatenate([[0], np.cumsum(count)])
        for i, log in enumerate(self.logs):
            for k, name in enumerate(channels[i]):
                column = made.setdefault(name, np.full(len(self), np.nan))
                column[start[i] : start[i + 1]] = log.values[:, k]
        return made


def is_taskdata(path: Path) -> bool:
    """True for a folder or zip that holds a TASKDATA.XML, for that file, and for a TLG file."""
    if path.is_dir():
        return any(p.name.upper() == "TASKDATA.XML" for p in path.iterdir())
    if path.name.upper() == "TASKDATA.XML" or is_log_file(path):
        return True
    return any(PurePosixPath(n).name.upper() == "TASKDATA.XML" for n in member_names(path))


def read_taskdata(path: Path) -> TaskData:
    """Read all time logs of a TASKDATA folder, its zip or its TASKDATA.XML; of a TLG file only that log.

    Raises InputError when nothing can be read: no TASKDATA.XML, no time log, no whole record in any.
    """
    path = Path(path)
    with task_files(path) as files:
        if "TASKDATA.XML" not in files:
            raise InputError("taskdata", None, "expected a TASKDATA.XML beside the time logs", file=path)
        described = _read_description(files)
        logs, problems = _read_logs(path, files, described)
    if not logs:
        why = f": {problems[0]}" if problems else ""
        expected = f"expected at least one time log with a whole record{why}"
        raise InputError("taskdata", None, expected, file=path)
    logs.sort(key=lambda log: (log.time[0], log.name))
    crop = described.crops[0] if len(set(described.crops)) == 1 else ""
    return TaskData(path, tuple(logs), dict(described.devices), tuple(problems[:MOST_PROBLEMS]), crop)


def _read_logs(path: Path, files: TaskFiles, described: Description) -> tuple[list[TimeLog], list[str]]:
    """The logs that hold a record, and what was wrong with all of them."""
    names = dict.fromkeys(described.logs)
    if described.problems or not names:
        names |= dict.fromkeys(sorted(n[:-4] for n in files if n.startswith("TLG") and n.endswith(".BIN")))
    if is_log_file(path):
        names = {path.stem.upper(): None}
    problems, logs = list(described.problems), []
    left = min(FEW_VALUES + VALUES_PER_BYTE * files.size, MOST_VALUES)
    for name in names:
        try:
            log = read_time_log(name, files, described, left)
        except InputError as error:
            problems.append(str(error))
            continue
        problems += log.problems
        left -= log.values.size
        if len(log):
            logs.append(log)
    return logs, problems


def _read_description(files: Mapping[str, bytes]) -> Description:
    made = Description()
    parts, rest = {"TASKDATA.XML"}, ["TASKDATA.XML"]
    found: list[Element] = []
    for part in rest:
        if part not in files:
            made.problems.append(f"{part}: referenced, but missing")
            continue
        more, problem = elements(files[part], DESCRIBED)
        found += more
        if problem:
            made.problems.append(f"{part}: {problem}; the rest of it is left out")
        linked = dict.fromkeys(f"{a.get('A', '').upper()}.XML" for tag, a, _ in more if tag == "XFR")
        rest += [name for name in linked if name not in parts]
        parts |= set(linked)
    _take_devices(found, made)
    made.crops = [a.get("B", "") for tag, a, _ in found if tag == "CTP"]
    for tag, a, around in found:
        if tag == "TLG" and a.get("A"):
            task = next((b.get("A", "") for t, b in around if t == "TSK"), "")
            made.logs[a["A"].upper()] = task
    return made


def _take_devices(found: list[Element], made: Description) -> None:
    """Labels and scaling of the values of every device element."""
    shown: dict[tuple[str, str], tuple[float, float, str]] = {}
    data: list[tuple[str, str, dict[str, str]]] = []
    for tag, a, around in found:
        device = next((b.get("A", "") for t, b in around if t == "DVC"), "")
        if tag == "DVC":
            made.devices[a.get("A", "")] = a.get("B", "")
        elif tag == "DET":
            made.owners[a.get("A", "")] = device
        elif tag == "DVP":
            shown[device, a.get("A", "")] = (
                number(a.get("C"), 1.0),
                number(a.get("B"), 0.0),
                a.get("E", ""),
            )
        elif tag == "DPD":
            data.append((device, a.get("F", ""), a))
    for device, presentation, a in data:
        ddi = hex_number(a.get("B"))
        scale, offset, unit = shown.get((device, presentation), (1.0, 0.0, ""))
        if ddi is not None:
            made.values[device, ddi] = Value(a.get("E", "").strip(), unit, scale, offset)
