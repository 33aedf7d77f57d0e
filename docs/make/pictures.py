"""Pictures of the documentation, drawn by headless Chromium from replays of the bundled scenarios.

python -m docs.make.pictures gallery [NAME ...]    docs/figures/gallery/NAME.webp, reference/gallery.md
python -m docs.make.pictures moving                docs/figures/moving.webp, the demo in motion
"""

import sys
import tempfile
from io import BytesIO
from pathlib import Path
from typing import Any

from tests.replay.browser import Browser

import swath
from swath.documents.data_sheets import find_sheet
from swath.documents.yaml_document import read_document
from swath.scenario.scenario import scenario_names

DOCS = Path(__file__).parents[1]
GALLERY = DOCS / "figures" / "gallery"
BARE = """(() => {
  document.head.append(Object.assign(document.createElement("style"), {textContent:
    "header, #bar, #moments, #charts, #notes, #legend, #facts { display: none !important } "
    + "main, #stage { position: fixed !important; inset: 0; margin: 0 !important; padding: 0 !important; "
    + "max-width: none !important } #view { width: 100vw !important; height: 100vh !important }"}));
  dispatchEvent(new Event("resize"));
})()"""
DRAWN = """new Promise((done) => {
  const before = swath.frames, look = () => (swath.frames > before ? done(true) : setTimeout(look, 10));
  swath.app.touch();
  look();
})"""
METRES, FRAMES, PER_SECOND = 30, 36, 8
HEAD = """# Gallery
The bundled scenarios. `swath run NAME` drives one and leaves its `replay.html`; `swath scenarios NAME` prints the
file. The pictures are from the replays of their first {metres} m, made by `python -m docs.make.pictures gallery`; after
`make replays` (some minutes, 15 MB) the site has the replays themselves.

"""
ENTRY = """## {name}
{summary}.{limits}

![{name}, as replay.html shows it](../figures/gallery/{name}.webp)

    swath run {name}

"""


def pictured(name: str, times: Any, camera: int, size: tuple[int, int], folder: Path) -> list[Any]:
    """Pictures of a run at some times, in shares of its length."""
    from PIL import Image

    run = swath.run(name, folder / name, sets={"run.distance_m": METRES, "expect": {}}, progress=True)
    with Browser(size, limit_s=300.0) as page:
        page.open(run.folder / "replay.html", "detail=1")
        page.ask(BARE)
        page.ask(f"swath.camera({camera})")
        made = []
        for share in times:
            page.ask(f"swath.seek({share * run.summary['simulated_s']})")
            page.ask(DRAWN)
            made.append(Image.open(BytesIO(page.picture())).convert("RGB"))
    return made


def gallery(names: list[str]) -> None:
    """A picture of every scenario, and the page."""
    GALLERY.mkdir(parents=True, exist_ok=True)
    page = HEAD.format(metres=METRES)
    with tempfile.TemporaryDirectory() as folder:
        for name in scenario_names():
            if not names or name in names:
                (picture,) = pictured(name, [0.75], 0, (960, 480), Path(folder))
                picture.save(GALLERY / f"{name}.webp", quality=80, method=6)
            data = read_document(find_sheet("scenarios", name)).data
            limits = ", ".join(f"`{limit}`" for limit in data.get("expect", {}))
            summary = data["summary"][0].upper() + data["summary"][1:]
            page += ENTRY.format(name=name, summary=summary, limits=f" Limits on {limits}." if limits else "")
    (DOCS / "reference" / "gallery.md").write_text(page.rstrip() + "\n", encoding="utf-8")


def moving() -> None:
    """The demo, a loop of some seconds."""
    with tempfile.TemporaryDirectory() as folder:
        times = [0.45 + 0.3 * k / FRAMES for k in range(FRAMES)]
        first, *rest = pictured("laser-pilot", times, 0, (720, 360), Path(folder))
    out = DOCS / "figures" / "moving.webp"
    first.save(
        out, save_all=True, append_images=rest, duration=1000 // PER_SECOND, loop=0, quality=30, method=6
    )
    print(out, out.stat().st_size)


if __name__ == "__main__":
    what, *names = sys.argv[1:]
    gallery(names) if what == "gallery" else moving()
