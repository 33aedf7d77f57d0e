"""Small drawings in a page, as SVG in the colours of its style sheet."""

import numpy as np
from numpy.typing import ArrayLike

from swath.report.html import Html, escaped

LEFT, BELOW, ABOVE = 66.0, 34.0, 8.0  # room for the names of the axes [px]
LETTER = 7.5  # width of a letter of such a name, about [px]


class Chart:
    """A drawing whose coordinates run from 0 to 1, to the right and upwards.

    Parameters
    ----------
    width, height : of the area [px].
    label : what it shows, for readers that do not see it.
    x, y : name, text at the lower and at the upper end of an axis; None = the axis has no room.
    caption : running text below.
    left : room for text at the left where there is no axis [px].
    """

    kind = "chart"

    def __init__(
        self,
        width: float,
        height: float,
        label: str,
        x: tuple[str, str, str] | None = None,
        y: tuple[str, str, str] | None = None,
        caption: str = "",
        left: float = 0.0,
    ) -> None:
        self.width, self.height, self.label, self.caption = width, height, label, caption
        self._left, self._below = LEFT if y else left, BELOW if x else 0.0
        self._above = ABOVE if x or y else 0.0
        self._marks: list[str] = []
        if x:
            for at, text, anchor in ((0.0, x[1], "start"), (1.0, x[2], "end")):
                self.text(at, 0.0, text, anchor=anchor, down=15.0)
            self.text(0.5, 0.0, x[0], anchor="middle", down=29.0, is_name=True)
        if y:
            for at, text, down in ((0.0, y[1], 0.0), (1.0, y[2], 11.0)):
                self.text(0.0, at, text, anchor="end", right=-5.0, down=down)
            place = f"translate(-50 {height / 2:.0f}) rotate(-90)"
            is_long = LETTER * len(y[0]) > height + ABOVE
            fit = f' textLength="{height:.0f}" lengthAdjust="spacingAndGlyphs"' if is_long else ""
            self._marks.append(
                f'<text class="name" transform="{place}" text-anchor="middle"{fit}>{escaped(y[0])}</text>'
            )

    def _at(self, x: float, y: float) -> tuple[str, str]:
        return f"{x * self.width:.4g}", f"{(1.0 - y) * self.height:.4g}"

    def dot(
        self, x: float, y: float, look: str = "", title: str = "", *, radius: float = 3.0, fill: str = ""
    ) -> None:
        """A run. look: a class of the style sheet; fill: a colour instead."""
        a, b = self._at(x, y)
        paint = f' fill="{fill}" fill-opacity=".75"' if fill else f' class="{look}" fill-opacity=".75"'
        self._marks.append(f'<circle{paint} cx="{a}" cy="{b}" r="{radius:.3g}">{_tip(title)}</circle>')

    def run(self, x: float, y: float, title: str, *, keeps: bool) -> None:
        """A run that keeps its limits, or one that does not."""
        if keeps:
            self.dot(x, y, "on", title)
        else:
            self.cross(x, y, title)

    def cross(self, x: float, y: float, title: str = "") -> None:
        """A run that fails."""
        a, b = (float(v) - 3.0 for v in self._at(x, y))
        self._marks.append(f'<path class="cross" d="M{a:.4g} {b:.4g}l6 6m0 -6l-6 6">{_tip(title)}</path>')

    def box(
        self, x: float, y: float, wide: float, high: float, *, look: str = "", fill: str = "",
        opacity: float = 1.0, title: str = "",
    ) -> None:  # fmt: skip
        """A rectangle from its lower left corner.

        look: a class of the style sheet; fill: a colour instead
        """
        a, b = self._at(x, y + high)
        paint = f'class="{look}"' if look else f'fill="{fill}" fill-opacity="{opacity:.3g}"'
        size = f'width="{wide * self.width:.4g}" height="{high * self.height:.4g}"'
        self._marks.append(f'<rect x="{a}" y="{b}" {size} {paint}>{_tip(title)}</rect>')

    def area(self, look: str, *corners: tuple[float, float]) -> None:
        """A polygon. look: a class of the style sheet."""
        points = " ".join(",".join(self._at(*corner)) for corner in corners)
        self._marks.append(f'<polygon class="{look}" points="{points}"/>')

    def line(self, x: float, y: float, to_x: float, to_y: float, dash: str = "", thick: float = 1.0) -> None:
        """A line between two points."""
        (a, b), (c, d) = self._at(x, y), self._at(to_x, to_y)
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self._marks.append(f'<line x1="{a}" y1="{b}" x2="{c}" y2="{d}" stroke-width="{thick}"{dashed}/>')

    def curve(self, x: ArrayLike, y: ArrayLike) -> None:
        """A line through points in their order, which is broken where y is nan."""
        points = np.stack([np.asarray(x) * self.width, (1.0 - np.asarray(y)) * self.height], axis=1)
        known = points[:, 1] == points[:, 1]
        steps = np.where([False, *known[:-1]], "L%.0f %.0f", "M%.0f %.0f")[known].tolist()
        path = "".join(steps) % tuple(points[known].ravel().tolist())
        self._marks.append(f'<path class="curve" d="{path}"/>')

    def text(
        self, x: float, y: float, text: str, *, anchor: str = "start", right: float = 0.0, down: float = 0.0,
        is_name: bool = False,
    ) -> None:  # fmt: skip
        """Text at a point, moved to the right and down [px]."""
        a, b = x * self.width + right, (1.0 - y) * self.height + down
        look = ' class="name"' if is_name else ""
        self._marks.append(
            f'<text{look} x="{a:.4g}" y="{b:.4g}" text-anchor="{anchor}">{escaped(text)}</text>'
        )

    def __html__(self) -> str:
        wide, high = self.width + self._left + 1.0, self.height + self._above + self._below
        frame = (
            f'<rect class="frame" width="{self.width:g}" height="{self.height:g}"/>' if self._below else ""
        )
        inner = "".join(self._marks)
        return Html(
            f'<svg width="{wide:g}" height="{high:g}" viewBox="0 0 {wide:g} {high:g}" role="img"'
            f' aria-label="{escaped(self.label)}">'
            f'<g transform="translate({self._left:g} {self._above:g})">{frame}{inner}</g></svg>'
        )


def _tip(title: str) -> str:
    return f"<title>{escaped(title)}</title>" if title else ""
