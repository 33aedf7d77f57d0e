"""The form of the proposed passes: what to drive and record; filled in, it is compared with simulation."""

import csv
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from swath.core.errors import InputError
from swath.core.files.whole_file import write_csv
from swath.core.number_text import num, percent_of
from swath.core.typed_numbers import number_in, unit_of
from swath.documents.text_file import read_text
from swath.scenario.overrides import layered
from swath.scenario.scenario import Scenario
from swath.tools.function_test.case import Point, Scalar
from swath.tools.function_test.evidence import Evidence, checked_rows, scans_row
from swath.tools.function_test.field_plan.plan import PAIRS, Planned
from swath.tools.function_test.field_plan.seen import SCANS
from swath.tools.function_test.one_run import scenario_of
from swath.tools.function_test.session import open_session

FORM, NEXT, DRIVEN = "passes.csv", "next-passes.csv", "passes"
FIXED = "as_well"  # column of what does not vary
FILLED = ("date", "scans", "log", "note")  # columns that come back
MEASURED_BY: Mapping[str, str] = {  # by the end of a scenario key
    "stems_per_m2": "stems counted in three frames of 0.25 m2", "height_factor": "crop height at ten places",
    "height_m": "heights at ten places", "lean_deg": "lean against a plumb line at ten places",
    "crop": "crop and variety, written down", "speed_m_s": "anemometer at 2 m, mean and gusts",
    "plants_per_m2": "weeds counted in three frames of 0.25 m2", "rain_mm_h": "rain gauge",
    "extinction_per_m": "photograph of the dust, a target at 10 m", "near_returns": "photograph of the chaff",
    "slope_percent": "RTK heights along the pass, or a level", "speed_kmh": "speed of the log",
    "radius_m": "RTK track of the edge", "angle_deg": "RTK track of the edge",
    "edge_side": "side of the crop, written down", "light": "lux meter, and where the sun stands",
}  # fmt: skip
CLOUDS = "scans with poses: MCAP, ROS bag or table, RTK (swath compare scans)"
STEERING = "steering angle and command, speed, yaw rate or RTK positions, 4 a second (swath compare log)"
ENGINE = "speed, crop flow, engine load or fuel, one a second (swath compare log)"
LOGS = {"lidar": CLOUDS, "motion": STEERING, "powertrain": ENGINE}  # by the kind of a slot
PLAYED = ("off", "truth", "ideal", "constant", "kinematic")  # levels that say nothing a log could refute


def instruments(planned: Planned) -> list[str]:
    """How each varied condition is measured."""
    found = []
    for name, varied in planned.case.file.vary.items():
        ends = [key.rpartition(".")[2] for key in varied.keys]
        how = next((MEASURED_BY[end] for end in ends if end in MEASURED_BY), "written down")
        found.append(f"{name}: {how}")
    return found


def fixed(planned: Planned) -> list[str]:
    """The conditions that the case does not vary, which a pass has to have as well."""
    varied = {key for each in planned.case.file.vary.values() for key in each.keys}
    found = []
    for key, value in _leaves(scenario_at(planned, planned.conditions[0].point).plain()):
        if key.rpartition(".")[2] in MEASURED_BY and value not in (None, 0.0, "") and key not in varied:
            found.append(f"{key} {value}")
    return found


def _leaves(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Key and value of what stands in nested mappings."""
    for key, value in data.items():
        inner = f"{path}.{key}".removeprefix(".").removeprefix("machines.")
        yield from _leaves(value, inner) if isinstance(value, Mapping) else [(inner, value)]


def logs(scenario: Scenario) -> list[str]:
    """What is to be recorded, by the parts that a scenario simulates."""
    kinds = [choice.kind.name for machine in scenario.machines.values() for choice in machine.slots.values()
             if choice.level not in PLAYED]  # fmt: skip
    return [text for kind, text in LOGS.items() if kind in kinds]


def why(planned: Planned, number: int) -> str:
    """Why a pass is proposed."""
    condition = planned.passes[number].condition
    metric = f"{SCANS} [m]" if planned.asked.metric == SCANS else planned.asked.metric
    said = [f"levels differ by {num(abs(condition.apart))} in {metric}, usually by {num(planned.usual)}"]
    if condition.unchecked:
        said.append(f"never checked there: {', '.join(condition.unchecked)}")
    if condition.unshown < 1.0:
        said.append(f"{percent_of(condition.unshown)} of its cells are not shown")
    return "; ".join(said)


def scenario_at(planned: Planned, point: Point) -> Scenario:
    """The case as it is at some conditions."""
    run = next(open_session(planned.folder / PAIRS, same_code=False).runs())
    sets = layered(planned.case.sets(point), planned.asked.sets)
    return scenario_of(replace(run, sets=sets, point=point))


def write_form(planned: Planned, name: str = FORM) -> Path:
    """Write the form."""
    what, same = "; ".join(instruments(planned)), "; ".join(fixed(planned))
    rows = []
    for number, each in enumerate(planned.passes):
        recorded = "; ".join(logs(scenario_at(planned, each.condition.point)))
        rows.append({
            "pass": number + 1, **each.condition.point,
            "narrows_percent": "" if planned.doubts_nothing else f"{100 * each.narrows:.1f}",
            FIXED: same, "why": why(planned, number), "measure": what, "record": recorded,
            **dict.fromkeys(FILLED, ""),
        })  # fmt: skip
    return write_csv(planned.folder / name, rows)


def read_form(path: Path, planned: Planned) -> list[dict[str, str]]:
    """The rows that came back with scans or a log. InputError with file, line and column."""
    rows = list(csv.DictReader(read_text(path, "--filled", "a form").splitlines()))
    names = [*planned.case.file.vary]
    if not rows or (lacks := [n for n in ("pass", *names, "scans", "log") if n not in rows[0]]):
        expected = f"expected the columns of {FORM}" + (f", {', '.join(lacks)} lack" if rows else "")
        raise InputError("--filled", str(path), expected, file=path)
    return [row for row in rows if row["scans"] or row["log"]]


def driven_point(row: Mapping[str, str], planned: Planned, path: Path) -> dict[str, Scalar]:
    """The conditions of a row, as they were in the field: numbers in the form may have been corrected."""
    point: dict[str, Scalar] = {}
    for name, varied in planned.case.file.vary.items():
        text = row[name].strip()
        if varied.range is None:
            known = {str(value): value for value in varied.drawn_values}
            if text not in known:
                expected = f"expected one of {', '.join(known)} in pass {row['pass']}"
                raise InputError(name, text, expected, file=path)
            point[name] = known[text]
        else:
            try:
                point[name] = number_in(text, unit_of(name))
            except ValueError as error:
                expected = f"expected a number in pass {row['pass']}{error}"
                raise InputError(name, text, expected, file=path) from None
    return point


def compared(planned: Planned, path: Path) -> list[Evidence]:
    """Each pass that came back, held against the simulation at its conditions."""
    from swath.runtime.job import run_job

    found = []
    for row in read_form(path, planned):
        point = driven_point(row, planned, path)
        scenario = scenario_at(planned, point)
        about = {"pass": row["pass"], "conditions": ", ".join(f"{k} {v}" for k, v in point.items()),
                 "date": row.get("date", ""), "note": row.get("note", "")}  # fmt: skip
        rows: list[Mapping[str, object]] = []
        if row["scans"] and (known := checked_rows(path.parent / row["scans"])):
            rows += [{**said, **{k: v for k, v in about.items() if v}} for said in known]
        elif row["scans"]:
            out = planned.folder / DRIVEN / row["pass"]
            run_job(scenario, out, progress=False, hooks=[])
            rows += [{**about, **said} for said in _scans(path.parent / row["scans"], out)]
        if row["log"]:
            rows += [{**about, **said} for said in _log(path.parent / row["log"], scenario)]
        found.append(Evidence(point, rows))
    return found


def _scans(measured: Path, simulated: Path) -> list[dict[str, object]]:
    """`swath compare scans`, each along its own path."""
    from swath.tools.compare_scans.clouds import Reading, read_cloud
    from swath.tools.compare_scans.compare import compare_clouds
    from swath.tools.height_map.source import Wanted

    clouds = [read_cloud(each, Reading(Wanted())) for each in (measured, simulated)]
    return [scans_row(compare_clouds(*clouds, align="path"), str(measured))]


def _log(log: Path, scenario: Scenario) -> list[dict[str, object]]:
    """`swath compare log` with the machine of the scenario, nothing fitted to the numbers that are told."""
    from swath.field_io.logs.steer_log import is_steer_log
    from swath.tools.compare_log.compare import compare_log
    from swath.tools.compare_log.steering_fit import compare_steering

    model = str(next(iter(scenario.machines.values())).plain()["machine"])
    told: list[tuple[str, float, str, str]] = []
    if is_steer_log(log):
        told = [(part.name, part.rmse[0], part.unit, f"{part.rmse[1]:.4g} when fitted")
                for part in compare_steering(model, log).parts]  # fmt: skip
    else:
        made = compare_log(model, log)
        units: Any = made.to_dict()["units"]
        every = {name: [*parts.values()][-1]["model"] for name, parts in made.statistics.items()}
        told = [
            (name, of.rmse, units[name], f"bias {of.bias:+.4g}, r {of.r:.2f}") for name, of in every.items()
        ]
    return [{"compared": "log", "number": f"{name}, RMSE", "value": f"{value:.4g}", "noise": "", "unit": unit,
             "says": says, "file": str(log)} for name, value, unit, says in told]  # fmt: skip
