"""Inputs of ten times the size cost at most twenty times as much, or are refused in one line."""

import json
import math
import time

import pytest

from swath.core.errors import InputError
from swath.documents.yaml_document import Document

LIMIT = 20.0  # memory beyond the caches costs up to 1.3 times as much; what grows squared comes to 100


def star(corners):
    """A ring in which every side crosses nearly every other one."""
    step = corners // 2 - 1
    angles = [2 * math.pi * (k * step % corners) / corners for k in range(corners)]
    ring = [[9 + 0.002 * math.cos(a), 52 + 0.0015 * math.sin(a)] for a in angles]
    return [*ring, ring[0]]


def wavy(corners):
    """An honest field with a border of many corners, one of which touches the side before."""
    angles = [2 * math.pi * k / corners for k in range(corners)]
    ring = [[9 + 0.002 * math.cos(a), 52 + 0.0015 * math.sin(a) * (1 + 1e-4 * (k % 2))]
            for k, a in enumerate(angles)]  # fmt: skip
    ring[5] = ring[2]
    return [*ring, ring[0]]


def geojson(path, ring):
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    return path


def test_a_star_is_refused_and_a_long_honest_border_is_read(tmp_path):
    pytest.importorskip("shapely")
    from swath.field_io.outline import read_outlines

    assert len(read_outlines(geojson(tmp_path / "a.geojson", wavy(20_000))).areas) == 1
    assert len(read_outlines(geojson(tmp_path / "b.geojson", star(21))).areas) >= 1
    for corners in (101, 3001, 20_001):
        with pytest.raises(InputError, match=f"its {corners + 1} corners that cross too often"):
            read_outlines(geojson(tmp_path / "c.geojson", star(corners)))


def test_candidates_have_a_number(tmp_path):
    from swath.tools.function_test.candidates import MOST, read_candidates

    file = tmp_path / "c.yaml"
    file.write_text("".join(f"c{k}: {{}}\n" for k in range(MOST)))
    assert len(read_candidates(file)) == MOST
    file.write_text("".join(f"c{k}: {{}}\n" for k in range(20_000)))
    with pytest.raises(InputError, match=f"at most {MOST} candidates"):
        read_candidates(file)


def test_events_have_a_number(tmp_path):
    from swath.runtime.changes import MOST_EVENTS, read_events

    file = tmp_path / "events.json"
    event = {"t_s": 1.0, "set": "combine.speed.speed_kmh", "value": 5}
    file.write_text(json.dumps([event] * MOST_EVENTS))
    assert len(read_events(file)) == MOST_EVENTS
    file.write_text(json.dumps([event] * 2 * MOST_EVENTS))
    with pytest.raises(InputError, match=f"at most {MOST_EVENTS}"):
        read_events(file)


def test_variables_of_an_fmu_have_a_number(tmp_path, monkeypatch):
    pytest.importorskip("fmpy")
    import zipfile

    from swath.link.fmi import description

    monkeypatch.setattr(description, "MOST_VARIABLES", 200)
    text = '<ScalarVariable name="v{0}" valueReference="{0}" causality="output"><Real/></ScalarVariable>'
    for count in (200, 201):
        variables = "".join(text.format(k) for k in range(count))
        with zipfile.ZipFile(tmp_path / "m.fmu", "w") as archive:
            archive.writestr(
                "modelDescription.xml",
                '<fmiModelDescription fmiVersion="2.0" modelName="m" guid="g"><CoSimulation '
                f'modelIdentifier="m"/><ModelVariables>{variables}</ModelVariables><ModelStructure/>'
                "</fmiModelDescription>",
            )
        if count == 200:
            assert len(description.read_fmu(tmp_path / "m.fmu").variables) == 200
        else:
            with pytest.raises(InputError, match="at most 200 variables, it has 201"):
                description.read_fmu(tmp_path / "m.fmu")


def brackets(count):
    from swath.core.packed_state import unpack

    head = json.dumps([[], None]).encode().replace(b"null", b"[" + b",".join([b"[]"] * count) + b"]")
    from swath.core.packed_state import LENGTH, MAGIC

    data = MAGIC + LENGTH.pack(len(head)) + head
    return lambda: unpack(data)


def events(count):
    from swath.replay.moments import events_of

    summary = {"events": [{"t_s": k / 10, "set": f"obstacles.{k}", "value": ""} for k in range(count)]}
    return lambda: events_of(summary, {})


def yaml_values(count):
    from swath.documents.yaml_document import parse

    text = "a: [" + ", ".join("1" for _ in range(count)) + "]\n"
    return lambda: parse(text + f"# {count}\n" + "#" * 70_000)


def summary(count):
    from swath.documents.validation import validate
    from swath.judge.summary import _Summary

    data = {"events": [{"t_s": 1.0, "set": "a", "value": 1} for _ in range(count)]}
    return lambda: validate(_Summary, data, (), Document(data))


def errors(text):
    return lambda count: lambda: InputError("key", text * count, text * count)


GROWING = {
    "brackets": (brackets, 20_000),
    "events": (events, 2_000),
    "YAML": (yaml_values, 1_000),
    "summary": (summary, 2_000),
    "error": (errors("9"), 20_000),
    "error of a list": (errors("name, "), 20_000),
    "error of lists": (errors("a, b, c, d; "), 2_000),
    "error of brackets": (errors("a (b "), 20_000),
}


@pytest.mark.parametrize("what", GROWING)
def test_ten_times_the_input_costs_at_most_twenty_times(what):
    make, count = GROWING[what]
    small, large = make(count), make(10 * count)
    ratios = []
    for _ in range(5):  # the machine may be busy: the best of five is the program's own
        spent = []
        for work in (small, large):
            begin = time.process_time()
            work()
            spent.append(time.process_time() - begin)
        ratios.append(spent[1] / max(spent[0], 1e-3))
        if ratios[-1] <= LIMIT:
            break
    assert min(ratios) <= LIMIT, ratios
