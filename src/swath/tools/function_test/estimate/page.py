"""report.html of an estimate: where failures lie, and with which weight; its JUnit file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from swath import __version__
from swath.core.number_text import num, percent_of, span
from swath.report.chart import Chart
from swath.report.html import Banner, Facts, Section, Table, element, write_page
from swath.signals import F64
from swath.tools.function_test.estimate.estimate import Estimated
from swath.tools.function_test.judging.first_batch import banners
from swath.tools.function_test.judging.verdict import BROKEN, SHOWN
from swath.tools.function_test.junit import write_suites
from swath.tools.function_test.page import axis_of, failures

SIDE = 360.0  # of the picture [px]
PASSED_MAX, FAILED_MAX = 1500, 20  # runs in the picture that keep the limit, failures in the list
LARGEST = 9.0  # radius of the failure with the largest weight [px]
PARAMETERS = (
    "parameter",
    "key",
    "range",
    "exposure",
    "nine tenths of the failures",
    "away from the exposure [nat]",
)
ABOUT_PICTURE = (
    "Runs of the last round over the two parameters in which failures differ most from the exposure. "
    "Orange: the limit is broken, the area is the run's share of the probability. Blue: kept."
)
ABOUT = (
    "The probability is the mean of exposure over density of the failures in the last round, whose "
    "density was fixed before its first run: over many estimates it is unbiased. The rounds before only "
    "say where failures are. They follow the margin to the limit; a region of failures that they "
    "overlooked makes the number too small and the interval too narrow, and is excluded only above a "
    "probability of {}. The interval says how far the number depends on chance, not how far the "
    "simulation or the exposure can be trusted."
)
SPAN = (0.05, 0.95)  # of the failures, by weight


def write_estimate(path: Path, found: Estimated, at_most: float | None = None) -> Path:
    """Write the page. at_most: the probability that is claimed."""
    rate, verdict = found.rate, found.verdict(at_most)
    given = not found.refusals
    names = list(found.telling)
    failed, every = _failed(found), (*found.rounds, found.last)
    rounds = [
        [f"{n}{', the last' if n == len(every) else ''}", "cheap" if r.level else "as judged",
         str(len(r.margins)), str(int(np.sum(r.margins < 0.0))),
         num(float(np.nanmin(r.margins, initial=1.0)))]
        for n, r in enumerate(every, 1)
    ]  # fmt: skip
    sections = [
        Section(
            "Where failures lie",
            [_picture(found, names), Table("", PARAMETERS, [_parameter(found, n) for n in names], (5,))],
        ),
        failures("Failures that weigh most", "share", failed, rate.failures),
        Section(
            "How sure it is",
            [ABOUT.format(num(found.blind)),
             Table("", ["round", "level", "runs", "failures", "least margin"], rounds, (2, 3, 4))],
        ),
    ]  # fmt: skip
    small = f"95 %: {num(rate.low)} to {num(rate.high)}" if given else "not supported by the runs"
    kind = {SHOWN: "pass", BROKEN: "fail"}.get(verdict, "none")
    said = f"at most {num(at_most)}: {verdict}" if verdict else small
    return write_page(
        path,
        sections,
        heading=f"Probability of failure of {found.case.name}",
        lead=f"{found.case.file.objective}; {found.limit}, swath {__version__}",
        verdict=(kind, f"{num(rate.value)} a run" if given else "no number", said),
        top=[
            *banners(found.telling_nothing),
            *(Banner(f"No number is given: {said}.") for said in found.refusals),
            Facts(_facts(found)),
        ],
    )


def _facts(found: Estimated) -> dict[str, object]:
    rate, cheap = found.rate, found.cheap_rate
    interval = percent_of(rate.half_width) if not found.refusals else None
    overlooked = percent_of(rate.overlooked) if rate.failures else None
    return {
        "runs": found.plain["runs"],
        "of them in the last round": rate.runs,
        "failures in the last round": rate.failures,
        "effective failures": num(rate.ess),
        "half width of the interval": interval,
        "of the probability where the search found none": overlooked,
        "not judged": found.unknown.failures or None,
        "at the cheap level": cheap and f"{num(cheap.value)} ({num(cheap.low)} to {num(cheap.high)})",
        "failures that it does not show": cheap and percent_of(found.unseen),
    }


def _values(found: Estimated, name: str) -> F64:
    """Where a parameter of each run of the last round lies in its range or list of values, 0 to 1, (n,)."""
    varied, values = found.case.file.vary[name], [point[name] for point in found.last.points]
    if varied.range is None:
        steps = np.array([varied.drawn_values.index(value) for value in values])
        apart = np.arange(len(steps)) * 0.618 % 1.0  # within the band of a value, so that all are seen
        return np.asarray((steps + 0.15 + 0.7 * apart) / len(varied.drawn_values))
    low, high = varied.range
    return (np.array(values, dtype=float) - low) / (high - low)


def _picture(found: Estimated, names: list[str]) -> Chart:
    """The runs over the two parameters that matter most; with one parameter, their margins over it."""
    x = _values(found, names[0])
    y = _values(found, names[1]) if len(names) > 1 else 0.5 + 0.5 * np.nan_to_num(found.last.margins)
    up = axis_of(found.case, names[1]) if len(names) > 1 else ("margin", "-1", "1")
    across = axis_of(found.case, names[0])
    made = Chart(SIDE, SIDE, f"{up[0]} over {across[0]}", across, up, ABOUT_PICTURE)
    fails = found.last.margins < 0.0
    largest = float(np.max(found.weights[fails])) if np.any(fails) else 1.0
    for i in np.flatnonzero(~fails)[:PASSED_MAX].tolist():
        made.dot(float(x[i]), float(y[i]), "pass", radius=1.1)
    for i in sorted(np.flatnonzero(fails).tolist(), key=lambda i: -found.weights[i]):
        radius = max(1.2, LARGEST * float(np.sqrt(found.weights[i] / largest)))
        made.dot(float(x[i]), float(y[i]), "heavy", radius=radius)
    return made


def _parameter(found: Estimated, name: str) -> list[object]:
    """The row of a parameter: its exposure, and where nine tenths of the weight of the failures lie."""
    varied = found.case.file.vary[name]
    fails = found.last.margins < 0.0
    values = np.array([point[name] for point in found.last.points], dtype=object)[fails]
    share = found.weights[fails] / max(float(np.sum(found.weights[fails])), 1e-300)
    if varied.range is None:
        sums = {value: float(np.sum(share[values == value])) for value in varied.drawn_values}
        lie = ", ".join(f"{value} {percent_of(of)}" for value, of in sums.items() if of > 0.0)
        drawn = ", ".join(map(str, varied.drawn_values))
    else:
        order = np.argsort(values.astype(float))
        places = np.minimum(np.searchsorted(np.cumsum(share[order]), SPAN), len(order) - 1)
        lie = " to ".join(num(value) for value in values[order][places]) if len(order) else ""
        drawn = span(varied.range)
    exposure = ", ".join(num(of) for of in varied.exposure) or "all alike"
    return [name, element("code", varied.key), drawn, exposure, lie or "–", num(found.telling[name])]


def _failed(found: Estimated) -> list[tuple[Mapping[str, Any], str]]:
    """The failures that weigh most, with their share of the probability."""
    last = found.last
    whole = float(np.sum(found.weights[last.margins < 0.0]))
    each = zip(found.weights.tolist(), last.margins.tolist(), last.results, strict=True)
    failed = sorted(((w, r) for w, m, r in each if m < 0.0), key=lambda pair: (-pair[0], pair[1]["id"]))
    return [(result, f"{num(100 * weight / whole)} %") for weight, result in failed[:FAILED_MAX]]


def write_junit(path: Path, found: Estimated, at_most: float | None) -> Path:
    """A test with the probability as a property: fails when it exceeds what is claimed, is skipped where that
    is not shown, or where no number is given.
    """
    verdict = found.verdict(at_most)
    suite = ET.Element("testsuite", name=f"{found.case.name} [estimate]", tests="1")
    test = ET.SubElement(suite, "testcase", classname=found.case.name, name=f"probability: {found.limit}")
    if not found.refusals:
        properties = ET.SubElement(test, "properties")
        for name in ("probability", "low", "high"):
            ET.SubElement(properties, "property", name=name, value=f"{found.plain[name]:.6g}")
    if verdict == BROKEN:
        ET.SubElement(test, "failure", message=f"{found.text}; at most {at_most:g} is asked")
    elif found.refusals or (verdict and verdict != SHOWN):
        ET.SubElement(test, "skipped", message=found.text)
    suite.set("failures", str(int(verdict == BROKEN)))
    root = ET.Element("testsuites")
    root.append(suite)
    return write_suites(path, root)
