"""What an import did, in numbers: for the terminal, for field.yaml, for tests."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from swath.core.number_text import num, signed, span
from swath.documents.reasons import doubts


@dataclass(frozen=True)
class ImportReport:
    """Outcome of an import. Each section is a plain dict; keys carry their unit.

    source: file, profile, columns and those not used (see `ColumnMap.summary`). rows: read, stated where
        the file says how many it has, broken (reason -> count), records. machines: per machine. removed:
        reason -> count. kept: records that count; with broken and removed they are those that were read.
    field: place, area, passes, spacing, direction. crop: yield, mass, stems. terrain: where heights come from
        and how good they are. notes: assumptions.
    """

    out: Path
    source: dict[str, Any]
    rows: dict[str, Any]
    machines: list[dict[str, Any]]
    removed: dict[str, int]
    kept: int
    field: dict[str, Any]
    crop: dict[str, Any]
    terrain: dict[str, Any]
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """All sections as plain data, without where it was written."""
        parts = {k: v for k, v in vars(self).items() if k not in ("out", "notes")}
        return {**parts, "notes": list(self.notes)}

    def lines(self) -> list[tuple[str, str, str]]:
        """What, how much, and more about it, for the terminal."""
        field, crop, terrain = self.field, self.crop, self.terrain
        heights = f", {span([terrain['lowest_m'], terrain['highest_m']])} m" if "lowest_m" in terrain else ""
        if not self.rows:
            return [
                ("place", "", field["place"]),
                ("area", f"{num(field['area_ha'])} ha", self.source["profile"]),
                ("guidance lines", f"{field['guidance_lines']}", ""),
                ("crop", crop["name"], f"{num(crop['stems_per_m2'])} stems/m2 everywhere"),
                ("terrain", f"{num(terrain['relief_m'])} m", terrain["source"] + heights),
                *(("doubt" if doubts([note]) else "note", "", note) for note in self.notes),
            ]
        read = self.rows["read"]
        spacing = "" if field["pass_spacing_m"] is None else f", {num(field['pass_spacing_m'])} m apart"
        percentiles = f"10-90 %: {num(crop['yield_p10_t_ha'])}-{num(crop['yield_p90_t_ha'])}"
        left_out = [("  broken", self.rows["broken"]), ("  not used", self.removed)]
        return [
            ("rows in the log", num(read), self.source["profile"]),
            *([("  stated", num(self.rows['stated']), "by the file")] if "stated" in self.rows else []),
            *((what, num(n), k.replace("_", " ")) for what, of in left_out for k, n in of.items() if n),
            ("records used", num(self.kept), f"{num(100 * self.kept / max(read, 1))} %"),
            *(
                (f"machine {m['name']}", num(m['records']),
                 "flow delay " + ", ".join(filter(None, (_delay(m), m["flow_delay_method"]))))
                for m in self.machines
            ),
            ("place", "", field["place"]),
            ("area", f"{num(field['area_ha'])} ha", f"row direction {num(field['row_azimuth_deg'])} deg"),
            ("passes", f"{field['passes']}", f"{num(field['pass_length_m'] / 1000)} km{spacing}"),
            ("yield", f"{num(crop['yield_t_ha'])} t/ha", percentiles),
            ("crop", crop["name"], ""),
            ("stems", f"{num(crop['stems_per_m2'])} /m2", f"{num(crop['grain_g_per_stem'])} g of grain each"),
            ("terrain", f"{num(terrain['relief_m'])} m", terrain["source"] + heights),
            *(("doubt" if doubts([note]) else "note", "", note) for note in self.notes),
        ]  # fmt: skip

    def __rich__(self) -> Any:
        """A table for the terminal."""
        from rich.markup import escape
        from rich.table import Table

        title = escape(f"field {self.out}")
        table = Table(title=title, title_justify="left", show_header=False, box=None, padding=(0, 2))
        table.add_column(style="bold")
        table.add_column(justify="right")
        table.add_column(style="dim")
        for line in self.lines():
            table.add_row(*map(escape, line))
        return table


def _delay(machine: dict[str, Any]) -> str:
    """The delay of the flow and its error as text, empty where it is not known."""
    seconds, error = machine["flow_delay_s"], machine["flow_delay_error_s"]
    return "" if seconds != seconds else f"{signed(seconds)}{f' +-{num(error)}' if error == error else ''} s"
