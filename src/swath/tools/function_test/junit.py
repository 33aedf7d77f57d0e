"""JUnit XML: a suite is a case, a test is a run with a candidate; build servers show it."""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from swath.core.files.whole_file import write_whole
from swath.tools.function_test.cells import Cell
from swath.tools.function_test.judging.judged import OPEN, UNJUDGED
from swath.tools.function_test.judging.kept_runs import Kept
from swath.tools.function_test.judging.verdict import NOT_JUDGED, NOT_SHOWN, SHOWN


def write_junit(path: Path, cells: Sequence[Cell]) -> Path:
    """Write junit.xml.

    A cell is a test too: it fails when its claim is broken, and is skipped when not shown or not judged. Of
    more than a thousand runs the worst and a sample are listed.
    """
    root = ET.Element("testsuites")
    for cell in cells:
        suite = ET.SubElement(root, "testsuite", name=f"{cell.case.name} [{cell.candidate}]")
        whole = ET.SubElement(suite, "testcase", classname=cell.case.name, name=f"{cell.candidate}: claim")
        failures = 0
        if cell.verdict in (NOT_SHOWN, NOT_JUDGED):
            ET.SubElement(whole, "skipped", message=cell.text)
        elif cell.verdict != SHOWN:
            ET.SubElement(whole, "failure", message="; ".join([cell.text, *cell.means]))
            failures += 1
        for run in _listed(cell):
            point = ", ".join(f"{k}={v}" for k, v in run.point.items())
            name = f"{cell.candidate}: {point or 'as it is'}, seed {run.seed} ({run.id})"
            test = ET.SubElement(suite, "testcase", classname=cell.case.name, name=name)
            if known := cell.case.known(run.point):
                ET.SubElement(test, "skipped", message=f"known: {known}")
            elif run.verdict == UNJUDGED:
                ET.SubElement(test, "skipped", message=run.reason)
            elif run.verdict == OPEN:
                ET.SubElement(test, "skipped", message="no limit of the case judges it")
            elif run.verdict != "pass":
                ET.SubElement(test, "error" if run.verdict == "error" else "failure", message=run.reason)
                failures += 1
        suite.set("tests", str(len(suite)))
        suite.set("failures", str(failures))
    return write_suites(path, root)


def write_suites(path: Path, root: ET.Element) -> Path:
    """Write suites of tests; returns the path."""
    ET.indent(root)
    return write_whole(path, ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n")


def _listed(cell: Cell) -> list[Kept]:
    """The runs that are drawn, and the worst failures that are not among them."""
    drawn = {run.id for run in cell.drawn.runs}
    return [*cell.drawn.runs, *(run for run in cell.failed.runs if run.id not in drawn)]
