"""FMUs of both versions, compiled from C: what comes out against closed forms, events, arrays, states."""

from math import exp

import pytest

from swath.link.fmi.calls import FmuError
from swath.link.fmi.child_process import ChildProcess
from swath.link.fmi.description import read_fmu
from swath.link.fmi.make_instance import make_instance
from tests.link.made_fmus import engine_fmu, needs_cc, python_fmu, store_fmu

pytest.importorskip("fmpy")
pytestmark = needs_cc
MODES = {"crash": 1, "hang": 2, "nan": 3, "fails": 4, "fatal": 5, "short": 6, "ends": 7}
SEEN = ("tank_grain", "lost_grain", "held_grain", "steps", "digits")


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return read_fmu(store_fmu(tmp_path_factory.mktemp("fmu")))


@pytest.fixture(scope="module")
def engine(tmp_path_factory):
    return read_fmu(engine_fmu(tmp_path_factory.mktemp("fmu")))


def opened(fmu, inputs, outputs, own=False):
    variables = [[fmu.variables[n] for n in names] for names in (inputs, outputs)]
    return ChildProcess(fmu, "part", *variables, 5.0) if own else make_instance(fmu, "part", *variables)


@pytest.fixture(params=[False, True], ids=["here", "own"])
def part(request, store):
    made = opened(store, ("grain_in", "straw_in", "ranges"), SEEN, request.param)
    yield made
    made.close()


def test_description(store, engine):
    assert (store.major, engine.major) == (2, 3)
    assert store.faults == engine.faults == ()
    assert store.variables["ranges"].refs == (13, 14, 15)
    assert [v.name for v in store.of("input")] == ["grain_in", "straw_in", "ranges"]
    assert engine.clocks[0].interval == 0.1
    assert engine.sized({"length": 7}).variables["x"].size == 7


def test_first_order_store_against_its_closed_form(part):
    assert part.start({"time_constant": 0.5}) == [0.0] * 5
    for k in range(10):
        tank, lost, held, steps, digits = part.step(0.1 * k, 0.1, [5.0, 3.0, 1.0, 2.0, 3.0])
    expected = 5.0 * 0.5 * (1.0 - exp(-1.0 / 0.5))
    assert held == pytest.approx(expected, rel=1e-12)
    assert tank + lost == pytest.approx(5.0 - expected, rel=1e-12)
    assert (steps, digits) == (10.0, 321.0)


def test_a_state_goes_back_to_the_bit(part):
    part.start({})
    part.step(0.0, 0.1, [5.0, 3.0, 0.0, 0.0, 0.0])
    state = part.save()
    first = part.step(0.1, 0.1, [7.0, 3.0, 0.0, 0.0, 0.0])
    part.load(state)
    assert part.step(0.1, 0.1, [7.0, 3.0, 0.0, 0.0, 0.0]) == first


def test_a_state_as_bytes_serves_another_instance(store):
    a, b = (opened(store, ("grain_in",), SEEN) for _ in range(2))
    a.start({})
    b.start({})
    a.step(0.0, 0.1, [5.0])
    b.load(a.save())
    assert b.step(0.1, 0.1, [2.0]) == a.step(0.1, 0.1, [2.0])
    a.close()
    b.close()


def test_another_start_starts_anew(part):
    first = part.start({"loss": 0.5})
    ahead = part.step(0.0, 0.1, [5.0, 3.0, 0.0, 0.0, 0.0])
    assert part.start({"loss": 0.5}) == first
    assert part.step(0.0, 0.1, [5.0, 3.0, 0.0, 0.0, 0.0]) == ahead


def test_a_discarded_step_goes_on_where_it_ended(part):
    part.start({"mode": MODES["short"], "fail_at": 0.0})
    numbers = part.step(0.0, 0.1, [5.0, 3.0, 0.0, 0.0, 0.0])
    assert numbers[3] == 8.0  # 7 of 13 ms and the rest
    assert numbers[0] + numbers[1] + numbers[2] == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize(
    ("mode", "message"),
    [
        ("fails", r"fmi2DoStep gave error; it says: belt 7 is torn"),
        ("fatal", r"fmi2DoStep gave fatal; it says: belt 7 is torn"),
        ("ends", r"it ended the simulation at 0\.5 s of its own accord"),
    ],
)
def test_failures_say_what_the_fmu_says(part, mode, message):
    part.start({"mode": MODES[mode], "fail_at": 0.5})
    for k in range(5):
        part.step(0.1 * k, 0.1, [5.0, 3.0, 0.0, 0.0, 0.0])
    with pytest.raises(FmuError, match=message):
        part.step(0.5, 0.1, [5.0, 3.0, 0.0, 0.0, 0.0])


def test_a_crash_is_an_error_that_names_the_signal(store):
    part = opened(store, ("grain_in",), SEEN, own=True)
    part.start({"mode": MODES["crash"], "fail_at": 0.0})
    folder = part.folder
    assert folder.is_dir()
    with pytest.raises(FmuError, match=r"its process crashed \(SIGSEGV\)"):
        part.step(0.0, 0.1, [0.0])
    assert not folder.exists()
    with pytest.raises(FmuError, match="has ended"):
        part.step(0.1, 0.1, [0.0])
    part.close()


def test_a_hang_is_an_error_after_the_time_out(store):
    variables = [[store.variables["grain_in"]], [store.variables["steps"]]]
    part = ChildProcess(store, "part", *variables, 0.3)
    part.start({"mode": MODES["hang"], "fail_at": 0.0})
    with pytest.raises(FmuError, match=r"no answer within 0\.3 s \(its step\); its process was ended"):
        part.step(0.0, 0.1, [0.0])
    part.close()


def test_own_process_ends_with_its_unit(store):
    part = opened(store, ("grain_in",), SEEN, own=True)
    part.start({})
    child = part.child
    part.close()
    assert child.returncode == 0


ENGINE_SEEN = ("speed", "fuel_used", "events", "ticks", "time_events", "switches", "y")


def engine_after(engine, steps, starts=None, h=0.1):
    sized = engine.sized(starts or {})
    part = opened(sized, ("ground_speed", "x", "engaged"), ENGINE_SEEN)
    part.start(starts or {})
    length = sized.variables["x"].size
    for k in range(steps):
        numbers = part.step(k * h, h, [7.2, *range(length), float(k % 2)])
    part.close()
    return dict(zip(ENGINE_SEEN[:-1], numbers, strict=False)), numbers[6:]


def test_events_clocks_and_discrete_inputs(engine):
    seen, doubled = engine_after(engine, 5)
    assert seen["speed"] == 2000.0 - 72.0
    assert seen["fuel_used"] == pytest.approx(0.5e-3 * 12.2)
    assert seen["time_events"] == 10  # every 50 ms
    assert seen["ticks"] == 6  # every 100 ms, and at 0
    assert seen["switches"] == 4  # a boolean that changes at four of five steps
    assert doubled == [0.0, 2.0, 4.0]


def test_early_return_costs_no_time(engine):
    plain, _ = engine_after(engine, 3)
    early, _ = engine_after(engine, 3, {"early_at": 0.07})
    assert early["fuel_used"] == pytest.approx(plain["fuel_used"], rel=1e-12)
    assert early["events"] == plain["events"] + 1


def test_structural_parameter_makes_arrays_longer(engine):
    _, doubled = engine_after(engine, 1, {"length": 5})
    assert doubled == [0.0, 2.0, 4.0, 6.0, 8.0]


def test_another_start_of_fmi_3(engine):
    part = opened(engine, ("ground_speed",), ("fuel_used",))
    first = part.start({})
    part.step(0.0, 0.05, [3.0])
    assert part.start({}) == first
    part.close()


def test_a_state_in_memory_serves_its_own_instance_only(engine):
    a, b = (opened(engine, ("ground_speed",), ("fuel_used",)) for _ in range(2))
    a.start({})
    b.start({})
    state = a.save()
    one = a.step(0.0, 0.1, [3.0])
    a.load(state)
    assert a.step(0.0, 0.1, [3.0]) == one
    with pytest.raises(FmuError, match="saved by another instance"):
        b.load(state)
    a.close()
    b.close()


def test_missing_functions_are_no_harm_until_they_are_needed(tmp_path):
    fmu = read_fmu(store_fmu(tmp_path, flags=("-DNO_STATES",)))
    part = opened(fmu, ("grain_in",), SEEN)
    part.start({})
    assert part.step(0.0, 0.1, [3.0])[3] == 1.0
    with pytest.raises(FmuError, match="its binary has no function fmi2GetFMUstate"):
        part.save()
    part.close()


TYPES_PY = '''
from pythonfmu3 import Boolean, Float64, Int32, Int64, String, UInt64
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Status, Fmi3StepResult, Fmi3Variability


class PyTypes(Fmi3Slave):
    """Gives back what it is given, one of every type."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.word = 0.0, "none"
        cause, kind = Fmi3Causality, Fmi3Variability
        self.register_variable(Float64("time", causality=cause.independent, variability=kind.continuous))
        self.register_variable(String("word", causality=cause.parameter, variability=kind.tunable))
        for type_, start in ((Int32, 0), (Int64, 0), (UInt64, 0), (Boolean, False), (Float64, 0.0)):
            name = type_.__name__.lower()
            change = kind.continuous if type_ is Float64 else kind.discrete
            for end, causality in (("in", cause.input), ("out", cause.output)):
                setattr(self, f"{name}_{end}", start)
                self.register_variable(type_(f"{name}_{end}", causality=causality, variability=change))
        self.length = 0.0
        self.register_variable(Float64("length", causality=cause.output, variability=kind.continuous))

    def do_step(self, t, h):
        for name in ("int32", "int64", "uint64", "boolean", "float64"):
            setattr(self, name + "_out", getattr(self, name + "_in"))
        self.length = float(len(self.word))
        return Fmi3StepResult(status=Fmi3Status.ok)
'''


def test_every_type_of_number_and_text(tmp_path):
    fmu = read_fmu(python_fmu(tmp_path, TYPES_PY, "pythonfmu3"))
    names = ("int32", "int64", "uint64", "boolean", "float64")
    part = opened(fmu, [f"{n}_in" for n in names], [*(f"{n}_out" for n in names), "length"])
    part.start({"word": "wheat"})
    numbers = part.step(0.0, 0.1, [-7.4, 2.0**40, 3.6, 1.0, 0.25])
    part.close()
    assert numbers == [-7, 2**40, 4, True, 0.25, 5.0]
