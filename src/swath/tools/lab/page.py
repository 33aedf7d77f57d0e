"""report.html of `swath lab stand`: the stands, the histograms beside each other, and how alike they are."""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from swath.core.random import Stream
from swath.report import plots
from swath.report.page import CSS, Figure
from swath.tools.lab import plots as lab_plots
from swath.tools.lab.agreement import SHOWN, VERDICTS, Judged, JudgedCase, describe, summary
from swath.tools.lab.lab import REFERENCE, Lab
from swath.tools.lab.table import samples

LABELS = {
    "wasserstein_m": ("Wasserstein-1", "cm", 100.0, 1),
    "ks": ("KS", "", 1.0, 3),
    "intersection": ("intersection", "", 1.0, 2),
    "p95_bias_m": ("P95 bias", "cm", 100.0, 1),
    "std_ratio": ("std ratio", "", 1.0, 2),
    "ground_bias": ("ground share", "", 1.0, 3),
}
WORDS = {
    "repeatable": "within the model's own repeatability",
    "good": "within the limits",
    "fair": "within twice the limits",
    "off": "outside",
}
MORE_CSS = """
td.repeatable,.key.repeatable{background:#dcefe6}td.good,.key.good{background:#edf4dc}
td.fair,.key.fair{background:#fdf0d5}td.off,.key.off{background:#fbdccd}
.key{padding:1px 8px;border-radius:4px;margin-right:10px;white-space:nowrap}
h3{margin-top:18px}
.wide td,.wide th{padding-right:12px;font-size:13.5px}.wide td.n{border-left:3px solid #fff}
"""


def write_lab_report(path: Path, lab: Lab, cases: Sequence[JudgedCase], real: str | None) -> Path:
    """Write the page; returns its path."""
    import matplotlib

    with matplotlib.rc_context(plots.STYLE):
        figures = _figures(lab, cases)
    body = [
        _header(lab, cases, real),
        _facts(lab, real),
        *(_section(f.title, _figure(f)) for f in figures),
        _section("How alike they are", _agreement(cases)) if any(c.judged for c in cases) else "",
        _section("What was measured", _statistics(cases)),
        _section("How to read this", _reading(lab, real)),
    ]
    text = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>lab stand · swath</title><style>{CSS}{MORE_CSS}</style></head>\n"
        f"<body><main>\n{''.join(body)}\n</main></body></html>\n"
    )
    part = path.with_suffix(".html.part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)
    return path


def _figures(lab: Lab, cases: Sequence[JudgedCase]) -> list[Figure]:
    made = []
    seed = Stream(lab.settings.seed, "lab")
    fig = lab_plots.stands_figure(lab.settings, lab.crop_height, seed.seed)
    caption = (
        f"One square metre of each stand, seed {seed.seed}: every stem, ear and leaf that rays can meet."
    )
    made.append(Figure("The stands", plots.as_image(fig, kind="webp", dpi=190), caption))
    for degrees in lab.settings.depressions_deg:
        mine = [c for c in cases if c.heights.case.depression_deg == degrees]
        fig = lab_plots.histograms_figure(lab, mine)
        caption = (
            "Normalised histograms in bins of 2 cm, means of the seeds; the band is the repeatability of "
            f"{lab.levels[0]}, from the lowest to the highest seed. {degrees:g}° is how far the middle beam "
            "looks down."
        )
        made.append(Figure(f"Measured height at {degrees:g}°", plots.as_image(fig), caption))
    if len(lab.settings.depressions_deg) > 1:
        caption = (
            "Returns from the crop alone (5 cm above the ground and more) and the share that comes from "
            f"the ground, by the level {lab.levels[0]}: means of the seeds, the band from lowest to highest."
        )
        image = plots.as_image(lab_plots.trends_figure(lab, cases))
        made.append(Figure("What density, spot and view do", image, caption))
    return made


def _header(lab: Lab, cases: Sequence[JudgedCase], real: str | None) -> str:
    judged = [j for c in cases for j in c.judged]
    count = sum(j.overall in ("repeatable", "good") for j in judged)
    if not judged:
        box = '<div class="outcome none">Nothing to judge<small>one level, no real heights</small></div>'
    else:
        kind = "pass" if count == len(judged) else "fail"
        box = (
            f'<div class="outcome {kind}">{count} of {len(judged)} comparisons good'
            "<small>in all six numbers, or repeatable</small></div>"
        )
    beside = f"{escape(real)} beside the levels " if real else "The levels "
    lead = f"{beside}{', '.join(map(escape, lab.levels))} of the LiDAR over the same stands."
    notes = "".join(f'<p class="banner">{escape(note)}</p>' for note in lab.notes)
    return f'<header><div><h1>Lab stand</h1><p class="lead">{lead}</p></div>{box}</header>{notes}'


def _facts(lab: Lab, real: str | None) -> str:
    s = lab.settings
    beams = next((len(h[0]) for c in lab.cases for h in c.heights.values()), 0)
    facts = {
        "crop": f"{s.crop}, {lab.crop_height:.2f} m",
        "stems per m²": ", ".join(f"{n:g}" for n in s.densities),
        "scanners": ", ".join(s.sensors),
        "looking down": ", ".join(f"{b:g}°" for b in s.depressions_deg),
        "crop away along the beam": f"{s.distance_m:g} m",
        "beams per case and seed": str(beams),
        "seeds": f"{s.seed} to {s.seed + s.seeds - 1}",
        "real heights": real or "none given",
        **{f"set {k}": str(v) for k, v in s.sets.items()},
    }
    items = "".join(f"<div><dt>{escape(k)}</dt><dd>{escape(v)}</dd></div>" for k, v in facts.items())
    return f'<dl class="facts">{items}</dl>'


def _agreement(cases: Sequence[JudgedCase]) -> str:
    key = "".join(f'<span class="key {v}">{escape(WORDS[v])}</span>' for v in VERDICTS)
    parts = [f"<p>{key}</p>", _counts(cases)]
    for against in ("real", REFERENCE):
        rows = [_row(c, j) for c in cases for j in c.judged if j.against == against]
        if rows:
            head = "<tr><th>level</th><th>stems/m²</th><th>scanner</th><th>looking down</th>"
            head += "".join(f'<th class="n">{_unit(n)}</th>' for n in SHOWN)
            parts.append(f"<h3>against {against}</h3><table class=wide>{head}</tr>{''.join(rows)}</table>")
    return "".join(parts)


def _counts(cases: Sequence[JudgedCase]) -> str:
    lines = []
    for name, counts in summary(cases).items():
        said = ", ".join(f"{n} {WORDS[v]}" for v, n in counts.items() if n)
        lines.append(f"<p><b>{escape(name)}</b>, worst of the six numbers, by cases: {said}.</p>")
    return "".join(lines)


def _unit(number: str) -> str:
    label, unit, _, _ = LABELS[number]
    return f"{label} [{unit}]" if unit else label


def _row(case: JudgedCase, judged: Judged) -> str:
    c = case.heights.case
    cells = [judged.level, f"{c.density:g}", c.sensor, f"{c.depression_deg:g}°"]
    text = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
    for number in SHOWN:
        _, _, factor, digits = LABELS[number]
        value, band = judged.value[number], judged.band[number]
        tip = f"repeatability allows {band * factor:.{digits}f}"
        if number == "intersection":
            tip = f"repeatability allows {1.0 - band:.{digits}f}"
        elif number == "std_ratio":
            tip = f"repeatability allows a factor of {2.718281828**band:.{digits}f}"
        text += f'<td class="n {judged.verdict[number]}" title="{tip}">{_signed(value * factor, digits)}</td>'
    return f"<tr>{text}</tr>"


def _signed(value: float, digits: int) -> str:
    text = f"{value:.{digits}f}"
    return text.replace("-", "" if float(text) == 0.0 else "−")


def _statistics(cases: Sequence[JudgedCase]) -> str:
    head = (
        "<tr><th>stems/m²</th><th>scanner</th><th class=n>spot [cm]</th><th>looking down</th><th>sample</th>"
    )
    columns = {"mean_m": "mean [m]", "std_m": "std [m]", "p50_m": "median [m]", "p95_m": "P95 [m]",
               "ground_share": "ground share", "silent_share": "no return"}  # fmt: skip
    head += "".join(f"<th class=n>{label}</th>" for label in columns.values())
    rows = []
    for case in cases:
        c = case.heights.case
        for name, heights in samples(case).items():
            found = describe(np.concatenate(heights))
            cells = f"<td>{c.density:g}</td><td>{escape(c.sensor)}</td><td class=n>{100 * c.spot:.1f}</td>"
            cells += f"<td>{c.depression_deg:g}°</td><td>{escape(name)}</td>"
            cells += "".join(f"<td class=n>{_signed(found[key], 3)}</td>" for key in columns)
            rows.append(f"<tr>{cells}</tr>")
    return f"<table class=wide>{head}</tr>{''.join(rows)}</table>"


def _reading(lab: Lab, real: str | None) -> str:
    said = [
        "Heights are those of reported echoes, placed as the scanner itself would place them: range noise "
        "and the constant range error of the instance are in them. Each seed is another stand of the same "
        "kind under another scanner of the same make; all levels see the same stands from the same places.",
        "Repeatability: the heights of one seed against those of another, for every pair of seeds, the worst "
        "of each number. A smaller difference is none that could be seen.",
    ]
    if real is None:
        said.append(
            "Nothing here was held against measured wheat: no such scans are openly available. What is shown "
            "is how far the levels agree with each other. Give your own with <code>--real FILE</code>."
        )
    return "".join(f"<p>{text}</p>" for text in said)


def _section(title: str, content: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{content}</section>\n"


def _figure(figure: Figure) -> str:
    return (
        f'<figure><img src="{figure.image}" alt="{escape(figure.title)}">'
        f"<figcaption>{escape(figure.caption)}</figcaption></figure>"
    )


def rows_for_print(cases: Sequence[JudgedCase]) -> list[list[Any]]:
    """What the command prints: one row per comparison, numbers in the units of LABELS."""
    rows = []
    for case in cases:
        c = case.heights.case
        for j in case.judged:
            numbers = [_signed(j.value[n] * LABELS[n][2], LABELS[n][3]) for n in SHOWN]
            place = [f"{c.density:g}", c.sensor, f"{c.depression_deg:g}"]
            rows.append([*place, j.level, j.against, *numbers, j.overall])
    return rows


PRINTED = ("stems/m2", "scanner", "deg", "level", "against",
           *(" ".join(LABELS[n][:2]).strip() for n in SHOWN), "verdict")  # fmt: skip
