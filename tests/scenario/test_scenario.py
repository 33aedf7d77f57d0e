"""Scenario files: what is read, what is refused and with which words."""

from dataclasses import fields
from pathlib import Path

import pytest

from swath.core.errors import InputError, SwathError
from swath.scenario.scenario import load_scenario, parse_scenario
from swath.scenario.slots import CATALOGUE
from tests.fake_levels import FAKE, GOOD

pytestmark = pytest.mark.usefixtures("code_allowed")


def read(text=GOOD, **options):
    return parse_scenario(text, catalogue=FAKE, **options)


def refusal(old, new, **options):
    """The message that reading says after one change to a good scenario."""
    assert old in GOOD
    with pytest.raises(SwathError) as caught:
        read(GOOD.replace(old, new), **options)
    return str(caught.value)


def test_reads_levels_parameters_and_defaults():
    scenario = read()
    lidar = scenario.machines["combine"].slots["lidar"]
    assert (scenario.name, scenario.seed, scenario.run.distance_m) == ("small", 3, 50.0)
    assert (lidar.level, lidar.common.rate_hz, lidar.params.sub_rays) == ("plants", 25.0, 19)
    assert lidar.params.mount.z_m == 2.5
    assert list(scenario.machines["combine"].slots) == ["lidar", "steer", "speed"]
    assert scenario.field.terrain.level == "plane"
    assert scenario.field.edges["edge"].gaps == ((10.0, 12.0),)
    (entry,) = scenario.expect
    assert (entry.subject, entry.name, entry.limit.max) == ("combine", "lateral_rms_m", 0.05)


def test_a_field_may_have_several_edges_by_name():
    edge = GOOD[GOOD.index("  edge:") : GOOD.index("  obstacles:")]
    several = "  edges: {west: {shape: straight}, east: {shape: straight, gaps: [[1, 2]]}}\n"
    scenario = read(GOOD.replace(edge, several))
    assert {name: e.gaps for name, e in scenario.field.edges.items()} == {"west": (), "east": ((1.0, 2.0),)}
    assert read(scenario.resolved()) == scenario
    assert "  edge:" in read().resolved()
    for wrong, message in (
        (edge + several, "field.edges: expected either `edge` or `edges`"),
        ("  edges: {}\n", "field.edges = {}: expected at least one edge by name"),
        ("  edges: {'a.b': {}}\n", "field.edges.a.b: expected an edge's name"),
        ("  edges: {west: {shape: strait}}\n", "field.edges.west.shape = strait: expected one of"),
    ):
        assert message in refusal(edge, wrong)


def test_wires_are_the_slots_own_with_the_scenarios_on_top():
    slots = read().machines["combine"].slots
    assert slots["steer"].wires == {"scan": ("combine.lidar", "scan")}
    other = GOOD.replace("steer: preview", "steer: {level: preview, wires: {scan: cart.lidar.scan}}")
    slots = (
        read(other.replace("\nexpect:", "\n  cart: {machine: lexion-700-class}\nexpect:\n combine:"))
        .machines["combine"]
        .slots
    )
    assert slots["steer"].wires == {"scan": ("cart.lidar", "scan")}


def test_levels_with_fixed_keys_are_read_back_as_they_were_written():
    """Every preset of every slot."""
    found = 0
    for kind in CATALOGUE.slots:
        for level in CATALOGUE.registry.names(kind.name):
            params = CATALOGUE.registry.get(kind.name, level).params
            if params is None or all(f.init for f in fields(params)):
                continue
            scenario = load_scenario("unload-on-the-go", sets=[f"combine.{kind.name}.level={level}"])
            assert parse_scenario(scenario.resolved()) == scenario
            found += 1
    assert found >= 5


def test_a_slot_can_be_off():
    scenario = read(GOOD.replace("steer: preview", "steer: off"))
    assert "steer" not in scenario.machines["combine"].slots
    assert read(scenario.resolved()) == scenario


def test_resolved_reads_back_equal_from_another_place(tmp_path):
    (tmp_path / "map.tif").write_bytes(b"x")
    (tmp_path / "mine.py").write_text(
        "from dataclasses import dataclass\n"
        "class Steer:\n"
        "    '''Mine.'''\n"
        "    @dataclass(frozen=True)\n"
        "    class Params:\n"
        "        gain: float = 1.5\n"
        "    def __init__(self, params, setup): ...\n"
    )
    text = GOOD.replace("plane", "{level: dem, file: map.tif}")
    text = text.replace("steer: preview", "steer: {level: 'mine.py:Steer', gain: 2}")
    (tmp_path / "here.yaml").write_text(text)
    scenario = load_scenario(tmp_path / "here.yaml", catalogue=FAKE)
    assert scenario.machines["combine"].slots["steer"].params.gain == 2
    assert scenario.field.terrain.params.file == str(tmp_path / "map.tif")
    run = tmp_path / "run"
    run.mkdir()
    (run / "scenario.yaml").write_text(scenario.resolved())
    again = load_scenario(run, catalogue=FAKE)
    assert again == scenario
    assert again.resolved() == scenario.resolved()
    assert read() != read(sets=["seed=4"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rate_hz: 25", "rate_hz: -5", "combine.lidar.rate_hz = -5: expected > 0 (text:20)"),
        (
            "rate_hz: 25",
            "rate_hz: 25 Hz",
            "rate_hz = 25 Hz: expected a number in Hz, without the unit (text:20)",
        ),
        ("rate_hz: 25", "rate_hz: '25'", "rate_hz = 25: expected a number in Hz, without quotes (text:20)"),
        ("rate_hz: 25", "rate_hz: true", "rate_hz = True: expected a number in Hz (text:20)"),
        ("rate_hz: 25", "rate_hz:", "rate_hz = (nothing): expected a number in Hz (text:20)"),
        ("rate_hz: 25", "rate_hz: .nan", "rate_hz = .nan: expected a finite number (text:20)"),
        ("rate_hz: 25", "rate_hz: -.inf", "rate_hz = -.inf: expected a finite number (text:20)"),
        ("rate_hz: 25", "rate_hz: 1e999", "rate_hz = 1e999: expected a finite number (text:20)"),
        ("seed: 3", "seed: 1" + 30 * "0", "expected a finite number (text:4)"),
        ("seed: 3", "seed: 3.5", "seed = 3.5: expected a whole number (text:4)"),
        ("seed: 3", "sead: 3", "sead: unknown key, did you mean 'seed'? (text:4)"),
        ("field:", "feild:", "feild: unknown key, did you mean 'field'? (text:6)"),
        ("speed_kmh: 7", "speed_mph: 7", "unknown key, did you mean 'speed_kmh'? expected in km/h (text:24)"),
        (
            "    speed:",
            "    weather: {}\n    speed:",
            "combine.weather: unknown key, did you mean field.weather?",
        ),
        ("speed_kmh: 7", "sped_kmh: 7", "sped_kmh: unknown key, did you mean 'speed_kmh'? (text:24)"),
        (
            "speed_kmh: 7",
            "speed_kmh: 7 km/h",
            "speed_kmh = 7 km/h: expected a number in km/h, without the unit",
        ),
        ("stems_per_m2", "stems_per_ha", "did you mean 'stems_per_m2'? expected in 1/m2 (text:10)"),
        ("stems_per_m2: 400", "stems_per_m2: 1e9", "stems_per_m2 = 1000000000.0: expected <= 2000 (text:10)"),
        ("{z_m: 2.5}", "{zz_m: 2.5}", "combine.lidar.mount.zz_m: unknown key, did you mean 'z_m'? (text:21)"),
        ("{z_m: 2.5}", "{z_m: true}", "combine.lidar.mount.z_m = True: expected a number in m (text:21)"),
        ("{z_m: 2.5}", "3", "combine.lidar.mount = 3: expected a mapping of keys (text:21)"),
        (
            "shape: straight",
            "shape: strait",
            "field.edge.shape = strait: expected one of curve, straight, did you",
        ),
        ("kind: post, ", "", "field.obstacles.0.kind: expected one of box, post (text:13)"),
        (
            "x_m: 3, y_m",
            "x: 3, y_m",
            "field.obstacles.0.x: unknown key, did you mean 'x_m'? expected in m (text:13)",
        ),
        ("[10, 12]", "[10, 12, 13]", "field.edge.gaps.0 = [10, 12, 13]: expected at most 2 items (text:11)"),
        (
            "preview",
            "previw",
            "combine.steer = previw: expected one of preview, pursuit, or file.py:Class, did",
        ),
        (
            "plane",
            "{level: dem, file: no.tif}",
            "field.terrain.file = no.tif: there is no such file (text:7)",
        ),
        ("plane", "{level: dem}", "field.terrain.file: expected a value, the key is missing (text:7)"),
        ("preview", "nowhere.py:Steer", "expected a Python file, but there is no file"),
        ("lexion-700-class", "lexion-900-class", "did you mean 'lexion-700-class'? (text:16)"),
        (
            "lidar.scan",
            "lidr.scan",
            "wires.scan = lidr.scan: expected slot.output of a slot that is there, did you",
        ),
        ("lidar.scan", "scan", "wires.scan = scan: expected slot.output or machine.slot.output (text:22)"),
        ("{max: 0.05}", "{max: 1, min: 2}", "expected min <= max (text:26)"),
        (
            "mount: {z_m",
            "sensor: sick\n      mount: {z_m",
            "lidar.sensor = sick: expected a file or one of ",
        ),
        (
            "level: uniform",
            "crop: oats",
            "field.stand.crop = oats: expected a file or one of barley, maize, ",
        ),
        ("{max: 0.05}", "{}", "expected min, max or both (text:26)"),
        (
            "lateral_rms_m",
            "lateral_rsm_m",
            "expect.lateral_rsm_m: unknown metric, did you mean 'lateral_rms_m'?",
        ),
        ("along_edge_m: 2", "x_m: 2", "combine.start.y_m: expected a value, the key is missing (text:17)"),
        (
            "name: small",
            "name: a/b",
            "name = a/b: expected at most 64 letters, digits, dots, - and _ (text:2)",
        ),
    ],
)
def test_refusals(old, new, message):
    text = refusal(old, new)
    assert message in text
    assert "\n" not in text


def test_a_check_between_keys_names_the_key():
    text = refusal("stems_per_m2: 400", "stems_per_m2: 1200\n    row_spacing_m: 0.6")
    assert text == "field.stand.row_spacing_m = 0.6: expected at most 0.5 at this density (text:11)"


def test_a_check_in_a_nested_class_gets_its_full_key():
    gaps = "{shape: straight, gaps: [[1, 2]], teeth: [{depth_m: 1}, {depth_m: 9}]}"
    text = refusal("{shape: straight, length_m: 80, gaps: [[10, 12]]}", gaps)
    assert text == "field.edge.teeth.1.depth_m = 9: expected at most 5 (text:11)"
    with pytest.raises(InputError, match=r"field.edge.teeth.0.depth_m = 8: expected at most 5 \(--set"):
        read(sets=["field.edge.teeth=[{depth_m: 8}]"])


def test_all_errors_are_kept_the_first_is_the_message():
    with pytest.raises(InputError) as caught:
        read(GOOD.replace("rate_hz: 25", "rate_hz: 0").replace("seed: 3", "seed: -1"))
    assert caught.value.key == "seed"
    assert [e.key for e in caught.value.others] == ["combine.lidar.rate_hz"]


def test_no_machine_and_no_mapping():
    with pytest.raises(SwathError, match="expected a machine"):
        read("format: swath scenario 2\nfield: {edge: {shape: straight}}")
    for text in ("", "3", "[1, 2]", "hello"):
        with pytest.raises(SwathError, match="expected keys such as"):
            read(text)


def test_named_scenarios_say_what_there_is(tmp_path):
    with pytest.raises(
        InputError, match=r"scenario = strait: expected a file or one of .*did you mean 'straight'"
    ):
        load_scenario("strait")
    with pytest.raises(InputError, match="there is no such file"):
        load_scenario(tmp_path / "none.yaml")


class TestOverrides:
    def test_value_is_yaml_and_shorthand_opens_up(self):
        scenario = read(sets=["combine.steer.speed_kmh=9", "combine.lidar.sector_deg=[-30, 30]", "seed=7"])
        slots = scenario.machines["combine"].slots
        assert (slots["steer"].level, slots["steer"].params.speed_kmh) == ("preview", 9.0)
        assert (slots["lidar"].params.sector_deg, scenario.seed) == ((-30.0, 30.0), 7)

    def test_another_level_drops_what_only_the_old_one_knew(self):
        lidar = read(sets=["combine.lidar.level=empirical"]).machines["combine"].slots["lidar"]
        assert (lidar.level, lidar.common.rate_hz, lidar.params.spread_m) == ("empirical", 25.0, 0.1)

    @pytest.mark.parametrize("level", ["otsu", "likelihood_ratio"])
    def test_a_level_in_a_recorded_scenario_is_the_one_it_would_have_been(self, level):
        other = {"otsu": "likelihood_ratio", "likelihood_ratio": "otsu"}[level]
        own = {"otsu": "search_m", "likelihood_ratio": "hold_m"}[level]
        written = [f"combine.edge={{level: {other}}}", "combine.speed.speed_kmh=5"]
        recorded = parse_scenario(load_scenario("bend", sets=written).resolved())
        chosen = {"combine.edge.level": level, f"combine.edge.{own}": 3.25}
        sets = [f"{key}={value}" for key, value in chosen.items()]
        again = parse_scenario(recorded.resolved(), sets=sets).machines["combine"].slots
        fresh = load_scenario("bend", sets=sets).machines["combine"].slots
        assert again["edge"].params == fresh["edge"].params
        assert again["speed"].params.speed_kmh == 5.0

    def test_a_machine_that_a_flag_adds_says_which_it_is(self):
        sets = ["cart.start.x_m=9", "cart.start.y_m=9", "cart.machine=tractor-grain-cart"]
        added = read(GOOD.partition("\nexpect:")[0], sets=sets)
        assert list(added.machines) == ["combine", "cart"]

    def test_paths_in_a_flag_start_from_the_working_directory(self, tmp_path, monkeypatch):
        (tmp_path / "far").mkdir()
        (tmp_path / "map.tif").write_bytes(b"x")
        (tmp_path / "far" / "here.yaml").write_text(GOOD)
        monkeypatch.chdir(tmp_path)
        flag = "field.stand.density_file=map.tif"
        stand = load_scenario("far/here.yaml", catalogue=FAKE, sets=[flag]).field.stand
        assert stand.params.density_file == str(tmp_path / "map.tif")

    def test_inside_a_list(self):
        assert read(sets=["field.obstacles.0.x_m=8"]).field.obstacles[0].x_m == 8.0

    @pytest.mark.parametrize(
        ("flag", "message"),
        [
            ("combine.lidar.rate_hz=-3", "lidar.rate_hz = -3: expected > 0 (--set combine.lidar.rate_hz=-3)"),
            (
                "combine.lidar.rate=3",
                "unknown key, did you mean 'rate_hz'? expected in Hz (--set combine.lidar.r",
            ),
            ("combine.steer=prevew", "did you mean 'preview'? (--set combine.steer=prevew)"),
            ("foo", "--set foo: expected --set key.key=value"),
            ("foo=1", "foo: unknown key; a machine has keys such as"),
            (
                "combinee.lidar.level=empirical",
                "combinee: unknown key, did you mean 'combine'? (--set combinee.",
            ),
            (
                "machines.combin.edge_side=left",
                "combin: unknown key, did you mean 'combine'? (--set machines.",
            ),
            (
                "combin={lidar: {level: empirical}}",
                "combin: unknown key, did you mean 'combine'? (--set combin={lidar",
            ),
            ("felds.edge.level=truth", "felds: unknown key, did you mean 'field'? (--set felds."),
            ("tractor.lidar.level=empirical", "tractor: unknown key, expected one of combine, name, summary"),
            ("seed=[[", "--set seed=[[: "),
            ("seed.x=1", "--set seed.x=1: seed has no keys inside"),
            ("field.obstacles.3.x_m=3", "expected a number below 1 instead of 3"),
            ("combine.lidar.level=", "combine.lidar.level = (nothing): expected a level's name (--set "),
        ],
    )
    def test_errors_name_the_flag(self, flag, message):
        with pytest.raises(SwathError) as caught:
            read(sets=[flag])
        assert message in str(caught.value)


class TestLocate:
    @pytest.mark.parametrize(
        ("key", "line"),
        [
            ("combine.lidar.mount.z_m", 21),
            ("combine.lidar.mount.roll_deg", 21),
            ("lidar.mount.z_m", 21),
            ("mount.z_m", 21),
            ("combine.speed.period", 24),
            ("field.obstacles.0.x_m", 13),
        ],
    )
    def test_finds_full_keys_ends_of_keys_and_parents(self, key, line):
        located = read().locate(InputError(key, -1, "expected more"))
        assert (located.key.rpartition(".")[2], located.line) == (key.rpartition(".")[2], line)
        assert str(located).endswith(f"= -1: expected more (text:{line})")

    def test_keeps_a_place_that_is_known(self):
        error = InputError("range.noise_mm", 1, "expected rows", file="a.yaml", line=3)
        assert read().locate(error) is error

    def test_an_unknown_key_stays_as_it_is(self):
        assert str(read().locate(InputError("foo.bar", 1, "expected 2"))) == "foo.bar = 1: expected 2"


def test_an_error_of_a_flag_is_in_no_file():
    scenario, error = load_scenario("straight"), InputError("--out", "there", "expected another folder")
    assert str(scenario.locate(error)) == "--out = there: expected another folder"


def test_an_open_wire_names_the_file_and_what_could_be_its_source(tmp_path):
    from swath.core.foreign_code import allow_code
    from swath.runtime.assembly import assemble

    own, text = tmp_path / "own.py", Path("examples/my_edge_detector.py").read_text(encoding="utf-8")
    own.write_text(text.replace('Port("scan"', 'Port("lidar_scan"'), encoding="utf-8")
    said = r"combine\.edge\.lidar_scan: input is not connected.*combine\.lidar\.scan \(.*straight\.yaml\)"
    sets = [f"combine.edge.level={own}:MyEdgeDetector", "combine.lidar.level=empirical"]
    with allow_code(None), pytest.raises(SwathError, match=said):
        assemble(load_scenario("straight", sets=sets))
