"""The form of scenario files: its version, and machines under `machines:`, which inside have the short path.

In a file a machine is `machines.combine`; in errors, in `--set` and in the reader it is `combine`, as no
machine may have the name of a section.
"""

from swath.core.errors import MIGRATED_BY, InputError
from swath.documents.data_sheets import KINDS, VERSION
from swath.documents.validation import unknown_key
from swath.documents.yaml_document import Document, KeyPath

FORMAT = "swath scenario 2"
READ_BY = {
    FORMAT: "swath run FILE",
    "swath test case 1": "swath test run FILE --out DIR",
    "swath odd 1": "swath test run --odd FILE --out DIR",
    "swath fleet 1": "swath fleet run FILE",
    **{f"swath {kind} {VERSION}": "swath sheets check FILE" for kind in KINDS.values()},
}  # by format, the command that reads such a file
SECTIONS = ("name", "summary", "seed", "run", "realtime", "field", "evaluators", "expect")


def lift_machines(document: Document) -> Document:
    """The document with its machines beside the sections, and without the line of its format.

    Raises InputError for another format, a key that is no section, and a machine with a section's name.
    """
    data = document.data
    if not isinstance(data, dict):
        raise document.error((), data, "expected keys such as format, name, field and machines")
    _check_format(document)
    machines = data.get("machines", {})
    if not isinstance(machines, dict):
        raise document.error(("machines",), machines, "expected machines by name, such as `combine:`")
    for key in data:
        if key not in ("format", "machines", *SECTIONS):
            raise document.error((key,), None, unknown_key(key, [*SECTIONS, "machines"]))
    for name in machines:
        if name in ("format", "machines", *SECTIONS):
            raise document.error(("machines", name), None, "expected another name: this one is a section's")
    sections = {key: value for key, value in data.items() if key in SECTIONS}
    places = {_short(path): place for path, place in document.places.items() if path != ("machines",)}
    return Document({**sections, **machines}, document.file, places)


def short_key(key: str) -> str:
    """A key of `--set` without a leading `machines.`."""
    return key.removeprefix("machines.")


def _short(path: KeyPath) -> KeyPath:
    return path[1:] if path[:1] == ("machines",) else path


def _check_format(document: Document) -> None:
    written = document.data.get("format")
    if written == FORMAT:
        return
    if isinstance(written, str) and (command := READ_BY.get(written)) is not None:
        raise document.error(("format",), written, f"expected a scenario; this file is for: {command}")
    older = f"; {MIGRATED_BY}" if written is None else ""
    error: InputError = document.error(("format",), written, f"expected {FORMAT!r}{older}")
    raise error
