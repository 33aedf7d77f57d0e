"""What a part of somebody else sends: types, ranges and finiteness of every sample, with file and field."""

import json
from dataclasses import replace

import numpy as np
import pytest

from swath.commands.main import main
from swath.core.checked import CheckedOutput
from swath.core.component import Port
from swath.core.errors import InputError
from swath.signals import CropEdge, OrganSettings, SpeedCommand
from swath.signals.field_map import FieldMap

NAN = float("nan")
EDGE = CropEdge(0, 0.1, 0.0, 0.0, 5.0, 0.9, 0.8, 0.2)
CHECKED = CheckedOutput("combine.edge", "/home/me/my.py:Mine", (Port("edge", CropEdge),))


@pytest.mark.parametrize(
    "change",
    [{}, {"offset": NAN, "heading": NAN}, {"confidence": 1}, {"confidence": np.float64(0.5)},
     {"offset_sd": np.float32(0.1)}, {"is_held": True}, {"is_held": np.bool_(True)}, {"confidence": 0.0}],
)  # fmt: skip
def test_what_a_sample_can_hold_passes(change):
    sent = {"edge": replace(EDGE, **change)}
    assert CHECKED.pass_on(0, sent) is sent
    assert CHECKED.pass_on(20_000_000, {}) == {}


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("confidence", 9, "from 0 to 1"),
        ("confidence", NAN, "from 0 to 1"),
        ("confidence", "0.5", "from 0 to 1"),
        ("offset", 600.0, "from -50 to 50, or nan: no edge"),
        ("offset", float("inf"), "from -50 to 50, or nan: no edge"),
        ("offset", "near", "from -50 to 50, or nan: no edge"),
        ("offset", None, "from -50 to 50, or nan: no edge"),
        ("offset", np.zeros(3), "from -50 to 50, or nan: no edge"),
        ("offset_sd", -0.1, "from 0 to 1e+06, or nan: not known"),
        ("is_held", 0.5, "true or false"),
    ],
)
def test_what_none_can_hold_is_refused_with_file_and_field(field, value, expected):
    with pytest.raises(InputError) as found:
        CHECKED.pass_on(0, {"edge": replace(EDGE, **{field: value})})
    text = str(found.value)
    assert f"combine.edge.edge.{field} = " in text
    assert expected in text
    assert "/home/me/my.py:Mine" in text


@pytest.mark.parametrize("concave", [8.0, -0.005])
def test_a_clearance_in_millimetres_is_no_clearance(concave):
    checked = CheckedOutput("combine.settings", "my.py:Mine", (Port("settings", OrganSettings),))
    checked.pass_on(0, {"settings": OrganSettings(0, concave=0.008)})
    with pytest.raises(InputError, match=r"settings\.concave = .*from 0\.0001 to 0\.1"):
        checked.pass_on(0, {"settings": OrganSettings(0, concave=concave)})


@pytest.mark.parametrize(
    "sent", ["text", None, {"edge": "text"}, {"edge": SpeedCommand(0, 1.0)}, {"x": EDGE}]
)
def test_another_type_is_refused(sent):
    with pytest.raises(InputError, match=r"combine\.edge.*my\.py:Mine"):
        CHECKED.pass_on(0, sent)


def test_arrays():
    checked = CheckedOutput("combine.map", "my.py:Map", (Port("map", FieldMap),))
    right = FieldMap(0, np.arange(3.0), np.array([NAN, 0.5, 1.0]), np.full(3, NAN), np.zeros(3), 9.0)
    assert checked.pass_on(0, {"map": right})
    assert checked.pass_on(0, {"map": replace(right, grain=np.zeros(0), ahead=np.zeros(0))})
    for field, value in (("ahead", np.array([0.0, NAN])), ("grain", np.array([0.0, np.inf])),
                         ("grain_sd", np.array([-1.0])), ("ahead", [0.0, 1.0]), ("ahead", np.zeros((2, 2))),
                         ("ahead", np.array(["a"]))):  # fmt: skip
        with pytest.raises(InputError, match=rf"map\.{field}"):
            checked.pass_on(0, {"map": replace(right, **{field: value})})


WRONG = """
import json
from dataclasses import replace

from swath.control.edge import otsu


class Mine(otsu.Otsu):
    \"\"\"Sure of nothing else.\"\"\"

    Params = otsu.LEVEL.params

    def step(self, t, dt, inputs):
        sent = super().step(t, dt, inputs)
        return {name: replace(edge, confidence=9.0) for name, edge in sent.items()} if t > 1e9 else sent
"""


def test_a_run_with_a_wrong_part_ends_with_its_file_and_field(tmp_path, capsys):
    (tmp_path / "my.py").write_text(WRONG, encoding="utf-8")
    sets = [
        f"combine.edge.level={tmp_path / 'my.py'}:Mine",
        "combine.lidar.level=empirical",
        "run.distance_m=6",
    ]
    changes = [word for text in sets for word in ("--set", text)]
    assert (
        main(["run", "straight", *changes, "--out", str(tmp_path / "run"), "--no-report", "--no-replay"]) == 2
    )
    said = capsys.readouterr().err
    assert "combine.edge.edge.confidence = 9.0: expected a number, from 0 to 1" in said
    assert "my.py" in said
    assert "mistake in swath" not in said


def test_what_a_part_inherits_is_not_blamed_on_swath(tmp_path, capsys):
    """Without the parameters of the level that it is made from, that level cannot be made."""
    (tmp_path / "my.py").write_text("from swath.control.edge import otsu\n\n\nclass Mine(otsu.Otsu): ...\n")
    changes = ["--set", f"combine.edge.level={tmp_path / 'my.py'}:Mine"]
    assert main(["run", "straight", *changes, "--out", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err
    assert f"{tmp_path / 'my.py'}:4: AttributeError" in said
    assert "mistake in swath" not in said


def test_a_part_that_comes_while_a_run_goes_is_checked_too(tmp_path, capsys):
    (tmp_path / "my.py").write_text(WRONG, encoding="utf-8")
    part = f"{tmp_path / 'my.py'}:Mine"
    events = [{"t_s": 0.5, "set": "combine.edge.level", "value": part}]
    (tmp_path / "events.json").write_text(json.dumps(events), encoding="utf-8")
    sets = [
        word for text in ("combine.lidar.level=empirical", "run.distance_m=6") for word in ("--set", text)
    ]
    given = ["--events", str(tmp_path / "events.json"), "--allow", part, "--out", str(tmp_path / "run")]
    assert main(["run", "straight", *sets, *given, "--no-report", "--no-replay"]) == 2
    said = capsys.readouterr().err
    assert "combine.edge.edge.confidence = 9.0: expected a number, from 0 to 1" in said
    assert "my.py" in said
