"""JSON Schema of job files, for editors, made from the classes that check them."""

from typing import Any

from swath.job.fleet import FORMAT, FleetFile
from swath.scenario.schema import adopt


def job_schema() -> dict[str, Any]:
    """The whole schema, draft 2020-12."""
    defs: dict[str, Any] = {}
    job = adopt(FleetFile, "job", defs)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "swath job",
        "description": "A field, how it is worked, and the machines that do it.",
        **job,
        "properties": {**job["properties"], "format": {"const": FORMAT, "description": "of this file"}},
        "$defs": defs,
    }
