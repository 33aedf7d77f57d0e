"""Which values of a run nobody wrote, and how they are said."""

import pytest

from swath.scenario.defaults import default_lines, defaults, paragraphs
from swath.scenario.scenario import parse_scenario
from tests.fake_levels import FAKE, GOOD

SHORT = (
    "{format: swath scenario 2, name: a, field: {edge: {shape: straight}}, "
    "machines: {combine: {lidar: plants}}}"
)


def read(text=GOOD, sets=()):
    return parse_scenario(text, sets=sets, catalogue=FAKE)


def said(scenario):
    return {title: text.replace("\N{NO-BREAK SPACE}", " ") for title, text in paragraphs(scenario)}


def test_only_what_is_not_written():
    rest = defaults(read())
    assert "seed" not in rest
    assert "expect" not in rest
    assert rest["run"] == {"max_duration_s": 120.0, "record": "exact", "on_contact": "end"}
    lidar = rest["combine"]["lidar"]
    assert lidar["mount"] == {"pitch_deg": 16.0}
    assert not {"level", "rate_hz", "wires"} & set(lidar)
    assert lidar["sector_deg"] is None
    assert rest["combine"]["steer"]["speed_kmh"] == 7.0
    assert "level" not in rest["combine"]["steer"]
    assert "speed_kmh" not in rest["combine"]["speed"]
    assert rest["combine"]["speed"]["level"] == "constant"
    assert rest["field"]["obstacles"] == {0: {"height_m": 2.0}}


def test_a_flag_writes_too():
    changed = read(
        sets=["combine.lidar.mount.pitch_deg=16", "combine.speed.level=constant", "run.record=exact"]
    )
    rest = defaults(changed)
    assert "mount" not in rest["combine"]["lidar"]
    assert "level" not in rest["combine"]["speed"]
    assert "record" not in rest["run"]


def test_a_resolved_scenario_has_no_defaults_left():
    whole = read(read().resolved())
    assert defaults(whole) == {}
    assert paragraphs(whole) == []
    assert default_lines(whole) == set()


def test_a_paragraph_per_slot():
    texts = said(read())
    assert texts["run"] == "max_duration_s 120, record exact, on_contact end"
    assert texts["field"] == "edge (teeth []), obstacles.0 (height_m 2)"
    lidar = "sensor sick-lms511-hr, mount (pitch_deg 16), sub_rays 19, echo percentile, noise true"
    assert texts["lidar plants"] == f"{lidar}; null: sector_deg"
    assert texts["speed constant"] == "level constant, rate_hz 10"
    assert texts["every slot"] == "offset_ms 0, latch false, wires none, where not written otherwise"


def test_machines_name_their_slots_where_there_are_several():
    texts = said(read(SHORT[:-2] + ", cart: {lidar: empirical}}}"))
    assert "spread_m 0.1" in texts["cart.lidar empirical"]
    assert "sub_rays 19" in texts["combine.lidar plants"]


def test_key_and_value_stay_on_one_line():
    assert "rate_hz\N{NO-BREAK SPACE}10" in dict(paragraphs(read()))["speed constant"]


@pytest.mark.parametrize("text", [GOOD, SHORT])
def test_lines_of_the_resolved_file(text):
    scenario = read(text)
    lines, marked = scenario.resolved().splitlines(), default_lines(scenario)
    pale = [lines[number - 1].strip() for number in sorted(marked)]
    assert "sub_rays: 19" in pale
    assert "pitch_deg: 16.0" in pale
    assert ("z_m: 2.4" in pale) == (text == SHORT)
    assert ("mount:" in pale) == (text == SHORT)  # pale only where all of it is
    assert not any(line.startswith(("name:", "combine:")) for line in pale)
