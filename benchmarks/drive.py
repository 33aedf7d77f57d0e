"""Whole runs as a user starts them: real-time factor of the demo, memory on fields of 1 and 100 ha."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from _harness import machine, write_json

FIELD = """
format: swath scenario 2
name: memory
seed: 1
run: {{distance_m: 40, max_duration_s: 60}}
field:
  terrain: {{level: formula, slope_percent: 1.0, roughness_class: C}}
  stand: {{level: uniform, stems_per_m2: 500}}
  edge: {{shape: straight, x_m: 20, y_m: 5, heading_deg: 90, length_m: {length}}}
  boundary: {{points_m: [[0, 0], [{side}, 0], [{side}, {side}], [0, {side}]]}}
machines:
  combine:
    edge_side: left
    lidar: {{sub_rays: 19}}
"""


def run(scenario: str, out: Path) -> tuple[dict[str, Any], float]:
    """The summary of a run in a process of its own, and that process's peak memory [MiB]."""
    code = (  # VmHWM and not ru_maxrss, which a child inherits from the process that started it
        "import sys; from swath.commands.main import main; main(sys.argv[1:]);"
        "print('peak', next(s for s in open('/proc/self/status') if s.startswith('VmHWM')).split()[1])"
    )
    command = [sys.executable, "-c", code, "run", scenario, "--out", str(out), "--quiet"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    peak = float(done.stdout.split("peak")[-1]) / 1024.0
    return json.loads((out / "summary.json").read_text(encoding="utf-8")), peak


def main(out_dir: Path | str = "out/bench") -> dict[str, Any]:
    """Measure, print, write drive.json."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="Whole runs, all cores", title_justify="left")
    for column in ("run", "simulated", "wall", "real-time factor", "Mray", "peak memory"):
        table.add_column(column, justify="left" if column == "run" else "right")
    data: dict[str, Any] = {"machine": machine(), "runs": {}}
    with tempfile.TemporaryDirectory() as folder:
        base = Path(folder)
        scenarios = {"laser-pilot": "laser-pilot"}
        for name, side in (("1 ha", 100.0), ("100 ha", 1000.0)):
            path = base / f"{side:g}.yaml"
            path.write_text(FIELD.format(side=side, length=side - 10.0), encoding="utf-8")
            scenarios[name] = str(path)
        for name, scenario in scenarios.items():
            summary, peak = run(scenario, base / f"out-{name.replace(' ', '-')}")
            data["runs"][name] = {
                "real_time_factor": summary["real_time_factor"],
                "simulated_s": summary["simulated_s"],
                "wall_s": summary["wall_s"],
                "ray_count": summary["ray_count"],
                "peak_mib": peak,
            }
            table.add_row(
                name,
                f"{summary['simulated_s']:.1f} s",
                f"{summary['wall_s']:.1f} s",
                f"{summary['real_time_factor']:.2f}",
                f"{summary['ray_count'] / 1e6:.1f}",
                f"{peak:.0f} MiB",
            )
    Console().print(table)
    write_json(Path(out_dir), "drive", data)
    return data


if __name__ == "__main__":
    main()
