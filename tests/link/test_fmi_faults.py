"""Descriptions that break the standard: read all the same where no harm is done, with the fault named."""

import re
import zipfile

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swath.core.errors import InputError
from swath.link.fmi.description import read_fmu
from tests.link.fmu_scenario import process_part
from tests.link.made_fmus import engine_fmu, engine_xml, needs_cc, process_xml, store_fmu

pytestmark = pytest.mark.usefixtures("code_allowed")

pytest.importorskip("fmpy")
WHOLE = process_xml()
FAULTS = {
    "type": (
        '<Real start="0.0" unit="kg/s"/>',
        '<Real start="0.0" unit="kg/s" declaredType="Flow"/>',
        "is of type Flow",
    ),
    "structure": ('<Unknown index="6"/>', '<Unknown index="600"/>', "model structure"),
    "derivative": ('<Real unit="kg"/>', '<Real unit="kg" derivative="900"/>', "model structure"),
    "variability": (
        'causality="output" >',
        'causality="output" variability="fixed">',
        "is output and fixed, which do not go together",
    ),
    "unknown attribute": ('generationTool="hand"', 'generationTool="hand" colour="green"', "colour"),
    "two of a name": ('name="straw_flow"', 'name="grain_flow"', "grain_flow"),
    "missing structure": ("<InitialUnknowns>", '<InitialUnknowns a="b">', "InitialUnknowns"),
}


def changed(folder, before, after):
    """The process FMU with a part of its description replaced."""
    assert before in WHOLE
    file = folder / "changed.fmu"
    with zipfile.ZipFile(store_fmu(folder)) as made, zipfile.ZipFile(file, "w") as out:
        for name in made.namelist():
            text = WHOLE.replace(before, after).encode() if name.endswith(".xml") else made.read(name)
            out.writestr(name, text)
    return file


@needs_cc
@pytest.mark.parametrize(("before", "after", "told"), FAULTS.values(), ids=list(FAULTS))
def test_a_fault_is_named_and_does_no_harm(tmp_path, before, after, told):
    fmu = read_fmu(changed(tmp_path, before, after))
    assert any(told in fault for fault in fmu.faults), fmu.faults
    assert {"grain_in", "tank_grain", "ranges", "loss"} <= set(fmu.variables)
    assert fmu.variables["loss"].causality == "parameter"
    assert fmu.variables["grain_in"].unit.name == "kg/s"


BROKEN = ["", "<a/>", WHOLE[:400], WHOLE.replace('valueReference="3"', 'valueReference="x"')]


@needs_cc
def test_a_sound_one_has_no_faults(tmp_path):
    assert read_fmu(store_fmu(tmp_path)).faults == ()
    assert read_fmu(engine_fmu(tmp_path)).faults == ()


@needs_cc
def test_units_that_nobody_defines(tmp_path):
    """One that says what it is counts; one that says nothing is asked for, and can be told."""
    file = changed(tmp_path, '<Unit name="kg/s"><BaseUnit kg="1" s="-1"/></Unit>', "")
    assert read_fmu(file).variables["grain_in"].unit.factor == 1.0
    odd = changed(tmp_path, 'start="0.0" unit="kg/s"', 'start="0.0" unit="scoops"')
    keys = {"file": str(odd), "inputs": {"grain_in": "flow.grain/s"}}
    with pytest.raises(InputError, match=r"units\.grain_in: expected a unit .* 'scoops' says nothing"):
        process_part(**keys)
    assert process_part(**keys, units={"grain_in": "t/h"})


@needs_cc
@pytest.mark.parametrize(
    "text", ["", "<a/>", WHOLE[:400], WHOLE.replace('valueReference="3"', 'valueReference="x"')]
)
def test_what_is_beyond_repair(tmp_path, text):
    file = tmp_path / "broken.fmu"
    with zipfile.ZipFile(file, "w") as out:
        out.writestr("modelDescription.xml", text)
    with pytest.raises(InputError, match=r"broken\.fmu: expected an FMU of FMI 1, 2 or 3, its"):
        read_fmu(file)


TEXTS = {"FMI 2": WHOLE, "FMI 3": engine_xml()}
WORD = re.compile(r"[A-Za-z_]+|[<>/=\"]|\d+")
NEW_WORDS = st.sampled_from(["", "x", "-1", '"', "<b/>", "input", "nan", " "])
CHANGES = st.lists(st.tuples(st.floats(0.0, 1.0), NEW_WORDS), min_size=1, max_size=4)


@pytest.mark.parametrize("whole", TEXTS.values(), ids=list(TEXTS))
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(changes=CHANGES)
def test_mangled_descriptions_are_read_or_refused(tmp_path, whole, changes):
    """Words of the description replaced at random: a description or one clear error, nothing else."""
    words = list(WORD.finditer(whole))
    text = whole
    for place, new in sorted(changes, reverse=True):
        old = words[round(place * (len(words) - 1))]
        text = text[: old.start()] + new + text[old.end() :]
    file = tmp_path / "mangled.fmu"
    with zipfile.ZipFile(file, "w") as out:
        out.writestr("modelDescription.xml", text)
    try:
        fmu = read_fmu(file)
    except InputError:
        return
    assert fmu.major in (2, 3)
    assert all(v.size >= 0 for v in fmu.variables.values())
