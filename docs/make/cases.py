"""docs/reference/cases.md and its pictures: every bundled function test, drawn from its own scenario.

python -m docs.make.cases               writes the page anew
python -m docs.make.cases --draw        and the pictures (some minutes); with names only those
python -m docs.make.cases --results DIR prints what a folder of `swath test run catalogue` shows, as a table
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from swath.scenario.scenario import load_scenario
from swath.tools.function_test.case import Case, find_cases
from swath.tools.function_test.cells import Cell
from swath.tools.function_test.session import open_session

HERE = Path(__file__).parents[1]
PAGE, PICTURES = HERE / "reference" / "cases.md", HERE / "figures" / "cases"
HEADER = """\
# The catalogue of function tests
Made by `python -m docs.make.cases` from the files in `src/swath/data/tests`; edit those. How they are run and
judged: [function-tests.md](../how-to/function-tests.md).

{count} cases with {runs} runs on their grids. Each picture: the field from above at the last point of the
grid, with the machine where it starts (it drives to the right, its header end on the edge), and one scan at
the start as points across the machine, height over y. The scales of length and width differ.
"""
TAGS = ("clean", "detection", "bend", "steering", "fault", "sensor", "speed", "machines")
CROP, STUBBLE, BODY = "#4f9d56", "#e4d3a8", "#22262b"


def page(cases: list[Case]) -> str:
    """The whole page."""
    runs = sum(case.grid_size * len(case.seeds) for case in cases)
    parts = [HEADER.format(count=len(cases), runs=runs)]
    left = list(cases)
    for tag in TAGS:
        of_tag = [case for case in left if tag in case.file.tags]
        left = [case for case in left if case not in of_tag]
        if of_tag:
            parts += [f"## {tag.capitalize()}\n", *(_entry(case) for case in of_tag)]
    assert not left, f"cases without a tag of {TAGS}: {[case.name for case in left]}"
    return "\n".join(parts).rstrip() + "\n"


def _entry(case: Case) -> str:
    file = case.file
    lines = [
        f"### {case.name}",
        f"![{case.name}](../figures/cases/{case.name}.webp)\n",
        f"{file.objective[0].upper()}{file.objective[1:]}.\n",
    ]
    varied_at, limits = [], [f"{name} {_limit(limit)}" for name, limit in file.expect.items()]
    limits += [f"mean {name} {_limit(b.model_dump(exclude_none=True))}" for name, b in file.mean.items()]
    for name, varied in file.vary.items():
        varied_at.append(f"`{name}` {', '.join(map(str, varied.at))}")
    lines.append(f"- varied: {'; '.join(varied_at)}")
    lines.append(f"- limits ({file.source}): {'; '.join(limits)}")
    whys = {known.why: [k.at for k in file.known if k.why == known.why] for known in file.known}
    lines += [f"- known failure at {', '.join(map(_point, at))}: {why}" for why, at in whys.items()]
    return "\n".join(lines) + "\n"


def _limit(limit: Any) -> str:
    """`<= 0.05`, `0.9..1`, and what else the limit says."""
    low, high = limit.get("min"), limit.get("max")
    said = []
    if low is not None and high is not None:
        said.append(f"{low}..{high}")
    elif low is not None:
        said.append(f">= {low}")
    elif high is not None:
        said.append(f"<= {high}")
    for key, value in limit.items():
        if key not in ("min", "max"):
            said.append(f"{key} {_limit(value) if isinstance(value, dict) else value}")
    return ", ".join(said)


def _point(at: Any) -> str:
    told = {n: f"{v[0]:g} to {v[1]:g}" if isinstance(v, list | tuple) else v for n, v in at.items()}
    return " and ".join(f"{name} {value}" for name, value in told.items()) or "every point"


def results(cells: list[Cell]) -> str:
    """A table of finished runs, a case a row. The margin is that of the worst run."""
    rows = ["| case | passed | known failures | verdict | worst margin | why |", "|---" * 6 + "|"]
    for cell in cells:
        passed = f"{cell.passed} of {cell.counted}" if cell.count else "not run"
        failed = f"{cell.known - cell.surprises.count} of {cell.known}" if cell.known else ""
        why = cell.worst.reason if cell.worst else ""
        verdict = cell.verdict if cell.counted else ""
        shown = f"{cell.worst.margin + 0.0:.2f}" if cell.worst else ""
        rows.append(f"| {cell.case.name} | {passed} | {failed} | {verdict} | {shown} | {why} |")
    return "\n".join(rows)


def draw(case: Case) -> None:
    """The picture of a case."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from swath.runtime.assembly import assemble
    from swath.runtime.loop import drive

    world = assemble(load_scenario(case.scenario, sets=case.sets(case.grid()[-1])))
    drive(world, until_s=0.2)
    fig, (plan, across) = plt.subplots(
        1, 2, figsize=(9, 2.1), width_ratios=(3, 1), constrained_layout=True, dpi=80
    )
    _plan(plan, world)
    _across(across, world)
    PICTURES.mkdir(exist_ok=True)
    fig.savefig(PICTURES / f"{case.name}.webp", pil_kwargs={"quality": 60})
    plt.close(fig)
    world.close()


def _plan(axes: Any, world: Any) -> None:
    """The field from above: u along the start's direction, v to its left."""
    start, length = world.leader.start, min(world.scenario.run.distance_m + 15.0, 80.0)
    along, left = start.rotation[:2, 0], start.rotation[:2, 1]
    line = world.leader.edge.point_at(np.linspace(0.0, length, 60))
    beside = (line - start.position[:2]) @ left
    beside = beside[(line - start.position[:2]) @ along < length]
    low, high = float(beside.min()) - 4.0, float(beside.max()) + 4.0
    u, v = np.meshgrid(np.arange(-8, length, 0.1), np.linspace(low, high, 160))
    x = start.position[0] + u * along[0] + v * left[0]
    y = start.position[1] + u * along[1] + v * left[1]
    world.field.ensure(float(x.mean()), float(y.mean()), float(length))
    stands = np.asarray(world.field.standing(x.ravel(), y.ravel())).reshape(u.shape)
    from matplotlib.colors import ListedColormap

    axes.pcolormesh(u, v, stands, cmap=ListedColormap([STUBBLE, CROP]), vmin=0, vmax=1, rasterized=True)
    for machine in world.machines.values():
        sheet, pose = machine.sheet, machine.start
        body = np.array([[sheet.body[0], sheet.body[2]], [sheet.body[1], sheet.body[2]],
                         [sheet.body[1], -sheet.body[2]], [sheet.body[0], -sheet.body[2]]])  # fmt: skip
        bars = [
            body,
            *([np.array([sheet.header_end("left"), sheet.header_end("right")])] if machine.cuts else []),
        ]
        for bar in bars:
            points = np.array([pose.apply([*p, 0.0])[:2] for p in bar]) - start.position[:2]
            axes.fill(points @ along, points @ left, edgecolor=BODY, facecolor="#ffffffaa", lw=1.4)
    axes.set_xlabel("along [m]")
    axes.set_ylabel("left [m]")
    axes.set_xlim(-8, length - 0.2)
    axes.set_ylim(low, high)


def _across(axes: Any, world: Any) -> None:
    """A scan as points of the machine frame."""
    machine = world.leader
    slots = machine.slots_of("lidar")
    if not slots:
        axes.text(0.5, 0.5, "no scanner", ha="center", va="center")
        axes.axis("off")
        return
    scan = world.graph.latest(f"{machine.name}.{slots[0]}", "scan")
    points = machine.mountings[slots[0]].apply(scan.points().reshape(-1, 3))
    axes.scatter(points[:, 1], points[:, 2], s=2, color=BODY)
    axes.invert_xaxis()
    axes.set_xlabel("y, left [m]")
    axes.set_ylabel("z [m]")
    axes.set_ylim(-0.5, 2.5)
    axes.grid(alpha=0.25)


if __name__ == "__main__":
    found = find_cases("catalogue")
    if "--results" in sys.argv:
        folder = Path(sys.argv[sys.argv.index("--results") + 1])
        print(results(open_session(folder, same_code=False).cells(again=True)))
        sys.exit()
    if "--draw" in sys.argv:
        names = sys.argv[sys.argv.index("--draw") + 1 :]
        for case in found:
            if not names or case.name in names:
                draw(case)
                print(case.name, flush=True)
    PAGE.write_text(page(found), encoding="utf-8")
