"""Systems of several FMUs: order, conversions on the way, parameters, nesting, states, what is refused."""

import re
from math import exp
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swath.core.errors import InputError
from swath.link.fmi.composite import Composite, describe_system
from swath.link.fmi.ssp import read_system
from swath.runtime.assembly import assemble
from swath.runtime.evaluation import make_evaluation
from swath.runtime.loop import drive
from tests.evaluated import metrics_of
from tests.link.fmu_scenario import process_part, scenario
from tests.link.made_fmus import (
    PROCESS,
    SSD,
    component,
    connection,
    connector,
    needs_cc,
    package,
    parameters,
    store_fmu,
    system,
)

pytest.importorskip("fmpy")
pytestmark = [needs_cc, pytest.mark.usefixtures("code_allowed")]
FILES = ("resources/store.fmu", "resources/tonnes.fmu")
OUTS = [connector("out", "output"), connector("held", "output")]


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ssp")
    tonnes = [("grain_in", "input", "t/h", 0.0), *PROCESS[1:]]
    return store_fmu(folder), store_fmu(folder, "tonnes.fmu", variables=tonnes)


def opened(file, inputs, outputs, **more):
    read = read_system(file)
    found = describe_system(read)[0].variables
    made = Composite(read, "part", [found[n] for n in inputs], [found[n] for n in outputs], **more)
    return SimpleNamespace(unit=made, variables=found)


def chain(folder, fmus, *links, first=FILES[0], second=FILES[0], order=("A", "B"), name="chain.ssp"):
    """Two stores one behind the other."""
    parts = {
        "A": component("A", first, time_constant=0.5, loss=0.0),
        "B": component("B", second, time_constant=0.2),
    }
    connections = [connection("feed", "A.grain_in"), *links, connection("B.grain_flow", "out")]
    text = system(
        "works",
        [connector("feed", "input", "kg/s"), *OUTS],
        [parts[n] for n in order],
        [*connections, connection("A.held_grain", "held")],
    )
    return package(folder, name, text, *fmus)


PLAIN = connection("A.grain_flow", "B.grain_in")


def held_of_b(folder, fmus, *links, steps=5, **more):
    made = opened(
        chain(folder, fmus, *links, **more), ["feed"], ["held", "B.held_grain", "A.grain_flow"]
    ).unit
    made.start({})
    rows = [made.run([(0.1 * k, 0.1, [5.0])]) for k in range(steps)]
    made.close()
    return rows


def store(held, flow, lag, h=0.1):
    """The model of fmu2.c: (held, flow out)."""
    after = held * exp(-h / lag) + flow * lag * (1.0 - exp(-h / lag))
    return after, (held + flow * h - after) / h


def by_hand(steps, factor=1.0, *, late=False):
    a = b = flow = 0.0
    rows = []
    for _ in range(steps):
        before = flow
        a, flow = store(a, 5.0, 0.5)
        b, _ = store(b, factor * (before if late else flow), 0.2)
        rows.append([a, b, flow])
    return rows


def close(rows, expected):
    return all(r == pytest.approx(e, rel=1e-12) for r, e in zip(rows, expected, strict=True))


def test_components_run_in_declared_order(tmp_path, fmus):
    assert close(held_of_b(tmp_path, fmus, PLAIN), by_hand(5))
    assert close(held_of_b(tmp_path, fmus, PLAIN, order=("B", "A")), by_hand(5, late=True))


def test_the_files_of_these_tests_are_valid(tmp_path, fmus):
    ssd = pytest.importorskip("fmpy.ssp.ssd")
    assert ssd.read_ssd(chain(tmp_path, fmus, PLAIN)).name == "works"  # checked against the schema


def test_conversions_on_the_way(tmp_path, fmus):
    to_tonnes = {"second": FILES[1]}
    assert close(held_of_b(tmp_path, fmus, PLAIN, **to_tonnes), by_hand(5, 3.6))
    double = connection("A.grain_flow", "B.grain_in", '<ssc:LinearTransformation factor="2"/>')
    assert close(held_of_b(tmp_path, fmus, double, **to_tonnes), by_hand(5, 7.2))
    raw = connection("A.grain_flow", "B.grain_in", suppressUnitConversion="true")
    assert close(held_of_b(tmp_path, fmus, raw, **to_tonnes), by_hand(5))


def test_a_feed_of_the_whole_is_converted_for_its_component(tmp_path, fmus):
    rows = held_of_b(tmp_path, fmus, PLAIN, first=FILES[1])
    single = by_hand(5)
    assert rows[-1][0] == pytest.approx(3.6 * single[-1][0], rel=1e-12)


def test_systems_within_systems(tmp_path, fmus):
    inner = system(
        "Inner",
        [connector("u", "input"), connector("y", "output")],
        [component("B", FILES[0], time_constant=0.2)],
        [
            connection("u", "B.grain_in", '<ssc:LinearTransformation factor="3"/>'),
            connection("B.grain_flow", "y"),
        ],
    )
    text = system(
        "works",
        [connector("feed", "input", "kg/s"), connector("out", "output")],
        [component("A", FILES[0], time_constant=0.5), inner],
        [
            connection("feed", "A.grain_in"),
            connection("A.grain_flow", "Inner.u"),
            connection("Inner.y", "out"),
        ],
    )
    made = opened(package(tmp_path, "deep.ssp", text, *fmus), ["feed"], ["Inner.B.held_grain", "out"]).unit
    made.start({})
    rows = [made.run([(0.1 * k, 0.1, [5.0])]) for k in range(5)]
    made.close()
    assert [r[0] for r in rows] == pytest.approx([b for _, b, _ in by_hand(5, 3.0)], rel=1e-12)


@pytest.mark.parametrize("own", [False, True])
def test_a_state_goes_back(tmp_path, fmus, own):
    made = opened(chain(tmp_path, fmus, PLAIN), ["feed"], ["held", "B.held_grain"], own=own).unit
    made.start({})
    made.run([(0.0, 0.1, [5.0])])
    state = made.save()
    ahead = made.run([(0.1, 0.1, [3.0])])
    made.load(state)
    assert made.run([(0.1, 0.1, [3.0])]) == ahead
    made.close()


def test_parameters_of_the_whole_reach_its_components(tmp_path, fmus):
    bindings = parameters(**{"A.time_constant": 0.5, "B.time_constant": 0.2, "A.nothing": 1})
    parts = [component("A", FILES[0]), component("B", FILES[0])]
    ends = [connection("feed", "A.grain_in"), PLAIN]
    text = system("works", [connector("feed", "input", "kg/s")], parts, ends, bindings)
    made = opened(
        package(tmp_path, "bound.ssp", text, *fmus), ["feed"], ["A.held_grain", "B.held_grain"]
    ).unit
    made.start({"B.loss": 0.5})
    rows = [made.run([(0.1 * k, 0.1, [5.0])]) for k in range(5)]
    made.close()
    assert close(rows, [row[:2] for row in by_hand(5)])


PROCESS_OUTPUTS = {
    "load.tank_grain": "B.tank_grain",
    "load.lost_grain": "B.lost_grain",
    "load.dropped_straw": "B.dropped_straw",
    "load.held_grain": "B.held_grain",
    "load.held_straw": "B.held_straw",
    "load.grain_flow": "B.grain_flow",
    "load.straw_flow": "B.straw_flow",
}


def run(file, **more):
    world = assemble(scenario(process={"level": "fmu", "file": str(file), **more}))
    evaluation = make_evaluation(world)
    drive(world, [evaluation])
    load = world.graph.latest("combine.process", "load")
    world.close()
    return load, metrics_of(evaluation)["mass_balance_error"]


def test_a_system_as_the_process_of_a_machine(tmp_path, fmus):
    """Grain through two stores, straw through the second; A holds next to nothing, so the balance closes."""
    file = chain(tmp_path, fmus, PLAIN)
    inputs = {"feed": "flow.grain/s", "B.straw_in": "flow.straw/s"}
    load, error = run(file, inputs=inputs, outputs=PROCESS_OUTPUTS, parameters={"A.time_constant": 1e-15})
    assert error < 1e-12
    assert load.tank_grain > 5.0
    assert load.dropped_straw > 5.0


def test_one_component_as_the_process_with_its_values_in_the_file(tmp_path, fmus):
    file = chain(tmp_path, fmus, PLAIN)
    feed = {"grain_in": "flow.grain/s", "straw_in": "flow.straw/s"}
    load, error = run(file, component="A", inputs=feed)
    assert error < 1e-12
    assert load.lost_grain == 0.0  # loss = 0 of component A
    assert load.tank_grain > 5.0


def test_a_description_beside_its_fmus(tmp_path, fmus):
    folder = tmp_path / "resources"
    folder.mkdir()
    for fmu in fmus:
        (folder / fmu.name).write_bytes(fmu.read_bytes())
    text = system(
        "works", [connector("feed", "input")], [component("A", FILES[0])], [connection("feed", "A.grain_in")]
    )
    file = tmp_path / "works.ssd"
    file.write_text(SSD.format(system=text), encoding="utf-8")
    made = opened(file, ["feed"], ["A.held_grain"])
    assert made.variables["feed"].unit.name == "kg/s"  # of the variable behind it


REFUSED = [
    (connection("A.grain_flow", "B.grain"), r"there is no B\.grain"),
    (connection("A.tank_grain", "B.grain_in"), r"A\.tank_grain is in kg, B\.grain_in in kg/s"),
    (PLAIN + PLAIN, r"two connections end at B\.grain_in"),
    (
        connection("A.grain_flow", "B.grain_in", "<ssc:BooleanMappingTransformation/>"),
        "linear transformations only",
    ),
]


@pytest.mark.parametrize(("link", "message"), REFUSED, ids=lambda v: v[:30])
def test_what_cannot_be_connected(tmp_path, fmus, link, message):
    with pytest.raises(InputError, match=message):
        process_part(file=str(chain(tmp_path, fmus, link)), outputs={"load.tank_grain": "out"})


def test_files_that_are_none(tmp_path, fmus):
    with pytest.raises(InputError, match=r"component = C: expected one of A, B"):
        process_part(file=str(chain(tmp_path, fmus, PLAIN)), component="C")
    with pytest.raises(InputError, match=r"expected a file \.ssp or \.ssd"):
        process_part(file=str(fmus[0]), component="A")
    missing = package(tmp_path, "m.ssp", system("s", [], [component("A", "resources/a.fmu")], []))
    with pytest.raises(InputError, match=r"expected an FMU for component A, its source is resources/a\.fmu"):
        process_part(file=str(missing))
    (tmp_path / "x.ssp").write_bytes(b"no zip")
    with pytest.raises(InputError, match="expected a System Structure Package"):
        process_part(file=str(tmp_path / "x.ssp"))


SSV = """<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
 name="p" version="1.0">
<ssv:Parameters><ssv:Parameter name="time_constant"><ssv:Real value="500" unit="ms"/></ssv:Parameter>
</ssv:Parameters></ssv:ParameterSet>"""


def test_parameters_in_a_file_of_their_own(tmp_path, fmus):
    """In another unit than the variable's, under a prefix."""
    binding = '<ssd:ParameterBinding source="p.ssv" prefix="A."/>'
    bindings = f"<ssd:ParameterBindings>{binding}</ssd:ParameterBindings>"
    folder = tmp_path / "resources"
    folder.mkdir()
    (folder / "store.fmu").write_bytes(fmus[0].read_bytes())
    (tmp_path / "p.ssv").write_text(SSV, encoding="utf-8")
    ends = [connection("feed", "A.grain_in")]
    text = system("works", [connector("feed", "input")], [component("A", FILES[0])], ends, bindings)
    (tmp_path / "works.ssd").write_text(SSD.format(system=text), encoding="utf-8")
    assert read_system(tmp_path / "works.ssd").starts == {("A", "time_constant"): 0.5}


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    changes=st.lists(
        st.tuples(st.floats(0.0, 1.0), st.sampled_from(["", "x", "-1", '"', "<b/>", "A", "B"])),
        min_size=1,
        max_size=3,
    )
)
def test_mangled_systems_are_read_or_refused(tmp_path, fmus, changes):
    """Words of the file replaced at random: a system or one clear error, nothing else."""
    folder = tmp_path / "resources"
    folder.mkdir(exist_ok=True)
    for fmu in fmus:
        (folder / fmu.name).write_bytes(fmu.read_bytes())
    double = connection("A.grain_flow", "B.grain_in", '<ssc:LinearTransformation factor="2"/>')
    parts = [component("A", FILES[0], loss=0.5), component("B", FILES[1])]
    ends = [connection("feed", "A.grain_in"), double, connection("B.grain_flow", "out")]
    text = SSD.format(system=system("works", [connector("feed", "input", "kg/s"), *OUTS], parts, ends))
    words = list(re.finditer(r"[A-Za-z_]+|[<>/=\"]|\d+", text))
    for place, new in sorted(changes, reverse=True):
        old = words[round(place * (len(words) - 1))]
        text = text[: old.start()] + new + text[old.end() :]
    file = tmp_path / "works.ssd"
    file.write_text(text, encoding="utf-8")
    try:
        read = read_system(file)
    except InputError:
        return
    assert describe_system(read)[0].variables
