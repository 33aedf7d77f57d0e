"""docs/reference/signals.md and the table of messages in docs/reference/run-folder.md, made from the declarations of the signals.

python -m docs.make.signals     writes both anew
"""

import inspect
from collections.abc import Sequence
from pathlib import Path

from swath.core.layout import Field, layout
from swath.core.signal import Message, Signal, signal_types, span_of
from swath.record.tracks import arrays_of
from swath.scenario.slots import SLOTS

DOCS = Path(__file__).parents[1] / "reference"
BEGIN, END = "<!-- made by docs/make/signals.py -->", "<!-- end -->"
FRAMES = {
    "base": "`machine/base_link`",
    "sensor": "`machine/slot`",
    "optical": "`machine/slot_optical`",
    "world": "`map`",
}
HEAD = f"""\
# Signals
{BEGIN}
What flows between the slots of a machine: samples in SI units and radians, each with a time `t` [ns]. Their
messages and frames: [run folder](run-folder.md); words and signs: [glossary](nomenclature.md). *Amounts*
belong to the step of their sample and add up, everything else is a state. Fields have the same names in ROS 2
messages `swath_msgs/<Signal>`, in variables of FMUs (`port.field`) and in `swath.signals`. The numbers of a
pose are `pose.x`, `pose.y`, `pose.z` [m], `pose.roll`, `pose.pitch`, `pose.yaw` [rad].

Every single number is a column of `tracks.parquet`. One for which the tables name no column has its name by rule: slot,
output where that is another word, field, unit. `settings_drum_rad_s`, `crop_flow_loss_cleaning_kg_s`; amounts are
divided by the length `dt` of their step: `header_flow_straw_kg_s`.

A part that is not swath's own (a file, an FMU, a node, a device, a log) may send what lies in the *range* of a
field; a pose has that of its place. Anything else, a confidence of 95 or an edge 600 m aside, ends the run in
one line. The ranges are estimates, wide enough for any machine in a field (`swath.signals.ranges`).

A signal of your own is declared once, in the file of the part that gives it; this holds for recording,
playback, FMUs and ROS 2:

```python
@frozen
class Moisture(Signal, about=About(frame="sensor")):
    "Water in the grain."

    share: Annotated[float, Quantity("", "of the wet mass", nan="no grain", column="moisture_share")]
```

`swath.core.signal` and `swath.core.frozen` hold these names and say what else can be declared.
"""
SAMPLES = {
    "exact": "",
    "full": " Recorded bit for bit with `record: full` only.",
    "messages": " Its messages keep every bit, there are no exact samples beside them.",
}


def bundled_signals() -> list[type[Signal]]:
    """The sample types of this package, by name."""
    ports = [port.signal for slot in SLOTS for port in (*slot.outputs, *slot.more)]
    known = {*signal_types(), *ports}
    found = [kind for kind in known if kind.__module__.startswith("swath.signals.")]
    return sorted(found, key=lambda kind: kind.__name__)


def signals_page(signals: Sequence[type[Signal]]) -> str:
    """A page with a table of fields per signal."""
    return HEAD + "".join("\n" + _section(signal) for signal in signals)


def messages_table(signals: Sequence[type[Signal]]) -> str:
    """Signal, topic, message and frame of everything in run.mcap, as a table."""
    rows = ["| sample | topic | message | frame |", "|---|---|---|---|"]
    for signal in signals:
        name = signal.__name__
        for message in messages_of(signal):
            said = f"{message.type}: {message.meaning}" if message.meaning else message.type
            frame = message.frame or FRAMES[signal.about.frame]
            rows.append(f"| {name} | `{message.topic}` | {said} | {frame} |")
            name = ""
    return "\n".join(rows) + "\n"


def messages_of(signal: type[Signal]) -> tuple[Message, ...]:
    """The ROS 2 messages of a signal."""
    return signal.about.messages or (Message(f"swath_msgs/{signal.__name__}"),)


def _section(signal: type[Signal]) -> str:
    about = signal.about
    rate = ", at the rate of `tracks.parquet`" if about.is_thinned else ""
    lines = [f"## {signal.__name__}", inspect.getdoc(signal) or "", ""]
    if rate or SAMPLES[about.samples]:
        lines += [f"ROS 2 messages{rate or ' at every sample'}.{SAMPLES[about.samples]}", ""]
    if arrays := arrays_of(signal):
        names = ", ".join(f"`{name}`" for name in arrays)
        lines += [f"Arrays without a column, {names}: {about.seen_as}.", ""]
    lines += [
        "| field | type | unit | range | meaning | nan | column of tracks |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [_row(field) for field in layout(signal).values()]
    return "\n".join(lines) + "\n"


def _row(field: Field) -> str:
    name, quantity, kind = field.name, field.quantity, field.kind
    shape = f"({', '.join(map(str, quantity.shape))})"
    said = "pose" if kind == "pose" else shape if kind == "array" else field.declared.__name__
    meaning = quantity.meaning.replace("|", "\\|") + (" (amount)" if quantity.is_amount else "")
    columns = ", ".join(f"`{c.name}`" for c in quantity.tracks)
    ends = "" if kind == "bool" else " to ".join(f"{end:g}" for end in span_of(name, quantity))
    return f"| `{name}` | {said} | {quantity.unit or '-'} | {ends} | {meaning} | {quantity.nan} | {columns} |"


def with_table(page: str) -> str:
    """A page with what stands between BEGIN and END made anew."""
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n{messages_table(bundled_signals())}{END}{rest.partition(END)[2]}"


def main() -> None:
    """Write both pages."""
    (DOCS / "signals.md").write_text(signals_page(bundled_signals()), encoding="utf-8")
    page = DOCS / "run-folder.md"
    page.write_text(with_table(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
