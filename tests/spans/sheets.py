"""Numbers of data sheets with declared limits, at both ends, in a run of a moment."""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from shutil import copy
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from unittest.mock import patch

from annotated_types import Ge, Le

from swath.documents.data_sheets import Sheet, read_sheet, sheet_names
from swath.documents.sheet_fields import Entry
from swath.documents.yaml_document import dump
from swath.field.crop_sheet import load_crop
from swath.machine.machine_sheet import load_machine
from swath.sensing.camera.camera_sheet import load_camera
from swath.sensing.ground_speed.radar import load_ground_radar
from swath.sensing.lidar_sheet import load_lidar
from swath.sensing.radar.radar_sheet import load_radar
from tests.spans.keys import base, placed, small

SENSORS = {  # kind of a sheet: slot and level that read it, and what loads it
    "lidar": ("lidar", "plants", load_lidar),
    "camera": ("camera", "error", load_camera),
    "radar": ("radar", "rays", load_radar),
    "ground_radar": ("ground_speed", "radar", load_ground_radar),
}


class Number(NamedTuple):
    """A number of a bundled sheet, and one of its limits."""

    kind: str
    name: str
    key: str
    value: float

    def __str__(self) -> str:
        return f"{self.kind}/{self.name}: {self.key} = {self.value:g}"

    def scenario(self, folder: Path) -> dict[str, Any]:
        """A scenario whose sheet, in the folder, has it. SwathError where that cannot be."""
        sheet = read_sheet(self.kind, self.name).changed({self.key: self.value})
        text = dump(sheet.document.data)
        if isinstance(read_sheet(self.kind, self.name).value(self.key), int) and self.value % 1.0 == 0.0:
            text = re.sub(rf" {re.escape(str(self.value))}(?=[,\s}}])", f" {self.value:.0f}", text)
        (folder / "own.yaml").write_text(text, encoding="utf-8")
        if self.kind == "crops":
            made = placed(("field", "stand"), "", {"level": "uniform", "crop": "own.yaml"})
            made["machines"]["combine"]["lidar"] = {**small("lidar", "plants"), "level": "plants"}
            return made
        if self.kind == "sensors":
            slot, level, _ = SENSORS[sheet.value("kind")]
            part = {**small(slot, level), "level": level, "sensor": "own.yaml"}
            return placed(("machines", "combine", slot), level, part)
        return _driven(sheet)


def _driven(sheet: Sheet) -> dict[str, Any]:
    """A scenario in which a machine of the sheet `own.yaml` does what it can."""
    more: dict[str, Any] = {"machine": "own.yaml"}
    if sheet.value("bodies") is not None:
        more["motion"] = {"level": "multibody", "start_speed_kmh": 5.0}
    if sheet.value("trailer") is not None:
        made = base(("machines", "combine", "cooperate"), "one_spot")
        made["machines"]["cart"] |= more
    elif sheet.value("threshing") is not None:
        made = base(("machines", "combine", "process"), "organs")
        made["machines"]["combine"] |= {**more, "process": "organs"}
    else:
        made = base(("machines", "combine", "steering"), "actuator")
        made["machines"]["combine"] |= more
        if sheet.value("type") == "truck":
            start = {"x_m": -8.0, "y_m": 0.0, "heading_deg": 90.0}
            made["machines"] = {"truck": {**more, "start": start}}
    return made


@cache
def numbers() -> list[Number]:
    """All of them."""
    kinds = {"machines": load_machine, "crops": load_crop, "sensors": _load_sensor}
    return [n for kind, load in kinds.items() for name in sheet_names(kind) for n in _of(kind, name, load)]


def _load_sensor(name: str) -> None:
    SENSORS[read_sheet("sensors", name).value("kind")][2](name)


@cache
def _of(kind: str, name: str, load: Any) -> tuple[Number, ...]:
    said: list[Entry] = []
    sheet, check = read_sheet(kind, name), Sheet.check

    def note(self: Sheet, *entries: Entry) -> None:
        said.extend(entries)
        check(self, *entries)

    with TemporaryDirectory() as folder, patch.object(Sheet, "check", note):
        load(copy(sheet.path, folder))  # a bundled one that was loaded before is not checked again
    return tuple(
        Number(kind, name, entry.key, end)
        for entry in said
        if type(sheet.value(entry.key)) in (int, float)
        for end in _limits(entry.kind)
    )


def _limits(kind: Any) -> Iterator[float]:
    """Least and greatest of a type as pydantic has it."""
    for mark in getattr(kind, "__metadata__", ()):
        for part in getattr(mark, "metadata", ()):
            if isinstance(part, Ge):
                yield float(part.ge)  # type: ignore[arg-type]
            elif isinstance(part, Le):
                yield float(part.le)  # type: ignore[arg-type]
