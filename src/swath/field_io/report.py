"""What an import did, in numbers: for the terminal, for field.yaml, for tests."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
        heights = ", {lowest_m:.1f} to {highest_m:.1f} m".format(**terrain) if "lowest_m" in terrain else ""
        if not self.rows:
            return [
                ("place", "", field["place"]),
                ("area", f"{field['area_ha']:.2f} ha", self.source["profile"]),
                ("guidance lines", f"{field['guidance_lines']}", ""),
                ("crop", crop["name"], f"{crop['stems_per_m2']:.3g} stems/m2 everywhere"),
                ("terrain", f"{terrain['relief_m']:.1f} m", terrain["source"] + heights),
                *(("doubt" if doubts([note]) else "note", "", note) for note in self.notes),
            ]
        read = self.rows["read"]
        spacing = "" if field["pass_spacing_m"] is None else f", {field['pass_spacing_m']:.2f} m apart"
        percentiles = f"10-90 %: {crop['yield_p10_t_ha']:.2f}-{crop['yield_p90_t_ha']:.2f}"
        left_out = [("  broken", self.rows["broken"]), ("  not used", self.removed)]
        return [
            ("rows in the log", f"{read:,}", self.source["profile"]),
            *([("  stated", f"{self.rows['stated']:,}", "by the file")] if "stated" in self.rows else []),
            *((what, f"{n:,}", k.replace("_", " ")) for what, of in left_out for k, n in of.items() if n),
            ("records used", f"{self.kept:,}", f"{100 * self.kept / max(read, 1):.1f} %"),
            *(
                (f"machine {m['name']}", f"{m['records']:,}",
                 "flow delay " + ", ".join(filter(None, (_delay(m), m["flow_delay_method"]))))
                for m in self.machines
            ),
            ("place", "", field["place"]),
            ("area", f"{field['area_ha']:.2f} ha", f"row direction {field['row_azimuth_deg']:.1f} deg"),
            ("passes", f"{field['passes']}", f"{field['pass_length_m'] / 1000:.1f} km{spacing}"),
            ("yield", f"{crop['yield_t_ha']:.2f} t/ha", percentiles),
            ("crop", crop["name"], ""),
            ("stems", f"{crop['stems_per_m2']:.3g} /m2", f"{crop['grain_g_per_stem']:.2f} g of grain each"),
            ("terrain", f"{terrain['relief_m']:.1f} m", terrain["source"] + heights),
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
    return "" if seconds != seconds else f"{seconds:+.1f}{f' +-{error:.1f}' if error == error else ''} s"
