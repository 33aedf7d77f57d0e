"""The keys of a job file in docs/how-to/fleet.md, made from the same classes that check them.

python -m docs.make.fleet     writes it anew
"""

from pathlib import Path

from docs.make.scenario import section, table

from swath.documents.data_sheets import find_sheet
from swath.fleet.files import (
    CartSettings,
    CombineSettings,
    FieldSettings,
    FleetSettings,
    JobKeys,
    PlanSettings,
    TruckSettings,
)
from swath.scenario.reference import parameter_rows

PAGE = Path(__file__).parents[1] / "how-to" / "fleet.md"
BEGIN = "## Job files\n"
HEADER = """\
Made by `python -m docs.make.fleet` from the classes that check a job; edit those.

A job is YAML, by the same rules as a [scenario](../reference/scenario.md): keys carry their unit, paths are
relative to the file, and what is wrong is an error that names key, value, what was expected, file and line.
`swath fleet run NAME|FILE --set combines.combine.speed_kmh=5` changes one key; results with other changes in `--out` stay
without `--replace`. `swath schema job --out job.schema.json`
writes the same as JSON Schema: an editor with a YAML language server completes and checks the file whose first line is
`# yaml-language-server: $schema=job.schema.json`. The bundled `{name}`:

```yaml
{example}```
"""
NAMED = "The key is its name; there may be several.\n"
SECTIONS = (
    ("### field", FieldSettings, "One of `boundary_m`, `file` and `log`.\n"),
    ("### plan", PlanSettings, ""),
    ("### combines.NAME", CombineSettings, NAMED),
    ("### carts.NAME", CartSettings, NAMED + "None: combines drive to the truck themselves.\n"),
    ("### truck", TruckSettings, ""),
    ("### fleet", FleetSettings, ""),
)


def reference(name: str = "small-field") -> str:
    """The whole page."""
    before = PAGE.read_text(encoding="utf-8").partition(BEGIN)[0]
    example = find_sheet("jobs", name).read_text(encoding="utf-8")
    parts = [before + BEGIN + HEADER.format(name=name, example=example)]
    head = [row for row in parameter_rows(JobKeys) if row[0] in ("format", "name", "summary")]
    parts += ["### Top level\n", table(head)]
    parts += [section(*each) for each in SECTIONS]
    return "\n".join(parts).rstrip() + "\n"


if __name__ == "__main__":
    PAGE.write_text(reference(), encoding="utf-8")
