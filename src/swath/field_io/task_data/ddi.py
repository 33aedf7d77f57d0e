"""What the data dictionary identifiers (DDI) of ISO 11783-11 mean that harvesters log, and in which unit.

Only what harvest logs hold; other channels keep the name and the scaling that the device itself declares.
"""

import re
import unicodedata
from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """name: for a column; unit: of the column; scale: unit per count of the logged integer."""

    name: str
    unit: str
    scale: float


DDI: dict[int, Entry] = {
    67: Entry("working_width", "m", 1e-3),
    68: Entry("default_working_width", "m", 1e-3),
    70: Entry("maximum_working_width", "m", 1e-3),
    84: Entry("yield", "t/ha", 1e-5),
    87: Entry("crop_flow", "kg/s", 1e-6),
    90: Entry("yield_total", "t", 1e-3),
    93: Entry("crop_loss_per_area", "t/ha", 1e-5),
    96: Entry("crop_loss", "kg/s", 1e-6),
    98: Entry("crop_loss_share", "%", 1e-4),
    99: Entry("moisture", "%", 1e-4),
    116: Entry("area_total", "m2", 1.0),
    117: Entry("distance_effective", "m", 1e-3),
    118: Entry("distance_ineffective", "m", 1e-3),
    119: Entry("time_effective", "s", 1.0),
    120: Entry("time_ineffective", "s", 1.0),
    141: Entry("work_state", "1", 1.0),
    144: Entry("yaw", "deg", 1e-3),
    145: Entry("roll", "deg", 1e-3),
    146: Entry("pitch", "deg", 1e-3),
    148: Entry("fuel_total", "l", 1e-3),
    149: Entry("fuel", "l/h", 3.6e-3),
    150: Entry("fuel_per_area", "l/ha", 1e-2),
    177: Entry("cut_length", "mm", 1e-3),
    181: Entry("dry_yield", "t/ha", 1e-5),
    182: Entry("dry_crop_flow", "kg/s", 1e-6),
    183: Entry("dry_yield_total", "t", 1e-3),
    237: Entry("header_height_state", "1", 1.0),
    241: Entry("crop_temperature", "K", 1e-3),
    262: Entry("moisture_mean", "%", 1e-4),
    397: Entry("speed", "m/s", 1e-3),
}
"""DDI -> entry. Source: ISO 11783-11 as in the list of npm isoxml 1.11; 67 to 149, 177 and 262 agree with the
scaling a forage harvester declares for them."""
CONDENSED = {161 + k: 16 * k for k in range(16)}
"""DDI of an actual condensed work state -> sections before the first of its sixteen, two bits for each from
the lowest on: 0 off, 1 on, 2 fault, 3 not installed (ISO 11783-11, DDI 161 to 176)."""
DDI |= {ddi: Entry(f"work_states_{k + 1}_{k + 16}", "1", 1.0) for ddi, k in CONDENSED.items()}
TOGETHER = {
    67: "sum", 68: "sum", 70: "sum", 84: "mean", 87: "sum", 96: "sum", 99: "mean", 141: "highest",
    181: "mean", 182: "sum",
}  # fmt: skip
"""What the values that the sections of one machine log make together; of other DDIs the first counts."""

LABELS: tuple[tuple[str, str], ...] = (
    ("engine_speed", r"(motor|engine).*(drehzahl|speed|rpm)"),
    ("engine_load", r"(motor|engine).*(auslastung|last|load|torque)"),
    ("speed", r"fahrgeschw|(ground|driving|vehicle|machine)_speed|geschwindigkeit"),
    ("fuel", r"(fuel|kraftstoff).*(rate|flow|per_time|momentan)"),
    ("header_speed", r"drehzahl_vorsatz|header.*(rpm|rotation)"),
    ("feed_speed", r"drehzahl_einzug|feed.*roll.*(rpm|speed)"),
    ("drum_speed", r"drehzahl.*trommel|drum.*(rpm|speed)"),
)
"""Column name and what a device calls such a channel, in German or English, as `slug` writes it."""

_UNITS = {
    "upm": "rpm", "u/min": "rpm", "1/min": "rpm", "min-1": "rpm", "r/min": "rpm", "rpm": "rpm",
    "prozent": "%", "percent": "%", "pct": "%", "%": "%", "km/h": "km/h", "kmh": "km/h", "m/s": "m/s",
    "l/h": "l/h", "kg/s": "kg/s", "t/h": "t/h", "t/ha": "t/ha", "h": "h", "min": "min", "s": "s", "m": "m",
    "mm": "mm", "km": "km", "ha": "ha", "l": "l", "t": "t", "kg": "kg", "": "1",
}  # fmt: skip


def slug(text: str) -> str:
    """Lower-case letters, digits and underscores: `Drehzahl Häckseltrommel` -> drehzahl_hackseltrommel."""
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "_", plain).strip("_")[:60]


def label_name(label: str) -> str:
    """The column name of a channel by what the device calls it; the label's own slug for an unknown one."""
    plain = slug(label)
    return next((name for name, pattern in LABELS if re.search(pattern, plain)), plain)


def unit_name(text: str) -> str:
    """A declared unit as it is written here, unknown ones as they are."""
    return _UNITS.get(text.strip().lower(), text.strip()[:20])
