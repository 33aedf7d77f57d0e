"""What holds for every page that swath writes. Each page that a test has made goes through `faults`."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from html.parser import HTMLParser
from typing import Any

import pytest

from swath.report import html
from swath.report.html import TEMPLATES

CSS = (TEMPLATES / "page.css").read_text(encoding="utf-8")
PALETTE = set(re.findall(r"--([a-z]+):", CSS))
CLASSES = set(re.findall(r"\.([a-z][\w-]*)", re.sub(r"url\([^)]*\)|\"[^\"]*\"", "", CSS)))
WIDE = ("table", "img", "svg")
EMPTY = ("br", "img", "meta", "link", "hr", "wbr", "input")
DRAWN = ("circle", "path", "rect", "line", "polygon", "text")
PAINT = re.compile(r"#[0-9a-f]{3,8}\b|rgba?\(|hsla?\(", re.IGNORECASE)
NAMED = re.compile(r"(?:color|background|fill|stroke)\s*:\s*(?!none)[^;\s]")
NO_VALUE = {"nan", "NaN", "None", "inf", "-inf"}


class _Walk(HTMLParser):
    """Goes through a page and notes what is wrong with it."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.open: list[tuple[str, set[str]]] = []
        self._marks = 0

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = {key: value or "" for key, value in attributes}
        classes = set(given.get("class", "").split())
        around = set().union(*(kinds for _, kinds in self.open))
        if tag in WIDE and "wide" not in around:
            self.found.append(f"<{tag}> does not lie in anything that scrolls")
        self.found += [f"class {name} has no look" for name in sorted(classes - CLASSES)]
        for key in ("style", "fill", "stroke", "bgcolor", "color"):
            self.found += self._paint(key, given.get(key, ""))
        if tag in DRAWN:
            self._marks += 1
        if tag == "svg":
            self._marks = 0
        if tag not in EMPTY:
            self.open.append((tag, classes))

    def _paint(self, key: str, value: str) -> Iterator[str]:
        for name in re.findall(r"var\(--([\w-]+)\)", value):
            if name not in PALETTE:
                yield f"{key}: {name} is no colour of the palette"
        rest = re.sub(r"var\(--[\w-]+\)", "", value).strip()
        named = NAMED.search(rest) if key == "style" else rest not in ("", "none")
        if PAINT.search(rest) or named:
            yield f"{key}: {value} is a colour in one look alone"

    def handle_endtag(self, tag: str) -> None:
        if tag == "svg" and not self._marks:
            self.found.append("a chart shows nothing")
        while self.open and self.open.pop()[0] != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1][0] in ("td", "th", "dd", "h2", "h3") and data.strip() in NO_VALUE:
            self.found.append(f"a cell says {data.strip()}")


def faults(page: str) -> list[str]:
    """What is wrong with a page: wide parts that do not scroll, colours without a dark look, unknown classes,
    charts that show nothing, cells that hold no value.
    """
    walk = _Walk()
    walk.feed(re.sub(r"<style>.*?</style>", "", page, count=1, flags=re.DOTALL))
    return list(dict.fromkeys(walk.found))


@contextmanager
def judged() -> Iterator[None]:
    """While it lasts, making a page fails where there is something wrong with it."""
    made = html._environment

    class Judging:
        def get_template(self, name: str) -> "Judging":
            return self

        def render(self, **values: Any) -> str:
            page: str = made().get_template("page.html.j2").render(**values)
            assert not (found := faults(page)), f"{values['title']}: {found}"
            return page

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(html, "_environment", Judging)
        yield
