"""report.html of a tuning: what is proven, the history, the front, what matters, how to use the winner."""

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from swath import __version__
from swath.core.files.whole_file import write_whole
from swath.core.number_text import num, signed
from swath.core.process.shell import command
from swath.report.chart import Chart
from swath.report.html import Facts, Section, Table, element, write_page
from swath.tools.function_test.judging.first_batch import banners
from swath.tools.function_test.search.page import index
from swath.tools.tune.optimiser import Measured, Tried, as_one, what_matters
from swath.tools.tune.parameters import sets_at
from swath.tools.tune.tune import (
    BETTER,
    CANDIDATES,
    PARTS,
    WORSE,
    Tuned,
    as_json,
    command_of,
    write_winner,
)

WIDE, HIGH, SIDE = 640.0, 180.0, 300.0  # of the history and of the front [px]
PROOF = ("proven by", "metric", "pairs", "winner less shipped, mean", "99 %", "shown")
PARAMETERS = ("parameter", "range", "winner", "share of the variance, alone", "with all that it acts with")
FRONT = ("setting", "values")
ABOUT_PROOF = (
    "Pairs of the same case, point and seed, by seeds that no setting was measured by: the mean difference, "
    "as settings are chosen by means, with its interval. A limit that is broken more often than as shipped "
    "is never bought by a better aim. The verdict is that of the other conditions; where they show nothing "
    "and the tuned ones do, the winner is better in the tuned cases only."
)
ABOUT_HISTORY = (
    "Each setting, in order. Crosses break a limit. The dashed line is what was shipped, the large dot the "
    "winner: it is where a Gaussian process of all settings is best, for the best value is the luckiest one."
)
ABOUT_FRONT = (
    "Settings that keep all limits; the blue ones are beaten by none in both aims, orange is shipped. Only "
    "the winner is proven."
)
ABOUT_MATTERS = "Shares of the variance over the ranges (Sobol's indices), by a Gaussian process of all."


def write_tuned(found: Tuned) -> Path:
    """Write report.html, tuned.json and the winner's scenario."""
    tune = found.tune
    write_whole(found.folder / "tuned.json", as_json(found) + "\n")
    scenario = write_winner(found)
    sets = " ".join(f"--set {key}={value}" for key, value in found.winner.items())
    against = command("test", "run", "CASE", "--with", found.folder / CANDIDATES, "--out", "DIR")
    indices = what_matters(tune.parameters, found.tried)
    matters = [
        [element("code", key), p.text, str(found.winner[key]), index(alone), index(whole)]
        for p, (key, alone, whole) in zip(tune.parameters, indices, strict=True)
    ]
    sections = [
        Table("What is proven", PROOF, _proof(found), (2, 3, 4), ABOUT_PROOF),
        Section("History", [*(_history(found, n) for n in range(len(tune.aims))), ABOUT_HISTORY]),
        Section("Front", [_front(found), Table("", FRONT, _settings(found)), ABOUT_FRONT])
        if len(tune.aims) > 1 else Section(""),
        Table("What matters", PARAMETERS, matters, (3, 4), ABOUT_MATTERS),
        Section("Use it", [
            Facts({
                "changes": element("code", sets),
                "as a scenario": element("code", command("run", scenario)),
                "in other cases": element("code", against),
                "tune again": element("code", command_of(tune, found.folder)),
            }),
        ]),
    ]  # fmt: skip
    cases = ", ".join(Path(case).stem for case in tune.cases)
    look = "pass" if found.verdict == BETTER else "fail" if found.verdict == WORSE else "none"
    return write_page(
        found.folder / "report.html",
        sections,
        heading=f"Tuned: {', '.join(p.key for p in tune.parameters)}",
        lead=f"{cases}; {len(found.tried)} settings, {tune.each} runs each, swath {__version__}",
        verdict=(look, found.verdict, f"by {', '.join(tune.directions)}"),
        top=banners(found.telling_nothing),
    )


def difference_rows(found: Tuned, part: str) -> list[list[str]]:
    """Rows of a part of the proof: part, metric, pairs, winner less shipped, interval, what it shows."""
    proof, rows = found.proofs[part], []
    for name, d in proof.found.differences.items():
        said = proof.found.difference_texts(name)
        rows.append([PARTS[part], name, str(d.count), *said, proof.found.says(name)])
    return rows


def caveats(found: Tuned, part: str) -> dict[str, str]:
    """What stands beside the aims that a part of the proof shows to be better."""
    proof = found.proofs[part].found
    return {name: proof.beside(name) for name in proof.differences if proof.says(name) == "better"}


def _proof(found: Tuned) -> list[list[str]]:
    rows = []
    for part, proof in found.proofs.items():
        beside = caveats(found, part)
        for *row, said in difference_rows(found, part):
            rows.append([*row, f"{said}; {beside[row[1]]}" if row[1] in beside else said])
        shipped, mine = proof.failed
        rows.append(
            [PARTS[part], "runs that do not pass", "", signed(mine - shipped), f"{shipped} as shipped", ""]
        )
    return rows


def _history(found: Tuned, aim: int) -> Chart:
    """The values of an aim over the number of the setting."""
    name, better = list(found.tune.directions.items())[aim]
    values = [t.measured.values[aim] for t in (*found.tried, Tried(np.zeros(0), found.shipped))]
    made, at = _axis(name, values, better)
    chart = Chart(WIDE, HIGH, f"{name} by setting", ("setting", "1", str(len(found.tried))), made,
                  f"**{name}**: {better} is better, and further down")  # fmt: skip
    if isfinite(values[-1]):
        chart.line(0.0, at(values[-1]), 1.0, at(values[-1]), "3 3")
    for number, tried in enumerate(found.tried):
        x = number / max(1, len(found.tried) - 1)
        chart.run(x, at(values[number]), _title(found, number), keeps=tried.measured.slack >= 0.0)
        if number == found.best:
            chart.dot(x, at(values[number]), title=_title(found, number), radius=7.0, fill="var(--green)")
    return chart


def _front(found: Tuned) -> Chart:
    (a, b), best = list(found.tune.directions.items()), set(found.front)
    of = [[t.measured.values[n] for t in (*found.tried, Tried(np.zeros(0), found.shipped))] for n in (0, 1)]
    (x, to_x), (y, to_y) = _axis(a[0], of[0], a[1]), _axis(b[0], of[1], b[1])
    chart = Chart(SIDE, SIDE, f"{b[0]} over {a[0]}", x, y)
    for number, tried in enumerate(found.tried):
        place = to_x(of[0][number]), to_y(of[1][number])
        if number in best:
            chart.dot(*place, title=_title(found, number), radius=5.0, fill="var(--blue)")
        elif tried.measured.slack >= 0.0:
            chart.dot(*place, "known", _title(found, number))
    chart.dot(to_x(of[0][-1]), to_y(of[1][-1]), title="as shipped", radius=5.0, fill="var(--orange)")
    return chart


def _axis(name: str, values: Sequence[float], better: str) -> tuple[tuple[str, str, str], Any]:
    """An axis with its ends, and where a value lies on it: the worst tenth at its end."""
    known = np.array([v for v in values if isfinite(v)] or [0.0])
    low, high = float(known.min()), float(np.quantile(known, 0.9))
    high = max(high, values[-1] if isfinite(values[-1]) else high, low + 0.01 * (abs(low) or 1.0))
    sign = -1.0 if better == "higher" else 1.0

    def at(value: float) -> float:
        return 0.04 + 0.92 * min(1.0, (value - low) / (high - low)) if isfinite(value) else 0.98

    return (name, num(sign * low), num(sign * high)), at


def _title(found: Tuned, number: int) -> str:
    tried = found.tried[number]
    sets = ", ".join(f"{key} {value}" for key, value in sets_at(found.tune.parameters, tried.shares).items())
    return f"t{number + 1}: {sets}; {_values(found, tried.measured)}"


def _values(found: Tuned, measured: Measured) -> str:
    told = zip(found.tune.directions.items(), measured.values, strict=True)
    return ", ".join(f"{name} {num(-v if better == 'higher' else v)}" for (name, better), v in told)


def _settings(found: Tuned) -> list[list[str]]:
    scores = as_one(found.tried)
    rows = [["shipped", _values(found, found.shipped)]]
    for n in sorted(found.front, key=lambda n: float(scores[n])):
        name = _title(found, n).partition("; ")[0] + " (winner)" * (n == found.best)
        rows.append([name, _values(found, found.tried[n].measured)])
    return rows
