"""The run of `swath reda`: every condition, sensor and place, and the scores of a sensor in a condition.

The three scores are named after Validation Scores (doi:10.3390/electronics13122396). Of that paper the
abstract was read: scores of usability, availability and reliability from errors place by place and by
statistics. The formulas here are our own.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import sqrt
from pathlib import Path
from typing import Any, NamedTuple

from swath import __version__
from swath.core.errors import SwathError
from swath.core.files.whole_file import write_csv, write_whole
from swath.documents.text_file import read_text
from swath.judge.evaluator import mean
from swath.runtime.workers import Lost, in_workers
from swath.tools.reda.scene import SCANS, Condition, Scene, Sensor, Settings, make_sensor, places

KEPT = "reda.part.jsonl"  # of a run that is not through
ASKED = 3.0  # of the places in the crop, for the table [m]
Z = 1.96  # of an interval of 95 %
Progress = Callable[[int, int], None]


class Cell(NamedTuple):
    """A place. detected: share of the looks at a person there; false: of those at nobody; looks: how many."""

    inside: float
    aside: float
    detected: float
    false: float
    looks: int
    why: str

    @property
    def net(self) -> float:
        """Share of the looks that detect the person, without those that report something there anyway."""
        return max(self.detected - self.false, 0.0) / max(1.0 - self.false, 1e-9)


@dataclass(frozen=True)
class Scores:
    """usability: share of the places that are covered in at least `least` of the looks.

    availability: share of all looks that detect the person
    reliability: lower end of the interval of 95 % of being right, over all looks with a person and without
        (Wilson 1927)
    """

    usability: float
    availability: float
    reliability: float


def scores_of(cells: Sequence[Cell], least: float) -> Scores:
    """Scores of all places of a condition."""
    net = [cell.net for cell in cells]
    right = mean([0.5 * (cell.detected + 1.0 - cell.false) for cell in cells])
    looks = 2 * sum(cell.looks for cell in cells)
    return Scores(mean([float(n >= least) for n in net]), mean(net), lower_end(right, looks))


def lower_end(share: float, count: int) -> float:
    """Lower end of the 95 % interval of a share of so many looks."""
    square = Z * Z / count
    half = Z * sqrt(share * (1.0 - share) / count + 0.25 * square / count)
    return max((share + 0.5 * square - half) / (1.0 + square), 0.0)


@dataclass(frozen=True)
class Found:
    """Results of a condition. cells: by sensor; asked: by sensor and height of a person 3 m inside [m]."""

    condition: Condition
    cells: dict[str, list[Cell]]
    asked: dict[tuple[str, float], Cell]

    def scores(self, sensor: str, least: float) -> Scores:
        """Scores of a sensor."""
        return scores_of(self.cells[sensor], least)


def run_reda(
    settings: Settings,
    *,
    processes: int = 1,
    progress: Progress = lambda done, total: None,
    kept: Path | None = None,
) -> list[Found]:
    """All conditions in their order. The same settings give the same numbers, whatever the processes.

    kept: a file that holds every condition that is done, from which a run with the same settings goes on
    """
    conditions = settings.conditions()
    found = [] if kept is None else _read_kept(kept, settings)
    for done, made in enumerate(_made(settings, conditions[len(found) :], processes), len(found) + 1):
        found.append(made)
        if kept is not None:
            _keep(kept, settings, found)
        progress(done, len(conditions))
    return found


def _keep(path: Path, settings: Settings, found: list[Found]) -> None:
    """What is done, a line of JSON each, after a line with the settings."""
    lines = [json.dumps(_settings_of(settings))]
    for made in found:
        asked = [[*key, cell] for key, cell in made.asked.items()]
        lines.append(json.dumps({"cells": made.cells, "asked": asked}))
    write_whole(path, "\n".join(lines) + "\n")


def _read_kept(path: Path, settings: Settings) -> list[Found]:
    """The conditions that are done; none where the file is of other settings, or of another version."""
    try:
        own, *lines = (json.loads(line) for line in read_text(path, "--out", "done conditions").splitlines())
        if own != json.loads(json.dumps(_settings_of(settings))):
            return []
        return [
            Found(
                condition,
                {name: [Cell(*cell) for cell in cells] for name, cells in line["cells"].items()},
                {(name, height): Cell(*cell) for name, height, cell in line["asked"]},
            )
            for condition, line in zip(settings.conditions(), lines, strict=False)
        ]
    except (SwathError, ValueError, KeyError, TypeError, AttributeError):
        return []


def _settings_of(settings: Settings) -> dict[str, Any]:
    return {**asdict(settings), "base": str(settings.base), "version": __version__}


def _made(settings: Settings, conditions: list[Condition], processes: int) -> Iterator[Found]:
    if processes < 2 or not conditions:
        yield from map(partial(measure, settings), conditions)
        return
    begin = partial(partial, _measured, settings)  # called without an argument in each worker
    for condition, made in in_workers(conditions, begin, processes, in_order=True):
        if isinstance(made, Lost):
            raise SwathError(f"{condition.name}: {made}")
        if isinstance(made, SwathError):
            raise made
        yield made


def _measured(settings: Settings, condition: Condition) -> Found | SwathError:
    try:
        return measure(settings, condition)
    except SwathError as error:
        return error


def measure(settings: Settings, condition: Condition) -> Found:
    """Measure one condition."""
    scene = Scene(settings, condition)
    cells: dict[str, list[Cell]] = {}
    asked: dict[tuple[str, float], Cell] = {}
    for name in settings.sensors:
        sensor = make_sensor(name, scene)
        looks = settings.repeats * {"lidar": SCANS - 1, "camera": 1, "thermal": 1}.get(name, settings.looks)

        cell = partial(_cell, sensor, looks)
        cells[name] = [cell(*place) for place in places()]
        standing = next(c for c in cells[name] if (c.inside, c.aside) == (ASKED, 0.0))
        asked[name, _height(scene)] = standing
        if "-" not in settings.target:  # what lies is low
            scene.height = settings.low_height
            asked[name, settings.low_height] = cell(ASKED, 0.0)
            scene.height = settings.target_height
    return Found(condition, cells, asked)


def _cell(sensor: Sensor, looks: int, inside: float, aside: float) -> Cell:
    answer = sensor.look(inside, aside)
    return Cell(inside, aside, answer.detected, sensor.false_share(inside, aside), looks, answer.why)


def _height(scene: Scene) -> float:
    from swath.field.solid.obstacles import load_obstacle

    return scene.height or load_obstacle(scene.settings.target).height


def write_cells(path: Path, found: list[Found]) -> Path:
    """A row per condition, sensor and place."""
    rows = [
        {"crop_height_m": made.condition.height, "stems_per_m2": made.condition.density,
         "weather": made.condition.weather, "hour": made.condition.hour, "sensor": name,
         "inside_m": cell.inside, "aside_m": cell.aside,
         "detected": f"{cell.detected:.4f}", "false": f"{cell.false:.4f}", "net": f"{cell.net:.4f}",
         "looks": cell.looks, "why": cell.why}
        for made in found for name, cells in made.cells.items() for cell in cells
    ]  # fmt: skip
    return write_csv(path, rows)
