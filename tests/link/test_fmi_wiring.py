"""Names that are guessed, amounts that are spread over sub-steps, notes about what stays open."""

import itertools

import pytest

from swath.core.errors import InputError
from swath.link.fmi.units import Scale
from swath.link.fmi.wiring import Into
from swath.link.levels.fmu import Feed
from swath.runtime.assembly import assemble
from swath.runtime.loop import drive
from swath.signals import CropFlow
from swath.signals.flat import flat_fields
from tests.link.fmu_scenario import process_part, scenario
from tests.link.made_fmus import PROCESS, needs_cc, store_fmu

pytestmark = pytest.mark.usefixtures("code_allowed")

pytest.importorskip("fmpy")
MS = 1_000_000


def wiring_of(folder, **names):
    """The wiring of a process FMU whose variables are renamed."""
    variables = [(names.get(n, n), c, u, s) for n, c, u, s in PROCESS]
    file = store_fmu(folder, variables=variables)
    return process_part(file=str(file))._wiring


@needs_cc
@pytest.mark.parametrize(
    ("name", "target", "mode"),
    [
        ("grain_flow_in", None, None),
        ("flow_grain", None, None),  # kg, but the variable is in kg/s: see below
        ("Flow.Grain_Flow", "flow.grain", "rate"),
        ("straw_rate", "flow.straw", "rate"),
    ],
)
def test_names_that_are_guessed(tmp_path, name, target, mode):
    found = {i.variable.name: i for i in wiring_of(tmp_path, grain_in=name).inputs}
    if name == "flow_grain":
        assert found[name].mode == "rate"  # by its unit
    elif target is None:
        assert name not in found
    else:
        assert f"{found[name].port}.{found[name].field.name}" == target
        assert found[name].mode == mode


@needs_cc
def test_a_name_that_fits_two_is_an_error(tmp_path):
    variables = [("speed", "input", "m/s", 0.0), *PROCESS[1:]]
    file = store_fmu(tmp_path, variables=variables)
    with pytest.raises(InputError, match=r"inputs\.speed: expected one of state\.speed or engine\.speed"):
        process_part(file=str(file))


@needs_cc
def test_a_port_that_is_silent_is_noted(tmp_path):
    variables = [("engine_speed", "input", "rpm", 1900.0), *PROCESS[1:]]
    file = store_fmu(tmp_path, variables=variables)
    world = assemble(scenario(process={"level": "fmu", "file": str(file)}))
    drive(world, until_s=0.2)
    assert any("nothing comes from engine" in n for n in world.leader.notes)
    world.close()


class _Number:
    """As much of an FMU variable as a feed looks at."""

    def __init__(self, name):
        self.name, self.size, self.is_array = name, 1, False


SAME = Scale()


def fed(mode, samples, cuts, scale=SAME):
    """Numbers of the sub-steps between `cuts` [ms] for these samples in one step."""
    into = Into(_Number("u"), "flow", flat_fields(CropFlow)["grain"], mode, scale)
    feed = Feed([into], [0.0])
    feed.take(cuts[0] * MS, (cuts[-1] - cuts[0]) * MS, {"flow": tuple(samples)})
    return [feed.numbers(a * MS, b * MS)[0] for a, b in itertools.pairwise(cuts)]


def flow(t_ms, grain, dt_ms):
    return CropFlow(t_ms * MS, grain, 0.0, 0.0, 0, 1.0, dt_ms * 1e-3)


FIVE = [flow(20 * k, 0.1 * k, 20) for k in range(1, 6)]


@pytest.mark.parametrize("cuts", [[0, 100], [0, 20, 40, 60, 80, 100], [0, 7, 33, 90, 100], [0, 10, 100]])
def test_amounts_are_neither_lost_nor_doubled(cuts):
    sums = fed("sum", FIVE, cuts)
    assert sum(sums) == pytest.approx(1.5, rel=1e-12)
    rates = fed("rate", FIVE, cuts)
    lengths = [(b - a) * 1e-3 for a, b in itertools.pairwise(cuts)]
    assert sum(r * h for r, h in zip(rates, lengths, strict=True)) == pytest.approx(1.5, rel=1e-12)
    assert sums == pytest.approx([r * h for r, h in zip(rates, lengths, strict=True)])


def test_amounts_fall_into_the_sub_steps_in_which_they_arose():
    assert fed("sum", FIVE, [0, 20, 40, 60, 80, 100]) == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    assert fed("sum", FIVE, [0, 10, 20, 100]) == pytest.approx([0.05, 0.05, 1.4])


def test_a_sample_that_began_before_the_step_counts_whole():
    late = [flow(110, 0.4, 40), flow(150, 0.4, 40)]
    assert sum(fed("sum", late, [100, 150, 200])) == pytest.approx(0.8)
    past = [flow(90, 0.3, 20)]
    assert fed("sum", past, [100, 150, 200]) == pytest.approx([0.3, 0.0])


def test_amounts_are_converted():
    assert fed("rate", FIVE, [0, 100], Scale(1 / 3.6)) == pytest.approx([15.0 * 3.6])
