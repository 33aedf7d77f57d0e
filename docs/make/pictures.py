"""All pictures in docs/figures: `make pictures`, or some of them: `make pictures ONLY="gallery moving"`.

python -m docs.make.pictures [NAME ...]                 all, or those named
python -m docs.make.pictures gallery [SCENARIO ...]     writes docs/reference/gallery.md, too

Results are made by what measures them: edge_reliability.png by benchmarks/edge_drawn.py, reda.png by `swath reda`,
compare-log-*.png by `swath compare log` from logs that are not here.
architecture.svg is drawn by hand. Pictures of runs are drawn by headless Chromium from their replays.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

from tests.replay.browser import Browser

import swath
from swath.commands.main import main
from swath.documents.data_sheets import find_sheet
from swath.documents.yaml_document import read_document
from swath.scenario.scenario import load_scenario, scenario_names
from swath.scenario.slots import CATALOGUE

DOCS = Path(__file__).parents[1]
FIGURES, GALLERY = DOCS / "figures", DOCS / "figures" / "gallery"
OUTLOOK = (Path(__file__).parent / "outlook.js").read_text(encoding="utf-8")
BARE = """(() => {
  const charts = CHARTS;
  document.head.append(Object.assign(document.createElement("style"), {textContent:
    "header, #bar, #moments, #notes, #legend, #facts { display: none !important } "
    + "main, #stage { position: fixed !important; inset: 0; margin: 0 !important; padding: 0 !important; "
    + "max-width: none !important } #view { width: 100vw !important; height: 100vh !important } "
    + "aside { position: fixed; right: 12px; bottom: 12px; width: 300px; border-radius: 8px; padding: 6px 10px } "
    + "figure { display: none } " + (charts.length ? "" : "aside { display: none } ")}));
  for (const figure of document.querySelectorAll("#charts figure")) {
    if (charts.includes(figure.querySelector("b").textContent)) figure.style.display = "block";
  }
  dispatchEvent(new Event("resize"));
})()"""
DRAWN = """new Promise((done) => {
  const before = swath.frames, look = () => (swath.frames > before ? done(true) : setTimeout(look, 10));
  swath.app.touch();
  look();
})"""
OF_PROCESS = "Crop and engine"  # group of metrics
CHARTS = ["Speed [km/h]", "Crop [kg/s]", "Load and loss [%]"]
PLACES, TIMES = ("start_m", "from_m", "run_in_m"), ("from_s", "silent_s")
USUAL_M, BEYOND_M, BEFORE_M, BEYOND_S = 40.0, 20.0, -3.0, 3.0
SPEED = 1.9  # of a machine of which only times are known [m/s]
FRAMES, PER_SECOND = 36, 8
HEAD = """# Gallery
The bundled scenarios. `swath run NAME` drives one and leaves its `replay.html`; `swath scenarios NAME` prints the
file. The pictures are from their replays, made by `make pictures`; after `make replays` (some minutes, 15 MB) the site
has the replays themselves.

"""
ENTRY = """## {name}
{summary}.{limits}{shown}

![{name}, as replay.html shows it](../figures/gallery/{name}.webp)

    swath run {name}

"""


def values_of(keys: tuple[str, ...], data: Any) -> Iterator[float]:
    """All numbers under keys of these names, the first of each list."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        while key in keys and isinstance(value, list):
            value = value[0]
        if key in keys and value is not None:
            yield float(value)
        elif isinstance(value, dict | list):
            yield from values_of(keys, value)


def distance_of(data: dict[str, Any]) -> float:
    """How far to drive [m] until a scenario shows what it is about: a little beyond the first place that its
    field names, or the last time that its machines name, or to the end of a path.
    """
    steers = [machine.get("steer") for machine in data["machines"].values()]
    if any("points_m" in (s.get("path") or {}) for s in steers if isinstance(s, dict)):
        return float(data["run"]["distance_m"])
    if times := list(values_of(TIMES, data["machines"])):
        return (max(times) + BEYOND_S) * SPEED
    places = list(values_of(PLACES, data["field"]))
    return min(places) + (BEFORE_M if has_gaps(data) else BEYOND_M) if places else USUAL_M


def has_gaps(data: dict[str, Any]) -> bool:
    """Whether the edge of a scenario has gaps, which are seen from near alone."""
    return bool(data["field"].get("edge", {}).get("gaps"))


def moment_of(data: dict[str, Any], run: Any) -> float:
    """The time [s] to show: the least clearance where something goes, else the end."""
    import pyarrow.parquet as pq

    if not any("path" in each for each in data["field"].get("obstacles", [])):
        return float(run.summary["simulated_s"])
    rows = pq.read_table(run.folder / "tracks.parquet", columns=["clearance_m", "t_s"]).to_pylist()
    return float(min((r["clearance_m"], r["t_s"]) for r in rows if r["clearance_m"] is not None)[1])


def picture_of(page: Browser) -> Any:
    """What the page shows, once it is drawn."""
    from PIL import Image

    page.ask(DRAWN)
    return Image.open(BytesIO(page.picture())).convert("RGB")


def drawn(name: str, folder: Path) -> Any:
    """The picture of a scenario for the gallery."""
    data = read_document(find_sheet("scenarios", name)).data
    run = swath.run(name, folder / name, sets={"run.distance_m": distance_of(data), "expect": {}})
    with Browser((960, 480), limit_s=120.0) as page:
        page.open(run.folder / "replay.html", "detail=1")
        groups = {m.group for key, m in CATALOGUE.judged().metrics.items() if key in data.get("expect", {})}
        page.ask(BARE.replace("CHARTS", str(CHARTS if OF_PROCESS in groups else [])))
        page.ask(f"swath.seek({moment_of(data, run)})")
        print(name, page.ask(f"({OUTLOOK})({str(has_gaps(data)).lower()})"), flush=True)
        return picture_of(page)


def specialities(name: str) -> str:
    """What takes away what a scenario is there to show, and the limit that then moves, a line each."""
    limits = [(e.name, e.limit.speciality) for e in load_scenario(name).expect]
    shown = [(limit, own, " ".join(f"--set {text}" for text in own.without)) for limit, own in limits if own]
    return "".join(f"\n`{sets}` takes away what it shows: `{limit}` moves by {own.by:g} or more."
                   for limit, own, sets in shown)  # fmt: skip


def gallery(names: list[str]) -> None:
    """A picture of every scenario, and the page."""
    GALLERY.mkdir(parents=True, exist_ok=True)
    text = HEAD
    with tempfile.TemporaryDirectory() as folder:
        for name in scenario_names():
            if not names or name in names:
                drawn(name, Path(folder)).save(GALLERY / f"{name}.webp", quality=80, method=6)
            data = read_document(find_sheet("scenarios", name)).data
            limits = ", ".join(f"`{limit}`" for limit in data.get("expect", {}))
            summary = data["summary"][0].upper() + data["summary"][1:]
            limits = f" Limits on {limits}." if limits else ""
            text += ENTRY.format(name=name, summary=summary, limits=limits, shown=specialities(name))
    (DOCS / "reference" / "gallery.md").write_text(text.rstrip() + "\n", encoding="utf-8")


def moving(_: list[str]) -> None:
    """The demo, a loop of some seconds, and its replay page as a whole."""
    with tempfile.TemporaryDirectory() as folder:
        run = swath.run("laser-pilot", Path(folder) / "run", sets={"run.distance_m": 30, "expect": {}})
        with Browser((1200, 750), limit_s=120.0) as page:
            page.open(run.folder / "replay.html", f"t={0.6 * run.summary['simulated_s']}&detail=1")
            picture_of(page).save(FIGURES / "replay.webp", quality=80, method=6)
        with Browser((720, 360), limit_s=120.0) as page:
            page.open(run.folder / "replay.html", "detail=1")
            page.ask(BARE.replace("CHARTS", "[]"))
            made = []
            for k in range(FRAMES):
                page.ask(f"swath.seek({(0.45 + 0.3 * k / FRAMES) * run.summary['simulated_s']})")
                made.append(picture_of(page))
    first, *others = made
    out = FIGURES / "moving.webp"
    first.save(
        out, save_all=True, append_images=others, duration=1000 // PER_SECOND, loop=0, quality=30, method=6
    )


def live(_: list[str]) -> None:
    """The page of a run that is paused, with another speed and one obstacle more."""
    import threading

    from swath.replay.live.view import LiveView
    from swath.runtime.job import run_job
    from swath.runtime.run_control import RunControl
    from swath.scenario.scenario import load_scenario

    control = RunControl(is_paused=True)
    view = LiveView(control)
    scenario = load_scenario("straight", sets=["run.max_duration_s=6", "expect={}"])
    with tempfile.TemporaryDirectory() as folder:
        run = threading.Thread(
            target=run_job, args=(scenario, Path(folder) / "run"), kwargs={"hooks": [view]}
        )
        run.start()
        try:
            with Browser((1200, 750), limit_s=120.0) as page:
                page.open(view.address, ready="globalThis.swath && swath.live && swath.live.frames > 0")
                page.ask("swath.live.ask('set', {key: 'combine.speed.speed_kmh', value: '6'})")
                page.ask(
                    "swath.live.ask('set', {key: 'obstacles.pole', value: '{kind: post, x_m: -4, y_m: 16}'})"
                )
                page.ask("swath.live.ask('speed', {value: 0.5})")
                page.ask("swath.live.ask('pause', {value: false})")
                while page.ask("swath.live.at") < 3.0:
                    time.sleep(0.2)
                page.ask("swath.live.ask('pause', {value: true})")
                picture_of(page).save(FIGURES / "live.webp", quality=80, method=6)
        finally:
            control.set_speed(0.0)
            control.pause(False)
            run.join()
            view.close()


def camera(_: list[str]) -> None:
    """What `swath scan --camera` draws."""
    mount = "{x_m: -1.5, y_m: 0.4, z_m: 3.2, pitch_deg: 24}"
    keys = f"combine.camera={{samples_per_pixel: 4, horizontal_fov_deg: 50, mount: {mount}}}"
    _copied(
        ["scan", "straight", "--camera", "--set", keys, "--format", "png"], "scan.camera.png", "camera.png"
    )


def unloading(_: list[str]) -> None:
    """The report's figure of a box that is filled, over a whole run."""
    from swath.report import report

    kept: list[Any] = []
    before = report.unloading_figure
    report.unloading_figure = lambda *args: kept.append(before(*args)) or kept[-1]  # type: ignore[assignment]
    try:
        with tempfile.TemporaryDirectory() as folder:
            swath.run(
                "unload-on-the-go",
                Path(folder) / "run",
                sets={"combine.lidar": "off", "combine.scan_filter": "off", "combine.edge": "truth"},
            )
    finally:
        report.unloading_figure = before
    kept[0].savefig(FIGURES / "unloading.png", dpi=110)


def script(name: str) -> Callable[[list[str]], None]:
    """A script of this folder's neighbour `figures`."""
    return lambda _: (
        subprocess.run([sys.executable, "-m", f"docs.figures.{name}"], cwd=DOCS.parent, check=True) and None
    )


def cases(names: list[str]) -> None:
    """The catalogue of function tests."""
    subprocess.run([sys.executable, "-m", "docs.make.cases", "--draw", *names], cwd=DOCS.parent, check=True)


def _copied(command: list[str], made: str, to: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        if main([*command, "--out", folder]):
            raise SystemExit(f"swath {command[0]} failed")
        found = next(Path(folder).rglob(made))
        (FIGURES / to).write_bytes(found.read_bytes())


PICTURES: dict[str, Callable[[list[str]], None]] = {
    **{
        name: script(name)
        for name in (
            *("beam", "control", "crops", "devices", "fleet", "groups", "guidance", "links", "mounting"),
            "rays",
        )
    },
    "camera": camera,
    "unloading": unloading,
    "live": live,
    "moving": moving,
    "gallery": gallery,
    "cases": cases,
}

if __name__ == "__main__":
    asked = sys.argv[1:]
    if asked[:1] in (["gallery"], ["cases"]):
        chosen = {asked[0]: asked[1:]}
    else:
        chosen = {name: [] for name in asked or PICTURES}
    for each, names in chosen.items():
        begun = time.monotonic()
        PICTURES[each](names)
        print(f"{each}: {time.monotonic() - begun:.0f} s", flush=True)
