"""The tables of docs/reference/metrics.md, made from the declarations of the evaluators.

python -m docs.make.metrics     writes them anew
"""

from pathlib import Path
from typing import Any

from swath.scenario.slots import CATALOGUE

PAGE = Path(__file__).parents[1] / "reference" / "metrics.md"
BEGIN, END = "<!-- made by docs/make/metrics.py -->\n", "<!-- end -->"


def markdown(judged: Any) -> str:
    """The generated part of docs/reference/metrics.md."""
    groups: dict[str, list[str]] = {}
    for scope, metrics in judged.by_scope().items():
        for name, m in metrics.items():
            meaning = m.meaning.replace("|", "\\|")
            row = f"| `{name}` | {m.unit or '-'} | {scope} | {m.better or '-'} | {meaning} |"
            groups.setdefault(m.group, []).append(row)
    head = "| name | unit | of | better | meaning |\n|---|---|---|---|---|\n"
    tables = [f"### {group}\n{head}" + "\n".join(rows) + "\n" for group, rows in groups.items()]
    columns = ", ".join(f"`{c}`" for c in judged.columns)
    events = ", ".join(f"`{e}`" for e in judged.events)
    return "\n".join([*tables, f"Columns of the tracks: {columns}.\n", f"Events: {events}.\n"])


if __name__ == "__main__":
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    made = before + BEGIN + markdown(CATALOGUE.judged()) + END + rest.partition(END)[2]
    PAGE.write_text(made, encoding="utf-8")
