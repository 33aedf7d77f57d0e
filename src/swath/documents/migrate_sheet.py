"""A data sheet of version 0.1 in the form of version 2, its comments and its order kept.

What changes: a format line; units move from `unit:` into the keys, what else stood there into `note:`;
numbers without a seen source get the tag U; a machine says its type, and a tractor loses its stand-in for a
header.
"""

import io
import re
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap

from swath.core.errors import InputError
from swath.core.units import UNITS
from swath.documents.yaml_document import parse

IN_CM = {"row_spacing", "stubble_height", "straw_below_height", "stand.height", "cob.height", "cob.height_sd"}
COUNTS = re.compile(
    r"stems_per_plant|count_m(in|ax)|per_ear|per_plant|drawn|\w+_per_(ear|cob|pod)|straw_to_grain"
)
CROP_UNITS = {
    "1/m2": "per_m2",
    "kg/m3": "kg_m3",
    "deg": "deg",
    "g": "g",
    "m": "m",
    "cm": "cm",
    "mm": "mm",
    "%": "percent",
}
MARKS = {"chassis": "machine", "beam": "sensor", "stand": "crop"}
"""Section -> the kind of data sheet that has it."""
TAGS = {"M": "U", "M+": "U", "M-": "U", "M/E": "U"}
MEMORY = re.compile(r" *\(memory\)|^from memory$")
SYMBOLS = sorted({u.symbol for u in UNITS.values()} | {"kg m2", "1/min", "percent"}, key=len, reverse=True)


def migrate_sheet(text: str) -> str:
    """The new text of a sensor's, machine's or crop's data sheet; one in the new form comes back as it is.

    Raises InputError for text that is no data sheet.
    """
    parse(text, "data sheet")  # in bounds, and YAML
    yaml = YAML(typ="rt")
    yaml.preserve_quotes, yaml.width = True, 10_000
    data = yaml.load(text)
    kind = _kind(data)
    if "format" in data:
        return text
    if kind != "sensor":
        data.pop("kind", None)
    data.insert(0, "format", f"swath {kind} 2")
    if kind == "machine":
        _machine(data)
    for section, entries in list(data.items()):
        if isinstance(entries, CommentedMap) and "value" in entries:
            _entry(data, section, "", kind)
        elif isinstance(entries, CommentedMap):
            for key in list(entries):
                _entry(entries, key, section, kind)
    out = io.StringIO()
    yaml.dump(data, out)
    return out.getvalue()


def _kind(data: Any) -> str:
    found = [kind for mark, kind in MARKS.items() if isinstance(data, dict) and mark in data]
    if not found:
        raise InputError("data sheet", None, f"expected one of the sections {', '.join(MARKS)}")
    return found[0]


def _machine(data: CommentedMap) -> None:
    header = data.get("header", {})
    is_stand_in = not any(header.get(k, {}).get("value", 1) for k in ("body_height_m", "body_depth_m"))
    if "cart" in data:
        _rename(data, "cart", "trailer")
    kind = "tractor_with_trailer" if "trailer" in data else "tractor" if is_stand_in else "combine"
    if kind == "combine" and "forage" in str(data.get("name", "")).lower():
        kind = "forage_harvester"
    if kind not in ("combine", "forage_harvester"):
        data.pop("header", None)
    data.insert(list(data).index("name") + 1, "type", kind)


def _entry(above: CommentedMap, key: str, section: str, kind: str) -> None:
    entry = above[key]
    if not isinstance(entry, CommentedMap):
        return
    if "value" not in entry:
        for inner in list(entry):  # a part of a mesh: {organ, reflectance: {value ...}}
            _entry(entry, inner, section, kind)
        return
    unit, place = str(entry.pop("unit", "") or ""), list(entry).index("value") + 1
    if kind == "crop":
        suffix = _crop_unit(section, key, entry, unit)
        _rename(above, key, f"{key}_{suffix}" if suffix else key)
    else:
        note = _note(unit)
        if note:
            entry.insert(place, "note", note)
        if key == "noise_by_signal":
            _rename(above, key, "noise_by_signal_mm")
    if "tag" in entry:
        entry["tag"] = TAGS.get(str(entry["tag"]), entry["tag"])
    if isinstance(entry.get("source"), str):
        source = MEMORY.sub("", entry["source"]).replace("from memory", "not looked up").strip()
        if source != entry["source"]:
            entry["source"] = source or "usual in the trade"


def _crop_unit(section: str, key: str, entry: CommentedMap, unit: str) -> str:
    """The unit that the key carries from now on; the value is put into it."""
    known = CROP_UNITS.get(unit, "")
    kind = UNITS[known].kind
    if kind == "length":
        wanted = "cm" if {key, f"{section}.{key}"} & IN_CM else "mm"
    elif kind == "ratio":
        wanted = "" if COUNTS.fullmatch(key) or "reflectance" in (section, key) else "percent"
    else:
        wanted = known
    if key == "per_plant_cv":  # version 0.1 rounded it to a whole share
        entry.insert(
            list(entry).index("value") + 1,
            "note",
            f"{entry['value']} {unit} stood here, and was read as this",
        )
        entry["value"] = round(entry["value"] * UNITS[known].factor) * 100
    if wanted != known:
        entry["value"] = float(f"{entry['value'] * UNITS[known].factor / UNITS[wanted].factor:.12g}")
    return wanted


def _note(unit: str) -> str:
    """What a unit's text says beside the unit."""
    text = unit.replace("m, mm one sigma", "m, range in m and one sigma in mm")
    text = text.replace(
        "signal to noise ratio, mm one sigma", "mm, signal to noise ratio and one sigma in mm"
    )
    for symbol in SYMBOLS:
        match = re.fullmatch(rf"{re.escape(symbol)}(?:[, ]+(.*))?", text)
        if match:
            return match[1] or ""
    return text.replace("1/drum length", "per drum length").replace("1/rotor length", "per rotor length")


def _rename(data: CommentedMap, old: str, new: str) -> None:
    """Another name for a key, its place and comments kept."""
    if old == new:
        return
    place, comment = list(data).index(old), data.ca.items.pop(old, None)
    data.insert(place, new, data.pop(old))
    if comment is not None:
        data.ca.items[new] = comment
