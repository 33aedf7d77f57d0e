"""Task data of ISO 11783-10 as one table: TASKDATA.XML names devices and logs, TLG files hold the records."""

import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swath.core.errors import InputError, capped, some_of
from swath.documents.packed import member_names
from swath.field_io.ddi import DDI, TOGETHER, slug
from swath.field_io.taskdata import WIDTHS, YIELDS, Description, Device, listed, read_description
from swath.field_io.taskfiles import TaskFiles, is_log_file, task_files
from swath.field_io.timelog import EPOCH, MOST_VALUES, TimeLog, check_values, column_names, read_time_log

Array = NDArray[np.float64]
FEW_VALUES, VALUES_PER_BYTE = 20_000_000, 32  # held of any task data; more per byte, up to MOST_VALUES
MOST_PROBLEMS = 100  # that are told of one set of task data
WIDTH, WORK_STATE = "working_width_m", 141  # a column; a DDI


@dataclass(frozen=True)
class TaskData:
    """All time logs of a TASKDATA folder, in the order of their first records; problems of every file."""

    path: Path
    logs: tuple[TimeLog, ...]
    described: Description
    problems: tuple[str, ...]

    def __len__(self) -> int:
        return sum(len(log) for log in self.logs)

    @property
    def time(self) -> Array:
        """Seconds since the first record with a date, nan of those without, shape (n,)."""
        all_times = np.concatenate([log.time for log in self.logs])
        first = min((log.begin for log in self.logs if not np.isnat(log.time).all()), default=EPOCH)
        seconds = (all_times - first) / np.timedelta64(1, "s")
        return np.where(np.isnat(all_times), np.nan, seconds.astype(float))

    @property
    def crops(self) -> list[str]:
        """The crop of each log with a yield: of its task's field, else of the list; '' = none is named."""
        found = [self.described.crop_of(self._part(log)) if _marks(log) else "" for log in self.logs]
        known = [name if name in self.described.crops.values() else "" for name in found]
        return known if any(known) else found

    def columns(self) -> dict[str, Any]:
        """Columns of all logs, one after the other: log, machine (text), time_s, lat_deg, lon_deg,
        elevation_m and one per quantity; nan where a log has no such channel. What sections of a machine log
        apart is put together, beside a column for each; fields of different crops make a column crop.
        """
        return self.table()[0]

    def table(self) -> tuple[dict[str, Any], Array | None, tuple[str, ...]]:
        """The columns; widths of the header [m] that machines state where no log holds any, shape (n,), nan =
        none; and what was assumed or left out.
        """
        count = [len(log) for log in self.logs]
        names = {name for log in self.logs for name in column_names(log.channels)}
        check_values(len(self), len(names), self.path)
        made: dict[str, Any] = {"log": np.repeat(np.array([log.name for log in self.logs]), count).tolist()}
        made["time_s"] = self.time
        made["machine"] = np.repeat(np.array([log.device for log in self.logs]), count).tolist()
        made["lat_deg"] = np.concatenate([log.lat for log in self.logs])
        made["lon_deg"] = np.concatenate([log.lon for log in self.logs])
        up = np.concatenate([log.up for log in self.logs])
        if np.isfinite(up).any():
            made["elevation_m"] = up
        notes, stated = Counter[str](), np.full(len(self), np.nan)
        crops = self.crops
        if len({*crops} - {""}) > 1:
            made["crop"] = np.repeat(np.array(crops), count).tolist()
        unsaid = [log.name for log, crop in zip(self.logs, crops, strict=True) if _marks(log) and not crop]
        if unsaid and any(crops):
            notes[f"crop: the tasks of {some_of(unsaid, 5)} name none, taken as the others"] += 1
        start, is_logged = 0, False
        for log in self.logs:
            rows = slice(start, start + len(log))
            start += len(log)
            quantities, told = _quantities(log, self.described)
            if WIDTH in quantities:
                is_logged = True
            else:
                width, what = self.described.width_of(self._machines(log), _marks(log))
                stated[rows] = width or np.nan
                told += [f"header width: the machine states {width:g} m ({what}), the log none"] * bool(width)
            notes.update(told)
            for name, values in quantities.items():
                made.setdefault(name, np.full(len(self), np.nan))[rows] = values
        if is_logged:
            made[WIDTH] = np.where(np.isfinite(stated), stated, made[WIDTH])
        return made, None if is_logged or np.isnan(stated).all() else stated, (*notes, *self._unused())

    def _part(self, log: TimeLog) -> str:
        return self.described.tasks[log.task].part if log.task in self.described.tasks else ""

    def _machines(self, log: TimeLog) -> list[str]:
        """Devices whose header a log may be of: those that log a yield, those of its task, a single one."""
        known = self.described.devices
        task = self.described.tasks.get(log.task)
        own = [self.described.owners.get(e, "") for e in _marks(log)] + [log.device]
        ids = [*own, *(task.devices if task else ()), *(known if len(known) == 1 else ())]
        return [i for i in dict.fromkeys(ids) if i in known]

    def _unused(self) -> list[str]:
        """What TASKDATA.XML holds beside the logs."""
        left = Counter[str]()
        for part in self.described.parts.values():
            left.update(polygon.name for polygons in part.polygons.values() for polygon in polygons)
            left["guidance pattern"] += len(part.guidance)
            left.update(part.unused)
        left.update(self.described.unused)
        return [f"task data, not used beside the logs: {listed(left)}"] if left.total() else []


def _marks(log: TimeLog) -> list[str]:
    """Device elements that log a yield."""
    return list(dict.fromkeys(c.element for c in log.channels if c.ddi in YIELDS))


def _quantities(log: TimeLog, described: Description) -> tuple[dict[str, Array], list[str]]:
    """Name -> values, shape (n,), of a log, and what was put together. A quantity of several elements of the
    machine is that of the whole machine, and those of the elements under names with their ids.
    """
    made: dict[str, Array] = {}
    notes: list[str] = []
    groups: dict[str, list[int]] = {}
    for k, channel in enumerate(log.channels):
        groups.setdefault(channel.column, []).append(k)
    for name, group in groups.items():
        there: dict[str, int] = {}
        for k in group:
            if np.isfinite(log.values[:, k]).any():
                there.setdefault(log.channels[k].element, k)
        made[name] = log.values[:, next(iter(there.values()), group[0])]
        if len(group) > 1:
            made |= {f"{name}_{slug(log.channels[k].element)}": log.values[:, k] for k in reversed(group)}
        rule = TOGETHER.get(log.channels[group[0]].ddi)
        if rule and len(there) > 1:
            made[name], told = _of_machine(log, described, there, rule)
            notes += [f"{name}: {told}"] * bool(told)
    width = next((n for ddi in WIDTHS if np.isfinite(made.get(n := DDI[ddi].name + "_m", np.nan)).any()), "")
    if width:
        made[WIDTH] = made[width]
        if width != WIDTH:
            notes.append(f"header width: taken from {width}, the log holds no actual one")
    else:
        made.pop(WIDTH, None)
    return made, notes


def _of_machine(log: TimeLog, described: Description, there: dict[str, int], rule: str) -> tuple[Array, str]:
    """The values of a quantity of the whole machine, shape (n,); there: element -> channel; and a note."""
    marks = _marks(log)
    owners = {e: described.owners.get(e, "") for e in there}
    yielding = [described.owners.get(m, "") for m in marks]
    own = next(d for d in (*yielding, *owners.values()) if d in owners.values())
    device = described.devices.get(own, Device(""))
    medians = {e: float(np.nanmedian(log.values[:, k])) for e, k in there.items()}
    of = device.whole([e for e in there if owners[e] == own], marks, medians.__getitem__)
    values = log.values[:, [there[e] for e in of]]
    off = [_is_off(log, e) for e in of]
    if rule == "sum" and len(of) > 1:
        values = np.where(np.stack(off, axis=1), 0.0, values)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of records before the first value
        make: Any = {"sum": np.nansum, "mean": np.nanmean, "highest": np.nanmax}[rule]
        made = make(values, axis=1)
    made = np.where(np.isfinite(values).any(axis=1), made, np.nan)
    others = [e for e in there if e not in of and not set(device.above(e)) & set(of)]
    if len(of) == 1 and not others:
        return made, ""
    how = f"{rule} of " if len(of) > 1 else "of "
    beside = f"; not of {_shown(others, medians)}" if others else ""
    return made, f"{how}{_shown(of, medians)}{beside}"


def _shown(elements: list[str], medians: dict[str, float]) -> str:
    """Some elements with the medians of their values."""
    return some_of((f"{e} ({medians[e]:g})" for e in elements), 4)


def _is_off(log: TimeLog, element: str) -> NDArray[np.bool_]:
    """Records in which an element says that it does not work, shape (n,)."""
    states = [k for k, c in enumerate(log.channels) if c.ddi == WORK_STATE and c.element == element]
    return np.asarray(log.values[:, states[0]] == 0.0) if states else np.zeros(len(log), dtype=bool)


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
        described = read_description(files)
        logs, problems = _read_logs(path, files, described)
    if not logs:
        why = f": {problems[0]}" if problems else ""
        expected = f"expected at least one time log with a whole record{why}"
        raise InputError("taskdata", None, expected, file=path)
    logs.sort(key=lambda log: (log.begin, log.name))
    return TaskData(path, tuple(logs), described, tuple(capped(problems, MOST_PROBLEMS)))


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
