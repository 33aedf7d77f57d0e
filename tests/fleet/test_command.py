"""The command: which levels there are, and where those of 0.2 went."""

import pytest

from swath.commands.main import main


@pytest.mark.parametrize(
    ("level", "said"),
    [
        ("kinematic", "expected events or driven; it is `driven` now"),
        ("sensors", "expected events or driven; whole fields have no level with sensors now, version 0.2"),
        ("granted", "expected events or driven"),
    ],
)
def test_a_level_that_is_not_there_says_what_is(capsys, level, said):
    assert main(["fleet", "run", "small-field", "--level", level]) == 2
    assert f"--level = {level}: {said}" in " ".join(capsys.readouterr().err.split())


def test_draws_are_of_events_alone(capsys):
    assert main(["fleet", "run", "small-field", "--level", "driven", "--spread", "5"]) == 2
    assert "expected the level events, not driven" in capsys.readouterr().err


def test_results_of_another_job_are_not_replaced(capsys, tmp_path):
    for name in ("north", "south"):
        (tmp_path / f"{name}.yaml").write_text(
            "format: swath fleet 1\nfield: {boundary_m: [[0, 0], [60, 0], [60, 40], [0, 40]]}\n"
            "combines: {combine: {}}\ntruck: {x_m: 20, y_m: -30}\nfleet: {plans: 2}\n"
        )
    out = ["--out", str(tmp_path / "out of both")]
    assert main(["fleet", "run", str(tmp_path / "north.yaml"), *out]) == 0
    before = (tmp_path / "out of both" / "results.json").read_bytes()
    assert main(["fleet", "run", str(tmp_path / "north.yaml"), *out]) == 0
    assert main(["fleet", "run", str(tmp_path / "south.yaml"), *out]) == 2
    assert "an earlier south, not of north" in " ".join(capsys.readouterr().err.split())
    assert (tmp_path / "out of both" / "results.json").read_bytes() == before
    assert main(["fleet", "run", str(tmp_path / "north.yaml"), *out, "--set", "fleet.plans=1"]) == 2
    assert "not of north with no changes" in " ".join(capsys.readouterr().err.split())
    assert main(["fleet", "run", str(tmp_path / "south.yaml"), *out, "--replace"]) == 0
    page = (tmp_path / "out of both" / "report.html").read_text()
    assert "; machines at" not in page  # the job has no summary


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            "combines.combine.machine=foo",
            "combines.combine.machine = foo: expected a file or one of combine-5m,",
        ),
        ("truck.machine=foo", "truck.machine = foo: expected a file or one of grain-truck"),
        ("field.ways_m=[[[2000,2000],[2100,2100]]]", "field.ways_m[0] = "),
    ],
)
def test_what_leads_nowhere_is_named_by_its_key(capsys, change, said):
    assert main(["fleet", "run", "small-field", "--set", "fleet.plans=1", "--set", change]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert said in told
    assert "grain-cart" not in told
