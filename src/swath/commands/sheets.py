"""`swath sheets`: the bundled data sheets of sensors, machines and crops, to look at and to copy."""

import argparse
from pathlib import Path
from typing import Any

from swath.core.errors import near_miss
from swath.terminal.options import option, verb
from swath.terminal.tables import add_json, as_json, say, table

PLACE = "start", 5  # among all commands
KINDS = ("sensors", "machines", "crops", "obstacles")


def add(parsers: Any) -> None:
    """Add the command."""
    parser = verb(parsers, "sheets", "data sheets of sensors, machines, crops; print one to copy", run)
    option(parser, "words NAME", "print this data sheet, e.g. sick-lms111; or: check FILE ...", nargs="*")
    add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Print a data sheet as it is and what its tags mean, check own ones, or print the names of all."""
    from swath.core.errors import InputError
    from swath.documents.data_sheets import TAGS, find_sheet, read_sheet, sheet_names
    from swath.documents.yaml_document import read_document

    if args.words[:1] == ["check"] and len(args.words) > 1 and not args.json:
        return max(_check(file) for file in args.words[1:])
    if len(args.words) > 1:
        raise InputError(
            "sheets", " ".join(args.words), "expected one NAME, or check FILE, which has no --json"
        )
    if args.words:
        name = _bundled_name(args.words[0])
        if args.json:
            import json

            print(json.dumps(read_document(find_sheet(_kind_of(name), name)).data, indent=1))
            return 0
        print(find_sheet(_kind_of(name), name).read_text(encoding="utf-8"), end="")
        print("# tags: " + "; ".join(f"{tag} {meaning}" for tag, meaning in TAGS.items()))
        return 0
    rows = []
    for kind, name in [(folder, name) for folder in KINDS for name in sheet_names(folder)]:
        sheet = read_sheet(kind, name)
        tags = [str(entry.get("tag", "U")) for entry in sheet.numbers().values()]
        rows.append(
            (kind, name, str(sheet.value("name")), {t: sum(a.startswith(t) for a in tags) for t in TAGS})
        )
    if args.json:
        as_json(("kind", "name", "what", "numbers_by_tag"), rows)
        return 0
    for folder in KINDS:
        texts = [
            (name, what, *(str(counts[tag]) for tag in TAGS))
            for kind, name, what, counts in rows
            if kind == folder
        ]
        table(folder, ("data sheet", "what it is", *TAGS), texts)
    say("Numbers by tag: " + "; ".join(f"{tag} {meaning}" for tag, meaning in TAGS.items()))
    say("Your own: swath sheets NAME > mine.yaml, change it, and give the file's name for the sheet's.")
    return 0


def _check(file: str) -> int:
    """Read an own data sheet whole; exit code 2 and all its mistakes where it cannot be."""
    from swath.core.errors import InputError
    from swath.documents.data_sheets import KINDS as WORDS
    from swath.documents.data_sheets import read_sheet
    from swath.documents.yaml_document import read_document
    from swath.field.crop_sheet import load_crop
    from swath.field.solid.obstacles import load_obstacle
    from swath.machine.machine_sheet import load_machine
    from swath.sensing.camera.camera_sheet import load_camera
    from swath.sensing.ground_speed.radar import load_ground_radar
    from swath.sensing.lidar_sheet import load_lidar
    from swath.sensing.radar.radar_sheet import load_radar

    path = Path(file).resolve()
    data = read_document(path).data or {}
    said = str(data.get("format", ""))
    kind = next((kind for kind, word in WORDS.items() if said.startswith(f"swath {word}")), None)
    if kind is None:
        formats = ", ".join(f"format: swath {word} 2" for word in WORDS.values())
        raise InputError("format", said or None, f"expected one of {formats}", file=file)
    sensors = {"radar": load_radar, "ground_radar": load_ground_radar, "camera": load_camera}
    load_sensor = sensors.get(str(data.get("kind")), load_lidar)
    load: Any = {
        "sensors": load_sensor,
        "machines": load_machine,
        "crops": load_crop,
        "obstacles": load_obstacle,
    }[kind]
    load(str(path))
    entries = read_sheet(kind, str(path)).numbers().values()
    plain = sum("source" not in entry for entry in entries)
    word = WORDS[kind]
    what = f"{'an' if word[0] in 'aeiou' else 'a'} {word}"
    print(f"{file}: {what} with {len(entries)} numbers, {plain} of them without a source")
    return 0


def _bundled_name(name: str) -> str:
    """As scenarios take it: `lexion-700` is `lexion-700-class`."""
    from swath.documents.data_sheets import sheet_names

    return f"{name}-class" if f"{name}-class" in sheet_names("machines") else name


def _kind_of(name: str) -> str:
    from swath.core.errors import InputError
    from swath.documents.data_sheets import sheet_names

    kinds = {sheet: kind for kind in KINDS for sheet in sheet_names(kind)}
    if name not in kinds:
        hint = near_miss(name, kinds) or "; swath sheets lists them"
        raise InputError("data sheet", name, f"expected a bundled data sheet{hint}")
    return kinds[name]
