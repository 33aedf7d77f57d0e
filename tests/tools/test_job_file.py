"""The reference and the JSON Schema of job files: up to date, and of one mind with the reader."""

import json
from dataclasses import replace

import jsonschema
import pytest
from docs.make.fleet import BEGIN, PAGE, reference

from swath.commands.main import main
from swath.documents.data_sheets import find_sheet
from swath.documents.yaml_document import parse
from swath.fleet.files import RENAMED, job_schema, read_job

JOBS = sorted(path.stem for path in find_sheet("jobs", "two-combines").parent.glob("*.yaml"))
GOOD = find_sheet("jobs", "two-combines").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def validator():
    jsonschema.Draft202012Validator.check_schema(job_schema())
    return jsonschema.Draft202012Validator(job_schema())


def test_the_reference_is_made_from_the_classes_as_they_are():
    assert PAGE.read_text(encoding="utf-8") == reference(), "run: python -m docs.make.fleet"


def test_every_key_of_the_reference_says_what_it_means():
    rows = [
        line.split(" | ") for line in reference().partition(BEGIN)[2].splitlines() if line.startswith("| `")
    ]
    assert len(rows) > 35
    assert [row[0] for row in rows if row[3].strip(" |") == ""] == []


def test_a_bundled_job_is_printed_to_make_ones_own_of_it(capsys, tmp_path):
    assert main(["fleet", "list", "two-combines"]) == 0
    printed = capsys.readouterr().out
    assert printed == GOOD
    (tmp_path / "mine.yaml").write_text(printed)
    assert read_job(str(tmp_path / "mine.yaml"))[0] == read_job("two-combines")[0]
    assert main(["fleet", "list", "two-combine"]) == 2
    assert "did you mean 'two-combines'" in capsys.readouterr().err


@pytest.mark.parametrize(("old", "new"), RENAMED.items())
def test_a_job_by_its_name_of_0_2_is_read_with_a_line_that_says_the_new_one(old, new, capsys):
    job = read_job(old)[0]
    assert job.notes[0] == f"form: {old} is called {new} now: nothing drives in echelon"
    assert replace(job, notes=()) == read_job(new)[0]
    assert main(["fleet", "list", old]) == 0
    assert capsys.readouterr().out == find_sheet("jobs", new).read_text(encoding="utf-8")


def test_set_adds_a_machine_with_its_machine_alone(capsys, tmp_path):
    out = ["--out", str(tmp_path / "out")]
    assert main(["fleet", "run", "small-field", "--set", "combines.combin.speed_kmh=5", *out]) == 2
    assert "did you mean 'combine'?" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    job, _ = read_job(
        "small-field", ["carts.more.machine=tractor-grain-cart", "combines.combine.speed_kmh=5"]
    )
    assert list(job.carts) == ["cart", "more"]
    assert job.combines["combine"].speed_kmh == 5.0


def test_the_schema_is_written_where_the_first_line_of_a_job_says(tmp_path):
    assert all(
        find_sheet("jobs", name).read_text().startswith("# yaml-language-server: $schema=job.schema.json\n")
        for name in JOBS
    )
    assert main(["schema", "job", "--out", str(tmp_path / "job.schema.json")]) == 0
    assert json.loads((tmp_path / "job.schema.json").read_text()) == job_schema()


@pytest.mark.parametrize("name", JOBS)
def test_accepts_the_bundled_jobs(validator, name):
    data = parse(find_sheet("jobs", name).read_text(encoding="utf-8")).data
    assert [error.message for error in validator.iter_errors(data)] == []


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("plan", "order", "lanes"),
        ("plan", "land_passes", 0),
        ("plan", "overlap", 0.3),
        ("truck", "x_m", "east"),
    ],
)
def test_refuses_what_the_reader_refuses(validator, section, key, value):
    data = parse(GOOD).data
    data[section] = {**data.get(section, {}), key: value}
    assert len(list(validator.iter_errors(data))) == 1


def test_refuses_a_key_that_a_combine_does_not_have(validator):
    data = parse(GOOD).data
    name = next(iter(data["combines"]))
    data["combines"][name]["speed_mph"] = 4
    assert list(validator.iter_errors(data))


def test_units_are_in_the_descriptions(validator):
    carts = validator.schema["$defs"]["job.CartSettings"]["properties"]
    assert carts["speed_kmh"]["description"] == "speed on straight parts of paths [km/h]"
